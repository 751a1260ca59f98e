//! Joint estimation in single precision, as on a node, against the batch optimum and against one
//! pass of open loop.
//!
//! Geometry as in the networks' rows: cameras stand 0.3 units and 3 degrees (normally distributed)
//! from where the scenario has them, stops are planned anew for each seed, and every camera looks at
//! every stop that it has in whole view. Bearings are off by 2.4 mrad, a third of a column of the
//! thesis's cameras, or rounded to whole columns. The firmware is not in it.

use std::{num::NonZeroUsize, sync::Mutex, thread};

use calib_core::{
    Limits,
    joint::{BearingStorage, Capacity, JointEstimator, StopStorage, UnknownStorage},
};
use site::{Overrides, ScatterTable, Scenario};
use test_support::walk::{CarrierErrors, Walk};

use crate::figure::{Estimate, Goal, Sheet};

mod geometry;
mod honesty;
mod solvers;

use geometry::{Bearings, Setting};
use solvers::{Errors, Run};

/// Case that is estimated in a row.
struct Case {
    name: &'static str,
    scenario: &'static str,
    stops: Option<usize>,
    carrier: CarrierErrors,
    bearings: Bearings,
    seeds: u64,
    /// Goals of rms x, y and heading.
    rms: [Goal; 3],
    unit: &'static str,
    limits: Limits<f64>,
}

/// Standard deviation of a bearing, radians.
const SIGMA: f64 = 0.0024;
/// Shares of the batch optimum's rms that the joint solution may have.
const OF_OPTIMUM: f64 = 1.1;
const QUANTITIES: [&str; 3] = ["x", "y", "heading"];
const NO_GOALS: [Goal; 3] = [Goal::None, Goal::None, Goal::None];

impl Default for Case {
    fn default() -> Self {
        Self {
            name: "",
            scenario: "thesis-13",
            stops: Some(3),
            carrier: CarrierErrors::UNKNOWN,
            bearings: Bearings::Gaussian(SIGMA),
            seeds: 60,
            rms: NO_GOALS,
            unit: "units",
            limits: Limits {
                position: 0.5,
                heading: 5_f64.to_radians(),
            },
        }
    }
}

fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "unknown carrier, 3 stops",
            seeds: 200,
            rms: [0.27, 0.29, 0.96].map(Goal::AtMost),
            ..Case::default()
        },
        Case {
            name: "unknown carrier, 10 stops",
            stops: Some(10),
            seeds: 200,
            rms: [
                Goal::AtMost(0.147),
                Goal::AtMost(0.138),
                Goal::Open(0.40, "the batch optimum of these geometries is no better"),
            ],
            ..Case::default()
        },
        Case {
            name: "unknown carrier, whole columns, 3 stops",
            bearings: Bearings::WholeColumns,
            ..Case::default()
        },
        Case {
            name: "drift, 3 stops",
            carrier: CarrierErrors::DRIFT,
            ..Case::default()
        },
        Case {
            name: "drift, 10 stops",
            stops: Some(10),
            carrier: CarrierErrors::DRIFT,
            ..Case::default()
        },
        Case {
            name: "drift, whole columns, 10 stops",
            stops: Some(10),
            carrier: CarrierErrors::DRIFT,
            bearings: Bearings::WholeColumns,
            ..Case::default()
        },
        Case {
            name: "perfect steps, 3 stops",
            carrier: CarrierErrors::PERFECT,
            ..Case::default()
        },
        Case {
            name: "perfect steps, 10 stops",
            stops: Some(10),
            carrier: CarrierErrors::PERFECT,
            ..Case::default()
        },
        Case {
            name: "unknown carrier, 3 stops",
            scenario: "lab",
            unit: "inches",
            limits: Limits {
                position: 1.4,
                ..Case::default().limits
            },
            ..Case::default()
        },
        Case {
            name: "unknown carrier, 6 stops",
            scenario: "office",
            stops: None,
            seeds: 60,
            rms: [0.15, 0.15, 0.5].map(Goal::AtMost),
            unit: "metres",
            limits: Limits {
                position: 1.0,
                ..Case::default().limits
            },
            ..Case::default()
        },
    ]
}

/// All rows, or in brief those with goals, of a few seeds.
pub(crate) fn run(sheet: &mut Sheet) -> anyhow::Result<()> {
    for case in cases() {
        row(sheet, &case)?;
    }
    honesty::run(sheet)?;
    memory(sheet);
    Ok(())
}

