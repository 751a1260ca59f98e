//! Messages, lines of the console and events in any order, to a node of any role: no panic, no end
//! of outputs, no deadline that has passed, and nothing sent that would not decode.
//!
//! The first byte selects the role; from 128 on, facts follow that the node remembers, each with its
//! length before it, up to a length of 0. Then come records: kind, pause in units of 100 ms, sender,
//! length, and that many bytes.

use std::time::Duration;

use node_firmware::{
    config::{CameraConfig, Sigmas, Subjects, TargetConfig},
    console::{Frames, FromPc, ToPc},
    facts::Fact,
    message::{CommandResult, Duty, Message, Reference, Seen, Sight, Tracked},
    network::{Attachment, NetworkIdentity},
    role::{
        Output, Role,
        camera::{self, CameraRole},
        coordinator::{self, CoordinatorRole},
        moving_target::{self, TargetRole},
    },
    steps::{Chip, SensorFault},
    vision::Lens,
};
use zigbee_link::{Instant, link::MESSAGE_MAX, wire::ShortAddress};

/// Tries one input.
pub(crate) fn run(input: &[u8]) {
    let Some((&selector, records)) = input.split_first() else {
        return;
    };
    let _ = postcard::from_bytes::<Fact>(records);
    let (facts, records) = match selector {
        128.. => remembered(records),
        _ => (Vec::new(), records),
    };
    match selector % 5 {
        0 => {
            let mut frames = Frames::default();
            live(&facts, records, 0, CoordinatorRole::new(), |bytes| {
                let wishes = bytes.iter().filter_map(|&byte| frames.push::<FromPc>(byte));
                wishes.map(coordinator::CoordinatorEvent::Pc).collect()
            });
        }
        1 => live(
            &facts,
            records,
            3,
            TargetRole::new(9, target(), 0xFFFE),
            |bytes| step(bytes).into_iter().collect(),
        ),
        2 => live(&facts, records, 1, camera(None), |bytes| {
            look(bytes).into_iter().collect()
        }),
        3 => live(&facts, records, 1, camera(Some(Duty::First)), |bytes| {
            look(bytes).into_iter().collect()
        }),
        _ => {
            let mut frames = Frames::default();
            for &byte in records {
                let _ = frames.push::<ToPc>(byte);
            }
            live(&facts, records, 2, camera(Some(Duty::Second)), |bytes| {
                look(bytes).into_iter().collect()
            });
        }
    }
}

/// Facts, and what follows them.
fn remembered(mut rest: &[u8]) -> (Vec<Fact>, &[u8]) {
    let mut facts = Vec::new();
    while let [len, tail @ ..] = rest {
        let (fact, tail) = tail.split_at(tail.len().min(usize::from(*len)));
        rest = tail;
        if *len == 0 {
            break;
        }
        facts.extend(postcard::from_bytes::<Fact>(fact));
    }
    (facts, rest)
}

fn target() -> TargetConfig {
    let mut config = TargetConfig::default();
    config.systematic_heading_deg = 0.5;
    config.systematic_scale = 0.01;
    config.dwell_most_ms = 20_000;
    config
}

fn camera(duty: Option<Duty>) -> CameraRole {
    let subjects = Subjects::Motion { threshold: 10 };
    let mut config = CameraConfig::new(Lens::pin_hole(88, 45.0), subjects);
    config.reference = duty.map(|duty| Reference {
        duty,
        position: None,
    });
    config.baseline = Some(10.0);
    config.good_enough = Sigmas {
        position: 0.05,
        heading_deg: 0.25,
    };
    config.sigma_floor_px = 0.1;
    CameraRole::new(7, config)
}

fn number(bytes: &[u8]) -> Option<(f32, &[u8])> {
    let (number, rest) = bytes.split_first_chunk()?;
    Some((f32::from_le_bytes(*number), rest))
}

