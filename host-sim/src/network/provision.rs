//! A configuration for every node of a scenario, as a person would write it.

use std::collections::BTreeMap;

use node_firmware::{
    config::{
        CameraConfig, Config, CoordinatorConfig, Duty, Reference, Role, SensorConfig, Sigmas,
        SiteKey, Subjects, TargetConfig,
    },
    role::camera::REFERENCE_STOPS,
    sight::{ColourWindow, Lens},
};
use rand::Rng;
use zigbee_link::security::Protection;

use cmucam2_emulator::Rgb;
use site::world::World;
use site::{
    CameraNode, FIRST_COORDINATOR, FirmwareTable, Network, Scenario, ScenarioError, Site,
    TargetNode,
};
use virtual_bench::random::Root;

/// How far from a target's colour a pixel may be, levels.
const COLOUR_WIDTH: u8 = 45;

/// Configurations of a network.
pub(super) struct Configs {
    pub(super) coordinator: Config,
    pub(super) cameras: Vec<Config>,
    pub(super) targets: Vec<Config>,
}

/// The index of the simulation's key.
pub(super) const KEY_INDEX: u8 = 1;

/// The simulation's own site key, drawn from its seed: no key of anybody's site.
pub(super) fn secret(root: Root) -> [u8; 16] {
    let mut secret = [0; 16];
    root.stream("site key", 0).fill_bytes(&mut secret);
    secret
}

/// Of all networks. All have the same site key.
///
/// # Errors
/// A node refuses what its scenario asks for.
pub(super) fn all(
    scenario: &Scenario,
    site: &Site,
    root: Root,
) -> Result<Vec<Configs>, ScenarioError> {
    let key = SiteKey::new(KEY_INDEX, secret(root));
    let networks = (0..).zip(&site.networks);
    networks
        .map(|(number, network)| {
            Plan {
                scenario,
                world: &site.world,
                network,
                number,
                key,
            }
            .configs()
            .checked()
        })
        .collect()
}

impl Configs {
    fn checked(self) -> Result<Self, ScenarioError> {
        let members = self.cameras.iter().chain(&self.targets);
        for config in members.chain([&self.coordinator]) {
            config.check().map_err(|reason| ScenarioError::Config {
                node: config.id,
                reason,
            })?;
        }
        Ok(self)
    }
}

struct Plan<'a> {
    scenario: &'a Scenario,
    world: &'a World,
    network: &'a Network,
    number: u16,
    key: SiteKey,
}

/// A locally administered EUI-64.
pub(super) fn extended(id: u16) -> [u8; 8] {
    let [high, low] = id.to_be_bytes();
    [0x02, 0, 0, 0, 0, 0, high, low]
}

/// The number of a network's coordinator; networks are counted from 0.
pub(super) const fn coordinator_id(network: u16) -> u16 {
    FIRST_COORDINATOR + network
}

