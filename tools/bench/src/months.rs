//! Ninety days of an office of 20 cameras, with a walk every day: cameras that are turned, shifted, or sag.
//!
//! Nothing tells the network of it. Each walk that happens anyway has to show it, and to find the new pose.

use std::{collections::BTreeMap, num::NonZeroUsize, thread};

use calib_core::{Status, angle::wrap_signed};
use host_sim::network::{Options, Simulation};
use node_firmware::message::Report;
use rand::RngExt;
use results::record::{RunRecord, verdict::deceives};
use site::{Action, Overrides, Scenario, ScriptedEvent};
use test_support::generator;

use crate::figure::{Goal, Sheet};

/// Runs, and moves in each.
const SEEDS: u64 = 10;
const MOVES: usize = 20;

const DAYS: u32 = 90;
const DAY_S: f64 = 86_400.0;
const LOOKS: u64 = 6_000_000_000;
/// Walks after a move within which it is to be noticed.
const WALKS: f64 = 3.0;
/// Days for which a camera that sags does so, and those between two moves of one camera at least.
const SAGS: u32 = 8;
const APART: u32 = 14;

/// Moves of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Turned,
    Shifted,
    Sagged,
}

#[derive(Clone, Debug)]
struct Move {
    camera: u16,
    kind: Kind,
    /// Times of its first and its last step, seconds.
    during: [f64; 2],
    by: [f64; 2],
    turn_deg: f64,
    /// The report before.
    held: Option<Report>,
    noticed: Option<f64>,
    found: Option<f64>,
}

struct Run {
    moves: Vec<Move>,
    false_alarms: usize,
    deceived: usize,
    calibrated: usize,
}

pub(crate) fn run(sheet: &mut Sheet) -> anyhow::Result<()> {
    sheet.heading("Ninety days of an office of 20 cameras, a walk every day, 20 moves");
    let runs = runs()?;
    let moves: Vec<_> = runs.iter().flat_map(|run| &run.moves).collect();
    for kind in [Kind::Turned, Kind::Shifted, Kind::Sagged] {
        let of = moves.iter().filter(|moved| moved.kind == kind).count();
        sheet.figure(&format!("{kind:?}"), of as f64, "", &Goal::None);
    }
    let within = |at: fn(&Move) -> Option<f64>, walks: f64| {
        let late = moves
            .iter()
            .filter(|moved| is_late(at(moved), moved, walks));
        late.count() as f64
    };
    let noticed = within(|moved| moved.noticed, WALKS);
    sheet.figure(
        "not noticed within three walks",
        noticed,
        "",
        &Goal::AtMost(0.0),
    );
    let at_once = within(|moved| moved.noticed, 1.0);
    sheet.figure("not noticed by the next walk", at_once, "", &Goal::None);
    let found = within(|moved| moved.found, WALKS);
    sheet.figure(
        "not calibrated anew within three walks",
        found,
        "",
        &Goal::None,
    );
    let sum = |of: fn(&Run) -> usize| runs.iter().map(of).sum::<usize>() as f64;
    let months = SEEDS as f64 * f64::from(DAYS) / 30.0;
    let alarms = sum(|run| run.false_alarms) / months;
    sheet.figure(
        "false alarms of 20 cameras in a month",
        alarms,
        "",
        &Goal::AtMost(1.0),
    );
    sheet.figure(
        "deceived at the end, of 200",
        sum(|run| run.deceived),
        "",
        &Goal::AtMost(0.0),
    );
    sheet.figure(
        "calibrated at the end, of 200",
        sum(|run| run.calibrated),
        "",
        &Goal::None,
    );
    for moved in moves {
        if is_late(moved.noticed, moved, WALKS) {
            let Move {
                camera,
                kind,
                during: [begin, _],
                turn_deg,
                noticed,
                ..
            } = moved;
            let [day, noticed] = [Some(*begin), *noticed].map(|at| at.map(|at| at / DAY_S));
            sheet.note(&format!(
                "{kind:?}: camera {camera} by {:?} and {turn_deg:.1} deg, day {day:.1?}, noticed {noticed:.1?}",
                moved.by
            ));
        }
    }
    Ok(())
}

/// Returns true where something happened later than so many walks after the last step of a move, or not at all.
fn is_late(at: Option<f64>, moved: &Move, walks: f64) -> bool {
    at.is_none_or(|at| at > moved.during[1] + walks * DAY_S)
}

fn runs() -> anyhow::Result<Vec<Run>> {
    let jobs = thread::available_parallelism().map_or(1, NonZeroUsize::get) as u64;
    thread::scope(|scope| {
        let work = (0..jobs).map(|job| {
            scope.spawn(move || {
                let own = (1..=SEEDS).filter(|seed| seed % jobs == job);
                own.map(one).collect::<anyhow::Result<Vec<_>>>()
            })
        });
        let work: Vec<_> = work.collect();
        let mut runs = Vec::new();
        for job in work {
            runs.extend(job.join().expect("no panic")?);
        }
        Ok(runs)
    })
}

