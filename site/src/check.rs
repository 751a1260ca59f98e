//! Whether a scenario's values make sense, each with its name, its range and what to do.

use std::{collections::BTreeSet, fmt::Display, ops::RangeInclusive};

use super::{
    FIRST_COORDINATOR, PATH_MAX,
    error::ScenarioError,
    event::Action,
    file::{CameraTable, NetworkTable, ObstacleTable, RadioTable, Scenario, TargetTable},
};
use crate::world::Variant;
use calib_core::camera::Projection;
use cmucam2_emulator::{BAUD_RATES, FaultRates};
use node_firmware::{
    config::{COLOURS_MAX, STOPS_WANTED},
    message::StopNumber,
};

type Checked = Result<(), ScenarioError>;

/// The longest length and the like: far from where f32 on the nodes loses digits.
const LARGE: f64 = 1e5;
/// As short as any length may be.
const SMALL: f64 = 1e-3;
/// So many numbers are left for their coordinators.
const MOST_NETWORKS: f64 = (u16::MAX - FIRST_COORDINATOR) as f64 + 1.0;

pub(super) fn refuse(
    field: impl Into<String>,
    found: impl Display,
    allowed: impl Into<String>,
) -> ScenarioError {
    ScenarioError::Value {
        field: field.into(),
        found: found.to_string(),
        allowed: allowed.into(),
    }
}

fn number(
    field: impl Into<String>,
    value: f64,
    range: RangeInclusive<f64>,
    advice: &str,
) -> Checked {
    if range.contains(&value) {
        return Ok(());
    }
    let allowed = format!("{} to {}{advice}", range.start(), range.end());
    Err(refuse(field, value, allowed))
}

fn seconds(field: &str, value: f64) -> Checked {
    number(field, value, 0.0..=1e7, " seconds")
}

/// Stops at which a camera wants to see the target.
fn stops(field: &str, value: f64) -> Checked {
    let [least, most] = [STOPS_WANTED.start(), STOPS_WANTED.end()].map(|&stops| f64::from(stops));
    let advice = format!(": a pose needs three sightings, and a camera keeps {most}");
    number(field, value, least..=most, &advice)
}

fn place(field: &str, place: [f64; 2], scenario: &Scenario) -> Checked {
    let world = &scenario.world;
    let inside = (0..2).all(|i| (world.low[i]..=world.high[i]).contains(&place[i]));
    if inside {
        return Ok(());
    }
    let found = format!("({}, {})", place[0], place[1]);
    let allowed = format!(
        "between `world.low` ({}, {}) and `world.high` ({}, {}): move it, or make the world larger",
        world.low[0], world.low[1], world.high[0], world.high[1]
    );
    Err(refuse(field, found, allowed))
}

/// All but what needs the world to be put up.
pub(super) fn scenario(scenario: &Scenario) -> Checked {
    stops("stops", scenario.stops as f64)?;
    name("name", &scenario.name)?;
    name("unit", &scenario.unit)?;
    number("path", scenario.path as f64, 1.0..=PATH_MAX as f64, "")?;
    unit(scenario)?;
    world(scenario)?;
    camera("camera", &scenario.camera)?;
    walk(scenario)?;
    scatter(scenario)?;
    radio(&scenario.radio)?;
    firmware(scenario)?;
    if scenario.networks.is_empty() {
        return Err(refuse(
            "network",
            "missing",
            "there at least once, unless there is a `grid`",
        ));
    }
    number(
        "network (how many)",
        scenario.networks.len() as f64,
        1.0..=MOST_NETWORKS,
        ": in a grid, set fewer `nodes` or more `cell_nodes`",
    )?;
    let mut ids = BTreeSet::new();
    for (n, network) in (1..).zip(&scenario.networks) {
        self::network(scenario, &format!("network {n}"), network, &mut ids)?;
    }
    events(scenario, &ids)
}

/// Names go to terminals, which would obey control characters, and into drawings, which may not
/// contain them.
fn name(field: &str, name: &str) -> Checked {
    if !name.contains(char::is_control) {
        return Ok(());
    }
    let allowed = "text of one line, without control characters";
    Err(refuse(field, name.escape_debug(), allowed))
}

fn unit(scenario: &Scenario) -> Checked {
    let is_known = ["units", "m", "metres"].contains(&scenario.unit.as_str());
    if scenario.unit_metres.is_none() && !is_known {
        let allowed = format!("the length of one of the {} in metres", scenario.unit);
        return Err(refuse("unit_metres", "missing", allowed));
    }
    let metres = scenario.metres_per_unit();
    number("unit_metres", metres, 1e-4..=LARGE, " metres")
}

