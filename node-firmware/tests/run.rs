//! Whole nodes on the host: the firmware as a board runs it, over seams that a test supplies.
//!
//! This is also how to test firmware of your own. What a test needs is
//! - a clock that moves only when every node waits: [`Clock`] and [`Bench::run_until`]. Hours pass in
//!   milliseconds, and the same test always does the same;
//! - a UART with somebody on its end: [`CameraUart`] answers as a CMUcam2 does, [`PcUart`] is a PC;
//! - a radio: [`Antenna`] hands frames to all others;
//! - flash, steps and lamps: a few lines each.

mod support;

use std::{
    cell::{Cell, RefCell},
    collections::VecDeque,
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

use calib_core::dead_reckoning::Step;
use embassy_futures::block_on;
use embedded_io_async::{Read, Write};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use node_firmware::{
    config::{Config, CoordinatorConfig, Duty, Role, SiteKey},
    console::{Frames, FromPc, ToPc},
    hardware::{Indication, Indicator, Observer, StepSensor},
    message::{Command, Done, Message, Sight, Tracked},
    run::{Layout, Seams, run},
};
use support::{
    flash::{MockFlash, PowerLoss},
    site::{camera_config, target_config},
};
use zigbee_link::{
    Instant,
    radio::{Capabilities, Channel, Filter, PSDU_MAX, Radio, Received, TxOutcome},
    runner,
    security::Protection,
    wire::{Eui64, ShortAddress},
};

const SECOND: u64 = 1_000_000;

/// Virtual time. Whoever sleeps leaves a note of until when.
#[derive(Clone, Default)]
struct Clock(Rc<(Cell<u64>, Cell<u64>)>);

impl Clock {
    /// Whether it is that late. If not, time will not jump over it.
    fn reached(&self, time: u64) -> bool {
        let (now, next) = &*self.0;
        if now.get() < time {
            next.set(next.get().min(time));
        }
        now.get() >= time
    }

    fn us(&self) -> u64 {
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
struct Woken(AtomicBool);

impl Wake for Woken {
    fn wake(self: Arc<Self>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// The nodes under test.
#[derive(Default)]
struct Bench {
    clock: Clock,
    woken: Arc<Woken>,
    nodes: Vec<Pin<Box<dyn Future<Output = String>>>>,
}

impl Bench {
    /// Runs all nodes until then. Polling everybody at every wake is slow, and simple.
    fn run_until(&mut self, time: u64) {
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

    fn run_for(&mut self, time: u64) {
        self.run_until(self.clock.us() + time);
    }
}

/// Every radio's frames on their way.
type Ether = Rc<RefCell<Vec<VecDeque<(Channel, Vec<u8>)>>>>;

struct Antenna {
    ether: Ether,
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
struct CameraUart {
    clock: Clock,
    sees: Rc<Cell<Option<u8>>>,
    /// Bytes for the node, each with the time at which it comes.
    answer: Rc<RefCell<VecDeque<(u64, u8)>>>,
    line: Rc<RefCell<String>>,
    heard: Rc<RefCell<Vec<String>>>,
}

impl CameraUart {
    fn new(clock: &Clock) -> Self {
        Self {
            clock: clock.clone(),
            sees: Rc::default(),
            answer: Rc::default(),
            line: Rc::default(),
            heard: Rc::default(),
        }
    }

    fn packet(&self) -> [u8; 8] {
        match self.sees.get() {
            Some(column) => [column, 70, column - 4, 61, column + 4, 79, 60, 200],
            None => [0; 8],
        }
    }

    /// The manual's answers, by the letters of the command.
    fn obey(&self, command: &str) {
        self.heard.borrow_mut().push(command.to_owned());
        let (after, text) = match command.get(..2) {
            Some("GV") => (1_000, "ACK\rCMUcam2 v1.01 c6\r:".to_owned()),
            Some("RS") => (700_000, "ACK\r\rCMUcam2 v1.01 c6\r:".to_owned()),
            Some("TC") => {
                let numbers = self.packet().map(|n| n.to_string()).join(" ");
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
struct PcUart {
    wishes: Rc<RefCell<VecDeque<u8>>>,
    frames: Rc<RefCell<Frames>>,
    told: Rc<RefCell<Vec<ToPc>>>,
}

impl PcUart {
    fn wish(&self, wish: FromPc) {
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
struct NoUart;

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

/// A flash that outlives its node: 8 KiB for the link, 8 KiB for the role.
#[derive(Clone)]
struct Flash(Rc<RefCell<MockFlash<64>>>);

const HALF: u32 = MockFlash::<64>::LEN / 2;

impl ErrorType for Flash {
    type Error = PowerLoss;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = MockFlash::<64>::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), PowerLoss> {
        block_on(self.0.borrow_mut().read(offset, bytes))
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
struct Steps(Rc<RefCell<VecDeque<Step<f32>>>>);

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
struct Lamps(Rc<Cell<Indication>>);

impl Indicator for Lamps {
    fn show(&mut self, indication: Indication) {
        self.0.set(indication);
    }
}

/// What a node sent.
#[derive(Clone, Default)]
struct Log(Rc<RefCell<Vec<Message>>>);

impl Observer for Log {
    fn sends(&mut self, _: ShortAddress, message: &Message) {
        self.0.borrow_mut().push(message.clone());
    }
}

/// A node without its firmware.
struct Board<U> {
    config: Config,
    number: usize,
    uart: U,
    ether: Ether,
    flash: Flash,
    steps: Steps,
    lamps: Lamps,
    log: Log,
}

impl<U: Read + Write + Clone + 'static> Board<U> {
    fn new(ether: &Ether, uart: U, role: Role) -> Self {
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
            flash: Flash(Rc::new(RefCell::new(MockFlash::new(number as u64)))),
            steps: Steps::default(),
            lamps: Lamps::default(),
            log: Log::default(),
        }
    }

    /// The firmware from its start, with what is in the flash.
    fn power(&self, bench: &Bench, seed: u64) -> Pin<Box<dyn Future<Output = String>>> {
        let antenna = Antenna {
            ether: self.ether.clone(),
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
struct Site {
    bench: Bench,
    coordinator: Board<PcUart>,
    camera: Board<CameraUart>,
    target: Board<NoUart>,
}

impl Site {
    fn new() -> Self {
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

    fn told(&self) -> Vec<ToPc> {
        self.coordinator.uart.told.borrow().clone()
    }

    /// What the camera answered to stops.
    fn looks(&self) -> Vec<Sight> {
        let log = self.camera.log.0.borrow();
        let looks = log.iter().filter_map(|message| match message {
            Message::Look(look) => Some(look.sight),
            _ => None,
        });
        looks.collect()
    }
}

#[test]
fn they_join_and_look() {
    let mut site = Site::new();
    site.camera.uart.sees.set(Some(40));
    site.bench.run_for(40 * SECOND);
    assert!(site.coordinator.lamps.0.get().joined);
    assert!(site.camera.lamps.0.get().joined);
    assert!(site.target.lamps.0.get().joined);
    let members = site.told().into_iter().filter_map(|message| match message {
        ToPc::Member { hello, .. } => Some(hello.id),
        _ => None,
    });
    let mut members: Vec<u16> = members.collect();
    members.sort_unstable();
    members.dedup();
    assert_eq!(members, [101, 102]);

    // It stood since it was switched on.
    assert_eq!(site.looks().last(), Some(&Sight::InView));
    assert!(site.target.lamps.0.get().may_walk);
    assert!(site.target.lamps.0.get().target_seen);
    assert!(site.camera.lamps.0.get().target_seen);

    // It goes where the camera does not see it.
    site.camera.uart.sees.set(None);
    site.target.steps.0.borrow_mut().push_back(Step {
        distance: 1.0,
        heading: 0.5,
        distance_sigma: 0.01,
        heading_sigma: 0.01,
    });
    site.bench.run_for(SECOND);
    assert!(!site.target.lamps.0.get().may_walk);
    site.bench.run_for(20 * SECOND);
    assert_eq!(site.looks().last(), Some(&Sight::NotInView));
    assert!(site.target.lamps.0.get().may_walk);
    let heard = site.camera.uart.heard.borrow();
    assert!(heard.contains(&"ST 170 240 60 140 16 80".to_owned()));
}

#[test]
fn the_pc_commands_a_camera() {
    let mut site = Site::new();
    site.camera.uart.sees.set(Some(40));
    site.bench.run_for(40 * SECOND);
    let address = site.told().into_iter().find_map(|message| match message {
        ToPc::Member { address, hello } if hello.id == 101 => Some(address),
        _ => None,
    });
    let address = address.unwrap();
    let command = Command::Track { colour: 0 };
    site.coordinator
        .uart
        .wish(FromPc::Command { address, command });
    site.bench.run_for(5 * SECOND);
    let done = Done {
        command,
        success: true,
    };
    assert!(site.told().contains(&ToPc::Done { address, done }));
    let tracked = Tracked {
        middle: [40, 70],
        edges: [36, 61, 44, 79],
        pixels: 60,
        confidence: 200,
    };
    let packet = ToPc::Tracked { address, tracked };
    assert!(site.told().iter().filter(|told| **told == packet).count() > 20);

    // A colour that would leave a gap is not learnt.
    let command = Command::LearnColour { colour: 3 };
    site.coordinator
        .uart
        .wish(FromPc::Command { address, command });
    site.bench.run_for(20 * SECOND);
    let done = Done {
        command,
        success: false,
    };
    assert!(site.told().contains(&ToPc::Done { address, done }));
    let before = site.told().len();
    site.bench.run_for(20 * SECOND);
    assert_eq!(site.told().len(), before, "no more packets");
}

/// Both the coordinator and its line have more to say than the other takes at a time.
#[test]
fn a_pc_that_writes_much_does_not_stop_the_coordinator() {
    let mut site = Site::new();
    site.bench.run_for(30 * SECOND);
    for _ in 0..100 {
        site.coordinator.uart.wish(FromPc::Refresh);
    }
    site.bench.run_for(10 * SECOND);
    site.coordinator.uart.told.borrow_mut().clear();
    site.coordinator.uart.wish(FromPc::Refresh);
    site.bench.run_for(SECOND);
    let told = site.told();
    assert!(matches!(told.first(), Some(ToPc::Network(Some(_)))));
    let members = told
        .iter()
        .filter(|told| matches!(told, ToPc::Member { .. }));
    assert_eq!(members.count(), 2);
}

/// Each loses its power once; the join window is closed by then.
#[test]
fn they_come_back_after_a_restart() {
    let mut site = Site::new();
    site.camera.uart.sees.set(Some(40));
    site.bench.run_for(100 * SECOND);
    for number in 0..3 {
        site.camera.lamps.0.take();
        site.target.lamps.0.take();
        let node = match number {
            0 => site.coordinator.power(&site.bench, 11),
            1 => site.camera.power(&site.bench, 12),
            _ => site.target.power(&site.bench, 13),
        };
        site.bench.nodes[number] = node;
        site.bench.run_for(30 * SECOND);
    }
    site.camera.log.0.borrow_mut().clear();
    site.target.steps.0.borrow_mut().push_back(Step {
        distance: 1.0,
        heading: 0.5,
        distance_sigma: 0.01,
        heading_sigma: 0.01,
    });
    site.bench.run_for(30 * SECOND);
    assert_eq!(site.looks().last(), Some(&Sight::InView));
    assert!(site.target.lamps.0.get().may_walk);
}
