//! A site in one file: what is deployed, and what a rehearsal of it adds.
//!
//! A file says where cameras, targets and obstacles are, what the nodes are configured to, and what
//! goes wrong when. [`Scenario::load`] reads and checks it. [`configs`] makes the configuration of
//! every node of it, the same for a rehearsal and for boards; [`provision`] refuses to do so for
//! boards while something that matters is left open. [`Scenario::put_up`] makes the world of it and
//! plans the targets' stops where the file does not give them. [`design`] tells what to expect of it
//! before anything is mounted.
//!
//! | built in | what |
//! |---|---|
//! | `thesis-13` | Thesis, sections 4.2 to 4.4: the 13 cameras of Table 4.1. |
//! | `lab` | Thesis, sections 3.4 and 3.5: two references and a camera at five placements. |
//! | `grid` | Sites of any size: [`grid`]. |
//! | `office` | An L-shaped floor of 20 cameras, and a person with a step sensor. |
//!
//! The files are in `host/site/scenarios`; each is an example of the format, which `docs/site.md`
//! describes. Every key is in [`keys::KEYS`]; others are refused, and a wrong value is named with
//! its line and its range.
//!
//! # Random numbers
//! Stops are planned from the number of the path alone, unless cameras are scattered. All else comes
//! from the seed.
//!
//! # Example
//! ```
//! use site::{Overrides, Scenario};
//!
//! let changes = Overrides { path: Some(2), ..Overrides::default() };
//! let site = Scenario::load("thesis-13", &changes)?.put_up()?;
//! let network = &site.networks[0];
//! assert_eq!(network.cameras.len(), 13);
//! let plan = network.targets[0].plan.as_ref().unwrap();
//! assert!(plan.stops[0].for_references);
//! # Ok::<(), site::ScenarioError>(())
//! ```

use std::{
    fs::File,
    io::{self, Read},
    path::Path,
};

mod assume;
mod check;
mod configs;
pub mod design;
pub mod durable;
mod error;
mod event;
mod file;
mod firmware;
pub mod grid;
pub mod key_file;
pub mod keys;
mod meant;
pub mod node;
mod overrides;
pub mod page_file;
pub mod planner;
mod put_up;
mod scatter;
pub mod world;

pub use assume::{Assumption, Purpose};
pub use configs::{NetworkConfigs, configs, coordinator_id, provision};
pub use error::ScenarioError;
pub use event::{Action, Forgery, ScriptedEvent};
use file::Source;
pub use file::{
    CameraTable, FrameTable, GridTable, ModelTable, NetworkTable, ObjectTable, ObstacleTable,
    OutlineTable, PillarTable, PlacedCamera, RadioTable, ReferencesTable, ScatterTable, Scenario,
    SensorName, SensorTable, TargetTable, WalkTable, WorldTable,
};
pub use firmware::FirmwareTable;
pub use meant::nearest;
pub use overrides::Overrides;
pub use put_up::{CameraNode, Frame, MovingObject, Network, Site, TargetNode, obstacles};

/// Coordinators have no numbers in a scenario: the first network's gets this one, the second's the
/// next one, and so on. All other nodes have lower ones.
pub const FIRST_COORDINATOR: u16 = 60_000;

/// The last path that can be planned.
pub const PATH_MAX: u64 = 1_000_000_000;

/// Names and texts of the built-in scenarios.
pub const BUILT_IN: [(&str, &str); 4] = [
    ("thesis-13", include_str!("../scenarios/thesis-13.toml")),
    ("lab", include_str!("../scenarios/lab.toml")),
    ("grid", include_str!("../scenarios/grid.toml")),
    ("office", include_str!("../scenarios/office.toml")),
];

/// Bytes of a site's file.
pub const FILE_MAX: u64 = 4 << 20;

/// A device may have no end.
fn read(name: &str) -> io::Result<String> {
    let mut text = String::new();
    File::open(name)?
        .take(FILE_MAX + 1)
        .read_to_string(&mut text)?;
    match text.len() as u64 > FILE_MAX {
        true => Err(io::Error::other(format!(
            "it has more than {FILE_MAX} bytes"
        ))),
        false => Ok(text),
    }
}

