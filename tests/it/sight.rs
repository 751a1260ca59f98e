//! Sight of a node through an emulated CMUcam2: the async driver on a line of 38,400 baud, in
//! virtual time.

use std::{
    cell::{Cell, RefCell},
    collections::VecDeque,
    convert::Infallible,
    future::{Future, poll_fn},
    pin::pin,
    rc::Rc,
    task::{Context, Poll, Waker},
};

use cmucam2_driver::Cmucam2;
use cmucam2_emulator::{Configuration, Emulator, Extent, FaultRates, Place, Scene, Shape};
use node_firmware::{
    config::{CameraConfig, Subjects},
    message::Seen,
    vision::{BlobCamera, Cmucam2BlobCamera, ColourWindow, Lens, Look, Subject, VisionError, look},
};

const BAUD: u32 = 38_400;
const SECOND: u64 = 1_000_000_000;
/// Start bit, eight data bits, stop bit.
const BYTE: u64 = 10 * SECOND / BAUD as u64;
const VIEW: f64 = 45.0;

const ORANGE: ColourWindow = ColourWindow {
    red: [170, 240],
    green: [60, 170],
    blue: [16, 90],
};

/// The camera, the line to it and the time, nanoseconds.
struct Bench {
    camera: RefCell<Emulator>,
    now: Cell<u64>,
    outgoing: RefCell<VecDeque<(u64, u8)>>,
    /// Bytes that the camera has sent and that are not read yet.
    waiting: RefCell<VecDeque<u8>>,
}

impl Bench {
    /// Lets time pass up to the next event, `until` at the latest.
    fn pass(&self, until: u64) {
        let mut camera = self.camera.borrow_mut();
        let mut outgoing = self.outgoing.borrow_mut();
        let next = [outgoing.front().map(|&(at, _)| at), camera.next_deadline()];
        let next = next.into_iter().flatten().fold(until, u64::min);
        self.now.set(self.now.get().max(next));
        while let Some((at, byte)) = outgoing.pop_front_if(|(at, _)| *at <= self.now.get()) {
            camera.receive(byte, at);
        }
        while let Some((_, byte)) = camera.transmit(self.now.get()) {
            self.waiting.borrow_mut().push_back(byte);
        }
    }
}

struct Line(Rc<Bench>);
struct Delay(Rc<Bench>);

impl embedded_io_async::ErrorType for Line {
    type Error = Infallible;
}

impl embedded_io_async::Read for Line {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        poll_fn(|_| {
            let mut waiting = self.0.waiting.borrow_mut();
            let count = waiting.len().min(buffer.len());
            for (place, byte) in buffer.iter_mut().zip(waiting.drain(..count)) {
                *place = byte;
            }
            if count > 0 {
                Poll::Ready(Ok(count))
            } else {
                Poll::Pending
            }
        })
        .await
    }
}

impl embedded_io_async::Write for Line {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        let mut outgoing = self.0.outgoing.borrow_mut();
        for &byte in bytes {
            let free_at = outgoing.back().map_or(self.0.now.get(), |&(at, _)| at);
            outgoing.push_back((free_at + BYTE, byte));
        }
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl embedded_hal_async::delay::DelayNs for Delay {
    /// The driver asks the delay before the line, so bytes that come at a time are read at that time.
    async fn delay_ns(&mut self, ns: u32) {
        let until = self.0.now.get() + u64::from(ns);
        poll_fn(|_| {
            if self.0.now.get() >= until {
                return Poll::Ready(());
            }
            if self.0.waiting.borrow().is_empty() {
                self.0.pass(until);
            }
            Poll::Pending
        })
        .await;
    }
}

fn wait<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    loop {
        if let Poll::Ready(done) = future.as_mut().poll(&mut context) {
            return done;
        }
    }
}

/// The part of a node's camera role that looks.
struct Node {
    sight: Cmucam2BlobCamera<Line, Delay>,
    bench: Rc<Bench>,
    config: CameraConfig,
}

