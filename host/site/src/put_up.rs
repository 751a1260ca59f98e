//! A scenario put up: the world, and what stands and walks in it.

use std::f64::consts::{PI, TAU};

use calib_core::{
    camera::{Camera as Optics, Projection},
    reference::Known,
};
use nalgebra::{Point2, Rotation2, Vector2};
use node_firmware::{
    config::{CameraConfig, Subjects},
    vision::CameraKind,
};

use super::{
    check::{self, fault_rates, refuse},
    error::ScenarioError,
    file::{
        CameraTable, NetworkTable, OutlineTable, PillarTable, PlacedCamera, Scenario, TargetTable,
    },
    planner::{self, Noise, Plan, PlanError, RARE, Steps, Task, Told, Tolerance},
};
use crate::world::{
    Camera, Gait, Mount, Obstacle, ObstacleShape, SensorErrors, Target, Variant, World,
};
use cmucam2_emulator::{FaultRates, Lens, Rgb, Sensor};

/// All of a scenario, with planned stops.
#[derive(Clone, Debug)]
pub struct Site {
    /// Cameras, targets and obstacles. A target stands at its first stop.
    pub world: World,
    /// The networks.
    pub networks: Vec<Network>,
    /// Objects that are to be tracked. Each is out of all cameras' view until it is moved.
    pub objects: Vec<MovingObject>,
}

/// Something of a target's colour, without a radio.
#[derive(Clone, Debug)]
pub struct MovingObject {
    /// The world's target.
    pub index: usize,
    /// Where it goes, to and fro.
    pub path: Vec<Point2<f64>>,
    /// Units per second.
    pub speed: f64,
}

/// Where objects are that are not there yet.
const ELSEWHERE: f64 = 1e7;

/// One network of a site.
#[derive(Clone, Debug)]
pub struct Network {
    /// Where its coordinator stands.
    pub coordinator: Point2<f64>,
    /// Its cameras.
    pub cameras: Vec<CameraNode>,
    /// The references among them: indices of `cameras`.
    pub references: [usize; 2],
    /// The references are to be elected.
    pub elected: bool,
    /// There are none: targets of this network, counted from 0, bring its frame.
    pub home: Option<usize>,
    /// Prior knowledge of the frame that its nodes are told.
    pub known: Known<f64>,
    /// Accuracy of that, and of lenses, as its targets count with it.
    pub told: Told,
    /// The frame in which the network reports.
    pub frame: Frame,
    /// Height of the middle of its ball above the floor.
    pub ball_height: f64,
    /// Its targets.
    pub targets: Vec<TargetNode>,
}

/// A node with a camera.
#[derive(Clone, Debug)]
pub struct CameraNode {
    /// Its number.
    pub id: u16,
    /// The world's camera.
    pub index: usize,
    /// Kind of camera.
    pub kind: CameraKind,
    /// Colours that a camera of the Pixy family was taught, signature 1 first.
    pub taught: Vec<Rgb>,
    /// The world's targets that wear tags, that of tag 0 first.
    pub tags: Vec<usize>,
    /// Image sensor of a CMUcam2.
    pub sensor: Sensor,
    /// Baud rate of its line.
    pub baud: u32,
    /// Rates of the camera's faults.
    pub faults: FaultRates,
    /// Noise of its pixels, levels, and change of the light, as in a
    /// [`Scene`](cmucam2_emulator::Scene).
    pub noise: f64,
    /// See `noise`.
    pub flicker: f64,
    /// The lens that the node believes to have.
    pub model: Optics<f64>,
    /// Its projection and field of view, degrees.
    pub model_lens: (Projection, f64),
}

/// A node with a target.
#[derive(Clone, Debug)]
pub struct TargetNode {
    /// Its number.
    pub id: u16,
    /// The world's target.
    pub index: usize,
    /// Gait of the target.
    pub gait: Gait,
    /// Where it stops, in the world.
    pub stops: Vec<Point2<f64>>,
    /// Predicted accuracy, if its stops were planned.
    pub plan: Option<Plan>,
    /// Errors of its step sensor.
    pub errors: SensorErrors,
    /// Accuracy of its steps, as it counts with it.
    pub steps: Steps,
    /// Direction of the x axis of its step sensor in the world, radians.
    pub axis: f64,
    /// Distance that it believes to stand off the place that it tells, standard deviation of each axis.
    pub standing_sigma: f64,
}

