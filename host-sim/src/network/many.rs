//! Many runs on many threads.

use std::{
    collections::BTreeMap,
    num::NonZeroUsize,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicUsize, Ordering},
        mpsc,
    },
    thread,
};

use super::{Options, Simulation};
use results::record::RunRecord;
use site::{Scenario, ScenarioError};

/// Runs every scenario, `jobs` at a time, and hands the records to `take` in their order.
///
/// A simulation lives on one thread. It does not matter which one, and how many threads there are.
///
/// # Errors
/// The first scenario that is not possible, and the first error of `take`. Nothing more is run then.
pub fn run_all<E: From<ScenarioError>>(
    scenarios: &[Scenario],
    jobs: NonZeroUsize,
    take: impl FnMut(RunRecord) -> Result<(), E>,
) -> Result<(), E> {
    run_all_until(scenarios, jobs, &Arc::default(), take)
}

/// As [`run_all`], until `stop` is set: runs that are under way then are left out.
///
/// # Errors
/// Those of [`run_all`].
pub fn run_all_until<E: From<ScenarioError>>(
    scenarios: &[Scenario],
    jobs: NonZeroUsize,
    stop: &Arc<AtomicBool>,
    mut take: impl FnMut(RunRecord) -> Result<(), E>,
) -> Result<(), E> {
    let next = AtomicUsize::new(0);
    let is_over = AtomicBool::new(false);
    let (done, records) = mpsc::channel();
    thread::scope(|scope| {
        for _ in 0..jobs.get().min(scenarios.len()) {
            let (done, next, is_over) = (done.clone(), &next, &is_over);
            scope.spawn(move || {
                while !is_over.load(Ordering::Relaxed) {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    let Some(scenario) = scenarios.get(number) else {
                        break;
                    };
                    let options = Options {
                        stop: stop.clone(),
                        ..Options::default()
                    };
                    let simulation = Simulation::new(scenario.clone(), options);
                    let record = simulation.map(|mut simulation| simulation.run(|_| ()));
                    if stop.load(Ordering::Relaxed) {
                        break;
                    }
                    if done.send((number, record)).is_err() {
                        break;
                    }
                }
            });
        }
        drop(done);
        let result = in_order(&records, &mut take);
        is_over.store(true, Ordering::Relaxed);
        result
    })
}

type Outcome = (usize, Result<RunRecord, ScenarioError>);

fn in_order<E: From<ScenarioError>>(
    records: &mpsc::Receiver<Outcome>,
    take: &mut impl FnMut(RunRecord) -> Result<(), E>,
) -> Result<(), E> {
    let mut early = BTreeMap::new();
    let mut expected = 0;
    for (number, record) in records {
        early.insert(number, record);
        while let Some(record) = early.remove(&expected) {
            take(record?)?;
            expected += 1;
        }
    }
    // Records behind a run that was stopped.
    early.into_values().try_for_each(|record| take(record?))
}
