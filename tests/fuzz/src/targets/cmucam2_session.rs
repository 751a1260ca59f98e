//! Any bytes and pauses during any request: no panic, and every request ends.
//!
//! The first byte of the input selects the request; of the others, 0xF7 lets the next deadline
//! pass and everything else comes from the camera. When the input is used up, the camera is
//! silent.

use cmucam2_driver::{
    Command,
    colour::ColourBounds,
    session::{Learn, Policy, Request, Session, StartUp},
};

/// Tries one input.
pub(crate) fn run(input: &[u8]) {
    let mut session = Session::new(Policy::default());
    let mut now = 0;
    for part in input.split(|&byte| byte == 0xF6) {
        let Some((&selector, bytes)) = part.split_first() else {
            continue;
        };
        dialogue(&mut session, request(selector), bytes, &mut now);
    }
}

fn request(selector: u8) -> Request {
    let how = Learn::default();
    match selector % 12 {
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
        _ => Request::Next,
    }
}

fn dialogue(session: &mut Session, request: Request, bytes: &[u8], now: &mut u64) {
    let mut row = [0; 264];
    let mut bytes = bytes.iter();
    session.begin(request, *now);
    for _ in 0..100_000 {
        if session.outcome().is_some() {
            return;
        }
        session.sent(session.pending().len());
        if session.payload_due() {
            session.payload_sent(*now);
        }
        match bytes.next() {
            Some(0xF7) | None => {
                *now = session
                    .deadline()
                    .expect("a request under way has a deadline");
                session.tick(*now);
            }
            Some(&byte) => {
                *now += 87;
                session.receive(byte, *now, &mut row);
            }
        }
    }
    panic!("{request:?} never ends");
}
