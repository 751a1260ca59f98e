//! Roles that get any messages and events at any times, in any order: no panic, a bounded number of outputs,
//! deadlines in the future, and no message that does not fit or would not decode.

use crate::support;

use calib_core::{
    Refusal,
    camera::Projection,
    dead_reckoning::{Place, PlaceParts, Step, Systematic},
    level::{Elevation, Mounting},
};
use nalgebra::{Point2, Vector2};
use node_firmware::{
    console::FromPc,
    hardware::Button,
    message::{
        CameraCommand, CameraState, CommandOutcome, CommandResult, Confirmation, CoordinateFrame,
        Duty, FittingLens, Hello, ListedSighting, MemberKind, Message, Mount, PoseParts,
        ProtectionLevel, Reference, References, Report, Seen, Sight, StopAnswer, StopBearing,
        Stopped, TargetLocation, Tracked, TrackedBlob,
    },
    role::{
        Role,
        camera::{self, CameraRole},
        coordinator::{self, CoordinatorRole},
        moving_target::{self, TargetRole},
    },
};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use support::{
    bus::{Air, AnyStation, Faults, Station},
    site::{camera_config, target_config},
    target::{BROKEN, WORKS, target_role},
};
use zigbee_link::wire::ShortAddress;

/// Source of anything.
struct Any(ChaCha8Rng);

impl Any {
    fn below(&mut self, limit: u16) -> u16 {
        self.0.random_range(0..limit)
    }

    fn flip(&mut self) -> bool {
        self.0.random()
    }

