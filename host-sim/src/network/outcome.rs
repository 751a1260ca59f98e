//! The record of a run.

use std::collections::BTreeMap;

use calib_core::{Sighting, level::Row};
use nalgebra::Point2;
use node_firmware::{config::RoleConfig as Configured, facts::KeptSighting, message::Duty};
use results::view;

use super::{FurtherEnd, Simulation, console::Console, journal::NodeEntry, measured};
use results::record::{
    self, Believed, FORMAT, Failure, Limits, Node, Place, Radio, Role, RunRecord, Stop, Target,
    Unit, View, heading_degrees,
    sightings::Sightings,
    space::{Hung, Told},
    summary::Summary,
};
use site::{CameraNode, Frame, Network};
use virtual_hardware::{executor::Time, medium::Reason};

/// Preamble, start of frame and length.
const PHY_HEADER: u64 = 6;

/// Time within which a camera answers when a target has stopped.
const ANSWER: Time = 10_000_000_000;

/// Rows from which a height is found, at most.
const ROWS: usize = 16;

/// Limits that the first camera was told.
fn limits(simulation: &Simulation) -> Limits {
    let mut cameras = simulation.nodes.iter().filter_map(|node| {
        let Configured::Camera(camera) = &node.config().settings().role else {
            return None;
        };
        Some(view::limits(camera))
    });
    cameras.next().unwrap_or(Limits {
        sigma_position: 0.0,
        sigma_heading_deg: 0.0,
    })
}

/// The record so far; without sightings, there are none of them in it.
pub(super) fn record(
    simulation: &Simulation,
    wall_seconds: f64,
    with_sightings: bool,
) -> RunRecord {
    let scenario = &simulation.scenario;
    let mut nodes = Vec::new();
    let mut targets = Vec::new();
    let (mut obstacles, mut area) = (Vec::new(), Vec::new());
    let mut first = None;
    let mut records = Vec::new();
    let mut measured = Vec::new();
    let (mut numbers, mut stops) = (Numbers::new(), BTreeMap::new());
    for (network, console) in simulation.site.networks.iter().zip(&simulation.consoles) {
        let frame = frame(simulation, network, console);
        for target in &network.targets {
            let entry = simulation.entry(target.id);
            let made = self::stops(&entry, target.id, &frame, &mut numbers);
            stops.insert(target.id, made);
        }
    }
    let networks = simulation.site.networks.iter().zip(&simulation.consoles);
    for (number, (network, console)) in (0..).zip(networks) {
        let references = references(network, console);
        let frame = frame(simulation, network, console);
        let first = *first.get_or_insert(frame);
        let known = console.view().network();
        let written = simulation.written.get(usize::from(number));
        let meant = references.map(|place| network.cameras[place].id);
        let meant = written.and_then(|written| match network.home {
            Some(_) => simulation.scenario.building_frame(written),
            None => written.frame_between(meant),
        });
        records.push(record::Network {
            network: number + 1,
            frame: within(&frame, &first),
            building: meant.as_ref().map(view::building_place),
            pan: known.map(|network| network.pan),
            channel: known.map(|network| network.channel),
            ball_height: Some(network.ball_height),
        });
        if number == 0 {
            let all = simulation.site.world.obstacles().iter();
            obstacles.extend(all.map(|obstacle| view::outline(obstacle, &frame)));
            area = view::area(&scenario.world, &frame);
        }
        let of_network = |id, role| Node {
            network: number + 1,
            ..Node::new(id, role)
        };
        let mut coordinator = of_network(site::coordinator_id(number), Role::Coordinator);
        coordinator.health = console.view().health();
        nodes.push(with_traffic(simulation, coordinator));
        for target in &network.targets {
            let entry = simulation.entry(target.id);
            let stops = stops.remove(&target.id).unwrap_or_default();
            targets.push(Target {
                id: target.id,
                network: number + 1,
                path: stops.iter().map(|stop| [stop.x, stop.y]).collect(),
                stops,
            });
            let mut node = of_network(target.id, Role::Target);
            if let Some(member) = console.view().member(node.id) {
                member.describe(&mut node);
            }
            // Its carrier led it on, and it said nothing.
            node.silent = has_missed(simulation, &entry, arrivals(&entry));
            nodes.push(with_traffic(simulation, node));
        }
        let told = measured::target_config(simulation, network)
            .map(|target| Told::new(target, Some(network.ball_height)));
        for (place, camera) in network.cameras.iter().enumerate() {
            let mut node = of_network(camera.id, Role::Camera);
            node.reference = network.home.is_none() && references.contains(&place);
            node.expected = true;
            describe(&mut node, simulation, &frame, network.ball_height, camera);
            if let Some(member) = console.view().member(node.id) {
                member.describe(&mut node);
            }
            let entry = simulation.entry(camera.id);
            let sightings = sightings(camera.id, &entry, console, &numbers);
            // A reference's sightings from before its solution are not part of that solution.
            if !sightings.is_empty() && !node.reference {
                node.set_sightings(
                    sightings
                        .iter()
                        .map(|(target, stop, s)| (*target, *stop, s)),
                );
            }
            if let Some(told) = &told {
                let rows = rows(simulation, camera.id, console, &numbers, &targets);
                node.set_hung(&rows, told);
            }
            let view = console.view();
            let member = view.member(node.id);
            if member.is_none_or(|member| member.report.is_none()) && !node.reference {
                node.sightings = sightings.len();
            }
            let is_absent = member.is_some_and(|member| member.absent);
            node.silent = is_absent || is_silent(simulation, network, &node, &entry);
            node.calibrated_seconds = entry.calibrated.map(seconds);
            nodes.push(with_traffic(simulation, node));
        }
        let references = references.map(|place| network.cameras[place].id);
        if with_sightings {
            measured.push(Sightings {
                network: number + 1,
                ..measured::sightings(simulation, network, references, console, &numbers)
            });
        }
    }
    nodes.sort_by_key(|node| node.id);
    targets.sort_by_key(|target| target.id);
    let sim_seconds = seconds(simulation.executor.clock().time());
    RunRecord {
        format: FORMAT,
        scenario: scenario.name.clone(),
        path: scenario.recorded_path(),
        published: { scenario.published.clone() }.filter(|_| scenario.scattered_by.is_none()),
        seed: Some(scenario.seed),
        unit: Unit {
            name: scenario.unit.clone(),
            metres: scenario.metres_per_unit(),
        },
        limits: limits(simulation),
        networks: records,
        summary: Summary::of(&nodes),
        nodes,
        targets,
        sightings: measured,
        obstacles,
        area,
        radio: Some(radio(simulation, sim_seconds)),
        tracking: simulation.tracking.clone(),
        stops_in_vain: simulation.further_end() == Some(FurtherEnd::InVain),
        sim_seconds,
        wall_seconds: Some(wall_seconds),
    }
}

