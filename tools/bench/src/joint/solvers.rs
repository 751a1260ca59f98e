//! Three ways to solve a walk, and their errors.

use calib_core::{
    Limits, Ray, Sighting,
    joint::{
        Capacity, JointError, JointEstimator, JointMemory, JointSettings, JointSolution, Leg,
        Prior, Progress,
    },
    reference::{self, Known, ReferenceSettings, Stop},
    resection,
};
use nalgebra::{Matrix2, Matrix3, Point2, Vector2, Vector3};
use test_support::{
    batch::Batch,
    walk::{CarrierErrors, Walk},
};

use super::geometry::degrees_off;

const CAMERAS: usize = 24;
pub(super) type Joint = JointEstimator<'static, f32>;

/// Memory for one walk. It is not given back: there are some thousand of them.
fn memory(walk: &Walk) -> JointMemory<'static, f32> {
    let room = Capacity {
        cameras: CAMERAS,
        stops: walk.places.len(),
        bearings: walk.bearings.len(),
        marks: 0,
    };
    JointMemory {
        cameras: vec![Default::default(); room.cameras].leak(),
        stops: vec![Default::default(); room.stops].leak(),
        bearings: vec![Default::default(); room.bearings].leak(),
        marks: &mut [],
        visits: &mut [],
        workspace: vec![0.0; room.workspace()].leak(),
    }
}

/// Errors of the cameras that are no references: of x, y and heading (degrees), and squared error over predicted
/// covariance.
#[derive(Default)]
pub(super) struct Errors {
    pub(super) poses: Vec<([f64; 3], f64)>,
}

/// One walk.
pub(super) struct Run {
    pub(super) joint: Option<Errors>,
    pub(super) batch: Option<Errors>,
    pub(super) open: Option<Errors>,
    /// Cameras that have three bearings.
    pub(super) able: usize,
    /// NEES of the joint solution: of reference headings, carrier, last stop.
    pub(super) nees: [f64; 3],
    pub(super) passes: usize,
}

/// Knowledge of the nodes about the carrier: the firmware's defaults for one of which nothing is known.
fn prior(errors: &CarrierErrors) -> [f64; 2] {
    if errors.scale > 1e-3 {
        [0.08, 3_f64.to_radians()]
    } else {
        [errors.scale, errors.compass]
    }
}

pub(super) fn solve(walk: &Walk, limits: &Limits<f64>) -> Run {
    let able = (2..walk.cameras.len()).filter(|&camera| walk.seen_by(camera) >= 3);
    let mut run = Run {
        joint: None,
        batch: None,
        open: open_loop(walk, limits),
        able: able.count(),
        nees: [0.0; 3],
        passes: 0,
    };
    let mut joint = filled(walk, limits, prior(&walk.errors));
    let Ok(solution) = joint.solve() else {
        return run;
    };
    run.passes = solution.passes;
    let mut errors = Errors::default();
    let mut taken = vec![false; walk.cameras.len()];
    for (n, truth) in walk.cameras.iter().enumerate().skip(2) {
        if let Ok(pose) = joint.pose(n) {
            taken[n] = true;
            let pose_at = Vector3::new(
                pose.position.x.into(),
                pose.position.y.into(),
                pose.heading.into(),
            );
            errors.add(truth, pose_at, &pose.covariance.cast());
        }
    }
    run.joint = Some(errors);
    if let Some(batch) = Batch::solve(walk, prior(&walk.errors), |camera| taken[camera]) {
        let mut errors = Errors::default();
        for (n, truth) in walk.cameras.iter().enumerate() {
            if let Some((pose, covariance)) = batch.camera(n) {
                errors.add(truth, pose, &covariance);
            }
        }
        run.batch = Some(errors);
    }
    run.nees = nees(&mut joint, walk);
    run
}

/// All steps of a round that has begun.
pub(super) fn finish(joint: &mut Joint) -> Result<JointSolution<f32>, JointError> {
    loop {
        if let Progress::Over(solution) = joint.step()? {
            return Ok(solution);
        }
    }
}

fn nees(joint: &mut Joint, walk: &Walk) -> [f64; 3] {
    let squared = |off: Vector2<f64>, covariance: Matrix2<f32>| {
        let inverse = covariance.cast::<f64>().try_inverse();
        inverse.map_or(f64::NAN, |inverse| off.dot(&(inverse * off)))
    };
    let last = walk.places.len() - 1;
    let (Ok(references), Ok(carrier), Ok(place)) = (
        joint.reference_headings(),
        joint.carrier(),
        joint.place(last),
    ) else {
        return [f64::NAN; 3];
    };
    let heading =
        |n: usize| degrees_off(references.headings[n].into(), walk.cameras[n].heading).to_radians();
    let carrier_off = Vector2::new(
        f64::from(carrier.scale) - walk.carrier[0],
        f64::from(carrier.compass) - walk.carrier[1],
    );
    [
        squared(Vector2::new(heading(0), heading(1)), references.covariance),
        squared(carrier_off, carrier.covariance),
        squared(place.position.cast() - walk.places[last], place.covariance),
    ]
}

