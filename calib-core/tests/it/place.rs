//! Places of stops as they are sent, and the poses that come from them.

use std::ops::AddAssign;

use calib_core::{
    Pose, Ray, Refusal, Sighting,
    angle::wrap_signed,
    dead_reckoning::{Place, PlaceParts, Step, Systematic, Track, TrackError, correlate},
    resection,
};
use nalgebra::{Matrix2, Matrix3, Matrix4, Point2, Vector2, Vector3, Vector4};
use proptest::prelude::*;
use rand::RngExt;
use test_support::{generator, normal};

use crate::walk;
use walk::{SYSTEMATIC, Walk, unit};

/// All stops of these tests are of one walk.
fn one_walk(_: usize, _: usize) -> bool {
    true
}

/// A camera at the origin, looking along x, and its pose from sightings by Gauss-Newton with
/// difference quotients, started at the truth. Knows nothing of the library but its types. `None`
/// near the danger circle, where nothing is linear: where the sum of the variances is above `widest`.
fn resect(seen: &[(Sighting<f64>, Place<f64>)], widest: f64) -> Option<Pose<f64>> {
    let predict =
        |x: &Vector3<f64>, target: &Point2<f64>| (target.y - x.y).atan2(target.x - x.x) - x.z;
    let mut x = Vector3::zeros();
    let mut normal_matrix = Matrix3::zeros();
    for iteration in 0..8 {
        normal_matrix = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for (sighting, _) in seen {
            let to = sighting.target - Point2::new(x.x, x.y);
            let across = Vector2::new(-to.y, to.x) / to.norm_squared();
            let variance =
                sighting.bearing_sigma.powi(2) + across.dot(&(sighting.target_covariance * across));
            let residual = wrap_signed(sighting.ray.bearing() - predict(&x, &sighting.target));
            let slope = Vector3::from_fn(|k, _| {
                let mut h = Vector3::zeros();
                h[k] = 1e-6;
                (predict(&(x + h), &sighting.target) - predict(&(x - h), &sighting.target)) / 2e-6
            });
            normal_matrix += slope * slope.transpose() / variance;
            right += slope * residual / variance;
        }
        if iteration == 0 && normal_matrix.try_inverse()?.trace() > widest {
            return None;
        }
        x += normal_matrix.cholesky()?.solve(&right);
    }
    Some(Pose {
        position: Point2::new(x.x, x.y),
        heading: x.z,
        covariance: normal_matrix.try_inverse()?,
    })
}

/// Mean normalised errors of poses from dead-reckoned stops. 3 when fair.
struct Nees {
    /// With the simple split into own and shared parts.
    split: f64,
    /// Correlated.
    correlated: f64,
    /// Correlated, from places that deny that the carrier stands beside them.
    denied: f64,
}

const RUNS: u32 = 600;

fn resection_nees(stops: usize, systematic: Systematic<f64>, standing: f64) -> Nees {
    let mut rng = generator(stops as u64);
    let mut sum = [0.0; 3];
    let mut count = 0;
    while count < RUNS {
        let mut walk = Walk::start(&mut rng, systematic);
        walk.fix(&mut rng, 0.0004, 0.0006);
        let sigma = 0.00005;
        let mut seen: Vec<(Sighting<f64>, Place<f64>)> = Vec::new();
        for _ in 0..stops {
            let goal = unit(rng.random_range(-0.5..0.5)) * rng.random_range(2.0..8.0);
            walk.go(&mut rng, Point2::from(goal));
            let mut stands = walk.truth;
            if standing > 0.0 {
                stands += Vector2::new(normal(&mut rng), normal(&mut rng)) * standing;
            }
            let bearing = stands.y.atan2(stands.x) + sigma * normal(&mut rng);
            let place = walk.track.place(standing).unwrap();
            let first = seen.first().map_or(place, |(_, place)| *place);
            let sighting = Sighting {
                target_covariance: place.own_covariance(&first),
                ..Sighting::new(place.position(), Ray::from_bearing(bearing), sigma)
            };
            seen.push((sighting, place));
        }
        // Standing spreads every answer; only the neighbourhood of the circle is left out.
        let widest = 5e-5 + 30.0 * standing * standing;
        let Some(pose) = resect(&seen, widest) else {
            continue;
        };
        count += 1;
        let first = seen[0].1;
        let denied: Vec<_> = seen
            .iter()
            .map(|&(s, p)| (s, with_standing(&p, 0.0)))
            .collect();
        let answers = [
            with_shared_error(pose, &first.covariance_with(&first)),
            correlate(&pose, &seen, one_walk).unwrap(),
            correlate(&pose, &denied, one_walk).unwrap(),
        ];
        for (sum, pose) in sum.iter_mut().zip(answers) {
            *sum += pose.normalised_error(Point2::origin(), 0.0).unwrap();
        }
    }
    let [split, correlated, denied] = sum.map(|sum| sum / f64::from(RUNS));
    Nees {
        split,
        correlated,
        denied,
    }
}

