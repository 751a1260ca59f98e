//! The wire formats of messages and console, which are interfaces: golden bytes of every variant, lengths,
//! and that nothing unsound decodes.

use calib_core::{
    Refusal, Status,
    camera::Projection,
    dead_reckoning::{Place, PlaceParts, Systematic},
    level::{Elevation, Mounting},
};
use nalgebra::{Point2, Vector2};
use node_firmware::{
    config::SiteKey,
    console::{
        FRAME_MAX, Frames, FromPc, KeyChangeReport, NetworkInfo, ToPc, TrackedObject, encode,
    },
    limits::ROSTER,
    message::{
        CONFIRMED, CameraCommand, CameraState, CommandOutcome, CommandResult, Confirmation,
        CoordinateFrame, Duty, Eye, FittingLens, Health, Hello, ListedSighting, MemberKind, Memory,
        Message, Mount, PoseParts, ProtectionLevel, Reference, References, Report, Restart, Seen,
        Sight, StopAnswer, StopBearing, Stopped, TargetLocation, Tracked, TrackedBlob,
    },
    steps::{Chip, SensorFault},
    vision::BackgroundShare,
};
use proptest::prelude::*;
use zigbee_link::link::MESSAGE_MAX;

/// 1.0, 2.0, 0.5 and 0.0 as IEEE 754 has them, little-endian.
const ONE: &str = "0000803f";
const TWO: &str = "00000040";
const HALF: &str = "0000003f";
const ZERO: &str = "00000000";

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn seen() -> Seen {
    let below = Elevation::from_radians(-0.2);
    Seen::direction(1.0, 0.5).wide(0.03).above(below)
}

fn place() -> Place<f32> {
    Place::new(PlaceParts {
        position: Point2::new(1.0, 2.0),
        fix: 300,
        fix_covariance: [1.0, 0.5, 2.0],
        step_covariance: [2.0, 0.0, 1.0],
        walked: Vector2::new(0.5, 1.0),
        systematic: Systematic {
            heading_sigma: 0.5,
            scale_sigma: 1.0,
        },
        standing_sigma: 2.0,
    })
    .unwrap()
}

fn pose() -> PoseParts {
    PoseParts {
        position: [1.0, 2.0],
        heading: 0.5,
        covariance: [1.0, 0.0, 2.0, 0.0, 0.5, 1.0],
    }
}

fn report(duty: Option<Duty>, state: CameraState) -> Report {
    Report {
        id: 11,
        duty,
        sightings: 4,
        used: 3,
        chi_squared: 2.0,
        done: true,
        joint: None,
        state,
        mount: None,
    }
}

/// Degrees.
fn mount(pitch: f32, roll: f32) -> Option<Mount> {
    let [pitch, roll] = [pitch, roll].map(f32::to_radians);
    Mount::of(Mounting { pitch, roll }, 2.0)
}

fn place_bytes() -> String {
    // 300 is ac 02 as a varint.
    [
        ONE, TWO, "ac02", ONE, HALF, TWO, TWO, ZERO, ONE, HALF, ONE, HALF, ONE, TWO,
    ]
    .concat()
}

fn pose_bytes() -> String {
    [ONE, TWO, HALF, ONE, ZERO, TWO, ZERO, HALF, ONE].concat()
}

fn look(sight: Sight) -> Message {
    Message::Look(StopAnswer {
        stop: 5,
        sight,
        seen: (sight == Sight::InView).then(seen),
        counted: 3,
        done: false,
    })
}