fn world(scenario: &Scenario) -> Checked {
    let world = &scenario.world;
    for i in 0..2 {
        let axis = ["x", "y"][i];
        number(
            format!("world.low ({axis})"),
            world.low[i],
            -LARGE..=LARGE,
            "",
        )?;
        number(
            format!("world.high ({axis})"),
            world.high[i],
            -LARGE..=LARGE,
            "",
        )?;
        if world.high[i] <= world.low[i] {
            let allowed = format!("above `world.low`, {}", world.low[i]);
            return Err(refuse(
                format!("world.high ({axis})"),
                world.high[i],
                allowed,
            ));
        }
    }
    for (n, obstacle) in (1..).zip(&world.obstacles) {
        let name = |field: &str| format!("world.obstacle {n}.{field}");
        let corners: &[[f64; 2]] = match obstacle {
            ObstacleTable::Wall(corners) if corners.len() < 2 => {
                return Err(refuse(
                    name("wall"),
                    format!("{} corners", corners.len()),
                    "two corners or more",
                ));
            }
            ObstacleTable::Wall(corners) => corners,
            ObstacleTable::Pillar { x, y, radius } => {
                number(name("pillar.radius"), *radius, SMALL..=LARGE, "")?;
                &[[*x, *y]]
            }
            ObstacleTable::Block(corners) if corners.len() < 3 => {
                return Err(refuse(
                    name("block"),
                    format!("{} corners", corners.len()),
                    "three corners or more; two make a `wall`",
                ));
            }
            ObstacleTable::Block(corners) => corners,
        };
        for value in corners.iter().flatten() {
            number(name("(coordinate)"), *value, -LARGE..=LARGE, "")?;
        }
    }
    Ok(())
}

pub(super) fn camera(name: &str, camera: &CameraTable) -> Checked {
    let projection = camera.projection();
    view(
        &format!("{name}.field_of_view_deg"),
        camera.field_of_view_deg(),
        projection,
    )?;
    let model = camera.model;
    if let Some(degrees) = model.field_of_view_deg {
        let projection = model.projection.unwrap_or(projection);
        view(
            &format!("{name}.model.field_of_view_deg"),
            degrees,
            projection,
        )?;
    }
    number(
        format!("{name}.range"),
        camera.range,
        SMALL..=LARGE,
        " in the unit of the world",
    )?;
    number(
        format!("{name}.noise"),
        camera.noise,
        0.0..=100.0,
        " levels",
    )?;
    number(
        format!("{name}.flicker"),
        camera.flicker,
        0.0..=1.0,
        " of the light",
    )?;
    if !BAUD_RATES.contains(&camera.baud()) {
        let rates = BAUD_RATES.map(|rate| rate.to_string()).join(", ");
        return Err(refuse(
            format!("{name}.baud"),
            camera.baud(),
            format!("one of {rates}"),
        ));
    }
    if camera.variant == Variant::Stage && projection != Projection::EqualAngle {
        return Err(refuse(
            format!("{name}.projection"),
            "pin-hole",
            "`equal-angle` for the variant `stage`; `camera.model.projection` is what nodes believe",
        ));
    }
    fault_rates(name, &camera.faults).map(|_| ())
}

fn view(field: &str, degrees: f64, projection: Projection) -> Checked {
    let most = match projection {
        Projection::PinHole => 170.0,
        Projection::EqualAngle => 360.0,
    };
    number(field, degrees, 1.0..=most, " degrees for such a lens")
}

/// The rates by their names.
pub(super) fn fault_rates(
    name: &str,
    table: &std::collections::BTreeMap<String, f64>,
) -> Result<FaultRates, ScenarioError> {
    let mut rates = FaultRates::default();
    for (fault, &rate) in table {
        rates.set(fault, rate).map_err(|why| {
            refuse(
                format!("{name}.faults.{fault}"),
                rate,
                format!("a fault and its rate: {why}"),
            )
        })?;
    }
    Ok(rates)
}

