//! Facts about a network from a site file, beside those that the network tells itself.

use nalgebra::{Point2, Vector2};
use node_firmware::{
    config::{CameraConfig, RoleConfig as Configured, SiteKey, Subjects, TargetConfig},
    vision::Lens,
};
use site::{
    Frame, NetworkTable, Scenario, ScenarioError, WorldTable,
    world::{Obstacle, ObstacleShape},
};

use crate::record::{Limits, Node, Place, Role, Unit, View, heading_degrees, space::Told};

/// Corners of a pillar's outline.
const PILLAR: u8 = 24;

/// A site file, for one of its networks.
#[derive(Clone, Debug)]
pub struct SitePlan {
    pub(super) name: String,
    pub(super) unit: Unit,
    pub(super) limits: Limits,
    pub(super) hanging: Told,
    scenario: Scenario,
    network: NetworkTable,
    number: u16,
    frame: Option<Frame>,
}

impl SitePlan {
    /// The network of a site to which most of these numbers belong; `None` if it has no network.
    ///
    /// # Errors
    /// The nodes of the file cannot be configured.
    pub fn new(scenario: &Scenario, members: &[u16]) -> Result<Option<Self>, ScenarioError> {
        // No key is needed to know what else nodes are configured to.
        let configs = site::configs(scenario, SiteKey::new(1, *b"no key is needed"))?;
        let belong = |network: &NetworkTable| {
            let cameras = network.cameras.iter().map(|camera| camera.id);
            let targets = network.targets.iter().map(|target| target.id);
            cameras
                .chain(targets)
                .filter(|id| members.contains(id))
                .count()
        };
        let networks = scenario.networks.iter().zip(&configs).enumerate();
        // If several have as many, the first.
        let best = networks
            .rev()
            .max_by_key(|(_, (network, _))| belong(network));
        let Some((index, (network, configs))) = best else {
            return Ok(None);
        };
        let weak = configs
            .cameras
            .first()
            .map(|config| &config.settings().role);
        let limits = match weak {
            Some(Configured::Camera(camera)) => limits(camera),
            _ => usual_limits(),
        };
        let ball_height = network.targets.first().and_then(|target| target.height);
        let carried = configs
            .targets
            .first()
            .map(|config| &config.settings().role);
        let hanging = match carried {
            Some(Configured::Target(target)) => Told::new(target, ball_height),
            _ => usually_told(),
        };
        Ok(Some(Self {
            name: scenario.name.clone(),
            unit: Unit {
                name: scenario.unit.clone(),
                metres: scenario.metres_per_unit(),
            },
            limits,
            hanging,
            frame: scenario.building_frame(network),
            network: network.clone(),
            number: index as u16 + 1,
            scenario: scenario.clone(),
        }))
    }

    /// The number of the network in the file, from 1.
    pub fn number(&self) -> u16 {
        self.number
    }

    /// The same when these cameras are the references, if that is known.
    pub(super) fn with_references(&self, references: Option<[u16; 2]>) -> Self {
        let mut plan = self.clone();
        if let Some(references) = references
            && self.network.references.frame_of.is_none()
        {
            plan.frame = self.network.frame_between(references);
        }
        plan
    }

    /// Where the frame of the network is in the building.
    pub(super) fn building(&self) -> Option<Place> {
        self.frame.as_ref().map(building_place)
    }

    /// The cameras and targets that there should be.
    pub(super) fn nodes(&self) -> Vec<Node> {
        let cameras = self.network.cameras.iter().map(|placed| {
            let mut node = Node::new(placed.id, Role::Camera);
            let table = self.scenario.camera.for_camera(placed);
            node.expected = true;
            node.reference = self.network.references.are_configured()
                && self.network.references.cameras.contains(&placed.id);
            node.view = Some(View {
                fov_deg: table.field_of_view_deg(),
                range: table.range,
            });
            node.planned = self.frame.zip(placed.place()).zip(placed.heading_deg).map(
                |((frame, place), heading_deg)| {
                    let place = frame.place(place);
                    Place::new(
                        place.x,
                        place.y,
                        heading_degrees(frame.direction(heading_deg.to_radians())),
                    )
                },
            );
            node
        });
        let targets = self.network.targets.iter();
        let targets = targets.map(|target| Node::new(target.id, Role::Target));
        cameras.chain(targets).collect()
    }

    /// Height of the middle of its ball above the floor, if the file tells it.
    pub(super) fn ball_height(&self) -> Option<f64> {
        self.network.targets.first()?.height
    }

    /// The outline of where a person can walk, in the frame of the network; empty if it is not known where that is.
    pub(super) fn area(&self) -> Vec<[f64; 2]> {
        let frame = self.frame.as_ref();
        frame.map_or_else(Vec::new, |frame| area(&self.scenario.world, frame))
    }

    /// The outlines of what hides targets, in the frame of the network; none if it is not known where that is.
    pub(super) fn obstacles(&self) -> Vec<Vec<[f64; 2]>> {
        let Some(frame) = &self.frame else {
            return Vec::new();
        };
        let all = site::obstacles(&self.scenario).into_iter();
        all.map(|obstacle| outline(&obstacle, frame)).collect()
    }
}

/// Knowledge that a target has where no file of a site says more.
pub(super) fn usually_told() -> Told {
    Told::new(&TargetConfig::default(), None)
}

/// The outline of where a person can walk, in a frame; empty where the site's file does not tell it.
pub fn area(world: &WorldTable, frame: &Frame) -> Vec<[f64; 2]> {
    let usual = WorldTable::default();
    if (world.low, world.high) == (usual.low, usual.high) {
        return Vec::new();
    }
    let ([left, low], [right, high]) = (world.low, world.high);
    let corners = [[left, low], [right, low], [right, high], [left, high]];
    let placed = corners.map(|corner| frame.place(Point2::from(corner)).into());
    placed.to_vec()
}

/// Where a frame is in the building.
pub fn building_place(frame: &Frame) -> Place {
    Place::new(
        frame.origin.x,
        frame.origin.y,
        heading_degrees(calib_core::angle::wrap_positive(frame.heading)),
    )
}

/// The outline of an obstacle in a frame.
pub fn outline(obstacle: &Obstacle, frame: &Frame) -> Vec<[f64; 2]> {
    let corners = match &obstacle.shape {
        ObstacleShape::Segment(ends) => ends.to_vec(),
        ObstacleShape::Disc { centre, radius } => (0..PILLAR)
            .map(|n| {
                let turn = f64::from(n) / f64::from(PILLAR) * std::f64::consts::TAU;
                let (sin, cos) = turn.sin_cos();
                centre + Vector2::new(cos, sin) * *radius
            })
            .collect(),
        ObstacleShape::Polygon(corners) => corners.clone(),
    };
    let corners = corners
        .into_iter()
        .map(|corner: Point2<f64>| frame.place(corner));
    corners.map(Into::into).collect()
}

/// Limits of weak poses that a camera was told.
pub fn limits(camera: &CameraConfig) -> Limits {
    Limits {
        sigma_position: camera.weak.position.into(),
        sigma_heading_deg: camera.weak.heading_deg.into(),
    }
}

/// Limits that cameras are told by default.
pub(super) fn usual_limits() -> Limits {
    // They do not depend on these.
    let (lens, subjects) = (Lens::pin_hole(88, 45.0), Subjects::Motion { threshold: 12 });
    limits(&CameraConfig::new(lens, subjects))
}
