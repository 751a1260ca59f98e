//! From three cameras to all that can be reached.

use calib_core::{
    Pose, Ray, Sighting, angle,
    fit::{Fit, one_in_a_thousand},
    resection,
};
use nalgebra::{Matrix2, Point2, Rotation2, Vector2, Vector3};

use super::{
    Measured,
    adjustment::{Adjusted, Scene, Sight},
};

/// Bearings of a camera that comes in, so that they can contradict each other, before it may come
/// in with three.
const WITNESSED: usize = 4;
/// Bearings that make a pose.
const LEAST_SEEN: usize = 3;
/// Bearings off a consensus by more sigmas do not belong to it.
const GATE: f64 = 4.0;
/// A bearing that is so many sigmas off is left out: chance does so once in 100,000.
const WRONG: f64 = 4.42;
/// A bearing with less redundancy has none.
pub(super) const UNCHECKED: f64 = 0.02;
/// Solutions that agree in every pose to so many sigmas are one.
const SAME: f64 = 1.0;

/// A solution: everything that was found from one start.
pub(super) struct Solved {
    pub(super) scene: Scene,
    pub(super) adjusted: Adjusted,
    /// Bearings that were left out, with how many sigmas they are off.
    pub(super) left_out: Vec<(usize, f64)>,
}

/// From three cameras to all that can be reached.
pub(super) fn grow(measured: &Measured, start: Scene) -> Option<Solved> {
    let mut scene = Scene {
        sights: measured.sights.clone(),
        ..start
    };
    let mut adjusted = loop {
        intersect(&mut scene);
        let came = resect(&mut scene, WITNESSED) || resect(&mut scene, LEAST_SEEN);
        let settled = settle(&mut scene)?;
        if !came {
            break settled;
        }
    };
    let mut left_out = Vec::new();
    for _ in 0..8 + measured.sights.len() / 10 {
        let Some((worst, off)) = worst(&scene, &adjusted) else {
            break;
        };
        scene.sights[worst].counts = false;
        left_out.push((worst, off));
        adjusted = settle(&mut scene)?;
    }
    let is_in_front = |sight: &Sight| !sight.counts || scene.is_in_front(sight) != Some(false);
    scene.sights.iter().all(is_in_front).then_some(Solved {
        scene,
        adjusted,
        left_out,
    })
}

/// Goes to the minimum, without points that only one camera sees and cameras that see too little.
fn settle(scene: &mut Scene) -> Option<Adjusted> {
    let mut forgot = true;
    while std::mem::take(&mut forgot) {
        for point in 0..scene.points.len() {
            if scene.points[point].is_some() && scene.seen(point) < 2 {
                scene.points[point] = None;
                forgot = true;
            }
        }
        for camera in 0..scene.cameras.len() {
            let is_given = scene.frame.contains(&camera);
            let used = |sight: &&Sight| {
                sight.camera == camera && sight.counts && scene.points[sight.point].is_some()
            };
            let is_known = scene.cameras[camera].is_some() && !is_given;
            if is_known && scene.sights.iter().filter(used).count() < LEAST_SEEN {
                scene.cameras[camera] = None;
                forgot = true;
            }
        }
    }
    scene.adjust()
}

/// Points that are not known and that two cameras or more see.
fn intersect(scene: &mut Scene) {
    for point in 0..scene.points.len() {
        if scene.points[point].is_some() {
            continue;
        }
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        let mut rays = Vec::new();
        let sights = scene.sights.iter();
        for sight in sights.filter(|sight| sight.point == point && sight.counts) {
            if let Some(camera) = scene.cameras[sight.camera] {
                let angle = camera.z + sight.bearing;
                let across = Vector2::new(angle.sin(), -angle.cos());
                normal += across * across.transpose();
                right += across * across.dot(&camera.xy());
                rays.push((camera.xy(), Vector2::new(angle.cos(), angle.sin())));
            }
        }
        // Two rays that meet at less than two degrees tell no place.
        if rays.len() < 2 || normal.determinant() < 1e-3 {
            continue;
        }
        let place = normal.try_inverse().map(|inverse| inverse * right);
        let is_ahead = |place: &Vector2<f64>| {
            rays.iter()
                .all(|(from, along)| along.dot(&(place - from)) > 0.0)
        };
        scene.points[point] = place.filter(is_ahead).map(Point2::from);
    }
}