fn walk(scenario: &Scenario) -> Checked {
    let (walk, sensor) = (&scenario.walk, scenario.sensor.unwrap_or_default());
    number("walk.speed", walk.speed, 1e-3..=1e3, " units a second")?;
    number(
        "walk.arrive_within",
        walk.arrive_within,
        1e-4..=1e3,
        " units",
    )?;
    number("walk.step_length", walk.step_length, 1e-3..=1e3, " units")?;
    seconds("walk.patience_s", walk.patience_s)?;
    for (field, value) in [
        ("sensor.leg_distance", sensor.leg_distance),
        ("sensor.step_distance", sensor.step_distance),
    ] {
        number(field, value, 0.0..=1.0, " of the distance")?;
    }
    for (field, value) in [
        ("sensor.leg_heading_deg", sensor.leg_heading_deg),
        ("sensor.step_heading_deg", sensor.step_heading_deg),
    ] {
        number(field, value, 0.0..=180.0, " degrees")?;
    }
    number(
        "sensor.scale_bias",
        sensor.scale_bias,
        -0.9..=9.0,
        " of the distance",
    )?;
    number(
        "sensor.heading_bias_deg",
        sensor.heading_bias_deg,
        -180.0..=180.0,
        " degrees",
    )
}

fn scatter(scenario: &Scenario) -> Checked {
    let scatter = &scenario.scatter;
    number("scatter.position", scatter.position, 0.0..=LARGE, "")?;
    number(
        "scatter.heading_deg",
        scatter.heading_deg,
        0.0..=180.0,
        " degrees",
    )
}

fn radio(radio: &RadioTable) -> Checked {
    match *radio {
        RadioTable::UnitDisk { range, loss } => {
            number(
                "radio.range",
                range,
                SMALL..=LARGE,
                " in the unit of the world",
            )?;
            number("radio.loss", loss, 0.0..=1.0, "")
        }
        RadioTable::LogDistance {
            exponent,
            shadowing_db,
            loss,
        } => {
            number(
                "radio.exponent",
                exponent,
                1.0..=8.0,
                ": 2 in free space, 3 indoors",
            )?;
            number("radio.shadowing_db", shadowing_db, 0.0..=30.0, " dB")?;
            number("radio.loss", loss, 0.0..=1.0, "")
        }
    }
}

fn firmware(scenario: &Scenario) -> Checked {
    let firmware = &scenario.firmware;
    if let Some(stops) = firmware.stops {
        self::stops("firmware.stops", f64::from(stops))?;
    }
    for (field, value) in [
        (
            "firmware.good_enough_position",
            firmware.good_enough_position,
        ),
        ("firmware.standing_sigma", firmware.standing_sigma),
        ("firmware.weak_sigma", firmware.weak_sigma),
    ] {
        number(
            field,
            value.unwrap_or(0.0),
            0.0..=LARGE,
            " in the unit of the world",
        )?;
    }
    number(
        "firmware.good_enough_heading_deg",
        firmware.good_enough_heading_deg.unwrap_or(0.0),
        0.0..=180.0,
        " degrees",
    )
}

fn network(
    scenario: &Scenario,
    name: &str,
    network: &NetworkTable,
    ids: &mut BTreeSet<u16>,
) -> Checked {
    for channel in network.channels() {
        number(
            format!("{name}.channel"),
            f64::from(channel),
            11.0..=26.0,
            ": a channel of the 2.4 GHz band",
        )?;
    }
    if let Some(at) = network.coordinator {
        place(&format!("{name}.coordinator"), at, scenario)?;
    }
    for corner in network.area.iter().flatten() {
        place(&format!("{name}.area"), *corner, scenario)?;
    }
    if let Some([low, high]) = network.area
        && (0..2).any(|i| high[i] <= low[i])
    {
        let found = format!("[{low:?}, {high:?}]");
        let allowed =
            "the lowest corner and then the highest one, such as [[0.0, 0.0], [9.0, 9.0]]";
        return Err(refuse(format!("{name}.area"), found, allowed));
    }
    let members = network.cameras.len() + network.targets.len();
    number(
        format!("{name} (cameras and targets)"),
        members as f64,
        3.0..=32.0,
        ": at least two cameras and a target, at most what a coordinator has room for; make more networks",
    )?;
    let mut take = |field: String, id: u16| {
        number(
            field.clone(),
            f64::from(id),
            1.0..=f64::from(FIRST_COORDINATOR - 1),
            ": larger numbers are those of coordinators",
        )?;
        if ids.insert(id) {
            Ok(())
        } else {
            Err(refuse(field, id, "a number that no other node has"))
        }
    };
    for (n, camera) in (1..).zip(&network.cameras) {
        let name = format!("{name}.camera {n}");
        take(format!("{name}.id"), camera.id)?;
        if let Some(at) = camera.place() {
            place(&format!("{name} (x, y)"), at.into(), scenario)?;
        }
        number(
            format!("{name}.heading_deg"),
            camera.heading_deg.unwrap_or(0.0),
            -360.0..=360.0,
            " degrees",
        )?;
        self::camera(&name, &scenario.camera.for_camera(camera))?;
    }
    for (n, target) in (1..).zip(&network.targets) {
        let name = format!("{name}.target {n}");
        take(format!("{name}.id"), target.id)?;
        self::target(scenario, &name, target)?;
    }
    if network.targets.is_empty() {
        return Err(refuse(
            format!("{name}.target"),
            "missing",
            "there at least once",
        ));
    }
    let colours: BTreeSet<_> = network.targets.iter().map(|target| target.colour).collect();
    number(
        format!("{name}.target (different colours)"),
        colours.len() as f64,
        1.0..=COLOURS_MAX as f64,
        ": a camera looks for no more; make more networks",
    )?;
    let references = &network.references;
    for id in references.cameras {
        if !network.cameras.iter().any(|camera| camera.id == id) {
            return Err(refuse(
                format!("{name}.references.cameras"),
                id,
                "the `id` of a camera of this network",
            ));
        }
    }
    if references.cameras[0] == references.cameras[1] {
        return Err(refuse(
            format!("{name}.references.cameras"),
            "the same camera twice",
            "two cameras",
        ));
    }
    number(
        format!("{name}.references.compass_deg"),
        references.compass_deg.unwrap_or(0.0),
        -360.0..=360.0,
        " degrees",
    )
}

