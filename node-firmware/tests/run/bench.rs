//! The seams, as a test supplies them, and a site of three nodes.

use std::{
    cell::{Cell, RefCell},
    collections::{BTreeMap, HashSet, VecDeque},
    convert::Infallible,
    future::{Future, poll_fn},
    pin::Pin,
    rc::Rc,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    task::{Context, Poll, Wake},
};

use crate::support::{
    flash::{MockFlash, PowerLoss},
    site::{camera_config, target_config},
};
use calib_core::dead_reckoning::Step;
use embassy_futures::block_on;
use embedded_io_async::{Read, Write};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use node_firmware::{
    config::{Config, CoordinatorConfig, Duty, Role, SiteKey},
    console::{Frames, FromPc, ToPc},
    hardware::{Indication, Indicator, Observer, StepSensor},
    message::{Kind, Message, Sight},
    run::{Layout, Seams, run},
};
use zigbee_link::{
    Instant,
    radio::{Capabilities, Channel, Filter, PSDU_MAX, Radio, Received, TxOutcome},
    runner,
    security::Protection,
    wire::{Eui64, Frame, KeyId, ShortAddress},
};

pub(super) const SECOND: u64 = 1_000_000;

/// Virtual time. Whoever sleeps leaves a note of until when.
#[derive(Clone, Default)]
pub(super) struct Clock(Rc<(Cell<u64>, Cell<u64>)>);

impl Clock {
    /// Whether it is that late. If not, time will not jump over it.
    pub(super) fn reached(&self, time: u64) -> bool {
        let (now, next) = &*self.0;
        if now.get() < time {
            next.set(next.get().min(time));
        }
        now.get() >= time
    }

    pub(super) fn us(&self) -> u64 {
        self.0.0.get()
    }
}

impl runner::Clock for Clock {
    fn now(&self) -> Instant {
        Instant(self.us())
    }

    async fn sleep_until(&self, time: Instant) {
        poll_fn(|_| match self.reached(time.0) {
            true => Poll::Ready(()),
            false => Poll::Pending,
        })
        .await;
    }
}

/// Somebody was woken: there is more to do at the present time.
#[derive(Default)]
pub(super) struct Woken(AtomicBool);

