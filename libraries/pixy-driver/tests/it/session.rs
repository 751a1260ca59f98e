//! The dialogue with an independent camera: it writes its answers from the tables of the maker's documentation,
//! and shares nothing with the driver.

use std::{cell::RefCell, collections::VecDeque, convert::Infallible, rc::Rc};

use embassy_futures::block_on;
use pixy_driver::{
    Block, Error, Model, Pixy, i2c,
    packet::{Request, Signatures},
    session::{Answer, Fault, Policy, Session, Version},
};
use proptest::prelude::*;

/// Faults of the camera, and the blobs that it sees.
#[derive(Default)]
struct Camera {
    request: Vec<u8>,
    answers: VecDeque<u8>,
    /// Number of times that it says that it is busy.
    busy: u32,
    /// Number of times that its answer is damaged.
    damaged: u32,
    /// Number of times that it does not hear.
    deaf: u32,
    /// It answers with this error.
    error: i8,
    /// So often.
    errors: u32,
    /// So often a bit of what asks for blocks is damaged: signature 1 becomes signature 2.
    other: u32,
    /// Answer that comes late, before the answer to the next request.
    late: Vec<u8>,
    /// Blocks as bytes.
    blocks: Vec<u8>,
    heard: u32,
}

const BUSY: i8 = -2;

impl Camera {
    fn answer(&mut self, kind: u8, payload: &[u8]) {
        let sum: u16 = payload.iter().map(|&byte| u16::from(byte)).sum();
        let [low, high] = sum.to_le_bytes();
        let mut packet = vec![0xAF, 0xC1, kind, payload.len() as u8, low, high];
        packet.extend(payload);
        if self.damaged > 0 {
            self.damaged -= 1;
            *packet.last_mut().unwrap() ^= 0x10;
        }
        self.answers.extend(packet);
    }

    fn hear(&mut self, byte: u8) {
        self.request.push(byte);
        if self.request.len() < 6 || self.request.len() < 6 + usize::from(self.request[3]) {
            return;
        }
        let mut request = std::mem::take(&mut self.request);
        assert_eq!(request[..2], [0xAF, 0xC1]);
        self.heard += 1;
        let late = std::mem::take(&mut self.late);
        self.answers.extend(late);
        if request[2] == 0x20 && self.other > 0 {
            self.other -= 1;
            request[6] ^= 3;
        }
        let sum: u16 = request[6..].iter().map(|&byte| u16::from(byte)).sum();
        if request[4..6] != sum.to_le_bytes() {
            return;
        }
        if self.deaf > 0 {
            self.deaf -= 1;
            return;
        }
        if self.errors > 0 {
            self.errors -= 1;
            return self.answer(3, &[self.error as u8]);
        }
        if self.busy > 0 {
            self.busy -= 1;
            return self.answer(3, &[BUSY as u8]);
        }
        match request[2] {
            0x0E => self.answer(0x0F, b"\x00\x22\x03\x00\x0c\x00general\0\0\0"),
            0x0C => self.answer(0x0D, &[0x3C, 0x01, 0xD0, 0x00]),
            0x20 => {
                let most = usize::from(request[7]).min(self.blocks.len() / 14);
                let blocks = self.blocks[..14 * most].to_vec();
                self.answer(0x21, &blocks);
            }
            0x18 => self.answer(1, &60_i32.to_le_bytes()),
            _ => self.answer(1, &[0; 4]),
        }
    }
}

/// The line to it.
#[derive(Clone, Default)]
struct Line(Rc<RefCell<Camera>>);

impl embedded_io::ErrorType for Line {
    type Error = Infallible;
}

impl embedded_io::Read for Line {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        let mut camera = self.0.borrow_mut();
        // In small pieces.
        let count = camera.answers.len().min(buffer.len()).min(5);
        for place in &mut buffer[..count] {
            *place = camera.answers.pop_front().unwrap();
        }
        Ok(count)
    }
}

