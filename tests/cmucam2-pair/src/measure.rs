//! Figures of the line between driver and camera, measured in virtual time.

use cmucam2_driver::{
    colour::ColourBounds,
    command::{Command, OutputMask, RawMode},
    geometry::Window,
    packet::Packet,
    session::{Answer, Fault, Policy, Request},
};

use cmucam2_emulator::{
    Background, Configuration, Emulator, Extent, FaultRates, Form, Note, Object, Place, Scene,
    Shape, Time, Way,
};

use super::Link;

const SECOND: Time = 1_000_000_000;

/// Form in which T packets are sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PacketForm {
    /// All eight fields as text.
    Text,
    /// Only the middle of mass, as text.
    Middle,
    /// All eight fields as raw bytes.
    Raw,
}

/// The highest rate at which every frame becomes a packet that the driver delivers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HighestRate {
    /// Rows of the window at which it is reached.
    pub rows: u8,
    /// Packets a second.
    pub packets_per_second: f64,
}

/// Fates of T packets on a bad line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Corruption {
    /// Packets that the camera sent.
    pub sent: u32,
    /// Packets that the driver delivered.
    pub delivered: u32,
    /// Delivered packets that the camera did not send.
    pub wrong: u32,
    /// Of these, packets that differ in more than one number from the packet sent.
    pub wrong_in_several: u32,
    /// Calls that ended in a fault, or without a packet.
    pub failed: u32,
}

/// The colour that all these measurements track.
fn orange() -> ColourBounds {
    ColourBounds::new([170, 240, 60, 150, 16, 90]).expect("levels in order")
}

/// An orange ball that moves all over the picture, so that coordinates have all their digits.
fn moving_ball() -> Scene {
    Scene {
        background: Background::Plain([100, 100, 100]),
        objects: vec![Object {
            colour: [210, 105, 40],
            shape: Shape::Disc,
            place: Place::Moving(Way {
                form: Form::Picture,
                stops: vec![
                    (0.0, [0.1, 0.15, 0.15, 0.2]),
                    (3.1, [0.9, 0.3, 0.2, 0.25]),
                    (5.3, [0.8, 0.85, 0.1, 0.12]),
                    (7.7, [0.2, 0.6, 0.3, 0.35]),
                    (9.0, [0.1, 0.15, 0.15, 0.2]),
                ],
                repeat: true,
            }),
        }],
        noise: 2.0,
        ..Scene::default()
    }
}

/// The widest text there is: the target fills columns and rows of three digits.
fn filling_box() -> Scene {
    Scene::with_object(
        [210, 105, 40],
        Shape::Box,
        Extent::centred(0.5, 0.5, 1.0, 1.0),
    )
}

fn link(configuration: Configuration, scene: Scene, policy: Policy) -> Link {
    let baud = configuration.baud;
    Link::new(Emulator::new(configuration, scene), policy, baud)
}

/// The highest rate of T packets without loss: windows of fewer and fewer rows raise the frame
/// rate until the line is too slow for a packet of each frame.
///
/// # Errors
/// The driver's; there are no faults on this line.
pub fn highest_rate(baud: u32, form: PacketForm) -> Result<HighestRate, Fault> {
    const SECONDS: u64 = 1;
    let mut best = HighestRate {
        rows: 0,
        packets_per_second: 0.0,
    };
    // A frame-rate limit is reached long before the last row.
    for rows in (8..=143).rev() {
        let configuration = Configuration {
            baud,
            host_baud: baud,
            watched: true,
            ..Configuration::default()
        };
        let mut link = link(configuration, filling_box(), Policy::default());
        let window = Window::new(1, 144 - rows, 88, 143).expect("corners in order");
        link.ask(Request::Do(Command::VirtualWindow(Some(window)).into()))?;
        match form {
            PacketForm::Text => {}
            PacketForm::Middle => {
                link.ask(Request::Do(
                    Command::OutputMask(OutputMask::Tracking(3)).into(),
                ))?;
            }
            PacketForm::Raw => {
                link.ask(Request::Do(Command::RawMode(RawMode::OUTPUT).into()))?;
            }
        }
        link.ask(Request::Start(Command::TrackColour(Some(orange())).into()))?;
        link.ask(Request::Next)?;
        let (begin, mut packets) = (link.heard_at(), 0_u32);
        while link.heard_at() < begin + SECONDS * SECOND {
            link.ask(Request::Next)?;
            packets += 1;
        }
        let seconds = (link.heard_at() - begin) as f64 / SECOND as f64;
        let rate = f64::from(packets) / seconds;
        let frames = 50.0 * 143.0 / f64::from(rows);
        if rate < 0.995 * frames {
            break;
        }
        best = HighestRate {
            rows,
            packets_per_second: rate,
        };
    }
    Ok(best)
}

