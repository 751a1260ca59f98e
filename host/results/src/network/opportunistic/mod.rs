//! A network without displacements: cameras that saw a target together, and nothing else.
//!
//! Cameras that see the same things at the same time tell how they stand to each other, up to a
//! scale: the opportunistic observations of Lee and Aghajan, the thesis's reference \[1\]. `M` cameras
//! and `N` places have `3 M - 4 + 2 N` unknowns and up to `M N` bearings, so three cameras need five
//! places. One known distance gives the scale.
//!
//! Three cameras begin ([`three_views`]). Places that two cameras see are intersected, cameras that
//! see four known places are resected, and [bundle adjustment](adjustment) solves for all at once,
//! again and again until no camera comes in any more. Bearings that contradict are left out and named. Every
//! solution of the first three is followed: if two end up fitting as well as each other, the answer is
//! reported as ambiguous.

use std::collections::{BTreeMap, BTreeSet};

use calib_core::{Pose, Refusal, Status, angle};
use nalgebra::{Matrix3, Point2, Vector3};

use self::{
    adjustment::{Adjusted, Scene, Sight},
    growth::{Solved, UNCHECKED, grow},
    three_views::{Common, LEAST},
};
use super::{
    BearingResidual, Camera, Finding, MOST_SIGMA, NetworkError, NetworkSolution, Protection,
    ScaleFrom, Settings, Stop, limits,
};
use crate::record::{Estimate, sightings::Sightings};

mod adjustment;
mod growth;
mod matrix;
#[cfg(test)]
mod tests;
mod three_views;

/// Sets of three cameras that are tried as a start.
const STARTS: usize = 8;
/// Solutions of three cameras that are followed.
const FOLLOWED: usize = 4;

/// Sigmas of a test that one good measurement in 100,000 fails, plus those by which a fault has to
/// exceed them to be missed once in a thousand.
const DETECTED: f64 = 4.42 + 3.09;
/// Noise exceeds so many sigmas once in a thousand.
const NOISE: f64 = 3.09;
/// A redundancy below this counts as this much.
const LEAST_REDUNDANCY: f64 = 1e-4;

/// Everything that was measured, by number.
struct Measured {
    cameras: Vec<u16>,
    /// Target and stop.
    points: Vec<(u16, u32)>,
    sights: Vec<Sight>,
}

impl Measured {
    fn new(sightings: &Sightings) -> Self {
        let seen = || sightings.bearings.iter();
        let cameras: BTreeSet<_> = seen().map(|seen| seen.camera).collect();
        let points: BTreeSet<_> = seen().map(|seen| (seen.target, seen.stop)).collect();
        let cameras: Vec<_> = cameras.into_iter().collect();
        let points: Vec<_> = points.into_iter().collect();
        let sights = seen().filter_map(|seen| {
            Some(Sight {
                point: points.binary_search(&(seen.target, seen.stop)).ok()?,
                camera: cameras.binary_search(&seen.camera).ok()?,
                bearing: seen.bearing_deg.to_radians(),
                sigma: seen.sigma_deg.to_radians(),
                counts: true,
            })
        });
        let sights = sights.collect();
        Self {
            cameras,
            points,
            sights,
        }
    }

    fn sight(&self, point: usize, camera: usize) -> Option<&Sight> {
        { self.sights.iter() }.find(|sight| sight.point == point && sight.camera == camera)
    }

    /// Points that three cameras saw together.
    fn common(&self, cameras: [usize; 3]) -> Vec<Common> {
        (0..self.points.len())
            .filter_map(|point| {
                let [a, b, c] = cameras.map(|camera| self.sight(point, camera));
                let sights = [a?, b?, c?];
                Some(Common {
                    point,
                    bearings: sights.map(|sight| sight.bearing),
                    sigmas: sights.map(|sight| sight.sigma),
                })
            })
            .collect()
    }

    /// Sets of three cameras that saw enough together, those that saw most first.
    fn starts(&self) -> Vec<([usize; 3], Vec<Common>)> {
        let mut by_point: Vec<BTreeSet<usize>> = vec![BTreeSet::new(); self.points.len()];
        for sight in &self.sights {
            by_point[sight.point].insert(sight.camera);
        }
        let mut counts: BTreeMap<[usize; 3], usize> = BTreeMap::new();
        for seen in by_point {
            let seen: Vec<_> = seen.into_iter().collect();
            for (i, &a) in seen.iter().enumerate() {
                for (j, &b) in seen.iter().enumerate().skip(i + 1) {
                    for &c in seen.iter().skip(j + 1) {
                        *counts.entry([a, b, c]).or_default() += 1;
                    }
                }
            }
        }
        let mut counts: Vec<_> = counts
            .into_iter()
            .filter(|(_, count)| *count >= LEAST)
            .collect();
        counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        counts.truncate(STARTS);
        let starts = counts.into_iter();
        starts
            .map(|(three, _)| (three, self.common(three)))
            .collect()
    }
}