impl Errors {
    fn add(&mut self, truth: &test_support::Truth, pose: Vector3<f64>, covariance: &Matrix3<f64>) {
        let heading = degrees_off(pose.z, truth.heading);
        let off = Vector3::new(pose.x - truth.x, pose.y - truth.y, heading.to_radians());
        let inverse = covariance.try_inverse();
        let nees = inverse.map_or(f64::NAN, |inverse| off.dot(&(inverse * off)));
        self.poses.push(([off.x, off.y, heading], nees));
    }
}

/// An estimator with all measurements, and the prior sigmas of scale and compass.
pub(super) fn filled(walk: &Walk, limits: &Limits<f64>, [scale, compass]: [f64; 2]) -> Joint {
    let mut settings = JointSettings::default();
    settings.scale = Prior {
        mean: 1.0,
        sigma: scale as f32,
    };
    settings.compass = Prior {
        mean: 0.0,
        sigma: compass as f32,
    };
    settings.limits = Limits {
        position: limits.position as f32,
        heading: limits.heading as f32,
    };
    let baseline = walk.cameras[1].x as f32;
    let mut joint = Joint::new(memory(walk), baseline, settings).expect("usable settings");
    for stop in 0..walk.places.len() {
        let leg = (stop > 0).then(|| Leg {
            displacement: walk.legs[stop - 1].displacement.cast(),
            covariance: walk.legs[stop - 1].covariance.cast(),
        });
        joint.add_stop(leg).expect("room for stops");
    }
    for seen in &walk.bearings {
        joint
            .add_bearing(
                seen.stop,
                seen.camera,
                seen.bearing as f32,
                seen.sigma as f32,
            )
            .expect("room for bearings");
    }
    joint
}

/// As the nodes do without: the references fix the target where both see it first, dead reckoning
/// is believed from then on, and each camera solves its own bearings.
fn open_loop(walk: &Walk, limits: &Limits<f64>) -> Option<Errors> {
    let at = |stop: usize, camera: usize| {
        walk.bearings
            .iter()
            .find(|seen| seen.stop == stop && seen.camera == camera)
    };
    let mut reckoned = vec![Point2::origin()];
    let mut covariances = vec![Matrix2::zeros()];
    for (n, leg) in walk.legs.iter().enumerate() {
        reckoned.push(reckoned[n] + leg.displacement);
        covariances.push(covariances[n] + leg.covariance);
    }
    let mut stops: Vec<Stop<f64>> = Vec::new();
    let mut common = Vec::new();
    for stop in 0..walk.places.len() {
        let (Some(a), Some(b)) = (at(stop, 0), at(stop, 1)) else {
            continue;
        };
        let before = common.last().copied().unwrap_or(stop);
        stops.push(Stop {
            rays: [a, b].map(|seen| Ray::from_bearing(seen.bearing)),
            bearing_sigmas: [a.sigma, b.sigma],
            displacement: reckoned[stop] - reckoned[before],
            displacement_covariance: covariances[stop] - covariances[before],
        });
        common.push(stop);
        if common.len() == 5 {
            break;
        }
    }
    let known = Known {
        baseline: Some(walk.cameras[1].x),
        frame_heading: Some(0.0),
    };
    let best = reference::solve(&stops, &known, &ReferenceSettings::default())
        .ok()?
        .best;
    let first = common[0];
    let shift = best.first_stop - reckoned[first];
    let mut errors = Errors::default();
    for (n, truth) in walk.cameras.iter().enumerate().skip(2) {
        let sightings: Vec<_> = { walk.bearings.iter() }
            .filter(|seen| seen.camera == n)
            .map(|seen| Sighting {
                target_covariance: covariances[seen.stop] - covariances[first],
                ..Sighting::new(
                    reckoned[seen.stop] + shift,
                    Ray::from_bearing(seen.bearing),
                    seen.sigma,
                )
            })
            .collect();
        let Ok(solution) = resection::solve(&sightings) else {
            continue;
        };
        let pose = solution.pose;
        if limits.allow(&pose) {
            let at = Vector3::new(pose.position.x, pose.position.y, pose.heading);
            errors.add(truth, at, &pose.covariance);
        }
    }
    Some(errors)
}