/// The frame in which a network reports poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// The first reference.
    pub origin: Point2<f64>,
    /// Direction from the first reference to the second one in the world, radians.
    pub heading: f64,
}

impl Frame {
    /// Frame of references at these places of the world.
    pub fn between([origin, other]: [Point2<f64>; 2]) -> Self {
        let baseline = other - origin;
        Self {
            origin,
            heading: baseline.y.atan2(baseline.x),
        }
    }

    /// A place of the world in this frame.
    pub fn place(&self, world: Point2<f64>) -> Point2<f64> {
        Point2::from(Rotation2::new(-self.heading) * (world - self.origin))
    }

    /// Where a place of this frame is in the world.
    pub fn in_world(&self, place: Point2<f64>) -> Point2<f64> {
        self.origin + Rotation2::new(self.heading) * place.coords
    }

    /// A direction of the world in this frame, radians in `[0, 2 pi)`.
    pub fn direction(&self, world: f64) -> f64 {
        calib_core::angle::wrap_positive(world - self.heading)
    }
}

impl Site {
    /// The frame in which a network reports when these of its cameras are its references.
    pub fn frame(&self, network: &Network, references: [usize; 2]) -> Frame {
        let place = |camera: usize| self.world.cameras()[network.cameras[camera].index].place;
        Frame::between(references.map(place))
    }
}

/// Height of the middle of a ball above the floor, where the file has none, metres.
const BALL_HEIGHT: f64 = 1.0;

/// Height of the middle of a network's ball above the floor.
fn ball_height(scenario: &Scenario, table: &NetworkTable) -> f64 {
    let told = table.targets.first().and_then(|target| target.height);
    told.unwrap_or(BALL_HEIGHT / scenario.metres_per_unit())
}

/// Mounting of a camera above a ball.
fn mount(
    name: &str,
    table: &CameraTable,
    placed: &PlacedCamera,
    ball_height: f64,
) -> Result<Mount, ScenarioError> {
    let [pitch, roll] = [placed.pitch_deg, placed.roll_deg].map(Option::unwrap_or_default);
    let mount = Mount {
        height: placed.height.map_or(0.0, |height| height - ball_height),
        pitch: pitch.to_radians(),
        roll: roll.to_radians(),
    };
    let key = if pitch == 0.0 {
        "roll_deg"
    } else {
        "pitch_deg"
    };
    if table.variant == Variant::Stage && mount != Mount::LEVEL {
        let allowed =
            "left out with the variant `stage`: its cameras are level, at the height of the ball";
        return Err(refuse(format!("{name}.{key}"), "given", allowed));
    }
    let is_tilted = pitch != 0.0 || roll != 0.0;
    if is_tilted && table.tilt_sigma_deg == Some(0.0) {
        let allowed = "0 where `camera.tilt_sigma_deg = 0` promises that every camera is level: nodes believe that. \
                       Leave that key out";
        return Err(refuse(format!("{name}.{key}"), pitch + roll, allowed));
    }
    Ok(mount)
}

/// The camera of the world that one of a file is.
fn camera(
    name: &str,
    table: &CameraTable,
    placed: &PlacedCamera,
    ball_height: f64,
) -> Result<(Camera, CameraNode), ScenarioError> {
    let missing = |field: &str| {
        let allowed = "there in a rehearsal, which puts this camera somewhere; only nodes are \
                       configured without it";
        refuse(format!("{name}.{field}"), "missing", allowed)
    };
    let place = Point2::new(
        placed.x.ok_or_else(|| missing("x"))?,
        placed.y.ok_or_else(|| missing("y"))?,
    );
    let heading_deg = placed.heading_deg.ok_or_else(|| missing("heading_deg"))?;
    let believed = table.believed();
    let degrees = { table.model.field_of_view_deg }.unwrap_or_else(|| table.field_of_view_deg());
    let model_lens = (believed.projection, degrees);
    let model = check::model(name, table)?;
    let camera = Camera {
        place,
        heading: heading_deg.to_radians(),
        mount: mount(name, table, placed, ball_height)?,
        lens: check::lens(name, table)?,
        range: table.range,
        variant: table.variant,
    };
    let node = CameraNode {
        id: placed.id,
        index: 0,
        kind: table.kind,
        taught: Vec::new(),
        tags: Vec::new(),
        sensor: table.sensor.into(),
        baud: table.baud(),
        faults: fault_rates(name, &table.faults)?,
        noise: table.noise,
        flicker: table.flicker,
        model,
        model_lens,
    };
    Ok((camera, node))
}

