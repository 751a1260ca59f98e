//! The covariance of a dead-reckoned target, against walks that are really taken.

use std::f64::consts::TAU;

use calib_core::{
    Pose, Ray, Refusal, Sighting,
    angle::wrap_signed,
    dead_reckoning::{Step, Systematic, Track, TrackError, correlate},
};
use nalgebra::{Matrix2, Matrix3, Matrix4, Point2, Vector2, Vector3, Vector4};
use proptest::prelude::*;
use rand::RngExt;
use test_support::{Random, generator, normal};

fn unit(angle: f64) -> Vector2<f64> {
    Vector2::new(angle.cos(), angle.sin())
}

/// Errors far smaller than a person's: what is tested is first order.
fn step(distance: f64, heading: f64) -> Step<f64> {
    Step {
        distance,
        heading,
        distance_sigma: 0.001 * distance,
        heading_sigma: 0.002,
    }
}

/// A target whose sensor errs: the track follows what is measured, `truth` what is walked.
struct Walk {
    track: Track<f64>,
    truth: Point2<f64>,
    bias: f64,
    scale: f64,
}

impl Walk {
    fn start(rng: &mut Random, systematic: Systematic<f64>) -> Self {
        let (bias, scale) = (
            systematic.heading_sigma * normal(rng),
            systematic.scale_sigma * normal(rng),
        );
        let truth = Point2::new(3.0, -1.0);
        let track = Track::start(truth, Matrix2::zeros(), systematic).unwrap();
        let mut walk = Self {
            track,
            truth,
            bias,
            scale,
        };
        walk.fix(rng, 0.0, 0.0);
        walk
    }

    /// The references see the target, to within these sigmas in x and y.
    fn fix(&mut self, rng: &mut Random, x: f64, y: f64) {
        let seen = self.truth + Vector2::new(x * normal(rng), y * normal(rng));
        let covariance = Matrix2::new(x * x, 0.0, 0.0, y * y);
        self.track.relocate(seen, covariance).unwrap();
    }

    fn take(&mut self, rng: &mut Random, meant: Step<f64>) {
        self.truth += unit(meant.heading) * meant.distance;
        let measured = Step {
            distance: meant.distance * (1.0 + self.scale) + meant.distance_sigma * normal(rng),
            heading: meant.heading + self.bias + meant.heading_sigma * normal(rng),
            ..meant
        };
        self.track.advance(&measured).unwrap();
    }

    /// In a straight line, in steps of about 0.7.
    fn go(&mut self, rng: &mut Random, to: Point2<f64>) {
        let way = to - self.truth;
        let count = (way.norm() / 0.7).ceil().max(1.0);
        for _ in 0..count as u32 {
            self.take(rng, step(way.norm() / count, way.y.atan2(way.x)));
        }
    }

    fn error(&self) -> Vector2<f64> {
        self.track.position() - self.truth
    }
}

const SYSTEMATIC: Systematic<f64> = Systematic {
    heading_sigma: 0.001,
    scale_sigma: 0.0015,
};

#[test]
fn a_square_leads_back_to_its_start() {
    let start = Point2::new(2.0, 5.0);
    let fix = Matrix2::new(0.04, 0.01, 0.01, 0.09);
    let mut track = Track::start(start, fix, SYSTEMATIC).unwrap();
    let first = track;
    for side in 0..4 {
        for _ in 0..10 {
            let heading = f64::from(side) * TAU / 4.0 + 0.3;
            track.advance(&step(0.7, heading)).unwrap();
        }
    }
    assert!((track.position() - start).norm() < 1e-12);
    assert!(track.since(&first).vector.norm() < 1e-12);
    // Bias and scale cancel on a closed path. Each axis saw 20 steps along and 20 across.
    let along = 0.7 * 0.001_f64;
    let across = 0.7 * 0.002_f64;
    let walked = 20.0 * (along * along + across * across);
    let expected = fix + Matrix2::from_diagonal_element(walked);
    assert!((track.covariance() - expected).norm() < 1e-12);
}

