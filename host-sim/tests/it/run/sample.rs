//! Possible runs: the thesis's cameras see the target through whole-pixel columns,
//! and their poses are solved from that.

use calib_core::{
    Pose, Ray, Refusal, Sighting, Status,
    camera::{Camera, Projection},
    resection,
};
use nalgebra::{Matrix3, Point2};
use rand::RngExt;
use results::record::{
    Believed, FORMAT, Limits, Network, Node, Place, Protection, Radio, Role, RunRecord, Stop,
    Target, Unit, View, published::Published, summary::Summary,
};
use test_support::{Random, generator, normal};

/// Place of a camera of Table 4.1, and its heading in degrees.
pub(crate) fn camera(id: u16) -> (f64, f64, f64) {
    let Place {
        x, y, heading_deg, ..
    } = cameras()[usize::from(id) - 1];
    (x, y, heading_deg)
}

/// Cameras of Table 4.1.
fn cameras() -> Vec<Place> {
    let thesis = Published::named("thesis-4.1", Some(1)).unwrap();
    assert_eq!(thesis.nodes.len(), 13);
    thesis.nodes.iter().map(|node| node.truth).collect()
}

const FOV_DEG: f64 = 60.0;
const RANGE: f64 = 8.0;
const COLUMNS: u16 = 88;
pub(crate) const TARGET: u16 = 20;
const LIMITS: Limits = Limits {
    sigma_position: 1.0,
    sigma_heading_deg: 10.0,
};
/// Protection of every pose.
pub(crate) const CHECKED: Protection = Protection {
    position: 0.42,
    heading_deg: 2.5,
};
/// The only network.
pub(crate) const FIRST: Network = Network {
    network: 1,
    frame: Place::new(0.0, 0.0, 0.0),
    building: Some(Place::new(10.0, -4.0, 90.0)),
    pan: Some(0x1234),
    channel: Some(15),
    ball_height: None,
};
/// Sigma of a place that the target believes in.
const STOP_SIGMA: f64 = 0.01;

/// Special properties of a run.
#[derive(Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) seed: u64,
    /// Number of stops made for every camera.
    pub(crate) stops: u32,
    /// Projection of the cameras; they are taken for pin-holes.
    pub(crate) projection: Projection,
    /// Cameras that see nothing.
    pub(crate) blind: &'static [u16],
    /// Cameras that see the target only at this number of their stops.
    pub(crate) short: Option<(u16, usize)>,
}

impl Default for Sample {
    fn default() -> Self {
        Self {
            seed: 7,
            stops: 3,
            projection: Projection::PinHole,
            blind: &[],
            short: None,
        }
    }
}

impl Sample {
    pub(crate) fn run(self) -> RunRecord {
        let mut random = generator(self.seed);
        let stops = self.stops(&mut random);
        let mut coordinator = Node::new(0, Role::Coordinator);
        coordinator.payload_bytes = Some(100);
        coordinator.bytes_sent = Some(2000);
        coordinator.frames_sent = Some(40);
        let mut nodes = vec![coordinator];
        for id in 1..=13 {
            nodes.push(self.camera(id, &stops, &mut random));
        }
        let mut target = Node::new(TARGET, Role::Target);
        target.payload_bytes = Some(40 * stops.len() as u64);
        target.bytes_sent = Some(90 * stops.len() as u64);
        target.frames_sent = Some(2 * stops.len() as u64);
        nodes.push(target);
        RunRecord {
            format: FORMAT,
            scenario: "thesis-13".to_owned(),
            path: Some(1),
            published: Some("thesis-4.1".to_owned()),
            seed: Some(self.seed),
            unit: Unit {
                name: "units".to_owned(),
                metres: 1.0,
            },
            limits: LIMITS,
            networks: vec![FIRST],
            summary: Summary::of(&nodes),
            radio: Some(Radio {
                frames: nodes.iter().filter_map(|n| n.frames_sent).sum(),
                bytes: nodes.iter().filter_map(|n| n.bytes_sent).sum(),
                drops: [("collision".to_owned(), 2), ("loss".to_owned(), 5)].into(),
                airtime_share: 0.0031,
                attack: None,
            }),
            nodes,
            targets: vec![Target {
                id: TARGET,
                network: 1,
                path: stops.iter().map(|stop| [stop.x, stop.y]).collect(),
                stops,
            }],
            sightings: Vec::new(),
            obstacles: vec![vec![[11.0, 8.0], [12.5, 8.0], [12.5, 9.0], [11.0, 9.0]]],
            area: Vec::new(),
            sim_seconds: 840.25,
            tracking: Vec::new(),
            stops_in_vain: false,
            wall_seconds: Some(0.31),
        }
    }

