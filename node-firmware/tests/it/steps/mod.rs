//! The inertial step sensor on modelled chips, worn by a simulated person.

mod bench;
mod chips;

use std::{f64::consts::FRAC_PI_2, rc::Rc};

use bench::{Bench, Faults, Happened};
use calib_core::dead_reckoning::Step;
use nalgebra::Vector2;
use node_firmware::{
    config::SensorConfig,
    steps::{Chip, SensorError, SensorFault},
};
use test_support::{
    turn,
    walker::{Act, Walker},
};

const IRON: [f32; 3] = [35.0, -60.0, 20.0];

/// Before the step length is known.
const USUAL: SensorConfig = {
    let mut sensor = SensorConfig::UNCALIBRATED;
    sensor.hard_iron = IRON;
    sensor
};

/// With the step length of another walk of this kind of person, at another pace, as people find it: the usual
/// one times the known distance over the reckoned one.
fn calibrated() -> SensorConfig {
    let mut walker = Walker::new(4711);
    walker.cadence = 1.8;
    walker.act(&[Act::Stand(3.0), Act::Walk(60, 0.0), Act::Stand(3.0)]);
    let known = walker.position.norm();
    let bench = bench(walker);
    let reckoned = length(&steps(&bench.until(&mut bench.sensor(&USUAL), f64::MAX)));
    let mut sensor = USUAL;
    sensor.step_length *= (known / reckoned) as f32;
    sensor
}

fn length(steps: &[Step<f32>]) -> f64 {
    steps.iter().map(|step| f64::from(step.distance)).sum()
}

fn person(seed: u64, acts: &[Act]) -> Walker {
    let mut walker = Walker::new(seed);
    walker.act(&[Act::Stand(5.0)]);
    walker.act(acts);
    walker.act(&[Act::Stand(3.0)]);
    walker
}

fn bench(walker: Walker) -> Rc<Bench> {
    let bench = Bench::new(walker.readings);
    bench.compass.borrow_mut().hard_iron = nalgebra::Vector3::from(IRON).cast();
    bench
}

fn steps(happened: &[Happened]) -> Vec<Step<f32>> {
    let steps = happened.iter().filter_map(|(_, step)| step.unwrap());
    steps.collect()
}

/// Times at which the sensor told that it works again.
fn recoveries(happened: &[Happened]) -> Vec<f64> {
    let ended = happened.iter().filter(|(_, step)| *step == Ok(None));
    ended.map(|(at, _)| *at).collect()
}

fn sum(steps: &[Step<f32>]) -> Vector2<f64> {
    steps.iter().map(|step| step.displacement().cast()).sum()
}

fn failures(happened: &[Happened]) -> Vec<SensorError> {
    happened.iter().filter_map(|(_, step)| step.err()).collect()
}

fn straight(steps: u32) -> [Act; 1] {
    [Act::Walk(steps, 0.0)]
}

/// Every step, 6 % of the way, and its direction: within 6 degrees, of which the field's wandering makes
/// most. With any error of the chip's clock.
#[test]
fn a_walk_comes_out_as_steps() {
    let config = calibrated();
    for (seed, fine) in (100..112).zip([0, 33, -33, 20, -20, 7].into_iter().cycle()) {
        let walker = person(seed, &straight(40));
        // Headings are counted from magnetic east.
        let facing = walker.facing - (walker.north - FRAC_PI_2);
        let truth = walker.position.norm();
        let bench = bench(walker);
        bench.motion.borrow_mut().fine = fine;
        let happened = bench.until(&mut bench.sensor(&config), f64::MAX);
        let steps = steps(&happened);
        let walked = sum(&steps);
        let off = turn(walked.y.atan2(walked.x), facing).to_degrees();
        let ratio = walked.norm() / truth;
        println!(
            "seed {seed}: {} steps, {ratio:.3}, {off:+.1} degrees",
            steps.len()
        );
        assert_eq!(steps.len(), 40, "seed {seed}");
        assert!((ratio - 1.0).abs() < 0.06, "seed {seed}: {ratio}");
        assert!(off.abs() < 6.0, "seed {seed}: {off}");
    }
}

