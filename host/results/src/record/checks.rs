//! Why poses of a network are not checked, and where to stop so that they are: the planner's
//! [`Checks`], of cameras that stand where they are believed to.
//!
//! Measurements are taken from the record where it has them. Otherwise, as of a real network, they are those
//! that cameras told of their sightings, and those that the references must have seen.

use std::collections::{BTreeMap, BTreeSet};

use calib_core::{Pose, Status};
use nalgebra::{Matrix2, Point2, Vector2};
use node_firmware::config::{LensSigma, SurveySigma};
use site::planner::{
    CheckWish, Checks, Look, Measurement, Noise, RARE, Redundancy, Steps, Survey, Told, Tolerance,
    UNCHECKED,
};
use site::world::{Sight, World};

use super::{
    Limits, Node, RunRecord, Target,
    next_stop::{MOST, RADIUS, UNSEEN, obstacles, stands},
    sightings::Sightings,
    standing::Standing,
    verdict::{Gain, Gained, Instead, NextStop, Weakness, edges, is_free},
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
    /// Changes that help where no stop does.
    pub(super) instead: Vec<Instead>,
}

/// One target's walk through a network.
struct Walk<'a> {
    record: &'a RunRecord,
    target: &'a Target,
    /// The references first.
    cameras: Vec<&'a Node>,
    known: Redundancy,
    /// All that its cameras measured is there: without some of it no gain can be foretold.
    is_whole: bool,
}

/// Advice about these cameras of a network, none of them a reference, whose poses are not checked.
pub(super) fn of(record: &RunRecord, network: u16, unchecked: &[&Node]) -> Unchecked {
    let Some(walk) = Walk::longest(record, network, true) else {
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
            let weakness = if has_few {
                Weakness::TooFew
            } else {
                walk.weakness(level.by?)?
            };
            Some((id, weakness))
        })
        .collect();
    let stops = walk.stops(network, &indices);
    let instead = match &stops {
        Some(stops) if stops.is_empty() => walk.instead(&indices),
        _ => Vec::new(),
    };
    Unchecked {
        weaknesses,
        stops: stops.unwrap_or_default(),
        instead,
    }
}

/// Advice about weak poses.
#[derive(Debug, Default)]
pub(super) struct Weak {
    /// Where to stop next.
    pub(super) stops: Vec<NextStop>,
    /// Changes that help where no stop does.
    pub(super) instead: Vec<Instead>,
}

/// Returns true if a camera has a pose that is only less certain than asked for. One that is certain enough, and
/// weak because [too little tests it](Node::is_untested), wants what unchecked ones want.
pub(super) fn is_weak(camera: &Node, limits: &Limits) -> bool {
    camera.status == Some(Status::Weak) && camera.estimate.is_some() && !camera.is_untested(limits)
}

/// Keeps of these stops those that help weak cameras, none of them a reference, or that others want, and finds others
/// for weak cameras that none of them helps.
pub(super) fn weak(record: &RunRecord, network: u16, stops: Vec<NextStop>, weak: &[&Node]) -> Weak {
    let foretold = { (!weak.is_empty()).then(|| Walk::longest(record, network, true)) }.flatten();
    let Some((walk, world)) = foretold.and_then(|walk| {
        let world = walk.world().filter(|_| walk.is_whole)?;
        Some((walk, world))
    }) else {
        return Weak {
            stops,
            instead: Vec::new(),
        };
    };
    let index = |id: &u16| walk.cameras.iter().position(|camera| camera.id == *id);
    let wishing: Vec<usize> = weak.iter().filter_map(|camera| index(&camera.id)).collect();
    // Usual values in the place of measurements that are not told are only of that size.
    let is_measured = record.sightings.iter().any(|own| own.network == network);
    let limit = record.limits.sigma_position;
    let mut now = walk.known.clone();
    let (mut kept, mut helped) = (Vec::new(), BTreeSet::new());
    for mut stop in stops {
        let after = walk.after(&now, &world, Point2::new(stop.x, stop.y));
        let own: Vec<usize> = { stop.seen_by.iter().filter_map(&index) }
            .filter(|index| wishing.contains(index))
            .collect();
        let gain = walk.gain(&own, &now, &after);
        // Where all measurements do not tell why it is weak, they do not tell what helps it either.
        let is_unclear = |index: &usize| {
            let told = walk.cameras[*index].estimate;
            let told = told.map_or(0.0, |estimate| estimate.sigma_position());
            let least = if is_measured {
                UNCLEAR * told
            } else {
                limit.max(UNLIKE * told)
            };
            walk.known.sigma(*index).is_none_or(|sigma| sigma <= least)
        };
        let unclear: Vec<usize> = own.iter().copied().filter(is_unclear).collect();
        let others = stop
            .seen_by
            .iter()
            .any(|id| weak.iter().all(|camera| camera.id != *id));
        if gain.is_some_and(|gain| gain.is_enough()) {
            stop.helps = gain;
            helped.extend(stop.seen_by.iter().copied());
        } else if !unclear.is_empty() {
            helped.extend(unclear.iter().map(|&index| walk.cameras[index].id));
        } else if !others {
            continue;
        }
        kept.push(stop);
        now = after;
    }
    let left = weak.iter().filter(|camera| !helped.contains(&camera.id));
    let left: Vec<&Node> = left.copied().collect();
    let more = match left.is_empty() {
        true => Unchecked::default(),
        false => of(record, network, &left),
    };
    // In view of a camera that it is for, or else with a gain that is worth the way. No other gain is told.
    let helps = |stop: &NextStop| {
        { left.iter() }.any(|camera| stop.seen_by.contains(&camera.id))
            || stop.helps.is_none_or(|gain| gain.is_enough())
    };
    kept.extend(more.stops.into_iter().filter(helps).map(|stop| NextStop {
        helps: stop.helps.filter(Gain::is_enough),
        ..stop
    }));
    let mut instead = more.instead;
    if kept.is_empty() && instead.is_empty() {
        let left: Vec<usize> = left.iter().filter_map(|camera| index(&camera.id)).collect();
        instead = walk.instead(&left);
    }
    Weak {
        stops: kept,
        instead,
    }
}