fn step(bytes: &[u8]) -> Option<moving_target::TargetEvent> {
    let Some((distance, rest)) = number(bytes) else {
        let fault = Chip::Compass.is(SensorFault::Silent);
        let failed = bytes.is_empty();
        return Some(moving_target::TargetEvent::Sensor(failed.then_some(fault)));
    };
    let (heading, rest) = number(rest)?;
    let (distance_sigma, rest) = number(rest)?;
    let (heading_sigma, _) = number(rest)?;
    Some(moving_target::TargetEvent::Step(
        calib_core::dead_reckoning::Step {
            distance,
            heading,
            distance_sigma,
            heading_sigma,
        },
    ))
}

fn look(bytes: &[u8]) -> Option<camera::CameraEvent> {
    let (&kind, rest) = bytes.split_first()?;
    match kind {
        0 => Some(camera::CameraEvent::Ready),
        1 => Some(camera::CameraEvent::Looked(
            postcard::from_bytes::<Sight>(rest).ok()?,
            None,
        )),
        2 => {
            let (bearing, rest) = number(rest)?;
            let (sigma, _) = number(rest)?;
            let seen = Seen::direction(bearing, sigma);
            Some(camera::CameraEvent::Looked(Sight::InView, Some(seen)))
        }
        3 => Some(camera::CameraEvent::Done(
            postcard::from_bytes::<CommandResult>(rest).ok()?,
        )),
        _ => Some(camera::CameraEvent::Tracked(
            postcard::from_bytes::<Tracked>(rest).ok()?,
        )),
    }
}

fn live<R: Role>(
    facts: &[Fact],
    records: &[u8],
    short: u16,
    mut role: R,
    mut events: impl FnMut(&[u8]) -> Vec<R::Event>,
) {
    let attachment = Attachment {
        network: NetworkIdentity {
            number: 1,
            founder: [2; 8],
        },
        own: short,
    };
    let mut now = Instant(0);
    let mut notifications = Vec::new();
    for fact in facts {
        role.restore(fact);
    }
    role.on_attached(now, Some(attachment));
    let mut rest = records;
    while let [kind, pause, from, len, tail @ ..] = rest {
        now = now + Duration::from_millis(100 * u64::from(*pause));
        let (bytes, tail) = tail.split_at(tail.len().min(usize::from(*len)));
        rest = tail;
        match kind % 8 {
            0 => {
                for event in events(bytes) {
                    role.on_event(now, event);
                }
            }
            1 => role.on_attached(now, None),
            2 => role.on_attached(now, Some(attachment)),
            3 => {
                for notification in notifications.drain(..) {
                    role.on_sent(now, notification, pause % 2 == 0);
                }
            }
            _ => {
                if let Ok(message) = postcard::from_bytes::<Message>(bytes) {
                    role.on_message(now, ShortAddress((*from).into()), &message);
                }
            }
        }
        let mut outputs = 0;
        role.compute(now);
        while let Some(output) = role.poll(now) {
            outputs += 1;
            assert!(outputs < 200, "it never has enough");
            match output {
                Output::Send {
                    message,
                    notification,
                    ..
                } => {
                    check(&message);
                    notifications.extend(notification);
                }
                Output::Save(fact) => {
                    let mut slot = [0; 90];
                    let bytes = postcard::to_slice(&fact, &mut slot).expect("a fact fits");
                    assert!(postcard::from_bytes::<Fact>(bytes).is_ok(), "{fact:?}");
                }
                Output::Task(_) => {}
            }
        }
        assert!(role.next_deadline().is_none_or(|deadline| deadline > now));
        let _ = role.indication();
    }
}

fn check(message: &Message) {
    let mut buffer = [0; MESSAGE_MAX];
    let bytes = postcard::to_slice(message, &mut buffer).expect("a message fits a frame");
    assert!(
        postcard::from_bytes::<Message>(bytes).is_ok(),
        "{message:?}"
    );
}
