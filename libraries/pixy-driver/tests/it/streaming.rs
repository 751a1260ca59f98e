//! Cameras that stream: bytes of other programs, and a line that loses some.

use std::{cell::RefCell, collections::VecDeque, rc::Rc};

use embassy_futures::block_on;
use pixy_driver::{
    Error, Model, Pixy,
    packet::{Request, Signatures},
    session::{Answer, Fault, Policy, Session},
};
use proptest::prelude::*;

const BLOBS: &[u8] = include_bytes!("../../../../tests/data/openmv/blobs.bin");
const TAGS: &[u8] = include_bytes!("../../../../tests/data/openmv/tags.bin");

const fn of(of: Signatures) -> Request {
    Request::Blocks { of, most: 2 }
}

fn words(words: &[u16]) -> Vec<u8> {
    words.iter().copied().flat_map(u16::to_le_bytes).collect()
}

/// A block of a colour, or of a code with its angle.
fn block(signature: u16, x: u16, angle: Option<u16>) -> Vec<u8> {
    let mut numbers = vec![signature, x, 100, 20, 22];
    numbers.extend(angle);
    let sum = numbers
        .iter()
        .fold(0_u16, |sum, &word| sum.wrapping_add(word));
    let sync = if angle.is_some() { 0xAA56 } else { 0xAA55 };
    words(&[&[sync, sum], &numbers[..]].concat())
}

fn picture(blocks: &[Vec<u8>]) -> Vec<u8> {
    [words(&[0xAA55]), blocks.concat()].concat()
}

/// Answers to requests that follow one another, each as columns of the blobs.
fn answers(model: Model, request: Request, bytes: &[u8]) -> Vec<Vec<u16>> {
    let mut session = Session::new(model, Policy::default());
    session.begin(request, 0);
    let mut answers = Vec::new();
    for &byte in bytes {
        assert!(session.pending().is_empty());
        session.receive(byte, 0);
        if session.outcome() == Some(Ok(Answer::Blocks)) {
            answers.push(session.blocks().map(|block| block.x).collect());
            session.begin(request, 0);
        }
    }
    answers
}

/// A listener that connects in the middle loses the picture under way, and no more.
#[test]
fn pictures_from_any_byte_on() {
    let none = vec![];
    let seen = |first: u16| -> Vec<Vec<u16>> {
        let column = |n: u16| {
            if n.is_multiple_of(3) {
                none.clone()
            } else {
                vec![first + n]
            }
        };
        (2..=8).map(column).collect()
    };
    let third = of(Signatures::one(3));
    assert_eq!(answers(Model::OpenMv, third, BLOBS), seen(100));
    let five = of(Signatures::tag(5));
    assert_eq!(answers(Model::OpenMvTags, five, TAGS), seen(60));
    for cut in 1..20 {
        let all = seen(100);
        let heard = answers(Model::OpenMv, third, &BLOBS[cut..]);
        // After a cut the first zero words may be those of a picture, or within a block.
        let with = |all: &[Vec<u16>]| all.iter().filter(|told| !told.is_empty()).count();
        assert_eq!(with(&heard), with(&all) - 1, "{cut}");
        assert_eq!(heard[heard.len() - 4..], all[3..], "{cut}");
    }
}

#[test]
fn only_what_is_asked_for() {
    let all = picture(&[
        block(2, 10, None),
        block(1, 20, None),
        block(0o12, 30, Some(5)),
        block(1, 40, None),
        block(1, 50, None),
        block(0o13, 60, Some(0)),
    ]);
    let next = picture(&[block(7, 0, None)]);
    let bytes = [all, next].concat();
    for (signatures, columns) in [
        (Signatures::one(1), &[20, 40][..]),
        (Signatures::one(3), &[]),
        (Signatures::ALL, &[10, 20]),
        (Signatures::code(0), &[30, 60]),
        (Signatures::code(0o13), &[60]),
        (Signatures::tag(2), &[30]),
        (Signatures::tag(4), &[]),
    ] {
        assert_eq!(answers(Model::Pixy, of(signatures), &bytes), [columns]);
    }
}