impl Wake for Woken {
    fn wake(self: Arc<Self>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// The nodes under test.
#[derive(Default)]
pub(super) struct Bench {
    pub(super) clock: Clock,
    pub(super) woken: Arc<Woken>,
    pub(super) nodes: Vec<Pin<Box<dyn Future<Output = String>>>>,
}

impl Bench {
    /// Runs all nodes until then. Polling everybody at every wake is slow, and simple.
    pub(super) fn run_until(&mut self, time: u64) {
        let waker = self.woken.clone().into();
        let mut context = Context::from_waker(&waker);
        let (now, next) = &*self.clock.0;
        while now.get() < time {
            let mut rounds = 0;
            loop {
                next.set(time);
                self.woken.0.store(false, Ordering::Relaxed);
                for node in &mut self.nodes {
                    if let Poll::Ready(failure) = node.as_mut().poll(&mut context) {
                        panic!("a node stopped: {failure}");
                    }
                }
                if !self.woken.0.load(Ordering::Relaxed) {
                    break;
                }
                rounds += 1;
                assert!(
                    rounds < 10_000,
                    "they keep each other busy, and time stands"
                );
            }
            now.set(next.get());
        }
    }

    pub(super) fn run_for(&mut self, time: u64) {
        self.run_until(self.clock.us() + time);
    }
}

/// Every radio's frames on their way.
pub(super) type Ether = Rc<RefCell<Vec<VecDeque<(Channel, Vec<u8>)>>>>;

/// Sender, index of the key, and frame counter of every frame: no nonce occurs twice.
pub(super) type Nonces = Rc<RefCell<HashSet<(usize, u8, u32)>>>;

pub(super) struct Antenna {
    ether: Ether,
    nonces: Nonces,
    number: usize,
    channel: Option<Channel>,
    clock: Clock,
    woken: Arc<Woken>,
}

impl Radio for Antenna {
    type Error = Infallible;

    fn capabilities(&self) -> Capabilities {
        Capabilities {
            fcs: true,
            csma: true,
            rx_queue: true,
            ..Capabilities::default()
        }
    }

    async fn configure(&mut self, config: &zigbee_link::radio::Config) -> Result<(), Infallible> {
        self.channel = Some(config.channel);
        Ok(())
    }

    async fn transmit(&mut self, psdu: &[u8]) -> Result<TxOutcome, Infallible> {
        // 250 kbit/s, and six bytes before the frame.
        let airtime = 32 * (psdu.len() as u64 + 6);
        runner::Clock::sleep_until(&self.clock, Instant(self.clock.us() + airtime)).await;
        let channel = self.channel.unwrap();
        if let Some(security) = Frame::parse(psdu).unwrap().header().security {
            let KeyId::Index(key) = security.key else {
                panic!("no such key");
            };
            let nonce = (self.number, key, security.counter.unwrap());
            assert!(self.nonces.borrow_mut().insert(nonce), "{nonce:?} twice");
        }
        for (number, frames) in self.ether.borrow_mut().iter_mut().enumerate() {
            if number != self.number {
                frames.push_back((channel, psdu.to_vec()));
            }
        }
        self.woken.clone().wake();
        Ok(TxOutcome::Sent)
    }

    async fn receive(&mut self, buffer: &mut [u8; PSDU_MAX]) -> Result<Received, Infallible> {
        poll_fn(|_| {
            while let Some((channel, psdu)) = self.ether.borrow_mut()[self.number].pop_front() {
                if Some(channel) == self.channel {
                    buffer[..psdu.len()].copy_from_slice(&psdu);
                    return Poll::Ready(Ok(Received {
                        len: psdu.len(),
                        channel,
                        rssi: None,
                        lqi: None,
                    }));
                }
            }
            Poll::Pending
        })
        .await
    }
}

/// A CMUcam2 that does what it is told and sees what the test says: column, or nothing.
#[derive(Clone)]
pub(super) struct CameraUart {
    pub(super) clock: Clock,
    pub(super) sees: Rc<Cell<Option<u8>>>,
    /// Bytes for the node, each with the time at which it comes.
    pub(super) answer: Rc<RefCell<VecDeque<(u64, u8)>>>,
    pub(super) line: Rc<RefCell<String>>,
    pub(super) heard: Rc<RefCell<Vec<String>>>,
    /// It hears nothing.
    pub(super) unplugged: Rc<Cell<bool>>,
}

impl CameraUart {
    pub(super) fn new(clock: &Clock) -> Self {
        Self {
            clock: clock.clone(),
            sees: Rc::default(),
            answer: Rc::default(),
            line: Rc::default(),
            heard: Rc::default(),
            unplugged: Rc::default(),
        }
    }

    pub(super) fn packet(&self) -> [u8; 8] {
        match self.sees.get() {
            Some(column) => [column, 70, column - 4, 61, column + 4, 79, 60, 200],
            None => [0; 8],
        }
    }

    /// The manual's answers, by the letters of the command.
    pub(super) fn obey(&self, command: &str) {
        if self.unplugged.get() {
            return;
        }
        self.heard.borrow_mut().push(command.to_owned());
        let (after, text) = match command.get(..2) {
            Some("GV") => (1_000, "ACK\rCMUcam2 v1.01 c6\r:".to_owned()),
            Some("RS") => (700_000, "ACK\r\rCMUcam2 v1.01 c6\r:".to_owned()),
            Some("GT") => (1_000, "ACK\r130 190 90 150 40 100\r:".to_owned()),
            Some(kind @ ("TC" | "TW" | "FD")) => {
                let mut packet = self.packet();
                if let ("FD", Some(column)) = (kind, self.sees.get()) {
                    // Of 16 x 16 blocks.
                    packet = [column, 8, column - 1, 7, column + 1, 9, 6, 255];
                }
                let numbers = packet.map(|n| n.to_string()).join(" ");
                (60_000, format!("ACK\rT {numbers}\r:"))
            }
            _ => (1_000, "ACK\r:".to_owned()),
        };
        // 38,400 baud.
        let first = self.clock.us() + after;
        let timed = text.bytes().enumerate();
        let timed = timed.map(|(n, byte)| (first + 260 * n as u64, byte));
        self.answer.borrow_mut().extend(timed);
    }
}

impl embedded_io_async::ErrorType for CameraUart {
    type Error = Infallible;
}

impl Write for CameraUart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        for &byte in bytes {
            if byte == b'\r' {
                let command = self.line.take();
                self.obey(&command);
            } else {
                self.line.borrow_mut().push(byte.into());
            }
        }
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl Read for CameraUart {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        poll_fn(|_| {
            let mut answer = self.answer.borrow_mut();
            match answer.front().copied() {
                Some((at, byte)) if self.clock.reached(at) => {
                    answer.pop_front();
                    buffer[0] = byte;
                    Poll::Ready(Ok(1))
                }
                _ => Poll::Pending,
            }
        })
        .await
    }
}

/// A PC, which writes and notes what it is told.
#[derive(Clone, Default)]
pub(super) struct PcUart {
    pub(super) wishes: Rc<RefCell<VecDeque<u8>>>,
    pub(super) frames: Rc<RefCell<Frames>>,
    pub(super) told: Rc<RefCell<Vec<ToPc>>>,
    /// It takes nothing.
    pub(super) stalled: Rc<Cell<bool>>,
}

impl PcUart {
    pub(super) fn wish(&self, wish: FromPc) {
        let mut buffer = [0; 64];
        let frame = postcard::to_slice_cobs(&wish, &mut buffer).unwrap();
        self.wishes.borrow_mut().extend(frame.iter());
    }
}

impl embedded_io_async::ErrorType for PcUart {
    type Error = Infallible;
}

impl Write for PcUart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        if self.stalled.get() {
            std::future::pending::<()>().await;
        }
        for &byte in bytes {
            let message: Option<ToPc> = self.frames.borrow_mut().push(byte);
            self.told.borrow_mut().extend(message);
        }
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl Read for PcUart {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        poll_fn(|_| {
            let mut wishes = self.wishes.borrow_mut();
            let count = wishes.len().min(buffer.len());
            if count == 0 {
                return Poll::Pending;
            }
            for place in &mut buffer[..count] {
                *place = wishes.pop_front().unwrap();
            }
            Poll::Ready(Ok(count))
        })
        .await
    }
}