/// The pose as if all stops erred by one and the same displacement of this covariance.
fn with_shared_error(mut pose: Pose<f64>, covariance: &Matrix2<f64>) -> Pose<f64> {
    let mut of_place = pose.covariance.fixed_view_mut::<2, 2>(0, 0);
    of_place += covariance;
    pose
}

fn with_standing(place: &Place<f64>, standing_sigma: f64) -> Place<f64> {
    Place::new(PlaceParts {
        standing_sigma,
        ..*place.parts()
    })
    .unwrap()
}

/// The table of the module's documentation. Standard error of a fair mean NEES here: 0.1.
#[test]
fn poses_from_dead_reckoned_stops_are_as_sure_as_they_say() {
    for (stops, random, with_systematic) in [(3, 3.0, 3.2), (4, 3.2, 3.7), (10, 5.0, 5.8)] {
        for (systematic, expected) in [(Systematic::none(), random), (SYSTEMATIC, with_systematic)]
        {
            let Nees {
                split, correlated, ..
            } = resection_nees(stops, systematic, 0.0);
            println!("{stops} stops: split {split:.2}, correlated {correlated:.2}");
            assert!((correlated - 3.0).abs() < 0.4, "{stops}: {correlated}");
            assert!(
                (split - expected).abs() < 0.15 * expected,
                "{stops}: {split}"
            );
        }
    }
}

/// A carrier who stands beside the place by about as much as his steps err.
#[test]
fn standing_beside_the_place_counts_once_for_each_stop() {
    for stops in [4, 10] {
        let Nees {
            correlated, denied, ..
        } = resection_nees(stops, SYSTEMATIC, 0.003);
        println!("{stops} stops: correlated {correlated:.2}, denied {denied:.2}");
        assert!((correlated - 3.0).abs() < 0.4, "{stops}: {correlated}");
        assert!(denied > 4.0, "{stops}: {denied}");
    }
}

