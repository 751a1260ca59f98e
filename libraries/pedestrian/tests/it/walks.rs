//! Whole walks: sensor readings of a simulated person, against what is known of the person.

use crate::walker;

use std::{f64::consts::TAU, time::Duration};

use calib_core::{
    angle::wrap_signed,
    dead_reckoning::{Step, Systematic, Track},
};
use nalgebra::{Matrix2, Point2, Vector3};
use pedestrian::{
    HeadingFilter, HeadingSettings, ImuError, ImuSample, Pedestrian, PedestrianSettings,
    StepLength, magnetic_north,
};
use proptest::prelude::*;
use walker::{Act, Walker, moment, reckon, sample, settings};

fn length(steps: &[Step<f64>]) -> f64 {
    steps.iter().map(|step| step.distance).sum()
}

/// `K` from a straight walk of 60 steps by the same kind of person, at another pace.
fn calibrated() -> StepLength<f64> {
    let mut walker = Walker::new(4711);
    walker.cadence = 1.8;
    walker.act(&[Act::Stand(3.0), Act::Walk(60, 0.0), Act::Stand(2.0)]);
    let steps = reckon(&walker, settings(&walker));
    assert_eq!(steps.len(), 60);
    StepLength::default()
        .calibrated(length(&steps), walker.position.norm())
        .unwrap()
}

fn round_the_block() -> Vec<Act> {
    let mut acts = vec![Act::Stand(5.0)];
    for turn in [0.0, 1.2, -0.7, TAU / 4.0, TAU / 4.0, -2.5] {
        acts.push(Act::Walk(14, turn));
        acts.push(Act::Stand(3.0));
    }
    acts
}

/// Calibrated, lengths are right in the mean over walkers, and differ with their cadence.
#[test]
fn every_step_is_counted_and_measured() {
    let k = calibrated();
    let (mut sum, mut squares) = (0.0, 0.0);
    for seed in 0..30 {
        let mut walker = Walker::new(seed);
        walker.act(&round_the_block());
        let mut changed = settings(&walker);
        changed.length = k;
        let steps = reckon(&walker, changed);
        assert_eq!(steps.len(), 84, "seed {seed}, cadence {}", walker.cadence);
        let truth = 84.0 * walker.step_length;
        let error = length(&steps) / truth - 1.0;
        assert!(error.abs() < 0.04, "seed {seed}: {error}");
        sum += error;
        squares += error * error;
    }
    let (mean, rms) = (sum / 30.0, f64::sqrt(squares / 30.0));
    assert!(mean.abs() < 0.01, "{mean}");
    assert!((0.012..0.022).contains(&rms), "{rms}");
}

/// At 25 readings a second, with a step length calibrated at 100. Peaks fall between readings, so
/// steps come out a few percent short, and cadences differ: the rms over walkers is what counts.
#[test]
fn a_slow_sensor_will_do() {
    let k = calibrated();
    let (mut sum, mut squares) = (0.0, 0.0);
    for seed in 0..20 {
        let mut walker = Walker::new(seed);
        walker.act(&round_the_block());
        let mut changed = settings(&walker);
        changed.length = k;
        let mut person = Pedestrian::new(changed).unwrap();
        let mut steps = Vec::new();
        for (i, reading) in walker.readings.iter().enumerate().step_by(4) {
            steps.extend(person.update(moment(i), &sample(reading)).unwrap());
        }
        assert_eq!(steps.len(), 84, "seed {seed}");
        let error = length(&steps) / (84.0 * walker.step_length) - 1.0;
        assert!(error.abs() < 0.08, "seed {seed}: {error}");
        sum += error;
        squares += error * error;
    }
    let (mean, rms) = (sum / 20.0, f64::sqrt(squares / 20.0));
    assert!((-0.045..-0.02).contains(&mean), "{mean}");
    assert!(rms < 0.045, "{rms}");
}

