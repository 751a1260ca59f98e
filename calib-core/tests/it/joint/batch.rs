//! The same answer as a dense least squares over everything at once.

use calib_core::angle::wrap_signed;
use test_support::{
    amount,
    batch::Batch,
    generator, turn,
    walk::{CarrierErrors, Visited, Walk},
};

use crate::joint::support::{Joint, WIDE, add, filled, filled_with, number, prior, through_lenses};

const CASES: [(&str, CarrierErrors); 3] = [
    ("unknown carrier", CarrierErrors::UNKNOWN),
    ("drift", CarrierErrors::DRIFT),
    ("perfect steps", CarrierErrors::PERFECT),
];

/// Largest difference to the batch, in its sigmas, and largest relative difference of a sigma, over
/// cameras, stops, carrier and reference headings.
fn off<T: calib_core::Real + Into<f64>>(joint: &mut Joint<T>, walk: &Walk) -> (f64, f64) {
    let taken: Vec<bool> = (0..walk.cameras.len())
        .map(|camera| joint.pose(camera).is_ok())
        .collect();
    let batch = Batch::solve(walk, prior(&walk.errors), |camera| taken[camera]).unwrap();
    off_batch(joint, walk, &taken, &batch)
}

fn off_batch<T: calib_core::Real + Into<f64>>(
    joint: &mut Joint<T>,
    walk: &Walk,
    taken: &[bool],
    batch: &Batch,
) -> (f64, f64) {
    let (mut worst, mut worst_sigma) = (0.0_f64, 0.0_f64);
    let mut compare = |difference: f64, variance: T, expected: f64| {
        worst = worst.max(difference.abs() / expected.sqrt());
        let ratio = (variance.into() / expected).sqrt();
        worst_sigma = worst_sigma.max((ratio - 1.0).abs());
    };
    if let Some((expected, variance)) = batch.baseline() {
        let pose = joint.pose(1).unwrap();
        let c = pose.covariance;
        compare(pose.position.x.into() - expected, c.m11, variance);
        // The frame says that it is right before the first one.
        assert_eq!([pose.position.y.into(), c.m22.into()], [0.0; 2]);
        let first = joint.pose(0).unwrap();
        assert_eq!(first.covariance.m11.into(), 0.0);
    }
    for camera in (2..walk.cameras.len()).filter(|&camera| taken[camera]) {
        let pose = joint.pose(camera).unwrap();
        let (expected, covariance) = batch.camera(camera).unwrap();
        let c = pose.covariance;
        let heading: f64 = pose.heading.into();
        compare(pose.position.x.into() - expected.x, c.m11, covariance.m11);
        compare(pose.position.y.into() - expected.y, c.m22, covariance.m22);
        compare(turn(heading, expected.z), c.m33, covariance.m33);
    }
    for stop in 0..walk.places.len() {
        let place = joint.place(stop).unwrap();
        let (expected, covariance) = batch.stop(stop);
        let c = place.covariance;
        compare(place.position.x.into() - expected.x, c.m11, covariance.m11);
        compare(place.position.y.into() - expected.y, c.m22, covariance.m22);
    }
    let carrier = joint.carrier().unwrap();
    let (expected, covariance) = batch.pair(0);
    let c = carrier.covariance;
    compare(carrier.scale.into() - expected.x, c.m11, covariance.m11);
    compare(carrier.compass.into() - expected.y, c.m22, covariance.m22);
    for camera in (0..walk.cameras.len()).filter(|&camera| taken[camera]) {
        if walk.lens_sigma > 0.0 {
            let lens = joint.lens(camera).unwrap();
            let (expected, variance) = batch.lens(camera);
            let sigma: f64 = lens.sigma.into();
            compare(
                lens.scale.into() - expected,
                number(sigma * sigma),
                variance,
            );
        }
    }
    let references = joint.reference_headings().unwrap();
    let (expected, covariance) = batch.pair(2);
    let c = references.covariance;
    let [first, second] = references.headings.map(Into::into);
    compare(wrap_signed(first - expected.x), c.m11, covariance.m11);
    compare(wrap_signed(second - expected.y), c.m22, covariance.m22);
    (worst, worst_sigma)
}