fn row(sheet: &mut Sheet, case: &Case) -> anyhow::Result<()> {
    sheet.heading(&format!(
        "Joint, {}: {}, {} seeds",
        case.scenario, case.name, case.seeds
    ));
    let runs = runs(case, |walk| solvers::solve(walk, &case.limits))?;
    let started: Vec<&Run> = runs.iter().filter(|run| run.joint.is_some()).collect();
    let share = started.len() as f64 / runs.len() as f64;
    sheet.figure("runs with a frame", share, "", &Goal::None);
    let of = |errors: fn(&Run) -> Option<&Errors>| -> Vec<&Errors> {
        started.iter().filter_map(|run| errors(run)).collect()
    };
    let joint = of(|run| run.joint.as_ref());
    let batch = of(|run| run.batch.as_ref());
    let open = of(|run| run.open.as_ref());
    let able: usize = runs.iter().map(|run| run.able).sum();
    let solved: usize = joint.iter().map(|errors| errors.poses.len()).sum();
    let share = solved as f64 / able as f64;
    let name = "cameras with three bearings that have a pose";
    sheet.figure(name, share, "", &Goal::None);
    for (n, quantity) in QUANTITIES.into_iter().enumerate() {
        let unit = if n == 2 { "deg" } else { case.unit };
        let rms = [&joint, &batch, &open].map(|errors| rms(errors, n));
        sheet.estimate(
            &format!("rms {quantity}"),
            rms[0],
            unit,
            &case.rms[n],
            false,
        );
        let name = format!("rms {quantity}, batch optimum");
        sheet.estimate(&name, rms[1], unit, &Goal::None, false);
        let name = format!("rms {quantity}, one pass of open loop");
        sheet.estimate(&name, rms[2], unit, &Goal::None, false);
        let name = format!("rms {quantity} over the batch optimum's");
        let ratio = rms[0].value / rms[1].value;
        sheet.figure(&name, ratio, "", &Goal::AtMost(OF_OPTIMUM));
    }
    for (who, errors) in [("joint", &joint), ("batch optimum", &batch)] {
        let nees = nees(errors);
        let name = format!("NEES of cameras, {who} (3 is right)");
        sheet.estimate(&name, nees, "", &Goal::None, false);
    }
    for (n, of) in [
        "reference headings (2 is right)",
        "carrier (2 is right)",
        "last stop (2 is right)",
    ]
    .into_iter()
    .enumerate()
    {
        let mean = started.iter().map(|run| run.nees[n]).sum::<f64>() / started.len() as f64;
        sheet.figure(&format!("NEES of {of}"), mean, "", &Goal::None);
    }
    let passes = started.iter().map(|run| run.passes).sum::<usize>() / started.len().max(1);
    sheet.figure(
        "passes of a solve from nothing",
        passes as f64,
        "",
        &Goal::None,
    );
    Ok(())
}

/// One a seed, on all processors.
fn runs<R: Send + Sync + 'static>(
    case: &Case,
    solve: impl Fn(&Walk) -> R + Sync,
) -> anyhow::Result<Vec<R>> {
    let next = Mutex::new(1..=case.seeds);
    let runs = Mutex::new(Vec::new());
    let jobs = thread::available_parallelism().map_or(1, NonZeroUsize::get);
    thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs)
            .map(|_| {
                scope.spawn(|| {
                    loop {
                        let seed = next.lock().ok().and_then(|mut seeds| seeds.next());
                        let Some(seed) = seed else {
                            return anyhow::Ok(());
                        };
                        let setting = Setting::new(&scenario(case, seed)?)?;
                        let walk = setting.measured(seed, case.carrier, case.bearings);
                        let run = solve(&walk);
                        if let Ok(mut runs) = runs.lock() {
                            runs.push((seed, run));
                        }
                    }
                })
            })
            .collect();
        for worker in workers {
            worker
                .join()
                .map_err(|_| anyhow::anyhow!("a worker panicked"))??;
        }
        anyhow::Ok(())
    })?;
    let mut runs = runs.into_inner()?;
    runs.sort_by_key(|(seed, _)| *seed);
    Ok(runs.into_iter().map(|(_, run)| run).collect())
}

fn scenario(case: &Case, seed: u64) -> anyhow::Result<Scenario> {
    let changes = Overrides {
        path: Some(1 + seed % 3),
        seed: Some(seed),
        stops: case.stops,
        scatter: Some(ScatterTable::USUAL),
        ..Overrides::default()
    };
    Ok(Scenario::load(case.scenario, &changes)?)
}

/// A mean over poses; runs are independent, poses are not.
fn mean(runs: &[&Errors], of: impl Fn(&Errors) -> f64) -> Estimate {
    let poses: f64 = runs.iter().map(|run| run.poses.len() as f64).sum();
    let mean = runs.iter().map(|run| of(run)).sum::<f64>() / poses;
    let off = |run: &&Errors| (of(run) - mean * run.poses.len() as f64).powi(2);
    let squares: f64 = runs.iter().map(off).sum();
    Estimate {
        value: mean,
        standard_error: squares.sqrt() / poses,
    }
}

fn rms(runs: &[&Errors], quantity: usize) -> Estimate {
    let square = mean(runs, |run| {
        run.poses.iter().map(|pose| pose.0[quantity].powi(2)).sum()
    });
    let value = square.value.sqrt();
    Estimate {
        value,
        standard_error: square.standard_error / (2.0 * value),
    }
}

fn nees(runs: &[&Errors]) -> Estimate {
    mean(runs, |run| run.poses.iter().map(|pose| pose.1).sum())
}

/// Static RAM of the estimator in single precision.
fn memory(sheet: &mut Sheet) {
    sheet.heading("Joint: static RAM on a node");
    for (cameras, stops, bearings) in [(13, 84, 200), (24, 84, 384)] {
        let name = format!("{cameras} cameras, {stops} stops, {bearings} bearings");
        let room = Capacity {
            cameras,
            stops,
            bearings,
            marks: 0,
        };
        let workspace = room.workspace() * size_of::<f32>();
        let bytes = size_of::<JointEstimator<'_, f32>>()
            + cameras * size_of::<UnknownStorage<f32>>()
            + stops * size_of::<StopStorage<f32>>()
            + bearings * size_of::<BearingStorage<f32>>()
            + workspace;
        // Of 120 KiB that a node may have in all.
        let most = Goal::AtMost(if cameras == 13 { 75e3 } else { 85e3 });
        sheet.figure(&name, bytes as f64, "bytes", &most);
        sheet.figure(
            &format!("{name}: workspace"),
            workspace as f64,
            "bytes",
            &Goal::None,
        );
    }
}
