//! Where to stop the target next, so that the cameras that want it learn most.
//!
//! Each candidate is a place in view of a camera. A sighting there adds `g g^T / v` to the
//! camera's information (see [`calib_core::resection`]); the best candidate shrinks the predicted
//! variances most, each in units of its limit, over all cameras that want a stop. The choice is
//! greedy: further stops are chosen as if the earlier ones had been made.
//!
//! Reference cameras without an answer count only stops that both of them see. All is in the frame
//! of one network, and near its targets' stops: what is far from all of them nobody can walk to, or
//! is no place at all, but in the view of a pose that is far off.

use std::f64::consts::PI;

use calib_core::{Pose, angle};
use nalgebra::{Matrix3, Point2, Vector3};

use super::{Limits, Node, RunRecord, View, verdict::NextStop};
use crate::recorded::sightings::USUAL_BEARING_SIGMA;

/// Places along the optical axis, in parts of the range.
const RANGES: [f64; 4] = [0.3, 0.5, 0.7, 0.9];
/// Bearings, in parts of half the field of view: blobs at the border would be cut off.
const BEARINGS: [f64; 7] = [-0.8, -0.5, -0.25, 0.0, 0.25, 0.5, 0.8];
/// Stops nearer to one another than this part of the range tell nearly the same.
const APART: f64 = 0.1;
/// More advice than this is not followed anyway.
const MOST: usize = 6;

/// A camera that wants to see the target again.
pub(super) struct Wish<'a> {
    pub(super) camera: &'a Node,
    /// Whether its pose says where it is, rather than the place where it was put.
    pub(super) believes: bool,
    /// It is a reference without an answer.
    pub(super) in_pair: bool,
}

struct Wanting {
    id: u16,
    pose: Pose<f64>,
    view: View,
    information: Matrix3<f64>,
    /// Stops that it certainly still needs.
    missing: usize,
    in_pair: bool,
}

/// What there is where a network is.
struct Ground<'a> {
    limits: &'a Limits,
    obstacles: Vec<Vec<Point2<f64>>>,
    /// Where targets stopped, or should have.
    been: Vec<Point2<f64>>,
    /// The references, if they have no answer.
    pair: Vec<Wanting>,
}

/// The best stops for these cameras of a network, at most a handful.
pub(super) fn propose(record: &RunRecord, network: u16, wishes: &[Wish<'_>]) -> Vec<NextStop> {
    let targets = || record.targets.iter().filter(|t| t.network == network);
    let planned = targets().flat_map(|target| &target.path);
    let stops = targets().flat_map(|target| &target.stops);
    let mut ground = Ground {
        limits: &record.limits,
        obstacles: record.obstacles_of(network),
        been: planned
            .map(|&place| place.into())
            .chain(stops.map(|stop| Point2::new(stop.x, stop.y)))
            .collect(),
        pair: Vec::new(),
    };
    if wishes.iter().any(|wish| wish.in_pair) {
        let references = record.cameras();
        let references = references.filter(|c| c.network == network && c.reference);
        ground.pair = references
            .filter_map(|camera| {
                let wish = Wish {
                    camera,
                    believes: true,
                    in_pair: true,
                };
                Wanting::new(record, &ground, &wish)
            })
            .collect();
    }
    let wanting = wishes.iter();
    let mut wanting: Vec<_> = wanting
        .filter_map(|wish| Wanting::new(record, &ground, wish))
        .collect();
    let mut stops: Vec<NextStop> = Vec::new();
    while stops.len() < MOST {
        wanting.retain(|camera| camera.missing > 0);
        let Some(stop) = ground.best(&wanting, &stops) else {
            break;
        };
        let place = Point2::new(stop.x, stop.y);
        for camera in wanting.iter_mut().filter(|c| stop.seen_by.contains(&c.id)) {
            camera.information += camera.gain(place);
            camera.missing -= 1;
        }
        stops.push(NextStop { network, ..stop });
    }
    stops
}

impl Ground<'_> {
    fn best(&self, wanting: &[Wanting], earlier: &[NextStop]) -> Option<NextStop> {
        let mut best: Option<(f64, NextStop)> = None;
        for (range, place) in wanting.iter().flat_map(Wanting::candidates) {
            let is_near = |other: Point2<f64>, part: f64| (place - other).norm() < part * range;
            let mut earlier = earlier.iter().map(|stop| Point2::new(stop.x, stop.y));
            let is_far = !self.been.is_empty() && !self.been.iter().any(|&been| is_near(been, 1.0));
            if is_far || earlier.any(|stop| is_near(stop, APART)) {
                continue;
            }
            let mut seen_by = Vec::new();
            let mut score = 0.0;
            for camera in wanting.iter().filter(|camera| self.counts(camera, place)) {
                let before = camera.spread(&camera.information, self.limits);
                let after = camera.spread(&(camera.information + camera.gain(place)), self.limits);
                if let (Some(before), Some(after)) = (before, after) {
                    score += (before / after).ln();
                    seen_by.push(camera.id);
                }
            }
            if score > best.as_ref().map_or(0.0, |(score, _)| *score) {
                let (x, y) = (place.x, place.y);
                let stop = NextStop {
                    network: 0,
                    x,
                    y,
                    seen_by,
                };
                best = Some((score, stop));
            }
        }
        best.map(|(_, stop)| stop)
    }

    /// Whether a stop there is one more for this camera.
    fn counts(&self, camera: &Wanting, place: Point2<f64>) -> bool {
        let others = self.pair.iter().filter(|_| camera.in_pair);
        camera.sees(place, self) && { others }.all(|other| other.sees(place, self))
    }
}