impl embedded_io::ReadReady for Line {
    fn read_ready(&mut self) -> Result<bool, Infallible> {
        Ok(!self.0.borrow().answers.is_empty())
    }
}

impl embedded_io::Write for Line {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        self.0.borrow_mut().hear(bytes[0]);
        Ok(1)
    }

    fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl embedded_io_async::Read for Line {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        if self.0.borrow().answers.is_empty() {
            std::future::pending::<()>().await;
        }
        embedded_io::Read::read(self, buffer)
    }
}

impl embedded_io_async::Write for Line {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        embedded_io::Write::write(self, bytes)
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// No time passes but in the driver's own count. Async, it gives way to the line once.
struct Delay;

impl embedded_hal::delay::DelayNs for Delay {
    fn delay_ns(&mut self, _: u32) {}
}

impl embedded_hal_async::delay::DelayNs for Delay {
    async fn delay_ns(&mut self, _: u32) {
        embassy_futures::yield_now().await;
    }
}

fn camera() -> (Pixy<Line, Delay>, Line) {
    let line = Line::default();
    (Pixy::new(Model::Pixy2, line.clone(), Delay), line)
}

const BALL: [u8; 14] = [1, 0, 0x2C, 0x01, 100, 0, 21, 0, 20, 0, 0, 0, 7, 255];

#[test]
fn what_a_node_asks() {
    let (mut camera, line) = camera();
    line.0.borrow_mut().busy = 900;
    let version = Version {
        hardware: 0x2200,
        major: 3,
        minor: 0,
        build: 12,
    };
    // It starts for 1.8 s.
    assert_eq!(camera.version().wait(), Ok(version));
    assert_eq!(block_on(camera.version().run()), Ok(version));
    assert_eq!(block_on(camera.resolution().run()), Ok((316, 208)));
    line.0.borrow_mut().blocks = [BALL, BALL].concat();
    let blocks: Vec<Block> = camera
        .blocks(Signatures::one(1), 1)
        .wait()
        .unwrap()
        .collect();
    let ball = Block {
        signature: 1,
        x: 300,
        y: 100,
        width: 21,
        height: 20,
        angle: 0,
        index: 7,
        age: 255,
    };
    assert_eq!(blocks, [ball]);
    assert_eq!((ball.left(), ball.top()), (290, 90));
    let count = block_on(async {
        camera
            .blocks(Signatures::ALL, 9)
            .run()
            .await
            .unwrap()
            .count()
    });
    assert_eq!(count, 2);
    line.0.borrow_mut().blocks.clear();
    assert_eq!(camera.blocks(Signatures::ALL, 9).wait().unwrap().count(), 0);
    assert_eq!(
        camera.request(Request::FramesPerSecond).wait(),
        Ok(Answer::Result(60))
    );
}

#[test]
fn what_goes_wrong_is_repeated_or_told() {
    for (deaf, damaged, outcome) in [
        (3, 0, Ok((316, 208))),
        (4, 0, Err(Error::Camera(Fault::Silence))),
        (0, 3, Ok((316, 208))),
        (0, 4, Err(Error::Camera(Fault::Garbled))),
    ] {
        let (mut camera, line) = camera();
        line.0.borrow_mut().deaf = deaf;
        line.0.borrow_mut().damaged = damaged;
        assert_eq!(camera.resolution().wait(), outcome, "{deaf} {damaged}");
        assert_eq!(line.0.borrow().heard, 4);
    }
    // What is refused may be what the line has made of the request.
    for (errors, outcome) in [(3, Ok(0)), (4, Err(Error::Camera(Fault::Refused(-4))))] {
        let (mut camera, line) = camera();
        line.0.borrow_mut().error = -4;
        line.0.borrow_mut().errors = errors;
        let blocks = camera
            .blocks(Signatures::ALL, 1)
            .wait()
            .map(Iterator::count);
        assert_eq!(blocks, outcome);
        assert_eq!(line.0.borrow().heard, 4);
    }
    let (mut camera, line) = camera();
    line.0.borrow_mut().error = BUSY;
    line.0.borrow_mut().errors = u32::MAX;
    assert_eq!(
        block_on(camera.version().run()),
        Err(Error::Camera(Fault::Busy))
    );
    // The late answer to another request is not taken for this one's.
    line.0.borrow_mut().errors = 0;
    line.0.borrow_mut().answer(0x0F, &[9; 16]);
    assert_eq!(camera.resolution().wait(), Ok((316, 208)));
}

/// Blobs of other signatures are not those that were asked for, whichever way they come.
#[test]
fn blocks_are_those_of_the_signature_that_is_asked_for() {
    let mut other = BALL;
    other[0] = 2;
    let mut code = BALL;
    code[0] = 0o12;
    let (mut camera, line) = camera();
    line.0.borrow_mut().blocks = BALL.to_vec();
    // Requests that the line has made others of are not obeyed.
    line.0.borrow_mut().other = 3;
    let one = Signatures::one(1);
    assert_eq!(camera.blocks(one, 2).wait().map(Iterator::count), Ok(1));
    assert_eq!(line.0.borrow().heard, 4);
    // The late answer to another request for blocks: of another signature, or of more.
    for late in [vec![other], vec![code], vec![BALL; 3]] {
        let mut camera_behind = line.0.borrow_mut();
        camera_behind.answer(0x21, &late.concat());
        camera_behind.late = camera_behind.answers.drain(..).collect();
        drop(camera_behind);
        let blocks = camera.blocks(one, 2).wait().unwrap();
        assert!(blocks.map(|block| block.signature).eq([1]));
        line.0.borrow_mut().answers.clear();
    }
    line.0.borrow_mut().blocks = [other, code].concat();
    assert_eq!(
        camera
            .blocks(Signatures::ALL, 2)
            .wait()
            .map(Iterator::count),
        Ok(2)
    );
    let never = camera.blocks(one, 2).wait().map(Iterator::count);
    assert_eq!(never, Err(Error::Camera(Fault::Garbled)));
}

/// A bus with the same camera: it gives zeros where it has nothing to say, and is not acknowledged while it is off.
struct Bus(Line, bool);

impl embedded_hal::i2c::ErrorType for Bus {
    type Error = embedded_hal::i2c::ErrorKind;
}

impl embedded_hal::i2c::I2c for Bus {
    fn transaction(
        &mut self,
        address: u8,
        operations: &mut [embedded_hal::i2c::Operation<'_>],
    ) -> Result<(), Self::Error> {
        use embedded_hal::i2c::{ErrorKind, NoAcknowledgeSource, Operation};
        if address != i2c::ADDRESS || !self.1 {
            return Err(ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address));
        }
        let mut camera = self.0.0.borrow_mut();
        for operation in operations {
            match operation {
                Operation::Write(bytes) => bytes.iter().for_each(|&byte| camera.hear(byte)),
                Operation::Read(buffer) => {
                    for place in buffer.iter_mut() {
                        *place = camera.answers.pop_front().unwrap_or(0);
                    }
                }
            }
        }
        Ok(())
    }
}

impl embedded_hal_async::i2c::I2c for Bus {
    async fn transaction(
        &mut self,
        address: u8,
        operations: &mut [embedded_hal::i2c::Operation<'_>],
    ) -> Result<(), Self::Error> {
        embedded_hal::i2c::I2c::transaction(self, address, operations)
    }
}

/// A bus that is disturbed once, at any of its transfers, fails the call at once, and the next one succeeds. Of that
/// the maker's library for Arduino hung (`charmedlabs/pixy2`, pull request 32).
#[test]
fn a_bus_that_is_disturbed_fails_one_call() {
    struct Disturbed(Bus, u32);
    impl embedded_hal::i2c::ErrorType for Disturbed {
        type Error = embedded_hal::i2c::ErrorKind;
    }
    impl embedded_hal::i2c::I2c for Disturbed {
        fn transaction(
            &mut self,
            address: u8,
            operations: &mut [embedded_hal::i2c::Operation<'_>],
        ) -> Result<(), Self::Error> {
            self.1 = self.1.wrapping_sub(1);
            if self.1 == 0 {
                return Err(embedded_hal::i2c::ErrorKind::ArbitrationLoss);
            }
            self.0.transaction(address, operations)
        }
    }
    let line = Line::default();
    line.0.borrow_mut().blocks = BALL.to_vec();
    let mut failed = 0;
    for at in 1..=6 {
        let bus = i2c::I2cLine::new(Disturbed(Bus(line.clone(), true), at), i2c::ADDRESS);
        let mut camera = Pixy::new(Model::Pixy2, bus, Delay);
        for call in 0..4 {
            let blocks = camera
                .blocks(Signatures::one(1), 2)
                .wait()
                .map(Iterator::count);
            match blocks {
                Err(Error::Uart(_)) => failed += 1,
                other => assert_eq!(other, Ok(1), "disturbed at {at}, call {call}"),
            }
        }
    }
    assert_eq!(failed, 6);
}

#[test]
fn the_same_camera_on_a_bus() {
    let line = Line::default();
    let camera = |address, is_on| {
        let bus = i2c::I2cLine::new(Bus(line.clone(), is_on), address);
        Pixy::new(Model::Pixy2, bus, Delay)
    };
    let mut on_bus = camera(i2c::ADDRESS, true);
    line.0.borrow_mut().blocks = [BALL, BALL].concat();
    line.0.borrow_mut().busy = 3;
    line.0.borrow_mut().damaged = 1;
    assert_eq!(on_bus.resolution().wait(), Ok((316, 208)));
    assert_eq!(block_on(on_bus.resolution().run()), Ok((316, 208)));
    let one = Signatures::one(1);
    assert_eq!(on_bus.blocks(one, 2).wait().map(Iterator::count), Ok(2));
    let found = block_on(async { on_bus.blocks(one, 2).run().await.map(Iterator::count) });
    assert_eq!(found, Ok(2));
    // A camera that says nothing is silent, and one that is off is told by the bus.
    line.0.borrow_mut().deaf = u32::MAX;
    let silent = Err(Error::Camera(Fault::Silence));
    assert_eq!(on_bus.resolution().wait(), silent);
    assert_eq!(block_on(on_bus.resolution().run()), silent);
    for mut off in [camera(i2c::ADDRESS, false), camera(0x55, true)] {
        let outcomes = [off.resolution().wait(), block_on(off.resolution().run())];
        for outcome in outcomes {
            let Err(Error::Uart(error)) = outcome else {
                panic!("{outcome:?}")
            };
            let kind = embedded_io::Error::kind(&error);
            assert_eq!(kind, embedded_io::ErrorKind::NotConnected);
        }
    }
}

proptest! {
    /// After any bytes, every request ends in bounded time, and the next one is answered.
    #[test]
    fn no_input_breaks_it(chunks in prop::collection::vec((any::<Vec<u8>>(), 0..60_000_u64), 0..40)) {
        let mut session = Session::new(Model::Pixy2, Policy::default());
        session.begin(Request::Blocks { of: Signatures::ALL, most: 4 }, 0);
        let mut now = 0;
        for (bytes, later) in chunks {
            now += later;
            session.sent(usize::MAX);
            for byte in bytes {
                session.receive(byte, now);
            }
            session.tick(now);
        }
        for _ in 0..10_000 {
            match session.deadline() {
                Some(deadline) => session.tick(deadline),
                None => break,
            }
        }
        prop_assert!(session.deadline().is_none());
        let _ = session.outcome();
        session.begin(Request::Resolution, now);
        session.sent(5);
        for byte in [0xAF, 0xC1, 0x0D, 4, 10, 0, 1, 2, 3, 4] {
            session.receive(byte, now);
        }
        prop_assert_eq!(session.outcome(), Some(Ok(Answer::Resolution(0x201, 0x403))));
    }
}