/// End of the name of a site's file.
const SITE_EXTENSION: &str = "toml";

/// Error of a name that is neither built in nor that of a file.
fn unknown(name: &str) -> ScenarioError {
    let file = format!("{name}.{SITE_EXTENSION}");
    let file = Path::new(&file).is_file().then_some(file);
    let known = BUILT_IN.iter().map(|(known, _)| (*known).to_owned());
    ScenarioError::Unknown {
        name: name.into(),
        known: known.chain(file).collect(),
    }
}

impl Scenario {
    /// A built-in scenario, or one from a file whose name ends in `.toml`.
    ///
    /// # Errors
    /// [`ScenarioError`].
    pub fn load(name: &str, changes: &Overrides) -> Result<Self, ScenarioError> {
        if let Some((_, text)) = BUILT_IN.iter().find(|(known, _)| *known == name) {
            return Self::from_toml(text, changes);
        }
        let path = Path::new(name);
        if path.is_dir() {
            return Err(ScenarioError::Folder(name.into()));
        }
        let is_site = |extension: &std::ffi::OsStr| extension.eq_ignore_ascii_case(SITE_EXTENSION);
        if !path.extension().is_some_and(is_site) {
            return Err(match path.exists() {
                true => ScenarioError::OtherFile(name.into()),
                false => unknown(name),
            });
        }
        let text = read(name).map_err(|source| ScenarioError::File {
            path: name.into(),
            source,
        })?;
        Self::from_toml(&text, changes)
    }

    /// A scenario from the text of a file, changed and checked, with the networks of its grid.
    ///
    /// # Errors
    /// [`ScenarioError`].
    pub fn from_toml(text: &str, changes: &Overrides) -> Result<Self, ScenarioError> {
        keys::check(text)?;
        let mut scenario: Self = toml::from_str(text)?;
        changes.apply(&mut scenario)?;
        scenario.source = Source(text.into());
        grid::expand(&mut scenario)?;
        check::scenario(&scenario).map_err(|error| scenario.located(error))?;
        Ok(scenario)
    }

    /// An error with its line in the file.
    fn located(&self, error: ScenarioError) -> ScenarioError {
        let field = match &error {
            ScenarioError::Value { field, .. } => Some(field.clone()),
            ScenarioError::Config { node, .. } => self.named(*node),
            _ => None,
        };
        let line = field.and_then(|field| keys::line_of(&self.source.0, &field));
        match line {
            Some(line) => error.at_line(line),
            None => error,
        }
    }

    /// Name of a node in the file, such as `network 1.camera 3`.
    fn named(&self, node: u16) -> Option<String> {
        (1..).zip(&self.networks).find_map(|(n, network)| {
            let cameras = network.cameras.iter().map(|camera| ("camera", camera.id));
            let camera = (1..).zip(cameras);
            let targets = network.targets.iter().map(|target| ("target", target.id));
            let target = (1..).zip(targets);
            let mut all = camera.chain(target);
            let (place, (kind, _)) = all.find(|(_, (_, id))| *id == node)?;
            Some(format!("network {n}.{kind} {place}"))
        })
    }

    /// Length of its unit.
    pub fn metres_per_unit(&self) -> f64 {
        self.unit_metres.unwrap_or(1.0)
    }

    /// Returns true if the stops of any target are planned. Otherwise the file gives all of them.
    pub(crate) fn is_planned(&self) -> bool {
        let mut targets = self.networks.iter().flat_map(|network| &network.targets);
        self.grid.is_some() || targets.any(|target| target.stops.is_none())
    }

    /// Number of its path in the record of a run.
    pub fn recorded_path(&self) -> Option<u32> {
        u32::try_from(self.path).ok()
    }

    /// Makes its world, with its cameras where the file has them, and plans the stops that it does not
    /// give.
    ///
    /// # Errors
    /// No plan is possible, a camera stands in an obstacle, or a target would walk through one.
    pub fn put_up(&self) -> Result<Site, ScenarioError> {
        put_up::put_up(self).map_err(|error| self.located(error))
    }
}
