//! The record of a run.

use std::collections::BTreeMap;

use calib_core::{Pose, Sighting};
use nalgebra::{Matrix3, Point2};
use node_firmware::{
    config::Duty,
    memory::KeptSighting,
    message::{PoseParts, State},
};

use super::{Simulation, console::Console, journal::NodeEntry, provision};
use crate::{
    record::{
        Believed, FORMAT, Limits, Node, Place, Radio, Role, RunRecord, Stop, Target, Unit, View,
        summary::Summary,
    },
    scenario::{CameraNode, Frame, Network},
    sim::medium::{Medium, Reason},
    world::Obstacle,
};

/// Preamble, start of frame and length.
const PHY_HEADER: u64 = 6;

pub(super) fn record(simulation: &Simulation, wall_seconds: f64) -> RunRecord {
    let scenario = &simulation.scenario;
    let mut nodes = Vec::new();
    let mut targets = Vec::new();
    let networks = simulation.site.networks.iter().zip(&simulation.consoles);
    for (number, (network, console)) in (0..).zip(networks) {
        let references = references(network, console);
        let frame = simulation.site.frame(network, references);
        let entry = |id: u16| {
            let journal = simulation.journal.borrow();
            journal.nodes.get(&id).cloned().unwrap_or_default()
        };
        let coordinator = provision::coordinator_id(number);
        nodes.push(traffic(
            simulation,
            Node::new(coordinator, Role::Coordinator),
            &entry(coordinator),
        ));
        // Stops are counted from 1 in the order in which each target told of them.
        let mut numbers = BTreeMap::new();
        for target in &network.targets {
            let entry = entry(target.id);
            let mut stops: Vec<_> = entry.stops.iter().collect();
            stops.sort_by_key(|(_, stop)| stop.at);
            let stops = (1..).zip(stops).map(|(count, (told, stop))| {
                numbers.insert((target.id, *told), count);
                let truth = frame.place(stop.truth);
                Stop {
                    stop: count,
                    seconds: stop.at as f64 * 1e-9,
                    x: truth.x,
                    y: truth.y,
                    believed: stop.believed.as_ref().map(|place| {
                        let covariance = place.covariance();
                        Believed {
                            x: place.position().x.into(),
                            y: place.position().y.into(),
                            sigma_x: f64::from(covariance.m11.max(0.0)).sqrt(),
                            sigma_y: f64::from(covariance.m22.max(0.0)).sqrt(),
                        }
                    }),
                }
            });
            let stops: Vec<_> = stops.collect();
            targets.push(Target {
                id: target.id,
                path: stops.iter().map(|stop| [stop.x, stop.y]).collect(),
                stops,
            });
            nodes.push(traffic(
                simulation,
                Node::new(target.id, Role::Target),
                &entry,
            ));
        }
        for (place, camera) in network.cameras.iter().enumerate() {
            let entry = entry(camera.id);
            let mut node = Node::new(camera.id, Role::Camera);
            node.reference = references.contains(&place);
            node.expected = true;
            describe(&mut node, simulation, &frame, camera);
            if let Some(report) = console.report(camera.id) {
                match report.state {
                    State::Pose(parts) => {
                        if let Some(pose) = exact(&parts) {
                            node.set_pose(&pose);
                        }
                    }
                    State::Refused(refusal) => node.refusal = Some(refusal),
                    State::Waiting => {}
                }
                node.sightings = report.sightings.into();
            }
            let first = |kept: &KeptSighting| {
                let same = |other: &&KeptSighting| {
                    other.target == kept.target && other.place.parts().fix == kept.place.parts().fix
                };
                entry
                    .sightings
                    .values()
                    .find(same)
                    .map_or(kept.place, |kept| kept.place)
            };
            let kept: Vec<_> = entry
                .sightings
                .values()
                .filter_map(|kept| {
                    let target = console.id_of(kept.target)?;
                    let stop = *numbers.get(&(target, kept.stop))?;
                    let place = &kept.place;
                    let sighting = Sighting {
                        target: place.position().cast(),
                        ray: calib_core::Ray::from_bearing(f64::from(kept.seen.bearing)),
                        bearing_sigma: kept.seen.sigma.into(),
                        // What stops share, residuals do not show.
                        target_covariance: place.own_covariance(&first(kept)).cast(),
                    };
                    Some((target, stop, sighting))
                })
                .collect();
            if !kept.is_empty() {
                node.set_sightings(kept.iter().map(|(target, stop, s)| (*target, *stop, s)));
            }
            node.calibrated_seconds = entry.calibrated.map(|at| at as f64 * 1e-9);
            nodes.push(traffic(simulation, node, &entry));
        }
    }
    nodes.sort_by_key(|node| node.id);
    targets.sort_by_key(|target| target.id);
    let sim_seconds = simulation.executor.clock().time() as f64 * 1e-9;
    let mut record = RunRecord {
        format: FORMAT,
        scenario: scenario.name.clone(),
        path: u32::try_from(scenario.path).ok(),
        seed: scenario.seed,
        unit: Unit {
            name: scenario.unit.clone(),
            metres: 1.0,
        },
        limits: Limits {
            sigma_position: scenario.firmware.weak_sigma * 2_f64.sqrt(),
            sigma_heading_deg: f64::MAX,
        },
        summary: Summary::of(&nodes),
        nodes,
        targets,
        obstacles: simulation
            .site
            .world
            .obstacles()
            .iter()
            .map(outline)
            .collect(),
        radio: radio(&simulation.medium, sim_seconds),
        sim_seconds,
        wall_seconds: Some(wall_seconds),
    };
    record.limits.sigma_heading_deg = record.limits.sigma_heading_deg.min(90.0);
    record
}