    fn one<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.0.random_range(0..of.len())]
    }

    fn address(&mut self) -> u16 {
        if self.below(20) == 0 {
            return self.0.random();
        }
        self.below(6)
    }

    fn stop(&mut self) -> u16 {
        if self.below(20) == 0 {
            return self.0.random();
        }
        self.below(20).wrapping_sub(5)
    }

    fn number(&mut self) -> f32 {
        match self.below(40) {
            0 => self.one(&[
                f32::NAN,
                f32::INFINITY,
                f32::MAX,
                f32::MIN,
                1e30,
                f32::MIN_POSITIVE,
            ]),
            1 => 0.0,
            _ => self.0.random_range(-10.0..10.0),
        }
    }

    fn sigma(&mut self) -> f32 {
        match self.below(20) {
            0 => self.number(),
            _ => self.0.random_range(1e-4..0.1),
        }
    }

    fn place(&mut self) -> Place<f32> {
        let spread = self.sigma();
        let place = Place::new(PlaceParts {
            position: Point2::new(self.number(), self.number()),
            fix: self.below(3).into(),
            fix_covariance: [spread, 0.0, spread],
            step_covariance: [spread, 0.0, self.sigma()],
            walked: Vector2::new(self.number(), self.number()),
            systematic: Systematic {
                heading_sigma: self.sigma(),
                scale_sigma: self.sigma(),
            },
            standing_sigma: self.sigma(),
        });
        // A value that decodes is sound.
        place.unwrap_or_else(|_| self.place())
    }

    fn seen(&mut self) -> Seen {
        let elevation = Elevation::from_radians(self.0.random_range(-2.0..2.0));
        Seen::direction(self.0.random_range(-0.6..0.6), self.sigma()).above(elevation)
    }

    fn pose(&mut self) -> PoseParts {
        let spread = self.sigma();
        PoseParts {
            position: [self.number(), self.number()],
            heading: self.number(),
            covariance: [
                spread,
                self.sigma() * spread,
                spread,
                0.0,
                0.0,
                self.sigma(),
            ],
        }
    }

    fn mounting(&mut self) -> Mounting<f32> {
        Mounting {
            pitch: self.number(),
            roll: self.number(),
        }
    }

    fn report(&mut self) -> Report {
        let state = match self.below(6) {
            0 => CameraState::Waiting,
            1 => CameraState::Refused(Refusal::DangerCircle),
            2 => CameraState::Calibrated(self.pose()),
            3 => CameraState::Weak(self.pose()),
            4 => CameraState::OtherLens(
                self.pose(),
                FittingLens::new(Projection::EqualAngle, self.sigma()),
            ),
            _ => CameraState::Doubtful(self.pose()),
        };
        Report {
            id: self.address(),
            duty: self.one(&[None, Some(Duty::First), Some(Duty::Second)]),
            sightings: self.0.random(),
            used: self.0.random(),
            chi_squared: self.number(),
            done: self.flip(),
            joint: self.flip().then(|| ProtectionLevel {
                position: self.sigma().abs(),
                heading: f32::MAX,
            }),
            state,
            mount: self
                .flip()
                .then(|| Mount::of(self.mounting(), self.number()))
                .flatten(),
        }
    }

    fn command(&mut self) -> CameraCommand {
        let colour = self.below(6) as u8;
        self.one(&[
            CameraCommand::Initialise,
            CameraCommand::LearnColour { colour },
            CameraCommand::LearnBackground,
            CameraCommand::Track { colour },
            CameraCommand::StopTracking,
            CameraCommand::Forget,
        ])
    }

    fn sight(&mut self) -> Sight {
        self.one(&[
            Sight::InView,
            Sight::InView,
            Sight::InView,
            Sight::NotInView,
            Sight::Clipped,
            Sight::Unsteady,
            Sight::NotLooking,
            Sight::Failed,
            Sight::NotReady,
            Sight::Hidden,
            Sight::Several,
        ])
    }

    fn kind(&mut self) -> MemberKind {
        let reference = self.flip().then(|| Reference {
            duty: self.one(&[Duty::First, Duty::Second]),
            position: self.flip().then(|| [self.number(), self.number()]),
        });
        self.one(&[MemberKind::Target, MemberKind::Camera { reference }])
    }

    fn message(&mut self) -> Message {
        match self.below(24) {
            0 => Message::Hello(Hello {
                id: self.address(),
                kind: self.kind(),
            }),
            1 => Message::WhoIsThere(heapless::Vec::new()),
            2 => Message::Roster((0..self.below(33)).map(|_| self.address()).collect()),
            3 | 4 => Message::References(References {
                first: self.address(),
                second: self.address(),
                positions: self
                    .flip()
                    .then(|| [[self.number(); 2], [self.number(); 2]]),
            }),
            5..=8 => Message::Stopped(Stopped {
                stop: self.stop(),
                colour: self.below(4) as u8,
                frame: self.one(&[CoordinateFrame::Own, CoordinateFrame::Site]),
                place: self.place(),
            }),
            9 => Message::Look(StopAnswer {
                stop: self.stop(),
                sight: self.sight(),
                seen: self.flip().then(|| self.seen()),
                counted: self.0.random(),
                done: self.flip(),
            }),
            10 => Message::Trigger {
                target: self.address(),
                stop: self.stop(),
            },
            11 | 12 => Message::Bearing(StopBearing {
                target: self.address(),
                stop: self.stop(),
                seen: self.seen(),
                pose: self.flip().then(|| self.pose()),
            }),
            13 => Message::Located(TargetLocation {
                stop: self.stop(),
                position: [self.number(), self.number()],
                covariance: [self.sigma(), self.number() * 1e-3, self.sigma()],
                frame_heading: self.number(),
                frame_heading_sigma: self.sigma(),
            }),
            14 => Message::Posed(self.report()),
            15 => Message::Report(self.report()),
            16 => Message::Command(self.command()),
            17 => Message::Done(CommandResult {
                command: self.command(),
                outcome: CommandOutcome::of(self.flip()),
            }),
            18 => Message::Tracked(Tracked {
                blob: TrackedBlob {
                    middle: self.0.random(),
                    edges: self.0.random(),
                    pixels: self.0.random(),
                    confidence: self.0.random(),
                },
                age_ms: self.0.random(),
                seen: self.flip().then(|| self.seen()),
                is_wide: self.flip(),
            }),
            19..=22 => Message::Confirmed(Confirmation {
                stop: self.stop(),
                seen_by: (0..self.below(4)).map(|_| self.address()).collect(),
            }),
            _ if self.flip() => Message::Sightings,
            _ => Message::Sighting(ListedSighting {
                index: self.0.random(),
                count: self.0.random(),
                target: self.address(),
                stop: self.stop(),
                position: [self.number(), self.number()],
                position_sigma: self.sigma(),
                seen: self.seen(),
            }),
        }
    }
}

