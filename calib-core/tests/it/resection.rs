//! Resection against scenes whose truth is known, and against other methods.

use crate::scene;

use calib_core::{
    Pose, Ray, Refusal, Sighting, angle,
    resection::{self, three_point},
};
use nalgebra::{Matrix2, Matrix3, Point2, Vector2, Vector3};
use proptest::prelude::*;
use rand::RngExt;
use scene::{regular_scene, sighting};
use test_support::{Truth, generator, normal, turn};

/// Central differences of bearings by pose: the oracle for every covariance.
fn numeric_covariance(truth: &Truth, sightings: &[Sighting<f64>]) -> Matrix3<f64> {
    let h = 1e-6;
    let mut information = Matrix3::zeros();
    for s in sightings {
        let at = |x: f64, y: f64, heading: f64| {
            Truth {
                x: truth.x + x,
                y: truth.y + y,
                heading: truth.heading + heading,
            }
            .bearing_of(s.target)
        };
        let g = Vector3::new(
            turn(at(h, 0., 0.), at(-h, 0., 0.)),
            turn(at(0., h, 0.), at(0., -h, 0.)),
            turn(at(0., 0., h), at(0., 0., -h)),
        ) / (2.0 * h);
        // The target's own error moves the bearing as the camera's would, the other way.
        let by_target = Vector2::new(g.x, g.y);
        let variance =
            s.bearing_sigma.powi(2) + (by_target.transpose() * s.target_covariance * by_target).x;
        information += g * g.transpose() / variance;
    }
    information.try_inverse().expect("a regular scene")
}

