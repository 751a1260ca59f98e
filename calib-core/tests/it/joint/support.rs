//! Estimators filled from walks.

use calib_core::{
    Limits, Real,
    joint::{Capacity, JointEstimator, JointMemory, JointSettings, Leg, Prior},
};
use test_support::{
    generator, normal,
    walk::{CarrierErrors, Walk},
};

pub(crate) const CAMERAS: usize = 16;
pub(crate) const MARKS: usize = 3;
pub(crate) type Joint<T> = JointEstimator<'static, T>;

/// Memory that the test keeps to its end.
pub(crate) fn memory<T: Real>(
    cameras: usize,
    stops: usize,
    bearings: usize,
    marks: usize,
) -> JointMemory<'static, T> {
    fn kept<V: Default + Clone>(count: usize) -> &'static mut [V] {
        vec![V::default(); count].leak()
    }
    let capacity = Capacity {
        cameras,
        stops,
        bearings,
        marks,
    };
    JointMemory {
        cameras: kept(cameras),
        stops: kept(stops),
        bearings: kept(bearings),
        marks: kept(marks),
        visits: kept(2 * marks),
        workspace: vec![T::zero(); capacity.workspace_with_lenses()].leak(),
    }
}

/// Limits that keep no camera out.
pub(crate) const WIDE: Limits<f64> = Limits {
    position: 3.0,
    heading: 0.5,
};

/// Sigmas of scale and compass.
pub(crate) fn prior(errors: &CarrierErrors) -> [f64; 2] {
    [errors.scale, errors.compass]
}

pub(crate) fn number<T: Real>(value: f64) -> T {
    nalgebra::convert(value)
}

/// An estimator that has all measurements of a walk.
pub(crate) fn filled<T: Real>(walk: &Walk, limits: Limits<f64>) -> Joint<T> {
    filled_with(walk, limits, [walk.cameras[1].x; 2])
}

/// The same with a baseline that may not be known: what is told of it and the right one differ.
pub(crate) fn filled_with<T: Real>(
    walk: &Walk,
    limits: Limits<f64>,
    baselines: [f64; 2],
) -> Joint<T> {
    let mut joint = empty(walk, limits, baselines);
    for stop in 0..walk.places.len() {
        add(&mut joint, walk, stop);
    }
    joint
}

/// The same without the ways to some stops: these were not measured.
pub(crate) fn filled_without_legs<T: Real>(
    walk: &Walk,
    limits: Limits<f64>,
    lost: &[usize],
) -> Joint<T> {
    let mut joint = empty(walk, limits, [walk.cameras[1].x; 2]);
    for stop in 0..walk.places.len() {
        add_after(&mut joint, walk, stop, stop > 0 && !lost.contains(&stop));
    }
    joint
}

/// An estimator that has no measurement of a walk.
fn empty<T: Real>(walk: &Walk, limits: Limits<f64>, [told, right]: [f64; 2]) -> Joint<T> {
    let mut settings = JointSettings::default();
    settings.scale = Prior {
        mean: T::one(),
        sigma: number(walk.errors.scale),
    };
    settings.compass = Prior {
        mean: T::zero(),
        sigma: number(walk.errors.compass),
    };
    settings.standing = T::zero();
    settings.tilt = number(0.0);
    settings.lens = (walk.lens_sigma > 0.0).then(|| number(walk.lens_sigma));
    settings.principal = (walk.principal_sigma > 0.0).then(|| number(walk.principal_sigma));
    // Of tests with lenses and ranges: these are of the size in the picture.
    settings.are_ranges_seen = walk.lens_sigma > 0.0;
    settings.is_baseline_known = told == right;
    settings.limits = Limits {
        position: number(limits.position),
        heading: number(limits.heading),
    };
    Joint::new(memory(CAMERAS, 64, 800, MARKS), number(told), settings).unwrap()
}

/// One stop with its bearings and visits.
pub(crate) fn add<T: Real>(joint: &mut Joint<T>, walk: &Walk, stop: usize) {
    add_after(joint, walk, stop, stop > 0);
}

fn add_after<T: Real>(joint: &mut Joint<T>, walk: &Walk, stop: usize, is_leg_measured: bool) {
    let leg = is_leg_measured.then(|| {
        let leg = &walk.legs[stop - 1];
        Leg {
            displacement: leg.displacement.map(number),
            covariance: leg.covariance.map(number),
        }
    });
    assert_eq!(joint.add_stop(leg), Ok(stop));
    for seen in walk.bearings.iter().filter(|seen| seen.stop == stop) {
        joint
            .add_bearing(stop, seen.camera, number(seen.bearing), number(seen.sigma))
            .unwrap();
    }
    for seen in walk.ranges.iter().filter(|seen| seen.stop == stop) {
        joint
            .add_range(stop, seen.camera, number(seen.range), number(seen.sigma))
            .unwrap();
    }
    for visit in walk.visits.iter().filter(|visit| visit.stop == stop) {
        joint
            .add_visit(stop, visit.mark, number(visit.sigma))
            .unwrap();
    }
}

/// The same walk with lenses that are 2 % off at one sigma, principal columns so much, and known to be no better.
pub(crate) fn through_lenses(mut walk: Walk, seed: u64, principal_sigma: f64) -> Walk {
    let mut rng = generator(seed ^ 0x1e45);
    walk.lens_sigma = 0.02;
    walk.principal_sigma = principal_sigma;
    for camera in 0..walk.cameras.len() {
        let scale = 1.0 + walk.lens_sigma * normal(&mut rng);
        let principal = match principal_sigma > 0.0 {
            true => principal_sigma * normal(&mut rng),
            false => 0.0,
        };
        walk.look_through(camera, scale, principal);
    }
    walk
}
