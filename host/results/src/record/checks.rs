//! Why poses of a network are not checked, and where to stop so that they are: the planner's
//! [`Checks`], of cameras that stand where they are believed to.
//!
//! Measurements are taken from the record where it has them. Otherwise, as of a real network, they are those
//! that cameras told of their sightings, and those that the references must have seen.

use std::collections::BTreeMap;

use calib_core::Pose;
use nalgebra::{Matrix2, Point2};
use site::planner::{
    CheckWish, Checks, Look, Measurement, RARE, Redundancy, Steps, Survey, Tolerance, UNCHECKED,
};
use site::world::World;

use super::{
    Node, RunRecord, Target,
    next_stop::{MOST, RADIUS, UNSEEN, obstacles, stands},
    verdict::{NextStop, Weakness},
};
use crate::network::usual_carrier;

/// Error of an unknown leg: a share of its length, along and across.
const USUAL_LEG: f64 = 0.02;
/// Distance that a target stands off its stops if it is not known, as a part of the range.
const USUAL_STANDING: f64 = 1.0 / 400.0;
/// Unknowns of a pose: so many sightings check nothing.
const UNKNOWNS: usize = 3;
/// Sigma of an unknown bearing, radians: a quarter of a column of 60 degrees.
const USUAL_BEARING: f64 = 0.003;

/// Advice about poses that are not checked.
#[derive(Debug, Default)]
pub(super) struct Unchecked {
    /// Measurement of each of these cameras that could be wrong unnoticed.
    pub(super) weaknesses: BTreeMap<u16, Weakness>,
    /// Where to stop next.
    pub(super) stops: Vec<NextStop>,
}

/// One target's walk through a network.
struct Walk<'a> {
    record: &'a RunRecord,
    target: &'a Target,
    /// The references first.
    cameras: Vec<&'a Node>,
    known: Redundancy,
}

/// Advice about these cameras of a network, none of them a reference, whose poses are not checked.
pub(super) fn of(record: &RunRecord, network: u16, unchecked: &[&Node]) -> Unchecked {
    let Some(walk) = Walk::longest(record, network) else {
        return Unchecked::default();
    };
    let named = |camera: &&&Node| {
        let index = { walk.cameras.iter() }.position(|other| other.id == camera.id)?;
        Some((index, camera.id))
    };
    let wishing: Vec<(usize, u16)> = unchecked.iter().filter_map(|c| named(&c)).collect();
    let indices: Vec<usize> = wishing.iter().map(|(index, _)| *index).collect();
    let levels = walk.known.levels(&indices);
    let weaknesses = { wishing.iter().zip(levels) }
        .filter_map(|(&(index, id), level)| {
            // Too few sightings leave open as much as a leg does, and are sooner mended.
            let has_few = walk.cameras[index].used <= UNKNOWNS;
            let own = Weakness::Sightings { camera: id };
            let weakness = if has_few {
                own
            } else {
                walk.weakness(level.by?)?
            };
            Some((id, weakness))
        })
        .collect();
    Unchecked {
        weaknesses,
        stops: walk.stops(network, &indices).unwrap_or_default(),
    }
}

/// Number of poses that are checked, and number that could be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Checked {
    /// Poses: of [checkable](Node::is_checkable) ones those that [are checked](Node::is_checked).
    pub poses: [usize; 2],
    /// Bearings whose errors would show in part, as far as the record tells them.
    pub bearings: [usize; 2],
    /// Legs from stop to stop, the same: in every direction.
    pub legs: [usize; 2],
}

impl Checked {
    /// Of a run.
    pub fn of(record: &RunRecord) -> Self {
        let checkable = || record.cameras().filter(|camera| camera.is_checkable());
        let checked = checkable().filter(|camera| camera.is_checked(&record.limits));
        let mut counts = Self {
            poses: [checked.count(), checkable().count()],
            ..Self::default()
        };
        let networks = record.networks.iter();
        for walk in networks.filter_map(|network| Walk::longest(record, network.network)) {
            for (of, share) in walk.known.shares() {
                let count = match of {
                    Measurement::Bearing { .. } => &mut counts.bearings,
                    Measurement::Leg { .. } => &mut counts.legs,
                };
                count[0] += usize::from(share >= UNCHECKED);
                count[1] += 1;
            }
        }
        counts
    }