/// Where the carrier really is, against the places of two stops after one fix.
#[test]
fn a_place_errs_as_it_says_alone_and_with_another() {
    let standing = 0.006;
    let runs = 10_000;
    let mut rng = generator(2);
    let (mut sample, mut predicted, mut own_nees) = (Matrix4::zeros(), Matrix4::zeros(), 0.0);
    for _ in 0..runs {
        let mut walk = Walk::start(&mut rng, SYSTEMATIC);
        walk.fix(&mut rng, 0.005, 0.008);
        let mut stop = |x: f64, y: f64| {
            walk.go(&mut rng, Point2::new(x, y));
            let beside = Vector2::new(normal(&mut rng), normal(&mut rng)) * standing;
            (walk.track.place(standing).unwrap(), walk.error() - beside)
        };
        let (first, error_1) = stop(9.0, 2.0);
        let (last, error_2) = stop(5.0, 7.0);
        let both = Vector4::new(error_1.x, error_1.y, error_2.x, error_2.y);
        sample += both * both.transpose();
        predicted
            .fixed_view_mut::<2, 2>(0, 0)
            .add_assign(first.covariance());
        predicted
            .fixed_view_mut::<2, 2>(2, 2)
            .add_assign(last.covariance());
        let joint = first.covariance_with(&last);
        predicted.fixed_view_mut::<2, 2>(0, 2).add_assign(joint);
        predicted
            .fixed_view_mut::<2, 2>(2, 0)
            .add_assign(joint.transpose());
        // The way between two stops has both ends' standing in it, and nothing that they share.
        let way = error_2 - error_1;
        let spread = last.own_covariance(&first) + first.own_covariance(&first);
        own_nees += way.dot(&spread.cholesky().unwrap().solve(&way));
    }
    let n = f64::from(runs);
    (sample, predicted, own_nees) = (sample / n, predicted / n, own_nees / n);
    for i in 0..4 {
        for j in 0..4 {
            let scale = predicted[(i, i)] * predicted[(j, j)];
            let se = ((scale + predicted[(i, j)].powi(2)) / n).sqrt();
            let off = (sample[(i, j)] - predicted[(i, j)]).abs();
            assert!(
                off < 4.0 * se + 0.005 * scale.sqrt(),
                "{i}, {j}: {off} {se}"
            );
        }
    }
    assert!(
        (own_nees - 2.0).abs() < 4.0 * 2.0 / n.sqrt() + 0.01,
        "{own_nees}"
    );
}

#[test]
fn fixes_and_targets_are_told_apart_by_number() {
    let mut track =
        Track::start(Point2::origin(), Matrix2::identity(), Systematic::none()).unwrap();
    let first = track.place(0.5).unwrap();
    assert_eq!(first.covariance(), Matrix2::identity() * 1.25);
    assert_eq!(first.covariance_with(&first), Matrix2::identity());
    assert_eq!(first.own_covariance(&first), Matrix2::identity() * 0.25);
    track
        .relocate(Point2::origin(), Matrix2::identity(), Systematic::none())
        .unwrap();
    let second = track.place(0.0).unwrap();
    assert_ne!(first.parts().fix, second.parts().fix);
    assert_eq!(first.covariance_with(&second), Matrix2::zeros());
    assert_eq!(first.own_covariance(&second), first.covariance());
}

/// A walk begun anew may number its fixes as another one did. No walk makes both of these places:
/// its uncertainty never falls.
#[test]
fn places_that_cannot_be_of_one_walk_share_nothing() {
    let place = |step_covariance| {
        Place::new(PlaceParts {
            step_covariance,
            ..good_parts()
        })
        .unwrap()
    };
    for (a, b) in [
        ([0.1, 0.0, 0.5], [1.0, 0.0, 0.01]),
        ([0.1, 0.0, 0.1], [0.2, 0.19, 0.2]),
    ] {
        let (a, b) = (place(a), place(b));
        assert_eq!(a.own_covariance(&b), a.covariance());
        assert_eq!(b.own_covariance(&a), b.covariance());
    }
}

