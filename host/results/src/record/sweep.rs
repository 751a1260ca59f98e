//! Many runs of one scenario: how errors are spread over seeds, per camera, overall and along the
//! targets' ways.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{RunRecord, checks::Checked};
use crate::accuracy::{WithinSigmas, quantile};

/// The runs are of different scenarios.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("one run is of {0}, another of {1}: a sweep is over one scenario")]
pub struct OtherScenario(String, String);

/// Collects runs. It keeps a few numbers per camera and stop of a run.
#[derive(Clone, Debug, Default)]
pub struct Sweep {
    scenario: Option<(String, String)>,
    runs: usize,
    complete: usize,
    checked: Checked,
    groups: BTreeMap<Group, Samples>,
}

/// Group of poses whose errors are counted together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Group {
    /// Every camera.
    All,
    /// Every camera that is no reference.
    Cameras,
    /// One camera.
    Camera(u16),
    /// Place of a target at one of its stops, as it believed.
    Stop {
        /// Number of the target.
        target: u16,
        /// Number of the stop.
        stop: u32,
    },
}

/// Quantity of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Signed errors; quantiles are of their size.
    X,
    /// As x.
    Y,
    /// Distance.
    Position,
    /// As x, degrees.
    HeadingDeg,
}

impl Quantity {
    const ALL: [Self; 4] = [Self::X, Self::Y, Self::Position, Self::HeadingDeg];

    /// For headings of tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Position => "position",
            Self::HeadingDeg => "heading",
        }
    }
}

#[derive(Clone, Debug, Default)]
struct Samples {
    expected: usize,
    calibrated: usize,
    components: [Component; 4],
}

#[derive(Clone, Debug, Default)]
struct Component {
    errors: Vec<f64>,
    sigmas: Vec<f64>,
    within: WithinSigmas,
}

impl Component {
    fn add(&mut self, error: f64, sigma: f64) {
        self.errors.push(error.abs());
        self.sigmas.push(sigma);
        // A given value is not an estimate.
        if sigma > 0.0 {
            self.within.add(error.abs() / sigma);
        }
    }
}

/// The statistics of one quantity over one group: a row of the CSV.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// `all`, `cameras` (no references), `camera 3`, `target 20 stop 5`.
    pub group: String,
    /// Quantity of the pose.
    pub quantity: Quantity,
    /// Poses there should be.
    pub expected: usize,
    /// Number of them that are: cameras whose status is `calibrated`, stops that a target had a place for. The
    /// fields below are of all poses, whatever they are worth.
    pub calibrated: usize,
    /// Root of the mean square of the errors, as all that follows; empty where there are none.
    pub rms: Option<f64>,
    /// Quantile of the absolute errors.
    pub p05: Option<f64>,
    /// Quantile of the absolute errors.
    pub p25: Option<f64>,
    /// Quantile of the absolute errors.
    pub p50: Option<f64>,
    /// Quantile of the absolute errors.
    pub p75: Option<f64>,
    /// Quantile of the absolute errors.
    pub p90: Option<f64>,
    /// Quantile of the absolute errors.
    pub p95: Option<f64>,
    /// The largest absolute error.
    pub max: Option<f64>,
    /// Root of the mean square of the predicted sigmas.
    pub sigma_rms: Option<f64>,
    /// Share of the errors within 1 sigma; 0.683 is foretold. Empty for distances.
    pub within_1: Option<f64>,
    /// Share within 2; 0.954 is foretold.
    pub within_2: Option<f64>,
    /// Share within 3; 0.997 is foretold.
    pub within_3: Option<f64>,
}

/// The statistics of all groups.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepReport {
    /// Name of the scenario.
    pub scenario: String,
    /// Name of the unit of length.
    pub unit: String,
    /// Number of runs.
    pub runs: usize,
    /// In how many of them every camera that should be calibrated was.
    pub complete: usize,
    /// Number of poses that are checked in all of them.
    pub checked: Checked,
    /// All groups, four rows each (stops: three, without heading), in the order of [`Group`].
    pub rows: Vec<(Group, Row)>,
}

