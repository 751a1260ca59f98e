//! Any bytes at any times: no panic, every request ends in bounded time, and the next one is answered.

use arbitrary::{Arbitrary, Unstructured};
use pixy_driver::{
    Model,
    packet::{Request, Signatures},
    session::{Answer, Policy, Session},
};

/// Tries one input.
pub(crate) fn run(input: &[u8]) {
    let Ok(input) = <(u8, Vec<(Vec<u8>, u16)>)>::arbitrary_take_rest(Unstructured::new(input)) else {
        return;
    };
    let (which, chunks) = input;
    let request = match which % 4 {
        0 => Request::Version,
        1 => Request::Resolution,
        2 => Request::FramesPerSecond,
        _ => Request::Blocks {
            of: Signatures::one(which / 4),
            most: which / 8,
        },
    };
    let mut session = Session::new(Model::Pixy2, Policy::default());
    session.begin(request, 0);
    let mut now = 0;
    for (bytes, later) in chunks {
        now += u64::from(later);
        session.sent(usize::MAX);
        for byte in bytes {
            session.receive(byte, now);
        }
        session.tick(now);
        assert!(session.blocks().count() <= 18);
    }
    for _ in 0..10_000 {
        match session.deadline() {
            Some(deadline) => session.tick(deadline),
            None => break,
        }
    }
    assert!(session.deadline().is_none());
    let _ = session.outcome();
    session.begin(Request::Resolution, now);
    session.sent(5);
    for byte in [0xAF, 0xC1, 0x0D, 4, 10, 0, 1, 2, 3, 4] {
        session.receive(byte, now);
    }
    assert_eq!(
        session.outcome(),
        Some(Ok(Answer::Resolution(0x201, 0x403)))
    );
}