/// The cameras that became the references, or else those that are meant to: places among the
/// network's cameras.
fn references(network: &Network, console: &Console) -> [usize; 2] {
    let has = |duty: Duty| {
        network.cameras.iter().position(|camera| {
            let report = console.report(camera.id);
            report.is_some_and(|report| report.duty == Some(duty))
        })
    };
    match (has(Duty::First), has(Duty::Second)) {
        (Some(first), Some(second)) if network.elected => [first, second],
        _ => network.references,
    }
}

fn describe(node: &mut Node, simulation: &Simulation, frame: &Frame, camera: &CameraNode) {
    let real = &simulation.site.world.cameras()[camera.index];
    let place = frame.place(real.place);
    node.truth = Some(Place {
        x: place.x,
        y: place.y,
        heading_deg: frame.direction(real.heading).to_degrees(),
    });
    node.view = Some(View {
        fov_deg: camera.model_lens.1,
        range: real.range,
    });
}

/// The pose as the node sent it.
fn exact(parts: &PoseParts) -> Option<Pose<f64>> {
    let pose = parts.pose()?;
    Some(Pose {
        position: Point2::new(pose.position.x.into(), pose.position.y.into()),
        heading: pose.heading.into(),
        covariance: Matrix3::from_iterator(pose.covariance.iter().map(|&c| f64::from(c))),
    })
}

fn traffic(simulation: &Simulation, mut node: Node, entry: &NodeEntry) -> Node {
    node.payload_bytes = entry.payload_bytes;
    if let Some(hardware) = simulation.node(node.id) {
        let counters = hardware.medium().counters(hardware.antenna);
        node.frames_sent = counters.frames;
        node.bytes_sent = counters.bytes + PHY_HEADER * counters.frames;
    }
    node
}

fn radio(medium: &Medium, seconds: f64) -> Radio {
    let totals = medium.totals();
    Radio {
        frames: totals.frames,
        bytes: totals.bytes + PHY_HEADER * totals.frames,
        drops: Reason::ALL
            .iter()
            .map(|&reason| (reason.name().replace(' ', "_"), totals.dropped(reason)))
            .filter(|(_, count)| *count > 0)
            .collect(),
        airtime_share: totals.airtime as f64 * 1e-9 / seconds,
    }
}

fn outline(obstacle: &Obstacle) -> Vec<[f64; 2]> {
    match obstacle {
        Obstacle::Segment(ends) => ends.iter().map(|end| [end.x, end.y]).collect(),
        Obstacle::Disc { centre, radius } => (0..24)
            .map(|n| {
                let (sin, cos) = (f64::from(n) * std::f64::consts::TAU / 24.0).sin_cos();
                [centre.x + radius * cos, centre.y + radius * sin]
            })
            .collect(),
        Obstacle::Polygon(corners) => corners.iter().map(|c| [c.x, c.y]).collect(),
    }
}