/// Every variant, and every one of the enums inside.
fn golden() -> Vec<(Message, String)> {
    let reference = |duty, position| Hello {
        id: 7,
        kind: MemberKind::Camera {
            reference: Some(Reference { duty, position }),
        },
    };
    let references = |positions| {
        Message::References(References {
            first: 1,
            second: 2,
            positions,
        })
    };
    let stopped = |frame| {
        Message::Stopped(Stopped {
            stop: 5,
            colour: 2,
            frame,
            place: place(),
        })
    };
    let bearing = |pose| {
        Message::Bearing(StopBearing {
            target: 9,
            stop: 5,
            seen: seen(),
            pose,
        })
    };
    let mut all: Vec<(Message, String)> = [
        (
            Message::Hello(Hello {
                id: 7,
                kind: MemberKind::Camera { reference: None },
            }),
            "00070000".into(),
        ),
        (
            Message::Hello(reference(Duty::First, None)),
            "000700010000".into(),
        ),
        (
            Message::Hello(reference(Duty::Second, Some([1.0, 2.0]))),
            format!("000700010101{ONE}{TWO}"),
        ),
        (
            Message::Hello(Hello {
                id: 300,
                kind: MemberKind::Target,
            }),
            "00ac0201".into(),
        ),
        (Message::WhoIsThere(heapless::Vec::new()), "0100".into()),
        (
            Message::WhoIsThere([1, 300].into_iter().collect()),
            "010201ac02".into(),
        ),
        (
            Message::Roster([1, 300].into_iter().collect()),
            "020201ac02".into(),
        ),
        (references(None), "03010200".into()),
        (
            references(Some([[1.0, 2.0], [0.5, 0.0]])),
            format!("03010201{ONE}{TWO}{HALF}{ZERO}"),
        ),
        (
            stopped(CoordinateFrame::Own),
            format!("04050200{}", place_bytes()),
        ),
        (
            stopped(CoordinateFrame::Site),
            format!("04050201{}", place_bytes()),
        ),
        (Message::Trigger { target: 9, stop: 5 }, "060905".into()),
        (bearing(None), format!("070905{ONE}{HALF}ac029f1f00")),
        (
            bearing(Some(pose())),
            format!("070905{ONE}{HALF}ac029f1f01{}", pose_bytes()),
        ),
        (
            Message::Located(TargetLocation {
                stop: 5,
                position: [1.0, 2.0],
                covariance: [1.0, 0.5, 2.0],
                frame_heading: 0.5,
                frame_heading_sigma: 1.0,
            }),
            format!("0805{ONE}{TWO}{ONE}{HALF}{TWO}{HALF}{ONE}"),
        ),
        (
            Message::Posed(report(Some(Duty::First), CameraState::Doubtful(pose()))),
            format!("090b01000403{TWO}010004{}00", pose_bytes()),
        ),
        (
            Message::Report(report(None, CameraState::Waiting)),
            format!("0a0b000403{TWO}01000000"),
        ),
        (
            Message::Report(report(Some(Duty::First), CameraState::Calibrated(pose()))),
            format!("0a0b01000403{TWO}010002{}00", pose_bytes()),
        ),
        (
            Message::Posed(Report {
                joint: Some(ProtectionLevel {
                    position: 1.0,
                    heading: 2.0,
                }),
                ..report(None, CameraState::Weak(pose()))
            }),
            format!("090b000403{TWO}0101{ONE}{TWO}03{}00", pose_bytes()),
        ),
        (
            Message::Report(report(None, CameraState::Weak(pose()))),
            format!("0a0b000403{TWO}010003{}00", pose_bytes()),
        ),
        (
            Message::Report(report(None, CameraState::Doubtful(pose()))),
            format!("0a0b000403{TWO}010004{}00", pose_bytes()),
        ),
        (
            // 60.1 degrees of equal angles: 0x8259, as a varint.
            Message::Report(report(
                None,
                CameraState::OtherLens(
                    pose(),
                    FittingLens::new(Projection::EqualAngle, 60.15_f32.to_radians()),
                ),
            )),
            format!("0a0b000403{TWO}010005{}d9840200", pose_bytes()),
        ),
        (
            // 20 degrees down: 2000, and half a degree of roll, zigzag, as varints; 2 above the ball.
            Message::Report(Report {
                mount: mount(20.001, -0.501),
                ..report(None, CameraState::Weak(pose()))
            }),
            format!("0a0b000403{TWO}010003{}01a01f63{TWO}", pose_bytes()),
        ),
        (
            Message::Done(CommandResult {
                command: CameraCommand::Forget,
                outcome: CommandOutcome::Done,
            }),
            "0c0501".into(),
        ),
        (
            Message::Tracked(Tracked {
                blob: TrackedBlob {
                    middle: [1, 2],
                    edges: [3, 4, 5, 300],
                    pixels: 7,
                    confidence: 255,
                },
                age_ms: 9,
                seen: Some(seen()),
                is_wide: true,
            }),
            format!("0d0102030405ac0207ff0901{ONE}{HALF}ac029f1f01"),
        ),
        (Message::Sightings, "0e".into()),
        (
            Message::Sighting(ListedSighting {
                index: 1,
                count: 3,
                target: 9,
                stop: 5,
                position: [1.0, 2.0],
                position_sigma: 0.5,
                seen: seen(),
            }),
            format!("0f01030905{ONE}{TWO}{HALF}{ONE}{HALF}ac029f1f"),
        ),
        (
            Message::Confirmed(Confirmation {
                stop: 5,
                seen_by: [3, 300].into_iter().collect(),
            }),
            "10050203ac02".into(),
        ),
    ]
    .into();
    let sights = [
        Sight::InView,
        Sight::NotInView,
        Sight::Clipped,
        Sight::Unsteady,
        Sight::NotLooking,
        Sight::Failed,
        Sight::NotReady,
        Sight::Hidden,
        Sight::Several,
    ];
    for (n, sight) in sights.into_iter().enumerate() {
        let seen = if n == 0 {
            format!("01{ONE}{HALF}ac029f1f")
        } else {
            "00".into()
        };
        all.push((look(sight), format!("0505{n:02x}{seen}0300")));
    }
    let refusals = [
        Refusal::TooFew,
        Refusal::CoincidentTargets,
        Refusal::DangerCircle,
        Refusal::DangerLine,
        Refusal::Undetermined,
        Refusal::TargetBehind,
        Refusal::NotFinite,
        Refusal::DidNotConverge,
        Refusal::Inconsistent,
    ];
    for (n, refusal) in refusals.into_iter().enumerate() {
        let report = report(Some(Duty::Second), CameraState::Refused(refusal));
        all.push((
            Message::Report(report),
            format!("0a0b01010403{TWO}010001{n:02x}00"),
        ));
    }
    let commands = [
        (CameraCommand::Initialise, "00"),
        (CameraCommand::LearnColour { colour: 3 }, "0103"),
        (CameraCommand::LearnBackground, "02"),
        (CameraCommand::Track { colour: 1 }, "0301"),
        (CameraCommand::StopTracking, "04"),
        (CameraCommand::Forget, "05"),
    ];
    for (command, bytes) in commands {
        all.push((Message::Command(command), format!("0b{bytes}")));
    }
    for (health, bytes) in healths() {
        all.push((Message::Health(health), format!("11{bytes}")));
    }
    all
}