    /// Both together.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        let sum = |a: [usize; 2], b: [usize; 2]| [a[0] + b[0], a[1] + b[1]];
        Self {
            poses: sum(self.poses, other.poses),
            bearings: sum(self.bearings, other.bearings),
            legs: sum(self.legs, other.legs),
        }
    }
}

impl<'a> Walk<'a> {
    /// The walk with most stops.
    fn longest(record: &'a RunRecord, network: u16) -> Option<Self> {
        let own = |node: &&Node| node.network == network && node.estimate.is_some();
        let is_sound = |node: &&Node| node.is_calibrated() && !node.reference;
        let cameras = || record.cameras().filter(own);
        let references: Vec<&Node> = cameras().filter(|camera| camera.reference).collect();
        let target = { record.targets.iter() }
            .filter(|target| target.network == network)
            .max_by_key(|target| (target.stops.len(), std::cmp::Reverse(target.id)))?;
        if references.len() != 2 {
            return None;
        }
        let mut cameras: Vec<&Node> = cameras().filter(is_sound).collect();
        cameras.splice(0..0, references);
        let known = survey(record, network, target, &cameras)?.redundancy()?;
        Some(Self {
            record,
            target,
            cameras,
            known,
        })
    }

    fn weakness(&self, by: Measurement) -> Option<Weakness> {
        Some(match by {
            Measurement::Bearing { camera, .. } => {
                let of = *self.cameras.get(camera)?;
                Weakness::Sightings { camera: of.id }
            }
            Measurement::Leg { stop } => {
                let number = |stop: usize| self.target.stops.get(stop).map(|stop| stop.stop);
                Weakness::Leg {
                    target: self.target.id,
                    from: number(stop.checked_sub(1)?)?,
                    to: number(stop)?,
                }
            }
        })
    }

    /// `None` where it is not known what cameras see.
    fn stops(&self, network: u16, wishing: &[usize]) -> Option<Vec<NextStop>> {
        let standing: Option<Vec<_>> = { self.cameras.iter() }
            .map(|camera| stands(camera, true))
            .collect();
        let world = World::new(
            standing?,
            obstacles(self.record, network).collect(),
            Vec::new(),
        );
        let range = self.known.survey().range;
        let others = { self.record.targets.iter() }.filter(|other| other.network == network);
        let been: Vec<Point2<f64>> = others
            .flat_map(|other| &other.path)
            .map(|&p| p.into())
            .collect();
        let tolerance = tolerance(self.record);
        let wishes = wishing
            .iter()
            .map(|&camera| CheckWish { camera, tolerance });
        let checks = Checks {
            world: &world,
            radius: RADIUS * range,
            bounds: [f64::NEG_INFINITY, f64::INFINITY].map(|end| Point2::new(end, end)),
            columns: UNSEEN.columns,
            wishes: wishes.collect(),
            been: &been,
        };
        let (stops, _) = checks.stops(self.known.clone(), MOST);
        let named = stops.into_iter().map(|stop| {
            let ids = |wanted: &dyn Fn(usize) -> bool| -> Vec<u16> {
                let seen = stop.seen_by.iter().filter(|&&camera| wanted(camera));
                seen.map(|&camera| self.cameras[camera].id).collect()
            };
            let own = ids(&|camera| wishing.contains(&camera));
            NextStop {
                network,
                x: stop.place.x,
                y: stop.place.y,
                again: stop.again.and_then(|again| {
                    let stop = self.target.stops.get(again)?;
                    Some(stop.stop)
                }),
                // A stop that ties others together also helps a camera that does not see it.
                seen_by: if own.is_empty() { ids(&|_| true) } else { own },
            }
        });
        Some(named.collect())
    }
}

