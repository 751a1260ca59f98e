//! The reference solve against scenes whose truth is known.

use crate::two_cameras;

use calib_core::{
    Method, Ray, Real, Refusal,
    reference::{self, Known, ReferenceSettings, Stop},
};
use nalgebra::{Matrix2, Matrix3, Point2, Rotation2, Vector2};
use proptest::prelude::*;
use rand::RngExt;
use test_support::{generator, normal, turn};
use two_cameras::{Scene, scene};

impl Scene {
    /// The measurements, with the displacements in a frame turned by `frame_heading`.
    fn measure(
        &self,
        frame_heading: f64,
        bearing_noise: impl FnMut() -> f64,
        bearing_sigma: f64,
        displacement_noise: impl FnMut() -> f64,
        displacement_sigma: f64,
    ) -> Vec<Stop<f64>> {
        let (mut bearing_noise, mut displacement_noise) = (bearing_noise, displacement_noise);
        let back = Rotation2::new(-frame_heading);
        (0..self.stops.len())
            .map(|n| {
                let from = self.stops[n.saturating_sub(1)];
                let noise = Vector2::from_fn(|_, _| displacement_sigma * displacement_noise());
                Stop {
                    rays: [0, 1].map(|k| {
                        let bearing = self.cameras[k].bearing_of(self.stops[n]);
                        Ray::from_bearing(bearing + bearing_sigma * bearing_noise())
                    }),
                    bearing_sigmas: [bearing_sigma.max(1e-4); 2],
                    displacement: back * (self.stops[n] - from) + noise,
                    displacement_covariance: Matrix2::from_diagonal_element(
                        displacement_sigma.powi(2),
                    ),
                }
            })
            .collect()
    }

    fn exact(&self, frame_heading: f64) -> Vec<Stop<f64>> {
        self.measure(frame_heading, || 0.0, 0.0, || 0.0, 0.0)
    }

    fn is_solved_by(&self, solution: &reference::ReferenceSolution<f64>, tolerance: f64) -> bool {
        let headings =
            (0..2).all(|k| turn(solution.headings[k], self.cameras[k].heading).abs() < tolerance);
        let first = (solution.first_stop - self.stops[0]).norm() < tolerance;
        headings && first && (solution.baseline - self.baseline).abs() < tolerance
    }
}

const ALL_KNOWN: fn(f64) -> Known<f64> = |baseline| Known {
    baseline: Some(baseline),
    frame_heading: Some(0.0),
};

/// With two stops the truth is the answer or the alternative, and both explain the data. Only nearly
/// degenerate scenes are refused.
#[test]
fn two_stops() {
    const SCENES: u64 = 400;
    let (mut refused, mut degenerate) = (0, 0);
    for seed in 0..SCENES {
        let scene = scene(seed, 2);
        let stops = scene.exact(0.0);
        let outcome = reference::solve(
            &stops,
            &ALL_KNOWN(scene.baseline),
            &ReferenceSettings::default(),
        );
        let Ok(outcome) = outcome else {
            refused += 1;
            continue;
        };
        if outcome.best.condition >= 1e8 {
            degenerate += 1;
            continue;
        }
        let answers = [Some(outcome.best), outcome.alternative];
        assert!(
            answers
                .iter()
                .flatten()
                .any(|s| scene.is_solved_by(s, 1e-4)),
            "{scene:?} {outcome:?}"
        );
        for s in answers.iter().flatten() {
            assert!(s.chi_squared < 1e-3);
        }
        assert_eq!(outcome.candidates, answers.iter().flatten().count());
    }
    assert!(refused <= SCENES / 100, "{refused} refused");
    assert!(degenerate <= SCENES / 100, "{degenerate} degenerate");
}

