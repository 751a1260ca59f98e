use calib_core::angle::wrap_signed;

use super::*;
use crate::{
    config::{LensSigma, SensorConfig, SurveySigma},
    role::moving_target::history::tests::estimate,
};

const CONFIG: TargetConfig = TargetConfig {
    lens_sigma: LensSigma::EXACT,
    survey_sigma: SurveySigma::EXACT,
    colour: 0,
    still_after_ms: 1_000,
    systematic_heading_deg: 2.0,
    systematic_scale: 0.05,
    standing_sigma: 0.01,
    ball_radius: 0.0,
    dwell_least_ms: 2_000,
    dwell_most_ms: 20_000,
    roams: false,
    sensor: SensorConfig::UNCALIBRATED,
};

/// Two references on the x axis and a third camera: x, y and heading.
const CAMERAS_AT: [[f32; 3]; 3] = [[0.0, 0.0, 1.2], [10.0, 0.0, 2.0], [5.0, 12.0, -1.5]];

/// Places of a walk before all of them.
fn place(stop: StopNumber) -> Point2<f32> {
    let turn = f32::from(stop);
    Point2::new(
        5.0 + 2.0 * (turn * 1.3).sin(),
        6.0 + 1.5 * (turn * 0.9).cos(),
    )
}

/// A target whose frame is that of its sensor, and the reports of both references.
struct Walk {
    estimate: Estimate<'static>,
    table: Table,
    unsaved: Unsaved,
}

impl Walk {
    fn new() -> Self {
        let mut walk = Self {
            estimate: estimate(),
            table: Table::new(),
            unsaved: Unsaved::new(),
        };
        for (address, duty) in [(1, Duty::First), (2, Duty::Second)] {
            let [x, y, heading] = CAMERAS_AT[usize::from(address) - 1];
            let parts = PoseParts {
                position: [x, y],
                heading,
                covariance: [0.0, 0.0, 0.0, 0.0, 0.0, 1e-4],
            };
            let report = Report {
                id: address,
                duty: Some(duty),
                sightings: 3,
                used: 3,
                chi_squared: 1.0,
                done: true,
                joint: None,
                state: CameraState::Calibrated(parts),
                mount: None,
            };
            walk.table.report(address, report, &mut walk.unsaved);
        }
        walk.estimate.on_sensor(0.0, 0.0);
        walk
    }

    /// The target walks to this stop, and stands.
    fn arrive(&mut self, stop: StopNumber) {
        if let Some(before) = stop.checked_sub(1) {
            let way = place(stop) - place(before);
            self.estimate.on_step(&Step {
                distance: way.norm(),
                heading: way.y.atan2(way.x),
                distance_sigma: 0.02,
                heading_sigma: 0.01,
            });
        }
        self.estimate.on_stop(stop, &mut self.unsaved);
    }

    /// All cameras see it there.
    fn look(&mut self, stop: StopNumber) {
        for (address, [x, y, heading]) in (1..).zip(CAMERAS_AT) {
            let to = place(stop) - Point2::new(x, y);
            let bearing = wrap_signed(to.y.atan2(to.x) - heading);
            let seen = Seen::direction(bearing, 0.003);
            self.estimate
                .on_seen(address, stop, &seen, 0.0, &mut self.unsaved);
        }
    }

    fn begin(&mut self) -> bool {
        self.estimate.find_frame(&self.table, &CONFIG);
        self.estimate.begin(&mut self.unsaved)
    }

    fn end(&mut self) -> Option<Estimated> {
        loop {
            if let Some(estimated) = self.estimate.step(&self.table) {
                return estimated;
            }
        }
    }

    /// Returns true if something checks the pose that the third camera was told last.
    fn is_checked(&self) -> bool {
        let told = self.estimate.told[2].expect("it was seen often enough");
        told.joint.is_some_and(|level| !level.is_none())
    }
}

/// A target is at its next stop before the last one is estimated: that one was solved all the same.
#[test]
fn a_round_that_ends_late_has_solved_its_stops() {
    let mut walk = Walk::new();
    walk.arrive(0);
    for stop in 0..14 {
        walk.look(stop);
        let begins = walk.begin();
        walk.arrive(stop + 1);
        if begins {
            walk.end();
        }
        if stop >= 5 {
            assert_eq!(walk.estimate.unsolved.0, 0, "stop {stop}");
            assert!(walk.is_checked(), "stop {stop}");
        }
    }
    // Of a round that is given up nothing is known.
    walk.look(14);
    assert!(walk.begin());
    assert!(walk.estimate.remove_stop(3, &mut walk.unsaved));
    walk.end();
    assert_eq!(walk.estimate.unsolved.0, 0);
}

/// Sightings since then do not confirm the pose.
#[test]
fn poses_are_weak_after_several_stops_without_a_result() {
    let mut walk = Walk::new();
    for stop in 0..8 {
        walk.arrive(stop);
        walk.look(stop);
        if walk.begin() {
            walk.end();
        }
    }
    assert!(walk.is_checked());
    for more in [0, 1, CONTRADICTING as u8] {
        let told = walk.estimate.told[2].as_mut().unwrap();
        told.sightings = 8 - more;
        for stop in 0..u16::from(UNSOLVED) {
            assert!(walk.is_checked(), "{more}, {stop}");
            walk.estimate.round = Some(100 + stop);
            // A further round at the same stop counts once.
            walk.estimate.on_unsolved(&walk.table);
            walk.estimate.on_unsolved(&walk.table);
        }
        walk.estimate.unsolved = (0, None);
    }
    let told = walk.estimate.told[2].map(|report| report.status());
    assert_eq!(told, Some(Status::Weak));
    assert!(!walk.is_checked());
}