/// Parts of an obstacle of a file: a wall is a segment between each two of its corners.
fn outlines(table: &OutlineTable) -> Vec<ObstacleShape> {
    let one = match table {
        OutlineTable::Wall(corners) => {
            let segments = corners.windows(2);
            let segment =
                |ends: &[[f64; 2]]| ObstacleShape::Segment([ends[0], ends[1]].map(Point2::from));
            return segments.map(segment).collect();
        }
        &OutlineTable::Pillar(PillarTable { x, y, radius }) => ObstacleShape::Disc {
            centre: Point2::new(x, y),
            radius,
        },
        OutlineTable::Block(corners) => ObstacleShape::Polygon(places(corners)),
    };
    vec![one]
}

/// All obstacles of a file, with their tops above the middle of the balls: above the lowest ones, where networks have balls
/// at different heights.
pub fn obstacles(scenario: &Scenario) -> Vec<Obstacle> {
    let balls = scenario.networks.iter();
    let lowest = balls
        .map(|network| ball_height(scenario, network))
        .fold(f64::INFINITY, f64::min);
    let tables = scenario.world.obstacles.iter();
    tables
        .flat_map(|table| {
            let top = table.height.map_or(f64::INFINITY, |height| height - lowest);
            let shapes = outlines(&table.outline).into_iter();
            shapes.map(move |shape| Obstacle { shape, top })
        })
        .collect()
}

/// The number in the file, from 1, of the table that an obstacle of the world is of.
fn number_in_file(scenario: &Scenario, obstacle: usize) -> usize {
    let mut before = 0;
    let tables = scenario.world.obstacles.iter();
    let number = tables.take_while(|table| {
        before += outlines(&table.outline).len();
        before <= obstacle
    });
    number.count() + 1
}

/// Columns of the smallest tag that an OpenMV Cam reads, and one for its rounding.
const LEAST_TAG: f64 = 11.0;

/// Distance up to which the tag of the smallest target is read.
fn farthest_tag(scenario: &Scenario, lens: &Lens) -> f64 {
    let targets = scenario
        .networks
        .iter()
        .flat_map(|network| &network.targets);
    let radius = targets
        .map(|target| target.radius)
        .fold(f64::INFINITY, f64::min);
    let middle = (lens.columns() - 1.0) / 2.0;
    let column = lens.bearing(middle - 0.5) - lens.bearing(middle + 0.5);
    2.0 * radius / (LEAST_TAG * column)
}

/// Puts a checked scenario up, but for the stops of its targets.
pub(super) fn furnish(scenario: &Scenario) -> Result<Site, ScenarioError> {
    let obstacles = obstacles(scenario);
    let mut cameras = Vec::new();
    let mut targets = Vec::new();
    let mut networks = Vec::new();
    for (n, table) in (1..).zip(&scenario.networks) {
        let mut nodes = Vec::new();
        let ball_height = ball_height(scenario, table);
        for (c, placed) in (1..).zip(&table.cameras) {
            let name = format!("network {n}.camera {c}");
            let of_all = scenario.camera.for_camera(placed);
            let (mut camera, mut node) = camera(&name, &of_all, placed, ball_height)?;
            if node.kind == CameraKind::OpenMvTags {
                camera.range = camera.range.min(farthest_tag(scenario, &camera.lens));
            }
            if let Some(o) = obstacles
                .iter()
                .position(|o| o.shape.contains(camera.place))
            {
                let allowed = format!("outside of obstacle {}", number_in_file(scenario, o));
                let found = format!("({}, {})", camera.place.x, camera.place.y);
                return Err(refuse(format!("{name} (x, y)"), found, allowed));
            }
            node.index = cameras.len();
            let colours = scenario.colours(table).into_iter();
            node.taught = colours.map(|(colour, _)| colour).collect();
            if node.kind == CameraKind::OpenMvTags {
                let all = scenario.networks.iter().flat_map(|table| &table.targets);
                let index = |id: u16| all.clone().position(|target| target.id == id);
                let worn = scenario.wearers(table);
                node.tags = worn.filter_map(|target| index(target.id)).collect();
            }
            cameras.push(camera);
            nodes.push(node);
        }
        let first_target = targets.len();
        targets.extend(table.targets.iter().map(|target| Target {
            place: Point2::origin(),
            above: 0.0,
            radius: target.radius,
            colour: target.colour,
        }));
        networks.push(network(scenario, n, table, nodes, first_target, &cameras)?);
    }
    for place in 0..networks.len() {
        if let Some(home) = networks[place].home.and_then(|home| networks.get(home)) {
            networks[place].frame = home.frame;
        }
    }
    targets.extend(scenario.objects.iter().map(|object| Target {
        place: Point2::new(ELSEWHERE, ELSEWHERE),
        above: 0.0,
        radius: object.radius,
        colour: object.colour,
    }));
    let world = World::new(cameras, obstacles, targets);
    Ok(Site {
        world,
        networks,
        objects: Vec::new(),
    })
}

