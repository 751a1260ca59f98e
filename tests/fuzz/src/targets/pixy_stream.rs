//! Any bytes of a camera that streams: no panic, every block has a sum that holds, a whole block behind them is
//! found, and every request ends in bounded time.

use pixy_driver::{
    Model,
    packet::{Request, Signatures},
    session::{Policy, Session},
    stream::{Event, Stream},
};

/// Tries one input.
pub(crate) fn run(input: &[u8]) {
    let Some((&which, bytes)) = input.split_first() else {
        return;
    };
    let mut stream = Stream::default();
    let block = [0x55, 0xAA, 0xFD, 0, 1, 0, 0x9E, 0, 0x34, 0, 0x15, 0, 0x15, 0];
    let mut last = None;
    for &byte in bytes.iter().chain(&block).chain(&[1; 16]) {
        stream.push(byte);
        while let Some(event) = stream.next_event() {
            if let Event::Block(found) = event {
                assert!(found.signature > 0);
                last = Some(found);
            }
        }
    }
    let last = last.expect("a whole block");
    // What looks like a block may have its beginning in the input, and its end in this one.
    let numbers = [last.signature, last.x, last.y, last.width, last.height];
    if numbers != [1, 158, 52, 21, 21] {
        assert!(bytes.iter().filter(|&&byte| byte == 0xAA).count() > 0);
    }
    let model = [Model::Pixy, Model::OpenMv, Model::OpenMvTags][usize::from(which) % 3];
    let mut session = Session::new(model, Policy::default());
    let of = match which / 3 {
        tag if tag % 2 == 0 => Signatures::tag((tag / 2).into()),
        signature => Signatures::one(signature / 2),
    };
    let mut now = 0;
    for chunk in bytes.chunks(usize::from(which % 37) + 1) {
        session.begin(Request::Blocks { of, most: which }, now);
        for &byte in chunk {
            session.receive(byte, now);
            assert!(session.pending().is_empty());
        }
        assert!(session.blocks().count() <= usize::from(which).min(4));
        for _ in 0..9 {
            match session.deadline() {
                Some(deadline) => now = deadline,
                None => break,
            }
            session.tick(now);
        }
        assert!(session.deadline().is_none());
    }
}