/// Two places that are visited again and again tell no more than two stops do: the truth is the answer or the
/// alternative, however much noise speaks for the other one. In one of fifty scenes noise lets circles that hardly meet
/// miss each other, so that a start is far off.
#[test]
fn two_places_visited_again_and_again() {
    const SCENES: u64 = 300;
    let (mut ambiguous, mut lost) = (0_u64, 0_u64);
    for seed in 0..SCENES {
        let mut scene = scene(seed, 2);
        let [one, other] = [scene.stops[0], scene.stops[1]];
        scene.stops = [one, other].repeat(4);
        let mut random = generator(seed);
        let mut noise = || normal(&mut random);
        let bearings: Vec<f64> = (0..16).map(|_| noise()).collect();
        let mut bearings = bearings.into_iter();
        let stops = scene.measure(0.0, || bearings.next().unwrap(), 0.003, noise, 0.02);
        let known = ALL_KNOWN(scene.baseline);
        let Ok(outcome) = reference::solve(&stops, &known, &ReferenceSettings::default()) else {
            continue;
        };
        let is_near = |s: &reference::ReferenceSolution<f64>| {
            let sigmas = s.heading_sigmas();
            (0..2).all(|k| {
                turn(s.headings[k], scene.cameras[k].heading).abs() < 6.0 * sigmas[k] + 0.02
            })
        };
        ambiguous += u64::from(outcome.alternative.is_some());
        let answers = [Some(outcome.best), outcome.alternative];
        lost += u64::from(!answers.iter().flatten().any(is_near));
    }
    assert!(
        ambiguous > 180 && lost * 50 <= SCENES,
        "{ambiguous} ambiguous, {lost} lost"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// A third stop decides.
    #[test]
    fn three_stops_have_one_answer(seed: u64) {
        let scene = scene(seed, 3);
        let stops = scene.exact(0.0);
        let outcome = reference::solve(&stops, &ALL_KNOWN(scene.baseline), &ReferenceSettings::default()).unwrap();
        prop_assume!(outcome.best.condition < 1e8);
        prop_assert!(scene.is_solved_by(&outcome.best, 1e-5), "{scene:?} {outcome:?}");
        prop_assert_eq!(outcome.best.degrees_of_freedom, 2);
    }

    /// A compass that is not aligned, and a baseline that was not measured.
    #[test]
    fn unknown_frame_and_unknown_baseline(seed: u64, frame in 0.0..6.2_f64) {
        let scene = scene(seed, 4);
        let stops = scene.exact(frame);
        for baseline in [Some(scene.baseline), None] {
            for frame_heading in [Some(frame), None] {
                let known = Known { baseline, frame_heading };
                let outcome = reference::solve(&stops, &known, &ReferenceSettings::default()).unwrap();
                prop_assume!(outcome.best.condition < 1e8);
                prop_assert!(scene.is_solved_by(&outcome.best, 1e-4), "{known:?} {scene:?} {outcome:?}");
                prop_assert!(turn(outcome.best.frame_heading, frame).abs() < 1e-4);
                for (n, (place, _)) in outcome.best.places(&stops).enumerate() {
                    prop_assert!((place - scene.stops[n]).norm() < 1e-3);
                }
            }
        }
    }

    /// Also of measurements that make no sense, in either precision.
    #[test]
    fn never_nan(
        raw in prop::collection::vec((prop::array::uniform8(any_number()), prop::array::uniform3(any_number())), 0..5),
        baseline in any_number(),
        heading in any_number(),
    ) {
        let stops: Vec<_> = raw.iter().map(|&([a, b, c, d, s0, s1, dx, dy], [xx, xy, yy])| Stop {
            rays: [Ray { forward: a, left: b }, Ray { forward: c, left: d }],
            bearing_sigmas: [s0, s1],
            displacement: Vector2::new(dx, dy),
            displacement_covariance: Matrix2::new(xx, xy, xy, yy),
        }).collect();
        for known in knowledge(baseline, heading) {
            assert_in_order(&stops, &known)?;
            assert_in_order(&stops.iter().map(single).collect::<Vec<_>>(), &single_known(&known))?;
        }
    }

    /// For measurements that are noisy and stops that may be poor, but that make sense.
    #[test]
    fn covariances_are_covariances(
        seed: u64,
        count in 2_usize..5,
        frame in 0.0..6.2_f64,
        bearing_sigma in 1e-4..0.05_f64,
        displacement_sigma in 0.0..0.5_f64,
        along in 0.0..6.2_f64,
        slimness in 0.0..1.0_f64,
    ) {
        let scene = scene(seed, count);
        let mut rng = generator(seed);
        let (mut a, mut b) = (generator(rng.random()), generator(rng.random()));
        let mut stops = scene.measure(frame, || normal(&mut a), bearing_sigma, || normal(&mut b), displacement_sigma);
        // Long and narrow, as a heading sensor's is.
        let turned = Rotation2::new(along).into_inner();
        let narrow = Matrix2::new(1.0, 0.0, 0.0, slimness * slimness) * displacement_sigma.powi(2);
        for stop in &mut stops {
            stop.displacement_covariance = turned * narrow * turned.transpose();
        }
        for known in knowledge(scene.baseline, frame) {
            assert_in_order(&stops, &known)?;
            assert_in_order(&stops.iter().map(single).collect::<Vec<_>>(), &single_known(&known))?;
        }
    }
}

fn knowledge(baseline: f64, heading: f64) -> [Known<f64>; 4] {
    [(true, true), (true, false), (false, true), (false, false)].map(|(length, angle)| Known {
        baseline: length.then_some(baseline),
        frame_heading: angle.then_some(heading),
    })
}

fn single(stop: &Stop<f64>) -> Stop<f32> {
    Stop {
        rays: stop.rays.map(|r| Ray {
            forward: r.forward as f32,
            left: r.left as f32,
        }),
        bearing_sigmas: stop.bearing_sigmas.map(|v| v as f32),
        displacement: stop.displacement.cast(),
        displacement_covariance: stop.displacement_covariance.cast(),
    }
}

fn single_known(known: &Known<f64>) -> Known<f32> {
    Known {
        baseline: known.baseline.map(|b| b as f32),
        frame_heading: known.frame_heading.map(|h| h as f32),
    }
}

/// An answer, if there is one, is made of numbers, its covariances are covariances, and its chi
/// squared is a sum of squares.
fn assert_in_order<T: Real + Into<f64>>(
    stops: &[Stop<T>],
    known: &Known<T>,
) -> Result<(), TestCaseError> {
    let Ok(outcome) = reference::solve(stops, known, &ReferenceSettings::default()) else {
        return Ok(());
    };
    for s in [Some(outcome.best), outcome.alternative].iter().flatten() {
        let [h0, h1] = s.headings;
        let numbers = [
            h0,
            h1,
            s.frame_heading,
            s.baseline,
            s.first_stop.x,
            s.first_stop.y,
        ];
        let sigmas = s.heading_sigmas();
        let sigmas = [
            sigmas[0],
            sigmas[1],
            s.baseline_sigma(),
            s.frame_heading_sigma(),
        ];
        prop_assert!(
            numbers
                .iter()
                .chain(&sigmas)
                .all(nalgebra::ComplexField::is_finite),
            "{s:?}"
        );
        prop_assert!(
            s.chi_squared.is_finite() && s.chi_squared >= T::zero(),
            "{s:?}"
        );
        prop_assert!(s.condition.is_finite(), "{s:?}");
        prop_assert!(
            is_covariance(s.covariance.map(Into::into)),
            "{}",
            s.covariance
        );
        let measured = stops
            .iter()
            .all(|stop| is_covariance(stop.displacement_covariance.map(Into::into)));
        for (place, covariance) in s.places(stops) {
            prop_assert!(place.iter().all(nalgebra::ComplexField::is_finite), "{s:?}");
            prop_assert!(
                covariance.iter().all(nalgebra::ComplexField::is_finite),
                "{s:?}"
            );
            if measured {
                prop_assert!(is_covariance(covariance.map(Into::into)), "{covariance}");
            }
        }
    }
    Ok(())
}

/// Symmetric and positive semi-definite but for rounding, which is judged on correlations: unknowns
/// have different units.
fn is_covariance<const N: usize>(m: nalgebra::SMatrix<f64, N, N>) -> bool {
    let sigma = m.diagonal().map(f64::sqrt);
    if !sigma.iter().all(|s| s.is_finite()) {
        return false;
    }
    let correlation = nalgebra::SMatrix::<f64, N, N>::from_fn(|i, j| {
        if sigma[i] * sigma[j] > 0.0 {
            m[(i, j)] / (sigma[i] * sigma[j])
        } else {
            f64::from(u8::from(i == j))
        }
    });
    let slack = nalgebra::SMatrix::<f64, N, N>::identity() * 1e-3;
    (correlation - correlation.transpose()).amax() < 1e-3
        && (correlation + slack).cholesky().is_some()
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        6 => -10.0..10.0,
        1 => prop::sample::select(vec![0.0, 1.0, -1.0, 0.01, f64::NAN, f64::INFINITY, 1e-300, 1e300]),
    ]
}