/// The frame in which a network reports.
pub(super) fn frame(simulation: &Simulation, network: &Network, console: &Console) -> Frame {
    let home = network.home.and_then(|home| {
        let mut homes = { simulation.site.networks.iter() }.zip(&simulation.consoles);
        homes.nth(home)
    });
    let (network, console) = home.unwrap_or((network, console));
    simulation.site.frame(network, references(network, console))
}

/// Pose of a frame in another one.
fn within(frame: &Frame, other: &Frame) -> Place {
    let origin = other.place(frame.origin);
    Place::new(
        origin.x,
        origin.y,
        heading_degrees(other.direction(frame.heading)),
    )
}

fn seconds(time: Time) -> f64 {
    time as f64 * 1e-9
}

/// Number of a stop in the record, by its target and the target's own number of it.
pub(super) type Numbers = BTreeMap<(u16, u16), u32>;

/// A target's stops, counted from 1 in the order in which it told of them.
fn stops(entry: &NodeEntry, target: u16, frame: &Frame, numbers: &mut Numbers) -> Vec<Stop> {
    let mut stops: Vec<_> = entry.stops.iter().collect();
    stops.sort_by_key(|(_, stop)| stop.at);
    let counted = (1..).zip(stops).map(|(count, (told, stop))| {
        numbers.insert((target, *told), count);
        let truth = frame.place(stop.truth);
        Stop {
            stop: count,
            seconds: Some(seconds(stop.at)),
            x: truth.x,
            y: truth.y,
            believed: stop.believed.as_ref().map(believed),
        }
    });
    counted.collect()
}

fn believed(place: &calib_core::dead_reckoning::Place<f32>) -> Believed {
    let covariance = place.covariance();
    Believed {
        x: place.position().x.into(),
        y: place.position().y.into(),
        sigma_x: f64::from(covariance.m11.max(0.0)).sqrt(),
        sigma_y: f64::from(covariance.m22.max(0.0)).sqrt(),
    }
}

/// Returns true if a camera said nothing though a target asked it for itself: a camera that does not see the
/// target says nothing unasked. Returns false where this is not known, as for one on an emulated board.
fn is_silent(simulation: &Simulation, network: &Network, node: &Node, entry: &NodeEntry) -> bool {
    // Where a target was in several networks, the same address is a camera's in each of them.
    let index = usize::from(node.network - 1);
    let mut networks = simulation.site.networks.iter();
    let roams = networks.any(|other| other.home == Some(index));
    let Some(address) = node.address.filter(|_| !roams) else {
        return false;
    };
    let targets = network.targets.iter();
    let asked =
        targets.filter_map(|target| simulation.entry(target.id).asked.get(&address).copied());
    has_missed(simulation, entry, asked)
}