/// Changes of the site that help the least certain of these cameras of a network.
pub(super) fn remedies(record: &RunRecord, network: u16, cameras: &[&Node]) -> Vec<Instead> {
    let Some(walk) = Walk::longest(record, network, true) else {
        return Vec::new();
    };
    let is_meant = |camera: &&Node| cameras.iter().any(|meant| meant.id == camera.id);
    let wishing = (2..walk.cameras.len()).filter(|&index| is_meant(&walk.cameras[index]));
    walk.instead(&wishing.collect::<Vec<_>>())
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
        let checkable = || {
            record
                .cameras()
                .filter(|camera| camera.is_checkable(&record.limits))
        };
        let checked = checkable().filter(|camera| camera.is_checked(&record.limits));
        let mut counts = Self {
            poses: [checked.count(), checkable().count()],
            ..Self::default()
        };
        let networks = record.networks.iter();
        for walk in networks.filter_map(|network| Walk::longest(record, network.network, false)) {
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
    /// The walk with most stops, with weak cameras too or without.
    fn longest(record: &'a RunRecord, network: u16, with_weak: bool) -> Option<Self> {
        let own = |node: &&Node| node.network == network && node.estimate.is_some();
        let limits = &record.limits;
        let is_sound = |node: &&Node| {
            let is_sure = node.is_calibrated() || node.is_untested(limits);
            (is_sure || with_weak && is_weak(node, limits)) && !node.reference
        };
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
        let is_measured = record.sightings.iter().any(|own| own.network == network);
        let has_all = |camera: &&Node| camera.residuals.len() >= camera.sightings;
        Some(Self {
            record,
            target,
            is_whole: is_measured || cameras.iter().skip(2).all(has_all),
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

    /// Its cameras, where they are believed to stand, and obstacles; `None` where it is not known what cameras see.
    fn world(&self) -> Option<World> {
        let standing: Option<Vec<_>> = { self.cameras.iter() }
            .map(|camera| stands(camera, true))
            .collect();
        let obstacles = obstacles(self.record, self.target.network).collect();
        Some(World::new(standing?, obstacles, Vec::new()))
    }

    /// The walk gone on with to a stop there.
    fn after(&self, now: &Redundancy, world: &World, place: Point2<f64>) -> Redundancy {
        let noise = Noise {
            columns: UNSEEN.columns,
            standing: 0.0,
        };
        let radius = RADIUS * now.survey().range;
        let looks = (0..self.cameras.len()).filter_map(|camera| {
            world.sight(camera, place, radius).filter(Sight::is_whole)?;
            Some((camera, noise.sigma(&world.cameras()[camera], place)))
        });
        now.with_stop(place, &looks.collect::<Vec<_>>())
    }

    /// `None` where it is not known what cameras see.
    fn stops(&self, network: u16, wishing: &[usize]) -> Option<Vec<NextStop>> {
        let world = self.world()?;
        let range = self.known.survey().range;
        let standing = Standing::of(self.record, network);
        let tolerance = tolerance(self.record);
        let wishes = wishing
            .iter()
            .map(|&camera| CheckWish { camera, tolerance });
        let checks = Checks {
            world: &world,
            radius: RADIUS * range,
            may_stand: &|place| standing.holds(place),
            columns: UNSEEN.columns,
            wishes: wishes.collect(),
        };
        let (stops, _) = checks.stops(self.known.clone(), MOST);
        let mut now = self.known.clone();
        let named = stops.into_iter().map(|stop| {
            let after = self.after(&now, &world, stop.place);
            let helps = self.gain(wishing, &now, &after);
            now = after;
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
                helps,
            }
        });
        Some(named.collect())
    }
}

/// Measurements that foretell no more than this share of a camera's own sigma do not tell why it is weak.
const UNCLEAR: f64 = 0.1;
/// The same of usual values in the place of measurements.
const UNLIKE: f64 = 0.3;
/// A gain below this share is none.
const LEAST_GAIN: f64 = 0.05;
/// So many measurements in common tie two cameras to one another.
const COMMON_STOPS: usize = 3;
/// Pairs of cameras that are tried as references.
const PAIRS: usize = 16;
/// A carrier that was measured: share of its ways, and its compass, degrees.
const MEASURED: [f64; 2] = [0.01, 1.0];
/// Gaps between cameras in which another one is tried.
const GAPS: usize = 8;
/// Sigma of a tape measure: metres, and a share of the distance.
const TAPE: [f64; 2] = [0.01, 0.01];
/// A wider lens, times the field of view.
const WIDER: f64 = 1.5;

impl Gain {
    /// Returns true if it is worth a stop or a change of the site.
    fn is_enough(&self) -> bool {
        self.to < (1.0 - LEAST_GAIN) * self.from
    }
}

impl Walk<'_> {
    /// Gain of the camera of these that gains most, from one state of knowledge to another.
    fn gain(&self, wishing: &[usize], before: &Redundancy, after: &Redundancy) -> Option<Gain> {
        if !self.is_whole {
            return None;
        }
        let [begun, old, new] = [&self.known, before, after].map(|walk| walk.levels(wishing));
        let gains = { wishing.iter().zip(begun) }
            .zip(old.iter().zip(new))
            .filter_map(|((&index, begun), (old, new))| {
                let node = self.cameras[index];
                // The model's own numbers are a little off those of the target: shares are not.
                Some(match node.status {
                    Some(Status::Weak) if is_weak(node, &self.record.limits) => {
                        let from = node.estimate?.sigma_position();
                        let begun = self.known.sigma(index)?;
                        Gain {
                            camera: node.id,
                            of: Gained::Sigma,
                            from: from * before.sigma(index)? / begun,
                            to: from * after.sigma(index)? / begun,
                        }
                    }
                    _ => {
                        let told = node.protection.map_or(begun.position, |told| told.position);
                        let scale = told / begun.position;
                        Gain {
                            camera: node.id,
                            of: Gained::Protection,
                            from: old.position * scale,
                            to: new.position * scale,
                        }
                    }
                })
            });
        gains.min_by(|a, b| f64::total_cmp(&(a.to / a.from), &(b.to / b.from)))
    }

    /// The worst of these cameras, when a change of the site makes its measurements these: the camera at this
    /// index now is at that one then.
    fn changed(&self, worst: usize, survey: Survey, then: impl Fn(usize) -> usize) -> Option<Gain> {
        self.gained(worst, survey.redundancy()?.sigma(then(worst))?)
    }

    /// The worst of these cameras, where a change of the site lowers the sigma of its place to this one.
    fn gained(&self, worst: usize, after: f64) -> Option<Gain> {
        let from = self.cameras[worst].estimate?.sigma_position();
        let to = from * after / self.known.sigma(worst)?;
        let gain = Gain {
            camera: self.cameras[worst].id,
            of: Gained::Sigma,
            from,
            to,
        };
        gain.is_enough().then_some(gain)
    }

    /// Changes of the site that help the least certain of these cameras, the best one first.
    fn instead(&self, wishing: &[usize]) -> Vec<Instead> {
        let sigma = |index: &usize| self.known.sigma(*index).unwrap_or_default();
        let worst = { wishing.iter().copied() }.max_by(|a, b| sigma(a).total_cmp(&sigma(b)));
        let Some(worst) = worst else {
            return Vec::new();
        };
        let same = |index: usize| index;
        let mut measured = self.known.survey().clone();
        let [scale, compass] = MEASURED;
        measured.steps.scale = measured.steps.scale.min(scale);
        measured.steps.compass = measured.steps.compass.min(compass.to_radians());
        let carrier = self.changed(worst, measured, same);
        let carrier = carrier.map(|gain| Instead::Carrier(self.target.id, gain));
        let lens = self
            .with_wider_lenses()
            .and_then(|survey| self.changed(worst, survey, same));
        let mut found: Vec<Instead> = carrier.into_iter().chain(lens.map(Instead::Lens)).collect();
        found.extend(self.other_references(worst));
        found.extend(self.camera_between(worst));
        found.extend(self.tape_measure(worst));
        found.sort_by(|a, b| a.gain().to.total_cmp(&b.gain().to));
        found
    }

    /// The pair of references that makes this camera most certain.
    fn other_references(&self, worst: usize) -> Option<Instead> {
        let survey = self.known.survey();
        let count = self.cameras.len();
        let seen: Vec<BTreeSet<usize>> = (0..count)
            .map(|camera| {
                let looks = survey.looks.iter().filter(|look| look.camera == camera);
                looks.map(|look| look.stop).collect()
            })
            .collect();
        let middle = |pair: [usize; 2]| {
            let [a, b] = pair.map(|camera| survey.cameras[camera].position.coords);
            let all = survey.cameras.iter().map(|pose| pose.position.coords);
            ((a + b) / 2.0 - all.sum::<Vector2<f64>>() / count as f64).norm()
        };
        let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b]));
        let mut pairs: Vec<[usize; 2]> = pairs
            .filter(|&[a, b]| b > 1 && a != worst && b != worst)
            .filter(|&[a, b]| seen[a].intersection(&seen[b]).count() >= COMMON_STOPS)
            .collect();
        pairs.sort_by(|a, b| middle(*a).total_cmp(&middle(*b)));
        let tried = pairs.into_iter().take(PAIRS).filter_map(|pair| {
            let mut order: Vec<usize> =
                (0..count).filter(|camera| !pair.contains(camera)).collect();
            order.splice(0..0, pair);
            let then = |camera: usize| {
                order
                    .iter()
                    .position(|&own| own == camera)
                    .unwrap_or(camera)
            };
            let mut changed = survey.clone();
            changed.cameras = order.iter().map(|&camera| survey.cameras[camera]).collect();
            for look in &mut changed.looks {
                look.camera = then(look.camera);
            }
            let gain = self.changed(worst, changed, then)?;
            Some(Instead::References(
                pair.map(|camera| self.cameras[camera].id),
                gain,
            ))
        });
        tried.min_by(|a, b| a.gain().to.total_cmp(&b.gain().to))
    }

    /// The place half way between two neighbours at which one more camera, like one of them, makes this one most certain.
    fn camera_between(&self, worst: usize) -> Option<Instead> {
        let survey = self.known.survey();
        let standing: Option<Vec<_>> = { self.cameras.iter() }
            .map(|camera| stands(camera, true))
            .collect();
        let standing = standing?;
        let network = self.target.network;
        let places: Vec<_> = survey.cameras.iter().map(|pose| pose.position).collect();
        let count = places.len();
        let length = |[a, b]: [usize; 2]| (places[a] - places[b]).norm();
        let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b]));
        let mut pairs: Vec<[usize; 2]> = pairs.collect();
        let aside = |[a, b]: [usize; 2]| {
            let middle = nalgebra::center(&places[a], &places[b]);
            (middle - places[worst]).norm() + length([a, b])
        };
        pairs.sort_by(|a, b| aside(*a).total_cmp(&aside(*b)));
        let radius = RADIUS * survey.range;
        let tried = pairs.into_iter().take(GAPS).flat_map(|pair| {
            let place = nalgebra::center(&places[pair[0]], &places[pair[1]]);
            pair.map(|like| (pair, like, place))
        });
        let found = tried.filter_map(|(pair, like, place)| {
            let mut more = standing[like];
            more.place = place;
            let obstacles = obstacles(self.record, network).collect();
            let world = World::new(vec![more], obstacles, Vec::new());
            let mut changed = survey.clone();
            let mut pose = survey.cameras[like];
            pose.position = place;
            changed.cameras.push(pose);
            let looks = { survey.stops.iter().enumerate() }.filter_map(|(stop, &at)| {
                world.sight(0, at, radius).filter(Sight::is_whole)?;
                Some(Look {
                    stop,
                    camera: count,
                    sigma: UNSEEN.sigma(&more, at),
                })
            });
            changed.looks.extend(looks);
            let gain = self.changed(worst, changed, |camera| camera)?;
            let between = pair.map(|camera| self.cameras[camera].id);
            Some(Instead::Camera(between, gain))
        });
        found.min_by(|a, b| a.gain().to.total_cmp(&b.gain().to))
    }

    /// The distance from this camera or a reference to one of its stops that makes it most certain, by a tape measure.
    fn tape_measure(&self, worst: usize) -> Option<Instead> {
        let survey = self.known.survey();
        let [metres, share] = TAPE;
        let least = metres / self.record.unit.metres;
        let edges = edges(&self.record.obstacles_of(self.target.network));
        let stops = survey.stops.iter().enumerate();
        let tried = stops.flat_map(|(stop, at)| [0, 1, worst].map(|camera| (stop, at, camera)));
        let found = tried.filter_map(|(stop, at, camera)| {
            let from = survey.cameras[camera].position;
            let sigma = least.max(share * (at - from).norm());
            is_free(&edges, from, *at).then_some(())?;
            let after = self.known.sigma_with_range(worst, [stop, camera], sigma)?;
            let gain = self.gained(worst, after)?;
            let stop = self.target.stops.get(stop)?.stop;
            Some(Instead::Tape {
                camera: self.cameras[camera].id,
                target: self.target.id,
                stop,
                gain,
            })
        });
        found.min_by(|a, b| a.gain().to.total_cmp(&b.gain().to))
    }

    /// The same walk before wider lenses.
    fn with_wider_lenses(&self) -> Option<Survey> {
        let standing: Option<Vec<_>> = { self.cameras.iter() }
            .map(|camera| {
                let mut wider = (*camera).clone();
                let view = wider.view.as_mut()?;
                view.fov_deg *= WIDER;
                stands(&wider, true)
            })
            .collect();
        let network = self.target.network;
        let world = World::new(
            standing?,
            obstacles(self.record, network).collect(),
            Vec::new(),
        );
        let mut survey = self.known.survey().clone();
        let radius = RADIUS * survey.range;
        let noise = Noise {
            columns: UNSEEN.columns,
            standing: 0.0,
        };
        let looks = survey.stops.iter().enumerate().flat_map(|(stop, &place)| {
            let cameras = 0..self.cameras.len();
            let world = &world;
            cameras.filter_map(move |camera| {
                world.sight(camera, place, radius).filter(Sight::is_whole)?;
                let sigma = noise.sigma(&world.cameras()[camera], place);
                Some(Look {
                    stop,
                    camera,
                    sigma,
                })
            })
        });
        survey.looks = looks.collect();
        Some(survey)
    }
}

