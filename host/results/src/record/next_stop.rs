//! Where to stop the target next, so that the cameras that want it learn most: the planner's
//! [`Advice`], of cameras that stand where they are believed to.
//!
//! All is in the frame of one network. The cameras' knowledge already counts: the information of their poses,
//! or that of the stops they saw; and each measures as well as its sightings show.

use calib_core::Pose;
use cmucam2_emulator::Lens;
use nalgebra::Point2;
use site::planner::{self, Advice, Noise, PairWish};
use site::world::{Camera, Mount, Obstacle, ObstacleShape, Variant, World};

use super::{
    Node, RunRecord, View, checks,
    standing::Standing,
    verdict::{Instead, NextStop},
};

/// A record does not tell how large a target is: about as large as the thesis's, as a part of the
/// camera's range.
pub(super) const RADIUS: f64 = 1.0 / 50.0;
/// Columns and rows of a picture, which it does not tell either: those of the smaller sensor.
const PICTURE: [u8; 2] = [88, 143];
/// More advice than this is not followed anyway.
pub(super) const MOST: usize = 6;

/// A camera that wants to see the target again.
pub(super) struct Wish<'a> {
    pub(super) camera: &'a Node,
    /// True if its pose says where it is, rather than the place where it was put.
    pub(super) believes: bool,
    /// It is a reference without an answer.
    pub(super) in_pair: bool,
}

impl Wish<'_> {
    /// The camera's number, and what else it is.
    pub(super) fn told(&self) -> (u16, bool, bool) {
        (self.camera.id, self.believes, self.in_pair)
    }
}

/// Stops, and changes of the site that help where no stop does.
#[derive(Clone, Debug, Default)]
pub(super) struct Proposed {
    pub(super) stops: Vec<NextStop>,
    pub(super) instead: Vec<Instead>,
}

