//! Common errors of a target's places, as it tells them: those that all of its steps make in the same way.

use core::time::Duration;

use calib_core::dead_reckoning::Step;
use node_firmware::network::{Attachment, NetworkIdentity};
use node_firmware::{
    config::{LensSigma, SurveySigma, TargetConfig},
    message::{CoordinateFrame, Message, Stopped, TargetLocation},
    role::{
        Output, Role,
        moving_target::{TargetEvent, TargetRole},
    },
};
use zigbee_link::{Instant, wire::ShortAddress};

const OWN_HEADING: f32 = 3.0_f32.to_radians();
const OWN_SCALE: f32 = 0.08;

struct Carrier {
    now: Instant,
    target: TargetRole<'static>,
}

impl Carrier {
    fn new() -> Self {
        let mut config = TargetConfig::default();
        config.lens_sigma = LensSigma::EXACT;
        config.survey_sigma = SurveySigma::EXACT;
        config.systematic_scale = OWN_SCALE;
        config.standing_sigma = 0.0;
        config.dwell_most_ms = 60_000;
        let mut carrier = Self {
            now: Instant(0),
            target: TargetRole::new(10, config, 7),
        };
        let network = Attachment {
            network: NetworkIdentity {
                number: 1,
                founder: [2, 0, 0, 0, 0, 0, 0, 0],
            },
            own: 10,
        };
        carrier.target.on_attached(carrier.now, Some(network));
        carrier
    }

    /// Steps without errors of their own, along x of the sensor's frame.
    fn walk(&mut self, distance: f32) {
        for _ in 0..5 {
            self.now = self.now + Duration::from_millis(500);
            let step = Step {
                distance: distance / 5.0,
                heading: 0.0,
                distance_sigma: 0.0,
                heading_sigma: 0.0,
            };
            self.target.on_event(self.now, TargetEvent::Step(step));
        }
    }

    /// Its message when it stands.
    fn stand(&mut self) -> Stopped {
        let mut told = None;
        for _ in 0..30 {
            self.now = self.now + Duration::from_millis(100);
            while let Some(output) = self.target.poll(self.now) {
                if let Output::Send {
                    message: Message::Stopped(stopped),
                    ..
                } = output
                {
                    told = Some(stopped);
                }
            }
        }
        told.expect("it stands")
    }

    fn is_told_its_place(&mut self, stop: u16, frame_heading_sigma: f32) {
        let located = TargetLocation {
            stop,
            position: [2.0, 1.0],
            covariance: [1e-4, 0.0, 1e-4],
            frame_heading: 0.0,
            frame_heading_sigma,
        };
        self.target.on_message(
            self.now,
            ShortAddress(0),
            &Message::Roster([1, 2].into_iter().collect()),
        );
        self.target
            .on_message(self.now, ShortAddress(1), &Message::Located(located));
    }
}

fn assert_near(value: f32, expected: f32) {
    assert!((value / expected - 1.0).abs() < 1e-4, "{value}, {expected}");
}

#[test]
fn places_carry_the_sigmas_of_the_configuration() {
    let mut carrier = Carrier::new();
    carrier.walk(10.0);
    let stopped = carrier.stand();
    assert_eq!(stopped.frame, CoordinateFrame::Own);
    let systematic = stopped.place.parts().systematic;
    assert_near(systematic.heading_sigma, OWN_HEADING);
    assert_near(systematic.scale_sigma, OWN_SCALE);
    // Ten along x: the scale errs along, the heading across.
    let covariance = stopped.place.covariance();
    assert_near(covariance.m11, (10.0 * OWN_SCALE).powi(2));
    assert_near(covariance.m22, (10.0 * OWN_HEADING).powi(2));
}

#[test]
fn in_the_frame_of_the_site_its_direction_errs_as_well() {
    let mut carrier = Carrier::new();
    carrier.walk(10.0);
    let first = carrier.stand();
    carrier.is_told_its_place(first.stop, 0.04);
    let found = carrier.stand();
    assert_eq!(found.frame, CoordinateFrame::Site);
    assert_ne!(found.place.parts().fix, first.place.parts().fix);
    // The walk before is forgotten.
    assert_near(found.place.covariance().m11, 1e-4);
    carrier.walk(5.0);
    let place = carrier.stand().place;
    assert_eq!(place.parts().fix, found.place.parts().fix);
    let heading = OWN_HEADING.hypot(0.04);
    assert_near(place.parts().systematic.heading_sigma, heading);
    assert_near(place.parts().systematic.scale_sigma, OWN_SCALE);
    assert_near(place.covariance().m11, 1e-4 + (5.0 * OWN_SCALE).powi(2));
    assert_near(place.covariance().m22, 1e-4 + (5.0 * heading).powi(2));
}
