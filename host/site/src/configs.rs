//! The configuration of every node: for a rehearsal and for the boards alike.

use calib_core::reference::Known;
use nalgebra::Point2;
use node_firmware::{
    config::{
        CameraConfig, CheckedConfig, Config, CoordinatorConfig, LensSigma, RoleConfig, SiteKey,
        Subjects, SurveySigma, TargetConfig,
    },
    limits::REFERENCE_STOPS,
    message::{Duty, Reference, SitePlace},
    vision::{CameraKind, ColourWindow, Lens},
};

use super::{
    FIRST_COORDINATOR, Frame,
    assume::Purpose,
    check::refuse,
    error::ScenarioError,
    file::{NetworkTable, PlacedCamera, Scenario, TargetTable, orange},
    firmware::{COLOUR_TOLERANCE, FirmwareTable},
    planner::Told,
};
use cmucam2_emulator::Rgb;

/// Configurations of the nodes of one network.
#[derive(Clone, Debug, PartialEq)]
pub struct NetworkConfigs {
    /// Configuration of its coordinator, which lets all the others join.
    pub coordinator: CheckedConfig,
    /// Configurations of its cameras, in the order of the file.
    pub cameras: Vec<CheckedConfig>,
    /// Configurations of its targets, in the order of the file.
    pub targets: Vec<CheckedConfig>,
}

impl NetworkConfigs {
    /// All of them, the coordinator's first.
    pub fn iter(&self) -> impl Iterator<Item = &CheckedConfig> {
        let members = self.cameras.iter().chain(&self.targets);
        std::iter::once(&self.coordinator).chain(members)
    }
}

/// The configurations of all nodes of all networks, each of them checked.
///
/// They come from the file alone: cameras that are no references need no places. Values that the file leaves
/// out have the firmware's default; [`Scenario::assumptions`] tells which of these should rather have been
/// said.
///
/// # Errors
/// A node cannot be configured to what the file says.
pub fn configs(scenario: &Scenario, key: SiteKey) -> Result<Vec<NetworkConfigs>, ScenarioError> {
    let networks = (0..).zip(&scenario.networks);
    let maker = |(number, network)| {
        Maker {
            scenario,
            network,
            number,
            key,
        }
        .configs()
    };
    networks.map(maker).collect()
}

/// As [`configs`], for real nodes: nothing that matters is assumed.
///
/// # Errors
/// [`ScenarioError::Open`], and those of [`configs`].
pub fn provision(scenario: &Scenario, key: SiteKey) -> Result<Vec<NetworkConfigs>, ScenarioError> {
    let open = scenario.assumptions(Purpose::Deployment);
    if !open.is_empty() {
        return Err(ScenarioError::Open(open));
    }
    configs(scenario, key)
}

/// The number of a network's coordinator; networks are counted from 0.
pub const fn coordinator_id(network: u16) -> u16 {
    FIRST_COORDINATOR + network
}

impl NetworkTable {
    /// Its frame in the building when these of its cameras are its references: between their places,
    /// or what [`NetworkTable::frame`] says. `None` if the file tells neither.
    pub fn frame_between(&self, references: [u16; 2]) -> Option<Frame> {
        let [first, second] = references.map(|id| self.camera(id).and_then(PlacedCamera::place));
        match (first, second) {
            (Some(first), Some(second)) => Some(Frame::between([first, second])),
            _ => self.frame.map(|frame| Frame {
                origin: Point2::new(frame.x, frame.y),
                heading: frame.heading_deg.to_radians(),
            }),
        }
    }

    /// Distance of its configured references by their places, above zero.
    pub fn baseline(&self) -> Option<f64> {
        let place = |id| self.camera(id).and_then(PlacedCamera::place);
        let [first, second] = self.references.cameras.map(place);
        Some((second? - first?).norm()).filter(|distance| *distance > 0.0)
    }

    /// Its frame in the building, as [`NetworkTable::frame_between`] its configured references.
    pub fn building_frame(&self) -> Option<Frame> {
        self.frame_between(self.references.cameras)
    }

