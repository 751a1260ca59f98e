//! The dialogue with cameras that do not keep to the protocol: every request ends, in bounded time
//! and with bounded output, and a camera that comes back to its senses is usable at once.

use crate::random;

use cmucam2_driver::{
    Command,
    colour::{ColourBounds, ColourChannel},
    command::{LineMode, TrackingLines},
    register::Registers,
    session::{Answer, Fault, Learn, Policy, Request, Session, StartUp},
};
use random::{Random, garbage};

const REPLIES: &[&str] = &[
    "ACK\r:",
    "ACK\r",
    "NCK\r:",
    ":",
    "ACK\r128\r:",
    "ACK\r170 230 70 130 16 46\r:",
    "CMUcam2 v1.01 c6\r:",
    "T 44 60 30 50 58 70 25 90\r",
    "T 0 0 0 0 0 0 0 0\r",
    "S 200 100 30 9 9 9\r",
    "ACK\r\x01\x03\x02\x02abc\x02abc\x03:",
    "",
];

fn request(random: &mut Random) -> Request {
    let bounds = ColourBounds::new([170, 230, 70, 130, 16, 46]).unwrap();
    match random.below(20) {
        0 => Request::Do(Command::GetVersion.into()),
        1 => Request::Do(Command::Reset.into()),
        2 => Request::Do(Command::PollMode(random.chance(50)).into()),
        3 => Request::Do(Command::PacketFilter(random.chance(50)).into()),
        4 => Request::Do(Command::GetMean.into()),
        5 => Request::Do(Command::Sleep.into()),
        6 => Request::Do(Command::UploadDifference.into()),
        7 => Request::Do(Command::Registers(Registers::DEFAULTS).into()),
        8 => Request::Do(Command::LineMode(LineMode::Tracking(TrackingLines::Bitmap)).into()),
        9 => Request::Start(Command::TrackColour(Some(bounds)).into()),
        10 => Request::Start(Command::TrackWindow.into()),
        11 => Request::Start(Command::SendFrame(Some(ColourChannel::Red)).into()),
        12 => Request::Stop,
        13 => Request::Recover,
        14 => Request::StartUp({
            let mut start_up = StartUp::default();
            start_up.adapt_ms = 100;
            start_up
        }),
        15 => Request::Learn {
            how: Learn::TrackWindow,
            track: true,
        },
        16 => Request::Learn {
            how: Learn::Mean {
                window: None,
                margin: 30,
            },
            track: false,
        },
        17 => Request::NextPart { row: 8 },
        _ => Request::Next,
    }
}

/// Answer of the other end to `sent`.
type Camera<'a> = &'a mut dyn FnMut(&[u8]) -> Vec<u8>;

/// Drives a request to its end; `None` if it takes longer than ten minutes of its own time.
fn drive(
    session: &mut Session,
    request: Request,
    now: &mut u64,
    camera: Camera<'_>,
) -> Option<Result<Answer, Fault>> {
    let begin = *now;
    let mut row = [0; 8];
    let mut sent = 0;
    session.begin(request, *now);
    loop {
        if let Some(outcome) = session.outcome() {
            assert_eq!(session.deadline(), None);
            return Some(outcome);
        }
        let line = session.pending().to_vec();
        session.sent(line.len());
        sent += line.len();
        assert!(sent < 20_000, "{request:?} sends for ever");
        if session.payload_due() {
            session.payload_sent(*now);
        }
        for byte in camera(&line) {
            *now += 87;
            session.receive(byte, *now, &mut row);
            session.tick(*now);
        }
        if session.pending().is_empty()
            && let Some(deadline) = session.deadline()
        {
            *now = deadline.max(*now);
            session.tick(*now);
        }
        if *now - begin > 600_000_000 {
            return None;
        }
    }
}

/// A camera that obeys its commands.
fn sane(streaming: &mut bool, sent: &[u8]) -> Vec<u8> {
    let Some(line) = sent.strip_suffix(b"\r") else {
        return Vec::new();
    };
    let was_streaming = std::mem::take(streaming);
    match line {
        b"" if was_streaming => b":".to_vec(),
        b"GV" => b"ACK\rCMUcam2 v1.00 c6\r:".to_vec(),
        b"RS" => b"ACK\r\rCMUcam2 v1.00 c6\r:".to_vec(),
        [b'T', b'C', ..] => {
            *streaming = true;
            b"ACK\rT 44 60 30 50 58 70 25 90\rT 44 60 30 50 58 70 25 90\r".to_vec()
        }
        _ => b"ACK\r:".to_vec(),
    }
}

#[test]
fn every_request_ends_and_the_camera_is_usable_afterwards() {
    for seed in 0..2_000 {
        let mut random = Random::new(seed);
        let mut session = Session::new(Policy::default());
        let mut now = 0;
        for _ in 0..12 {
            let request = request(&mut random);
            let mad = random.below(4);
            let outcome = drive(&mut session, request, &mut now, &mut |sent| {
                let mut bytes = Vec::new();
                match mad {
                    0 => {}
                    1 => garbage(&mut random, 30, &mut bytes),
                    _ if sent.is_empty() && mad == 2 => {}
                    _ => {
                        for _ in 0..=random.below(2) {
                            let at = random.below(REPLIES.len() as u64) as usize;
                            bytes.extend_from_slice(REPLIES[at].as_bytes());
                        }
                    }
                }
                bytes
            });
            assert!(outcome.is_some(), "seed {seed}: {request:?} never ends");
            if mad == 0 {
                let harmless = matches!(
                    outcome,
                    Some(Err(Fault::Silence
                        | Fault::NotStreaming
                        | Fault::Restarted
                        | Fault::Garbage))
                        | Some(Ok(Answer::Quiet | Answer::Done))
                );
                assert!(
                    harmless,
                    "seed {seed}: {request:?} of a dead camera: {outcome:?}"
                );
            }
        }
        let mut streaming = false;
        let mut camera = |sent: &[u8]| sane(&mut streaming, sent);
        let reset = Request::Do(Command::Reset.into());
        let outcome = drive(&mut session, reset, &mut now, &mut camera);
        assert!(
            matches!(outcome, Some(Ok(Answer::Version(_)))),
            "seed {seed}: {outcome:?}"
        );
        let bounds = ColourBounds::new([170, 230, 70, 130, 16, 46]).unwrap();
        let track = Request::Start(Command::TrackColour(Some(bounds)).into());
        let outcome = drive(&mut session, track, &mut now, &mut camera);
        assert_eq!(outcome, Some(Ok(Answer::Done)), "seed {seed}");
    }
}

/// A line that carries only noise at full speed.
#[test]
fn noise_for_ever_is_garbage_in_bounded_time() {
    for byte in [0x00, b'T', b'\r', b'5', 0xFF, b'A'] {
        let mut session = Session::new(Policy::default());
        let mut now = 0;
        let request = Request::Do(Command::GetVersion.into());
        let outcome = drive(&mut session, request, &mut now, &mut |_| vec![byte; 100]);
        assert_eq!(outcome, Some(Err(Fault::Garbage)), "{byte}");
        assert!(now < 60_000_000, "{byte}: {now} us");
    }
}