impl Sweep {
    /// Takes one run. The order of runs makes no difference.
    ///
    /// # Errors
    /// [`OtherScenario`]; the run is left out then.
    pub fn add(&mut self, record: &RunRecord) -> Result<(), OtherScenario> {
        let name = || (record.scenario.clone(), record.unit.name.clone());
        let (scenario, _) = self.scenario.get_or_insert_with(name);
        if *scenario != record.scenario {
            let other = record.scenario.clone();
            return Err(OtherScenario(scenario.clone(), other));
        }
        self.runs += 1;
        self.checked = self.checked.and(Checked::of(record));
        let summary = &record.summary;
        self.complete += usize::from(summary.calibrated == summary.expected);
        for camera in record.cameras().filter(|camera| camera.expected) {
            let mut groups = vec![Group::All, Group::Camera(camera.id)];
            if !camera.reference {
                groups.push(Group::Cameras);
            }
            for group in groups {
                let samples = self.groups.entry(group).or_default();
                samples.expected += 1;
                samples.calibrated += usize::from(camera.is_calibrated());
                let (Some(estimate), Some(error)) = (&camera.estimate, camera.error) else {
                    continue;
                };
                let [x, y, position, heading] = &mut samples.components;
                x.add(error.x, estimate.sigma_x);
                y.add(error.y, estimate.sigma_y);
                position.add(error.x.hypot(error.y), estimate.sigma_position());
                heading.add(error.heading_deg, estimate.sigma_heading_deg);
            }
        }
        for target in &record.targets {
            for stop in &target.stops {
                let group = Group::Stop {
                    target: target.id,
                    stop: stop.stop,
                };
                let samples = self.groups.entry(group).or_default();
                samples.expected += 1;
                if let Some(believed) = &stop.believed {
                    samples.calibrated += 1;
                    let (dx, dy) = (believed.x - stop.x, believed.y - stop.y);
                    let [x, y, position, _] = &mut samples.components;
                    x.add(dx, believed.sigma_x);
                    y.add(dy, believed.sigma_y);
                    position.add(dx.hypot(dy), believed.sigma_x.hypot(believed.sigma_y));
                }
            }
        }
        Ok(())
    }

    /// The statistics; `None` if there was no run.
    pub fn finish(self) -> Option<SweepReport> {
        let (scenario, unit) = self.scenario?;
        let mut rows = Vec::new();
        for (group, samples) in self.groups {
            let is_stop = matches!(group, Group::Stop { .. });
            let counts = [samples.expected, samples.calibrated];
            for (quantity, component) in Quantity::ALL.into_iter().zip(samples.components) {
                if !(is_stop && quantity == Quantity::HeadingDeg) {
                    rows.push((group, row(group, quantity, counts, component)));
                }
            }
        }
        Some(SweepReport {
            scenario,
            unit,
            runs: self.runs,
            complete: self.complete,
            checked: self.checked,
            rows,
        })
    }
}

fn row(
    group: Group,
    quantity: Quantity,
    [expected, calibrated]: [usize; 2],
    component: Component,
) -> Row {
    let Component {
        mut errors,
        mut sigmas,
        within,
    } = component;
    // In this order sums are the same for any order of runs.
    errors.sort_unstable_by(f64::total_cmp);
    sigmas.sort_unstable_by(f64::total_cmp);
    let rms = |values: &[f64]| {
        let squares: f64 = values.iter().map(|v| v * v).sum();
        (!values.is_empty()).then(|| (squares / values.len() as f64).sqrt())
    };
    let p = |q| quantile(&errors, q);
    let shares = within.shares().filter(|_| quantity != Quantity::Position);
    let [within_1, within_2, within_3] = match shares {
        Some(shares) => shares.map(Some),
        None => [None; 3],
    };
    Row {
        group: match group {
            Group::All => "all".to_owned(),
            Group::Cameras => "cameras".to_owned(),
            Group::Camera(id) => format!("camera {id}"),
            Group::Stop { target, stop } => format!("target {target} stop {stop}"),
        },
        quantity,
        expected,
        calibrated,
        rms: rms(&errors),
        p05: p(0.05),
        p25: p(0.25),
        p50: p(0.5),
        p75: p(0.75),
        p90: p(0.9),
        p95: p(0.95),
        max: errors.last().copied(),
        sigma_rms: rms(&sigmas),
        within_1,
        within_2,
        within_3,
    }
}

impl SweepReport {
    /// The rows as CSV; columns are the fields of [`Row`].
    ///
    /// # Errors
    /// Those of the CSV writer.
    pub fn to_csv(&self) -> Result<String, csv::Error> {
        crate::export::to_csv(self.rows.iter().map(|(_, row)| row))
    }

    /// One quantity of one group.
    pub fn find(&self, group: Group, quantity: Quantity) -> Option<&Row> {
        let mut rows = self.rows.iter();
        rows.find(|(of, row)| *of == group && row.quantity == quantity)
            .map(|(_, row)| row)
    }
}
