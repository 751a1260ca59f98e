//! Measurements of a run's nodes, as input of another solution.

use node_firmware::config::{RoleConfig, TargetConfig};
use results::record::sightings::{Bearing, Carrier, Leg, Lens, References, Sightings, Surveyed};

use super::{Simulation, console::Console, outcome::Numbers};
use site::{Network, TargetNode};

/// The bearings of all cameras and the ways of all targets of a network, with the values that its nodes are
/// told beforehand.
pub(super) fn sightings(
    simulation: &Simulation,
    network: &Network,
    references: [u16; 2],
    console: &Console,
    numbers: &Numbers,
) -> Sightings {
    let cameras = network.cameras.iter().map(|camera| camera.id);
    let mut bearings: Vec<_> = cameras
        .flat_map(|camera| seen_by(simulation, camera, console, numbers))
        .collect();
    bearings.sort_by_key(|seen| (seen.target, seen.stop, seen.camera));
    let mut legs: Vec<_> = { network.targets.iter() }
        .flat_map(|target| ways(simulation, target, numbers))
        .collect();
    legs.sort_by_key(|leg| (leg.target, leg.stop));
    let carriers = { network.targets.iter() }.filter_map(|target| {
        let RoleConfig::Target(config) = &simulation.config(target.id)?.settings().role else {
            return None;
        };
        Some(Carrier {
            target: target.id,
            systematic_scale: config.systematic_scale.into(),
            systematic_heading_deg: config.systematic_heading_deg.into(),
            standing_sigma: config.standing_sigma.into(),
        })
    });
    let told = target_config(simulation, network).map(|config| config.lens_sigma);
    let lens = { told.filter(|told| told.focal > 0.0) }.map(|told| Lens {
        sigma: told.focal.into(),
        fov_deg: None,
        principal_deg: told.principal_deg.into(),
    });
    let surveyed = Surveyed {
        baseline_sigma: network.told.baseline.unwrap_or_default(),
        position_sigma: network.told.place,
    };
    Sightings {
        lens,
        tilt_sigma_deg: told.map_or(0.0, |told| told.tilt_deg.into()),
        references: network.home.is_none().then_some(References {
            cameras: references,
            baseline: network.known.baseline,
        }),
        survey: (surveyed.baseline_sigma > 0.0 || surveyed.position_sigma > 0.0)
            .then_some(surveyed),
        frame_heading_deg: network.known.frame_heading.map(f64::to_degrees),
        carriers: carriers.collect(),
        bearings,
        legs,
        ..Sightings::default()
    }
}

/// Settings of the first target of a network.
pub(super) fn target_config<'s>(
    simulation: &'s Simulation,
    network: &Network,
) -> Option<&'s TargetConfig> {
    network.targets.iter().find_map(|target| {
        let RoleConfig::Target(config) = &simulation.config(target.id)?.settings().role else {
            return None;
        };
        Some(config)
    })
}

/// All bearings of a camera, by stops.
pub(super) fn seen_by(
    simulation: &Simulation,
    camera: u16,
    console: &Console,
    numbers: &Numbers,
) -> Vec<Bearing> {
    let entry = simulation.entry(camera);
    let view = console.view();
    let bearings = entry.seen.iter().filter_map(|(&(address, told), seen)| {
        let target = view.id_of(address)?;
        Some(Bearing {
            target,
            stop: *numbers.get(&(target, told))?,
            camera,
            bearing_deg: f64::from(seen.bearing).to_degrees(),
            sigma_deg: f64::from(seen.sigma).to_degrees(),
            elevation_deg: seen.elevation.radians().map(f64::to_degrees),
        })
    });
    bearings.collect()
}

fn ways(simulation: &Simulation, target: &TargetNode, numbers: &Numbers) -> Vec<Leg> {
    let entry = simulation.entry(target.id);
    let legs = entry.stops.iter().filter_map(|(told, stop)| {
        let number = *numbers.get(&(target.id, *told))?;
        let way = stop.way.as_ref().filter(|_| number > 1)?;
        let covariance = way.covariance;
        Some(Leg {
            target: target.id,
            stop: number,
            dx: way.vector.x,
            dy: way.vector.y,
            covariance: [covariance.m11, covariance.m12, covariance.m22],
        })
    });
    legs.collect()
}
