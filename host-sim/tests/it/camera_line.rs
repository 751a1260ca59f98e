//! The driver of the camera against its emulator, on a line.

use std::{
    cell::{Cell, RefCell},
    rc::Rc,
};

use embedded_io_async::Read;

use cmucam2_driver::{colour::ColourBounds, device::Cmucam2, packet::Tracking, session::StartUp};
use cmucam2_emulator::{Configuration, Emulator, Extent, FaultRates, Place, Scene, Shape};
use virtual_hardware::{
    executor::{Clock, Ended, Executor, TaskId, Time},
    line::{Line, Side, Uart},
};

use node_test::CameraDevice;

const MILLISECOND: Time = 1_000_000;
const SECOND: Time = 1_000_000_000;

const BAUD: u32 = 38_400;

fn ball(x: f64) -> Extent {
    Extent::centred(x, 0.5, 0.1, 0.1)
}

/// A camera on a line, before which a ball moves to the right in 20 s.
fn line(clock: &Clock, faults: FaultRates, seed: u64) -> Line {
    let configuration = Configuration {
        baud: BAUD,
        host_baud: BAUD,
        faults,
        seed,
        ..Configuration::default()
    };
    let scene = Scene::with_object([220, 110, 40], Shape::Disc, ball(0.2));
    let camera = Emulator::new(configuration, scene);
    let device = CameraDevice::new(camera, |at: Time, scene| {
        let x = 0.2 + 0.6 * (at as f64 / SECOND as f64 - 10.0).clamp(0.0, 20.0) / 20.0;
        scene.objects[0].place = Place::At(ball(x));
    });
    Line::to_device(clock, Uart::new(BAUD), device)
}

type Packets = Rc<RefCell<Vec<(Time, Tracking)>>>;

/// The firmware of a camera that only tracks.
async fn track(line: Line, clock: Clock, packets: Packets, failures: Rc<Cell<u32>>) {
    let fail = || failures.set(failures.get() + 1);
    let mut camera = Cmucam2::new(line.open(Side::Node), clock.clone());
    let mut start_up = StartUp::default();
    start_up.adapt_ms = 2_000;
    while camera.start_up(start_up).run().await.is_err() {
        fail();
    }
    let bounds = ColourBounds::new([170, 240, 60, 180, 16, 100]).unwrap();
    while camera.track_colour(bounds).run().await.is_err() {
        fail();
    }
    loop {
        match camera.next_tracking().run().await {
            Ok(Some(tracking)) => packets.borrow_mut().push((clock.time(), tracking)),
            Ok(None) => {}
            Err(_) => fail(),
        }
    }
}

struct Bench {
    executor: Executor,
    line: Line,
    packets: Packets,
    failures: Rc<Cell<u32>>,
}

impl Bench {
    fn new(faults: FaultRates, seed: u64) -> Self {
        let executor = Executor::new();
        let line = line(&executor.clock(), faults, seed);
        Self {
            executor,
            line,
            packets: Packets::default(),
            failures: Rc::default(),
        }
    }

    fn switch_on(&mut self) -> TaskId {
        let (line, clock) = (self.line.clone(), self.executor.clock());
        let (packets, failures) = (self.packets.clone(), self.failures.clone());
        self.executor.spawn(track(line, clock, packets, failures))
    }

    fn run(&mut self, until: Time) {
        assert_eq!(self.executor.run_until(until), Ended::TimeUp);
    }

    fn packets(&self, from: Time, to: Time) -> Vec<Tracking> {
        let packets = self.packets.borrow();
        let within = packets.iter().filter(|(at, _)| (from..to).contains(at));
        within.map(|(_, tracking)| *tracking).collect()
    }

    fn column(&self, at: Time) -> u8 {
        self.packets(at, at + SECOND)[0].centroid().unwrap().0
    }
}

/// 50 frames a second, each of them a packet, and each with the scene of its time: the ball is in
/// the middle of 88 columns 20 s after the start, and at 0.8 of the width after 30 s.
#[test]
fn the_driver_starts_a_camera_and_tracks() {
    let mut bench = Bench::new(FaultRates::default(), 1);
    bench.switch_on();
    bench.run(20 * SECOND);
    let before = bench.executor.effort();
    bench.run(40 * SECOND);
    let after = bench.executor.effort();
    assert_eq!(bench.failures.get(), 0);
    assert_eq!(bench.packets(20 * SECOND, 30 * SECOND).len(), 500);
    assert!((43..=45).contains(&bench.column(20 * SECOND)));
    assert!((69..=71).contains(&bench.column(35 * SECOND)));
    assert_eq!(bench.line.counts(Side::Node).overrun, 0);
    // For each of 1000 packets: its frame, its end, and at most two timers of the driver.
    let events = after.events - before.events;
    assert!(events <= 4 * 1000 + 10, "{events}");
}

/// One byte in 20 % of the lines is wrong: about that many packets less, and none of them fatal.
#[test]
fn a_bad_line_costs_packets_only() {
    let faults = FaultRates {
        corrupt_line: 0.2,
        ..FaultRates::default()
    };
    let mut bench = Bench::new(faults, 2);
    bench.switch_on();
    bench.run(40 * SECOND);
    let packets = bench.packets(20 * SECOND, 40 * SECOND).len();
    assert!((700..950).contains(&packets), "{packets}");
}

#[test]
fn a_camera_that_is_unplugged_comes_back() {
    let mut bench = Bench::new(FaultRates::default(), 3);
    bench.switch_on();
    bench.run(20 * SECOND);
    bench.line.unplug(true);
    bench.run(25 * SECOND);
    assert!(
        bench
            .packets(20 * SECOND + 50 * MILLISECOND, 25 * SECOND)
            .is_empty()
    );
    bench.line.plug();
    bench.run(45 * SECOND);
    assert!(bench.packets(35 * SECOND, 45 * SECOND).len() > 400);
}

/// The node loses its power for a second: the camera goes on, unheard; the node finds it again.
#[test]
fn a_node_that_restarts_finds_its_camera() {
    let mut bench = Bench::new(FaultRates::default(), 4);
    let task = bench.switch_on();
    bench.run(20 * SECOND);
    bench.executor.kill(task);
    bench.run(21 * SECOND);
    // Some 50 packets of at least 20 bytes.
    assert!(bench.line.counts(Side::Node).unheard > 50 * 20);
    bench.switch_on();
    bench.run(40 * SECOND);
    assert_eq!(bench.packets(30 * SECOND, 40 * SECOND).len(), 500);
}

/// A camera costs nothing while it does not stream and gets no command.
#[test]
fn an_idle_camera_costs_nothing() {
    let mut executor = Executor::new();
    let line = line(&executor.clock(), FaultRates::default(), 1);
    let (banner, port) = (Rc::new(RefCell::new(Vec::new())), line.open(Side::Node));
    let heard = banner.clone();
    executor.spawn(async move {
        let mut port = port;
        loop {
            let mut bytes = [0; 64];
            let count = port.read(&mut bytes).await.unwrap();
            heard.borrow_mut().push(bytes[..count].to_vec());
        }
    });
    assert_eq!(executor.run_until(5 * SECOND), Ended::TimeUp);
    // All at once, as it was said.
    assert_eq!(*banner.borrow(), [b"CMUcam2 v1.00 c6\r:"]);
    let effort = executor.effort();
    assert_eq!(executor.run_until(1_000_000 * SECOND), Ended::TimeUp);
    assert_eq!((executor.effort(), executor.clock().planned()), (effort, 0));
}