impl Node {
    /// A node before a ball at a bearing, degrees.
    fn new(columns: u16, bearing: f64, faults: FaultRates) -> Self {
        let config = CameraConfig::new(
            Lens::pin_hole(columns, VIEW as f32),
            Subjects::Colours([ORANGE].into_iter().collect()),
        );
        let camera = Emulator::new(
            Configuration {
                baud: BAUD,
                host_baud: BAUD,
                faults,
                seed: 7,
                ..Configuration::default()
            },
            Scene::with_object([220, 110, 40], Shape::Disc, ball(bearing)),
        );
        let bench = Rc::new(Bench {
            camera: RefCell::new(camera),
            now: Cell::new(SECOND),
            outgoing: RefCell::default(),
            waiting: RefCell::default(),
        });
        bench.pass(SECOND);
        let driver = Cmucam2::new(Line(bench.clone()), Delay(bench.clone()));
        Self {
            sight: Cmucam2BlobCamera::new(driver, config.cmucam2()),
            bench,
            config,
        }
    }

    fn move_ball(&self, bearing: f64) {
        let mut camera = self.bench.camera.borrow_mut();
        camera.scene_mut().objects[0].place = Place::At(ball(bearing));
    }

    /// A look, and its duration, seconds.
    fn look(&mut self, subject: Subject) -> (Result<Look, VisionError>, f64) {
        let mut judge = self.config.judge(self.config.lens.camera().unwrap());
        let begun = self.bench.now.get();
        let looked = wait(look(&mut self.sight, subject, &mut judge));
        (looked, (self.bench.now.get() - begun) as f64 * 1e-9)
    }

    fn seen(&mut self) -> Seen {
        let (looked, _) = self.look(Subject::Colour(ORANGE));
        let Ok(Look::Steady(seen)) = looked else {
            panic!("{looked:?}");
        };
        seen
    }
}

/// The picture of a ball of 3.5 degrees at a bearing, degrees: its edges are where a pin-hole of
/// square directions sees them. Pixels are twice as wide as tall.
fn ball(bearing: f64) -> Extent {
    const RADIUS: f64 = 3.5;
    let focal = 43.5 / (VIEW / 2.0).to_radians().tan();
    let across = |angle: f64| (44.0 - focal * angle.to_radians().tan()) / 88.0;
    let distance = 1.0 / bearing.to_radians().cos();
    let half_height = 2.0 * focal * RADIUS.to_radians().tan() * distance / 143.0;
    Extent {
        left: across(bearing + RADIUS),
        right: across(bearing - RADIUS),
        top: 0.5 - half_height,
        bottom: 0.5 + half_height,
    }
}

/// Bearings over the view, none of them a whole column.
fn bearings() -> impl Iterator<Item = f64> {
    (-6..=6).map(|step| f64::from(step) * 2.617 + 0.1)
}

#[test]
fn a_ball_is_seen_where_it_is_within_a_third_of_a_second() {
    let mut node = Node::new(88, 0.0, FaultRates::default());
    wait(node.sight.start_up()).unwrap();
    let column = VIEW / 87.0;
    for bearing in bearings() {
        node.move_ball(bearing);
        let (looked, seconds) = node.look(Subject::Colour(ORANGE));
        assert!(seconds < 0.35, "{seconds} s");
        let Ok(Look::Steady(seen)) = looked else {
            panic!("{bearing}: {looked:?}");
        };
        let off = f64::from(seen.bearing.to_degrees()) - bearing;
        assert!(off.abs() < 0.65 * column, "{bearing}: {off}");
        assert!((0.15..0.25).contains(&(f64::from(seen.sigma.to_degrees()) / column)));
    }
}