/// Puts a checked scenario up.
pub(super) fn put_up(scenario: &Scenario) -> Result<Site, ScenarioError> {
    with_stops(scenario, furnish(scenario)?)
}

/// Plans the stops that the scenario does not give.
pub(super) fn with_stops(scenario: &Scenario, site: Site) -> Result<Site, ScenarioError> {
    let Site {
        mut world,
        mut networks,
        ..
    } = site;
    let first_object = world.targets().len() - scenario.objects.len();
    for place in 0..networks.len() {
        for target in stops(scenario, place, &networks, &world)? {
            if let Some(&first) = target.stops.first() {
                world.move_target(target.index, first);
            }
            let targets = networks[place].targets.iter_mut();
            for own in targets.filter(|own| own.id == target.id) {
                *own = target.clone();
            }
        }
    }
    let first = networks.first().and_then(|network| network.targets.first());
    let way = first.map_or(&[][..], |target| &target.stops);
    let count = scenario.objects.len().max(1);
    let objects = scenario.objects.iter().enumerate().map(|(n, object)| {
        let path = object.path.as_deref().map(places);
        MovingObject {
            index: first_object + n,
            path: path.unwrap_or_else(|| {
                let begin = way.len() * n / count;
                [&way[begin..], &way[..begin]].concat()
            }),
            speed: object.speed.unwrap_or(scenario.walk.speed),
        }
    });
    let objects: Vec<MovingObject> = objects.collect();
    for (n, (object, table)) in (1..).zip(objects.iter().zip(&scenario.objects)) {
        if table.path.is_some() {
            let who = format!("object {n}");
            clear_way(scenario, (&who, table.radius), &object.path, &world)?;
        }
    }
    Ok(Site {
        world,
        networks,
        objects,
    })
}

fn network(
    scenario: &Scenario,
    number: usize,
    table: &NetworkTable,
    nodes: Vec<CameraNode>,
    first_target: usize,
    cameras: &[Camera],
) -> Result<Network, ScenarioError> {
    let own = |id: u16| nodes.iter().position(|node| node.id == id).unwrap_or(0);
    let references = table.references.cameras.map(own);
    let [origin, other] = references.map(|index| cameras[nodes[index].index].place);
    let baseline = other - origin;
    if !(baseline.norm() > 0.0) {
        return Err(refuse(
            format!("network {number}.references"),
            "two cameras at one place",
            "two places",
        ));
    }
    let frame = Frame::between([origin, other]);
    let middle = nodes
        .iter()
        .map(|node| cameras[node.index].place.coords)
        .sum::<Vector2<f64>>()
        / nodes.len() as f64;
    let axis = match table.references.compass_deg {
        Some(degrees) => degrees.to_radians(),
        None if table.references.frame_heading_known() => frame.heading,
        None => 0.0,
    };
    let known = table.known(&format!("network {number}"))?;
    Ok(Network {
        coordinator: table.coordinator.map_or(Point2::from(middle), Point2::from),
        references,
        elected: table.references.elected,
        home: table.references.frame_of.map(|number| number - 1),
        told: scenario.told(table, &known),
        known,
        frame,
        ball_height: ball_height(scenario, table),
        targets: (first_target..)
            .zip(&table.targets)
            .map(|(index, target)| TargetNode {
                id: target.id,
                index,
                gait: gait(scenario),
                stops: Vec::new(),
                plan: None,
                errors: errors(scenario),
                steps: steps(scenario, target),
                axis,
                standing_sigma: scenario.target_config(target).standing_sigma.into(),
            })
            .collect(),
        cameras: nodes,
    })
}