/// Number of headings of camera 0 that make everything fit, by trying 40,000: each heading gives both
/// ranges from the leg, so both stops, so the angle under which camera 1 would see the leg.
fn answers_by_scanning(scene: &Scene) -> usize {
    let [p0, p1] = scene.stops[..] else {
        panic!("two stops")
    };
    let leg = p1 - p0;
    let camera1 = Vector2::new(scene.baseline, 0.0);
    let cross = |a: Vector2<f64>, b: Vector2<f64>| a.x * b.y - a.y * b.x;
    let bearing = |k: usize, p| scene.cameras[k].bearing_of(p);
    let misfit = |heading: f64| {
        let along = |phi: f64| Vector2::new((heading + phi).cos(), (heading + phi).sin());
        let (e0, e1) = (along(bearing(0, p0)), along(bearing(0, p1)));
        let range0 = -cross(leg, e1) / cross(e0, e1);
        let range1 = -cross(leg, e0) / cross(e0, e1);
        if range0 < 0.0 || range1 < 0.0 {
            return None;
        }
        let (d0, d1) = (e0 * range0 - camera1, e1 * range1 - camera1);
        let seen = cross(d0, d1).atan2(d0.dot(&d1));
        Some(turn(seen, bearing(1, p1) - bearing(1, p0)))
    };
    let values: Vec<_> = (0..=40_000)
        .map(|i| misfit(f64::from(i) * 1.570_8e-4))
        .collect();
    values
        .windows(2)
        .filter(|w| matches!(w, [Some(a), Some(b)] if a * b < 0.0 && (a - b).abs() < 1.0))
        .count()
}