/// Levels that are tolerated, in the unit of the site and in radians.
fn tolerance(record: &RunRecord) -> Tolerance {
    let limits = &record.limits;
    [limits.sigma_position, limits.sigma_heading_deg.to_radians()].map(|limit| RARE * limit)
}

/// Measurements of a walk.
fn survey(record: &RunRecord, network: u16, target: &Target, cameras: &[&Node]) -> Option<Survey> {
    let stops: Vec<Point2<f64>> = { target.stops.iter() }
        .map(|stop| Point2::new(stop.x, stop.y))
        .collect();
    let poses: Vec<Pose<f64>> = { cameras.iter() }
        .filter_map(|camera| Some(camera.estimate?.pose()))
        .collect();
    let ranges = cameras.iter().filter_map(|camera| Some(camera.view?.range));
    let around = stops.first()?;
    let farthest = poses.iter().map(|pose| (pose.position - around).norm());
    let range = { ranges.reduce(f64::min) }.or_else(|| farthest.reduce(f64::max))?;
    let index = |id: u16| cameras.iter().position(|camera| camera.id == id);
    let number = |stop: u32| target.stops.iter().position(|other| other.stop == stop);
    let measured = { record.sightings.iter() }.find(|measured| measured.network == network);
    let usual = usual_carrier(target.id);
    let mut steps = Steps {
        scale: usual.systematic_scale,
        compass: usual.systematic_heading_deg.to_radians(),
        leg: [USUAL_LEG; 2],
        least: USUAL_STANDING * range,
    };
    if let Some(measured) = measured {
        let looks = measured.bearings.iter().filter_map(|seen| {
            Some(Look {
                stop: number(seen.stop).filter(|_| seen.target == target.id)?,
                camera: index(seen.camera)?,
                sigma: seen.sigma_deg.to_radians(),
            })
        });
        let mut legs = vec![None; stops.len()];
        for leg in measured.legs.iter().filter(|leg| leg.target == target.id) {
            let [xx, xy, yy] = leg.covariance;
            if let Some(stop) = number(leg.stop) {
                // One that claims to be exact is not.
                let least = Matrix2::identity() * 1e-6;
                legs[stop] = Some(Matrix2::new(xx, xy, xy, yy) + least);
            }
        }
        if let Some(carrier) = measured.carriers.iter().find(|c| c.target == target.id) {
            steps.scale = carrier.systematic_scale;
            steps.compass = carrier.systematic_heading_deg.to_radians();
        }
        steps.learn(&stops, &legs);
        return Some(Survey {
            cameras: poses,
            range,
            looks: looks.collect(),
            stops,
            legs,
            standing: 0.0,
            steps,
            anchor: None,
        });
    }
    let told = cameras.iter().enumerate().flat_map(|(camera, node)| {
        let own = node.residuals.iter().filter(|r| r.target == target.id);
        own.filter_map(move |seen| {
            Some(Look {
                stop: number(seen.stop)?,
                camera,
                sigma: USUAL_BEARING,
            })
        })
    });
    let mut looks: Vec<Look> = told.collect();
    for (camera, node) in cameras.iter().enumerate().take(2) {
        if let (true, Some(standing)) = (node.residuals.is_empty(), stands(node, true)) {
            let world = World::new(
                vec![standing],
                obstacles(record, network).collect(),
                Vec::new(),
            );
            let seen = { stops.iter().enumerate() }
                .filter(|(_, place)| world.sight(0, **place, RADIUS * range).is_some());
            looks.extend(seen.map(|(stop, _)| Look {
                stop,
                camera,
                sigma: USUAL_BEARING,
            }));
        }
    }
    let legs = { stops.windows(2) }.map(|leg| Some(steps.covariance(leg[1] - leg[0])));
    Some(Survey {
        cameras: poses,
        range,
        looks,
        legs: std::iter::once(None).chain(legs).collect(),
        standing: USUAL_STANDING * range,
        anchor: { target.stops.first()?.believed }.map(|at| at.sigma_x.max(at.sigma_y)),
        steps,
        stops,
    })
}