/// Tracks a moving ball over a line that damages one byte in this share of its lines.
pub fn corruption(share: f64, strict: bool, packets: u32, seed: u64) -> Corruption {
    let configuration = Configuration {
        baud: 38_400,
        host_baud: 38_400,
        faults: FaultRates {
            corrupt_line: share,
            ..FaultRates::default()
        },
        seed,
        watched: true,
        ..Configuration::default()
    };
    let mut policy = Policy::default();
    policy.strict = strict;
    let mut link = link(configuration, moving_ball(), policy);
    let mut counts = Corruption::default();
    let mut sent: Vec<(Time, Vec<u8>)> = Vec::new();
    // A command may fail on such a line; the next request tries again.
    while link
        .ask(Request::Start(Command::TrackColour(Some(orange())).into()))
        .is_err()
    {}
    while counts.sent < packets {
        let answer = link.ask(Request::Next);
        while let Some(note) = link.camera.take_note() {
            if let Note::Packet { packet, end } = note
                && packet.letter == b'T'
            {
                counts.sent += 1;
                sent.push((end, packet.line()));
            }
        }
        let heard = link.heard_at();
        match answer {
            Ok(Answer::Packet(delivered @ Packet::Tracking(_))) => {
                counts.delivered += 1;
                let delivered = delivered.line();
                let delivered = delivered.as_bytes();
                // The packet on the line: a damaged byte may end it early.
                let truth = sent.iter().find(|(end, _)| *end >= heard);
                if truth.is_none_or(|(_, truth)| truth != delivered) {
                    counts.wrong += 1;
                    let differing = truth.map_or(8, |(_, truth)| differing(truth, delivered));
                    counts.wrong_in_several += u32::from(differing > 1);
                }
            }
            _ => counts.failed += 1,
        }
        sent.retain(|(end, _)| *end >= heard);
    }
    counts
}

/// Lets one camera track a moving ball for some seconds at 50 frames a second, as a simulated
/// network does, and counts its bytes: to be timed by the caller.
pub fn track_for(seconds: u64, seed: u64) -> u64 {
    let configuration = Configuration {
        seed,
        ..Configuration::default()
    };
    let mut camera = Emulator::new(configuration, moving_ball());
    camera.advance(SECOND);
    let [a, b, c, d, e, f] = orange().values();
    for byte in format!("CR 19 32\rTC {a} {b} {c} {d} {e} {f}\r").bytes() {
        camera.receive(byte, SECOND);
    }
    let end = (1 + seconds) * SECOND;
    let mut bytes = 0;
    while let Some(now) = camera.next_deadline().filter(|&now| now < end) {
        while camera.transmit(now).is_some() {
            bytes += 1;
        }
    }
    bytes
}

/// Number of a packet's numbers that differ from another's.
fn differing(a: &[u8], b: &[u8]) -> usize {
    let words = |line| <[u8]>::split(line, u8::is_ascii_whitespace);
    words(a).zip(words(b)).filter(|(a, b)| a != b).count()
}