/// Solves a network of which only bearings were measured.
///
/// # Errors
/// [`NetworkError`].
pub(super) fn solve(
    sightings: &Sightings,
    settings: &Settings,
) -> Result<NetworkSolution, NetworkError> {
    let measured = Measured::new(sightings);
    let appointed = match sightings.references {
        None => None,
        Some(references) => {
            let number = |id: &u16| measured.cameras.binary_search(id);
            let numbers = [
                number(&references.cameras[0]),
                number(&references.cameras[1]),
            ];
            match numbers {
                [Ok(first), Ok(second)] => Some([first, second]),
                [Err(_), _] => return Err(NetworkError::NeverSaw(references.cameras[0])),
                _ => return Err(NetworkError::NeverSaw(references.cameras[1])),
            }
        }
    };
    let mut empty = empty(sightings, &measured, appointed);
    let starts = measured.starts();
    if starts.is_empty() {
        empty.reason = Some(Refusal::TooFew.name());
        empty.advice = Some(format!(
            "no three cameras saw the target together at {LEAST} places: stop it where three or more \
             see it"
        ));
        return Ok(empty);
    }
    let size = (measured.cameras.len(), measured.points.len());
    let mut solved: Vec<Solved> = Vec::new();
    for (three, common) in starts {
        let mut solutions = three_views::solutions(three, &common, size);
        solutions.truncate(FOLLOWED);
        for (_, scene) in solutions {
            if let Some(grown) = grow(&measured, scene) {
                solved.push(grown);
            }
        }
        // Another start is for cameras that the first ones do not reach, and for one that misled.
        let most = solved.iter().map(Solved::cameras).max().unwrap_or_default();
        if most == measured.cameras.len() {
            break;
        }
    }
    let reaches = |solved: &Solved| {
        let has = |camera: &usize| solved.scene.cameras[*camera].is_some();
        appointed.is_none_or(|two| two.iter().all(has))
    };
    solved.retain(|solved| reaches(solved));
    // Most bearings that count, then the best fit.
    solved.sort_by(|a, b| {
        let order = b.counting().cmp(&a.counting());
        order.then(a.adjusted.chi_squared.total_cmp(&b.adjusted.chi_squared))
    });
    let Some(best) = solved.first() else {
        empty.status = Status::Refused;
        empty.reason = Some(Refusal::Undetermined.name());
        empty.advice = Some(
            "the bearings give no solution that includes the references: let the cameras see the \
             target together at more places, spread over all of their view, or name two others"
                .to_owned(),
        );
        return Ok(empty);
    };
    let frame = appointed.unwrap_or_else(|| best.farthest());
    let mut framed = Vec::new();
    for mut other in solved {
        if other.put_into(frame).is_some() {
            framed.push(other);
        }
    }
    let Some(best) = framed.first() else {
        empty.status = Status::Refused;
        empty.reason = Some(Refusal::Undetermined.name());
        return Ok(empty);
    };
    let rival = framed.iter().skip(1).find(|other| best.rivals(other));
    let mut told = told(sightings, settings, &measured, best, empty);
    if let Some(rival) = rival {
        told.status = Status::Doubtful;
        told.reason = Some(NetworkSolution::AMBIGUOUS);
        told.advice = Some(format!(
            "another solution fits as well (chi squared {:.1}): let a further camera see the target \
             at the same places, or stop it at more",
            rival.adjusted.chi_squared
        ));
        for camera in &mut told.cameras {
            if camera.estimate.is_some() {
                camera.status = Status::Doubtful;
                camera.reason = Some(NetworkSolution::AMBIGUOUS);
            }
        }
    }
    Ok(told)
}

/// Most that a wrong bearing which no test notices moves a camera, without noise: as [`calib_core::joint`]
/// defines it.
fn protection(scene: &Scene, adjusted: &Adjusted, camera: usize) -> Protection {
    let counting = scene.sights.iter().filter(|sight| sight.counts);
    let moves = counting.filter_map(|sight| {
        let (_, redundancy) = scene.residual(adjusted, sight)?;
        let by = scene.influence(adjusted, sight, camera)?;
        Some(by * (DETECTED / redundancy.max(LEAST_REDUNDANCY).sqrt()))
    });
    moves.fold(
        Protection {
            position: 0.0,
            heading_deg: 0.0,
        },
        |most, by| Protection {
            position: most.position.max(by.xy().norm()),
            heading_deg: most.heading_deg.max(by.z.abs().to_degrees()),
        },
    )
}

fn empty(
    sightings: &Sightings,
    measured: &Measured,
    appointed: Option<[usize; 2]>,
) -> NetworkSolution {
    let targets: BTreeSet<_> = measured.points.iter().map(|(target, _)| *target).collect();
    let mut targets = targets.into_iter();
    NetworkSolution {
        network: sightings.network,
        target: targets.next().filter(|_| targets.next().is_none()),
        status: Status::Waiting,
        reason: None,
        advice: None,
        scale_from: ScaleFrom::Nothing,
        references: appointed.map(|two| two.map(|camera| measured.cameras[camera])),
        baseline: None,
        sigma_baseline: None,
        cameras: Vec::new(),
        stops: Vec::new(),
        left_out: Vec::new(),
        carrier: None,
        findings: Vec::new(),
        bearings: Vec::new(),
        ranges: Vec::new(),
        legs: Vec::new(),
        leg_factor: None,
        chi_squared: None,
        degrees_of_freedom: 0,
    }
}

