//! Whole networks calibrating themselves: every node's firmware, in virtual time.

use std::{num::NonZeroUsize, thread, time::Instant};

use answers::record::{
    RunRecord,
    sweep::{Group, Quantity, Row, Sweep, SweepReport},
    verdict::{Common, Finding, Trouble, Verdict},
};
use calib_core::{Refusal, camera::Projection};
use host_sim::network::{Options, Simulation, run_all};
use site::world::Variant;
use site::{Overrides, Scenario};

use crate::figure::{Goal, Sheet};

const PATHS: [u64; 3] = [1, 2, 3];
const QUANTITIES: [(Quantity, &str, &str); 3] = [
    (Quantity::X, "x", "units"),
    (Quantity::Y, "y", "units"),
    (Quantity::HeadingDeg, "heading", "deg"),
];
/// One byte of such a share of the lines is another.
const CORRUPT_LINE: f64 = 0.05;

pub(crate) fn run(sheet: &mut Sheet) -> anyhow::Result<()> {
    let plain = Overrides::default();
    sheet.heading("Networks: thesis-13, 3 paths and 50 seeds, rms over cameras without references");
    let kinds = [
        ("3 stops", plain, Some([0.08, 0.10, 0.9])),
        ("10 stops", with_stops(plain, 10), Some([0.04, 0.04, 0.25])),
        ("3 stops, drift", drifting(plain), None),
        ("10 stops, drift", drifting(with_stops(plain, 10)), None),
    ];
    for (name, changes, goals) in kinds {
        let report = sweep(&changes, 50, |_| ())?;
        accuracy(sheet, name, &report, goals);
        complete(sheet, name, &report, &ALL);
        if changes.drift {
            growth(sheet, name, &report);
        }
    }

    sheet
        .heading("Networks: thesis-13, 3 paths, 200 seeds, errors within 1, 2, 3 predicted sigmas");
    for (name, changes) in [
        ("3 stops", plain),
        ("10 stops", with_stops(plain, 10)),
        ("3 stops, drift", drifting(plain)),
    ] {
        honesty(sheet, name, &sweep(&changes, 200, |_| ())?);
    }

    sheet.heading("Networks: thesis-13 with the cameras of Stage, 3 paths and 50 seeds");
    stage(sheet)?;

    sheet.heading("Networks: thesis-13, 30 % of frames lost, 5 % of camera lines corrupted");
    let lossy = Overrides {
        loss: Some(0.3),
        ..plain
    };
    let report = sweep(&lossy, 50, |scenario| {
        let faults = &mut scenario.camera.faults;
        faults.insert("corrupt_line".to_owned(), CORRUPT_LINE);
    })?;
    accuracy(sheet, "3 stops", &report, None);
    complete(sheet, "3 stops", &report, &ALL);

    sheet.heading("Networks: simulated time over the time of this computer");
    speed(sheet, "thesis-13", &plain, 2_800.0)?;
    let thousand = Overrides {
        nodes: Some(1000),
        ..plain
    };
    speed(sheet, "grid", &thousand, 60.0)
}

fn with_stops(changes: Overrides, stops: usize) -> Overrides {
    Overrides {
        stops: Some(stops),
        ..changes
    }
}

fn drifting(changes: Overrides) -> Overrides {
    Overrides {
        drift: true,
        ..changes
    }
}

/// Every path with seeds from 1, each record looked at.
fn runs(
    changes: &Overrides,
    seeds: u64,
    adapt: impl Fn(&mut Scenario),
    mut take: impl FnMut(&RunRecord) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let mut scenarios = Vec::new();
    for path in PATHS {
        for seed in 1..=seeds {
            let changes = Overrides {
                path: Some(path),
                seed: Some(seed),
                ..*changes
            };
            let mut scenario = Scenario::load("thesis-13", &changes)?;
            adapt(&mut scenario);
            scenarios.push(scenario);
        }
    }
    let jobs = thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
    run_all(&scenarios, jobs, |record| take(&record))
}

fn sweep(
    changes: &Overrides,
    seeds: u64,
    adapt: impl Fn(&mut Scenario),
) -> anyhow::Result<SweepReport> {
    let mut sweep = Sweep::default();
    runs(changes, seeds, adapt, |record| Ok(sweep.add(record)?))?;
    sweep.finish().ok_or_else(|| anyhow::anyhow!("no runs"))
}

fn row(report: &SweepReport, quantity: Quantity) -> Option<&Row> {
    report.find(Group::Cameras, quantity)
}

