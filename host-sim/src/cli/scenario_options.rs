//! The scenario, and changes to it by the command line.

use std::path::Path;

use clap::{Args, ValueEnum};
use site::world::Variant;
use site::{
    BUILT_IN, Overrides, Purpose, ScatterTable, Scenario, ScenarioError, planner::Placement,
};

use super::{of_site, tell, values};

/// Heading for these options.
pub(super) const FOR_SCENARIO: &str = "Scenario";

#[derive(Args)]
pub(super) struct ScenarioOptions {
    /// `thesis-13`, `lab`, `grid`, `office`, or a file.
    #[arg(value_name = "SCENARIO|FILE.toml")]
    scenario: String,
    /// Number of the planned way that the target takes, from 1.
    #[arg(long, value_name = "K", value_parser = values::path)]
    path: Option<u64>,
    /// Stops that are planned in view of each camera.
    #[arg(long, value_name = "N", value_parser = values::count)]
    stops: Option<usize>,
    /// Places of these stops: where they help most; there, and on until every pose is checked; or
    /// anywhere in view.
    #[arg(long, value_name = "HOW")]
    placement: Option<Place>,
    /// Cameras of a grid.
    #[arg(long, value_name = "N", value_parser = values::count)]
    nodes: Option<usize>,
    /// Way of making pictures: rendered and counted, or by a scan of equal angles as in Stage.
    #[arg(long, value_name = "KIND")]
    camera: Option<Kind>,
    /// The lens that all nodes believe to have, whatever they have.
    #[arg(long, value_name = "LENS")]
    decode: Option<Decode>,
    /// Step sensors drift: 1 % of the distance and 0.5 degrees per leg.
    #[arg(long)]
    drift: bool,
    /// Share of the frames that the radio loses, 0 to 1.
    #[arg(long, value_name = "SHARE", value_parser = values::share)]
    loss: Option<f64>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Place {
    Planned,
    Checked,
    Anywhere,
}

#[derive(Clone, Copy, ValueEnum)]
enum Kind {
    Cmucam2,
    Stage,
}

#[derive(Clone, Copy, ValueEnum)]
enum Decode {
    PinHole,
    EqualAngle,
}

impl ScenarioOptions {
    /// The file that is read, if the scenario is not built in.
    pub(super) fn file(&self) -> Option<&Path> {
        let is_built_in = BUILT_IN.iter().any(|(name, _)| *name == self.scenario);
        (!is_built_in).then_some(Path::new(&self.scenario))
    }

    /// The scenario, with this seed, path and scatter or its own.
    pub(super) fn load(
        &self,
        seed: Option<u64>,
        path: Option<u64>,
        scatter: Option<ScatterTable>,
    ) -> anyhow::Result<Scenario> {
        let changes = Overrides {
            seed,
            path: path.or(self.path),
            stops: self.stops,
            placement: self.placement.map(|place| match place {
                Place::Planned => Placement::Planned,
                Place::Checked => Placement::Checked,
                Place::Anywhere => Placement::Anywhere,
            }),
            nodes: self.nodes,
            variant: self.camera.map(|kind| match kind {
                Kind::Cmucam2 => Variant::Cmucam2,
                Kind::Stage => Variant::Stage,
            }),
            model: self.decode.map(|lens| match lens {
                Decode::PinHole => calib_core::camera::Projection::PinHole,
                Decode::EqualAngle => calib_core::camera::Projection::EqualAngle,
            }),
            drift: self.drift,
            loss: self.loss,
            scatter,
        };
        Scenario::load(&self.scenario, &changes).map_err(|error| self.named(error))
    }

    /// Tells which important things the scenario leaves open, and what is assumed.
    pub(super) fn tell_assumptions(&self, scenario: &Scenario) {
        tell_assumptions(&self.scenario, scenario);
    }

    /// Error in the scenario, with the scenario's name.
    pub(super) fn named(&self, error: ScenarioError) -> anyhow::Error {
        of_site(&self.scenario, error)
    }
}

/// Tells which important things the scenario of this name leaves open, what is assumed, and what is hardly meant.
pub(super) fn tell_assumptions(name: &str, scenario: &Scenario) {
    for assumption in scenario.assumptions(Purpose::Rehearsal) {
        tell(format_args!("{name}: {assumption}"));
    }
    tell_doubts(name, scenario);
}

/// Tells what is hardly meant as the file of this name has it.
pub(super) fn tell_doubts(name: &str, scenario: &Scenario) {
    for doubt in scenario.doubts() {
        tell(format_args!("{name}: {doubt}"));
    }
}