impl Wanting {
    fn new(record: &RunRecord, ground: &Ground<'_>, wish: &Wish<'_>) -> Option<Self> {
        let camera = wish.camera;
        let view = camera.view?;
        let estimate = camera.estimate.filter(|_| wish.believes);
        let estimate = estimate.map(|estimate| estimate.pose());
        let stands = camera.truth.or(camera.planned);
        let pose = estimate.or_else(|| stands.map(|place| place.pose()))?;
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
            in_pair: wish.in_pair,
        };
        if let Some(information) = known {
            wanting.information = information;
        } else if wish.in_pair {
            // What references saw is not told before they have an answer.
            let targets = record.targets.iter();
            let targets = targets.filter(|target| target.network == camera.network);
            for stop in targets.flat_map(|target| &target.stops) {
                let place = Point2::new(stop.x, stop.y);
                if ground.counts(&wanting, place) {
                    wanting.information += wanting.gain(place);
                }
            }
        } else {
            let stops = camera.residuals.iter().filter_map(|r| record.stop(r));
            for stop in stops {
                wanting.information += wanting.gain(Point2::new(stop.x, stop.y));
            }
        }
        Some(wanting)
    }

    /// Each with the range of the camera.
    fn candidates(&self) -> impl Iterator<Item = (f64, Point2<f64>)> + '_ {
        let half = (self.view.fov_deg / 2.0).to_radians();
        BEARINGS.into_iter().flat_map(move |bearing| {
            let (sin, cos) = (self.pose.heading + bearing * half).sin_cos();
            RANGES.map(|part| {
                let range = self.view.range;
                let off = nalgebra::Vector2::new(cos, sin) * range * part;
                (range, self.pose.position + off)
            })
        })
    }

    fn sees(&self, place: Point2<f64>, ground: &Ground<'_>) -> bool {
        let d = place - self.pose.position;
        let bearing = angle::wrap_signed(d.y.atan2(d.x) - self.pose.heading);
        bearing.abs() < 0.9 * (self.view.fov_deg / 2.0).to_radians()
            && d.norm() < 0.95 * self.view.range
            && d.norm() > 0.1 * self.view.range
            && !ground.obstacles.iter().any(|corners| {
                let next = corners.iter().cycle().skip(1);
                let mut edges = corners.iter().zip(next);
                edges.any(|(&a, &b)| crosses(self.pose.position, place, a, b))
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
pub(super) fn crosses(a: Point2<f64>, b: Point2<f64>, c: Point2<f64>, d: Point2<f64>) -> bool {
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