/// The turn is the gyroscope's: within a second the compass has no say.
#[test]
fn a_turn_is_a_turn() {
    for angle in [1.5, -1.5] {
        let acts = [Act::Walk(12, 0.0), Act::Walk(12, angle)];
        let bench = bench(person(7, &acts));
        let happened = bench.until(&mut bench.sensor(&USUAL), f64::MAX);
        let steps = steps(&happened);
        assert_eq!(steps.len(), 24);
        let turned = turn(steps[18].heading.into(), steps[8].heading.into());
        assert!((turned - angle).abs() < 0.12, "{turned} {angle}");
    }
}

#[test]
fn nobody_walks_at_rest() {
    let bench = bench(person(3, &[Act::Stand(120.0)]));
    let happened = bench.until(&mut bench.sensor(&USUAL), f64::MAX);
    assert!(happened.is_empty(), "{happened:?}");
}

/// A node that writes its flash, or is busy otherwise, comes late; the same steps come out.
#[test]
fn late_wake_ups_do_not_matter() {
    let walk = || {
        let acts = [Act::Walk(20, 0.0), Act::Walk(20, 1.0)];
        bench(person(21, &acts))
    };
    let punctual = walk();
    let expected = steps(&punctual.until(&mut punctual.sensor(&USUAL), 27.0));
    assert!(expected.len() >= 30);
    for late_us in [30_000, 400_000, 2_000_000] {
        let late = walk();
        late.faults.borrow_mut().late_us = late_us;
        let found = steps(&late.until(&mut late.sensor(&USUAL), f64::MAX));
        assert_eq!(found.len(), 40, "{late_us}");
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found.distance - expected.distance).abs() < 0.02);
            // The compass is read less often.
            let off = turn(found.heading.into(), expected.heading.into());
            assert!(off.abs() < 0.2, "{late_us}: {off}");
        }
    }
}

/// Calls are dropped in the middle of a transaction, every second to fifth look at the chips.
#[test]
fn calls_that_are_dropped_lose_no_step() {
    let whole = bench(person(21, &straight(40)));
    let expected = length(&steps(&whole.until(&mut whole.sensor(&USUAL), f64::MAX)));
    for most in [600, 300] {
        let bench = bench(person(21, &straight(40)));
        let mut sensor = bench.sensor(&USUAL);
        let mut happened = bench.until(&mut sensor, 4.0);
        bench.faults.borrow_mut().cut = Some(most);
        happened.extend(bench.until(&mut sensor, f64::MAX));
        let steps = steps(&happened);
        assert_eq!(steps.len(), 40, "{most}");
        let ratio = length(&steps) / expected;
        assert!((ratio - 1.0).abs() < 0.03, "{most}: {ratio}");
    }
}

#[test]
fn a_sensor_that_is_not_there_is_reported_until_it_is() {
    type Change = fn(&Bench, bool);
    let cases: [(Change, Chip, SensorFault); 5] = [
        (
            |b, bad| b.faults.borrow_mut().no_motion = bad,
            Chip::Motion,
            SensorFault::Absent,
        ),
        (
            |b, bad| b.faults.borrow_mut().no_compass = bad,
            Chip::Compass,
            SensorFault::Absent,
        ),
        (
            |b, bad| b.faults.borrow_mut().broken = bad,
            Chip::Motion,
            SensorFault::Bus,
        ),
        (
            |b, bad| b.motion.borrow_mut().identity = if bad { 0x69 } else { 0x6C },
            Chip::Motion,
            SensorFault::Identity,
        ),
        (
            |b, bad| b.compass.borrow_mut().identity = if bad { 0 } else { 0x3D },
            Chip::Compass,
            SensorFault::Identity,
        ),
    ];
    for (change, chip, fault) in cases {
        let bench = bench(person(5, &straight(20)));
        let mut sensor = bench.sensor(&USUAL);
        change(&bench, true);
        let happened = bench.until(&mut sensor, 2.5);
        assert_eq!(failures(&happened), vec![chip.is(fault); 3]);
        change(&bench, false);
        let happened = bench.until(&mut sensor, f64::MAX);
        assert_eq!(steps(&happened).len(), 20, "{chip:?} {fault:?}");
        assert_eq!(recoveries(&happened).len(), 1, "{chip:?} {fault:?}");
    }
}

