//! Where to stop the target next, so that the cameras that want it learn most.
//!
//! Each candidate is a place in view of a camera. A sighting there adds `g g^T / v` to the
//! camera's information (see [`calib_core::resection`]); the best candidate shrinks the predicted
//! variances most, each in units of its limit, over all cameras that want a stop. The choice is
//! greedy: further stops are chosen as if the earlier ones had been made.

use std::f64::consts::PI;

use calib_core::{Pose, angle};
use nalgebra::{Matrix3, Point2, Vector3};

use super::{Limits, Node, RunRecord, View, verdict::NextStop};
use crate::recorded::sightings::USUAL_BEARING_SIGMA;

/// Places along the optical axis, in parts of the range.
const RANGES: [f64; 4] = [0.3, 0.5, 0.7, 0.9];
/// Bearings, in parts of half the field of view: blobs at the border would be cut off.
const BEARINGS: [f64; 7] = [-0.8, -0.5, -0.25, 0.0, 0.25, 0.5, 0.8];
/// More advice than this is not followed anyway.
const MOST: usize = 6;

/// A camera that wants to see the target again.
struct Wanting {
    id: u16,
    pose: Pose<f64>,
    view: View,
    information: Matrix3<f64>,
    /// Stops that it certainly still needs.
    missing: usize,
}

/// The best stops for these cameras, at most a handful.
pub(super) fn propose<'a>(
    record: &RunRecord,
    cameras: impl IntoIterator<Item = &'a Node>,
) -> Vec<NextStop> {
    let mut wanting: Vec<_> = cameras
        .into_iter()
        .filter_map(|camera| Wanting::new(record, camera))
        .collect();
    let mut stops = Vec::new();
    while stops.len() < MOST {
        wanting.retain(|camera| camera.missing > 0);
        let Some(stop) = best(record, &wanting) else {
            break;
        };
        let place = Point2::new(stop.x, stop.y);
        for camera in wanting.iter_mut().filter(|c| stop.seen_by.contains(&c.id)) {
            camera.information += camera.gain(place);
            camera.missing -= 1;
        }
        stops.push(stop);
    }
    stops
}

fn best(record: &RunRecord, wanting: &[Wanting]) -> Option<NextStop> {
    let mut best: Option<(f64, NextStop)> = None;
    for place in wanting.iter().flat_map(Wanting::candidates) {
        let mut seen_by = Vec::new();
        let mut score = 0.0;
        for camera in wanting.iter().filter(|camera| camera.sees(place, record)) {
            let before = camera.spread(&camera.information, &record.limits);
            let after = camera.spread(&(camera.information + camera.gain(place)), &record.limits);
            if let (Some(before), Some(after)) = (before, after) {
                score += (before / after).ln();
                seen_by.push(camera.id);
            }
        }
        if score > best.as_ref().map_or(0.0, |(score, _)| *score) {
            let (x, y) = (place.x, place.y);
            best = Some((score, NextStop { x, y, seen_by }));
        }
    }
    best.map(|(_, stop)| stop)
}

impl Wanting {
    fn new(record: &RunRecord, camera: &Node) -> Option<Self> {
        let view = camera.view?;
        let estimate = camera.estimate.map(|estimate| estimate.pose());
        let pose = estimate.or_else(|| camera.truth.map(|truth| truth.pose()))?;
        let known = estimate.and_then(|pose| pose.covariance.try_inverse());
        let mut wanting = Self {
            id: camera.id,
            pose,
            view,
            // Somewhere about here, looking anywhere.
            information: Matrix3::from_diagonal(&Vector3::new(
                view.range.powi(-2),
                view.range.powi(-2),
                PI.powi(-2),
            )),
            missing: match known {
                Some(_) => 1,
                None => 3_usize.saturating_sub(camera.sightings).max(1),
            },
        };
        match known {
            Some(information) => wanting.information = information,
            None => {
                let stops = camera.residuals.iter().filter_map(|r| record.stop(r));
                for stop in stops {
                    wanting.information += wanting.gain(Point2::new(stop.x, stop.y));
                }
            }
        }
        Some(wanting)
    }

    fn candidates(&self) -> impl Iterator<Item = Point2<f64>> + '_ {
        let half = (self.view.fov_deg / 2.0).to_radians();
        BEARINGS.into_iter().flat_map(move |bearing| {
            let (sin, cos) = (self.pose.heading + bearing * half).sin_cos();
            RANGES.map(|range| {
                let range = range * self.view.range;
                self.pose.position + nalgebra::Vector2::new(cos, sin) * range
            })
        })
    }

    fn sees(&self, place: Point2<f64>, record: &RunRecord) -> bool {
        let d = place - self.pose.position;
        let bearing = angle::wrap_signed(d.y.atan2(d.x) - self.pose.heading);
        bearing.abs() < 0.9 * (self.view.fov_deg / 2.0).to_radians()
            && d.norm() < 0.95 * self.view.range
            && d.norm() > 0.1 * self.view.range
            && !record.obstacles.iter().any(|outline| {
                let corners = outline.iter().map(|&[x, y]| Point2::new(x, y));
                let next = corners.clone().cycle().skip(1);
                corners
                    .zip(next)
                    .any(|(a, b)| crosses(self.pose.position, place, a, b))
            })
    }

    /// The information of a sighting of a target there.
    fn gain(&self, place: Point2<f64>) -> Matrix3<f64> {
        let d = place - self.pose.position;
        let range2 = d.norm_squared();
        let slope = Vector3::new(d.y / range2, -d.x / range2, -1.0);
        slope * slope.transpose() / USUAL_BEARING_SIGMA.powi(2)
    }

    /// The predicted variances in units of their limits; `None` of no information.
    fn spread(&self, information: &Matrix3<f64>, limits: &Limits) -> Option<f64> {
        let covariance = information.cholesky()?.inverse();
        let heading_limit = limits.sigma_heading_deg.to_radians();
        Some(
            (covariance.m11 + covariance.m22) / limits.sigma_position.powi(2)
                + covariance.m33 / heading_limit.powi(2),
        )
    }
}

/// Whether two segments cross.
fn crosses(a: Point2<f64>, b: Point2<f64>, c: Point2<f64>, d: Point2<f64>) -> bool {
    let side = |from: Point2<f64>, to: Point2<f64>, p: Point2<f64>| (to - from).perp(&(p - from));
    side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_segments_that_meet_between_their_ends_cross() {
        let p = Point2::new;
        assert!(crosses(p(0.0, 0.0), p(2.0, 2.0), p(0.0, 2.0), p(2.0, 0.0)));
        assert!(!crosses(p(0.0, 0.0), p(2.0, 2.0), p(3.0, 0.0), p(5.0, 9.0)));
        assert!(!crosses(p(0.0, 0.0), p(1.0, 0.0), p(0.0, 1.0), p(1.0, 1.0)));
    }
}