#[test]
fn a_walk_begins_when_it_is_confirmed() {
    for (confirmation, walked, counted) in [
        (1, 1, 1),
        (2, 1, 0),
        (2, 2, 2),
        (4, 3, 0),
        (4, 4, 4),
        (4, 9, 9),
    ] {
        let mut walker = Walker::new(3);
        walker.act(&[Act::Stand(3.0), Act::Walk(walked, 0.0), Act::Stand(3.0)]);
        let mut changed = settings(&walker);
        changed.confirmation = confirmation;
        let steps = reckon(&walker, changed);
        assert_eq!(
            steps.len(),
            counted,
            "{walked} steps, {confirmation} to confirm"
        );
    }
}

/// Heading against truth all along the walk: the rms in units of the stated sigma.
#[test]
fn heading_keeps_within_its_sigma() {
    let (mut sum, mut count, mut worst) = (0.0, 0.0, 0.0_f64);
    let mut bias_errors = 0.0;
    for seed in 0..30 {
        let mut walker = Walker::new(seed);
        walker.act(&round_the_block());
        let mut person = Pedestrian::new(settings(&walker)).unwrap();
        for (i, reading) in walker.readings.iter().enumerate() {
            person.update(moment(i), &sample(reading)).unwrap();
            if i < 100 {
                continue;
            }
            let filter = person.heading_filter();
            let error = wrap_signed(filter.heading() - reading.facing) / filter.sigma();
            sum += error * error;
            count += 1.0;
            worst = worst.max(error.abs());
        }
        let bias_error = person.heading_filter().gyro_bias() - walker.gyro_bias.z;
        // The bias about the vertical, not quite that about z of a sensor that leans.
        assert!(bias_error.abs() < 0.01, "seed {seed}: {bias_error}");
        bias_errors += bias_error;
    }
    let rms = f64::sqrt(sum / count);
    println!("heading error: rms {rms:.2} sigma, worst {worst:.2} sigma");
    assert!((0.75..1.0).contains(&rms), "rms {rms}");
    assert!((2.0..3.5).contains(&worst), "worst {worst}");
    let mean_bias_error: f64 = bias_errors / 30.0;
    assert!(mean_bias_error.abs() < 0.003, "{mean_bias_error}");
}

/// Sensors to position: errors at the end of the walks in units of the track's covariance. Headings
/// that err together for some time count as independent ones of a larger sigma: fair for long walks,
/// cautious for short ones.
#[test]
fn the_track_knows_how_far_it_may_be_off() {
    let k = calibrated();
    let systematic = Systematic {
        heading_sigma: 0.0,
        scale_sigma: 0.03,
    };
    for (name, expected, acts) in [
        (
            "short",
            0.4..0.9,
            vec![Act::Stand(8.0), Act::Walk(8, 0.0), Act::Stand(2.0)],
        ),
        ("block", 0.5..1.05, round_the_block()),
        (
            "long",
            0.9..1.8,
            vec![Act::Stand(5.0), Act::Walk(300, 0.0), Act::Stand(2.0)],
        ),
    ] {
        let mut nees = 0.0;
        let runs = 30;
        for seed in 0..runs {
            let mut walker = Walker::new(1000 + seed);
            walker.act(&acts);
            let mut track = Track::start(Point2::origin(), Matrix2::zeros(), systematic).unwrap();
            let mut changed = settings(&walker);
            changed.length = k;
            for step in reckon(&walker, changed) {
                track.advance(&step).unwrap();
            }
            let error = track.position().coords - walker.position;
            nees += error.dot(&track.covariance().cholesky().unwrap().solve(&error));
        }
        nees /= runs as f64;
        println!("{name}: mean NEES {nees:.2} (2 when fair, less when cautious)");
        assert!(expected.contains(&nees), "{name}: {nees}");
    }
}

#[test]
fn nobody_walks_at_rest() {
    let mut walker = Walker::new(7);
    walker.acceleration_noise = 0.1;
    walker.act(&[Act::Stand(600.0)]);
    assert_eq!(reckon(&walker, settings(&walker)).len(), 0);
}

#[test]
fn turning_on_the_spot_is_no_step_and_does_not_spoil_the_next() {
    let mut walker = Walker::new(8);
    walker.act(&[
        Act::Stand(5.0),
        Act::Turn(2.0, 1.5),
        Act::Stand(1.0),
        Act::Walk(6, 0.0),
        Act::Stand(2.0),
    ]);
    let steps = reckon(&walker, settings(&walker));
    assert_eq!(steps.len(), 6);
    for step in steps {
        let error = wrap_signed(step.heading - walker.facing);
        assert!(error.abs() < 0.12, "{error}");
    }
}