/// A fault at 12 s of a long walk is reported once, soon, and then it goes on. It is over when the chips have measured
/// for two seconds.
#[test]
fn what_fails_under_way_is_set_up_anew() {
    type Change = fn(&Bench);
    let nothing: Change = |_| {};
    let cases: [(&str, Change, Change, Chip, SensorFault); 6] = [
        (
            "reset",
            |b| b.motion.borrow_mut().reset(),
            nothing,
            Chip::Motion,
            SensorFault::Silent,
        ),
        (
            "reset",
            |b| b.compass.borrow_mut().reset(),
            nothing,
            Chip::Compass,
            SensorFault::Silent,
        ),
        (
            "stuck",
            |b| b.motion.borrow_mut().stick(),
            |b| b.motion.borrow_mut().unstick(),
            Chip::Motion,
            SensorFault::Stuck,
        ),
        (
            "stuck",
            |b| b.compass.borrow_mut().stick(),
            |b| b.compass.borrow_mut().unstick(),
            Chip::Compass,
            SensorFault::Stuck,
        ),
        (
            "bus",
            |b| b.faults.borrow_mut().broken = true,
            |b| b.faults.borrow_mut().broken = false,
            Chip::Motion,
            SensorFault::Bus,
        ),
        (
            "late",
            |b| b.faults.borrow_mut().late_us = 12_000_000,
            |b| b.faults.borrow_mut().late_us = 0,
            Chip::Motion,
            SensorFault::Overrun,
        ),
    ];
    for (name, fail, heal, chip, fault) in cases {
        let bench = bench(person(9, &straight(80)));
        let mut sensor = bench.sensor(&USUAL);
        let before = steps(&bench.until(&mut sensor, 12.0));
        assert!(before.len() > 8, "{name}");
        fail(&bench);
        let mut failed = Vec::new();
        // A little longer than a second: a failure counts for one.
        let mut end = 12.0;
        while failures(&failed).is_empty() && end < 25.0 {
            end += 0.1;
            failed.extend(bench.until(&mut sensor, end));
        }
        let found = failed.last().and_then(|last| last.1.err());
        assert_eq!(found.map(SensorError::fault), Some(fault), "{name}");
        // The bus fails both.
        let is_blamed = found.is_some_and(|found| found.chip() == chip);
        assert!(is_blamed || fault == SensorFault::Bus, "{name}: {found:?}");
        let noticed = failed.last().unwrap().0 - 1.0;
        assert!(
            fault == SensorFault::Overrun || noticed < 14.0,
            "{name}: {noticed}"
        );
        heal(&bench);
        let after = bench.until(&mut sensor, f64::MAX);
        let recovered = recoveries(&after);
        let [over] = recovered[..] else {
            panic!("{name}: {recovered:?}");
        };
        // It was set up anew when the failure was told.
        let lasts = over - failed.last().unwrap().0;
        assert!((2.0..3.0).contains(&lasts), "{name}: {lasts}");
        // The step for which it was late does not come out once more.
        let left = (person(9, &straight(80)).time - 3.0 - end) * 1.5;
        let after = steps(&after).len();
        assert!(
            after > 10 && after as f64 >= left - 4.0,
            "{name}: {after}, {left}"
        );
        assert!(before.len() + after < 80, "{name}");
    }
}

/// Errors of the bus that pass cost nothing: wherever they come, in the start and in a walk.
#[test]
fn transfers_that_fail_are_repeated() {
    let walk = || bench(person(100, &straight(40)));
    let expected = {
        let bench = walk();
        length(&steps(&bench.until(&mut bench.sensor(&USUAL), f64::MAX)))
    };
    for refused in [(1, 2), (1, 7), (2, 5), (3, 4), (3, 100)] {
        let bench = walk();
        bench.faults.borrow_mut().refused = Some(refused);
        let happened = bench.until(&mut bench.sensor(&USUAL), f64::MAX);
        let steps = steps(&happened);
        assert_eq!(steps.len(), 40, "{refused:?}");
        let ratio = length(&steps) / expected;
        assert!((ratio - 1.0).abs() < 0.02, "{refused:?}: {ratio}");
    }
    // What fails for longer is named.
    let bench = walk();
    bench.faults.borrow_mut().refused = Some((4, 100));
    let happened = bench.until(&mut bench.sensor(&USUAL), f64::MAX);
    let absent = |failure: &SensorError| failure.fault() == SensorFault::Absent;
    assert!(failures(&happened).iter().all(absent) && !failures(&happened).is_empty());
}