    /// Some stops in view of every camera in turn.
    fn stops(self, random: &mut Random) -> Vec<Stop> {
        let mut stops = Vec::new();
        for Place {
            x, y, heading_deg, ..
        } in cameras()
        {
            for k in 0..self.stops {
                let side = [-0.7, 0.7, 0.0][k as usize % 3];
                let bearing = 0.4 * (side + random.random_range(-0.25..0.25));
                let angle = heading_deg.to_radians() + bearing;
                let range = [0.35, 0.6, 0.8][k as usize % 3] * RANGE;
                let (x, y) = (x + range * angle.cos(), y + range * angle.sin());
                stops.push(Stop {
                    stop: stops.len() as u32,
                    seconds: Some(20.0 * (stops.len() + 1) as f64),
                    x,
                    y,
                    believed: Some(Believed {
                        x: x + STOP_SIGMA * normal(random),
                        y: y + STOP_SIGMA * normal(random),
                        sigma_x: STOP_SIGMA,
                        sigma_y: STOP_SIGMA,
                    }),
                });
            }
        }
        stops
    }

    fn camera(self, id: u16, stops: &[Stop], random: &mut Random) -> Node {
        let (x, y, heading_deg) = camera(id);
        let mut node = Node::new(id, Role::Camera);
        node.reference = id <= 2;
        node.expected = true;
        node.truth = Some(Place::new(x, y, heading_deg));
        node.view = Some(View {
            fov_deg: FOV_DEG,
            range: RANGE,
        });
        let fov = FOV_DEG.to_radians();
        let real = Camera::new(self.projection, COLUMNS, fov).unwrap();
        let assumed = Camera::pin_hole(COLUMNS, fov).unwrap();
        let mut seen: Vec<(u32, Sighting<f64>)> = Vec::new();
        for stop in stops {
            let d = Point2::new(stop.x, stop.y) - Point2::new(x, y);
            let bearing = d.y.atan2(d.x) - heading_deg.to_radians();
            let column = real
                .column(Ray::from_bearing(bearing))
                .filter(|_| d.norm() < RANGE);
            let (Some(column), Some(believed)) = (column, stop.believed) else {
                continue;
            };
            let column = column.round();
            let place = Point2::new(believed.x, believed.y);
            let sigma = assumed.whole_pixel_sigma(column);
            let sighting = Sighting::new(place, assumed.ray(column), sigma);
            seen.push((stop.stop, sighting.with_target_sigma(STOP_SIGMA)));
        }
        if self.blind.contains(&id) {
            seen.clear();
        }
        if let Some((_, few)) = self.short.filter(|(short, _)| *short == id) {
            seen.truncate(few);
        }
        let sightings: Vec<_> = seen.iter().map(|(_, sighting)| *sighting).collect();
        let pose = if node.reference && !sightings.is_empty() {
            Ok(reference_pose(&node.truth.unwrap(), random))
        } else {
            resection::solve(&sightings).map(|solution| solution.pose)
        };
        match pose {
            Ok(pose) => {
                node.set_pose(&pose);
                node.calibrated_seconds = seen.get(2).map(|(stop, _)| 20.0 * f64::from(*stop + 1));
            }
            Err(refusal) => {
                node.status = Some(refusal.into());
                node.reason = Some(refusal);
            }
        }
        node.set_sightings(
            seen.iter()
                .map(|(stop, sighting)| (TARGET, *stop, sighting)),
        );
        node.sightings = seen.len();
        if node.estimate.is_some() {
            judge(&mut node);
            // As if a target had made a joint estimate.
            node.protection = (!node.reference).then_some(CHECKED);
            node.used = node.sightings;
        }
        assert!(node.reason != Some(Refusal::NotFinite));
        node.payload_bytes = Some(20 * seen.len() as u64 + 30);
        node.bytes_sent = Some(60 * seen.len() as u64 + 300);
        node.frames_sent = Some(2 * seen.len() as u64 + 8);
        node
    }
}

/// Sets the camera's own judgement of its pose.
pub(crate) fn judge(node: &mut Node) {
    if node.reference {
        // From the stops of their common solution.
        node.status = Some(Status::Calibrated);
        return;
    }
    let limits = calib_core::Limits {
        position: LIMITS.sigma_position,
        heading: LIMITS.sigma_heading_deg.to_radians(),
    };
    let pose = node.estimate.unwrap().pose();
    node.status = Some(Status::of(&pose, &node.fit(), &limits));
}

/// A reference's place is given, its heading is not.
fn reference_pose(truth: &Place, random: &mut Random) -> Pose<f64> {
    let sigma = 0.003;
    Pose {
        position: truth.position(),
        heading: truth.heading_deg.to_radians() + sigma * normal(random),
        covariance: Matrix3::from_diagonal(&[0.0, 0.0, sigma * sigma].into()),
    }
}