#[test]
fn two_stops_have_as_many_answers_as_a_scan_finds() {
    let (mut same, mut two) = (0, 0);
    for seed in 0..200 {
        let scene = scene(seed, 2);
        let expected = answers_by_scanning(&scene);
        assert!(expected == 1 || expected == 2, "seed {seed}: {expected}");
        let known = ALL_KNOWN(scene.baseline);
        let found = reference::solve(&scene.exact(0.0), &known, &ReferenceSettings::default());
        same += usize::from(found.is_ok_and(|outcome| outcome.candidates == expected));
        two += usize::from(expected == 2);
    }
    // Where two answers are about to merge, the scan may see none or both.
    assert!(same >= 196, "{same} of 200");
    assert!(two > 40, "two answers are common: {two} of 200");
}

/// Gauss-Newton, steepest descent and Levenberg find the same minimum of noisy data.
#[test]
fn methods_agree() {
    let mut rng = generator(5);
    let mut agreed = 0;
    for seed in 0..40 {
        let scene = scene(seed, 4);
        let stops = scene.measure(0.0, || normal(&mut rng), 0.005, || 0.0, 0.0);
        let solve = |method, iteration_limit| {
            let mut settings = ReferenceSettings::default();
            settings.method = method;
            settings.iteration_limit = iteration_limit;
            reference::solve(&stops, &ALL_KNOWN(scene.baseline), &settings)
        };
        let Ok(default) = solve(Method::Levenberg, 50) else {
            continue;
        };
        for (method, limit) in [
            (Method::GaussNewton, 50),
            (Method::SteepestDescent, 100_000),
        ] {
            if let Ok(other) = solve(method, limit) {
                for k in 0..2 {
                    let sigma = default.best.heading_sigmas()[k];
                    let difference = turn(other.best.headings[k], default.best.headings[k]).abs();
                    assert!(
                        difference < 0.02 * sigma,
                        "seed {seed} {method:?}: {difference} of {sigma}"
                    );
                }
                agreed += 1;
            }
        }
    }
    assert!(agreed >= 70, "{agreed} of 80");
}