#[test]
fn equals_the_dense_batch() {
    for (name, errors) in CASES {
        for seed in 0..amount(4, 12) {
            let walk = Walk::random(&mut generator(seed), 9, 20, errors, 0.0024);
            let mut joint = filled::<f64>(&walk, WIDE);
            let solution = joint.solve().unwrap();
            let (worst, worst_sigma) = off(&mut joint, &walk);
            assert!(worst < 1e-3, "{name} {seed}: {worst:e} sigma off");
            assert!(
                worst_sigma < 1e-3,
                "{name} {seed}: sigmas {worst_sigma:e} off"
            );
            assert!(
                solution.cameras >= 7,
                "{name} {seed}: {} cameras",
                solution.cameras
            );
        }
    }
}

/// A distance between the references that is one of the unknowns: answers are the same whatever was told of it, in
/// double and in single precision.
#[test]
fn equals_the_dense_batch_without_a_baseline() {
    for (name, errors) in CASES {
        for seed in 0..amount(4, 12) {
            let walk = Walk::random(&mut generator(seed), 9, 20, errors, 0.0024);
            let right = walk.cameras[1].x;
            for told in [0.8 * right, 1.3 * right] {
                let mut joint = filled_with::<f64>(&walk, WIDE, [told, right]);
                let solution = joint.solve().unwrap();
                assert!(solution.cameras >= 7, "{name} {seed}: {solution:?}");
                let mut single = filled_with::<f32>(&walk, WIDE, [told, right]);
                single.solve().unwrap();
                let taken: Vec<bool> = (0..9).map(|n| joint.pose(n).is_ok()).collect();
                let prior = prior(&errors);
                let batch = Batch::solve_with(&walk, prior, false, |n| taken[n]).unwrap();
                let (worst, worst_sigma) = off_batch(&mut joint, &walk, &taken, &batch);
                assert!(
                    worst < 1e-3 && worst_sigma < 1e-3,
                    "{name} {seed}: {worst:e}, {worst_sigma:e}"
                );
                let (worst, worst_sigma) = off_batch(&mut single, &walk, &taken, &batch);
                assert!(
                    worst < 0.03 && worst_sigma < 0.005,
                    "{name} {seed} in single precision: {worst:e}, {worst_sigma:e}"
                );
            }
        }
    }
}

/// A target that walks past a mark again: the loop that it closes is one more measurement.
#[test]
fn equals_the_dense_batch_with_closed_loops() {
    let errors = CarrierErrors::UNKNOWN;
    for seed in 0..6 {
        let mut walk = Walk::random(&mut generator(seed), 7, 16, errors, 0.0024);
        let open = Batch::solve(&walk, prior(&errors), |_| false).unwrap();
        // Stops 3 and 11 are one place up to a hundredth, 5 is a mark that is visited once.
        walk.places[11] = walk.places[3];
        let (cameras, places) = (walk.cameras.clone(), walk.places.clone());
        walk = Walk::measured(&mut generator(seed), cameras, places, errors, 0.0024);
        for (stop, mark) in [(3, 0), (5, 1), (11, 0)] {
            let sigma = 0.01;
            walk.visits.push(Visited { stop, mark, sigma });
        }
        let mut joint = filled::<f64>(&walk, WIDE);
        joint.solve().unwrap();
        let (worst, worst_sigma) = off(&mut joint, &walk);
        assert!(
            worst < 1e-3 && worst_sigma < 1e-3,
            "{seed}: {worst:e}, {worst_sigma:e}"
        );
        let closed = joint.place(11).unwrap().covariance.m11;
        assert!(
            closed < open.stop(11).1.m11,
            "{seed}: a closed loop tells something"
        );
    }
}

/// With a range for every bearing.
#[test]
fn equals_the_dense_batch_with_ranges() {
    for seed in 0..6 {
        let errors = CarrierErrors::UNKNOWN;
        let mut walk = Walk::random(&mut generator(seed), 9, 20, errors, 0.0024);
        walk.range(&mut generator(seed), 0.03);
        let mut joint = filled::<f64>(&walk, WIDE);
        joint.solve().unwrap();
        let (worst, worst_sigma) = off(&mut joint, &walk);
        assert!(
            worst < 1e-3 && worst_sigma < 1e-3,
            "{seed}: {worst:e}, {worst_sigma:e}"
        );
    }
}