/// The first block is the largest one: a picture without it is none.
#[test]
fn a_damaged_picture_is_none() {
    let mut bytes = [
        picture(&[block(1, 10, None), block(1, 20, None)]),
        picture(&[block(1, 30, None)]),
        picture(&[block(7, 0, None)]),
    ]
    .concat();
    let request = of(Signatures::one(1));
    for place in 2..30 {
        bytes[place] ^= 0x10;
        assert_eq!(answers(Model::Pixy, request, &bytes), [vec![30]], "{place}");
        bytes[place] ^= 0x10;
    }
    assert_eq!(
        answers(Model::Pixy, request, &bytes),
        [vec![10, 20], vec![30]]
    );
}

/// A line that is turned round, as between RS-232 and a pin, or has another rate, is damaged and not silent, and none of
/// its blocks is taken. People have met both (forum.pixycam.com, topic 5023).
#[test]
fn a_line_that_cannot_be_understood_is_not_silent() {
    let pictures: Vec<u8> = (0..40_u16)
        .flat_map(|n| picture(&[block(1, 10 + n, None), block(2, 90, None)]))
        .collect();
    // At half the rate, two bits are read as one.
    let slow = pictures.chunks(2).map(|two| {
        let bits = u16::from_le_bytes([two[0], two[1]]);
        (0..8).fold(0, |byte, bit| {
            byte | (((bits >> (2 * bit)) & 1) as u8) << bit
        })
    });
    let turned = pictures.iter().map(|byte| !byte);
    for bytes in [turned.collect::<Vec<_>>(), slow.collect()] {
        for (model, request) in [
            (Model::Pixy, of(Signatures::ALL)),
            (Model::OpenMv, of(Signatures::ALL)),
            (Model::Pixy2, Request::Version),
        ] {
            let mut session = Session::new(model, Policy::default());
            session.begin(request, 0);
            let mut outcome = None;
            let mut bytes = bytes.iter().cycle();
            // A byte each 0.1 ms.
            for now in (0..200_000_000).step_by(100) {
                session.sent(session.pending().len());
                session.receive(*bytes.next().unwrap(), now);
                session.tick(now);
                outcome = session.outcome();
                if outcome.is_some() {
                    break;
                }
            }
            assert_eq!(outcome, Some(Err(Fault::Garbled)), "{model:?}");
        }
    }
}

/// The Pixy tells zero words where it sees nothing, as many as it likes; between pictures, too.
#[test]
fn nothing_in_view_is_no_silence() {
    let zeros = |session: &mut Session| {
        for _ in 0..11 {
            session.receive(0, 0);
        }
    };
    let request = of(Signatures::one(1));
    let mut session = Session::new(Model::Pixy, Policy::default());
    session.begin(request, 0);
    zeros(&mut session);
    assert_eq!(session.outcome(), None);
    let deadline = session.deadline().unwrap();
    session.tick(deadline);
    assert_eq!(session.outcome(), Some(Ok(Answer::Blocks)));
    assert_eq!(session.blocks().count(), 0);
    // One with a blob, and zeros behind it.
    session.begin(request, deadline);
    zeros(&mut session);
    for byte in [0].into_iter().chain(picture(&[block(1, 10, None)])) {
        session.receive(byte, deadline);
    }
    zeros(&mut session);
    assert_eq!(session.outcome(), Some(Ok(Answer::Blocks)));
    assert_eq!(
        session.blocks().map(|block| block.x).collect::<Vec<_>>(),
        [10]
    );
    for model in [Model::Pixy, Model::OpenMv, Model::OpenMvTags] {
        for (bytes, fault) in [
            (&[][..], Fault::Silence),
            (&[0x55, 0xAA, 0x55, 0xAA, 1, 2, 3, 4], Fault::Garbled),
        ] {
            let mut session = Session::new(model, Policy::default());
            session.begin(request, 0);
            let mut now = 0;
            while let Some(deadline) = session.deadline() {
                assert!(deadline > now);
                now = deadline;
                for &byte in bytes {
                    session.receive(byte, now - 1);
                }
                session.tick(now);
            }
            assert_eq!(session.outcome(), Some(Err(fault)), "{model:?} {now}");
        }
    }
}

/// A UART that has these bytes, then nothing; every 7th read fails.
#[derive(Clone)]
struct Line(Rc<RefCell<(VecDeque<u8>, u32)>>);

#[derive(Debug, PartialEq)]
struct Overrun;

impl std::fmt::Display for Overrun {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("overrun")
    }
}

impl std::error::Error for Overrun {}

impl embedded_io::Error for Overrun {
    fn kind(&self) -> embedded_io::ErrorKind {
        embedded_io::ErrorKind::Other
    }
}