#[test]
fn bias_and_scale_grow_with_the_way_from_the_fix() {
    let exact = |distance| Step {
        distance,
        heading: 0.0,
        distance_sigma: 0.0,
        heading_sigma: 0.0,
    };
    let mut track = Track::start(Point2::origin(), Matrix2::zeros(), SYSTEMATIC).unwrap();
    for _ in 0..100 {
        track.advance(&exact(0.5)).unwrap();
    }
    let c = track.covariance();
    assert!((c.m11.sqrt() - 50.0 * 0.0015).abs() < 1e-12);
    assert!((c.m22.sqrt() - 50.0 * 0.001).abs() < 1e-12);
    // A new fix takes it all away, but not from the way between stops.
    let before = track;
    track
        .relocate(Point2::new(49.0, 0.1), Matrix2::identity())
        .unwrap();
    assert_eq!(track.covariance(), Matrix2::identity());
    track.advance(&exact(10.0)).unwrap();
    assert!((track.position().x - 59.0).abs() < 1e-12);
    let leg = track.since(&before);
    assert!((leg.vector.x - 10.0).abs() < 1e-12);
    assert!((leg.covariance.m11.sqrt() - 0.015).abs() < 1e-12);
}

/// Positions at two stops, before and after a second fix: the joint covariance of their errors.
#[test]
fn errors_are_as_large_and_as_correlated_as_predicted() {
    for second_fix in [false, true] {
        let mut rng = generator(1);
        let runs = 10_000;
        let mut sample = Matrix4::zeros();
        let mut predicted = Matrix4::zeros();
        let mut leg_nees = 0.0;
        for _ in 0..runs {
            let mut walk = Walk::start(&mut rng, SYSTEMATIC);
            walk.fix(&mut rng, 0.005, 0.008);
            walk.go(&mut rng, Point2::new(9.0, 2.0));
            let (first, error_1, truth_1) = (walk.track, walk.error(), walk.truth);
            if second_fix {
                walk.fix(&mut rng, 0.003, 0.002);
            }
            walk.go(&mut rng, Point2::new(5.0, 7.0));
            let (last, error_2) = (walk.track, walk.error());

            let both = Vector4::new(error_1.x, error_1.y, error_2.x, error_2.y);
            sample += both * both.transpose();
            let leg = last.since(&first);
            let off = leg.vector - (walk.truth - truth_1);
            leg_nees += off.dot(&leg.covariance.cholesky().unwrap().solve(&off));
            for (row, a) in [first, last].iter().enumerate() {
                for (column, b) in [first, last].iter().enumerate() {
                    let mut block = predicted.fixed_view_mut::<2, 2>(2 * row, 2 * column);
                    block += a.covariance_with(b);
                }
            }
        }
        let n = f64::from(runs);
        (sample, predicted) = (sample / n, predicted / n);
        for i in 0..4 {
            for j in 0..4 {
                // Standard error of a sample covariance of Gaussians, and a little second order.
                let scale = predicted[(i, i)] * predicted[(j, j)];
                let se = ((scale + predicted[(i, j)].powi(2)) / n).sqrt();
                let off = (sample[(i, j)] - predicted[(i, j)]).abs();
                assert!(
                    off < 4.0 * se + 0.005 * scale.sqrt(),
                    "{i}, {j}: {off} {se}"
                );
            }
        }
        // Chi squared of two degrees of freedom: mean 2, variance 4.
        leg_nees /= n;
        assert!(
            (leg_nees - 2.0).abs() < 4.0 * 2.0 / n.sqrt() + 0.01,
            "{leg_nees}"
        );
    }
}