/// A board that was restarted alone finds its sensors as they were: the chip refuses a reset while its FIFO
/// streams.
#[test]
fn a_board_may_start_without_its_sensors() {
    let bench = bench(person(9, &straight(40)));
    let before = steps(&bench.until(&mut bench.sensor(&USUAL), 12.0)).len();
    assert!(before > 8, "{before}");
    let after = steps(&bench.until(&mut bench.sensor(&USUAL), f64::MAX)).len();
    // Those of the second in which it started are lost.
    assert!(before + after >= 37, "{before} and {after}");
}

/// It says that it is the usual chip, and measures half.
#[test]
fn an_lsm6dso32_is_told_by_gravity() {
    let walk = || person(100, &straight(40));
    let expected = {
        let bench = bench(walk());
        steps(&bench.until(&mut bench.sensor(&USUAL), f64::MAX))
    };
    let bench = bench(walk());
    bench.motion.borrow_mut().is_32 = true;
    let mut sensor = bench.sensor(&USUAL);
    let found = steps(&bench.until(&mut sensor, f64::MAX));
    assert_eq!(found.len(), expected.len());
    let off = (sum(&found) - sum(&expected)).norm();
    assert!(off < 0.03 * sum(&expected).norm(), "{off} m");
}

/// A person who runs or turns the sensor over does not look like another chip; one that measures another
/// gravity is named.
#[test]
fn a_scale_that_is_none_is_named() {
    for (unit, is_named) in [
        (0.2, true),
        (0.8, false),
        (1.3, false),
        (1.8, false),
        (3.5, true),
    ] {
        let mut walker = person(100, &[Act::Stand(5.0)]);
        for reading in &mut walker.readings {
            reading.acceleration *= unit;
        }
        let bench = bench(walker);
        let happened = bench.until(&mut bench.sensor(&USUAL), f64::MAX);
        let error = Chip::Motion.is(SensorFault::Scale);
        let failures = failures(&happened);
        assert_eq!(!failures.is_empty(), is_named, "{unit}: {failures:?}");
        assert!(failures.iter().all(|failure| *failure == error), "{unit}");
        assert_eq!(recoveries(&happened), [0.0; 0], "{unit}");
    }
}

/// Noise on the bus, or a weak supply, changes a register: the compass measures in another unit from then on.
#[test]
fn a_setting_that_changes_is_set_again() {
    let acts = [
        Act::Walk(12, 0.0),
        Act::Stand(3.0),
        Act::Turn(1.5, 3.0),
        Act::Stand(3.0),
        Act::Walk(12, 0.0),
    ];
    let walk = || bench(person(100, &acts));
    let expected = {
        let bench = walk();
        steps(&bench.until(&mut bench.sensor(&USUAL), f64::MAX))
    };
    let bench = walk();
    let mut sensor = bench.sensor(&USUAL);
    let mut found = steps(&bench.until(&mut sensor, 3.0));
    bench.compass.borrow_mut().write(0x21, 0x60);
    found.extend(steps(&bench.until(&mut sensor, f64::MAX)));
    let off = (sum(&found) - sum(&expected)).norm();
    assert_eq!(found.len(), expected.len());
    assert!(off < 0.3, "{off} m");
}

/// Of the accelerometer that is an error, and what it measured is not used any more.
#[test]
fn a_range_that_changes_is_named() {
    let bench = bench(person(9, &straight(80)));
    let mut sensor = bench.sensor(&USUAL);
    let before = steps(&bench.until(&mut sensor, 12.0)).len();
    bench.motion.borrow_mut().write(0x10, 0x34);
    let after = bench.until(&mut sensor, f64::MAX);
    let changed = Chip::Motion.is(SensorFault::Changed);
    assert_eq!(failures(&after), [changed]);
    let is_step = |step: &Happened| matches!(step.1, Ok(Some(_)));
    let after = after.into_iter().filter(is_step).count();
    assert!(before + after > 74, "{before} and {after}");
}

/// Random bytes end in an error, never in a panic or a loop without end.
#[test]
fn noise_is_noticed() {
    let bench = bench(person(4, &straight(20)));
    *bench.faults.borrow_mut() = Faults {
        noise: true,
        ..Faults::default()
    };
    let happened = bench.until(&mut bench.sensor(&USUAL), f64::MAX);
    let failures = failures(&happened);
    assert!(failures.len() > 5, "{happened:?}");
}