/// Moves of cameras that are no references: the place of a reference is told, and only a person can tell another.
fn drawn(seed: u64, scenario: &Scenario) -> Vec<Move> {
    let mut rng = generator(seed);
    let mut moves: Vec<Move> = Vec::new();
    while moves.len() < MOVES {
        let (camera, day) = (rng.random_range(3..=20), rng.random_range(3..DAYS - 10));
        let begin = (f64::from(day) + rng.random_range(0.2..0.9)) * DAY_S;
        let is_near = |other: &Move| {
            other.camera == camera && (other.during[0] - begin).abs() < f64::from(APART) * DAY_S
        };
        if moves.iter().any(is_near) {
            continue;
        }
        let sign = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let kind = [Kind::Turned, Kind::Shifted, Kind::Sagged][moves.len() % 3];
        let (turn_deg, length, days) = match kind {
            Kind::Turned => (rng.random_range(3.0..15.0), 0.0, 0),
            Kind::Shifted => (rng.random_range(0.0..5.0), rng.random_range(0.2..0.5), 0),
            Kind::Sagged => (rng.random_range(4.0..8.0), 0.0, SAGS - 1),
        };
        // Into the room: behind a wall it would see nothing.
        let angle = heading(scenario, camera) + rng.random_range(-1.0..1.0);
        moves.push(Move {
            camera,
            kind,
            during: [begin, begin + f64::from(days) * DAY_S],
            by: [length * angle.cos(), length * angle.sin()],
            turn_deg: sign * turn_deg,
            held: None,
            noticed: None,
            found: None,
        });
    }
    moves
}

/// Direction of a camera as the file has it, radians.
fn heading(scenario: &Scenario, camera: u16) -> f64 {
    let mut cameras = { scenario.networks.iter() }.flat_map(|network| &network.cameras);
    let placed = cameras.find(|placed| placed.id == camera);
    placed
        .and_then(|placed| placed.heading_deg)
        .unwrap_or_default()
        .to_radians()
}

fn events(moves: &[Move]) -> impl Iterator<Item = ScriptedEvent> {
    moves.iter().flat_map(|moved| {
        let steps = if moved.kind == Kind::Sagged { SAGS } else { 1 };
        (0..steps).map(move |step| ScriptedEvent {
            at_s: moved.during[0] + f64::from(step) * DAY_S,
            action: Action::BumpCamera {
                node: moved.camera,
                by: moved.by,
                turn_deg: moved.turn_deg / f64::from(steps),
            },
        })
    })
}

fn one(seed: u64) -> anyhow::Result<Run> {
    let changes = Overrides {
        seed: Some(seed),
        ..Overrides::default()
    };
    let mut scenario = Scenario::load("office", &changes)?;
    scenario.walk.walks = DAYS;
    // A person does not stand in the same place twice.
    scenario.walk.arrive_within = 0.2;
    let mut moves = drawn(seed, &scenario);
    scenario.events.extend(events(&moves));
    let mut simulation = Simulation::new(scenario, Options::default())?;
    let mut held: BTreeMap<u16, Report> = BTreeMap::new();
    let mut false_alarms = 0;
    let record = simulation.run_watched(
        LOOKS,
        |_| (),
        |simulation| {
            let now = simulation.seconds();
            for (camera, report) in simulation.new_reports() {
                let before = held.insert(camera, report);
                let was_good = before.is_some_and(|before| before.status() == Status::Calibrated);
                let is_doubtful = report.status() == Status::Doubtful;
                let has_begun = |moved: &&mut Move| moved.camera == camera && moved.during[0] < now;
                // The last of them.
                let last = moves.iter_mut().filter(has_begun);
                let last = last.max_by(|a, b| a.during[0].total_cmp(&b.during[0]));
                let open =
                    last.filter(|moved| moved.found.is_none() || now < moved.during[1] + DAY_S);
                let Some(moved) = open else {
                    false_alarms += usize::from(is_doubtful && was_good && now > DAY_S);
                    continue;
                };
                let held = moved.held.or(before);
                moved.held = held;
                if is_doubtful || held.is_some_and(|held| moved.is_followed(&held, &report)) {
                    moved.noticed.get_or_insert(now);
                }
                if moved.noticed.is_some() && report.status() == Status::Calibrated {
                    moved.found.get_or_insert(now);
                }
            }
        },
    );
    let (deceived, calibrated) = judged(&record);
    println!(
        "  (seed {seed}: {:.0} s, {false_alarms} false alarms, {deceived} deceived)",
        record.wall_seconds.unwrap_or(0.0)
    );
    Ok(Run {
        moves,
        false_alarms,
        deceived,
        calibrated,
    })
}

impl Move {
    /// Returns true where a pose has gone half of the way or more.
    fn is_followed(&self, before: &Report, now: &Report) -> bool {
        let (Some(before), Some(now)) = (before.pose(), now.pose()) else {
            return false;
        };
        let gone = [0, 1].map(|n| f64::from(now.position[n] - before.position[n]));
        let [dx, dy] = self.by;
        let length = dx.hypot(dy);
        let along = (gone[0] * dx + gone[1] * dy) / length;
        let turned = f64::from(wrap_signed(now.heading - before.heading)).to_degrees();
        match self.kind {
            Kind::Shifted => along > 0.5 * length,
            Kind::Turned | Kind::Sagged => turned / self.turn_deg > 0.5,
        }
    }
}

/// Calibrated cameras, and those of them that are not where they say.
fn judged(record: &RunRecord) -> (usize, usize) {
    let good: Vec<_> = record
        .cameras()
        .filter(|camera| camera.is_calibrated())
        .collect();
    let deceived: Vec<_> = { good.iter() }
        .filter_map(|camera| Some((camera, deceives(camera)?)))
        .collect();
    for (camera, sigmas) in &deceived {
        println!(
            "  (camera {}: {sigmas:.1} sigmas, {:?})",
            camera.id, camera.error
        );
    }
    (deceived.len(), good.len())
}