fn assert_pose(pose: &Pose<f64>, truth: &Truth, tolerance: f64) {
    let place = truth.position();
    assert!(
        (pose.position - place).norm() < tolerance
            && turn(pose.heading, truth.heading).abs() < tolerance,
        "{pose:?} is not {truth:?}"
    );
    assert!((0.0..core::f64::consts::TAU).contains(&pose.heading));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn exact_sightings_give_the_exact_pose(seed: u64) {
        let (truth, targets) = regular_scene(seed);
        let sightings = targets.map(|t| sighting(&truth, t, 0.0, 0.01));
        assert_pose(&three_point::solve(&sightings).unwrap(), &truth, 1e-7);
    }

    /// The same lines of sight, one of them pointing away from its target: whichever it is.
    #[test]
    fn no_target_may_be_behind(seed: u64) {
        let (truth, targets) = regular_scene(seed);
        for behind in 0..3 {
            let mut sightings = targets.map(|t| sighting(&truth, t, 0.0, 0.01));
            let ray = &mut sightings[behind].ray;
            *ray = Ray { forward: -ray.forward, left: -ray.left };
            prop_assert_eq!(three_point::fix(&sightings).unwrap_err(), Refusal::TargetBehind);
        }
    }

    /// The closed form and least squares are the same function of the same noisy bearings.
    #[test]
    fn rays_and_least_squares_agree(seed: u64) {
        let (truth, targets) = regular_scene(seed);
        let mut rng = generator(seed ^ 1);
        let sightings = targets.map(|t| sighting(&truth, t, 0.002 * normal(&mut rng), 0.002));
        let Ok(pose) = three_point::solve(&sightings) else { return Ok(()) };
        prop_assume!(pose.sigma_position() < 1.0);
        // Each sighting twice, at half the weight: the least-squares path, the same optimum.
        let doubled: Vec<_> = sightings
            .iter()
            .chain(&sightings)
            .map(|s| Sighting { bearing_sigma: s.bearing_sigma * 2_f64.sqrt(), ..*s })
            .collect();
        let fitted = resection::solve(&doubled).unwrap();
        prop_assert!((fitted.pose.position - pose.position).norm() < 1e-3 * pose.sigma_position());
        prop_assert!(turn(fitted.pose.heading, pose.heading).abs() < 1e-3 * pose.sigma_heading());
        prop_assert!((fitted.pose.covariance - pose.covariance).norm() < 1e-3 * pose.covariance.norm());
        prop_assert!(fitted.chi_squared < 1e-6);
    }

    #[test]
    fn covariance_is_the_inverse_information(seed: u64) {
        let (truth, targets) = regular_scene(seed);
        let mut rng = generator(seed ^ 2);
        let mut sightings = targets.map(|t| sighting(&truth, t, 0.0, rng.random_range(0.001..0.02)));
        for s in &mut sightings {
            let (a, b, c) = (rng.random_range(0.0..0.1), rng.random_range(0.0..0.1), rng.random_range(-0.1..0.1));
            let factor = Matrix2::new(a, 0.0, c, b);
            s.target_covariance = factor * factor.transpose();
        }
        let oracle = numeric_covariance(&truth, &sightings);
        let pose = three_point::solve(&sightings).unwrap();
        prop_assert!((pose.covariance - oracle).norm() < 1e-4 * oracle.norm());
        let more: [_; 6] = core::array::from_fn(|i| sightings[i % 3]);
        let fitted = resection::solve(&more).unwrap();
        prop_assert!((fitted.pose.covariance - oracle / 2.0).norm() < 1e-4 * oracle.norm());
    }

    /// Predicted from the places and sigmas alone; the seen bearings have no part in it.
    #[test]
    fn prediction_needs_no_bearings(seed: u64) {
        let (truth, targets) = regular_scene(seed);
        let mut rng = generator(seed ^ 4);
        let seen = targets.map(|t| sighting(&truth, t, rng.random_range(-1.0..1.0), 0.01).with_target_sigma(0.02));
        let oracle = numeric_covariance(&truth, &seen);
        let now = resection::predict(truth.position(), truth.heading, &seen).unwrap();
        prop_assert!((now.covariance - oracle).norm() < 1e-4 * oracle.norm());
        prop_assert_eq!(now.position, truth.position());
        // Another stop never takes anything away.
        let [place] = truth.targets::<1>(&mut rng);
        let next = Sighting::new(place, Ray::towards(truth.position(), truth.heading, place), 0.01);
        let then = resection::predict(truth.position(), truth.heading, seen.iter().chain([&next])).unwrap();
        let gain = now.covariance - then.covariance;
        prop_assert!(gain.symmetric_eigenvalues().min() > -1e-6 * now.covariance.norm());
        prop_assert!(then.sigma_position() < now.sigma_position());
    }

    /// The length of a ray carries no meaning, and neither does the order of the sightings.
    #[test]
    fn ray_length_and_order_do_not_matter(seed: u64, a in 0.01..100.0, b in 0.01..100.0) {
        let (truth, targets) = regular_scene(seed);
        let [s1, s2, mut s3] = targets.map(|t| sighting(&truth, t, 0.0, 0.01));
        let mut long = s1;
        long.ray = Ray { forward: s1.ray.forward * a, left: s1.ray.left * a };
        s3.ray = Ray { forward: s3.ray.forward * b, left: s3.ray.left * b };
        assert_pose(&three_point::solve(&[s2, s3, long]).unwrap(), &truth, 1e-7);
    }

    /// Turning, shifting and stretching the world does the same to the answer.
    #[test]
    fn equivariant(seed: u64, shift in -50.0..50.0_f64, angle in 0.0..6.2_f64, scale in 0.1..10.0_f64) {
        let (truth, targets) = regular_scene(seed);
        let mut rng = generator(seed ^ 3);
        let sightings = targets.map(|t| sighting(&truth, t, 0.001 * normal(&mut rng), 0.001));
        let Ok(pose) = three_point::solve(&sightings) else { return Ok(()) };
        prop_assume!(pose.sigma_position() < 1.0);
        let rotation = nalgebra::Rotation2::<f64>::new(angle);
        let moved = |p: Point2<f64>| {
            Point2::from((rotation * p).coords * scale + Vector2::new(shift, -shift))
        };
        let turned = three_point::solve(&sightings.map(|s| Sighting { target: moved(s.target), ..s })).unwrap();
        prop_assert!((turned.position - moved(pose.position)).norm() < 1e-6 * (1.0 + scale));
        prop_assert!(turn(turned.heading, pose.heading + angle).abs() < 1e-6);
        prop_assert!((turned.sigma_position() / scale / pose.sigma_position() - 1.0).abs() < 1e-5);
    }

    /// Whatever the numbers are, there is an answer of finite numbers or a refusal.
    #[test]
    fn never_nan(raw in prop::collection::vec(prop::array::uniform5(any_number()), 0..7), gate in any_number()) {
        let sightings: Vec<_> = raw.iter().map(|&[x, y, forward, left, bearing_sigma]| Sighting {
            target: Point2::new(x, y),
            ray: Ray { forward, left },
            bearing_sigma,
            target_covariance: Matrix2::zeros(),
        }).collect();
        let mut dropped = vec![false; sightings.len()];
        let solutions = [
            resection::solve(&sightings),
            resection::solve_rejecting(&sightings, gate, &mut dropped),
        ];
        for s in solutions.into_iter().flatten() {
            prop_assert!(s.pose.position.coords.iter().all(|v| v.is_finite()));
            prop_assert!(s.pose.heading.is_finite() && s.pose.covariance.iter().all(|v| v.is_finite()));
        }
    }
}