/// A camera at the origin, looking along x, and its pose from sightings by Gauss-Newton with
/// difference quotients, started at the truth. Knows nothing of the library but its types. `None`
/// near the danger circle, where nothing is linear.
fn resect(seen: &[(Sighting<f64>, Track<f64>)]) -> Option<Pose<f64>> {
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
        if iteration == 0 && normal_matrix.try_inverse()?.trace() > 5e-5 {
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

/// Mean normalised errors of poses from `stops` stops: with the simple split, and correlated.
fn resection_nees(stops: usize, systematic: Systematic<f64>) -> (f64, f64) {
    let mut rng = generator(stops as u64);
    let runs = 600;
    let (mut split_sum, mut correlated_sum, mut count) = (0.0, 0.0, 0);
    while count < runs {
        let mut walk = Walk::start(&mut rng, systematic);
        walk.fix(&mut rng, 0.0004, 0.0006);
        let sigma = 0.00005;
        let mut seen: Vec<(Sighting<f64>, Track<f64>)> = Vec::new();
        for _ in 0..stops {
            let place = unit(rng.random_range(-0.5..0.5)) * rng.random_range(2.0..8.0);
            walk.go(&mut rng, Point2::from(place));
            let bearing = walk.truth.y.atan2(walk.truth.x) + sigma * normal(&mut rng);
            let first = seen.first().map_or(walk.track, |(_, track)| *track);
            let sighting = Sighting {
                target_covariance: walk.track.since(&first).covariance,
                ..Sighting::new(walk.track.position(), Ray::from_bearing(bearing), sigma)
            };
            seen.push((sighting, walk.track));
        }
        let Some(pose) = resect(&seen) else { continue };
        count += 1;
        let split = pose.with_shared_target_error(&seen[0].1.covariance());
        let correlated = correlate(&pose, &seen).unwrap();
        split_sum += split.normalised_error(Point2::origin(), 0.0).unwrap();
        correlated_sum += correlated.normalised_error(Point2::origin(), 0.0).unwrap();
    }
    (
        split_sum / f64::from(runs),
        correlated_sum / f64::from(runs),
    )
}

/// The table of the module's documentation. Standard error of a fair mean NEES here: 0.1.
#[test]
fn poses_from_dead_reckoned_stops_are_as_sure_as_they_say() {
    for (stops, random, with_systematic) in [(3, 3.0, 3.2), (4, 3.2, 3.7), (10, 5.0, 5.8)] {
        for (systematic, expected) in [(Systematic::none(), random), (SYSTEMATIC, with_systematic)]
        {
            let (split, correlated) = resection_nees(stops, systematic);
            println!("{stops} stops: split {split:.2}, correlated {correlated:.2}");
            assert!((correlated - 3.0).abs() < 0.4, "{stops}: {correlated}");
            assert!(
                (split - expected).abs() < 0.15 * expected,
                "{stops}: {split}"
            );
        }
    }
}

#[test]
fn correlation_refuses_what_determines_no_pose() {
    let track = Track::start(Point2::origin(), Matrix2::zeros(), SYSTEMATIC).unwrap();
    let pose = Pose {
        position: Point2::new(1.0, 0.0),
        heading: 0.0,
        covariance: Matrix3::identity(),
    };
    let sight = |x: f64, y: f64| {
        (
            Sighting::new(Point2::new(x, y), Ray::from_bearing(0.0), 0.01),
            track,
        )
    };
    let good = [sight(4.0, 1.0), sight(5.0, -1.0), sight(3.0, 0.0)];
    assert!(correlate(&pose, &good).is_ok());
    assert_eq!(correlate(&pose, &good[..2]), Err(Refusal::TooFew));
    let on_one_line = [sight(4.0, 0.0), sight(5.0, 0.0), sight(3.0, 0.0)];
    assert_eq!(correlate(&pose, &on_one_line), Err(Refusal::Undetermined));
    let broken = [good[0], good[1], sight(f64::NAN, 0.0)];
    assert_eq!(correlate(&pose, &broken), Err(Refusal::NotFinite));
    let on_the_camera = [good[0], good[1], sight(1.0, 0.0)];
    assert_eq!(correlate(&pose, &on_the_camera), Err(Refusal::NotFinite));
}

#[test]
fn what_is_no_step_or_fix_changes_nothing() {
    let mut track = Track::start(Point2::origin(), Matrix2::identity(), SYSTEMATIC).unwrap();
    let before = track;
    let good = step(0.7, 1.0);
    for (bad, error) in [
        (
            Step {
                distance: f64::NAN,
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            Step {
                heading: f64::INFINITY,
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            Step {
                heading_sigma: f64::NAN,
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            Step {
                distance: 1e200,
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            Step {
                distance: -0.1,
                ..good
            },
            TrackError::Negative,
        ),
        (
            Step {
                distance_sigma: -0.1,
                ..good
            },
            TrackError::Negative,
        ),
        (
            Step {
                heading_sigma: -0.1,
                ..good
            },
            TrackError::Negative,
        ),
    ] {
        assert_eq!(track.advance(&bad), Err(error), "{bad:?}");
    }
    let place = Point2::new(1.0, 2.0);
    for (bad, error) in [
        (Matrix2::new(1.0, f64::NAN, 0.0, 1.0), TrackError::NotFinite),
        (
            Matrix2::new(-1.0, 0.0, 0.0, 1.0),
            TrackError::NotACovariance,
        ),
        (Matrix2::new(1.0, 2.0, 2.0, 1.0), TrackError::NotACovariance),
        (
            Matrix2::new(1.0, 0.5, -0.5, 1.0),
            TrackError::NotACovariance,
        ),
    ] {
        assert_eq!(track.relocate(place, bad), Err(error), "{bad}");
    }
    let nowhere = Point2::new(f64::NAN, 0.0);
    assert_eq!(
        track.relocate(nowhere, Matrix2::zeros()),
        Err(TrackError::NotFinite)
    );
    assert_eq!(track, before);
    let negative = Systematic {
        heading_sigma: -0.1,
        scale_sigma: 0.0,
    };
    assert_eq!(
        Track::start(place, Matrix2::zeros(), negative),
        Err(TrackError::Negative)
    );
}

fn any_step() -> impl Strategy<Value = Step<f64>> {
    (0.0..2.0_f64, -10.0..10.0_f64, 0.0..0.2_f64, 0.0..0.5_f64).prop_map(
        |(distance, heading, distance_sigma, heading_sigma)| Step {
            distance,
            heading,
            distance_sigma,
            heading_sigma,
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever is fed, the covariance stays one, and refused input changes nothing.
    #[test]
    fn no_input_breaks_a_track(numbers in prop::collection::vec(any::<[f32; 4]>(), 0..40)) {
        let mut track = Track::start(
            Point2::new(1.0_f32, 2.0), Matrix2::identity(), Systematic::default()).unwrap();
        for [distance, heading, distance_sigma, heading_sigma] in numbers {
            let before = track;
            let step = Step { distance, heading, distance_sigma, heading_sigma };
            if track.advance(&step).is_err() {
                prop_assert_eq!(track, before);
            }
            let c = track.covariance();
            prop_assert!(c.iter().all(|x| x.is_finite()) && c.m11 >= 0.0 && c.m22 >= 0.0);
            prop_assert!(track.position().coords.iter().all(|x| x.is_finite()));
        }
    }

    /// Own parts and shared part are covariances, whatever the walk, and so is what joins two.
    #[test]
    fn every_covariance_is_one(steps in prop::collection::vec(any_step(), 2..40), cut in 0_usize..40) {
        let mut track = Track::start(
            Point2::origin(), Matrix2::identity() * 0.01, Systematic::default()).unwrap();
        let mut first = track;
        for (i, step) in steps.iter().enumerate() {
            track.advance(step).unwrap();
            if i == cut % steps.len() {
                first = track;
            }
        }
        let (a, b) = (first.covariance(), track.covariance());
        let ab = first.covariance_with(&track);
        prop_assert_eq!(ab.transpose(), track.covariance_with(&first));
        let joint = Matrix4::new(
            a.m11, a.m12, ab.m11, ab.m12,
            a.m21, a.m22, ab.m21, ab.m22,
            ab.m11, ab.m21, b.m11, b.m12,
            ab.m12, ab.m22, b.m21, b.m22,
        );
        prop_assert!(joint.symmetric_eigenvalues().min() > -1e-12);
        let leg = track.since(&first).covariance;
        prop_assert!(leg.symmetric_eigenvalues().min() > -1e-12);
        // Var(b - a) = Var(b) + Var(a) - Cov - Cov^T, without the fix, which cancels.
        let expected = b + a - ab - ab.transpose();
        prop_assert!((leg - expected).norm() < 1e-12 * (1.0 + b.norm()));
    }

    #[test]
    fn single_precision_is_enough(steps in prop::collection::vec(any_step(), 1..200)) {
        let mut wide = Track::start(Point2::origin(), Matrix2::zeros(), Systematic::default()).unwrap();
        let mut narrow = Track::start(Point2::origin(), Matrix2::zeros(), Systematic::default()).unwrap();
        for s in &steps {
            wide.advance(s).unwrap();
            narrow.advance(&Step {
                distance: s.distance as f32,
                heading: s.heading as f32,
                distance_sigma: s.distance_sigma as f32,
                heading_sigma: s.heading_sigma as f32,
            }).unwrap();
        }
        prop_assert!((narrow.position().cast::<f64>() - wide.position()).norm() < 1e-3);
        let c = wide.covariance();
        prop_assert!((narrow.covariance().cast::<f64>() - c).norm() < 1e-4 * (1.0 + c.norm()));
    }
}