/// With every lens some percent off, and estimated; in double and in single precision. Then also with principal
/// columns that are half a degree off.
#[test]
fn equals_the_dense_batch_with_lenses() {
    for ((name, errors), principal) in CASES
        .into_iter()
        .flat_map(|case| [(case, 0.0), (case, 0.01)])
    {
        for seed in 0..amount(2, 6) {
            let walk = Walk::random(&mut generator(seed), 9, 20, errors, 0.0024);
            let walk = through_lenses(walk, seed, principal);
            let mut joint = filled::<f64>(&walk, WIDE);
            let solution = joint.solve().unwrap();
            let (worst, worst_sigma) = off(&mut joint, &walk);
            assert!(
                worst < 1e-3 && worst_sigma < 1e-3,
                "{name} {seed}: {worst:e}, {worst_sigma:e}"
            );
            assert!(solution.cameras >= 7, "{name} {seed}: {solution:?}");
            let mut single = filled::<f32>(&walk, WIDE);
            single.solve().unwrap();
            let (worst, worst_sigma) = off(&mut single, &walk);
            assert!(
                worst < 0.05 && worst_sigma < 0.005,
                "{name} {seed}: {worst:e}, {worst_sigma:e}"
            );
        }
    }
}

/// Single precision, as on a node: in posterior sigmas.
#[test]
fn single_precision_is_as_good() {
    for (name, errors) in CASES {
        let (mut worst, mut worst_sigma) = (0.0_f64, 0.0_f64);
        for seed in 0..amount(4, 12) {
            let walk = Walk::random(&mut generator(seed), 9, 32, errors, 0.0024);
            let mut joint = filled::<f32>(&walk, WIDE);
            joint.solve().unwrap();
            let (off, off_sigma) = off(&mut joint, &walk);
            worst = worst.max(off);
            worst_sigma = worst_sigma.max(off_sigma);
        }
        std::println!("{name}: {worst:e} sigma, sigmas {worst_sigma:e}");
        assert!(worst < 0.03, "{name}: {worst:e} sigma off");
        assert!(worst_sigma < 0.003, "{name}: sigmas {worst_sigma:e} off");
    }
}

/// Stop after stop, as a node does, ends where all at once ends.
#[test]
fn the_way_there_does_not_matter() {
    for seed in 0..8 {
        let walk = Walk::random(&mut generator(seed), 9, 20, CarrierErrors::UNKNOWN, 0.0024);
        let empty = Walk {
            places: Vec::new(),
            ..walk.clone()
        };
        let mut joint = filled::<f64>(&empty, WIDE);
        for stop in 0..walk.places.len() {
            add(&mut joint, &walk, stop);
            let solved = joint.solve();
            assert!(
                solved.is_ok() || stop < 4,
                "{seed}, stop {stop}: {solved:?}"
            );
        }
        let (worst, worst_sigma) = off(&mut joint, &walk);
        assert!(
            worst < 1e-3 && worst_sigma < 1e-3,
            "{seed}: {worst:e}, {worst_sigma:e}"
        );
    }
}

/// Walks so short that hardly anything is measured twice, where normal equations have least to hold on to.
#[test]
fn single_precision_is_as_good_with_hardly_any_redundancy() {
    let (mut worst, mut worst_sigma, mut solved) = (0.0_f64, 0.0_f64, 0);
    for (_, errors) in CASES {
        for seed in 0..24 {
            let walk = Walk::random(&mut generator(100 + seed), 6, 6, errors, 0.0024);
            let (mut single, mut double) = (filled::<f32>(&walk, WIDE), filled::<f64>(&walk, WIDE));
            let (Ok(_), Ok(_)) = (single.solve(), double.solve()) else {
                continue;
            };
            solved += 1;
            for camera in 2..6 {
                let (Ok(a), Ok(b)) = (single.pose(camera), double.pose(camera)) else {
                    continue;
                };
                let off = a.position.cast::<f64>() - b.position;
                let sigma = b.sigma_position();
                worst = worst.max(off.norm() / sigma);
                let turned = turn(a.heading.into(), b.heading).abs();
                worst = worst.max(turned / b.sigma_heading());
                let ratio = f64::from(a.sigma_position()) / sigma;
                worst_sigma = worst_sigma.max((ratio - 1.0).abs());
            }
        }
    }
    std::println!("{worst:e} sigma, sigmas {worst_sigma:e} off, {solved} walks");
    assert!(solved > 48, "{solved}");
    assert!(
        worst < 0.03 && worst_sigma < 0.01,
        "{worst:e}, {worst_sigma:e}"
    );
}