fn gait(scenario: &Scenario) -> Gait {
    let walk = &scenario.walk;
    Gait {
        speed: walk.speed,
        arrive_within: walk.arrive_within,
        bob: walk.bob_sigma,
        step_length: walk.step_length,
        patience: (walk.patience_s * 1e9) as u64,
        ..Gait::default()
    }
}

fn errors(scenario: &Scenario) -> SensorErrors {
    let sensor = scenario.sensor.unwrap_or_default();
    SensorErrors {
        measures: sensor.measures,
        leg_distance: sensor.leg_distance,
        leg_heading: sensor.leg_heading_deg * PI / 180.0,
        undeclared_distance: sensor.undeclared_distance,
        undeclared_heading: sensor.undeclared_heading_deg * PI / 180.0,
        step_distance: sensor.step_distance,
        step_heading: sensor.step_heading_deg * PI / 180.0,
        scale_bias: sensor.scale_bias,
        heading_bias: sensor.heading_bias_deg * PI / 180.0,
    }
}

/// The targets of a network, each with its stops: in its own network, and then in those to which it
/// brings the frame, always the nearest one next.
fn stops(
    scenario: &Scenario,
    place: usize,
    networks: &[Network],
    world: &World,
) -> Result<Vec<TargetNode>, ScenarioError> {
    let network = &networks[place];
    let mut targets = network.targets.clone();
    for (target, own) in targets.iter_mut().zip(&scenario.networks[place].targets) {
        let who = format!("target {}", own.id);
        if let Some(stops) = &own.stops {
            target.stops = places(stops);
            clear_way(scenario, (&who, own.radius), &target.stops, world)?;
            continue;
        }
        let plan = planned(scenario, place, networks, (target, own), world)?;
        let mut stops: Vec<_> = plan.stops.iter().map(|stop| stop.place).collect();
        target.plan = Some(plan);
        let mut left: Vec<_> = scenario.visited_from(place).collect();
        let mut here = network.coordinator;
        let distance = |from: Point2<f64>, to: usize| (networks[to].coordinator - from).norm();
        while let Some(next) = (0..left.len())
            .min_by(|&a, &b| distance(here, left[a]).total_cmp(&distance(here, left[b])))
        {
            let next = left.remove(next);
            here = networks[next].coordinator;
            for stop in planned(scenario, next, networks, (target, own), world)?.stops {
                let from = stops.last().copied().unwrap_or(stop.place);
                // The way around is only looked for where there is something to go around.
                match world.obstacle_on_way(from, stop.place, own.radius) {
                    None => stops.push(stop.place),
                    Some(_) => {
                        let ends = [from, stop.place];
                        stops.extend(planner::way_around(world, own.radius, &stops, ends));
                    }
                }
            }
        }
        clear_way(scenario, (&who, own.radius), &stops, world)?;
        target.stops = stops;
    }
    Ok(targets)
}

/// The stops that a target makes in a network, its own one or another one.
fn planned(
    scenario: &Scenario,
    place: usize,
    networks: &[Network],
    (target, own): (&TargetNode, &TargetTable),
    world: &World,
) -> Result<Plan, ScenarioError> {
    let (network, table) = (&networks[place], &scenario.networks[place]);
    let index = |camera: usize| network.cameras[camera].index;
    let references = network.references.map(index);
    // A camera that is no reference needs stops of its own.
    let others: Vec<_> = (0..network.cameras.len())
        .map(index)
        .filter(|index| network.home.is_some() || !references.contains(index))
        .collect();
    let [low, high] = table
        .area
        .unwrap_or([scenario.world.low, scenario.world.high]);
    let id_of = |index| {
        let node = network.cameras.iter().find(|node| node.index == index);
        node.map_or(0, |node| node.id)
    };
    // As it is: the planner has the true displacements in the true frame. A target that brings a frame knows it.
    let is_known = network.home.is_some();
    let [first, second] = references.map(|index| world.cameras()[index].place);
    let known = Known {
        baseline: (is_known || network.known.baseline.is_some()).then(|| (second - first).norm()),
        frame_heading: (is_known || network.known.frame_heading.is_some()).then_some(0.0),
    };
    let task = Task {
        world,
        bounds: [low, high].map(Point2::from),
        references,
        known,
        cameras: &others,
        radius: own.radius,
        stops: scenario.stops,
        placement: scenario.placement,
        noise: Noise {
            columns: Noise::COLUMNS,
            standing: target.gait.standing_sigma(),
        },
        steps: target.steps,
        told: network.told,
        tolerance: tolerance(scenario),
        path: scenario.path,
        seed: scenario.scattered_by.unwrap_or(0),
        target: target.index as u64,
    };
    planner::plan(&task).map_err(|why| match why {
        PlanError::Camera { .. } | PlanError::References { .. } if are_radians(scenario) => {
            ScenarioError::Radians
        }
        PlanError::Camera { .. } | PlanError::References { .. }
            if let Some(far) = far_apart(scenario) =>
        {
            far
        }
        PlanError::Camera { camera, stops } => ScenarioError::Unseen {
            camera: id_of(camera),
            stops,
        },
        source => ScenarioError::Plan {
            network: place + 1,
            source,
        },
    })
}