fn target(scenario: &Scenario, name: &str, target: &TargetTable) -> Checked {
    number(format!("{name}.radius"), target.radius, SMALL..=LARGE, "")?;
    let Some(stops) = &target.stops else {
        return Ok(());
    };
    if stops.len() < 3 {
        return Err(refuse(
            format!("{name}.stops"),
            format!("{} places", stops.len()),
            "three places or more; leave it out to have them planned",
        ));
    }
    if stops.len() > usize::from(StopNumber::MAX) {
        return Err(refuse(
            format!("{name}.stops"),
            format!("{} places", stops.len()),
            format!(
                "{} places or fewer: a target counts no further",
                StopNumber::MAX
            ),
        ));
    }
    for (n, &stop) in (1..).zip(stops) {
        place(&format!("{name}.stops, place {n}"), stop, scenario)?;
    }
    Ok(())
}

fn events(scenario: &Scenario, ids: &BTreeSet<u16>) -> Checked {
    let targets: BTreeSet<_> = scenario
        .networks
        .iter()
        .flat_map(|network| &network.targets)
        .map(|target| target.id)
        .collect();
    for (n, event) in (1..).zip(&scenario.events) {
        let name = |field: &str| format!("event {n}.{field}");
        seconds(&name("at_s"), event.at_s)?;
        if let Some(duration) = event.action.duration_s() {
            seconds(&name("for_s"), duration)?;
        }
        let is_camera_only = matches!(
            event.action,
            Action::UnplugCamera { .. } | Action::StickCamera { .. }
        );
        for id in event.action.nodes() {
            let coordinator = *id == 0 && !is_camera_only;
            if !(ids.contains(id) || coordinator) || (is_camera_only && targets.contains(id)) {
                let allowed = if is_camera_only {
                    "the `id` of a camera"
                } else {
                    "the `id` of a camera or a target, or 0 for the first network's coordinator"
                };
                return Err(refuse(name("node"), id, allowed));
            }
        }
        match &event.action {
            Action::Jam {
                channel, at, reach, ..
            } => {
                if let Some(channel) = channel {
                    number(
                        name("channel"),
                        f64::from(*channel),
                        11.0..=26.0,
                        ": a channel of the 2.4 GHz band",
                    )?;
                }
                if at.is_some() != reach.is_some() {
                    return Err(refuse(
                        name("jam"),
                        "half a place",
                        "`at` and `reach`, or neither",
                    ));
                }
                number(name("reach"), reach.unwrap_or(0.0), 0.0..=LARGE, "")?;
                for coordinate in at.iter().flatten() {
                    number(name("at"), *coordinate, -LARGE..=LARGE, "")?;
                }
            }
            Action::Loss { share, .. } => number(name("share"), *share, 0.0..=1.0, "")?,
            Action::Replay { last_s, .. } => seconds(&name("last_s"), *last_s)?,
            _ => {}
        }
    }
    Ok(())
}