fn arrivals(entry: &NodeEntry) -> impl Iterator<Item = Time> + '_ {
    entry.arrivals.iter().map(|(at, _)| *at)
}

/// Returns true if one of these moments is after a node last said anything, and long enough ago.
fn has_missed(
    simulation: &Simulation,
    entry: &NodeEntry,
    mut moments: impl Iterator<Item = Time>,
) -> bool {
    let end = simulation.executor.clock().time();
    let is_late = |said, at| at > said && at + ANSWER < end;
    entry
        .said
        .is_some_and(|said| moments.any(|at| is_late(said, at)))
}

/// The sightings that a camera has counted, each with its target and stop.
fn sightings(
    camera: u16,
    entry: &NodeEntry,
    console: &Console,
    numbers: &Numbers,
) -> Vec<(u16, u32, Sighting<f64>)> {
    let kept = || entry.sightings.values();
    // The place that most of them share their errors with, as the camera chooses it: residuals are
    // in units of the sigmas with which it weighs its sightings. A joint estimate of a target is not
    // made of these sightings, and shares no errors with a place of then.
    let view = console.view();
    let report = view.member(camera).and_then(|member| member.report);
    let is_joint = report.is_some_and(|report| report.joint.is_some());
    let fix = |sighting: &KeptSighting| (sighting.target, sighting.place.parts().fix);
    let shared = |one: &&KeptSighting| kept().filter(|other| fix(other) == fix(one)).count();
    let common = kept().max_by_key(shared);
    let sightings = kept().filter_map(|sighting| {
        let target = view.id_of(sighting.target)?;
        let stop = *numbers.get(&(target, sighting.stop))?;
        let seen = report.map_or(Some(sighting.seen), |report| report.upright(sighting.seen))?;
        let place = &sighting.place;
        let own = match common {
            Some(common) if common.target == sighting.target && !is_joint => {
                place.own_covariance(&common.place)
            }
            _ => place.covariance(),
        };
        let sighting = Sighting {
            target: place.position().cast(),
            ray: calib_core::Ray::from_bearing(f64::from(seen.bearing)),
            bearing_sigma: seen.sigma.into(),
            target_covariance: own.cast(),
        };
        Some((target, stop, sighting))
    });
    sightings.collect()
}

/// The last rows in which a camera saw targets at stops that are in the record.
fn rows(
    simulation: &Simulation,
    camera: u16,
    console: &Console,
    numbers: &Numbers,
    targets: &[Target],
) -> Vec<Row<f64>> {
    let seen = measured::seen_by(simulation, camera, console, numbers);
    let rows = seen.iter().rev().filter_map(|seen| {
        let target = targets.iter().find(|target| target.id == seen.target)?;
        let stop = target
            .stops
            .binary_search_by_key(&seen.stop, |stop| stop.stop);
        let believed = target.stops.get(stop.ok()?)?.believed?;
        Some(Row {
            target: Point2::new(believed.x, believed.y),
            target_variance: believed.variance(),
            bearing: seen.bearing_deg.to_radians(),
            elevation: seen.elevation_deg?.to_radians(),
            sigma: seen.sigma_deg.to_radians(),
        })
    });
    let rows: Vec<_> = rows.take(ROWS).collect();
    // Of the target on an emulated board only the last stop is known; of a camera's own sightings the place that was told.
    let entry = simulation.entry(camera);
    if rows.len() >= entry.sightings.len() {
        return rows;
    }
    let told = entry.sightings.values().filter_map(|kept| {
        Some(Row {
            target: kept.place.position().cast(),
            target_variance: believed(&kept.place).variance(),
            bearing: kept.seen.bearing.into(),
            elevation: kept.seen.elevation.radians()?,
            sigma: kept.seen.sigma.into(),
        })
    });
    told.collect()
}

/// The cameras that became the references, or else those that are meant to: indices among the
/// network's cameras.
fn references(network: &Network, console: &Console) -> [usize; 2] {
    let has = |duty: Duty| {
        network.cameras.iter().position(|camera| {
            let view = console.view();
            let member = view.member(camera.id);
            member.is_some_and(|member| member.duty() == Some(duty))
        })
    };
    match (has(Duty::First), has(Duty::Second)) {
        (Some(first), Some(second)) if network.elected => [first, second],
        _ => network.references,
    }
}

