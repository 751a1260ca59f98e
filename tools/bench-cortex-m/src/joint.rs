//! Rounds of joint estimation: too long to be repeated, so that each step is counted once.

use core::fmt;

use calib_core::{
    Real,
    joint::{
        BearingStorage, Capacity, JointEstimator, JointMemory, JointSettings, Leg, Progress, Round,
        StopStorage, UnknownStorage,
    },
    lit,
};
use nalgebra::{Matrix2, Point2, Vector2};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::measure::{Bench, Counter, Error};

const SEED: u64 = 2030;
const BASELINE: f32 = 10.0;
/// Standard deviations of a bearing, radians, and of a leg in each direction.
const BEARING_SIGMA: f32 = 0.0024;
const LEG_SIGMA: f32 = 0.02;

/// Counts the steps of rounds of 13, 24 and 98 cameras; of the last ones the lenses are estimated, too.
///
/// # Errors
/// As [`Bench::measure`].
pub fn measure_all<C: Counter, W: fmt::Write>(bench: &mut Bench<C, W>) -> Result<(), Error> {
    measure_thirteen(bench)?;
    measure_many(bench)?;
    measure_most(bench)
}

// Each for itself: there is no room on the stack for the arrays of all.
#[inline(never)]
fn measure_thirteen<C: Counter, W: fmt::Write>(bench: &mut Bench<C, W>) -> Result<(), Error> {
    let mut arrays = Thirteen::<f32>::new();
    let mut joint = walked(arrays.memory(), 4);
    bench.measure_steps("joint_13_cameras_32_stops_52_bearings", || {
        goes_on(joint.step())
    })
}

#[inline(never)]
fn measure_many<C: Counter, W: fmt::Write>(bench: &mut Bench<C, W>) -> Result<(), Error> {
    let mut arrays = Many::new();
    let mut joint = walked(arrays.memory(), 10);
    bench.measure_steps("joint_24_cameras_64_stops_240_bearings", || {
        goes_on(joint.step())
    })
}

#[inline(never)]
fn measure_most<C: Counter, W: fmt::Write>(bench: &mut Bench<C, W>) -> Result<(), Error> {
    let mut arrays = Most::new();
    let mut joint = walked_with(arrays.memory(), 4, lenses());
    bench.measure_steps("joint_98_cameras_100_stops_392_bearings", || {
        goes_on(joint.step())
    })
}

/// Settings of a node: lenses as the data sheet of a camera tells them.
fn lenses() -> JointSettings<f32> {
    let mut settings = JointSettings::default();
    settings.lens = Some(0.05);
    settings.principal = Some(0.01);
    settings
}

/// Solves the round of 13 cameras in one stretch, and hands the estimator to `look`.
pub(crate) fn solve_thirteen<T: Real, R>(look: impl FnOnce(&mut JointEstimator<'_, T>) -> R) -> R {
    let mut arrays = Thirteen::<T>::new();
    let mut joint = walked(arrays.memory(), 4);
    while goes_on(joint.step()) {}
    look(&mut joint)
}

fn goes_on<T: Real, E: fmt::Debug>(step: Result<Progress<T>, E>) -> bool {
    !matches!(step.expect("a walk that can be solved"), Progress::Over(_))
}

/// An estimator's memory on the stack.
struct Arrays<T: Real, const C: usize, const S: usize, const B: usize, const W: usize> {
    cameras: [UnknownStorage<T>; C],
    stops: [StopStorage<T>; S],
    bearings: [BearingStorage<T>; B],
    workspace: [T; W],
}

/// For 13 cameras.
type Thirteen<T> = Arrays<T, 13, 32, 52, { room(13, 32, 52) }>;

/// For 24 cameras.
type Many = Arrays<f32, 24, 64, 240, { room(24, 64, 240) }>;

/// For 98 cameras.
type Most = Arrays<f32, 98, 100, 392, { room(98, 100, 392) }>;

const fn room(cameras: usize, stops: usize, bearings: usize) -> usize {
    Capacity {
        cameras,
        stops,
        bearings,
        marks: 0,
    }
    .workspace_with_lenses()
}

impl<T: Real, const C: usize, const S: usize, const B: usize, const W: usize>
    Arrays<T, C, S, B, W>
{
    fn new() -> Self {
        Self {
            cameras: [UnknownStorage::default(); C],
            stops: [StopStorage::default(); S],
            bearings: [BearingStorage::default(); B],
            workspace: [T::zero(); W],
        }
    }

    fn memory(&mut self) -> JointMemory<'_, T> {
        JointMemory {
            cameras: &mut self.cameras,
            stops: &mut self.stops,
            bearings: &mut self.bearings,
            marks: &mut [],
            visits: &mut [],
            workspace: &mut self.workspace,
        }
    }
}