#[test]
fn correlation_refuses_what_determines_no_pose() {
    let track = Track::start(Point2::origin(), Matrix2::zeros(), SYSTEMATIC).unwrap();
    let place = track.place(0.01).unwrap();
    let pose = Pose {
        position: Point2::new(1.0, 0.0),
        heading: 0.0,
        covariance: Matrix3::identity(),
    };
    let sight = |x: f64, y: f64| {
        (
            Sighting::new(Point2::new(x, y), Ray::from_bearing(0.0), 0.01),
            place,
        )
    };
    let good = [sight(4.0, 1.0), sight(5.0, -1.0), sight(3.0, 0.0)];
    assert!(correlate(&pose, &good, one_walk).is_ok());
    assert_eq!(correlate(&pose, &good[..2], one_walk), Err(Refusal::TooFew));
    let on_one_line = [sight(4.0, 0.0), sight(5.0, 0.0), sight(3.0, 0.0)];
    assert_eq!(
        correlate(&pose, &on_one_line, one_walk),
        Err(Refusal::Undetermined)
    );
    let broken = [good[0], good[1], sight(f64::NAN, 0.0)];
    assert_eq!(correlate(&pose, &broken, one_walk), Err(Refusal::NotFinite));
    let on_the_camera = [good[0], good[1], sight(1.0, 0.0)];
    assert_eq!(
        correlate(&pose, &on_the_camera, one_walk),
        Err(Refusal::NotFinite)
    );
    // The places are numbers; times the bearings' weights they are not.
    let wide = Track::start(
        Point2::origin(),
        Matrix2::from_diagonal_element(1e306),
        Systematic::none(),
    );
    let wide = wide.and_then(|track| track.place(0.0)).unwrap();
    assert_eq!(
        correlate(&pose, &good.map(|(seen, _)| (seen, wide)), one_walk),
        Err(Refusal::NotFinite)
    );
    // One fix, of which one place says that it was poor and the others that it was exact.
    let claim = |fix: f64, step: f64| {
        Place::new(PlaceParts {
            fix_covariance: [fix, 0.0, fix],
            step_covariance: [step, 0.0, step],
            ..*place.parts()
        })
        .unwrap()
    };
    let poor = (good[0].0, claim(100.0, 0.0));
    let exact = |i: usize| (good[i].0, claim(0.0, 1e-6));
    let contradicting = [poor, exact(1), exact(2)];
    assert_eq!(
        correlate(&pose, &contradicting, one_walk),
        Err(Refusal::Inconsistent)
    );
}

/// Places of one walk in the middle of which the sensor was calibrated: the same errors, of other sizes.
fn places_of_two_calibrations() -> [Place<f64>; 5] {
    let poor = Systematic {
        heading_sigma: 0.02,
        scale_sigma: 0.05,
    };
    let good = Systematic {
        heading_sigma: 0.005,
        scale_sigma: 0.01,
    };
    [
        ([3.0, 1.0], poor, [1e-6, 2e-7, 2e-6]),
        ([4.0, -1.5], poor, [2e-6, 2e-7, 3e-6]),
        ([2.0, 0.5], good, [3e-6, 1e-7, 5e-6]),
        ([6.0, 2.0], poor, [5e-6, 3e-7, 6e-6]),
        ([5.0, 0.0], good, [6e-6, 3e-7, 8e-6]),
    ]
    .map(|(walked, systematic, step_covariance)| {
        Place::new(PlaceParts {
            position: Point2::from(walked),
            fix: 7,
            fix_covariance: [4e-6, 1e-6, 9e-6],
            step_covariance,
            walked: Vector2::from(walked),
            systematic,
            standing_sigma: 0.001,
        })
        .unwrap()
    })
}

/// `E[e_i e_j^T]` of two of them, written out from the model of the errors.
fn joint_covariance(places: &[Place<f64>], i: usize, j: usize) -> Matrix2<f64> {
    let (a, b) = (places[i].parts(), places[j].parts());
    let quarter = |v: Vector2<f64>| Vector2::new(-v.y, v.x);
    // In the order of the walk.
    let [xx, xy, yy] = places[i.min(j)].parts().step_covariance;
    let [fxx, fxy, fyy] = a.fix_covariance;
    let (s, t) = (a.systematic, b.systematic);
    let mut joint = Matrix2::new(xx + fxx, xy + fxy, xy + fxy, yy + fyy)
        + quarter(a.walked) * quarter(b.walked).transpose() * s.heading_sigma * t.heading_sigma
        + a.walked * b.walked.transpose() * s.scale_sigma * t.scale_sigma;
    if i == j {
        joint += Matrix2::from_diagonal_element(a.standing_sigma * b.standing_sigma);
    }
    joint
}