    /// Known parts of the frame, as its nodes are told them.
    ///
    /// # Errors
    /// They are to be told a value that the file does not have. `name` is the name of the network.
    pub(crate) fn known(&self, name: &str) -> Result<Known<f64>, ScenarioError> {
        let references = &self.references;
        let places = references.cameras.map(|id| self.camera(id)?.place());
        let measured = match places {
            [Some(first), Some(second)] => Some((second - first).norm()),
            _ => None,
        };
        let baseline = references.baseline.or(measured);
        if references.baseline_known() && baseline.is_none() {
            let allowed = "their distance, or give both cameras `x` and `y`, or say \
                           `baseline_known = false`";
            return Err(refuse(
                format!("{name}.references.baseline"),
                "missing",
                allowed,
            ));
        }
        let turned = match (references.compass_deg, self.building_frame()) {
            (None, _) => Some(0.0),
            (Some(compass), Some(frame)) => Some(compass.to_radians() - frame.heading),
            (Some(_), None) => None,
        };
        if references.frame_heading_known() && turned.is_none() {
            let allowed = "there where `compass_deg` is: where the compass points, seen from the \
                           network, depends on it; or give both references `x` and `y`";
            return Err(refuse(format!("{name}.frame"), "missing", allowed));
        }
        Ok(Known {
            baseline: baseline.filter(|_| references.baseline_known()),
            frame_heading: turned
                .filter(|_| references.frame_heading_known())
                .map(calib_core::angle::wrap_signed),
        })
    }
}

impl Scenario {
    /// The different colours of the targets in a network, each with a window if one is given: first
    /// those of visitors, which have the same numbers at home.
    pub(crate) fn colours(&self, network: &NetworkTable) -> Vec<(Rgb, Option<ColourWindow>)> {
        let mut colours: Vec<(Rgb, Option<ColourWindow>)> = Vec::new();
        let is_tagged = self.is_tagged(network);
        for target in self.wearers(network) {
            let known = colours.iter_mut().find(|(c, _)| *c == target.colour);
            match known.filter(|_| !is_tagged) {
                Some((_, window)) => *window = window.or(target.window),
                None => colours.push((target.colour, target.window)),
            }
        }
        colours
    }

    /// Returns true if a camera of the network looks for tags: each target then has a number of its own.
    fn is_tagged(&self, network: &NetworkTable) -> bool {
        let kind = |placed| self.camera.for_camera(placed).kind;
        let mut kinds = network.cameras.iter().map(kind);
        kinds.any(|kind| kind == CameraKind::OpenMvTags)
    }
}

struct Maker<'a> {
    scenario: &'a Scenario,
    network: &'a NetworkTable,
    /// From 0.
    number: u16,
    key: SiteKey,
}

