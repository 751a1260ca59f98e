//! What is counted.

use core::{f32::consts::PI, fmt};

use calib_core::{
    camera::{Camera, Projection},
    resection::three_point,
};
use cmucam2_driver::{
    Packet,
    packet::{PacketLine, Tracking},
    parser::{Expectation, Parser},
};
use rand::{Rng, RngExt};

use crate::{
    measure::{Bench, Counter, Error},
    scene::Scene,
    total,
};

/// Counts every routine, one line each.
///
/// # Errors
/// As [`Bench::measure`].
pub fn measure_all<C: Counter, W: fmt::Write>(bench: &mut Bench<C, W>) -> Result<(), Error> {
    // What reading an input and storing a result take: the floor under every line below.
    bench.measure("copy_f32", RngExt::random::<f32>, |x| *x)?;

    for (name, projection) in [
        ("camera_ray_pin_hole", Projection::PinHole),
        ("camera_ray_equal_angle", Projection::EqualAngle),
    ] {
        let camera = Camera::new(projection, 88, PI / 3.0).expect("88 columns of 60 degrees");
        bench.measure(
            name,
            |random| (camera, random.random_range(0.0..=87.0)),
            |(camera, column)| camera.ray(*column),
        )?;
    }

    bench.measure(
        "libm_tanf",
        |random| random.random_range(-PI..PI),
        |angle| libm::tanf(*angle),
    )?;
    bench.measure(
        "libm_atan2f",
        |random| {
            (
                random.random_range(-8.0..8.0),
                random.random_range(-8.0..8.0),
            )
        },
        |(y, x)| libm::atan2f(*y, *x),
    )?;

    let sightings = |random: &mut _| Scene::<f32>::random(random).sightings(0.005);
    bench.measure("resection_three_fix", sightings, three_point::fix)?;
    bench.measure("resection_three_heading", sightings, |s| {
        three_point::fix(s).map(|fix| (fix.position, fix.heading()))
    })?;
    bench.measure("resection_three_covariance", sightings, three_point::solve)?;

    // Every number has two digits, so every packet has 26 bytes.
    let mut parser = Parser::new(Expectation::default());
    bench.measure("cmucam2_parse_26_bytes", tracking_line, |line| {
        let mut event = None;
        for &byte in line.as_bytes() {
            event = parser.push(byte);
        }
        event
    })?;

    bench.measure(
        "total_position",
        |random| Scene::<f32>::random(random).bearings(),
        |(targets, bearings)| total::position(targets, bearings),
    )?;
    bench.measure(
        "total_pose",
        |random| Scene::<f32>::random(random).bearings(),
        |(targets, bearings)| total::pose(targets, bearings),
    )?;
    Ok(())
}

/// A T packet as it comes over the line.
fn tracking_line(random: &mut impl Rng) -> PacketLine {
    let mut between = |low: u8, high: u8| random.random_range(low..=high);
    let (left, top) = (between(10, 60), between(10, 60));
    let (right, bottom) = (between(left, 87), between(top, 99));
    let (x, y) = (between(left, right), between(top, bottom));
    let (pixels, confidence) = (between(10, 99), between(10, 99));
    let values = [x, y, left, top, right, bottom, pixels, confidence];
    Packet::Tracking(Tracking::new(values)).line()
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeSet, string::String, vec::Vec};

    use super::*;

    struct Nothing;

    impl Counter for Nothing {
        fn start(&mut self) {}

        fn stop(&mut self) -> Option<u64> {
            Some(0)
        }
    }

    #[test]
    fn a_line_each_under_names_of_their_own() {
        let mut output = String::new();
        measure_all(&mut Bench::new(Nothing, &mut output)).unwrap();
        let names: BTreeSet<&str> = output
            .lines()
            .map(|line| {
                let words: Vec<&str> = line.split(' ').collect();
                assert!(words.len() == 5 && words[0] == "instructions", "{line}");
                words[1]
            })
            .collect();
        assert_eq!(names.len(), output.lines().count());
        assert!(names.contains("total_pose"));
    }
}