/// Cameras around an area, `each` bearings of every one of them, and a round that has begun: solve, check, legs'
/// noise and protection levels. The measurements are the same in any precision.
fn walked<T: Real>(memory: JointMemory<'_, T>, each: usize) -> JointEstimator<'_, T> {
    walked_with(memory, each, JointSettings::default())
}

fn walked_with<T: Real>(
    memory: JointMemory<'_, T>,
    each: usize,
    settings: JointSettings<T>,
) -> JointEstimator<'_, T> {
    let real = |number: f32| lit::<T>(number.into());
    let (cameras, stops) = (memory.cameras.len(), memory.stops.len());
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut joint = JointEstimator::new(memory, real(BASELINE), settings).expect("usable settings");
    let mut before: Option<Point2<f32>> = None;
    for stop in 0..stops {
        let mut place = || random.random_range(2.0..8.0_f32);
        let place = Point2::new(place(), place());
        let leg = before.map(|before| Leg {
            displacement: (place - before + off(&mut random) * LEG_SIGMA).map(real),
            covariance: Matrix2::from_diagonal_element(real(LEG_SIGMA * LEG_SIGMA)),
        });
        before = Some(place);
        joint.add_stop(leg).expect("room for stops");
        for camera in 0..cameras {
            // References together, the others each at its own times.
            let first = if camera < 2 { 0 } else { camera };
            let since = (stop + stops - first % stops) % stops;
            let apart = stops / each;
            if !since.is_multiple_of(apart) || since / apart >= each {
                continue;
            }
            let (at, heading) = camera_at(camera);
            let bearing = libm::atan2f(place.y - at.y, place.x - at.x) - heading;
            let noisy = bearing + off(&mut random).x * BEARING_SIGMA;
            let seen = joint.add_bearing(stop, camera, real(noisy), real(BEARING_SIGMA));
            seen.expect("room for bearings");
        }
    }
    joint.begin(Round {
        findings: 4,
        leg_noise: true,
        protection: true,
    });
    joint
}

/// References at both ends of the baseline, the others on a circle.
fn camera_at(camera: usize) -> (Point2<f32>, f32) {
    let middle = Vector2::new(5.0, 5.0);
    let at = match camera {
        0 => Vector2::zeros(),
        1 => Vector2::new(BASELINE, 0.0),
        _ => {
            let angle = camera as f32 * 2.4;
            middle + Vector2::new(libm::cosf(angle), libm::sinf(angle)) * 7.0
        }
    };
    let to_middle = middle - at;
    (at.into(), libm::atan2f(to_middle.y, to_middle.x))
}

/// Two numbers of mean zero and variance one.
fn off(random: &mut impl Rng) -> Vector2<f32> {
    let mut sum = || (0..12).map(|_| random.random_range(-0.5..0.5_f32)).sum();
    Vector2::new(sum(), sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All cameras get a pose, and it is where they stand.
    #[test]
    fn they_end_with_the_poses() {
        let mut arrays = Thirteen::<f32>::new();
        let mut joint = walked(arrays.memory(), 4);
        while goes_on(joint.step()) {}
        assert_eq!(joint.bearings(), 52);
        for camera in 2..13 {
            let pose = joint.pose(camera).unwrap();
            let (at, heading) = camera_at(camera);
            let nees = pose.normalised_error(at, heading).unwrap();
            assert!(nees < 25.0, "{camera}: {nees}");
        }
        let mut arrays = Many::new();
        let many = walked(arrays.memory(), 10);
        assert_eq!(many.bearings(), 240);
        let mut arrays = Most::new();
        let mut most = walked_with(arrays.memory(), 4, lenses());
        assert_eq!(most.bearings(), 392);
        while goes_on(most.step()) {}
        let told = (2..98).filter(|camera| most.pose(*camera).is_ok()).count();
        assert!(told > 90, "{told}");
    }
}