/// One of each kind.
fn healths() -> [(Health, &'static str); 10] {
    let health = |memory, camera, restart| Health {
        memory,
        camera,
        restart,
        steps: None,
    };
    let steps = |fault| Health {
        steps: Some(fault),
        ..Health::default()
    };
    [
        (steps(Chip::Motion.is(SensorFault::Absent)), "0000000101"),
        (steps(Chip::Motion.is(SensorFault::Scale)), "0000000107"),
        (steps(Chip::Compass.is(SensorFault::Overrun)), "0000000119"),
        (
            health(Memory::Flash, Eye::Sees, Restart::Ordinary),
            "00000000",
        ),
        (
            health(Memory::Ram, Eye::Blind, Restart::RadioDeaf),
            "01010100",
        ),
        (
            health(Memory::Ram, Eye::Failed, Restart::RadioStuck),
            "01020200",
        ),
        (
            health(Memory::Flash, Eye::Sees, Restart::CameraStuck),
            "00000300",
        ),
        (
            health(Memory::Flash, Eye::Sees, Restart::Program),
            "00000400",
        ),
        (
            health(Memory::Flash, Eye::Hidden, Restart::Ordinary),
            "00030000",
        ),
        (
            health(Memory::Flash, Eye::Several, Restart::Ordinary),
            "00040000",
        ),
    ]
}

/// Frozen. Written by hand from postcard's specification, not by the encoder.
#[test]
fn messages_are_these_bytes() {
    for (message, bytes) in golden() {
        let encoded = postcard::to_allocvec_like(&message);
        assert_eq!(hex(&encoded), bytes, "{message:?}");
        assert_eq!(postcard::from_bytes(&encoded), Ok(message));
    }
}

/// A byte that is no fault of a step sensor is refused, and the record of a run has words.
#[test]
fn faults_of_the_step_sensor() {
    for code in 0..=u8::MAX {
        let number = code & 0x0F;
        let is_one = code < 0x20 && (1..=9).contains(&number);
        let health = postcard::from_bytes::<Health>(&[0, 0, 0, 1, code]);
        assert_eq!(health.is_ok(), is_one, "{code}");
        if let Ok(health) = health {
            let fault = health.steps.unwrap();
            assert_eq!(fault.chip().is(fault.fault()), fault);
            let text = serde_json::to_string(&health).unwrap();
            assert_eq!(serde_json::from_str::<Health>(&text).unwrap(), health);
        }
    }
    let fault = Chip::Compass.is(SensorFault::Silent);
    let text = serde_json::to_string(&fault).unwrap();
    assert_eq!(text, r#"{"chip":"compass","fault":"silent"}"#);
    assert_eq!(
        fault.to_string(),
        "the step sensor's LIS3MDL (compass) has stopped: check its supply"
    );
}

/// postcard without its own allocation, as the link does it.
mod postcard {
    pub(super) use ::postcard::from_bytes;

    pub(super) fn to_allocvec_like<T: serde::Serialize>(value: &T) -> Vec<u8> {
        let mut buffer = [0; 1024];
        ::postcard::to_slice(value, &mut buffer).unwrap().to_vec()
    }
}

fn tell(message: ToPc) -> String {
    let mut buffer = [0; FRAME_MAX];
    let frame = encode(&message, &mut buffer).unwrap().to_vec();
    let (end, body) = frame.split_last().unwrap();
    assert_eq!(*end, 0);
    assert!(!body.contains(&0), "zero bytes end frames");
    let mut frames = Frames::default();
    let told: Vec<ToPc> = frame.iter().filter_map(|&b| frames.push(b)).collect();
    assert_eq!(told, [message]);
    hex(&postcard::to_allocvec_like(&message))
}

#[test]
fn what_the_pc_is_told_is_these_bytes() {
    let hello = Hello {
        id: 7,
        kind: MemberKind::Target,
    };
    let network = NetworkInfo {
        pan: 300,
        channel: 15,
    };
    assert_eq!(tell(ToPc::Network(None)), "0000");
    assert_eq!(tell(ToPc::Network(Some(network))), "0001ac020f");
    assert_eq!(tell(ToPc::Member { address: 3, hello }), "01030701");
    let report = report(None, CameraState::Calibrated(pose()));
    assert_eq!(
        tell(ToPc::Report { address: 3, report }),
        format!("02030b000403{TWO}010002{}00", pose_bytes())
    );
    let done = CommandResult {
        command: CameraCommand::LearnBackground,
        outcome: CommandOutcome::Failed,
    };
    assert_eq!(tell(ToPc::Done { address: 3, done }), "03030200");
    let share = |thousandths| BackgroundShare { thousandths };
    for (outcome, hex) in [
        (CommandOutcome::Learnt(share(3)), "030301010203"),
        (CommandOutcome::CommonColour(share(445)), "0303010103bd03"),
        (CommandOutcome::PartOfObject, "0303010104"),
    ] {
        let done = CommandResult {
            command: CameraCommand::LearnColour { colour: 1 },
            outcome,
        };
        assert_eq!(tell(ToPc::Done { address: 3, done }), hex);
    }
    let tracked = Tracked {
        blob: TrackedBlob {
            middle: [1, 2],
            edges: [3, 4, 5, 6],
            pixels: 7,
            confidence: 8,
        },
        ..Tracked::default()
    };
    assert_eq!(
        tell(ToPc::Tracked {
            address: 3,
            tracked
        }),
        "04030102030405060708000000"
    );
    let object = TrackedObject {
        place: ([1.0, 2.0], [0.5, 0.0, 1.0]),
        velocity: [1.0, 0.5],
        unseen_ms: 300,
    };
    for (object, hex) in [
        (None, "0c0300".to_owned()),
        (
            Some(object),
            format!("0c0301{ONE}{TWO}{HALF}00000000{ONE}{ONE}{HALF}ac02"),
        ),
    ] {
        assert_eq!(tell(ToPc::Object { id: 3, object }), hex);
    }
    let sighting = ListedSighting {
        index: 1,
        count: 3,
        target: 9,
        stop: 5,
        position: [1.0, 2.0],
        position_sigma: 0.5,
        seen: seen(),
    };
    assert_eq!(
        tell(ToPc::Sighting {
            address: 3,
            sighting
        }),
        format!("050301030905{ONE}{TWO}{HALF}{ONE}{HALF}ac029f1f")
    );
    let removed = ToPc::Removed {
        address: 300,
        success: true,
    };
    assert_eq!(tell(removed), "06ac0201");
    let change = KeyChangeReport {
        index: 2,
        check: [3, 4, 5],
        done: true,
        unreached: 1,
    };
    assert_eq!(tell(ToPc::KeyChange(None)), "0700");
    assert_eq!(
        tell(ToPc::KeyChange(Some(change))),
        "07010203040501 01".replace(' ', "")
    );
    let pan = |conflict_s, changes| ToPc::Pan {
        conflict_s,
        changes,
    };
    assert_eq!(tell(pan(None, true)), "080001");
    assert_eq!(tell(pan(Some(300), false)), "0801ac0200");
    for (health, bytes) in healths() {
        let line = ToPc::Health { address: 3, health };
        assert_eq!(tell(line), format!("0903{bytes}"));
    }
    let reference = ToPc::Reference {
        address: 300,
        present: true,
    };
    assert_eq!(tell(reference), "0aac0201");
    let stopped = |place| ToPc::Stopped {
        address: 300,
        stop: 5,
        place,
    };
    assert_eq!(tell(stopped(None)), "0bac020500");
    assert_eq!(
        tell(stopped(Some(([1.0, 2.0], [0.5, 1.0, 2.0])))),
        format!("0bac020501{ONE}{TWO}{HALF}{ONE}{TWO}")
    );
}

/// Before their checksum and COBS.
#[test]
fn what_the_pc_wants_is_these_bytes() {
    let key = SiteKey::new(2, core::array::from_fn(|i| i as u8 + 1));
    let wants: [(FromPc, &[u8]); 8] = [
        (FromPc::Refresh, &[0]),
        (FromPc::JoinWindow(300), &[1, 0xAC, 2]),
        (
            FromPc::Command {
                address: 3,
                command: CameraCommand::Track { colour: 1 },
            },
            &[2, 3, 3, 1],
        ),
        (FromPc::Sightings(3), &[3, 3]),
        (FromPc::Remove(300), &[4, 0xAC, 2]),
        (
            FromPc::ChangeKey(key),
            &[5, 2, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16],
        ),
        (FromPc::ChangePan, &[6]),
        (
            FromPc::Located {
                address: 3,
                located: TargetLocation::of_place(([1.0, -2.0], [0.25, 0.0, 0.5])),
            },
            &[
                7, 3, 0, 0, 0, 0x80, 0x3F, 0, 0, 0, 0xC0, 0, 0, 0x80, 0x3E, 0, 0, 0, 0, 0, 0, 0,
                0x3F, 0, 0, 0, 0, 0, 0, 0, 0,
            ],
        ),
    ];
    for (wish, bytes) in wants {
        assert_eq!(postcard::to_allocvec_like(&wish), bytes);
        let mut buffer = [0; FRAME_MAX];
        let frame = encode(&wish, &mut buffer).unwrap();
        let mut frames = Frames::default();
        let heard: Vec<FromPc> = frame.iter().filter_map(|&b| frames.push(b)).collect();
        assert_eq!(heard, [wish]);
    }
}

/// A whole frame: the CRC-32 of one zero byte is 0xD202EF8D, and COBS puts the distance to the next zero
/// in the place of each.
#[test]
fn a_console_frame_is_these_bytes() {
    let mut buffer = [0; FRAME_MAX];
    let frame = encode(&FromPc::Refresh, &mut buffer).unwrap();
    assert_eq!(frame, [1, 5, 0x8D, 0xEF, 0x02, 0xD2, 0]);
}

/// No bit of a frame with a key can flip unnoticed, nor two of them, nor a burst of them.
#[test]
fn a_key_with_flipped_bits_is_no_key() {
    let key = SiteKey::new(2, core::array::from_fn(|i| 0x5A ^ (7 * i) as u8));
    let mut buffer = [0; FRAME_MAX];
    let frame = encode(&FromPc::ChangeKey(key), &mut buffer)
        .unwrap()
        .to_vec();
    let bits = (frame.len() - 1) * 8;
    let heard = |flipped: &[usize]| {
        let mut frame = frame.clone();
        for bit in flipped {
            frame[bit / 8] ^= 1 << (bit % 8);
        }
        let mut frames = Frames::default();
        // Messages from the rest after a false end of the frame count too.
        let heard = frame.iter().filter_map(|&byte| frames.push::<FromPc>(byte));
        heard.count()
    };
    assert_eq!(heard(&[]), 1);
    for a in 0..bits {
        assert_eq!(heard(&[a]), 0, "bit {a}");
        for b in a + 1..bits {
            assert_eq!(heard(&[a, b]), 0, "bits {a} and {b}");
        }
        let burst: Vec<_> = (a..bits.min(a + 17)).collect();
        assert_eq!(heard(&burst), 0, "from bit {a}");
    }
}

#[test]
fn a_console_frame_that_is_bad_costs_only_itself() {
    for noise in [
        vec![],
        vec![9, 9, 9],
        vec![7; FRAME_MAX - 1],
        vec![7; FRAME_MAX],
        vec![7; 5 * FRAME_MAX + 3],
    ] {
        let mut frames = Frames::default();
        let bad = noise.iter().chain(&[0]);
        assert_eq!(bad.filter_map(|&b| frames.push::<FromPc>(b)).count(), 0);
        let mut buffer = [0; FRAME_MAX];
        let whole = encode(&FromPc::Refresh, &mut buffer).unwrap();
        let good: Vec<FromPc> = whole.iter().filter_map(|&b| frames.push(b)).collect();
        assert_eq!(good, [FromPc::Refresh]);
    }
}

/// The longest of each kind: all numbers as large as they get.
fn longest() -> Vec<(&'static str, Message)> {
    let widest = Seen {
        half_width: u16::MAX,
        elevation: Elevation::UNKNOWN,
        ..seen()
    };
    let far = u16::MAX;
    let share = BackgroundShare { thousandths: far };
    let place = Place::new(PlaceParts {
        fix: u32::MAX,
        ..*place().parts()
    })
    .unwrap();
    let report = Report {
        id: far,
        mount: mount(-120.0, 170.0),
        sightings: 255,
        used: 255,
        joint: Some(ProtectionLevel {
            position: 1.0,
            heading: 2.0,
        }),
        ..report(
            Some(Duty::Second),
            CameraState::OtherLens(pose(), FittingLens::new(Projection::EqualAngle, 6.0)),
        )
    };
    vec![
        (
            "Hello",
            Message::Hello(Hello {
                id: far,
                kind: MemberKind::Camera {
                    reference: Some(Reference {
                        duty: Duty::Second,
                        position: Some([1.0, 2.0]),
                    }),
                },
            }),
        ),
        (
            "WhoIsThere",
            Message::WhoIsThere([far; ROSTER].into_iter().collect()),
        ),
        (
            "Roster",
            Message::Roster([far; ROSTER].into_iter().collect()),
        ),
        (
            "References",
            Message::References(References {
                first: far,
                second: far,
                positions: Some([[1.0, 2.0], [3.0, 4.0]]),
            }),
        ),
        (
            "Stopped",
            Message::Stopped(Stopped {
                stop: far,
                colour: 255,
                frame: CoordinateFrame::Site,
                place,
            }),
        ),
        (
            "Look",
            Message::Look(StopAnswer {
                stop: far,
                sight: Sight::InView,
                seen: Some(widest),
                counted: 255,
                done: true,
            }),
        ),
        (
            "Trigger",
            Message::Trigger {
                target: far,
                stop: far,
            },
        ),
        (
            "Bearing",
            Message::Bearing(StopBearing {
                target: far,
                stop: far,
                seen: widest,
                pose: Some(pose()),
            }),
        ),
        (
            "Located",
            Message::Located(TargetLocation {
                stop: far,
                position: [1.0, 2.0],
                covariance: [1.0, 0.5, 2.0],
                frame_heading: 0.5,
                frame_heading_sigma: 1.0,
            }),
        ),
        ("Posed", Message::Posed(report)),
        ("Report", Message::Report(report)),
        (
            "Command",
            Message::Command(CameraCommand::LearnColour { colour: 255 }),
        ),
        (
            "Done",
            Message::Done(CommandResult {
                command: CameraCommand::LearnColour { colour: 255 },
                outcome: CommandOutcome::CommonColour(share),
            }),
        ),
        (
            "Tracked",
            Message::Tracked(Tracked {
                blob: TrackedBlob {
                    middle: [315; 2],
                    edges: [315; 4],
                    pixels: 255,
                    confidence: 255,
                },
                age_ms: u16::MAX,
                seen: Some(seen()),
                is_wide: true,
            }),
        ),
        ("Sightings", Message::Sightings),
        (
            "Sighting",
            Message::Sighting(ListedSighting {
                index: 255,
                count: 255,
                target: far,
                stop: far,
                position: [1.0, 2.0],
                position_sigma: 0.5,
                seen: widest,
            }),
        ),
        (
            "Confirmed",
            Message::Confirmed(Confirmation {
                stop: far,
                seen_by: [far; CONFIRMED].into_iter().collect(),
            }),
        ),
        ("Health", Message::Health(healths()[2].0)),
    ]
}

/// Most bytes of payload per kind. A kind that grows costs airtime, so that should be seen.
const LENGTHS: [(&str, usize); 18] = [
    ("Hello", 16),
    ("WhoIsThere", 98),
    ("Roster", 98),
    ("References", 24),
    ("Stopped", 63),
    ("Look", 22),
    ("Trigger", 7),
    ("Bearing", 58),
    ("Located", 32),
    ("Posed", 73),
    ("Report", 73),
    ("Command", 3),
    ("Done", 7),
    ("Tracked", 32),
    ("Sightings", 1),
    ("Sighting", 35),
    ("Confirmed", 77),
    ("Health", 6),
];

#[test]
fn every_message_fits_a_frame() {
    let lengths: Vec<(&str, usize)> = longest()
        .iter()
        .map(|(kind, message)| (*kind, postcard::to_allocvec_like(message).len()))
        .collect();
    for (kind, length) in &lengths {
        println!("{kind:12}{length:4}");
        assert!(*length <= MESSAGE_MAX, "{kind} has {length} bytes");
    }
    assert_eq!(lengths, LENGTHS);
}

/// Told to the PC, the longest message of a camera still fits a frame of the console.
#[test]
fn every_line_to_the_pc_fits() {
    let address = u16::MAX;
    for (kind, message) in longest() {
        let line = match message {
            Message::Hello(hello) => ToPc::Member { address, hello },
            Message::Report(report) => ToPc::Report { address, report },
            Message::Done(done) => ToPc::Done { address, done },
            Message::Tracked(tracked) => ToPc::Tracked { address, tracked },
            Message::Sighting(sighting) => ToPc::Sighting { address, sighting },
            Message::Health(health) => ToPc::Health { address, health },
            _ => continue,
        };
        let mut buffer = [0; FRAME_MAX];
        assert!(encode(&line, &mut buffer).is_some(), "{kind}");
    }
}

/// A decoded message has only finite numbers in it, and is itself when it is sent on.
fn check(bytes: &[u8]) {
    let Ok(message) = postcard::from_bytes::<Message>(bytes) else {
        return;
    };
    let shown = format!("{message:?}");
    // A configured position is checked where references are appointed.
    if !matches!(message, Message::Hello(_)) {
        assert!(!shown.contains("NaN") && !shown.contains("inf"), "{shown}");
    }
    match &message {
        Message::Bearing(bearing) => {
            assert!(bearing.seen.is_usable());
            assert!(bearing.pose.is_none_or(|pose| pose.pose().is_some()));
        }
        Message::Posed(report) | Message::Report(report) => {
            assert!(report.pose().is_none_or(|p| p.pose().is_some()));
        }
        _ => {}
    }
    let again = postcard::to_allocvec_like(&message);
    assert!(again.len() <= MESSAGE_MAX);
    let back = postcard::from_bytes::<Message>(&again).unwrap();
    assert_eq!(format!("{back:?}"), shown);
}

/// Every number of every message, one after the other, is spoilt.
#[test]
fn spoilt_numbers_do_not_decode() {
    let mut refused = 0;
    for (_, message) in longest() {
        let good = postcard::to_allocvec_like(&message);
        for at in 0..good.len().saturating_sub(3) {
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0] {
                let mut bytes = good.clone();
                bytes[at..at + 4].copy_from_slice(&bad.to_le_bytes());
                check(&bytes);
                refused += u32::from(postcard::from_bytes::<Message>(&bytes).is_err());
            }
        }
    }
    assert!(refused > 500, "{refused}");
}

#[test]
fn unsound_values_do_not_decode() {
    let unsound = [
        Message::Posed(report(
            None,
            CameraState::Calibrated(PoseParts {
                covariance: [1.0, 2.0, 1.0, 0.0, 0.0, 1.0],
                ..pose()
            }),
        )),
        Message::Posed(Report {
            chi_squared: -1.0,
            ..report(None, CameraState::Calibrated(pose()))
        }),
        Message::Bearing(StopBearing {
            target: 1,
            stop: 1,
            seen: Seen {
                sigma: 0.0,
                ..seen()
            },
            pose: None,
        }),
        Message::Report(report(
            None,
            CameraState::Weak(PoseParts {
                heading: f32::NAN,
                ..pose()
            }),
        )),
        Message::References(References {
            first: 1,
            second: 2,
            positions: Some([[0.0, 0.0], [f32::INFINITY, 0.0]]),
        }),
    ];
    for message in unsound {
        let bytes = postcard::to_allocvec_like(&message);
        assert!(
            postcard::from_bytes::<Message>(&bytes).is_err(),
            "{message:?}"
        );
    }
}

/// A report tells the status of a pose, and none without one.
#[test]
fn a_report_has_a_status() {
    for (state, status) in [
        (CameraState::Waiting, Status::Waiting),
        (CameraState::Refused(Refusal::DangerLine), Status::Refused),
        (CameraState::Calibrated(pose()), Status::Calibrated),
        (CameraState::Weak(pose()), Status::Weak),
        (CameraState::Doubtful(pose()), Status::Doubtful),
        (
            CameraState::OtherLens(pose(), FittingLens::new(Projection::PinHole, 0.8)),
            Status::Doubtful,
        ),
    ] {
        let report = report(None, state);
        assert_eq!(report.status(), status);
        let has_pose = !matches!(status, Status::Waiting | Status::Refused);
        assert_eq!(report.pose().is_some(), has_pose, "{status}");
    }
}

proptest! {
    #[test]
    fn any_bytes_are_a_sound_message_or_none(bytes in prop::collection::vec(any::<u8>(), 0..128)) {
        check(&bytes);
    }

    /// Bytes of one kind each, so that the inner parts are reached.
    #[test]
    fn any_bytes_behind_a_kind(kind in 0_u8..18, bytes in prop::collection::vec(any::<u8>(), 0..100)) {
        let mut all = vec![kind];
        all.extend(bytes);
        check(&all);
    }

    #[test]
    fn any_line_is_survived(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let mut frames = Frames::default();
        for byte in bytes {
            let _ = frames.push::<FromPc>(byte);
        }
        // Whatever came before, after the end of a frame the next one is heard.
        let _ = frames.push::<FromPc>(0);
        let mut buffer = [0; FRAME_MAX];
        let frame = encode(&FromPc::Refresh, &mut buffer).unwrap();
        let heard: Vec<FromPc> = frame.iter().filter_map(|&b| frames.push(b)).collect();
        prop_assert_eq!(heard, [FromPc::Refresh]);
    }
}

/// Packets of updates, which every later version must hand on.
#[cfg(feature = "update")]
#[test]
fn updates_are_these_bytes() {
    use node_firmware::message::UpdatePacket;

    let packet = UpdatePacket::new(&[1, 2, 3]).unwrap();
    assert_eq!(
        hex(&postcard::to_allocvec_like(&Message::Update(packet))),
        "1203010203"
    );
    let wish = FromPc::Update { to: 0xFFFF, packet };
    assert_eq!(hex(&postcard::to_allocvec_like(&wish)), "08ffff0303010203");
    assert_eq!(tell(ToPc::Update { address: 3, packet }), "0d0303010203");
    assert_eq!(tell(ToPc::UpdateSent), "0e");
    let references = References {
        first: 3,
        second: 300,
        positions: None,
    };
    assert_eq!(tell(ToPc::References(Some(references))), "0f0103ac0200");
    assert_eq!(tell(ToPc::References(None)), "0f00");
    // The longest fits the air and the line.
    let longest = UpdatePacket::new(&[0xA5; 92]).unwrap();
    assert_eq!(UpdatePacket::new(&[0xA5; 93]), None);
    let message = Message::Update(longest);
    let bytes = postcard::to_allocvec_like(&message);
    assert!(bytes.len() <= MESSAGE_MAX, "{}", bytes.len());
    assert_eq!(postcard::from_bytes::<Message>(&bytes), Ok(message));
    let mut buffer = [0; FRAME_MAX];
    let (to, address) = (u16::MAX, u16::MAX);
    assert!(
        encode(
            &FromPc::Update {
                to,
                packet: longest
            },
            &mut buffer
        )
        .is_some()
    );
    assert!(
        encode(
            &ToPc::Update {
                address,
                packet: longest
            },
            &mut buffer
        )
        .is_some()
    );
}