/// Blows of different strength and length, some with a rebound, none a step.
#[test]
fn a_knock_is_no_step() {
    for (strength, duration) in [(15.0, 2), (40.0, 3), (80.0, 5), (-30.0, 4), (20.0, 20)] {
        for rebound in [0.0, -0.5, 0.9] {
            let mut walker = Walker::new(9);
            walker.act(&[Act::Stand(10.0)]);
            for i in 0..duration {
                walker.readings[500 + i].acceleration.z += strength;
                walker.readings[500 + duration + i].acceleration.z += strength * rebound;
            }
            let steps = reckon(&walker, settings(&walker));
            assert_eq!(steps.len(), 0, "{strength} m/s^2, {rebound}");
        }
    }
}

/// Ten seconds past a steel door that turns the compass by 60 degrees: once with a stronger field,
/// and once with a field as strong as ever, where only the gyroscope can tell.
#[test]
fn a_disturbed_compass_is_left_out() {
    for (seed, stronger) in (0..10).flat_map(|seed| [(seed, true), (seed, false)]) {
        let mut walker = Walker::new(seed);
        walker.act(&[Act::Stand(20.0), Act::Walk(20, 0.0)]);
        let horizontal = |angle: f64| Vector3::new(angle.cos(), angle.sin(), 0.0) * 20.0;
        walker.disturbance = if stronger {
            horizontal(walker.north + TAU / 4.0) * 1.75
        } else {
            horizontal(walker.north + TAU / 6.0) - horizontal(walker.north)
        };
        let before = walker.readings.len();
        walker.act(&[Act::Walk(20, 0.5)]);
        let in_passing = walker.readings.len() - before;
        walker.disturbance = Vector3::zeros();
        walker.act(&[Act::Walk(10, 0.5)]);

        let mut person = Pedestrian::new(settings(&walker)).unwrap();
        let mut disturbed = 0_usize;
        for (i, reading) in walker.readings.iter().enumerate() {
            person.update(moment(i), &sample(reading)).unwrap();
            let filter = person.heading_filter();
            disturbed += usize::from(filter.is_disturbed());
            if i > 1000 {
                let error = wrap_signed(filter.heading() - reading.facing);
                assert!(error.abs() < 0.2, "seed {seed}, {i}: {error}");
                assert!(error.abs() < 4.0 * filter.sigma());
            }
        }
        // All the time, and a fraction of a second longer.
        assert!(
            (in_passing - 3..in_passing + 30).contains(&disturbed),
            "seed {seed}: {disturbed} of {in_passing}"
        );
        assert!(!person.heading_filter().is_disturbed());
    }
}

/// A field that never comes back becomes the usual one.
#[test]
fn a_stronger_field_is_accepted_in_the_end() {
    let mut walker = Walker::new(5);
    walker.act(&[Act::Stand(20.0)]);
    walker.disturbance = Vector3::z() * -20.0;
    walker.act(&[Act::Stand(60.0)]);
    let mut person = Pedestrian::new(settings(&walker)).unwrap();
    let mut sigmas = Vec::new();
    for (i, reading) in walker.readings.iter().enumerate() {
        person.update(moment(i), &sample(reading)).unwrap();
        sigmas.push(person.heading_filter().sigma());
    }
    let left_out = sigmas[4900] / sigmas[1900];
    assert!((3.5..5.0).contains(&left_out), "{left_out}");
    let accepted = sigmas[7900] / sigmas[1900];
    assert!((0.7..1.0).contains(&accepted), "{accepted}");
}