impl Maker<'_> {
    fn configs(&self) -> Result<NetworkConfigs, ScenarioError> {
        let network = self.network;
        let known = network.known(&format!("network {}", self.number + 1))?;
        let own = channel_mask(&network.channels());
        let visited = self.scenario.visited_from(self.number.into());
        let all = visited.fold(own, |mask, number| {
            let visited = &self.scenario.networks[number];
            mask | channel_mask(&visited.channels())
        });
        let cameras = network.cameras.iter().map(|camera| {
            let firmware = self.firmware(camera.firmware);
            let role = RoleConfig::Camera(self.camera(camera, &firmware, &known));
            self.node(camera.id, &firmware, own, role)
        });
        let targets = network.targets.iter().map(|target| {
            let firmware = self.firmware(target.firmware);
            let role = RoleConfig::Target(self.target(target));
            self.node(target.id, &firmware, all, role)
        });
        let cameras = cameras.collect::<Result<Vec<_>, _>>()?;
        let targets = targets.collect::<Result<Vec<_>, _>>()?;
        let members = cameras.iter().chain(&targets);
        let visitors = self.scenario.visitors(network);
        let mut coordinator = CoordinatorConfig::default();
        coordinator.allow = members
            .map(|node| node.settings().id)
            .chain(visitors.iter().map(|target| target.id))
            .chain(network.allow.iter().copied())
            .collect();
        coordinator.metres_per_unit = self.scenario.metres_per_unit() as f32;
        coordinator.ball_radius = self.scenario.firmware.ball_radius();
        self.scenario
            .firmware
            .configure_coordinator(&mut coordinator);
        let coordinator = self.node(
            coordinator_id(self.number),
            &self.scenario.firmware,
            own,
            RoleConfig::Coordinator(coordinator),
        )?;
        Ok(NetworkConfigs {
            coordinator,
            cameras,
            targets,
        })
    }

    /// A node's parameters.
    fn firmware(&self, own: Option<FirmwareTable>) -> FirmwareTable {
        own.unwrap_or_default().over(self.scenario.firmware)
    }

    fn node(
        &self,
        id: u16,
        firmware: &FirmwareTable,
        channels: u32,
        role: RoleConfig,
    ) -> Result<CheckedConfig, ScenarioError> {
        let mut config = Config::new(id, self.key, role);
        config.channels = channels;
        firmware.configure_node(&mut config);
        config.check().map_err(|reason| {
            self.scenario.located(ScenarioError::Config {
                line: None,
                node: id,
                reason,
            })
        })
    }

    fn camera(
        &self,
        placed: &PlacedCamera,
        firmware: &FirmwareTable,
        known: &Known<f64>,
    ) -> CameraConfig {
        let table = self.scenario.camera.for_camera(placed);
        let subjects = firmware.motion().unwrap_or_else(|| {
            let colours = self.scenario.colours(self.network).into_iter();
            let tolerance = firmware.colour_tolerance();
            let windows =
                colours.map(|(colour, own)| own.unwrap_or_else(|| window(colour, tolerance)));
            Subjects::Colours(windows.collect())
        });
        let mut camera = match table.kind.model() {
            None => CameraConfig::new(table.believed(), subjects),
            Some(model) => {
                CameraConfig::pixy(model, self.scenario.colours(self.network).len() as u8)
            }
        };
        camera.lens = table.believed();
        camera.baud = table.baud();
        camera.lens_sigma = table.lens_sigma();
        let references = &self.network.references;
        let duty = match references.cameras.iter().position(|&id| id == placed.id) {
            Some(0) => Some(Duty::First),
            Some(_) => Some(Duty::Second),
            None => None,
        };
        camera.reference = duty
            .filter(|_| references.are_configured())
            .map(|duty| Reference {
                duty,
                position: known.baseline.map(|baseline| match duty {
                    Duty::First => [0.0; 2],
                    Duty::Second => [baseline as f32, 0.0],
                }),
            });
        camera.may_be_elected = references.elected && firmware.may_be_elected.unwrap_or(true);
        camera.baseline = known.baseline.map(|baseline| baseline as f32);
        camera.frame_heading_deg = known
            .frame_heading
            .map(|heading| heading.to_degrees() as f32);
        // Checked to be no more than a camera keeps. For the references as many as are planned:
        // their order is that of the whole way.
        camera.stops = self.scenario.stops as u8;
        camera.reference_stops = self.scenario.stops.min(REFERENCE_STOPS) as u8;
        firmware.configure_camera(&mut camera);
        // No camera reaches 0; a configuration has no such value.
        for sigma in [
            &mut camera.good_enough.position,
            &mut camera.good_enough.heading_deg,
        ] {
            *sigma = sigma.max(f32::MIN_POSITIVE);
        }
        camera
    }

    fn target(&self, table: &TargetTable) -> TargetConfig {
        let colours = self.scenario.colours(self.network);
        let colour = if self.scenario.is_tagged(self.network) {
            let mut wearers = self.scenario.wearers(self.network);
            wearers.position(|target| target.id == table.id)
        } else {
            colours.iter().position(|(c, _)| *c == table.colour)
        };
        let mut visited = self.scenario.visited_from(self.number.into());
        let mut target = self.scenario.target_config(table);
        target.lens_sigma = self.scenario.lens_sigma(self.network);
        target.survey_sigma = self.scenario.survey_sigma(self.network);
        target.colour = colour.unwrap_or(0) as u8;
        target.roams = visited.next().is_some();
        target
    }
}

impl Scenario {
    /// Promises that all lenses and places of references are exactly as the file says.
    #[must_use]
    pub fn exact(mut self) -> Self {
        self.camera.field_of_view_sigma = Some(0.0);
        self.camera.principal_sigma = Some(0.0);
        self.camera.tilt_sigma_deg = Some(0.0);
        for network in &mut self.networks {
            network.references.baseline_sigma = Some(0.0);
            network.references.position_sigma = Some(0.0);
        }
        self
    }

