use calib_core::{
    Pose, angle,
    joint::{Capacity, JointEstimator, JointMemory, JointSettings, Leg, Prior},
};
use nalgebra::{Matrix3, Point2, SMatrix, SVector, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

const SIGMA: f64 = 0.003;
const STANDING: f64 = 0.01;
const STEPS: Steps = Steps {
    scale: 0.05,
    compass: 0.03,
    leg: [0.02, 0.01],
    least: 0.01,
};

fn pose(x: f64, y: f64, heading: f64) -> Pose<f64> {
    Pose {
        position: Point2::new(x, y),
        heading: angle::wrap_positive(heading),
        covariance: Matrix3::zeros(),
    }
}

/// Six cameras around a room, and a walk in it.
fn survey(seed: u64, stops: usize) -> Survey {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let cameras = [
        pose(0.0, 0.0, 0.8),
        pose(10.0, 0.0, 2.3),
        pose(12.0, 8.0, 3.4),
        pose(5.0, 12.0, 4.7),
        pose(-2.0, 9.0, 5.6),
        pose(4.0, -3.0, 1.5),
    ];
    let stops: Vec<Point2<f64>> = (0..stops)
        .map(|_| Point2::new(random.random_range(2.0..8.0), random.random_range(2.0..8.0)))
        .collect();
    let legs = { 0..stops.len() }
        .map(|n| (n > 0).then(|| STEPS.covariance(stops[n] - stops[n - 1])))
        .collect();
    let looks = { 0..stops.len() }
        .flat_map(|stop| (0..cameras.len()).map(move |camera| (stop, camera)))
        // The references see the first stops, and all cameras see about half of the others.
        .filter(|&(stop, camera)| (stop < 4 && camera < 2) || random.random_bool(0.5))
        .map(|(stop, camera)| Look {
            stop,
            camera,
            sigma: SIGMA,
        })
        .collect();
    Survey {
        cameras: cameras.to_vec(),
        range: 20.0,
        stops,
        legs,
        looks,
        standing: STANDING,
        steps: STEPS,
        told: Told::EXACT,
        anchor: None,
    }
}

/// Results of the estimator that nodes run, from measurements without errors: of each camera that is no
/// reference, levels of place and heading, and its covariance; of each bearing its redundancy.
fn estimated(survey: &Survey) -> (Vec<[f64; 2]>, Vec<Matrix3<f64>>, Vec<f64>) {
    let [focal, principal] = survey.told.lens;
    let mut settings = JointSettings::default();
    settings.scale = Prior {
        mean: 1.0,
        sigma: STEPS.scale,
    };
    settings.compass = Prior {
        mean: 0.0,
        sigma: STEPS.compass,
    };
    settings.standing = STANDING;
    settings.lens = Some(focal);
    settings.principal = Some(principal);
    let room = Capacity {
        cameras: 6,
        stops: survey.stops.len(),
        bearings: survey.looks.len(),
        marks: 0,
    };
    let memory = JointMemory {
        cameras: &mut [Default::default(); 6],
        stops: &mut vec![Default::default(); survey.stops.len()],
        bearings: &mut vec![Default::default(); survey.looks.len()],
        marks: &mut [],
        visits: &mut [],
        workspace: &mut vec![0.0; room.workspace_with_lenses()],
    };
    let mut joint = JointEstimator::new(memory, 10.0, settings).unwrap();
    for (stop, place) in survey.stops.iter().enumerate() {
        let leg = survey.legs[stop].map(|covariance| Leg {
            displacement: place - survey.stops[stop - 1],
            covariance,
        });
        assert_eq!(joint.add_stop(leg), Ok(stop));
        for look in survey.looks.iter().filter(|look| look.stop == stop) {
            let camera = &survey.cameras[look.camera];
            let to: Vector2<f64> = place - camera.position;
            let bearing = angle::wrap_signed(to.y.atan2(to.x) - camera.heading);
            joint
                .add_bearing(stop, look.camera, bearing, look.sigma)
                .unwrap();
        }
    }
    joint.solve().unwrap();
    joint.protect().unwrap();
    let levels = (2..6).map(|camera| {
        let levels = joint.protection(camera).unwrap();
        [
            levels.position_bearing.max(levels.position_leg),
            levels.heading_bearing.max(levels.heading_leg),
        ]
    });
    let levels = levels.collect();
    let looks = 0..survey.looks.len();
    let redundancies: Vec<_> = { looks }
        .map(|n| joint.bearing_residual(n).unwrap().redundancy)
        .collect();
    let covariances = (2..6).map(|camera| joint.pose(camera).unwrap().covariance);
    (levels, covariances.collect(), redundancies)
}

/// Covariances, protection levels and redundancies are those of the estimator, which has them from a triangle.
#[test]
fn levels_are_those_of_the_estimator() {
    let lenses = [[0.0; 2], [0.05, 0.02], [0.0, 0.02]];
    for (seed, lens) in (0..6).zip(lenses.into_iter().cycle()) {
        let survey = Survey {
            told: Told {
                lens,
                ..Told::EXACT
            },
            ..survey(seed, 16)
        };
        let (levels, covariances, redundancies) = estimated(&survey);
        let known = survey.redundancy().unwrap();
        let found = known.levels(&[2, 3, 4, 5]);
        for (camera, covariance) in (2..).zip(covariances) {
            let own = known.covariance(camera);
            let off = (own - covariance).abs().max() / covariance.abs().max();
            assert!(off < 0.01, "{seed}, camera {camera}: {own} {covariance}");
        }
        for (found, [position, heading]) in found.iter().zip(levels) {
            let off = (found.position / position - 1.0).abs();
            assert!(off < 0.02, "{seed}: {found:?}, {position}");
            let off = (found.heading / heading - 1.0).abs();
            assert!(off < 0.02, "{seed}: {found:?}, {heading}");
        }
        let shares = known.shares();
        for ((of, share), redundancy) in shares.iter().zip(redundancies) {
            assert!(
                (share - redundancy).abs() < 0.01,
                "{of:?} {share} {redundancy}"
            );
        }
    }
}

/// Places of references that are not exact move all others: those between them least, along the baseline and across.
#[test]
fn a_frame_errs_as_its_references_do() {
    let exact = survey(2, 16);
    let told = Told {
        baseline: Some(0.02),
        place: 0.1,
        ..Told::EXACT
    };
    let frame = Survey {
        told,
        ..exact.clone()
    };
    let [exact, frame] = [exact, frame].map(|survey| survey.redundancy().unwrap());
    let by = |camera| frame.covariance(camera) - exact.covariance(camera);
    let second = by(1);
    assert!((second.m11 - (0.2_f64.powi(2) + 0.1_f64.powi(2))).abs() < 1e-9);
    assert!((second.m22 - 0.1_f64.powi(2)).abs() < 1e-9);
    // (5, 12): a place p moves by (1 - s) da + s db, where s is p over the baseline as a complex number.
    let far = by(3);
    let moved = 0.01 * (0.5_f64.powi(2) + 1.2_f64.powi(2)) * 2.0;
    assert!((far.m11 - (moved + 0.1_f64.powi(2))).abs() < 1e-9, "{far}");
    assert!((far.m22 - (moved + 0.24_f64.powi(2))).abs() < 1e-9, "{far}");
    assert!((far.m12 - 0.1 * 0.24).abs() < 1e-9, "{far}");
    assert!((far.m33 - 2.0 * 0.01 / 100.0).abs() < 1e-12, "{far}");
    assert!(frame.sigma(3) > exact.sigma(3));
    // Nodes add the frame's error to what their own measurements leave open: both at their worst.
    let level = |known: &Redundancy| known.levels(&[3])[0];
    let (alone, with) = (level(&exact), level(&frame));
    assert!((with.position - alone.position - RARE * (far.m11 + far.m22).sqrt()).abs() < 1e-9);
    assert!((with.heading - alone.heading - RARE * far.m33.sqrt()).abs() < 1e-9);
}

/// Two references look at the same place from near by, where no stop would be planned. Their two bearings of it are
/// what the other cameras hang on, so it is visited again.
#[test]
fn a_place_that_was_seen_is_asked_for_again_however_near_it_is() {
    let mut survey = survey(5, 16);
    survey.looks.clear();
    for stop in 0..16 {
        let cameras = if stop < 3 { 0..2 } else { 2..6 };
        survey.looks.extend(cameras.map(|camera| Look {
            stop,
            camera,
            sigma: SIGMA,
        }));
    }
    let lens = cmucam2_emulator::Lens::new(1.2, 88, 143).unwrap();
    let standing = survey.cameras.iter().map(|pose| Camera {
        place: pose.position,
        heading: pose.heading,
        mount: crate::world::Mount::LEVEL,
        lens,
        range: 20.0,
        variant: crate::world::Variant::Cmucam2,
    });
    let world = crate::world::World::new(standing.collect(), Vec::new(), Vec::new());
    let known = survey.redundancy().unwrap();
    let stops = |radius: f64| {
        let checks = Checks {
            world: &world,
            radius,
            may_stand: &|_| false,
            columns: 0.3,
            wishes: (2..6)
                .map(|camera| CheckWish {
                    camera,
                    tolerance: [0.1, 0.1],
                })
                .collect(),
        };
        checks.stops(known.clone(), 4).0
    };
    for radius in [0.05, 0.8] {
        let found = stops(radius);
        let of_references = found.iter().find(|stop| stop.seen_by == [0, 1]);
        assert!(
            of_references.is_some_and(|stop| stop.again.is_some_and(|again| again < 3)),
            "{radius}: {found:?}"
        );
    }
}

/// Where no one told the references' distance, the carrier tells it: its scale is that of everything.
#[test]
fn an_unknown_baseline_is_as_wide_as_the_carrier() {
    let told = Told {
        baseline: None,
        ..Told::EXACT
    };
    let survey = Survey {
        told,
        ..survey(2, 16)
    };
    let known = survey.redundancy().unwrap();
    let second = known.covariance(1);
    assert!((0.5..0.52).contains(&second.m11.sqrt()), "{second}");
    assert_eq!((second.m12, second.m22), (0.0, 0.0));
}

/// Going on by one stop is the same as beginning with it.
#[test]
fn one_more_stop_is_one_more_stop() {
    let whole = survey(3, 16);
    let last = whole.stops.len() - 1;
    let mut part = whole.clone();
    part.stops.pop();
    part.legs.pop();
    part.looks.retain(|look| look.stop < last);
    let looks: Vec<_> = { whole.looks.iter() }
        .filter(|look| look.stop == last)
        .map(|look| (look.camera, look.sigma))
        .collect();
    let place = whole.stops[last];
    let gone_on = part.redundancy().unwrap().with_stop(place, &looks);
    let whole = whole.redundancy().unwrap();
    let (a, b) = (gone_on.levels(&[2, 3, 4, 5]), whole.levels(&[2, 3, 4, 5]));
    for (a, b) in a.iter().zip(b) {
        assert!((a.position / b.position - 1.0).abs() < 1e-3, "{a:?} {b:?}");
        assert!((a.heading / b.heading - 1.0).abs() < 1e-3, "{a:?} {b:?}");
    }
}

/// Three bearings determine a pose, and a fourth one checks them.
#[test]
fn three_sightings_check_nothing_and_four_do() {
    let mut survey = survey(1, 16);
    let mut seen = 0;
    survey.looks.retain(|look| {
        seen += usize::from(look.camera == 2);
        look.camera != 2 || seen <= 3
    });
    let own = |known: &Redundancy| -> Vec<f64> {
        let shares = known.shares().into_iter();
        shares
            .filter(|(of, _)| matches!(of, Measurement::Bearing { camera: 2, .. }))
            .map(|(_, share)| share)
            .collect()
    };
    let three = survey.redundancy().unwrap();
    assert!(
        own(&three).iter().all(|share| *share < 1e-3),
        "{:?}",
        own(&three)
    );
    let level = three.levels(&[2])[0];
    assert!(matches!(
        level.by,
        Some(Measurement::Bearing { camera: 2, .. })
    ));
    assert!(level.position > 3.0, "{level:?}");
    let four = three.with_stop(Point2::new(6.0, 3.0), &[(2, SIGMA), (3, SIGMA), (4, SIGMA)]);
    // One degree of freedom, for four bearings and what ties the stop to others.
    let shared: f64 = own(&four).iter().sum();
    assert!((0.3..1.0).contains(&shared), "{:?}", own(&four));
    assert!(four.levels(&[2])[0].position < level.position / 2.0);
}

/// Cameras 2 to 5 know the second half of the walk only through one leg: nothing checks it until the target
/// walks back.
#[test]
fn a_leg_that_alone_ties_two_halves_is_checked_by_walking_back() {
    let mut survey = survey(5, 16);
    survey.looks.clear();
    for stop in 0..16 {
        let cameras = if stop < 6 { 0..2 } else { 2..6 };
        survey.looks.extend(cameras.map(|camera| Look {
            stop,
            camera,
            sigma: SIGMA,
        }));
    }
    let first = survey.stops[2];
    let known = survey.redundancy().unwrap();
    let by = Measurement::Leg { stop: 6 };
    for level in known.levels(&[2, 3, 4, 5]) {
        assert_eq!(level.by, Some(by), "{level:?}");
        assert!(level.position > 1.0, "{level:?}");
    }
    let share = |known: &Redundancy| {
        let shares = known.shares();
        shares.iter().find(|(of, _)| *of == by).unwrap().1
    };
    assert!(share(&known) < 0.01, "{}", share(&known));
    let closed = known.with_stop(first, &[(0, SIGMA), (1, SIGMA)]);
    assert!(share(&closed) > 0.1, "{}", share(&closed));
    let levels = [&known, &closed].map(|walk| walk.levels(&[2, 3, 4, 5]));
    for (before, after) in levels[0].iter().zip(&levels[1]) {
        assert!(
            after.position < before.position / 3.0,
            "{before:?} {after:?}"
        );
    }
}

/// A range is one more row of the information, whose derivatives are differences of distances.
#[test]
fn a_range_is_one_more_measurement() {
    const STEP: f64 = 1e-6;
    const STOPS: usize = 9;
    /// Unknowns of four cameras and these stops.
    const WIDTH: usize = COMMON + 3 * 4 + 2 * STOPS;
    let survey = survey(3, STOPS);
    let known = survey.clone().redundancy().unwrap();
    assert_eq!(known.covariance.width(), WIDTH);
    let covariance = SMatrix::<f64, WIDTH, WIDTH>::from_fn(|i, j| known.covariance[(i, j)]);
    let information = covariance.try_inverse().unwrap();
    for ([stop, camera], sigma) in [
        ([8, 0], 0.01),
        ([5, 1], 0.3),
        ([6, 3], 0.02),
        ([2, 4], 0.05),
    ] {
        let distance = |unknown: usize, by: f64| {
            let mut moved = survey.clone();
            let place = moved.stop_column(stop);
            let column = (camera >= 2).then(|| Survey::camera_column(camera));
            for axis in 0..2 {
                if unknown == place + axis {
                    moved.stops[stop][axis] += by;
                }
                if Some(unknown) == column.map(|column| column + axis) {
                    moved.cameras[camera].position[axis] += by;
                }
            }
            (moved.stops[stop] - moved.cameras[camera].position).norm()
        };
        let row = SVector::<f64, WIDTH>::from_fn(|unknown, _| {
            (distance(unknown, STEP) - distance(unknown, -STEP)) / (2.0 * STEP * sigma)
        });
        let after = (information + row * row.transpose()).try_inverse().unwrap();
        for of in 2..6 {
            let column = Survey::camera_column(of);
            let right = (after[(column, column)] + after[(column + 1, column + 1)]).sqrt();
            let told = known.sigma_with_range(of, [stop, camera], sigma).unwrap();
            assert!(
                (told - right).abs() < 1e-5 * right,
                "camera {of}: {told} {right}"
            );
            assert!(told < known.sigma(of).unwrap());
        }
    }
    assert_eq!(known.sigma_with_range(1, [0, 0], 0.1), None);
    assert_eq!(known.sigma_with_range(2, [9, 0], 0.1), None);
}