/// A target's UART: none.
pub(super) struct NoUart;

impl embedded_io_async::ErrorType for NoUart {
    type Error = Infallible;
}

impl Write for NoUart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl Read for NoUart {
    async fn read(&mut self, _: &mut [u8]) -> Result<usize, Infallible> {
        std::future::pending().await
    }
}

/// A flash that outlives its node: 8 KiB for the link, 8 KiB for the role. And after how many more
/// reads one fails.
#[derive(Clone)]
pub(super) struct Flash(
    pub(super) Rc<RefCell<MockFlash<64>>>,
    pub(super) Rc<Cell<u32>>,
);

impl Flash {
    pub(super) fn new(chip: MockFlash<64>) -> Self {
        Self(Rc::new(RefCell::new(chip)), Rc::new(Cell::new(u32::MAX)))
    }

    /// Another one, with the same in it.
    pub(super) fn copy(&self) -> Self {
        Self::new(self.0.borrow().clone())
    }

    /// The bytes of the link's half.
    pub(super) fn pages(&self) -> Vec<u8> {
        self.0.borrow().bytes[..HALF as usize].to_vec()
    }
}

pub(super) const HALF: u32 = MockFlash::<64>::LEN / 2;

impl ErrorType for Flash {
    type Error = PowerLoss;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = MockFlash::<64>::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), PowerLoss> {
        self.1.set(self.1.get().wrapping_sub(1));
        match self.1.get() {
            0 => Err(PowerLoss),
            _ => block_on(self.0.borrow_mut().read(offset, bytes)),
        }
    }

    fn capacity(&self) -> usize {
        self.0.borrow().capacity()
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = MockFlash::<64>::WRITE_SIZE;
    const ERASE_SIZE: usize = MockFlash::<64>::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), PowerLoss> {
        block_on(self.0.borrow_mut().erase(from, to))
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), PowerLoss> {
        block_on(self.0.borrow_mut().write(offset, bytes))
    }
}

/// Steps, as the test wants them.
#[derive(Clone, Default)]
pub(super) struct Steps(pub(super) Rc<RefCell<VecDeque<Step<f32>>>>);

impl StepSensor for Steps {
    type Error = Infallible;

    async fn next(&mut self) -> Result<Step<f32>, Infallible> {
        poll_fn(|_| match self.0.borrow_mut().pop_front() {
            Some(step) => Poll::Ready(Ok(step)),
            None => Poll::Pending,
        })
        .await
    }
}

#[derive(Clone, Default)]
pub(super) struct Lamps(pub(super) Rc<Cell<Indication>>);

impl Indicator for Lamps {
    fn show(&mut self, indication: Indication) {
        self.0.set(indication);
    }
}

/// What a node sent.
#[derive(Clone, Default)]
pub(super) struct Log(pub(super) Rc<RefCell<Vec<Message>>>);

impl Observer for Log {
    fn sends(&mut self, _: ShortAddress, message: &Message) {
        self.0.borrow_mut().push(message.clone());
    }
}

/// A node without its firmware.
pub(super) struct Board<U> {
    pub(super) config: Config,
    pub(super) number: usize,
    pub(super) uart: U,
    pub(super) ether: Ether,
    pub(super) nonces: Nonces,
    pub(super) flash: Flash,
    pub(super) steps: Steps,
    pub(super) lamps: Lamps,
    pub(super) log: Log,
}

