use std::f32::consts::FRAC_PI_2;

use nalgebra::{Matrix2, Point2};
use zigbee_link::{radio::Channel, wire::Eui64, wire::PanId};

use super::*;
use crate::{config::SensorConfig, message::TargetLocation};

const OWN: f32 = 2.0 / 180.0 * core::f32::consts::PI;
const SCALE: f32 = 0.03;
const STANDING: f32 = 0.02;

const fn at(seconds: u64) -> Instant {
    Instant(seconds * 1_000_000)
}

fn target() -> TargetRole {
    let config = TargetConfig {
        colour: 0,
        still_after_ms: 1_000,
        systematic_heading_deg: OWN.to_degrees(),
        systematic_scale: SCALE,
        standing_sigma: STANDING,
        dwell_least_ms: 2_000,
        dwell_most_ms: 20_000,
        sensor: SensorConfig::UNCALIBRATED,
    };
    TargetRole::new(9, config, 7)
}

/// Ten steps of one unit along the sensor's x axis, which err by nothing of their own.
fn walk(target: &mut TargetRole) {
    let step = Step {
        distance: 1.0,
        heading: 0.0,
        distance_sigma: 0.0,
        heading_sigma: 0.0,
    };
    for _ in 0..10 {
        target.on_event(at(5), TargetEvent::Step(step));
    }
}

#[track_caller]
fn check(target: &TargetRole, position: [f32; 2], variances: [f32; 2]) {
    let place = target.place().unwrap();
    let off = place.position() - Point2::from(position);
    assert!(off.norm() < 1e-4, "{:?}", place.position());
    let expected = Matrix2::from_diagonal(&variances.into());
    let covariance = place.covariance();
    let off = covariance - expected;
    assert!(off.norm() < 1e-3 * expected.norm(), "{covariance}");
}

/// Of ten units, three percent along the way and two degrees across it.
#[test]
fn a_walk_is_as_uncertain_as_what_its_sensor_always_does_wrong() {
    let mut target = target();
    check(&target, [0.0, 0.0], [STANDING * STANDING; 2]);
    walk(&mut target);
    let along = 100.0 * SCALE * SCALE + STANDING * STANDING;
    let across = 100.0 * OWN * OWN + STANDING * STANDING;
    check(&target, [10.0, 0.0], [along, across]);
}

/// The sensor's x axis is the site's y axis, with an error that adds to the sensor's own.
#[test]
fn a_target_that_was_located_walks_on_in_the_frame_of_the_site() {
    const FRAME: f32 = 0.04;
    let mut target = target();
    let membership = Membership {
        pan: PanId(1),
        channel: Channel::FIRST,
        short: ShortAddress(3),
        coordinator: Eui64([2; 8]),
    };
    target.on_attached(at(0), Some(membership));
    let _ = target.poll(at(2));
    let located = TargetLocation {
        stop: target.stop,
        position: [3.0, 4.0],
        covariance: [0.25, 0.0, 0.16],
        frame_heading: FRAC_PI_2,
        frame_heading_sigma: FRAME,
    };
    target.on_located(at(3), &located);
    check(
        &target,
        [3.0, 4.0],
        [0.25, 0.16].map(|variance| variance + STANDING * STANDING),
    );
    walk(&mut target);
    let across = 0.25 + 100.0 * (OWN * OWN + FRAME * FRAME) + STANDING * STANDING;
    let along = 0.16 + 100.0 * SCALE * SCALE + STANDING * STANDING;
    check(&target, [3.0, 14.0], [across, along]);
    // What a second reference camera tells is too late.
    let again = TargetLocation {
        position: [0.0, 0.0],
        ..located
    };
    target.on_located(at(6), &again);
    check(&target, [3.0, 14.0], [across, along]);
}