/// The solution in the unit that the known distance gives it.
fn told(
    sightings: &Sightings,
    settings: &Settings,
    measured: &Measured,
    solved: &Solved,
    mut told: NetworkSolution,
) -> NetworkSolution {
    let Solved {
        scene,
        adjusted,
        left_out,
    } = solved;
    let known = sightings
        .references
        .and_then(|references| references.baseline);
    let unit = known.unwrap_or(1.0);
    let fit = solved.fit();
    (told.status, told.reason) = if fit.is_bad() {
        (Status::Doubtful, Some(NetworkSolution::CONTRADICTORY))
    } else if fit.degrees_of_freedom == 0 {
        told.advice = Some(
            "nothing checks this answer: stop the target at another place that three cameras see"
                .to_owned(),
        );
        (Status::Weak, Some(NetworkSolution::UNCHECKED))
    } else {
        (Status::Calibrated, None)
    };
    if known.is_some() {
        told.scale_from = ScaleFrom::Baseline;
    }
    told.references = Some(scene.frame.map(|camera| measured.cameras[camera]));
    (told.baseline, told.sigma_baseline) = (Some(unit), Some(0.0));
    (told.chi_squared, told.degrees_of_freedom) = (Some(fit.chi_squared), fit.degrees_of_freedom);
    let stretch = Matrix3::from_diagonal(&Vector3::new(unit, unit, 1.0));
    for (n, camera) in scene.cameras.iter().enumerate() {
        let own = || scene.sights.iter().filter(|sight| sight.camera == n);
        let reference = scene.frame.contains(&n);
        let redundancies = own().filter(|sight| sight.counts);
        let redundancies =
            redundancies.filter_map(|sight| Some(scene.residual(adjusted, sight)?.1));
        let least = redundancies.reduce(f64::min);
        let mut one = Camera {
            camera: measured.cameras[n],
            reference,
            status: Status::Waiting,
            reason: None,
            estimate: None,
            protection: None,
            redundancy: least,
            checked: false,
            lens: None,
            mirrored: false,
            mount: None,
            bearings: own().count(),
            used: own()
                .filter(|s| s.counts && scene.is_in_front(s).is_some())
                .count(),
        };
        if let Some(camera) = camera {
            let pose = Pose {
                position: Point2::from(camera.xy() * unit),
                heading: angle::wrap_positive(camera.z),
                covariance: stretch * adjusted.camera(n) * stretch,
            };
            one.estimate = Estimate::new(&pose);
            one.protection = (!reference).then(|| {
                let level = protection(scene, adjusted, n);
                Protection {
                    position: level.position * unit + NOISE * pose.sigma_position(),
                    heading_deg: level.heading_deg + NOISE * pose.sigma_heading().to_degrees(),
                }
            });
            let limits = limits(settings, unit);
            one.checked = one.protection.is_some_and(|level| limits.tolerate(&level));
            let is_weak = !reference && pose.sigma_position() > limits.sigma_position
                || pose.sigma_heading() > MOST_SIGMA;
            (one.status, one.reason) = match told.reason {
                Some(reason) => (told.status, Some(reason)),
                None if is_weak => (Status::Weak, None),
                None => (Status::Calibrated, None),
            };
        }
        told.cameras.push(one);
    }
    for (n, (target, stop)) in measured.points.iter().enumerate() {
        match (scene.points[n], adjusted.point(n)) {
            (Some(place), Some(covariance)) => {
                let c = covariance * (unit * unit);
                told.stops.push(Stop {
                    target: *target,
                    stop: *stop,
                    x: place.x * unit,
                    y: place.y * unit,
                    sigma_x: c.m11.max(0.0).sqrt(),
                    sigma_y: c.m22.max(0.0).sqrt(),
                    covariance: [c.m11, c.m12, c.m22],
                });
            }
            _ => told.left_out.push(*stop),
        }
    }
    for sight in &scene.sights {
        let Some((residual, redundancy)) = scene.residual(adjusted, sight) else {
            continue;
        };
        let (target, stop) = measured.points[sight.point];
        let is_checked = redundancy >= UNCHECKED;
        told.bearings.push(BearingResidual {
            target,
            stop,
            camera: measured.cameras[sight.camera],
            residual_deg: (residual * sight.sigma).to_degrees(),
            redundancy,
            normalised: is_checked.then(|| residual / redundancy.sqrt()),
            standing: if sight.counts { "counts" } else { "excluded" },
        });
    }
    for (n, off) in left_out {
        let sight = &scene.sights[*n];
        let (target, stop) = measured.points[sight.point];
        told.findings.push(Finding::Bearing {
            target,
            stop,
            camera: measured.cameras[sight.camera],
            off: *off,
        });
    }
    told
}
