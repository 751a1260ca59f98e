//! Targets that walk on: to the next stops that the verdict asks for, until every camera that can be calibrated is, and
//! every pose is checked; and the same way again, another day.

use std::{
    collections::{BTreeMap, BTreeSet},
    rc::Rc,
};

use nalgebra::Point2;
use results::record::{RunRecord, verdict::Verdict};

use super::{Simulation, outcome, walk::Orders};
use site::{Network, TargetNode, planner};
use virtual_hardware::executor::Time;

/// Count of the stops to which targets were led on.
pub(super) struct Further {
    most: usize,
    made: usize,
    orders: BTreeMap<u16, Rc<Orders>>,
    /// Best knowledge of each camera so far, before the last stops to which targets were led.
    best: Option<Vec<Known>>,
    /// So many times in turn, that was in vain.
    in_vain: usize,
    end: Option<FurtherEnd>,
}

/// Reason why targets are led to no further stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FurtherEnd {
    /// No more stops are allowed.
    Spent,
    /// The last stops improved nothing.
    InVain,
    /// The verdict asks for none.
    Unasked,
}

/// A camera's status, whether it is checked, its sigma, and what one wrong measurement could do to it.
type Known = (u16, [bool; 2], [f64; 2]);

/// Verdicts in turn that may be followed in vain.
const PATIENCE: usize = 2;

/// An improvement by less than this share is none.
const LEAST_GAIN: f64 = 0.02;

fn known(record: &RunRecord) -> Vec<Known> {
    let cameras = record.cameras().map(|camera| {
        let sigma = camera.estimate.map(|estimate| estimate.sigma_position());
        let level = camera.protection.map(|level| level.position);
        (
            camera.id,
            [camera.is_calibrated(), camera.is_checked(&record.limits)],
            [sigma, level].map(|value| value.unwrap_or(f64::INFINITY)),
        )
    });
    cameras.collect()
}

/// Returns true if some camera is better known than it ever was.
fn is_better(best: &[Known], now: &[Known]) -> bool {
    now.iter().zip(best).any(|((_, is, of), (_, was, had))| {
        let gains = { of.iter().zip(had) }.any(|(of, had)| *of < (1.0 - LEAST_GAIN) * had);
        gains || { is.iter().zip(was) }.any(|(is, was)| *is && !was)
    })
}

/// The best of both.
fn best_of(best: Vec<Known>, now: Vec<Known>) -> Vec<Known> {
    let both = best.into_iter().zip(now);
    let best = both.map(|((id, was, had), (_, is, of))| {
        (
            id,
            [0, 1].map(|n| is[n] || was[n]),
            [0, 1].map(|n| f64::min(had[n], of[n])),
        )
    });
    best.collect()
}

impl Further {
    /// Allows so many stops at most.
    pub(super) fn new(most: usize) -> Self {
        Self {
            most,
            made: 0,
            orders: BTreeMap::new(),
            best: None,
            in_vain: 0,
            end: None,
        }
    }

    /// Orders that lead a target on.
    pub(super) fn orders_of(&mut self, target: u16) -> Rc<Orders> {
        self.orders.entry(target).or_default().clone()
    }

    /// Returns true if targets may be led on.
    fn is_left(&self) -> bool {
        self.made < self.most
    }

    /// Reason why targets are led to no further stop.
    pub(super) fn end(&self) -> Option<FurtherEnd> {
        self.end
    }

    /// Stops to which targets were led.
    pub(super) fn made(&self) -> usize {
        self.made
    }
}