/// Every stop's place moves the pose. The movement is found by moving the place and solving again.
#[test]
fn the_pose_errs_as_all_stops_do_also_of_two_calibrations() {
    let places = places_of_two_calibrations();
    for i in 0..5 {
        for j in 0..5 {
            let covariance = if i == j {
                places[i].covariance()
            } else {
                places[i].covariance_with(&places[j])
            };
            let off = covariance - joint_covariance(&places, i, j);
            assert!(off.norm() < 1e-15, "{i}, {j}: {off}");
        }
    }
    let sigma = 0.0007;
    let seen = places.map(|place| {
        let target = place.position();
        let sighting = Sighting {
            target_covariance: place.own_covariance(&places[0]),
            ..Sighting::new(target, Ray::from_bearing(target.y.atan2(target.x)), sigma)
        };
        (sighting, place)
    });
    let sightings = seen.map(|(sighting, _)| sighting);
    let solve = |sightings: &[Sighting<f64>; 5]| {
        let pose = resection::solve(sightings).unwrap().pose;
        Vector3::new(pose.position.x, pose.position.y, wrap_signed(pose.heading))
    };
    let slope = |change: &dyn Fn(&mut [Sighting<f64>; 5], f64)| {
        let at = |h: f64| {
            let mut moved = sightings;
            change(&mut moved, h);
            solve(&moved)
        };
        (at(1e-5) - at(-1e-5)) / 2e-5
    };
    let by_place = [0, 1, 2, 3, 4]
        .map(|i| [0, 1].map(|axis| slope(&|s: &mut [Sighting<f64>; 5], h| s[i].target[axis] += h)));
    let mut expected = Matrix3::zeros();
    for i in 0..5 {
        let by_bearing = slope(&|s: &mut [Sighting<f64>; 5], h| {
            s[i].ray = Ray::from_bearing(s[i].ray.bearing() + h);
        });
        expected += by_bearing * by_bearing.transpose() * (sigma * sigma);
        for j in 0..5 {
            let joint = joint_covariance(&places, i, j);
            for (a, row) in by_place[i].iter().enumerate() {
                for (b, column) in by_place[j].iter().enumerate() {
                    expected += row * column.transpose() * joint[(a, b)];
                }
            }
        }
    }
    let pose = resection::solve(&sightings).unwrap().pose;
    let correlated = correlate(&pose, &seen, one_walk).unwrap().covariance;
    for i in 0..3 {
        for j in 0..3 {
            let off = correlated[(i, j)] - expected[(i, j)];
            let scale = (expected[(i, i)] * expected[(j, j)]).sqrt();
            assert!(off.abs() < 1e-4 * scale, "{i}, {j}: {off:e} of {scale:e}");
        }
    }
}

fn good_parts() -> PlaceParts<f64> {
    PlaceParts {
        position: Point2::new(3.0, -2.0),
        fix: 3,
        fix_covariance: [0.04, 0.01, 0.09],
        step_covariance: [0.02, -0.01, 0.02],
        walked: Vector2::new(1.0, 5.0),
        systematic: SYSTEMATIC,
        standing_sigma: 0.03,
    }
}

