//! Places of cameras: two references that see a common area, and others anywhere.

use std::{f64::consts::PI, fmt::Write};

use nalgebra::{Point2, Vector2};
use rand::{Rng, RngExt};

use super::{Draw, between, happens, short};

/// Units between a camera and the border of the world.
const MARGIN: f64 = 1.0;

/// Colours of targets: far from one another.
const COLOURS: [[u8; 3]; 2] = [[230, 105, 35], [40, 200, 60]];

fn towards(degrees: f64) -> Vector2<f64> {
    let radians = degrees * PI / 180.0;
    Vector2::new(radians.cos(), radians.sin())
}

fn degrees(direction: Vector2<f64>) -> f64 {
    direction.y.atan2(direction.x).to_degrees()
}

/// Shape of a site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ground {
    /// Cameras anywhere on a square, and references that look at it well.
    Square,
    /// Cameras along the walls of a hall, about twice as long as it is wide.
    Hall,
    /// Cameras along the walls of a corridor.
    Corridor,
}

impl Ground {
    /// Width of a building; its length comes from the number of its cameras.
    fn width(self, random: &mut impl Rng) -> f64 {
        match self {
            Self::Corridor => between(random, 4.0, 5.5),
            Self::Square | Self::Hall => between(random, 7.0, 11.0),
        }
    }
}

/// The file of a site on which all goes well.
pub(super) fn text(random: &mut impl Rng, number: u64, draw: Draw) -> String {
    let cameras = match random.random_range(0..10) {
        0..6 => random.random_range(3..=6),
        6..9 => random.random_range(7..=10),
        _ => random.random_range(11..=16),
    };
    let side = short((cameras as f64).sqrt() * random.random_range(4.0..6.5)).max(11.0);
    let ground = match draw {
        Draw::Daily => Ground::Square,
        Draw::Systematic => match random.random_range(0..3) {
            0 => Ground::Square,
            1 => Ground::Hall,
            _ => Ground::Corridor,
        },
    };
    let [length, width] = match ground {
        Ground::Square => [side; 2],
        Ground::Hall | Ground::Corridor => {
            let width = ground.width(random);
            [short((cameras as f64 * 2.5).max(2.0 * width)), width]
        }
    };
    let view = between(random, 45.0, 80.0);
    let range = between(random, 7.0, 14.0);
    let seed: u32 = random.random();
    let stops = random.random_range(3..=6);
    let [speed, arrive] = [between(random, 0.2, 0.8), between(random, 0.01, 0.05)];
    let mut text = format!(
        "name = \"campaign-{number}\"\nseed = {seed}\nstops = {stops}\n\
         [world]\nlow = [0.0, 0.0]\nhigh = [{length:?}, {width:?}]\n"
    );
    if happens(random, 0.25) {
        for _ in 0..random.random_range(1..=3) {
            let [x, y] = [length, width].map(|most| between(random, 1.0, most - 1.0));
            let radius = between(random, 0.1, 0.4);
            let pillar = format!("{{ x = {x:?}, y = {y:?}, radius = {radius:?} }}");
            let _ = write!(text, "[[world.obstacle]]\npillar = {pillar}\n");
        }
    }
    let _ = write!(
        text,
        "[camera]\nfield_of_view_deg = {view:?}\nrange = {range:?}\n\
         [walk]\nspeed = {speed:?}\narrive_within = {arrive:?}\n\
         [[network]]\nchannel = 15\n"
    );
    let _ = write!(text, "references = {}\ncamera = [\n", references(random));
    let places = match ground {
        Ground::Square => places(random, cameras, side),
        Ground::Hall | Ground::Corridor => along_walls(random, cameras, [length, width]),
    };
    for (id, (place, heading)) in (1..).zip(places) {
        let [x, y, heading] = [place.x, place.y, heading.rem_euclid(360.0)].map(short);
        let _ = writeln!(
            text,
            "{{ id = {id}, x = {x:?}, y = {y:?}, heading_deg = {heading:?} }},"
        );
    }
    text += "]\ntarget = [\n";
    let targets = if happens(random, 0.2) { 2 } else { 1 };
    for (id, colour) in (40..).zip(&COLOURS[..targets]) {
        let _ = writeln!(text, "{{ id = {id}, colour = {colour:?}, radius = 0.15 }},");
    }
    text + "]\n"
}

fn references(random: &mut impl Rng) -> String {
    let rest = match random.random_range(0..20) {
        0 => ", elected = true".to_owned(),
        1 => ", baseline_known = false".to_owned(),
        2 => {
            let compass = between(random, 0.0, 360.0);
            format!(", frame_heading_known = false, compass_deg = {compass:?}")
        }
        3..6 => format!(", compass_deg = {:?}", between(random, 0.0, 360.0)),
        _ => String::new(),
    };
    format!("{{ cameras = [1, 2]{rest} }}")
}

/// Places and headings (degrees), the references' first.
fn places(random: &mut impl Rng, cameras: usize, side: f64) -> Vec<(Point2<f64>, f64)> {
    let middle = side / 2.0;
    let within = |place: Point2<f64>| place.map(|x| x.clamp(MARGIN, side - MARGIN));
    let mut any = |low: f64, high: f64| random.random_range(low..high);
    // Area that both references look at, from directions that are well apart.
    let quarter = side / 8.0;
    let seen = Point2::new(
        middle + any(-quarter, quarter),
        middle + any(-quarter, quarter),
    );
    let [first, apart] = [any(0.0, 360.0), any(50.0, 130.0)];
    let mut all = Vec::new();
    for direction in [first, first + apart] {
        let place = within(seen + towards(direction) * any(3.0, 6.0));
        all.push((place, degrees(seen - place) + any(-8.0, 8.0)));
    }
    while all.len() < cameras {
        let place = Point2::new(any(MARGIN, side - MARGIN), any(MARGIN, side - MARGIN));
        let inwards = degrees(Point2::new(middle, middle) - place);
        all.push((place, inwards + any(-60.0, 60.0)));
    }
    all
}

/// The same along the two long walls of a building, by turns, looking across and along it. The references are next
/// to each other, as where the first two that were at hand were taken.
fn along_walls(
    random: &mut impl Rng,
    cameras: usize,
    [length, width]: [f64; 2],
) -> Vec<(Point2<f64>, f64)> {
    let apart = (length - 2.0 * MARGIN) / (cameras as f64 - 1.0);
    let along = |place: usize, off: f64| {
        let x = MARGIN + apart * (place as f64 + off);
        x.clamp(MARGIN, length - MARGIN)
    };
    let camera = |place: usize| {
        let off = random.random_range(-0.3..0.3);
        let (y, across) = match place % 2 {
            0 => (0.3, 90.0),
            _ => (width - 0.3, 270.0),
        };
        let turned = random.random_range(-50.0..50.0);
        (Point2::new(along(place, off), y), across + turned)
    };
    let mut all: Vec<_> = (0..cameras).map(camera).collect();
    // Somewhere in the building.
    let first = random.random_range(0..cameras - 1);
    all.rotate_left(first);
    all
}