fn accuracy(sheet: &mut Sheet, name: &str, report: &SweepReport, goals: Option<[f64; 3]>) {
    for (place, (quantity, of, unit)) in QUANTITIES.into_iter().enumerate() {
        let rms = row(report, quantity).and_then(|row| row.rms);
        let goal = goals.map_or(Goal::None, |goals| Goal::AtMost(goals[place]));
        let name = format!("{name}: rms {of}");
        sheet.figure(&name, rms.unwrap_or(f64::NAN), unit, &goal);
    }
}

/// Every run has to be complete.
const ALL: Goal = Goal::AtLeast(1.0);

fn complete(sheet: &mut Sheet, name: &str, report: &SweepReport, goal: &Goal) {
    let share = report.complete as f64 / report.runs as f64;
    let name = format!("{name}: runs with every camera calibrated");
    sheet.figure(&name, share, "", goal);
}

/// How far off targets believe to be, at the first stops where they know a place and the last.
fn growth(sheet: &mut Sheet, name: &str, report: &SweepReport) {
    let stops: Vec<_> = report
        .rows
        .iter()
        .filter(|(group, row)| {
            matches!(group, Group::Stop { .. })
                && row.quantity == Quantity::Position
                && row.rms.is_some()
        })
        .collect();
    let places = [0, stops.len() / 2, stops.len().saturating_sub(1)];
    for (_, row) in places.into_iter().filter_map(|place| stops.get(place)) {
        let name = format!("{name}: {}, rms of its place", row.group);
        sheet.figure(&name, row.rms.unwrap_or(f64::NAN), "units", &Goal::None);
    }
}

fn honesty(sheet: &mut Sheet, name: &str, report: &SweepReport) {
    for (quantity, of, _) in QUANTITIES {
        let Some(row) = row(report, quantity) else {
            continue;
        };
        for (sigmas, share) in (1..).zip([row.within_1, row.within_2, row.within_3]) {
            let name = format!("{name}: {of} within {sigmas}");
            sheet.figure(&name, share.unwrap_or(f64::NAN), "", &Goal::None);
        }
    }
}

fn stage(sheet: &mut Sheet) -> anyhow::Result<()> {
    for (name, model, is_wrong) in [
        ("decoded as equal angles", Projection::EqualAngle, false),
        ("decoded as pin-hole", Projection::PinHole, true),
    ] {
        for stops in [3, 10] {
            let changes = Overrides {
                variant: Some(Variant::Stage),
                model: Some(model),
                ..with_stops(Overrides::default(), stops)
            };
            let name = format!("{name}, {stops} stops");
            let mut sweep = Sweep::default();
            let (mut all, mut told) = (0, 0);
            runs(
                &changes,
                50,
                |_| (),
                |record| {
                    let verdict = Verdict::of(record);
                    all += 1;
                    let misfit = |common: &Common| matches!(common, Common::Lens(_));
                    let refused = |finding: &Finding| {
                        matches!(finding.trouble, Trouble::Refused(Refusal::Inconsistent))
                    };
                    told += usize::from(
                        verdict.common.iter().any(misfit) || verdict.findings.iter().any(refused),
                    );
                    Ok(sweep.add(record)?)
                },
            )?;
            if let Some(report) = sweep.finish() {
                accuracy(sheet, &name, &report, None);
                // References that refuse a wrong model do what they should.
                let goal = if is_wrong { Goal::None } else { ALL };
                complete(sheet, &name, &report, &goal);
            }
            // The references' own stops contradict each other, or the residuals are too large.
            let goal = match is_wrong {
                true => Goal::AtLeast(1.0),
                false => Goal::AtMost(0.05),
            };
            let share = told as f64 / f64::from(all);
            let name = format!("{name}: runs told that the model misfits");
            sheet.figure(&name, share, "", &goal);
        }
    }
    Ok(())
}

fn speed(sheet: &mut Sheet, name: &str, changes: &Overrides, least: f64) -> anyhow::Result<()> {
    let mut simulation = Simulation::new(Scenario::load(name, changes)?, Options::default())?;
    let begun = Instant::now();
    let record = simulation.run(|_| ());
    let times = record.sim_seconds / begun.elapsed().as_secs_f64();
    let title = match changes.nodes {
        Some(nodes) => format!("{name}, {nodes} nodes"),
        None => name.to_owned(),
    };
    sheet.figure(&title, times, "times", &Goal::AtLeast(least));
    let share = record.summary.calibrated as f64 / record.summary.expected as f64;
    let title = format!("{title}: cameras calibrated");
    sheet.figure(&title, share, "", &Goal::AtLeast(1.0));
    Ok(())
}