/// The best stops for these cameras of a network, at most a handful. A stop before cameras that are only weak has
/// to make one of them more certain by all that is measured, with the carrier's ways.
pub(super) fn propose(record: &RunRecord, network: u16, wishes: &[Wish<'_>]) -> Proposed {
    let stops = informative(record, network, wishes);
    let weak = wishes.iter().map(|wish| wish.camera);
    // Places of references are given: only their own headings can be better known.
    let weak = weak.filter(|camera| checks::is_weak(camera, &record.limits) && !camera.reference);
    let weak: Vec<&Node> = weak.collect();
    let checks::Weak { stops, instead } = checks::weak(record, network, stops, &weak);
    Proposed { stops, instead }
}

/// The stops that tell most about cameras by themselves.
fn informative(record: &RunRecord, network: u16, wishes: &[Wish<'_>]) -> Vec<NextStop> {
    let (own, paired): (Vec<_>, Vec<_>) = wishes.iter().partition(|wish| !wish.in_pair);
    let references: Vec<&Node> = { record.cameras() }
        .filter(|camera| camera.network == network && camera.reference && !paired.is_empty())
        .collect();
    // The cameras of the planner's world: those who wish, then the references.
    let own: Vec<_> = own
        .into_iter()
        .filter_map(|wish| Some((wish, stands(wish.camera, wish.believes)?)))
        .collect();
    let pair: Option<Vec<Camera>> = references.iter().map(|node| stands(node, true)).collect();
    let pair = pair.filter(|pair| pair.len() == 2);
    let mut cameras: Vec<Camera> = own.iter().map(|(_, camera)| *camera).collect();
    let mut ids: Vec<u16> = own.iter().map(|(wish, _)| wish.camera.id).collect();
    let first = cameras.len();
    if let Some(pair) = &pair {
        cameras.extend(pair);
        ids.extend(references.iter().map(|node| node.id));
    }
    let Some(range) = cameras.iter().map(|camera| camera.range).reduce(f64::min) else {
        return Vec::new();
    };
    let world = World::new(cameras, obstacles(record, network).collect(), Vec::new());
    let radius = RADIUS * range;

    let targets = || record.targets.iter().filter(|t| t.network == network);
    let stops = || { targets().flat_map(|target| &target.stops) }.map(|s| Point2::new(s.x, s.y));
    let standing = Standing::of(record, network);
    let wishes = own.iter().enumerate().map(|(index, (wish, camera))| {
        let noise = noise(wish.camera, camera);
        let pose = wish.camera.estimate.filter(|_| wish.believes);
        let known = pose.and_then(|pose| pose.pose().covariance.try_inverse());
        let seen = wish.camera.residuals.iter().filter_map(|r| record.stop(r));
        let seen = seen.map(|s| planner::of_sighting(camera, Point2::new(s.x, s.y), &noise));
        planner::Wish {
            camera: index,
            missing: match known {
                Some(_) => 1,
                None => 3_usize.saturating_sub(wish.camera.sightings).max(1),
            },
            known: known.unwrap_or_else(|| {
                seen.fold(planner::Wish::nothing_known(camera.range), |a, b| a + b)
            }),
            noise,
        }
    });
    let advice = Advice {
        world: &world,
        radius,
        may_stand: &|place| standing.holds(place),
        wishes: wishes.collect(),
        pair: pair.map(|_| {
            let cameras = [first, first + 1];
            let see = |place: &Point2<f64>| {
                { cameras.iter() }.all(|&camera| world.sight(camera, *place, radius).is_some())
            };
            let sightings = references.iter().map(|node| node.sightings).min();
            PairWish {
                cameras,
                // References' sightings are not told before they have an answer.
                made: stops().filter(see).collect(),
                noise: UNSEEN,
                missing: 3_usize.saturating_sub(sightings.unwrap_or(0)).max(1),
            }
        }),
    };
    let named = |(place, seen_by): (Point2<f64>, Vec<usize>)| NextStop {
        network,
        x: place.x,
        y: place.y,
        again: None,
        helps: None,
        seen_by: seen_by.into_iter().map(|camera| ids[camera]).collect(),
    };
    advice.stops(MOST).into_iter().map(named).collect()
}

/// Obstacles, in the frame of a network. A record does not tell their heights: where one may hide, it does.
pub(super) fn obstacles(record: &RunRecord, network: u16) -> impl Iterator<Item = Obstacle> {
    let outlines = record.obstacles_of(network).into_iter();
    outlines.map(|outline| {
        let shape = match outline[..] {
            [a, b] => ObstacleShape::Segment([a, b]),
            _ => ObstacleShape::Polygon(outline),
        };
        shape.into()
    })
}

/// Place where it is believed to stand, or was put; `None` if that is not known, or what it sees.
pub(super) fn stands(node: &Node, believes: bool) -> Option<Camera> {
    let View { fov_deg, range } = node.view?;
    let estimate = node.estimate.filter(|_| believes);
    let estimate = estimate.map(|estimate| estimate.pose());
    let Pose {
        position, heading, ..
    } = estimate.or_else(|| node.truth.or(node.planned).map(|place| place.pose()))?;
    let [columns, rows] = PICTURE;
    let lens = |of| Lens::with_projection(of, fov_deg.to_radians(), columns, rows);
    use calib_core::camera::Projection::{EqualAngle, PinHole};
    Some(Camera {
        place: position,
        heading,
        mount: Mount::LEVEL,
        lens: lens(PinHole).or_else(|| lens(EqualAngle))?,
        range,
        variant: Variant::Cmucam2,
    })
}

/// Before anything is seen.
pub(super) const UNSEEN: Noise = Noise {
    columns: Noise::COLUMNS,
    standing: 0.0,
};

/// Noise of a camera: the median of its sightings' sigmas, in columns, with what the target's places had in
/// them.
fn noise(node: &Node, camera: &Camera) -> Noise {
    let mut columns: Vec<f64> = { node.residuals.iter() }
        .filter_map(|seen| {
            let sigma = (seen.residual_deg? / seen.normalised?).to_radians();
            let column = planner::column_angle(camera, seen.bearing_deg.to_radians());
            Some(sigma / column).filter(|sigma| sigma.is_finite() && *sigma > 0.0)
        })
        .collect();
    columns.sort_unstable_by(f64::total_cmp);
    Noise {
        columns: crate::accuracy::quantile(&columns, 0.5).unwrap_or(UNSEEN.columns),
        ..UNSEEN
    }
}