impl Plan<'_> {
    fn configs(&self) -> Configs {
        let colours = self.colours();
        let network = self.network;
        let members = network.cameras.iter().map(|camera| camera.id);
        let members = members.chain(network.targets.iter().map(|target| target.id));
        let coordinator = CoordinatorConfig {
            allow: members.map(extended).collect(),
            join_window_s: 0,
        };
        let cameras = (0..).zip(&network.cameras).map(|(place, camera)| {
            let config = self.camera(place, camera, &colours);
            self.node(camera.id, Role::Camera(config))
        });
        let targets = network.targets.iter().map(|target| {
            let config = self.target(target, &colours);
            self.node(target.id, Role::Target(config))
        });
        Configs {
            coordinator: self.node(coordinator_id(self.number), Role::Coordinator(coordinator)),
            cameras: cameras.collect(),
            targets: targets.collect(),
        }
    }

    fn node(&self, id: u16, role: Role) -> Config {
        Config {
            id,
            extended: Some(extended(id)),
            site_key: self.key,
            first_counter: 1,
            channels: 1 << self.network.channel,
            tx_power: 0,
            protection: Protection::EncMic64,
            role,
        }
    }

    /// The different colours of this network's targets.
    fn colours(&self) -> Vec<Rgb> {
        let targets = self.world.targets();
        let all = self
            .network
            .targets
            .iter()
            .map(|target| targets[target.index].colour);
        let mut first = BTreeMap::new();
        for (place, colour) in all.enumerate() {
            first.entry(colour).or_insert(place);
        }
        let mut colours: Vec<_> = first.into_iter().collect();
        colours.sort_by_key(|(_, place)| *place);
        colours.into_iter().map(|(colour, _)| colour).collect()
    }

    fn camera(&self, place: usize, camera: &CameraNode, colours: &[Rgb]) -> CameraConfig {
        let FirmwareTable {
            stops,
            refine,
            weak_sigma,
            good_enough_position,
            good_enough_heading_deg,
            motion,
            ..
        } = self.scenario.firmware;
        let wanted = self.scenario.stops;
        let network = self.network;
        let known = &network.known;
        let (projection, degrees) = camera.model_lens;
        let duty = match network
            .references
            .iter()
            .position(|&reference| reference == place)
        {
            Some(0) => Some(Duty::First),
            Some(_) => Some(Duty::Second),
            None => None,
        };
        let reference = duty.filter(|_| !network.elected).map(|duty| Reference {
            duty,
            position: known.baseline.map(|baseline| match duty {
                Duty::First => [0.0; 2],
                Duty::Second => [baseline as f32, 0.0],
            }),
        });
        CameraConfig {
            lens: Lens {
                columns: u16::try_from(camera.model.last_column() as i64 + 1).unwrap_or(88),
                field_of_view_deg: degrees as f32,
                projection,
                principal_column: None,
            },
            baud: camera.baud,
            first_column: 1,
            subjects: if motion {
                Subjects::Motion { threshold: 12 }
            } else {
                Subjects::Colours(colours.iter().map(window).collect())
            },
            round: true,
            reference,
            may_be_elected: network.elected,
            baseline: known.baseline.map(|baseline| baseline as f32),
            frame_heading_deg: known
                .frame_heading
                .map(|heading| heading.to_degrees() as f32),
            // As many as are planned: their order is that of the whole way.
            reference_stops: wanted.min(REFERENCE_STOPS) as u8,
            // The scenario's are checked to be no more than a camera keeps.
            stops: stops.unwrap_or(wanted as u8),
            refine,
            good_enough: Sigmas {
                // A scenario's 0 is what no camera reaches; a configuration has no such value.
                position: (good_enough_position as f32).max(f32::MIN_POSITIVE),
                heading_deg: (good_enough_heading_deg as f32).max(f32::MIN_POSITIVE),
            },
            weak_sigma: weak_sigma as f32,
            sigma_floor_px: 0.05,
        }
    }

    fn target(&self, target: &TargetNode, colours: &[Rgb]) -> TargetConfig {
        let own = self.world.targets()[target.index].colour;
        let colour = colours.iter().position(|&colour| colour == own);
        TargetConfig {
            colour: colour.unwrap_or(0) as u8,
            still_after_ms: 1_500,
            systematic_heading_deg: 0.0,
            systematic_scale: 0.0,
            standing_sigma: target.standing_sigma as f32,
            dwell_least_ms: 1_000,
            dwell_most_ms: 60_000,
            sensor: SensorConfig::UNCALIBRATED,
        }
    }
}

fn window(colour: &Rgb) -> ColourWindow {
    let [red, green, blue] = colour.map(|level| {
        // What a CMUcam2 can see: 16 to 240.
        [
            level.saturating_sub(COLOUR_WIDTH).clamp(16, 240),
            level.saturating_add(COLOUR_WIDTH).clamp(16, 240),
        ]
    });
    ColourWindow { red, green, blue }
}