#[test]
fn what_is_no_place_is_refused() {
    let good = good_parts();
    assert_eq!(*Place::new(good).unwrap().parts(), good);
    let systematic = |heading_sigma, scale_sigma| Systematic {
        heading_sigma,
        scale_sigma,
    };
    let nan = f64::NAN;
    for (bad, error) in [
        (
            PlaceParts {
                position: Point2::new(nan, 0.0),
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            PlaceParts {
                walked: Vector2::new(0.0, nan),
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            PlaceParts {
                walked: Vector2::new(1e200, 0.0),
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            PlaceParts {
                fix_covariance: [nan, 0.0, 1.0],
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            PlaceParts {
                step_covariance: [1.0, f64::INFINITY, 1.0],
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            PlaceParts {
                systematic: systematic(nan, 0.0),
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            PlaceParts {
                standing_sigma: nan,
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            PlaceParts {
                standing_sigma: 1e200,
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            PlaceParts {
                systematic: systematic(0.0, -0.1),
                ..good
            },
            TrackError::Negative,
        ),
        (
            PlaceParts {
                standing_sigma: -0.1,
                ..good
            },
            TrackError::Negative,
        ),
        (
            PlaceParts {
                fix_covariance: [-1.0, 0.0, 1.0],
                ..good
            },
            TrackError::NotACovariance,
        ),
        (
            PlaceParts {
                step_covariance: [1.0, 1.1, 1.0],
                ..good
            },
            TrackError::NotACovariance,
        ),
        // As narrow as it is, it cannot err with the other axis.
        (
            PlaceParts {
                fix_covariance: [1.0, 1e-3, 1e-8],
                ..good
            },
            TrackError::NotACovariance,
        ),
    ] {
        assert_eq!(Place::new(bad), Err(error), "{bad:?}");
    }
    let track = Track::start(Point2::origin(), Matrix2::zeros(), SYSTEMATIC).unwrap();
    for (sigma, error) in [
        (nan, TrackError::NotFinite),
        (f64::INFINITY, TrackError::NotFinite),
        (-0.1, TrackError::Negative),
    ] {
        assert_eq!(track.place(sigma), Err(error), "{sigma}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// A camera takes every place that a target sends, however long and odd the walk was.
    #[test]
    fn every_place_of_a_track_comes_back(
        numbers in prop::collection::vec(
            prop_oneof![
                any::<[f32; 4]>(),
                (0.0..2.0_f32, -10.0..10.0_f32, 0.0..0.2_f32, 0.0..0.5_f32).prop_map(Into::into),
                // Errors along the way only: a covariance of rank one.
                (0.0..2.0_f32, -10.0..10.0_f32, 0.0..0.2_f32).prop_map(|(d, h, s)| [d, h, s, 0.0]),
            ],
            0..60,
        ),
        fix in 0_usize..60,
    ) {
        let mut track =
            Track::start(Point2::new(1.0_f32, 2.0), Matrix2::zeros(), Systematic::default()).unwrap();
        for (i, &[distance, heading, distance_sigma, heading_sigma]) in numbers.iter().enumerate() {
            if i == fix {
                let covariance = Matrix2::new(0.01, 0.002, 0.002, 0.01);
                track.relocate(track.position(), covariance, Systematic::default()).unwrap();
            }
            let _ = track.advance(&Step { distance, heading, distance_sigma, heading_sigma });
        }
        let place = track.place(0.02).unwrap();
        prop_assert_eq!(Place::new(*place.parts()), Ok(place));
        prop_assert_eq!(place.position(), track.position());
    }

    /// Var(b - a) = Var(b) + Var(a) - Cov - Cov^T, whichever comes first.
    #[test]
    fn own_parts_are_what_a_difference_leaves(
        steps in prop::collection::vec((0.0..2.0_f64, -10.0..10.0_f64, 0.0..0.2_f64, 0.0..0.5_f64), 2..40),
        cut in 0_usize..40,
        standing in 0.0..0.5_f64,
    ) {
        let mut track = Track::start(
            Point2::origin(), Matrix2::identity() * 0.01, Systematic::default()).unwrap();
        let mut a = track.place(0.0).unwrap();
        for (i, &(distance, heading, distance_sigma, heading_sigma)) in steps.iter().enumerate() {
            track.advance(&Step { distance, heading, distance_sigma, heading_sigma }).unwrap();
            if i == cut % steps.len() {
                a = track.place(0.0).unwrap();
            }
        }
        let b = track.place(standing).unwrap();
        let ab = a.covariance_with(&b);
        let expected = a.covariance() + b.covariance() - ab - ab.transpose();
        let size = 1.0 + b.covariance().norm();
        prop_assert!((b.own_covariance(&a) - expected).norm() < 1e-12 * size);
        let standing = Matrix2::identity() * standing * standing;
        prop_assert!((a.own_covariance(&b) + standing - expected).norm() < 1e-12 * size);
    }
}