/// Errors of noisy solves agree with the predicted covariance, displacement errors included.
#[test]
fn covariance_is_honest() {
    let mut rng = generator(9);
    for (bearing_sigma, displacement_sigma) in [(0.004, 0.0), (0.004, 0.02)] {
        let (mut nees, mut runs) = (0.0, 0.0);
        for seed in 0..600 {
            let scene = scene(seed, 3);
            let noise = generator(rng.random());
            let (mut a, mut b) = (noise.clone(), generator(rng.random()));
            let stops = scene.measure(
                0.0,
                || normal(&mut a),
                bearing_sigma,
                || normal(&mut b),
                displacement_sigma,
            );
            let known = ALL_KNOWN(scene.baseline);
            let Ok(outcome) = reference::solve(&stops, &known, &ReferenceSettings::default())
            else {
                continue;
            };
            let s = outcome.best;
            // Near-degenerate scenes are not linear in their noise.
            if s.heading_sigmas().iter().any(|&sigma| sigma > 0.03) || outcome.alternative.is_some()
            {
                continue;
            }
            let error = nalgebra::Vector4::new(
                turn(s.headings[0], scene.cameras[0].heading),
                turn(s.headings[1], scene.cameras[1].heading),
                s.first_stop.x - scene.stops[0].x,
                s.first_stop.y - scene.stops[0].y,
            );
            let covariance = s.covariance.fixed_view::<4, 4>(0, 0).into_owned();
            nees += error.dot(&covariance.cholesky().unwrap().solve(&error));
            runs += 1.0;
        }
        assert!(runs > 250.0, "{runs}");
        let mean = nees / runs;
        // Four unknowns. Chained displacements are treated as independent stops: a little unsure.
        assert!((3.4..4.6).contains(&mean), "NEES {mean} over {runs} runs");
    }
}

/// Noise that makes the two circles miss each other does not lose the answer, and the sigma,
/// which has no first order there, is still believable.
#[test]
fn circles_that_miss() {
    let mut rng = generator(21);
    let (mut solved, mut missed, mut within_two_sigmas) = (0, 0, 0);
    for seed in 0..500 {
        let scene = scene(seed, 2);
        let stops = scene.measure(0.0, || normal(&mut rng), 0.02, || 0.0, 0.0);
        let known = ALL_KNOWN(scene.baseline);
        let Ok(outcome) = reference::solve(&stops, &known, &ReferenceSettings::default()) else {
            continue;
        };
        solved += 1;
        if outcome.best.chi_squared > 1e-3 {
            missed += 1;
            within_two_sigmas += usize::from((0..2).all(|k| {
                let error = turn(outcome.best.headings[k], scene.cameras[k].heading);
                error.abs() < 2.0 * outcome.best.heading_sigmas()[k]
            }));
        }
    }
    assert!(solved >= 475, "{solved} of 500");
    assert!(missed >= 40, "{missed}");
    assert!(
        10 * within_two_sigmas >= 8 * missed,
        "{within_two_sigmas} of {missed}"
    );
}