/// Ordinary numbers, awkward ones, and a few that many inputs share.
fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -10.0..10.0,
        1 => any::<f64>(),
        2 => prop::sample::select(vec![0.0, 1.0, -1.0, 0.01, f64::NAN, f64::INFINITY, 1e-300, 1e300]),
    ]
}

/// A camera on the circle, at various places of it, seeing targets on it.
#[test]
fn danger_circle_is_refused_and_its_neighbourhood_is_unsure() {
    let on_circle = |angle: f64| Point2::new(3.0 * angle.cos() - 1.0, 3.0 * angle.sin() + 2.0);
    let targets = [0.3, 1.1, 2.0].map(on_circle);
    for degrees in (130..340).step_by(7) {
        let camera = on_circle(f64::from(degrees).to_radians());
        let truth = Truth {
            x: camera.x,
            y: camera.y,
            heading: (targets[1] - camera).y.atan2((targets[1] - camera).x),
        };
        let sightings = targets.map(|t| sighting(&truth, t, 0.0, 0.01));
        match three_point::solve(&sightings) {
            Err(why) => assert_eq!(why, Refusal::DangerCircle),
            // Where rounding leaves a digit, the predicted sigma must not.
            Ok(pose) => assert!(pose.sigma_position() > 1e6, "{pose:?}"),
        }
        let beside = Truth {
            x: camera.x * 1.001,
            ..truth
        };
        let pose = three_point::solve(&targets.map(|t| sighting(&beside, t, 0.0, 0.01))).unwrap();
        assert!(pose.sigma_position() > 3.0, "{pose:?}");
    }
}

#[test]
fn refusals_name_the_reason() {
    let truth = Truth {
        x: 0.0,
        y: 0.0,
        heading: 0.0,
    };
    let see = |x: f64, y: f64| sighting(&truth, Point2::new(x, y), 0.0, 0.01);
    let (a, b, c) = (see(2.0, 0.5), see(5.0, -1.0), see(4.0, 2.0));
    let refusal = |s: &[Sighting<f64>]| resection::solve(s).unwrap_err();

    assert_eq!(refusal(&[]), Refusal::TooFew);
    assert_eq!(refusal(&[a, b]), Refusal::TooFew);
    for same in [[a, a, b], [a, b, a], [b, a, a], [a, a, a]] {
        assert_eq!(refusal(&same), Refusal::CoincidentTargets);
    }
    // The same place with bearings that noise made different.
    let noisy = sighting(&truth, a.target, 0.01, 0.01);
    for same in [[a, noisy, b], [a, b, noisy], [b, a, noisy]] {
        assert_eq!(refusal(&same), Refusal::CoincidentTargets);
    }
    assert_eq!(refusal(&[a, a, b, b]), Refusal::CoincidentTargets);
    assert_eq!(
        refusal(&[see(1.0, 0.0), see(2.0, 0.0), see(3.0, 0.0)]),
        Refusal::DangerLine
    );
    // On the targets' line, between them: bearings of 0 and 180 degrees.
    assert_eq!(
        refusal(&[see(-1.0, 0.0), see(2.0, 0.0), see(3.0, 0.0)]),
        Refusal::DangerLine
    );
    // Mirrored bearings put the camera on the other side, where it would look away.
    let mirrored = [a, b, c].map(|s| Sighting {
        ray: Ray {
            forward: -s.ray.forward,
            left: -s.ray.left,
        },
        ..s
    });
    let turned_around = resection::solve(&mirrored).unwrap();
    assert!((turned_around.pose.heading - core::f64::consts::PI).abs() < 1e-9);
    assert_eq!(refusal(&[a, mirrored[1], c]), Refusal::TargetBehind);
    for bad in [
        Sighting {
            target: Point2::new(f64::NAN, 0.0),
            ..a
        },
        Sighting {
            bearing_sigma: 0.0,
            ..a
        },
        Sighting {
            bearing_sigma: -1.0,
            ..a
        },
        Sighting {
            ray: Ray {
                forward: 0.0,
                left: 0.0,
            },
            ..a
        },
        Sighting {
            ray: Ray {
                forward: f64::INFINITY,
                left: 0.0,
            },
            ..a
        },
    ] {
        assert_eq!(refusal(&[bad, b, c]), Refusal::NotFinite);
        assert_eq!(refusal(&[a, b, c, bad]), Refusal::NotFinite);
    }
}

