//! Many runs, and the results of their cameras.

use std::{collections::BTreeMap, num::NonZeroUsize, thread};

use calib_core::Status;
use host_sim::network::run_all;
use results::record::{RunRecord, verdict::deceives};
use site::Scenario;

use crate::figure::Estimate;

/// Results of the cameras of many runs. Errors are those of the cameras that are no references, even of refused
/// poses; a run's cameras share the error of its references, so only runs are independent.
#[derive(Default)]
pub(super) struct Tally {
    runs: Vec<Run>,
    /// Cameras of each status, references included.
    statuses: BTreeMap<&'static str, usize>,
    expected: usize,
    /// Runs all of whose cameras are calibrated.
    complete: usize,
    /// Errors within 1, 2, 3 predicted sigmas, of x, y and heading.
    within: [[usize; 3]; 3],
    /// Cameras that are called calibrated, and five sigmas off.
    deceived: usize,
    /// Runs with a camera that is refused as inconsistent or is doubtful.
    doubting: usize,
}

/// Sums over the cameras of a run.
#[derive(Default)]
struct Run {
    poses: f64,
    squares: [f64; 3],
    nees: f64,
}

impl Tally {
    /// Every scenario, on all processors; `look` sees each record too.
    pub(super) fn of(
        scenarios: &[Scenario],
        mut look: impl FnMut(&RunRecord),
    ) -> anyhow::Result<Self> {
        let jobs = thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
        let mut tally = Self::default();
        run_all(scenarios, jobs, |record| {
            tally.add(&record);
            look(&record);
            anyhow::Ok(())
        })?;
        Ok(tally)
    }

    pub(super) fn add(&mut self, record: &RunRecord) {
        let mut run = Run::default();
        let (mut complete, mut doubting) = (true, false);
        for camera in record.cameras().filter(|camera| camera.expected) {
            let status = camera.status.unwrap_or(Status::Waiting);
            *self.statuses.entry(status.name()).or_default() += 1;
            self.expected += 1;
            complete &= status == Status::Calibrated;
            doubting |= matches!(status, Status::Doubtful | Status::Refused);
            let (Some(estimate), Some(error)) = (&camera.estimate, camera.error) else {
                continue;
            };
            let nees = camera.nees.unwrap_or(0.0);
            self.deceived +=
                usize::from(status == Status::Calibrated && deceives(camera).is_some());
            if camera.reference {
                continue;
            }
            run.poses += 1.0;
            run.nees += nees;
            for (n, (error, sigma)) in [
                (error.x, estimate.sigma_x),
                (error.y, estimate.sigma_y),
                (error.heading_deg, estimate.sigma_heading_deg),
            ]
            .into_iter()
            .enumerate()
            {
                run.squares[n] += error * error;
                for (count, sigmas) in self.within[n].iter_mut().zip([1.0, 2.0, 3.0]) {
                    *count += usize::from(error.abs() <= sigmas * sigma);
                }
            }
        }
        self.complete += usize::from(complete);
        self.doubting += usize::from(doubting);
        self.runs.push(run);
    }

    /// The mean over all poses, with its standard error from the differences of runs.
    fn mean(&self, of: impl Fn(&Run) -> f64) -> Estimate {
        let poses: f64 = self.runs.iter().map(|run| run.poses).sum();
        let mean = self.runs.iter().map(&of).sum::<f64>() / poses;
        let off = |run: &Run| (of(run) - mean * run.poses).powi(2);
        let runs = self.runs.len() as f64;
        let squares = self.runs.iter().map(off).sum::<f64>() * runs / (runs - 1.0);
        Estimate {
            value: mean,
            standard_error: squares.sqrt() / poses,
        }
    }

    /// Root of the mean square of the errors of x, y or heading.
    pub(super) fn rms(&self, quantity: usize) -> Estimate {
        let square = self.mean(|run| run.squares[quantity]);
        let value = square.value.sqrt();
        Estimate {
            value,
            standard_error: square.standard_error / (2.0 * value),
        }
    }

    /// Squared error over predicted covariance: 3 where predictions are right.
    pub(super) fn nees(&self) -> Estimate {
        self.mean(|run| run.nees)
    }

    /// Shares of the errors of x, y or heading within 1, 2, 3 predicted sigmas.
    pub(super) fn within(&self, quantity: usize) -> [f64; 3] {
        let poses: f64 = self.runs.iter().map(|run| run.poses).sum();
        self.within[quantity].map(|count| count as f64 / poses)
    }

    /// The share of the cameras that has this status.
    pub(super) fn share(&self, status: Status) -> f64 {
        let count = self.statuses.get(status.name()).copied();
        count.unwrap_or(0) as f64 / self.expected as f64
    }

    /// The share of the cameras that are called calibrated and are five sigmas off.
    pub(super) fn deceived(&self) -> f64 {
        self.deceived as f64 / self.expected as f64
    }

    /// The share of the runs all of whose cameras are calibrated.
    pub(super) fn complete(&self) -> f64 {
        self.complete as f64 / self.runs.len() as f64
    }

    /// The share of the runs with a camera whose sightings contradict each other.
    pub(super) fn doubting(&self) -> f64 {
        self.doubting as f64 / self.runs.len() as f64
    }
}