/// Adds cameras that are not known and that see at least so many known points. Returns true if one came in.
fn resect(scene: &mut Scene, least: usize) -> bool {
    let mut came = false;
    for camera in 0..scene.cameras.len() {
        if scene.cameras[camera].is_some() {
            continue;
        }
        let own = scene.sights.iter().filter(|sight| sight.camera == camera);
        let sightings: Vec<_> = own
            .filter_map(|sight| {
                let place = scene.points[sight.point]?;
                Some(Sighting::new(
                    place,
                    Ray::from_bearing(sight.bearing),
                    sight.sigma,
                ))
            })
            .collect();
        if sightings.len() < least {
            continue;
        }
        let mut dropped = vec![false; sightings.len()];
        // Places are less certain than bearings alone say.
        if let Ok(solution) = resection::solve_rejecting(&sightings, 5.0 * GATE, &mut dropped) {
            let Pose {
                position, heading, ..
            } = solution.pose;
            scene.cameras[camera] = Some(Vector3::new(position.x, position.y, heading));
            came = true;
        }
    }
    came
}

/// The bearing that is off most, if chance is not to blame.
fn worst(scene: &Scene, adjusted: &Adjusted) -> Option<(usize, f64)> {
    let normalised = scene.sights.iter().enumerate().filter_map(|(n, sight)| {
        let (residual, redundancy) = scene.residual(adjusted, sight)?;
        let is_checked = sight.counts && redundancy >= UNCHECKED;
        is_checked.then(|| (n, residual / redundancy.sqrt()))
    });
    let worst = normalised.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    worst.filter(|(_, off)| off.abs() > WRONG)
}

impl Solved {
    pub(super) fn cameras(&self) -> usize {
        self.scene.cameras.iter().flatten().count()
    }

    pub(super) fn counting(&self) -> usize {
        let sights = self.scene.sights.iter();
        let known = sights.filter(|sight| sight.counts && self.scene.is_in_front(sight).is_some());
        known.count()
    }

    pub(super) fn fit(&self) -> Fit<f64> {
        Fit {
            chi_squared: self.adjusted.chi_squared,
            degrees_of_freedom: self.adjusted.degrees_of_freedom,
        }
    }

    /// The two cameras that are farthest apart.
    pub(super) fn farthest(&self) -> [usize; 2] {
        let known = || {
            let cameras = self.scene.cameras.iter().enumerate();
            cameras.filter_map(|(n, camera)| Some((n, (*camera)?)))
        };
        let mut farthest = ([0, 1], -1.0);
        for (i, a) in known() {
            for (j, b) in known().filter(|(j, _)| *j > i) {
                let apart = (a.xy() - b.xy()).norm();
                if apart > farthest.1 {
                    farthest = ([i, j], apart);
                }
            }
        }
        farthest.0
    }

    /// Takes it to another frame, in which these two cameras are a unit apart.
    pub(super) fn put_into(&mut self, frame: [usize; 2]) -> Option<()> {
        let [first, second] = frame.map(|camera| self.scene.cameras[camera]);
        let (first, second) = (first?, second?);
        let baseline = second.xy() - first.xy();
        let turn = Rotation2::new(-baseline.y.atan2(baseline.x));
        let placed = |place: Vector2<f64>| turn * (place - first.xy()) / baseline.norm();
        for camera in self.scene.cameras.iter_mut().flatten() {
            let place = placed(camera.xy());
            *camera = Vector3::new(place.x, place.y, camera.z + turn.angle());
        }
        for point in self.scene.points.iter_mut().flatten() {
            *point = Point2::from(placed(point.coords));
        }
        self.scene.frame = frame;
        self.adjusted = self.scene.adjust()?;
        Some(())
    }

    /// Returns true if another solution fits as well, and is another one.
    pub(super) fn rivals(&self, other: &Self) -> bool {
        let counts = other.counting() + other.left_out.len() >= self.counting()
            && other.counting() + 2 >= self.counting();
        let worse = other.adjusted.chi_squared - self.adjusted.chi_squared;
        if !counts || worse >= one_in_a_thousand(1) {
            return false;
        }
        let both = self.scene.cameras.iter().zip(&other.scene.cameras);
        both.enumerate().any(|(n, both)| {
            let (Some(a), Some(b)) = both else {
                return false;
            };
            let covariance = self.adjusted.camera(n);
            let sigma = |i: usize| covariance[(i, i)].max(0.0).sqrt() * SAME + 1e-6;
            (a.x - b.x).abs() > sigma(0)
                || (a.y - b.y).abs() > sigma(1)
                || angle::wrap_signed(a.z - b.z).abs() > sigma(2)
        })
    }
}