/// Bearings that differ by 0 or 180 degrees break methods that use cotangents. Not this one.
#[test]
fn opposite_and_equal_bearings_are_fine() {
    let truth = Truth {
        x: 1.0,
        y: 2.0,
        heading: 1.0,
    };
    for bearings in [[0.3, 0.3, -0.2], [0.0, core::f64::consts::PI, 1.0]] {
        let [b1, b2, b3] = bearings;
        let targets = [
            truth.place(2.0, b1),
            truth.place(5.0, b2),
            truth.place(3.0, b3),
        ];
        let sightings = targets.map(|t| sighting(&truth, t, 0.0, 0.01));
        assert_pose(&three_point::solve(&sightings).unwrap(), &truth, 1e-9);
    }
}

/// Half the slope of chi squared by x, y, heading, from differences, and the way to the minimum that the
/// Cramer-Rao bound makes of it, in sigmas.
fn sigmas_to_the_minimum(pose: &Pose<f64>, sightings: &[Sighting<f64>]) -> f64 {
    let h = 1e-6;
    let cost = |by: Vector3<f64>| {
        let at = Truth {
            x: pose.position.x + by.x,
            y: pose.position.y + by.y,
            heading: pose.heading + by.z,
        };
        sightings.iter().fold(0.0, |sum, s| {
            sum + (turn(at.bearing_of(s.target), s.ray.bearing()) / s.bearing_sigma).powi(2)
        })
    };
    let slope = Vector3::from_fn(|i, _| {
        let by = Vector3::ith(i, h);
        (cost(by) - cost(-by)) / (4.0 * h)
    });
    slope.dot(&(pose.covariance * slope)).sqrt()
}

/// A camera that looks down an aisle: stops within 2 cm of one line, 1.5 to 4 m of it, 5 to 12 m away.
/// Place and heading lie in one narrow, curved valley; its floor is found wherever the place is
/// known to 15 % of the distance.
#[test]
fn stops_nearly_on_one_line_are_answered() {
    let mut rng = generator(1);
    let (mut walks, mut most_steps) = (0, 0);
    while walks < 3000 {
        let count = [4, 5, 6, 8, 10][rng.random_range(0..5)];
        let sigma = [0.0005, 0.001, 0.0023][rng.random_range(0..3)];
        let (length, scatter) = (rng.random_range(1.5..4.0), rng.random_range(0.005..0.02));
        let (along, away) = (rng.random_range(0.0..1.57_f64), rng.random_range(5.0..12.0));
        let truth = Truth {
            x: 0.0,
            y: 0.0,
            heading: 0.05 * normal(&mut rng),
        };
        let sightings: Vec<_> = (0..count)
            .map(|i| {
                let a = length * (f64::from(i) / f64::from(count - 1) - 0.5);
                let b = scatter * normal(&mut rng);
                let (sin, cos) = along.sin_cos();
                let stop = Point2::new(away + a * cos - b * sin, a * sin + b * cos);
                sighting(&truth, stop, sigma * normal(&mut rng), sigma)
            })
            .collect();
        let bound = resection::predict(truth.position(), truth.heading, &sightings);
        if !bound.is_ok_and(|bound| bound.sigma_position() <= 0.15 * away) {
            continue;
        }
        walks += 1;
        let solution = resection::solve(&sightings).unwrap();
        let off = sigmas_to_the_minimum(&solution.pose, &sightings);
        assert!(off < 0.1, "walk {walks} is {off} sigmas off: {solution:?}");
        most_steps = most_steps.max(solution.iterations);
    }
    assert!(most_steps <= 15, "{most_steps} steps");
}

