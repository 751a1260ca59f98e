//! A small site: five cameras around a yard, which all see its middle.

use std::{cell::RefCell, collections::BTreeMap, io, rc::Rc};

use host_sim::network::{Options, Simulation};
use results::record::{Node, RunRecord};
use site::{Action, Overrides, Scenario, ScriptedEvent};
use test_support::chi_squared_band;

/// The cameras that are no references.
pub(crate) const OTHERS: [u16; 3] = [3, 4, 5];
/// The target.
pub(crate) const TARGET: u16 = 20;
/// The coordinator, in the events of a scenario.
pub(crate) const COORDINATOR: u16 = 0;

/// Options of a yard, as TOML.
pub(crate) struct Yard<'a> {
    /// Further configuration of the nodes.
    pub(crate) firmware: &'a str,
    /// Whole tables.
    pub(crate) tables: &'a str,
    /// Sigmas of the carrier's systematic errors: degrees, and a share of the distance.
    pub(crate) systematic: (&'a str, &'a str),
    /// The network's references.
    pub(crate) references: &'a str,
    /// The network's targets.
    pub(crate) targets: &'a str,
}

/// Ten stops in view of all.
pub(crate) const STOPS: &str = "[3.0, 3.2], [5.0, 3.4], [4.2, 5.2], [2.8, 4.8], [5.2, 5.4], [3.4, 4.0], \
                         [4.6, 4.3], [3.9, 3.1], [4.9, 4.9], [3.2, 5.4]";

impl Default for Yard<'_> {
    fn default() -> Self {
        Self {
            firmware: "",
            tables: "",
            systematic: ("0.0", "0.0"),
            references: "cameras = [1, 2]",
            targets: "{ id = 20, stops = [STOPS] }",
        }
    }
}

impl Yard<'_> {
    pub(crate) fn scenario(&self, seed: u64) -> Scenario {
        let targets = self.targets.replace("STOPS", STOPS);
        let Self {
            tables,
            systematic: (heading, scale),
            firmware,
            references,
            ..
        } = self;
        let text = format!(
            r#"
            name = "yard"
            [world]
            low = [-3.0, -3.0]
            high = [11.0, 11.0]
            # The target reports the way from goal to goal.
            [firmware]
            systematic_heading_deg = {heading}
            systematic_scale = {scale}
            standing_sigma = 0.01
            {firmware}
            {tables}
            [[network]]
            references = {{ {references} }}
            camera = [
              {{ id = 1, x = 0.0, y = 0.0, heading_deg = 45.0 }},
              {{ id = 2, x = 8.0, y = 0.0, heading_deg = 135.0 }},
              {{ id = 3, x = 4.0, y = 9.0, heading_deg = 270.0 }},
              {{ id = 4, x = -1.0, y = 5.0, heading_deg = 0.0 }},
              {{ id = 5, x = 9.0, y = 6.0, heading_deg = 190.0 }},
            ]
            target = [{targets}]
            "#
        );
        let seed = Overrides {
            seed: Some(seed),
            ..Overrides::default()
        };
        Scenario::from_toml(&text, &seed).unwrap().exact()
    }
}

/// A writer that others can read.
#[derive(Clone, Default)]
struct Pages(Rc<RefCell<Vec<u8>>>);

