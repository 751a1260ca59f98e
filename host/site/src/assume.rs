//! Values that a file leaves open although they matter.

use std::{f64::consts::PI, fmt};

use node_firmware::config::TargetConfig;

use super::{
    file::{CameraTable, DEFAULT_UNIT, Scenario},
    firmware::FirmwareTable,
};
use crate::world::Variant;

/// Purpose of a site's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A simulation.
    Rehearsal,
    /// Real nodes.
    Deployment,
}

/// Something that a file does not say, and on which results depend.
#[derive(Clone, Debug, PartialEq)]
pub struct Assumption {
    /// The key, and what is assumed without it.
    pub what: String,
    /// Text to write into the file.
    pub write: String,
}

impl fmt::Display for Assumption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: write {}", self.what, self.write)
    }
}

/// The fastest walk of a person, metres a second; most walk at about 1.
const FASTEST_WALK: f64 = 3.0;

impl Scenario {
    /// Values that may be written but are hardly meant, with what they may be instead.
    pub fn doubts(&self) -> Vec<String> {
        let mut all = Vec::new();
        let is_metre_known = self.unit_metres.is_some() || self.unit != DEFAULT_UNIT;
        let speed = self.walk.speed * self.metres_per_unit();
        if is_metre_known && speed > FASTEST_WALK {
            all.push(format!(
                "`walk.speed` is {} {} a second, and a person walks about 1 m a second: is it in another unit?",
                self.walk.speed, self.unit
            ));
        }
        let views = self.networks.iter().flat_map(|network| &network.cameras);
        let views = views.map(|camera| (camera.id, self.camera.for_camera(camera)));
        let mut views = views.filter_map(|(id, camera)| Some((id, camera.field_of_view_deg?)));
        if let Some((id, view)) = views.find(|(_, view)| *view <= PI) {
            all.push(format!(
                "`field_of_view_deg` of camera {id} is {view}: is it in radians? In degrees that is {:.1}",
                view.to_degrees()
            ));
        }
        all
    }

    /// Values that it leaves open although they matter for this purpose: the assumption, and what to write. A
    /// rehearsal tells these, a deployment is refused until they are said.
    pub fn assumptions(&self, purpose: Purpose) -> Vec<Assumption> {
        let mut all = Vec::new();
        let mut assume = |is_said: bool, what: String, write: String| {
            if !is_said {
                all.push(Assumption { what, write });
            }
        };
        let networks = &self.networks;
        let cameras = networks.iter().flat_map(|network| &network.cameras);
        let tables: Vec<_> = cameras
            .map(|camera| (camera.id, self.camera.for_camera(camera)))
            .collect();
        // Those that do not say it, by their numbers.
        let silent = |says: fn(&CameraTable) -> bool| {
            let silent = tables.iter().filter(|(_, table)| !says(table));
            whose("camera", &silent.map(|(id, _)| *id).collect::<Vec<_>>())
        };
        let views = silent(|table| {
            table
                .field_of_view_deg
                .or(table.model.field_of_view_deg)
                .is_some()
        });
        assume(
            views.is_none(),
            format!(
                "the field of view of {} is assumed to be {} degrees",
                views.unwrap_or_default(),
                self.camera.field_of_view_deg()
            ),
            "`field_of_view_deg` into `[camera]`, or into each camera: a CMUcam2's is 44 to 50 \
             degrees, by lens; docs/deploy.md tells how to measure it"
                .into(),
        );
        let projections = silent(|table| {
            table.projection.or(table.model.projection).is_some() || table.variant == Variant::Stage
        });
        assume(
            projections.is_none(),
            format!(
                "the lens of {} is assumed to be a pin-hole",
                projections.unwrap_or_default()
            ),
            "`projection = \"pin-hole\"` (most lenses) or `\"equal-angle\"` into `[camera]`".into(),
        );
        let usual = TargetConfig::default();
        let targets = networks.iter().flat_map(|network| &network.targets);
        let parameters: Vec<(u16, FirmwareTable)> = targets
            .map(|target| {
                let own = target.firmware.unwrap_or_default();
                (target.id, own.over(self.firmware))
            })
            .collect();
        let silent = |says: fn(&FirmwareTable) -> bool| {
            let silent = parameters.iter().filter(|(_, table)| !says(table));
            whose("target", &silent.map(|(id, _)| *id).collect::<Vec<_>>())
        };
        let headings = silent(|table| table.systematic_heading_deg.is_some());
        assume(
            headings.is_none(),
            format!(
                "the compass of {} is assumed to be off by {} degrees (standard deviation)",
                headings.unwrap_or_default(),
                usual.systematic_heading_deg
            ),
            "`systematic_heading_deg` into `[firmware]`: 3 for a person who has not been measured"
                .into(),
        );
        let scales = silent(|table| table.systematic_scale.is_some());
        assume(
            scales.is_none(),
            format!(
                "the step length of {} is assumed to be off by {} of it (standard deviation)",
                scales.unwrap_or_default(),
                usual.systematic_scale
            ),
            "`systematic_scale` into `[firmware]`: 0.08 for a person who has not been measured, \
             0.03 for one who has"
                .into(),
        );
        match purpose {
            Purpose::Rehearsal => assume(
                self.sensor.is_some(),
                "the simulated carrier is assumed to report the way from goal to goal as it was \
                 planned, as the thesis's robot does"
                    .into(),
                "`[sensor]` with `measures = false`, or `measures = true` and how it errs".into(),
            ),
            Purpose::Deployment => {
                let is_metre = (self.metres_per_unit() - 1.0).abs() < 1e-9;
                let lengths = silent(|table| table.step_length.is_some()).filter(|_| !is_metre);
                assume(
                    lengths.is_none(),
                    format!(
                        "the step length of {} is not known in the unit of this site, {}",
                        lengths.unwrap_or_default(),
                        self.unit
                    ),
                    format!(
                        "`step_length` into `[firmware]`: an adult's is {} m",
                        usual.sensor.step_length
                    ),
                );
            }
        }
        all
    }
}

/// Nodes that something is about; `None` if there are none.
fn whose(what: &str, ids: &[u16]) -> Option<String> {
    let (first, rest) = ids.split_first()?;
    Some(match rest {
        [] => format!("{what} {first}"),
        [second] => format!("{what}s {first} and {second}"),
        _ => format!("{} {what}s ({first} and others)", ids.len()),
    })
}