/// Gaussian bearings: errors reach the Cramer-Rao bound and agree with the predicted covariance.
#[test]
fn monte_carlo_agrees_with_the_prediction() {
    let mut rng = generator(7);
    for (n, sigma) in [(3, 0.1_f64), (3, 1.0), (6, 0.5), (10, 1.0)] {
        let sigma = sigma.to_radians();
        let (mut nees, mut ratio, mut runs) = (0.0, 0.0, 0.0);
        while runs < 4000.0 {
            let truth = Truth::random(&mut rng);
            let targets: [_; 10] = truth.targets(&mut rng);
            let place = truth.position();
            let exact: Vec<_> = targets[..n]
                .iter()
                .map(|&t| sighting(&truth, t, 0.0, sigma))
                .collect();
            // Far from degenerate, so that the linear prediction is one.
            let Ok(bound) = resection::solve(&exact) else {
                continue;
            };
            if bound.pose.sigma_position() > 0.25 {
                continue;
            }
            let noisy: Vec<_> = targets[..n]
                .iter()
                .map(|&t| sighting(&truth, t, sigma * normal(&mut rng), sigma))
                .collect();
            let Ok(solution) = resection::solve(&noisy) else {
                continue;
            };
            nees += solution
                .pose
                .normalised_error(place, truth.heading)
                .unwrap();
            let variance = bound.pose.sigma_position().powi(2);
            ratio += (solution.pose.position - place).norm_squared() / variance;
            runs += 1.0;
        }
        // NEES has mean 3 and variance 6; four standard errors of the mean, and some non-linearity.
        assert!(
            (nees / runs - 3.0).abs() < 0.25,
            "n {n}: nees {}",
            nees / runs
        );
        assert!(
            ((ratio / runs).sqrt() - 1.0).abs() < 0.05,
            "n {n}: {}",
            ratio / runs
        );
    }
}

/// One sighting in six is wild: it is found, reported, and does no harm.
#[test]
fn outliers_are_dropped_and_reported() {
    let mut rng = generator(11);
    let sigma = 0.005;
    let (mut tried, mut right, mut clean_kept) = (0, 0, 0);
    while tried < 500 {
        let truth = Truth::random(&mut rng);
        let targets: [_; 6] = truth.targets(&mut rng);
        let mut sightings = targets.map(|t| sighting(&truth, t, sigma * normal(&mut rng), sigma));
        let Ok(clean) = resection::solve(&sightings) else {
            continue;
        };
        if clean.pose.sigma_position() > 0.05 {
            continue;
        }
        tried += 1;
        let mut dropped = [true; 6];
        let kept = resection::solve_rejecting(&sightings, 4.0, &mut dropped);
        clean_kept += usize::from(kept.is_ok() && dropped == [false; 6]);
        let wild = rng.random_range(0..6);
        sightings[wild] = sighting(&truth, targets[wild], rng.random_range(0.15..0.5), sigma);
        let result = resection::solve_rejecting(&sightings, 4.0, &mut dropped);
        let mut expected = [false; 6];
        expected[wild] = true;
        right += usize::from(result.is_ok() && dropped == expected);
    }
    assert!(
        clean_kept >= 490,
        "{clean_kept} of 500 clean cases kept whole"
    );
    assert!(right >= 450, "{right} of 500 outliers found");
}

#[test]
fn of_four_one_wrong_sighting_is_noticed() {
    let truth = Truth {
        x: 0.0,
        y: 0.0,
        heading: 0.5,
    };
    let targets =
        [(4.0, -0.4), (3.0, 0.3), (6.0, 0.45), (2.0, -0.1)].map(|(r, b)| truth.place(r, b));
    let mut sightings = targets.map(|t| sighting(&truth, t, 0.0, 0.005));
    let mut dropped = [false; 4];
    assert!(resection::solve_rejecting(&sightings, 4.0, &mut dropped).is_ok());
    sightings[2] = sighting(&truth, targets[2], 0.2, 0.005);
    assert_eq!(
        resection::solve_rejecting(&sightings, 4.0, &mut dropped),
        Err(Refusal::Inconsistent)
    );
    // Without rejection it is answered, and the residuals show that the answer is doubtful.
    let solution = resection::solve(&sightings).unwrap();
    assert!(solution.chi_squared > 100.0 && solution.degrees_of_freedom() == 1);
    let fit = solution.fit();
    assert_eq!(fit.chi_squared, solution.chi_squared);
    assert_eq!(fit.degrees_of_freedom, 1);
    assert!(fit.is_bad());
}