/// The compass runs clockwise from north, the heading counter-clockwise from x.
#[test]
fn compass_and_world_turn_opposite_ways() {
    let facing = |declination: f64, forward: f64, left: f64| {
        let mut heading = HeadingSettings::default();
        // The world's x axis points to true east.
        heading.magnetic_north = magnetic_north(TAU / 4.0, declination.to_radians());
        let mut filter = HeadingFilter::new(heading).unwrap();
        let sample = ImuSample {
            acceleration: Vector3::new(0.0, 0.0, 9.8),
            angular_rate: Vector3::zeros(),
            magnetic_field: Some(Vector3::new(forward, left, -40.0)),
        };
        filter.update(0.01, &sample);
        filter.heading().to_degrees()
    };
    // North ahead, on the left (facing east), behind, on the right (facing west).
    for (forward, left, heading) in [
        (20.0, 0.0, 90.0),
        (0.0, 20.0, 0.0),
        (-20.0, 0.0, 270.0),
        (0.0, -20.0, 180.0),
    ] {
        assert!(wrap_degrees(facing(0.0, forward, left) - heading).abs() < 1e-6);
        // Where the needle points 10 degrees east of north, a walk along it goes clockwise of y.
        assert!(wrap_degrees(facing(10.0, forward, left) - (heading - 10.0)).abs() < 1e-6);
    }
}

fn wrap_degrees(angle: f64) -> f64 {
    wrap_signed(angle.to_radians()).to_degrees()
}

/// Walking with the heading right on the seam of the angles is nothing special.
#[test]
fn the_seam_of_the_angles_is_nowhere() {
    for seam in [0.0, TAU / 2.0] {
        let mut walker = Walker::new(12);
        walker.facing = seam;
        walker.act(&[Act::Stand(6.0), Act::Walk(40, 0.0), Act::Stand(2.0)]);
        let steps = reckon(&walker, settings(&walker));
        assert_eq!(steps.len(), 40);
        for step in &steps {
            assert!((0.0..TAU).contains(&step.heading));
            assert!(wrap_signed(step.heading - seam).abs() < 0.2);
        }
        let above = steps
            .iter()
            .filter(|s| wrap_signed(s.heading - seam) > 0.0)
            .count();
        assert!(above > 0 && above < 40, "the seam was not crossed");
    }
}

#[test]
fn a_node_in_f32_walks_the_same_way() {
    let mut walker = Walker::new(21);
    walker.act(&round_the_block());
    let wide = reckon(&walker, settings(&walker));
    let mut narrow_settings = PedestrianSettings::default();
    narrow_settings.heading.magnetic_north = walker.north as f32;
    let mut person = Pedestrian::<f32>::new(narrow_settings).unwrap();
    let mut narrow = Vec::new();
    for (i, reading) in walker.readings.iter().enumerate() {
        let sample = ImuSample {
            acceleration: reading.acceleration.cast(),
            angular_rate: reading.angular_rate.cast(),
            magnetic_field: reading.magnetic_field.map(nalgebra::Matrix::cast),
        };
        // Hours after the clock's start, where seconds in an f32 would have run out of digits.
        let time = Duration::from_secs(1_000_000) + moment(i);
        narrow.extend(person.update(time, &sample).unwrap());
    }
    assert_eq!(wide.len(), narrow.len());
    for (a, b) in wide.iter().zip(&narrow) {
        assert!((a.distance - f64::from(b.distance)).abs() < 1e-4);
        assert!(wrap_signed(a.heading - f64::from(b.heading)).abs() < 1e-3);
        assert!((a.heading_sigma - f64::from(b.heading_sigma)).abs() < 1e-3 * a.heading_sigma);
    }
}

/// The magnetometer at a tenth of the rate.
#[test]
fn a_slow_compass_will_do() {
    let mut walker = Walker::new(22);
    walker.act(&round_the_block());
    for (i, reading) in walker.readings.iter_mut().enumerate() {
        if i % 10 != 0 {
            reading.magnetic_field = None;
        }
    }
    let mut person = Pedestrian::new(settings(&walker)).unwrap();
    for (i, reading) in walker.readings.iter().enumerate() {
        person.update(moment(i), &sample(reading)).unwrap();
    }
    let filter = person.heading_filter();
    assert!(wrap_signed(filter.heading() - walker.facing).abs() < 3.0 * filter.sigma());
    assert!((0.028..0.038).contains(&filter.sigma()));
}