impl<U: Read + Write + Clone + 'static> Board<U> {
    pub(super) fn new(ether: &Ether, uart: U, role: Role) -> Self {
        let number = ether.borrow().len();
        ether.borrow_mut().push(VecDeque::new());
        let config = Config {
            id: 100 + number as u16,
            extended: Some([2, 0, 0, 0, 0, 0, 0, number as u8]),
            site_key: SiteKey::new(1, *b"0123456789abcdef"),
            first_counter: 1,
            channels: 1 << 15,
            tx_power: 0,
            protection: Protection::EncMic32,
            role,
        };
        config.check().unwrap();
        Self {
            config,
            number,
            uart,
            ether: ether.clone(),
            nonces: Nonces::default(),
            flash: Flash::new(MockFlash::new(number as u64)),
            steps: Steps::default(),
            lamps: Lamps::default(),
            log: Log::default(),
        }
    }

    /// The firmware from its start, with what is in the flash.
    pub(super) fn power(&self, bench: &Bench, seed: u64) -> Pin<Box<dyn Future<Output = String>>> {
        let antenna = Antenna {
            ether: self.ether.clone(),
            nonces: self.nonces.clone(),
            number: self.number,
            channel: None,
            clock: bench.clock.clone(),
            woken: bench.woken.clone(),
        };
        let seams = Seams {
            uart: self.uart.clone(),
            radio: Filter::new(antenna),
            clock: bench.clock.clone(),
            flash: self.flash.clone(),
            layout: Layout {
                link: 0..HALF,
                memory: HALF..2 * HALF,
            },
            steps: self.steps.clone(),
            indicator: self.lamps.clone(),
            buttons: (),
            observer: self.log.clone(),
            extended: Eui64([0; 8]),
            seed,
        };
        let config = self.config.clone();
        Box::pin(async move { run(&config, seams).await.to_string() })
    }
}

impl Clone for NoUart {
    fn clone(&self) -> Self {
        Self
    }
}

/// A coordinator with a PC, a camera with a CMUcam2, and a target.
pub(super) struct Site {
    pub(super) bench: Bench,
    pub(super) coordinator: Board<PcUart>,
    pub(super) camera: Board<CameraUart>,
    pub(super) target: Board<NoUart>,
}

impl Site {
    pub(super) fn new() -> Self {
        let mut bench = Bench::default();
        let ether = Ether::default();
        let coordinator = Role::Coordinator(CoordinatorConfig {
            join_window_s: 60,
            ..CoordinatorConfig::default()
        });
        let coordinator = Board::new(&ether, PcUart::default(), coordinator);
        let camera = Role::Camera(camera_config(Some(Duty::First)));
        let camera = Board::new(&ether, CameraUart::new(&bench.clock), camera);
        let target = Board::new(&ether, NoUart, Role::Target(target_config(0)));
        bench.nodes = vec![
            coordinator.power(&bench, 1),
            camera.power(&bench, 2),
            target.power(&bench, 3),
        ];
        Self {
            bench,
            coordinator,
            camera,
            target,
        }
    }

    /// Switches all off and on again, with the pages they have by then.
    pub(super) fn restart(&mut self, seed: u64) {
        self.coordinator.uart.told.borrow_mut().clear();
        for lamps in [
            &self.coordinator.lamps,
            &self.camera.lamps,
            &self.target.lamps,
        ] {
            lamps.0.take();
        }
        self.bench.nodes = vec![
            self.coordinator.power(&self.bench, seed),
            self.camera.power(&self.bench, seed + 1),
            self.target.power(&self.bench, seed + 2),
        ];
    }

    pub(super) fn configs(&mut self) -> [&mut Config; 3] {
        [
            &mut self.coordinator.config,
            &mut self.camera.config,
            &mut self.target.config,
        ]
    }

    /// What members said they are, by number.
    pub(super) fn hellos(&self) -> BTreeMap<u16, Kind> {
        let hellos = self.told().into_iter().filter_map(|told| match told {
            ToPc::Member { hello, .. } => Some((hello.id, hello.kind)),
            _ => None,
        });
        hellos.collect()
    }

    pub(super) fn told(&self) -> Vec<ToPc> {
        self.coordinator.uart.told.borrow().clone()
    }

    /// What the camera answered to stops.
    pub(super) fn looks(&self) -> Vec<Sight> {
        let log = self.camera.log.0.borrow();
        let looks = log.iter().filter_map(|message| match message {
            Message::Look(look) => Some(look.sight),
            _ => None,
        });
        looks.collect()
    }
}