impl embedded_io::ErrorType for Line {
    type Error = Overrun;
}

impl embedded_io::Read for Line {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Overrun> {
        let (bytes, reads) = &mut *self.0.borrow_mut();
        *reads += 1;
        if reads.is_multiple_of(7) {
            return Err(Overrun);
        }
        let count = bytes.len().min(buffer.len()).min(9);
        for place in &mut buffer[..count] {
            *place = bytes.pop_front().unwrap();
        }
        Ok(count)
    }
}

impl embedded_io::ReadReady for Line {
    fn read_ready(&mut self) -> Result<bool, Overrun> {
        Ok(!self.0.borrow().0.is_empty())
    }
}

impl embedded_io::Write for Line {
    fn write(&mut self, _: &[u8]) -> Result<usize, Overrun> {
        panic!("nothing is asked")
    }

    fn flush(&mut self) -> Result<(), Overrun> {
        Ok(())
    }
}

impl embedded_io_async::Read for Line {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Overrun> {
        if self.0.borrow().0.is_empty() {
            std::future::pending::<()>().await;
        }
        embedded_io::Read::read(self, buffer)
    }
}

impl embedded_io_async::Write for Line {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Overrun> {
        embedded_io::Write::write(self, bytes)
    }

    async fn flush(&mut self) -> Result<(), Overrun> {
        Ok(())
    }
}

struct Delay;

impl embedded_hal::delay::DelayNs for Delay {
    fn delay_ns(&mut self, _: u32) {}
}

impl embedded_hal_async::delay::DelayNs for Delay {
    async fn delay_ns(&mut self, _: u32) {
        embassy_futures::yield_now().await;
    }
}

#[test]
fn a_uart_that_loses_bytes_loses_pictures() {
    let pictures = |count: u16| -> VecDeque<u8> {
        let one = |n| picture(&[block(1, n, None)]);
        (0..count).flat_map(one).collect()
    };
    let one = Signatures::one(1);
    let line = Line(Rc::new(RefCell::new((pictures(100), 0))));
    let mut camera = Pixy::new(Model::Pixy, line.clone(), Delay);
    let mut last = None;
    for n in 0..20 {
        let found = if n % 2 == 0 {
            block_on(async { camera.blocks(one, 2).run().await.map(|mut all| all.next()) })
        } else {
            camera.blocks(one, 2).wait().map(|mut all| all.next())
        };
        let x = found.unwrap().unwrap().x;
        assert!(last.is_none_or(|last| x > last));
        last = Some(x);
    }
    let unable = Err(Error::Camera(Fault::Unable));
    assert_eq!(block_on(camera.request(Request::Version).run()), unable);
    assert_eq!(camera.request(Request::Resolution).wait(), unable);
    line.0.borrow_mut().0.clear();
    let silent = block_on(camera.request(of(one)).run());
    assert!(matches!(
        silent,
        Err(Error::Camera(Fault::Silence | Fault::Garbled))
    ));
}

proptest! {
    /// After any bytes, a whole picture is told, and the next request ends in bounded time.
    #[test]
    fn no_input_breaks_it(chunks in prop::collection::vec((any::<Vec<u8>>(), 0..600_000_u64), 0..20), which in 0..3_usize) {
        let model = [Model::Pixy, Model::OpenMv, Model::OpenMvTags][which];
        let mut session = Session::new(model, Policy::default());
        let request = of(Signatures::one(1));
        session.begin(request, 0);
        let mut now = 0;
        for (bytes, later) in chunks {
            now += later;
            for byte in bytes {
                session.receive(byte, now);
            }
            session.tick(now);
        }
        for _ in 0..10 {
            match session.deadline() {
                Some(deadline) => session.tick(deadline),
                None => break,
            }
        }
        prop_assert!(session.deadline().is_none());
        // What waits for bytes that never came must end first.
        for byte in [7; 20].into_iter().chain(words(&[0xAA55, 0xAA55])) {
            session.receive(byte, now);
        }
        let _ = session.outcome();
        session.begin(request, now);
        for byte in block(1, 77, None).split_off(2).into_iter().chain(words(&[0])) {
            session.receive(byte, now);
        }
        prop_assert_eq!(session.outcome(), Some(Ok(Answer::Blocks)));
        prop_assert!(session.blocks().map(|block| block.x).eq([77]));
    }
}