    /// The length of so many metres in the unit of the site, as far as a configuration has it.
    fn of_metres(&self, metres: f32) -> f32 {
        (f64::from(metres) / self.metres_per_unit()).min(1000.0) as f32
    }

    /// A target's parameters but for the number of its colour.
    /// One for all cameras of a network: that of the lens which is known least.
    fn lens_sigma(&self, network: &NetworkTable) -> LensSigma {
        let sigmas = network.cameras.iter().map(|placed| {
            let table = self.camera.for_camera(placed);
            table.lens_sigma()
        });
        sigmas.fold(LensSigma::EXACT, LensSigma::larger)
    }

    fn survey_sigma(&self, network: &NetworkTable) -> SurveySigma {
        let references = &network.references;
        let mut sigma = SurveySigma::MEASURED;
        sigma.position = self.of_metres(sigma.position);
        if let Some(told) = references.baseline_sigma {
            sigma.baseline = told as f32;
        }
        if let Some(told) = references.position_sigma {
            sigma.position = told as f32;
        }
        sigma
    }

    /// A place of the building as people tell it to a target whose steps are not known: in the frame of its network,
    /// as exact as places of references are measured. `None` if the file does not tell where that frame is.
    pub fn told_place(&self, network: &NetworkTable, place: Point2<f64>) -> Option<SitePlace> {
        let home = self.home_of(network).unwrap_or(network);
        let frame = home.building_frame();
        let place = frame.filter(|_| !home.references.elected)?.place(place);
        let sigma = self.survey_sigma(home).position;
        let position = [place.x as f32, place.y as f32];
        Some((position, [sigma * sigma, 0.0, sigma * sigma]))
    }

    /// Knowledge that the target of a network has of it before it walks. `known` is what of the frame is told.
    pub(crate) fn told(&self, network: &NetworkTable, known: &Known<f64>) -> Told {
        let survey = self.survey_sigma(network);
        Told {
            lens: self.lens_sigma(network).of_tangent().map(f64::from),
            baseline: known.baseline.map(|_| survey.baseline.into()),
            place: known.baseline.map_or(0.0, |_| survey.position.into()),
        }
    }

    pub(crate) fn target_config(&self, table: &TargetTable) -> TargetConfig {
        let mut target = TargetConfig::default();
        target.standing_sigma = self.of_metres(target.standing_sigma);
        let own = table.firmware.unwrap_or_default();
        own.over(self.firmware).configure_target(&mut target);
        target
    }
}

impl super::file::CameraTable {
    /// Baud rate of the line between node and camera.
    pub fn baud(&self) -> u32 {
        let usual = || match self.kind.model() {
            None => CameraConfig::new(self.believed(), Subjects::Motion { threshold: 1 }),
            Some(model) => CameraConfig::pixy(model, 1),
        };
        self.baud.unwrap_or_else(|| usual().baud)
    }

    /// The lens that the node believes to have.
    pub(crate) fn believed(&self) -> Lens {
        let model = &self.model;
        Lens {
            columns: self.size()[0],
            field_of_view_deg: model
                .field_of_view_deg
                .unwrap_or_else(|| self.field_of_view_deg()) as f32,
            projection: model.projection.unwrap_or_else(|| self.projection()),
            principal_column: model.principal_column.map(|column| column as f32),
            distortion: { model.distortion.unwrap_or(self.distortion()) }.map(|k| k as f32),
        }
    }
}

fn channel_mask(channels: &[u8]) -> u32 {
    channels
        .iter()
        .fold(0, |mask, channel| mask | 1 << channel.min(&31))
}

/// Window of the usual ball: targets carry it where the file says nothing else.
pub(crate) fn usual_window() -> ColourWindow {
    window(orange(), COLOUR_TOLERANCE)
}

fn window(colour: Rgb, tolerance: u8) -> ColourWindow {
    let [red, green, blue] = colour.map(|level| {
        // Levels that a CMUcam2 can see: 16 to 240.
        [
            level.saturating_sub(tolerance).clamp(16, 240),
            level.saturating_add(tolerance).clamp(16, 240),
        ]
    });
    ColourWindow { red, green, blue }
}
