//! Checks that values of a file make sense together. The limits of each value alone are in `keys`.

mod events;

use std::{collections::BTreeSet, fmt::Display, ops::RangeInclusive};

use calib_core::camera::{Camera as Optics, Distortion, Projection};
use cmucam2_emulator::{FaultRates, Lens};
use nalgebra::Vector2;
use node_firmware::{
    limits::{COLOURS_MAX, MEMBERS},
    vision::CameraKind,
};

use super::{
    FIRST_COORDINATOR,
    error::ScenarioError,
    file::{CameraTable, NetworkTable, PlacedCamera, Scenario, TargetTable},
    firmware::FirmwareTable,
};
use crate::world::Variant;

type Checked = Result<(), ScenarioError>;

/// So many numbers are left for their coordinators.
pub(super) const MOST_NETWORKS: f64 = (u16::MAX - FIRST_COORDINATOR) as f64 + 1.0;

pub(super) fn refuse(
    field: impl Into<String>,
    found: impl Display,
    allowed: impl Into<String>,
) -> ScenarioError {
    ScenarioError::Value {
        line: None,
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

fn places(field: &str, places: Option<&[[f64; 2]]>, scenario: &Scenario) -> Checked {
    let mut places = (1..).zip(places.into_iter().flatten());
    places.try_for_each(|(n, &place)| self::place(&format!("{field}, place {n}"), place, scenario))
}

/// All but what needs the world to be put up.
pub(super) fn scenario(scenario: &Scenario) -> Checked {
    unit(scenario)?;
    world(scenario)?;
    camera("camera", &scenario.camera)?;
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
    for (n, object) in (1..).zip(&scenario.objects) {
        places(
            &format!("object {n}.path"),
            object.path.as_deref(),
            scenario,
        )?;
    }
    events::check(scenario, &ids)
}

fn unit(scenario: &Scenario) -> Checked {
    let is_metre = ["m", "metres"].contains(&scenario.unit.as_str());
    if let Some(metres) = scenario
        .unit_metres
        .filter(|metres| is_metre && *metres != 1.0)
    {
        let allowed = format!(
            "1, as `unit` is \"{}\", or another name of the unit",
            scenario.unit
        );
        return Err(refuse("unit_metres", metres, allowed));
    }
    let is_known = ["units", "m", "metres"].contains(&scenario.unit.as_str());
    if scenario.unit_metres.is_some() || is_known {
        return Ok(());
    }
    let allowed = format!(
        "how many metres one unit of length is, as `unit` is \"{}\"; `m` and `metres` need no \
         `unit_metres`",
        scenario.unit
    );
    Err(refuse("unit_metres", "missing", allowed))
}

fn world(scenario: &Scenario) -> Checked {
    let world = &scenario.world;
    for (i, axis) in [(0, "x"), (1, "y")] {
        if world.high[i] <= world.low[i] {
            let allowed = format!("above `world.low`, {}", world.low[i]);
            return Err(refuse(
                format!("world.high ({axis})"),
                world.high[i],
                allowed,
            ));
        }
    }
    Ok(())
}

pub(super) fn camera(name: &str, camera: &CameraTable) -> Checked {
    lens(name, camera)?;
    model(name, camera)?;
    if camera.variant == Variant::Stage && camera.projection() != Projection::EqualAngle {
        return Err(refuse(
            format!("{name}.projection"),
            "pin-hole",
            "`equal-angle` for the variant `stage`; `camera.model.projection` is what nodes believe",
        ));
    }
    fault_rates(name, &camera.faults)?;
    let is_rehearsed = |fault: &str| camera.kind == CameraKind::Cmucam2 || fault == CORRUPT_LINE;
    match camera
        .faults
        .iter()
        .find(|(fault, rate)| **rate > 0.0 && !is_rehearsed(fault))
    {
        None => Ok(()),
        Some((fault, rate)) => Err(refuse(
            format!("{name}.faults.{fault}"),
            rate,
            format!(
                "`{CORRUPT_LINE}` alone for this kind of camera: the other faults are those of a CMUcam2"
            ),
        )),
    }
}

/// The fault that all kinds of cameras have.
const CORRUPT_LINE: &str = "corrupt_line";

/// The lens that a camera has.
///
/// # Errors
/// Its field of view is not one of its projection, or its distortion folds the picture back.
pub(super) fn lens(name: &str, camera: &CameraTable) -> Result<Lens, ScenarioError> {
    let projection = camera.projection();
    let degrees = camera.field_of_view_deg();
    let field = format!("{name}.field_of_view_deg");
    view(&field, degrees, projection)?;
    let aspect = f64::from(camera.kind.rows_per_column());
    let own = camera.distortion();
    Lens::of_frame(projection, degrees.to_radians(), camera.size(), aspect)
        .ok_or_else(|| refuse(field, degrees, "a field of view of this projection"))?
        .with_distortion(own)
        .ok_or_else(|| folds(format!("{name}.distortion"), own))
}

/// The lens that the node of a camera believes to have.
///
/// # Errors
/// As for [`lens`], or its optical axis is not within its columns.
pub(super) fn model(name: &str, camera: &CameraTable) -> Result<Optics<f64>, ScenarioError> {
    let believed = camera.believed();
    let own = &camera.model;
    let degrees = { own.field_of_view_deg }.unwrap_or_else(|| camera.field_of_view_deg());
    let field = format!("{name}.model.field_of_view_deg");
    if own.field_of_view_deg.is_some() {
        view(&field, degrees, believed.projection)?;
    }
    let model = Optics::new(believed.projection, believed.columns, degrees.to_radians())
        .map_err(|_| refuse(field, degrees, "a field of view of this projection"))?;
    let model = match own.principal_column {
        None => model,
        Some(column) => {
            let field = format!("{name}.model.principal_column");
            let last = f64::from(believed.columns) - 1.0;
            number(&field, column, 0.0..=last, ": a column of the lens")?;
            let refused = |_| refuse(field, column, "a column of the lens");
            model.with_principal_point(column).map_err(refused)?
        }
    };
    let [k1, k2] = { own.distortion }.unwrap_or_else(|| camera.distortion());
    model.with_distortion(Distortion { k1, k2 }).map_err(|_| {
        let key = match own.distortion {
            Some(_) => "model.distortion",
            None => "distortion",
        };
        folds(format!("{name}.{key}"), [k1, k2])
    })
}

/// Refusal of a lens of which the distortion folds the picture back.
fn folds(field: String, [k1, k2]: [f64; 2]) -> ScenarioError {
    let allowed = "those of a lens that does not fold the corners of its picture back: check their signs, and that \
                   they are those of this field of view";
    refuse(field, format!("[{k1}, {k2}]"), allowed)
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

/// A node that sleeps alone would not be woken by the others, and would not be told of stops.
fn sleep(scenario: &Scenario, name: &str, own: Option<FirmwareTable>) -> Checked {
    let all = scenario.firmware.sleep.unwrap_or_default();
    match own.and_then(|own| own.sleep).filter(|&own| own != all) {
        None => Ok(()),
        Some(own) => {
            let allowed = "the same for all nodes: say it in `[firmware]` alone";
            Err(refuse(format!("{name}.firmware.sleep"), own, allowed))
        }
    }
}

fn network(
    scenario: &Scenario,
    name: &str,
    network: &NetworkTable,
    ids: &mut BTreeSet<u16>,
) -> Checked {
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
    let visitors = scenario.visitors(network);
    let members = network.cameras.len() + network.targets.len() + visitors.len();
    number(
        format!("{name} (cameras and targets)"),
        members as f64,
        3.0..=MEMBERS as f64,
        ": at least two cameras and a target; a coordinator has room for no more: with more, make two networks, \
         each with references of its own or with `frame_of`",
    )?;
    let mut take = |field: String, id: u16| match ids.insert(id) {
        true => Ok(()),
        false => Err(refuse(field, id, "a number that no other node has")),
    };
    for (n, camera) in (1..).zip(&network.cameras) {
        let name = format!("{name}.camera {n}");
        take(format!("{name}.id"), camera.id)?;
        if let Some(at) = camera.place() {
            place(&format!("{name} (x, y)"), at.into(), scenario)?;
        }
        self::camera(&name, &scenario.camera.for_camera(camera))?;
        sleep(scenario, &name, camera.firmware)?;
    }
    for (n, target) in (1..).zip(&network.targets) {
        let name = format!("{name}.target {n}");
        take(format!("{name}.id"), target.id)?;
        self::target(scenario, &name, target)?;
        sleep(scenario, &name, target.firmware)?;
        let first = network.targets.first().and_then(|first| first.height);
        if target.height != first {
            let found = target
                .height
                .map_or("missing".to_owned(), |height| height.to_string());
            let allowed = "that of the first target: all balls of a network move at one height";
            return Err(refuse(format!("{name}.height"), found, allowed));
        }
    }
    if network.targets.is_empty() && visitors.is_empty() {
        home(scenario, name, network)?;
        return Err(refuse(
            format!("{name}.target"),
            "missing",
            "there at least once",
        ));
    }
    number(
        format!("{name}.target (different colours)"),
        scenario.colours(network).len() as f64,
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
    self::references(scenario, name, network)?;
    network.known(name).map(|_| ())
}

/// A frame that comes from a network which has one.
fn home(scenario: &Scenario, name: &str, network: &NetworkTable) -> Checked {
    let is_home = |home: &NetworkTable| home.references.frame_of.is_none();
    match network.references.frame_of {
        Some(home) if !scenario.home_of(network).is_some_and(is_home) => {
            let allowed = "the number, from 1, of a network that has references";
            Err(refuse(format!("{name}.references.frame_of"), home, allowed))
        }
        _ => Ok(()),
    }
}

/// References that can be some.
fn references(scenario: &Scenario, name: &str, network: &NetworkTable) -> Checked {
    home(scenario, name, network)?;
    let references = &network.references;
    if references.frame_of.is_some() {
        for (key, is_given) in [
            ("elected", references.elected),
            ("baseline_known", references.baseline_known.is_some()),
            ("baseline", references.baseline.is_some()),
            (
                "frame_heading_known",
                references.frame_heading_known.is_some(),
            ),
            ("compass_deg", references.compass_deg.is_some()),
        ] {
            if is_given {
                let allowed = "left out where there are no references, but a `frame_of`";
                return Err(refuse(format!("{name}.references.{key}"), "given", allowed));
            }
        }
    }
    for (key, is_known) in [
        ("baseline_known", references.baseline_known()),
        ("frame_heading_known", references.frame_heading_known()),
    ] {
        if references.elected && is_known {
            let allowed = "`false` or left out where the references are `elected`: it is not known \
                           beforehand which two cameras they will be";
            return Err(refuse(format!("{name}.references.{key}"), true, allowed));
        }
    }
    if references.elected && references.baseline.is_some() {
        let allowed = "left out where the references are `elected`";
        return Err(refuse(
            format!("{name}.references.baseline"),
            "given",
            allowed,
        ));
    }
    let cameras = references.cameras.map(|id| network.camera(id));
    let [Some(first), Some(second)] = cameras else {
        return Ok(());
    };
    let (Some(origin), Some(other)) = (first.place(), second.place()) else {
        return Ok(());
    };
    if origin == other {
        return Err(refuse(
            format!("{name}.references"),
            "two cameras at one place",
            "two places: their distance gives the network its scale",
        ));
    }
    let distance = (other - origin).norm();
    if let Some(told) = references.baseline
        && !(0.5..=2.0).contains(&(told / distance))
    {
        let [first, second] = references.cameras;
        let allowed = format!(
            "their distance, and by `x` and `y` of cameras {first} and {second} that is {distance:.3}: correct what is \
             wrong"
        );
        return Err(refuse(format!("{name}.references.baseline"), told, allowed));
    }
    let sector = |camera: &PlacedCamera| {
        let view = scenario.camera.for_camera(camera).field_of_view_deg();
        Some((camera.heading_deg?.to_radians(), view.to_radians()))
    };
    if let (Some(first), Some(second)) = (sector(first), sector(second))
        && !views_meet(other - origin, first, second)
    {
        return Err(refuse(
            format!("{name}.references"),
            "two cameras whose views never meet",
            "two that see a common area, in which the walk begins: turn them, or take others",
        ));
    }
    Ok(())
}

/// Returns true if two cameras, the second one so far from the first, look at anything in common, were there
/// no walls and no range. Both are told by their headings and fields of view, radians.
fn views_meet(baseline: Vector2<f64>, first: (f64, f64), second: (f64, f64)) -> bool {
    const RAYS: i32 = 32;
    let rays = |(heading, view): (f64, f64)| {
        (0..=RAYS).map(move |ray| {
            let angle = heading + view * (f64::from(ray) / f64::from(RAYS) - 0.5);
            Vector2::new(angle.cos(), angle.sin())
        })
    };
    rays(first).any(|a| {
        rays(second).any(|b| {
            let across = a.perp(&b);
            // Where the two rays meet, in front of both.
            baseline.perp(&b) / across > 0.0 && baseline.perp(&a) / across > 0.0
        })
    })
}

fn target(scenario: &Scenario, name: &str, target: &TargetTable) -> Checked {
    places(&format!("{name}.stops"), target.stops.as_deref(), scenario)?;
    if let Some(window) = target.window
        && !window.is_ordered()
    {
        let allowed = "of each colour the lowest level, and then the highest one";
        return Err(refuse(
            format!("{name}.window"),
            "in another order",
            allowed,
        ));
    }
    Ok(())
}