/// Half of the sightings fit one pose exactly, half another one: neither has the majority.
#[test]
fn half_is_no_majority() {
    let (one, other) = (
        Truth {
            x: 0.0,
            y: 0.0,
            heading: 0.3,
        },
        Truth {
            x: 2.0,
            y: -1.0,
            heading: 0.9,
        },
    );
    let places = [
        (4.0, -0.3),
        (5.0, 0.4),
        (3.0, 0.1),
        (7.0, -0.1),
        (6.0, 0.25),
    ];
    let seen = |by: &Truth| places.map(|(r, b)| sighting(by, one.place(r, b), 0.0, 0.005));
    let (first, second) = (seen(&one), seen(&other));
    let four_each: Vec<_> = first[..4].iter().chain(&second[..4]).copied().collect();
    let mut dropped = [false; 9];
    assert_eq!(
        resection::solve_rejecting(&four_each, 4.0, &mut dropped[..8]),
        Err(Refusal::Inconsistent)
    );
    // One more makes it five of nine.
    let five: Vec<_> = first.iter().chain(&second[..4]).copied().collect();
    let solution = resection::solve_rejecting(&five, 4.0, &mut dropped).unwrap();
    assert_eq!(dropped, [[false; 5].as_slice(), &[true; 4]].concat()[..]);
    assert_pose(&solution.pose, &one, 1e-9);
}

/// A difference of covariances may be none. It makes no sighting better than the camera's own sigma.
#[test]
fn an_impossible_target_covariance_adds_nothing() {
    for seed in 0..50 {
        let mut rng = generator(seed);
        let (truth, targets) = regular_scene(seed);
        let more =
            [0, 1].map(|_| truth.place(rng.random_range(1.0..8.0), rng.random_range(-0.5..0.5)));
        let good: Vec<_> = targets
            .iter()
            .chain(&more)
            .map(|&target| sighting(&truth, target, 0.01 * normal(&mut rng), 0.01))
            .collect();
        let mut bad = good.clone();
        for sighting in &mut bad {
            sighting.target_covariance = Matrix2::new(0.0, 0.0, 0.0, 0.0)
                - Matrix2::from_diagonal_element(rng.random_range(0.001..0.5));
        }
        let mut dropped = [false; 5];
        assert_eq!(resection::solve(&bad), resection::solve(&good));
        assert_eq!(
            resection::solve_rejecting(&bad, 4.0, &mut dropped),
            resection::solve_rejecting(&good, 4.0, &mut dropped)
        );
        let three = |s: &[Sighting<f64>]| resection::solve(&s[..3]);
        assert_eq!(three(&bad), three(&good));
    }
    // A value that is not a number is still refused.
    let (truth, targets) = regular_scene(1);
    let mut three = targets.map(|target| sighting(&truth, target, 0.0, 0.01));
    three[1].target_covariance = Matrix2::repeat(f64::NAN);
    assert_eq!(three_point::solve(&three), Err(Refusal::NotFinite));
}

/// Millimetres are a unit as good as any.
#[test]
fn single_precision_bears_any_unit() {
    let (truth, targets) = regular_scene(3);
    let solve = |scale: f64| {
        let truth = Truth {
            x: truth.x * scale,
            y: truth.y * scale,
            ..truth
        };
        let three = targets.map(|target| {
            single_precision(
                sighting(&truth, target * scale, 0.0, 0.01).with_target_sigma(0.01 * scale),
            )
        });
        three_point::solve(&three)
    };
    let unit = solve(1.0).unwrap();
    for scale in [1e-6, 1e-3, 1e3, 7e4, 1e6] {
        let pose = solve(scale).unwrap();
        let ratio = pose.sigma_position() / (unit.sigma_position() * scale as f32);
        assert!((ratio - 1.0).abs() < 1e-2, "{scale}: {ratio}");
        let ratio = pose.sigma_heading() / unit.sigma_heading();
        assert!((ratio - 1.0).abs() < 1e-2, "{scale}: {ratio}");
    }
}

/// An error that all targets share moves the camera by just as much and does not turn it.
#[test]
fn a_shift_of_all_targets_shifts_the_camera() {
    let (truth, targets) = regular_scene(3);
    let shift = Vector2::new(0.3, -0.2);
    let sightings = targets.map(|t| sighting(&truth, t, 0.0, 0.01));
    let moved = sightings.map(|s| Sighting {
        target: s.target + shift,
        ..s
    });
    let (before, after) = (
        three_point::solve(&sightings).unwrap(),
        three_point::solve(&moved).unwrap(),
    );
    assert!((after.position - before.position - shift).norm() < 1e-9);
    assert!(angle::wrap_signed(after.heading - before.heading).abs() < 1e-9);
    assert!((after.covariance - before.covariance).norm() < 1e-9);
}

