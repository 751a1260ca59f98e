//! Any bytes and pauses during any requests: no panic, every request ends and sends little, one to a dead camera ends
//! as it must, and a camera that comes back to its senses is usable at once.
//!
//! The input is split at 0xF6; the first byte of each part selects a request. Of the others, 0xF7 lets the next
//! deadline pass, the bytes from 0xE0 on are replies as a camera gives them, and everything else comes from the
//! camera as it is. When a part is used up, the camera is silent.

use std::collections::VecDeque;

use cmucam2_driver::{
    Command,
    colour::{ColourBounds, ColourChannel},
    command::{LineMode, TrackingLines},
    register::Registers,
    session::{Answer, Fault, Learn, Policy, Request, Session, StartUp},
};

const DEADLINE: u8 = 0xF7;
const REPLY: u8 = 0xE0;
const REPLIES: [&str; 11] = [
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
];

/// The most bytes that a request may send.
const SENT: usize = 20_000;

/// Tries one input.
pub(crate) fn run(input: &[u8]) {
    let mut session = Session::new(Policy::default());
    let mut now = 0;
    for part in input.split(|&byte| byte == 0xF6) {
        let Some((&selector, bytes)) = part.split_first() else {
            continue;
        };
        let request = request(selector);
        let mut said = bytes.iter().flat_map(|&byte| {
            let reply = REPLIES.get(usize::from(byte.wrapping_sub(REPLY)));
            let itself = reply.is_none().then_some(byte);
            let bytes = reply.copied().unwrap_or_default().bytes();
            bytes.chain(itself).map(|byte| (byte != DEADLINE).then_some(byte))
        });
        let outcome = dialogue(&mut session, request, &mut now, |_| said.next().flatten());
        if bytes.iter().all(|&byte| byte == DEADLINE) {
            assert!(is_of_a_dead_camera(outcome), "{request:?}: {outcome:?}");
        }
    }
    let (mut streaming, mut said) = (false, VecDeque::new());
    let mut camera = |sent: &[u8]| {
        said.extend(sane(&mut streaming, sent).bytes());
        said.pop_front()
    };
    let reset = Request::Do(Command::Reset.into());
    let outcome = dialogue(&mut session, reset, &mut now, &mut camera);
    assert!(matches!(outcome, Ok(Answer::Version(_))), "{outcome:?}");
    let track = Request::Start(Command::TrackColour(Some(ColourBounds::ALL)).into());
    assert_eq!(dialogue(&mut session, track, &mut now, &mut camera), Ok(Answer::Done));
}

fn request(selector: u8) -> Request {
    let how = Learn::default();
    let lines = LineMode::Tracking(TrackingLines::Bitmap);
    match selector % 21 {
        0 => Request::Do(Command::GetVersion.into()),
        1 => Request::Do(Command::PollMode(true).into()),
        2 => Request::Do(Command::PacketFilter(true).into()),
        3 => Request::Do(Command::GetMean.into()),
        4 => Request::Do(Command::UploadDifference.into()),
        5 => Request::Start(Command::TrackColour(Some(ColourBounds::ALL)).into()),
        6 => Request::Start(Command::SendFrame(None).into()),
        7 => Request::Recover,
        8 => Request::StartUp(StartUp::default()),
        9 => Request::Learn { how, track: true },
        10 => Request::NextPart { row: 264 },
        12 => Request::Do(Command::Reset.into()),
        13 => Request::Do(Command::PollMode(false).into()),
        14 => Request::Do(Command::PacketFilter(false).into()),
        15 => Request::Do(Command::Sleep.into()),
        16 => Request::Do(Command::Registers(Registers::DEFAULTS).into()),
        17 => Request::Do(Command::LineMode(lines).into()),
        18 => Request::Start(Command::SendFrame(Some(ColourChannel::Red)).into()),
        19 => Request::Stop,
        20 => {
            let (window, margin) = (None, 30);
            let how = Learn::Mean { window, margin };
            Request::Learn { how, track: false }
        }
        _ => Request::Next,
    }
}

/// `camera` is told what it was sent, and says its next byte or is silent.
fn dialogue(
    session: &mut Session,
    request: Request,
    now: &mut u64,
    mut camera: impl FnMut(&[u8]) -> Option<u8>,
) -> Result<Answer, Fault> {
    let mut row = [0; 264];
    let mut sent = 0;
    session.begin(request, *now);
    for _ in 0..100_000 {
        if let Some(outcome) = session.outcome() {
            assert_eq!(session.deadline(), None);
            return outcome;
        }
        let line = session.pending().to_vec();
        session.sent(line.len());
        sent += line.len();
        assert!(sent < SENT, "{request:?} sends for ever");
        if session.payload_due() {
            session.payload_sent(*now);
        }
        if let Some(byte) = camera(&line) {
            *now += 87;
            session.receive(byte, *now, &mut row);
        } else {
            *now = session
                .deadline()
                .expect("a request under way has a deadline");
            session.tick(*now);
        }
    }
    panic!("{request:?} never ends");
}

fn is_of_a_dead_camera(outcome: Result<Answer, Fault>) -> bool {
    match outcome {
        Ok(answer) => matches!(answer, Answer::Quiet | Answer::Done),
        Err(fault) => matches!(
            fault,
            Fault::Silence
                | Fault::NotStreaming
                | Fault::Restarted
                | Fault::Garbage
                | Fault::RowBuffer { .. }
        ),
    }
}

/// A camera that obeys its commands.
fn sane(streaming: &mut bool, sent: &[u8]) -> &'static str {
    let Some(line) = sent.strip_suffix(b"\r") else {
        return "";
    };
    let was_streaming = std::mem::take(streaming);
    match line {
        b"" if was_streaming => ":",
        b"RS" => "ACK\r\rCMUcam2 v1.00 c6\r:",
        [b'T', b'C', ..] => {
            *streaming = true;
            "ACK\rT 44 60 30 50 58 70 25 90\rT 44 60 30 50 58 70 25 90\r"
        }
        _ => "ACK\r:",
    }
}