#[test]
fn refusals() {
    let scene = scene(1, 4);
    let stops = scene.exact(0.0);
    let all = ALL_KNOWN(scene.baseline);
    let solve = |stops: &[Stop<f64>], known: &Known<f64>| {
        reference::solve(stops, known, &ReferenceSettings::default()).map(|_| ())
    };
    assert_eq!(solve(&[], &all), Err(Refusal::TooFew));
    assert_eq!(solve(&stops[..1], &all), Err(Refusal::TooFew));
    let unaligned = Known {
        frame_heading: None,
        ..all
    };
    assert_eq!(solve(&stops[..2], &unaligned), Err(Refusal::TooFew));
    assert_eq!(solve(&stops[..3], &unaligned), Ok(()));
    for baseline in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let known = Known {
            baseline: Some(baseline),
            ..all
        };
        assert_eq!(solve(&stops, &known), Err(Refusal::NotFinite));
    }
    let mut still = stops.clone();
    for stop in &mut still {
        stop.displacement = Vector2::zeros();
    }
    assert_eq!(solve(&still, &all), Err(Refusal::CoincidentTargets));
    let mut bad = stops.clone();
    for sigma in [0.0, f64::INFINITY, f64::NAN] {
        bad[2].bearing_sigmas[1] = sigma;
        assert_eq!(solve(&bad, &all), Err(Refusal::NotFinite));
    }
}

/// `f32` solves the same scenes as `f64`.
#[test]
fn single_precision() {
    for seed in 0..200 {
        let scene = scene(seed, 3);
        let stops = scene.measure(0.0, || 0.0, 0.005, || 0.0, 0.0);
        let single: Vec<Stop<f32>> = stops
            .iter()
            .map(|s| Stop {
                rays: s.rays.map(|r| Ray {
                    forward: r.forward as f32,
                    left: r.left as f32,
                }),
                bearing_sigmas: s.bearing_sigmas.map(|v| v as f32),
                displacement: s.displacement.cast(),
                displacement_covariance: Matrix2::zeros(),
            })
            .collect();
        let known = Known {
            baseline: Some(scene.baseline as f32),
            frame_heading: Some(0.0),
        };
        let double = reference::solve(
            &stops,
            &ALL_KNOWN(scene.baseline),
            &ReferenceSettings::default(),
        )
        .unwrap();
        if double.alternative.is_some() {
            continue;
        }
        let single = reference::solve(&single, &known, &ReferenceSettings::default()).unwrap();
        for k in 0..2 {
            let sigma = double.best.heading_sigmas()[k];
            let error = turn(f64::from(single.best.headings[k]), double.best.headings[k]);
            assert!(
                error.abs() < 0.05 * sigma + 1e-5,
                "seed {seed}: {error} of {sigma}"
            );
        }
    }
}

/// Without noise the best answer fits exactly, and chi squared of the other one is in inverse
/// proportion to the bearings' variance: so the sigma decides whether it is ruled out.
#[test]
fn another_answer_is_told_of_until_one_in_a_thousand_fits_so_badly() {
    const LIMIT: f64 = 10.828;
    let mut found = 0;
    for seed in 0..200 {
        let scene = scene(seed, 3);
        let solve = |sigma: f64| {
            let stops: Vec<_> = scene
                .exact(0.0)
                .into_iter()
                .map(|stop| Stop {
                    bearing_sigmas: [sigma; 2],
                    ..stop
                })
                .collect();
            let known = ALL_KNOWN(scene.baseline);
            reference::solve(&stops, &known, &ReferenceSettings::default()).ok()
        };
        // With poor bearings nothing is ruled out, and with better ones chi squared is known better.
        let other = |sigma| Some(solve(sigma)?.alternative?.chi_squared * sigma * sigma);
        let Some(scale) = other(0.5).and_then(|scale| other((scale / 2.0).sqrt())) else {
            continue;
        };
        let sigma_of = |chi_squared: f64| (scale / chi_squared).sqrt();
        // Poorer ones lead to less than a minimum.
        if sigma_of(LIMIT) > 0.03 {
            continue;
        }
        found += 1;
        let told = |chi_squared| solve(sigma_of(chi_squared)).unwrap().alternative;
        let just = told(0.97 * LIMIT).expect("not ruled out");
        assert!(
            (just.chi_squared / LIMIT - 0.97).abs() < 1e-3,
            "seed {seed}"
        );
        assert_eq!(told(1.03 * LIMIT), None, "seed {seed}");
    }
    assert!(found >= 5, "{found} scenes have another answer");
}