fn single_precision(s: Sighting<f64>) -> Sighting<f32> {
    let ray = Ray {
        forward: s.ray.forward as f32,
        left: s.ray.left as f32,
    };
    Sighting::new(s.target.cast(), ray, s.bearing_sigma as f32)
}

/// `f32` against `f64` in ordinary scenes: rounding is far below a sensible bearing noise.
#[test]
fn single_precision_is_enough() {
    for seed in 0..2000 {
        let (truth, targets) = regular_scene(seed);
        let sightings = targets.map(|t| sighting(&truth, t, 0.0, 0.005));
        let single = sightings.map(single_precision);
        let exact = three_point::solve(&sightings).unwrap();
        let rounded = three_point::solve(&single).unwrap();
        let error = (rounded.position.cast::<f64>() - exact.position).norm();
        assert!(
            error < 0.01 * exact.sigma_position(),
            "seed {seed}: {error}"
        );
    }
}

/// Least squares in `f32` stops where that in `f64` does.
#[test]
fn single_precision_is_enough_for_least_squares() {
    let mut rng = generator(17);
    for seed in 0..500 {
        let truth = Truth::random(&mut rng);
        let targets: [Point2<f64>; 8] = truth.targets(&mut rng);
        let sightings = targets.map(|t| sighting(&truth, t, 0.005 * normal(&mut rng), 0.005));
        let single = sightings.map(single_precision);
        let double = resection::solve(&sightings).unwrap();
        let single = resection::solve(&single).unwrap();
        let error = (single.pose.position.cast::<f64>() - double.pose.position).norm();
        assert!(
            error < 0.02 * double.pose.sigma_position(),
            "seed {seed}: {error}"
        );
    }
}

/// The ellipse of a covariance against one drawn by its eigenvectors.
#[test]
fn ellipse_of_a_covariance() {
    let (truth, targets) = regular_scene(5);
    let pose = three_point::solve(&targets.map(|t| sighting(&truth, t, 0.0, 0.01))).unwrap();
    let e = pose.ellipse(0.95);
    let eigen =
        nalgebra::SymmetricEigen::new(pose.covariance.fixed_view::<2, 2>(0, 0).into_owned());
    let i = eigen.eigenvalues.imax();
    // 5.991 is the 95 % quantile of chi squared with two degrees of freedom.
    assert!((e.semi_major - (5.991_464_5 * eigen.eigenvalues[i]).sqrt()).abs() < 1e-6);
    assert!((e.semi_minor - (5.991_464_5 * eigen.eigenvalues[1 - i]).sqrt()).abs() < 1e-6);
    let axis = eigen.eigenvectors.column(i);
    assert!((axis.x * e.angle.sin() - axis.y * e.angle.cos()).abs() < 1e-9);
}

#[test]
fn predictions_refuse_what_determines_no_pose() {
    let camera = Point2::new(-1.0, 2.0);
    let predict = |targets: &[(f64, f64)]| {
        let seen: Vec<_> = targets
            .iter()
            .map(|&(x, y)| Sighting::new(Point2::new(x, y), Ray::from_bearing(0.0), 0.01))
            .collect();
        resection::predict(camera, 0.0, &seen)
    };
    assert!(predict(&[(3.0, 2.0), (4.0, 1.0), (5.0, 4.0)]).is_ok());
    assert_eq!(predict(&[(3.0, 2.0), (4.0, 1.0)]), Err(Refusal::TooFew));
    let circle = [0.3_f64, 1.1, 2.0].map(|a| (3.0 * a.cos() - 4.0, 3.0 * a.sin() + 2.0));
    let line = [(0.0, 3.0), (1.0, 4.0), (3.0, 6.0)];
    let coincident = [(3.0, 2.0), (3.0, 2.0), (5.0, 4.0)];
    for degenerate in [circle, line, coincident] {
        assert_eq!(predict(&degenerate), Err(Refusal::Undetermined));
    }
    let on_the_camera = [(3.0, 2.0), (4.0, 1.0), (-1.0, 2.0)];
    assert_eq!(predict(&on_the_camera), Err(Refusal::NotFinite));
    let broken = [(3.0, 2.0), (4.0, 1.0), (f64::NAN, 2.0)];
    assert_eq!(predict(&broken), Err(Refusal::NotFinite));
}