/// No compass at all: a known start, and a sigma that grows with the unknown bias.
#[test]
fn without_a_compass_the_sigma_says_so() {
    let mut walker = Walker::new(23);
    walker.act(&[Act::Stand(1.0), Act::Walk(20, 1.0), Act::Stand(1.0)]);
    let mut person = Pedestrian::new(settings(&walker)).unwrap();
    person.align(walker.readings[0].facing, 0.01);
    for (i, reading) in walker.readings.iter().enumerate() {
        let sample = ImuSample {
            magnetic_field: None,
            ..sample(reading)
        };
        person.update(moment(i), &sample).unwrap();
    }
    let filter = person.heading_filter();
    let error = wrap_signed(filter.heading() - walker.facing);
    // Bias sigma times time, from the settings alone.
    let expected = 0.05 * walker.time;
    assert!((filter.sigma() / expected - 1.0).abs() < 0.005);
    assert!(error.abs() < 3.0 * filter.sigma());
}

#[test]
fn time_must_go_on() {
    let mut walker = Walker::new(24);
    walker.act(&[Act::Stand(5.0), Act::Walk(10, 0.0), Act::Stand(2.0)]);
    let mut person = Pedestrian::new(settings(&walker)).unwrap();
    let mut count = 0;
    for (i, reading) in walker.readings.iter().enumerate() {
        count += usize::from(
            person
                .update(moment(i), &sample(reading))
                .unwrap()
                .is_some(),
        );
        // Again, and late, and broken: refused, and nothing changes.
        let before = person;
        let broken = ImuSample {
            angular_rate: Vector3::new(0.0, f64::NAN, 0.0),
            ..sample(reading)
        };
        assert_eq!(
            person.update(moment(i), &sample(reading)),
            Err(ImuError::TimeNotAfter)
        );
        assert_eq!(
            person.update(moment(i + 1), &broken),
            Err(ImuError::NotUsable)
        );
        assert_eq!(person, before);
    }
    assert_eq!(count, 10);

    // A gap: the heading is open until the compass has told it again.
    let still = sample(&walker.readings[0]);
    let blind = ImuSample {
        magnetic_field: None,
        ..still
    };
    let later = moment(walker.readings.len() + 50);
    assert_eq!(person.update(later, &blind), Ok(None));
    // Sigma of a direction of which nothing is known.
    let unknown = TAU / 2.0 / 3_f64.sqrt();
    assert!((person.heading_filter().sigma() - unknown).abs() < 1e-9);
    assert_eq!(person.update(later + moment(1), &still), Ok(None));
    let told_once = person.heading_filter().sigma();
    assert!((0.6..0.7).contains(&told_once), "{told_once}");
}

fn any_number() -> impl Strategy<Value = f32> {
    prop_oneof![
        8 => -30.0_f32..30.0,
        1 => any::<f32>(),
        1 => prop::sample::select(vec![0.0, -0.0, f32::NAN, f32::INFINITY, f32::MIN_POSITIVE, 9999.0]),
    ]
}

fn any_vector() -> impl Strategy<Value = Vector3<f32>> {
    [any_number(), any_number(), any_number()].prop_map(Vector3::from)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whatever_is_read_nothing_breaks(
        readings in prop::collection::vec(
            (0_u64..120, 0_u64..20, any_vector(), any_vector(), prop::option::of(any_vector())),
            1..300,
        ),
        confirmation in 1_u8..=4,
    ) {
        let mut settings = PedestrianSettings::default();
        settings.confirmation = confirmation;
        let mut person = Pedestrian::<f32>::new(settings).unwrap();
        let mut track = Track::start(
            Point2::origin(), Matrix2::zeros(), Systematic::default()).unwrap();
        let mut time = 1000;
        for (forward, back, acceleration, angular_rate, magnetic_field) in readings {
            time = time + forward - back;
            let sample = ImuSample { acceleration, angular_rate, magnetic_field };
            if let Ok(Some(step)) = person.update(Duration::from_millis(time), &sample) {
                track.advance(&step).unwrap();
            }
            let filter = person.heading_filter();
            prop_assert!((0.0..std::f32::consts::TAU).contains(&filter.heading()));
            prop_assert!(filter.sigma() >= 0.0 && filter.sigma() < 1.82);
            prop_assert!(filter.gyro_bias().is_finite());
        }
        prop_assert!(track.covariance().iter().all(|x| x.is_finite()));
    }
}
