//! Changes that a command line makes to a scenario.

use calib_core::camera::Projection;

use super::{
    check::refuse,
    error::ScenarioError,
    file::{ScatterTable, Scenario, SensorTable},
    keys,
    planner::Placement,
};
use crate::world::Variant;

/// Changes to a scenario; nothing by default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overrides {
    /// The seed.
    pub seed: Option<u64>,
    /// The path, from 1.
    pub path: Option<u64>,
    /// Stops planned in view of each camera.
    pub stops: Option<usize>,
    /// Method by which these are chosen.
    pub placement: Option<Placement>,
    /// Cameras of a grid.
    pub nodes: Option<usize>,
    /// Model by which pictures are made. With `stage` the real projection follows; otherwise unless the file sets
    /// it.
    pub variant: Option<Variant>,
    /// The projection that all nodes believe in.
    pub model: Option<Projection>,
    /// Step sensors drift as [`SensorTable::DRIFT`] says.
    pub drift: bool,
    /// Share of frames that the radio loses.
    pub loss: Option<f64>,
    /// Distance of cameras from where the file has them.
    pub scatter: Option<ScatterTable>,
}

impl Overrides {
    pub(super) fn apply(&self, scenario: &mut Scenario) -> Result<(), ScenarioError> {
        let scatter = self.scatter.unwrap_or_default();
        for (key, value) in [
            ("path", self.path.map(|path| path as f64)),
            ("stops", self.stops.map(|stops| stops as f64)),
            ("grid.nodes", self.nodes.map(|nodes| nodes as f64)),
            ("radio.loss", self.loss),
            ("scatter.position", Some(scatter.position)),
            ("scatter.heading_deg", Some(scatter.heading_deg)),
        ] {
            if let Some(value) = value {
                keys::check_number(key, value)?;
            }
        }
        if !scenario.is_planned() {
            let changed = [
                ("path", self.path.is_some()),
                ("stops", self.stops.is_some()),
                ("placement", self.placement.is_some()),
            ];
            if let Some((option, _)) = changed.into_iter().find(|(_, is_changed)| *is_changed) {
                let allowed = "left out: it is about planned stops, and the file gives the `stops` of all targets";
                return Err(refuse(option, "given", allowed));
            }
        }
        scenario.seed = self.seed.unwrap_or(scenario.seed);
        scenario.path = self.path.unwrap_or(scenario.path);
        scenario.stops = self.stops.unwrap_or(scenario.stops);
        scenario.placement = self.placement.unwrap_or(scenario.placement);
        scenario.scatter = self.scatter.unwrap_or(scenario.scatter);
        if let Some(nodes) = self.nodes {
            match &mut scenario.grid {
                Some(grid) => grid.nodes = nodes,
                None => {
                    let allowed = "left out: only scenarios with a `grid` have it";
                    return Err(refuse("nodes", nodes, allowed));
                }
            }
        }
        scenario.camera.variant = self.variant.unwrap_or(scenario.camera.variant);
        if self.variant == Some(Variant::Stage) {
            // Stage has no other.
            scenario.camera.projection = None;
        }
        if self.model.is_some() {
            scenario.camera.model.projection = self.model;
            for camera in scenario.networks.iter_mut().flat_map(|n| &mut n.cameras) {
                if let Some(model) = &mut camera.model {
                    model.projection = self.model;
                }
            }
        }
        if self.drift {
            scenario.sensor = Some(SensorTable::DRIFT);
            // It measures where it stands, too.
            scenario.firmware.standing_sigma = Some(0.0);
        }
        if let Some(share) = self.loss {
            scenario.radio.set_loss(share);
        }
        Ok(())
    }
}