/// In the baseline's own frame the poses are parts of the solution; in another one they are turned and moved
/// with it.
#[test]
fn poses_turn_with_their_frame() {
    let scene = scene(3, 4);
    let (mut a, mut b) = (generator(1), generator(2));
    let stops = scene.measure(0.4, || normal(&mut a), 0.002, || normal(&mut b), 0.01);
    let known = Known {
        baseline: None,
        frame_heading: None,
    };
    let solution = reference::solve(&stops, &known, &ReferenceSettings::default());
    let solution = solution.unwrap().best;
    let c = solution.covariance;
    let own = solution.poses(Point2::origin(), 0.0);
    assert_eq!(own[0].position, Point2::origin());
    assert_eq!(own[1].position, Point2::new(solution.baseline, 0.0));
    assert_eq!(own.map(|pose| pose.heading), solution.headings);
    let mut first = Matrix3::zeros();
    first.m33 = c.m11;
    // The error along the baseline is that of its length, together with the heading.
    let second = Matrix3::new(c.m66, 0.0, c.m26, 0.0, 0.0, 0.0, c.m26, 0.0, c.m22);
    assert_eq!(own.map(|pose| pose.covariance), [first, second]);
    assert!(c.m66 > 0.0 && c.m26 != 0.0);
    assert_eq!(solution.heading_sigmas(), [c.m11.sqrt(), c.m22.sqrt()]);
    assert_eq!(solution.frame_heading_sigma(), c.m55.sqrt());
    assert_eq!(solution.baseline_sigma(), c.m66.sqrt());
    for direction in [0.7, 2.5, 4.0, 5.9] {
        let origin = Point2::new(3.0, -2.0);
        let turn = Rotation2::new(direction);
        let turn3 = turn.to_homogeneous();
        for (pose, own) in solution.poses(origin, direction).iter().zip(own) {
            assert!((pose.position - (origin + turn * own.position.coords)).norm() < 1e-12);
            assert!(test_support::turn(pose.heading, own.heading + direction).abs() < 1e-12);
            assert!((0.0..core::f64::consts::TAU).contains(&pose.heading));
            let expected = turn3 * own.covariance * turn3.transpose();
            assert!((pose.covariance - expected).norm() < 1e-12 * c.norm());
        }
    }
}

/// The reason why the refinement failed is told, where no candidate got further.
#[test]
fn too_few_steps_do_not_converge() {
    let scene = scene(5, 3);
    let stops = scene.measure(0.0, || 0.5, 0.01, || 0.5, 0.01);
    let with = |iteration_limit| {
        let mut settings = ReferenceSettings::default();
        settings.iteration_limit = iteration_limit;
        reference::solve(&stops, &ALL_KNOWN(scene.baseline), &settings)
    };
    for steps in [0, 1] {
        assert_eq!(with(steps), Err(Refusal::DidNotConverge));
    }
    let free = with(50).unwrap().best;
    assert!((2..50).contains(&free.iterations));
    assert_eq!(with(free.iterations).unwrap().best, free);
}
