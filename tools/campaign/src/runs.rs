//! Runs scenarios, to any outcome.

use std::{
    any::Any,
    collections::BTreeMap,
    num::NonZeroUsize,
    panic::{self, AssertUnwindSafe},
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
        mpsc,
    },
    thread,
    time::{Duration, Instant},
};

use host_sim::network::{Options, Simulation};
use node_firmware::{config::TargetConfig, message::ProtectionLevel};
use results::record::RunRecord;
use site::{Scenario, ScenarioError};

/// Limit of a run's time on a computer, even a busy one.
const WALL_LIMIT: Duration = Duration::from_secs(300);

/// Setting up and saying the last things, seconds.
const SLACK_S: f64 = 240.0;

/// Outcome of a run.
#[derive(Debug)]
pub enum Outcome {
    /// It came to its end.
    Ended {
        /// Its record.
        record: Box<RunRecord>,
        /// Limits for the errors of the positions of cameras that are told as checked, in the unit of the site.
        protection: BTreeMap<u16, f64>,
    },
    /// Something panicked, with this message.
    Panicked(String),
    /// It was not over by this simulated time, seconds, though all waiting was.
    Hung(f64),
}

/// Time by which a run is over, seconds, were every stop as long as a target waits at most, and all events that
/// last one after the other.
///
/// # Errors
/// The scenario is not possible.
pub fn limit_s(scenario: &Scenario) -> Result<f64, ScenarioError> {
    let usual = f64::from(TargetConfig::default().dwell_most_ms) * 1e-3;
    let firmware = scenario.firmware.dwell_most_ms;
    let dwell_s = firmware.map_or(usual, |ms| f64::from(ms) * 1e-3);
    let site = scenario.put_up()?;
    let targets = site.networks.iter().flat_map(|network| &network.targets);
    let walks = targets.map(|target| {
        let legs = target.stops.windows(2);
        let way: f64 = legs.map(|leg| (leg[1] - leg[0]).norm()).sum();
        way / scenario.walk.speed + target.stops.len() as f64 * (dwell_s + 10.0)
    });
    // An event that lasts for ever does not delay the nodes for ever.
    let outages = scenario
        .events
        .iter()
        .filter_map(|event| event.action.duration_s());
    let outages: f64 = outages.filter(|seconds| *seconds < 1e4).sum();
    Ok(walks.fold(0.0, f64::max) + outages + SLACK_S)
}

/// Runs a scenario to its end, or as far as it comes.
///
/// # Errors
/// The scenario is not possible.
pub fn run(scenario: &Scenario) -> Result<Outcome, ScenarioError> {
    let (limit_s, begun) = (limit_s(scenario)?, Instant::now());
    let stop = Arc::new(AtomicBool::new(false));
    let options = Options {
        stop: stop.clone(),
        ..Options::default()
    };
    let caught = panic::catch_unwind(AssertUnwindSafe(|| {
        let mut simulation = Simulation::new(scenario.clone(), options)?;
        let record = simulation.run(|progress| {
            if progress.seconds > limit_s || begun.elapsed() > WALL_LIMIT {
                stop.store(true, Ordering::Relaxed);
            }
        });
        Ok((record, protection(&simulation)))
    }));
    Ok(match caught {
        Err(panic) => Outcome::Panicked(message(&*panic)),
        Ok(Err(error)) => return Err(error),
        Ok(Ok((record, _))) if stop.load(Ordering::Relaxed) => Outcome::Hung(record.sim_seconds),
        Ok(Ok((record, protection))) => Outcome::Ended {
            record: Box::new(record),
            protection,
        },
    })
}

/// A pose is checked where a level is known.
fn protection(simulation: &Simulation) -> BTreeMap<u16, f64> {
    let reports = simulation.reports().into_iter();
    let levels = reports.filter_map(|(id, report)| Some((id, report.joint?.position)));
    levels
        .filter(|(_, level)| *level < ProtectionLevel::NONE.position)
        .map(|(id, level)| (id, level.into()))
        .collect()
}

fn message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
    text.unwrap_or_else(|| "a panic without a message".into())
}

/// Does something for each number, `jobs` at a time, and hands the results to `take` as they come.
pub fn side_by_side<T: Send>(
    numbers: impl IntoIterator<Item = u64>,
    jobs: NonZeroUsize,
    of: impl Fn(u64) -> T + Sync,
    mut take: impl FnMut(T),
) {
    let numbers: Vec<u64> = numbers.into_iter().collect();
    let next = AtomicU64::new(0);
    let (done, results) = mpsc::channel();
    thread::scope(|scope| {
        for _ in 0..jobs.get() {
            let (done, next, numbers, of) = (done.clone(), &next, &numbers, &of);
            scope.spawn(move || {
                while let Some(&number) = numbers.get(next.fetch_add(1, Ordering::Relaxed) as usize)
                {
                    if done.send(of(number)).is_err() {
                        break;
                    }
                }
            });
        }
        drop(done);
        for result in results {
            take(result);
        }
    });
}