impl Instead {
    /// Gain of the least certain camera.
    pub fn gain(&self) -> &Gain {
        match self {
            Self::Carrier(_, gain)
            | Self::References(_, gain)
            | Self::Lens(gain)
            | Self::Camera(_, gain) => gain,
            Self::Tape { gain, .. } => gain,
        }
    }
}

/// Levels that are tolerated, in the unit of the site and in radians.
fn tolerance(record: &RunRecord) -> Tolerance {
    let limits = &record.limits;
    [limits.sigma_position, limits.sigma_heading_deg.to_radians()].map(|limit| RARE * limit)
}

/// Knowledge that nodes had beforehand: as measured, or what they have where nothing more is told.
fn told(record: &RunRecord, measured: Option<&Sightings>) -> Told {
    let survey = SurveySigma::MEASURED;
    let usual = Told {
        lens: LensSigma::UNMEASURED.of_tangent().map(f64::from),
        baseline: Some(survey.baseline.into()),
        place: f64::from(survey.position) / record.unit.metres,
    };
    let Some(measured) = measured else {
        return usual;
    };
    let lens = measured.lens;
    let baseline = measured.references.and_then(|both| both.baseline);
    let survey = measured.survey;
    Told {
        lens: lens.map_or([0.0; 2], |lens| {
            [lens.sigma, lens.principal_deg.to_radians()]
        }),
        baseline: baseline.map(|_| survey.map_or(0.0, |survey| survey.baseline_sigma)),
        place: survey.map_or(0.0, |survey| survey.position_sigma),
    }
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
    let beforehand = told(record, measured);
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
        let carrier = measured.carriers.iter().find(|c| c.target == target.id);
        if let Some(carrier) = carrier {
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
            standing: carrier.map_or(0.0, |carrier| carrier.standing_sigma),
            steps,
            told: beforehand,
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
        told: beforehand,
        stops,
    })
}