/// Any input for a while; the checks are the station's.
fn live<R: Role>(mut station: Station<R>, any: &mut Any, event: impl Fn(&mut Any) -> R::Event) {
    let faults = Faults {
        loss: 0.3,
        ..Faults::default()
    };
    let mut air = Air::new(faults, any.0.random());
    let mut now = 0_u64;
    for _ in 0..250 {
        match any.below(24) {
            0 => station.restart(now),
            1 => station.role.on_attached(zigbee_link::Instant(now), None),
            2 => station.attach(now),
            3 => station.join(now, any.below(2), any.below(3)),
            4..=7 => {
                let event = event(any);
                station.event(now, event);
            }
            _ => {
                let from = ShortAddress(any.address());
                let message = any.message();
                station.hear(now, from, &message);
            }
        }
        let next = station.act(now, &mut air);
        let _ = station.role.indication();
        now = match (any.below(3), next) {
            (0, Some(next)) => next,
            (1, _) => now + u64::from(any.below(10_000)),
            _ => now + 1000 * u64::from(any.below(10_000)),
        };
    }
    // Sound or not, whatever came in: the output is sound.
    for sent in &air.sent {
        let mut buffer = [0; 256];
        let bytes = postcard::to_slice(&sent.message, &mut buffer).unwrap();
        let back = postcard::from_bytes::<Message>(bytes);
        assert!(back.is_ok(), "{:?}", sent.message);
    }
}

fn camera_event(any: &mut Any) -> camera::CameraEvent {
    match any.below(8) {
        0 => camera::CameraEvent::Ready,
        1 => camera::CameraEvent::Button(any.one(&[Button::JoinWindow, Button::LearnColour])),
        2 => camera::CameraEvent::Done(CommandResult {
            command: any.command(),
            outcome: CommandOutcome::of(any.flip()),
        }),
        3 => camera::CameraEvent::Tracked(Tracked {
            blob: TrackedBlob {
                middle: [1; 2],
                edges: [2; 4],
                pixels: 3,
                confidence: 4,
            },
            seen: any.flip().then(|| any.seen()),
            ..Tracked::default()
        }),
        _ => {
            let sight = any.sight();
            camera::CameraEvent::Looked(sight, any.flip().then(|| any.seen()))
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, ..ProptestConfig::default() })]

    #[test]
    fn a_coordinator_survives(seed: u64) {
        let station = Station::<CoordinatorRole>::new(0, CoordinatorRole::new, Box::new(|_, _| None));
        live(station, &mut Any(ChaCha8Rng::seed_from_u64(seed)), |any| {
            match any.below(6) {
                0 => coordinator::CoordinatorEvent::Button(Button::JoinWindow),
                1 => coordinator::CoordinatorEvent::Pc(FromPc::Refresh),
                2 => coordinator::CoordinatorEvent::Pc(FromPc::JoinWindow(any.address())),
                3 => coordinator::CoordinatorEvent::Pc(FromPc::Sightings(any.address())),
                4 => coordinator::CoordinatorEvent::Pc(FromPc::Remove(any.address())),
                _ => coordinator::CoordinatorEvent::Pc(FromPc::Command {
                    address: any.address(),
                    command: any.command(),
                }),
            }
        });
    }

    #[test]
    fn a_camera_survives(seed: u64) {
        let mut any = Any(ChaCha8Rng::seed_from_u64(seed));
        let mut config = camera_config(any.one(&[None, Some(Duty::First), Some(Duty::Second)]));
        config.may_be_elected = any.flip();
        config.refine = any.flip();
        config.baseline = any.flip().then_some(10.0);
        config.frame_heading_deg = any.flip().then_some(30.0);
        config.reference_stops = any.below(14) as u8 + 3;
        let address = 1 + any.below(2);
        let station = Station::<CameraRole>::new(
            address,
            move || CameraRole::new(7, config.clone()),
            Box::new(|_, _| None),
        );
        live(station, &mut any, camera_event);
    }

    #[test]
    fn a_target_survives(seed: u64) {
        let mut any = Any(ChaCha8Rng::seed_from_u64(seed));
        let mut config = target_config(0);
        config.dwell_least_ms = u32::from(any.below(3000));
        config.dwell_most_ms = config.dwell_least_ms + u32::from(any.below(3000));
        let first = any.stop();
        let station = Station::<TargetRole<'_>>::new(
            3,
            move || target_role(9, config, first),
            Box::new(|_, _| None),
        );
        live(station, &mut any, |any| {
            match any.below(16) {
                0 => return BROKEN,
                1 => return WORKS,
                _ => {}
            }
            moving_target::TargetEvent::Step(Step {
                distance: any.number().abs(),
                heading: any.number(),
                distance_sigma: any.sigma(),
                heading_sigma: any.sigma(),
            })
        });
    }
}
