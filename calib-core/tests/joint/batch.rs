//! The same answer as a dense least squares over everything at once.

use calib_core::angle::wrap_signed;
use test_support::{
    generator, turn,
    walk::{Batch, CarrierErrors, Visited, Walk},
};

use crate::support::{Joint, MARKS, WIDE, filled, prior};

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
    let (mut worst, mut worst_sigma) = (0.0_f64, 0.0_f64);
    let mut compare = |difference: f64, variance: T, expected: f64| {
        worst = worst.max(difference.abs() / expected.sqrt());
        let ratio = (variance.into() / expected).sqrt();
        worst_sigma = worst_sigma.max((ratio - 1.0).abs());
    };
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
        for seed in 0..12 {
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