impl io::Write for Pages {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

pub(crate) fn run(scenario: Scenario) -> RunRecord {
    let mut simulation = Simulation::new(scenario, Options::default()).unwrap();
    simulation.run(|_| ())
}

/// The record and the log.
pub(crate) fn logged(scenario: Scenario) -> (RunRecord, String) {
    let pages = Pages::default();
    let options = Options {
        log: Some(Box::new(pages.clone())),
        ..Options::default()
    };
    let record = Simulation::new(scenario, options).unwrap().run(|_| ());
    (record, String::from_utf8(pages.0.take()).unwrap())
}

/// The record as JSON, and the log.
pub(crate) fn written(scenario: Scenario) -> (String, String) {
    let (record, log) = logged(scenario);
    (record.to_json(false).unwrap(), log)
}

/// The scenario with a fault.
pub(crate) fn with(mut scenario: Scenario, at_s: f64, action: Action) -> Scenario {
    scenario.events.push(ScriptedEvent { at_s, action });
    scenario
}

pub(crate) fn node(record: &RunRecord, id: u16) -> &Node {
    record.nodes.iter().find(|node| node.id == id).unwrap()
}

/// Limit of the squared error over covariance, three numbers: a larger one comes once in a million.
const NEES_MAX: f64 = 30.7;

/// Every camera has a pose that is as good as it says.
#[track_caller]
pub(crate) fn assert_all_calibrated(record: &RunRecord, what: &str) {
    assert_calibrated_within(record, what, 0.3);
}

/// Over several runs pose errors agree with their sigmas. The cameras of a run have the error of its
/// references in common, so that each run counts as three independent numbers only.
#[track_caller]
pub(crate) fn assert_fair(records: &[RunRecord]) {
    let mut chi_squared = 0.0;
    for record in records {
        let nees: Vec<f64> = record.cameras().filter_map(|camera| camera.nees).collect();
        assert!(!nees.is_empty());
        chi_squared += nees.iter().sum::<f64>() / nees.len() as f64;
    }
    let band = chi_squared_band(3.0 * records.len() as f64);
    println!("chi squared {chi_squared:.2}, between {band:.2?}");
    assert!(band.contains(&chi_squared), "{chi_squared}, not {band:?}");
}

/// The same, where poses cannot be foretold better than this sigma of the position.
#[track_caller]
pub(crate) fn assert_calibrated_within(record: &RunRecord, what: &str, widest: f64) {
    for camera in record.cameras() {
        let id = camera.id;
        let (Some(estimate), Some(error)) = (&camera.estimate, camera.error) else {
            panic!(
                "{what}: camera {id} is not calibrated, with {} sightings",
                camera.sightings
            );
        };
        // A given number has no sigma.
        for (error, sigma) in [
            (error.x, estimate.sigma_x),
            (error.y, estimate.sigma_y),
            (error.heading_deg, estimate.sigma_heading_deg),
        ] {
            assert!(
                error.abs() <= 5.0 * sigma + 1e-6,
                "{what}: camera {id} errs by {error}, and foretells {sigma}"
            );
        }
        assert!(
            camera.nees.is_none_or(|nees| nees < NEES_MAX),
            "{what}: camera {id}: squared error over predicted covariance {:?}",
            camera.nees
        );
        assert!(
            estimate.sigma_position() < widest,
            "{what}: camera {id} is weak"
        );
    }
}

/// No camera ever tells a target of fewer sightings than it told before.
#[track_caller]
pub(crate) fn assert_nothing_forgotten(log: &str, what: &str) {
    let mut most = BTreeMap::new();
    for line in log.lines() {
        let answer = line.split_once(": Look(").zip(line.split_once("counted: "));
        let Some(((sender, _), (_, counted))) = answer else {
            continue;
        };
        let node = sender.split_whitespace().nth(2).unwrap();
        let digits = counted.split(',').next().unwrap();
        let counted: u32 = digits.parse().unwrap();
        let before = most.insert(node.to_owned(), counted).unwrap_or(0);
        assert!(counted >= before, "{what}: {line}, after {before}");
    }
    assert!(
        most.values().any(|&counted| counted > 2),
        "{what}: nothing was learnt"
    );
}

/// Moments of a run at which nodes do different things: at each stop as it is told, while cameras
/// look, a while later, and on the way to the next one.
pub(crate) fn moments(record: &RunRecord) -> Vec<f64> {
    let stops: Vec<f64> = record.targets[0]
        .stops
        .iter()
        .filter_map(|s| s.seconds)
        .collect();
    let ways = stops.windows(2).map(|leg| f64::midpoint(leg[0], leg[1]));
    let standing = stops
        .iter()
        .flat_map(|at| [0.002, 0.05, 0.9].map(|after| at + after));
    let mut moments: Vec<f64> = standing.chain(ways).collect();
    moments.sort_by(f64::total_cmp);
    moments
}