/// Returns true if the headings of a file look like radians: all are small, and not all are whole.
fn are_radians(scenario: &Scenario) -> bool {
    let cameras = scenario
        .networks
        .iter()
        .flat_map(|network| &network.cameras);
    let headings: Vec<_> = cameras.filter_map(|camera| camera.heading_deg).collect();
    headings.iter().all(|heading| heading.abs() < TAU + 0.05)
        && headings.iter().any(|heading| heading.fract() != 0.0)
}

/// Number of ranges between a camera and the nearest other one from which on their units differ.
const FAR_APART: f64 = 5.0;

/// The error of a file in which each camera is far beyond the range of all others, as where places are told in
/// another unit than ranges.
fn far_apart(scenario: &Scenario) -> Option<ScenarioError> {
    let cameras: Vec<_> = { scenario.networks.iter() }
        .flat_map(|network| &network.cameras)
        .filter_map(|camera| {
            let range = camera.range.unwrap_or(scenario.camera.range);
            Some((camera.id, camera.place()?, range))
        })
        .collect();
    let gap = |(id, place): (u16, Point2<f64>)| {
        let others = cameras.iter().filter(|(other, ..)| *other != id);
        let gaps = others.map(|(_, other, _)| (other - place).norm());
        gaps.min_by(f64::total_cmp)
    };
    let all: Option<Vec<_>> = { cameras.iter() }
        .map(|&(camera, place, range)| {
            let gap = gap((camera, place))?;
            let is_far = gap > FAR_APART * range;
            is_far.then_some(ScenarioError::Centimetres { camera, range, gap })
        })
        .collect();
    all?.into_iter().next()
}

/// Accuracy with which the carrier of a target measures its way.
fn steps(scenario: &Scenario, table: &TargetTable) -> Steps {
    let (told, errors) = (scenario.target_config(table), errors(scenario));
    Steps {
        scale: told.systematic_scale.into(),
        compass: f64::from(told.systematic_heading_deg).to_radians(),
        leg: [errors.leg_distance, errors.leg_heading],
        least: 0.0,
    }
}

/// Protection levels with which poses are checked.
fn tolerance(scenario: &Scenario) -> Tolerance {
    limits(scenario).map(|limit| RARE * limit)
}

/// Sigmas beyond which poses are weak: of the place, and of the heading, radians.
pub(crate) fn limits(scenario: &Scenario) -> [f64; 2] {
    let mut camera = CameraConfig::new(
        scenario.camera.believed(),
        Subjects::Motion { threshold: 1 },
    );
    scenario.firmware.configure_camera(&mut camera);
    let weak = camera.weak;
    [
        weak.position.into(),
        f64::from(weak.heading_deg).to_radians(),
    ]
}

fn places(places: &[[f64; 2]]) -> Vec<Point2<f64>> {
    places.iter().copied().map(Point2::from).collect()
}

/// Refuses a way on which something of this name and radius would go through an obstacle.
fn clear_way(
    scenario: &Scenario,
    (who, radius): (&str, f64),
    stops: &[Point2<f64>],
    world: &World,
) -> Result<(), ScenarioError> {
    for (stop, leg) in (1..).zip(stops.windows(2)) {
        if let Some(obstacle) = world.obstacle_on_way(leg[0], leg[1], radius) {
            return Err(ScenarioError::Blocked {
                who: who.to_owned(),
                obstacle: number_in_file(scenario, obstacle),
                stop,
            });
        }
    }
    Ok(())
}
