//! Routines that are counted.

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
use zigbee_link::{
    Instant,
    radio::FRAME_MAX,
    security::{self, FrameSecurity, Key, Protection},
    wire::{Address, Eui64, FrameType, Header, PanId, Panned, ShortAddress},
};

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
    // Cost of reading an input and storing a result: the floor under every line below.
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

    // 40 bytes without FCS: 15 of header with an extended source, 6 of security, 8 of MIC.
    let mut sender = link_session(1);
    let header = link_header();
    let mut buffer = [0; FRAME_MAX];
    bench.measure(
        "link_seal_40_bytes",
        RngExt::random::<[u8; 11]>,
        |payload| {
            sender
                .seal(&header, payload, &mut buffer)
                .map(|sealed| sealed.len)
        },
    )?;
    let mut receiver = link_session(2);
    bench.measure(
        "link_open_40_bytes",
        |random| {
            let mut buffer = [0; FRAME_MAX];
            let sealed = sender.seal(&header, &random.random::<[u8; 11]>(), &mut buffer);
            assert_eq!(sealed.map(|sealed| sealed.len), Ok(40));
            let mut frame = [0; 40];
            frame.copy_from_slice(&buffer[..40]);
            frame
        },
        |frame| {
            // From a stranger, so that the same frame may come again.
            let mut frame = *frame;
            receiver
                .open(Instant(0), &mut frame)
                .map(|opened| opened.payload.len())
        },
    )?;

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

/// A node with all its frame counters before it.
fn link_session(node: u8) -> FrameSecurity<16> {
    let mut counter = security::Counter::resume(0);
    counter.reserved(u32::MAX);
    let key = Key::new(1, core::array::from_fn(|i| i as u8)).expect("a usable key");
    let extended = Eui64([0xAC, 0xDE, 0x48, 0, 0, 0, 0, node]);
    FrameSecurity::new(extended, Protection::EncMic64, key, counter)
}

/// From node 1, by its extended address.
fn link_header() -> Header {
    let extended = Eui64([0xAC, 0xDE, 0x48, 0, 0, 0, 0, 1]);
    Header {
        destination: Panned::new(PanId(0xBEEF), Address::Short(ShortAddress(2))),
        source: Panned::compressed(Address::Extended(extended)),
        ..Header::new(FrameType::Data, 7)
    }
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