/// Leads targets on to the stops that the verdict asks for. Returns how long that may take; `None` if it asks
/// for no stop, or for more than are left.
pub(super) fn lead_on(simulation: &mut Simulation) -> Option<Time> {
    if !simulation.further.is_left() {
        simulation.further.end = Some(FurtherEnd::Spent);
        return None;
    }
    let record = outcome::record(simulation, 0.0, true);
    let now = known(&record);
    let best = simulation.further.best.as_ref();
    let is_in_vain = best.is_some_and(|best| !is_better(best, &now));
    let in_vain = if is_in_vain {
        simulation.further.in_vain + 1
    } else {
        0
    };
    simulation.further.in_vain = in_vain;
    if in_vain >= PATIENCE {
        simulation.further.end = Some(FurtherEnd::InVain);
        return None;
    }
    simulation.further.best = Some(match simulation.further.best.take() {
        Some(best) => best_of(best, now),
        None => now,
    });
    let verdict = Verdict::of(&record);
    let is_calibrated = |id: &u16| record.cameras().any(|c| c.id == *id && c.is_calibrated());
    let mut longest = None;
    let mut led = BTreeSet::new();
    for number in 0..simulation.site.networks.len() {
        let network = &simulation.site.networks[number];
        let frame = outcome::frame(simulation, network, &simulation.consoles[number]);
        let asked = verdict.next_stops.iter();
        let asked = asked.filter(|stop| usize::from(stop.network) == number + 1);
        // A target that went on into another network makes no joint estimates any more.
        let has_left = { simulation.site.networks.iter() }.any(|other| other.home == Some(number));
        let asked = asked.filter(|stop| !has_left || !stop.seen_by.iter().all(is_calibrated));
        let goals: Vec<_> = asked
            .map(|stop| frame.in_world(Point2::new(stop.x, stop.y)))
            .collect();
        // Cameras of a network without targets wait for those of another one.
        let guest = || walker(simulation, simulation.site.networks.get(network.home?)?);
        let target = walker(simulation, network).or_else(guest);
        let Some(target) = target.filter(|target| !led.contains(&target.id)) else {
            continue;
        };
        let left = simulation.further.most - simulation.further.made;
        let (id, stops) = (target.id, route(simulation, target, &goals, left));
        if stops.is_empty() {
            continue;
        }
        let here = simulation.world.borrow().targets()[target.index].place;
        let way: Vec<_> = std::iter::once(here).chain(stops.iter().copied()).collect();
        longest = longest.max(Some(simulation.patience(&way)));
        led.insert(id);
        simulation.further.made += stops.len();
        simulation.further.orders_of(id).give(stops);
    }
    if longest.is_none() {
        simulation.further.end = Some(FurtherEnd::Unasked);
    }
    longest
}

/// Sends all targets the way back, from where they were led on first to its begin. Returns how long that may take.
pub(super) fn walk_again(simulation: &mut Simulation) -> Time {
    simulation.walks += 1;
    let is_led = simulation.further.made > 0;
    let mut longest = 0;
    let targets = { simulation.site.networks.iter() }.flat_map(|network| &network.targets);
    let ways: Vec<_> = targets
        .map(|target| {
            let mut stops = target.stops.clone();
            if simulation.walks.is_multiple_of(2) {
                stops.reverse();
            }
            let (first, others) = stops.split_at(stops.len().min(1));
            // Else it stands there.
            let mut way = if is_led {
                route(simulation, target, first, usize::MAX)
            } else {
                Vec::new()
            };
            way.extend(others);
            longest = longest.max(simulation.patience(&stops) + simulation.patience(&way));
            (target.id, way)
        })
        .collect();
    for (id, way) in ways {
        simulation.further.orders_of(id).give(way);
    }
    longest
}

/// The target that is led on: the one with the most stops, whose walk the verdict is about.
fn walker<'a>(simulation: &Simulation, network: &'a Network) -> Option<&'a TargetNode> {
    let made = |target: &&TargetNode| {
        let stops = simulation.entry(target.id).stops.len();
        (stops, std::cmp::Reverse(target.id))
    };
    network.targets.iter().max_by_key(made)
}

/// The way there, around obstacles: over places where the target was, at which it stops too.
fn route(
    simulation: &Simulation,
    target: &TargetNode,
    goals: &[Point2<f64>],
    most: usize,
) -> Vec<Point2<f64>> {
    let world = simulation.world.borrow();
    let walking = &world.targets()[target.index];
    let mut here = walking.place;
    let mut been = target.stops.clone();
    let mut route = Vec::new();
    for &goal in goals {
        let way = planner::way_around(&world, walking.radius, &been, [here, goal]);
        route.extend(way);
        been.push(goal);
        here = goal;
    }
    route.truncate(most);
    route
}