fn describe(
    node: &mut Node,
    simulation: &Simulation,
    frame: &Frame,
    ball_height: f64,
    camera: &CameraNode,
) {
    // Its place at the end.
    let world = simulation.world.borrow();
    let real = &world.cameras()[camera.index];
    let place = frame.place(real.place);
    let mount = real.mount;
    node.truth = Some(Place {
        hung: Some(Hung {
            z: ball_height + mount.height,
            pitch_deg: mount.pitch.to_degrees(),
            roll_deg: mount.roll.to_degrees(),
        }),
        ..Place::new(place.x, place.y, frame.direction(real.heading).to_degrees())
    });
    node.view = Some(View {
        fov_deg: camera.model_lens.1,
        range: real.range,
    });
}

/// Adds a node's traffic, and the failures that kept it from going on.
fn with_traffic(simulation: &Simulation, mut node: Node) -> Node {
    let entry = simulation.entry(node.id);
    if let Some(said) = entry.said {
        node.heard_seconds = Some(seconds(said));
    }
    let failures = entry.failures.iter().map(|(at, why)| Failure {
        seconds: seconds(*at),
        why: why.clone(),
    });
    node.failures = failures.collect();
    if let Some(hardware) = simulation.node(node.id) {
        let counters = hardware.medium().counters(hardware.antenna);
        node.frames_sent = Some(counters.frames);
        node.bytes_sent = Some(counters.bytes + PHY_HEADER * counters.frames);
        node.page_erasures = hardware.page_erasures();
        // The bytes that a board's machine code hands to its link cannot be seen.
        node.payload_bytes = (!hardware.is_emulated()).then_some(entry.payload_bytes);
    }
    node
}

fn radio(simulation: &Simulation, seconds: f64) -> Radio {
    let totals = simulation.medium.totals();
    Radio {
        frames: totals.frames,
        bytes: totals.bytes + PHY_HEADER * totals.frames,
        drops: Reason::ALL
            .iter()
            .map(|&reason| (reason.name().replace(' ', "_"), totals.dropped(reason)))
            .filter(|(_, count)| *count > 0)
            .collect(),
        // A run may end before its first moment has passed.
        airtime_share: match seconds > 0.0 {
            true => totals.airtime as f64 * 1e-9 / seconds,
            false => 0.0,
        },
        attack: simulation.attacker.told(&simulation.scenario, seconds),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::Options;
    use site::{Overrides, Scenario};

    #[test]
    fn what_kept_a_node_from_going_on_is_in_the_record() {
        let lab = Scenario::load("lab", &Overrides::default()).unwrap();
        let mut simulation = Simulation::new(lab, Options::default()).unwrap();
        let journal = simulation.journal.clone();
        let clock = simulation.executor.clock();
        simulation.executor.spawn(async move {
            for why in ["the radio failed", "the flash failed"] {
                clock.sleep(2_500_000_000).await;
                journal.borrow_mut().failed(3, why);
            }
        });
        let record = simulation.run(|_| ());
        for node in &record.nodes {
            let failures = node.failures.iter();
            let failures: Vec<_> = failures.map(|f| (f.seconds, f.why.as_str())).collect();
            let expected: &[_] = match node.id {
                3 => &[(2.5, "the radio failed"), (5.0, "the flash failed")],
                _ => &[],
            };
            assert_eq!(failures, expected, "node {}", node.id);
        }
    }

    /// A site that is turned by a quarter and moved: a camera three units before a wall.
    #[test]
    fn obstacles_are_in_the_frame_of_the_cameras() {
        let text = r#"
            name = "turned"
            unit_metres = 0.5
            [[world.obstacle]]
            wall = [[9.0, 1.0], [9.0, 3.0]]
            [[network]]
            references = { cameras = [1, 2] }
            camera = [
                { id = 1, x = 20.0, y = 5.0, heading_deg = 135.0 },
                { id = 2, x = 20.0, y = 15.0, heading_deg = 225.0 },
                { id = 3, x = 12.0, y = 2.0, heading_deg = 90.0 },
            ]
            target = [{ id = 20, stops = [[15.0, 10.0], [14.0, 11.0], [15.0, 12.0]] }]
        "#;
        let turned = Scenario::from_toml(text, &Overrides::default()).unwrap();
        let mut simulation = Simulation::new(turned, Options::default()).unwrap();
        let record = simulation.run(|_| ());
        assert_eq!(record.unit.metres, 0.5);
        let truth = record
            .cameras()
            .nth(2)
            .and_then(|camera| camera.truth)
            .unwrap();
        // The x axis points along the world's y axis, the y axis against the world's x axis.
        for (found, expected) in [
            ([truth.x, truth.y], [-3.0, 8.0]),
            (record.obstacles[0][0], [-4.0, 11.0]),
            (record.obstacles[0][1], [-2.0, 11.0]),
        ] {
            let off = (found[0] - expected[0]).hypot(found[1] - expected[1]);
            assert!(off < 1e-9, "{found:?} {expected:?}");
        }
    }
}