/// Twice the columns: half the sigma.
#[test]
fn high_resolution_halves_the_sigma() {
    let sigma = |columns| {
        let mut node = Node::new(columns, 5.0, FaultRates::default());
        wait(node.sight.start_up()).unwrap();
        let seen = node.seen();
        assert!(
            (f64::from(seen.bearing.to_degrees()) - 5.0).abs() < 0.5,
            "{seen:?}"
        );
        seen.sigma
    };
    let ratio = sigma(88) / sigma(176);
    assert!((1.9..2.1).contains(&ratio), "{ratio}");
}

#[test]
fn what_is_not_to_be_seen_is_told() {
    let mut node = Node::new(88, 30.0, FaultRates::default());
    wait(node.sight.start_up()).unwrap();
    assert_eq!(node.look(Subject::Colour(ORANGE)).0, Ok(Look::Nothing));
    node.move_ball(22.0);
    assert_eq!(node.look(Subject::Colour(ORANGE)).0, Ok(Look::Clipped));
}

/// The background is learnt, then the ball comes (thesis 2.5). A block is 5.5 columns wide.
#[test]
fn what_moved_into_view_is_seen_without_a_colour() {
    let motion = Subject::Motion { threshold: 15 };
    let mut node = Node::new(88, 60.0, FaultRates::default());
    // Its green differs from that of the background: green is the channel in use.
    node.bench.camera.borrow_mut().scene_mut().objects[0].colour = [30, 30, 30];
    node.config.subjects = Subjects::Motion { threshold: 15 };
    wait(node.sight.start_up()).unwrap();
    assert_eq!(node.look(motion).0, Err(VisionError::NoBackground));
    wait(node.sight.learn_background()).unwrap();
    assert_eq!(node.look(motion).0, Ok(Look::Nothing));
    for bearing in [-10.0, 2.0, 12.0] {
        node.move_ball(bearing);
        let (looked, _) = node.look(motion);
        let Ok(Look::Steady(seen)) = looked else {
            panic!("{bearing}: {looked:?}");
        };
        let off = f64::from(seen.bearing.to_degrees()) - bearing;
        assert!(
            off.abs() < 3.0 * f64::from(seen.sigma.to_degrees()),
            "{bearing}: {seen:?}"
        );
    }
}

/// A camera that loses its power between two looks, with or without its banner being seen, is
/// started up again and sees the ball.
#[test]
fn a_camera_that_lost_its_power_is_started_up_again() {
    for quietly in [false, true] {
        let mut node = Node::new(88, 4.0, FaultRates::default());
        wait(node.sight.start_up()).unwrap();
        node.seen();
        let now = node.bench.now.get();
        node.bench.camera.borrow_mut().brown_out(now, quietly);
        let (looked, _) = node.look(Subject::Colour(ORANGE));
        assert_eq!(looked, Err(VisionError::Restarted));
        wait(node.sight.start_up()).unwrap();
        let seen = node.seen();
        assert!((f64::from(seen.bearing.to_degrees()) - 4.0).abs() < 0.4);
    }
}

/// One line in 20 is damaged, and one byte in 1000 is lost to another; commands are refused now
/// and then.
#[test]
fn a_bad_line_only_takes_longer() {
    let faults = FaultRates {
        nck: 0.05,
        corrupt_line: 0.05,
        corrupt_byte: 0.001,
        ..FaultRates::default()
    };
    let mut node = Node::new(88, 0.0, faults);
    while wait(node.sight.start_up()).is_err() {}
    let (mut steady, mut looks) = (0, 0);
    for bearing in bearings().chain(bearings()).chain(bearings()) {
        node.move_ball(bearing);
        looks += 1;
        if let (Ok(Look::Steady(seen)), _) = node.look(Subject::Colour(ORANGE)) {
            steady += 1;
            let off = f64::from(seen.bearing.to_degrees()) - bearing;
            assert!(off.abs() < 1.0, "{bearing}: {off}");
        }
    }
    assert!(10 * steady >= 9 * looks, "{steady} of {looks}");
}
