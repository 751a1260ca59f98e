//! Cameras that saw enough once the last fault was over.

use std::collections::BTreeSet;

use nalgebra::{Matrix3, Point2};
use results::record::{Limits, RunRecord};
use site::{
    Action, Scenario, ScriptedEvent,
    planner::{Noise, of_sighting},
    world::World,
};

/// A camera is to be calibrated if the bound of its sigmas is below this share of their limits. The best pose
/// could reach that bound, with a carrier that errs nowhere.
const SHARE_OF_LIMIT: f64 = 0.4;

/// A pose needs so many places.
const PLACES: usize = 3;

/// After so many sightings a camera that was bumped is to be found out.
const NOTICED_AFTER: usize = 3;

/// Places nearer to each other than this are one, units.
const APART: f64 = 0.3;

/// A target so near to the border of the picture is not counted on, columns.
const BORDER_COLUMNS: f64 = 4.0;

/// The node, if it never recovers from a power cut, a plug or a picture.
fn broken_for_good(event: &ScriptedEvent, end_s: f64) -> Option<u16> {
    let over = event.at_s + event.action.duration_s()?;
    let (Action::PowerCut { node, .. }
    | Action::UnplugCamera { node, .. }
    | Action::StickCamera { node, .. }) = event.action
    else {
        return None;
    };
    (over >= end_s).then_some(node)
}

/// Time when the last fault was over, seconds; of nodes that stay broken, when they broke.
fn last_fault_s(scenario: &Scenario, end_s: f64) -> f64 {
    let over = scenario.events.iter().map(|event| {
        let lasts = match (&event.action, event.action.duration_s()) {
            // Frames heard in that time come again with their pauses.
            (Action::Replay { last_s, .. }, _) => *last_s,
            (_, Some(for_s)) if event.at_s + for_s < end_s => for_s,
            _ => 0.0,
        };
        event.at_s + lasts
    });
    over.fold(0.0, f64::max)
}

/// The world as it is in the end, with all cameras at their places after bumps.
fn world(scenario: &Scenario) -> Option<(World, Vec<u16>)> {
    let site = scenario.put_up().ok()?;
    let mut world = site.world;
    let cameras: Vec<u16> = site.networks[0]
        .cameras
        .iter()
        .map(|camera| camera.id)
        .collect();
    for event in &scenario.events {
        if let Action::BumpCamera { node, by, turn_deg } = event.action
            && let Some(index) = cameras.iter().position(|id| *id == node)
        {
            let camera = world.cameras()[index];
            let place = camera.place + nalgebra::Vector2::from(by);
            world.move_camera(index, place, camera.heading + turn_deg.to_radians());
        }
    }
    Some((world, cameras))
}

/// Cameras that were moved or turned, and since then saw the target too seldom for it to be noticed.
pub fn bumped_unseen(scenario: &Scenario, record: &RunRecord) -> BTreeSet<u16> {
    let Some(((world, ids), told)) = world(scenario).zip(record.in_building()) else {
        return BTreeSet::new();
    };
    let radius = radius(&world);
    let bumps = scenario
        .events
        .iter()
        .filter_map(|event| match event.action {
            Action::BumpCamera { node, .. } => Some((node, event.at_s)),
            _ => None,
        });
    let unseen = bumps.filter(|&(node, at_s)| {
        let index = ids.iter().position(|id| *id == node);
        let since = stops_after(&told, at_s);
        index.is_none_or(|index| {
            let seen = { since.iter() }.filter(|(seconds, stop)| {
                is_in_view(&world, index, radius, *stop) && !is_blind(scenario, node, *seconds)
            });
            seen.count() < NOTICED_AFTER
        })
    });
    unseen.map(|(node, _)| node).collect()
}

/// Returns true if a camera sees nothing at this time, or no picture but an old one.
fn is_blind(scenario: &Scenario, camera: u16, seconds: f64) -> bool {
    scenario.events.iter().any(|event| match event.action {
        Action::UnplugCamera { node, for_s, .. } | Action::StickCamera { node, for_s } => {
            node == camera && (event.at_s..event.at_s + for_s).contains(&seconds)
        }
        _ => false,
    })
}

/// The stops that targets told of after a time, in seconds.
fn stops_after(told: &RunRecord, since_s: f64) -> Vec<(f64, Point2<f64>)> {
    let stops = told.targets.iter().flat_map(|target| &target.stops);
    let after = stops.filter_map(|stop| {
        let seconds = stop.seconds.filter(|at| *at > since_s)?;
        Some((seconds, Point2::new(stop.x, stop.y)))
    });
    after.collect()
}

fn radius(world: &World) -> f64 {
    world.targets().first().map_or(0.0, |target| target.radius)
}

/// Cameras of the first network that are whole, and after the last fault were in view of stops from
/// which a pose well within the limits can be had.
pub fn well_served(scenario: &Scenario, record: &RunRecord) -> BTreeSet<u16> {
    // In the coordinates of the file.
    let Some(((world, ids), told)) = world(scenario).zip(record.in_building()) else {
        return BTreeSet::new();
    };
    let end_s = record.sim_seconds;
    let since_s = last_fault_s(scenario, end_s);
    let broken: BTreeSet<u16> = { scenario.events.iter() }
        .filter_map(|event| broken_for_good(event, end_s))
        .collect();
    let calm: Vec<_> = { stops_after(&told, since_s).into_iter() }
        .map(|(_, stop)| stop)
        .collect();
    let radius = radius(&world);
    let served = (0..).zip(ids).filter(|&(index, id)| {
        !broken.contains(&id) && sees_enough(&world, index, radius, &calm, &record.limits)
    });
    served.map(|(_, id)| id).collect()
}

/// Returns true if a camera sees all of a target there, and not at the border of its picture, beyond which the
/// blob may go on.
fn is_in_view(world: &World, index: usize, radius: f64, stop: Point2<f64>) -> bool {
    let half_view = world.cameras()[index].lens.bearing(BORDER_COLUMNS).abs();
    world
        .sight(index, stop, radius)
        .is_some_and(|sight| sight.is_whole() && sight.bearing.abs() + sight.half_width < half_view)
}

fn sees_enough(
    world: &World,
    index: usize,
    radius: f64,
    stops: &[Point2<f64>],
    limits: &Limits,
) -> bool {
    let camera = &world.cameras()[index];
    let noise = Noise {
        columns: Noise::COLUMNS,
        standing: 0.02,
    };
    let mut places: Vec<Point2<f64>> = Vec::new();
    let mut information = Matrix3::zeros();
    for &stop in stops {
        if !is_in_view(world, index, radius, stop) {
            continue;
        }
        // A place seen twice is one place.
        if places.iter().all(|place| (place - stop).norm() > APART) {
            places.push(stop);
            information += of_sighting(camera, stop, &noise);
        }
    }
    let covariance = information.try_inverse();
    places.len() >= PLACES
        && covariance.is_some_and(|covariance| {
            let position = (covariance.m11 + covariance.m22).sqrt();
            let heading = covariance.m33.sqrt().to_degrees();
            position < SHARE_OF_LIMIT * limits.sigma_position
                && heading < SHARE_OF_LIMIT * limits.sigma_heading_deg
        })
}
