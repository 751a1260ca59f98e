//! Sight of a node through emulated cameras of the Pixy family: the async driver on a line of 19,200 baud, in
//! virtual time.

use std::{
    cell::{Cell, RefCell},
    convert::Infallible,
    future::{Future, poll_fn},
    pin::pin,
    rc::Rc,
    task::{Context, Poll, Waker},
};

use calib_core::camera::Projection;
use cmucam2_emulator::{Lens, Object, Place, Scene, Shape};
use node_firmware::{
    config::CameraConfig,
    message::Seen,
    vision::{BlobCamera, Look, PixyBlobCamera, Subject, VisionError, look},
};
use pixy_driver::{Model, Pixy};
use pixy_emulator::{Configuration, Emulator};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SECOND: u64 = 1_000_000_000;
const ORANGE: [u8; 3] = [230, 105, 35];
const BALL: Subject = Subject::Signature(1);

/// The camera, and the time, nanoseconds.
struct Bench {
    camera: RefCell<Emulator>,
    now: Cell<u64>,
    /// Time at which the line to the camera is free.
    free_at: Cell<u64>,
}

const BYTE: u64 = 10 * SECOND / 19_200;

struct Line(Rc<Bench>);
struct Delay(Rc<Bench>);

impl embedded_io_async::ErrorType for Line {
    type Error = Infallible;
}

impl embedded_io_async::Read for Line {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        poll_fn(|_| {
            let mut camera = self.0.camera.borrow_mut();
            let now = self.0.now.get();
            match camera.transmit(now) {
                Some((_, byte)) => {
                    buffer[0] = byte;
                    Poll::Ready(Ok(1))
                }
                None => Poll::Pending,
            }
        })
        .await
    }
}

impl embedded_io_async::Write for Line {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        for &byte in bytes {
            let at = self.0.free_at.get().max(self.0.now.get()) + BYTE;
            self.0.free_at.set(at);
            self.0.camera.borrow_mut().receive(byte, at);
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
            let next = self.0.camera.borrow().next_deadline();
            let next = next.map_or(until, |at| at.clamp(self.0.now.get(), until));
            if next == until && self.0.now.get() >= until {
                return Poll::Ready(());
            }
            self.0.now.set(next);
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

/// A ball at a bearing, of an angular radius, before a Pixy2; radians.
fn ball(bearing: f64, radius: f64) -> Object {
    ball_before(Model::Pixy2, bearing, radius)
}

fn ball_before(model: Model, bearing: f64, radius: f64) -> Object {
    let (aspect, view) = (1.0, f64::from(model.field_of_view_deg()).to_radians());
    let [columns, rows] = model.size();
    let lens = Lens::of_frame(Projection::PinHole, view, [columns, rows], aspect).unwrap();
    let mut extent = lens.extent(bearing, 0.0, 2.0 * radius, 0.0).unwrap();
    let height = (extent.right - extent.left) * f64::from(columns) / f64::from(rows);
    (extent.top, extent.bottom) = (0.5 - height / 2.0, 0.5 + height / 2.0);
    Object {
        colour: ORANGE,
        shape: Shape::Disc,
        place: Place::At(extent),
    }
}

struct Node {
    sight: PixyBlobCamera<Line, Delay>,
    bench: Rc<Bench>,
    config: CameraConfig,
    subject: Subject,
}

impl Node {
    fn new(configuration: Configuration) -> Self {
        use pixy_emulator::Model as Emulated;
        let model = match configuration.model {
            Emulated::Pixy2 => Model::Pixy2,
            Emulated::Pixy => Model::Pixy,
            Emulated::OpenMv => Model::OpenMv,
            Emulated::OpenMvTags => Model::OpenMvTags,
        };
        let scene = Scene {
            noise: 2.0,
            ..Scene::default()
        };
        let bench = Rc::new(Bench {
            camera: RefCell::new(Emulator::new(configuration, scene)),
            now: Cell::new(0),
            free_at: Cell::new(0),
        });
        let config = CameraConfig::pixy(model, 1);
        let driver = Pixy::new(model, Line(bench.clone()), Delay(bench.clone()));
        Self {
            sight: PixyBlobCamera::new(driver, config.lens.columns),
            bench,
            config,
            subject: match model {
                Model::OpenMvTags => Subject::Tag(3),
                _ => BALL,
            },
        }
    }

    fn of(model: pixy_emulator::Model) -> Self {
        Self::new(Configuration {
            model,
            ..Configuration::default()
        })
    }

    fn show(&self, objects: Vec<Object>) {
        self.bench.camera.borrow_mut().scene_mut().objects = objects;
    }

    fn look(&mut self) -> Result<Look, VisionError> {
        let mut judge = self.config.judge(self.config.lens.camera().unwrap());
        wait(look(&mut self.sight, self.subject, &mut judge))
    }

    fn seen(&mut self) -> Seen {
        match self.look() {
            Ok(Look::Steady(seen)) => seen,
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn it_starts_as_long_as_the_camera_takes_and_looks_in_a_fifth_of_a_second() {
    let mut node = Node::new(Configuration::default());
    assert_eq!(wait(node.sight.start_up()), Ok(()));
    let started = node.bench.now.get();
    assert!((2 * SECOND..3 * SECOND).contains(&started), "{started}");
    assert_eq!(node.look(), Ok(Look::Nothing));
    node.show(vec![ball(0.1, 0.04)]);
    let begun = node.bench.now.get();
    node.seen();
    let took = node.bench.now.get() - begun;
    assert!(took < SECOND / 5, "{took} ns");
    // A Pixy2 is taught its colours, and does not find motion.
    assert_eq!(wait(node.sight.learn_colour()), Err(VisionError::Unable));
    let motion = Subject::Motion { threshold: 12 };
    assert_eq!(wait(node.sight.begin(motion)), Err(VisionError::Unable));
}

/// Squared errors over sigmas, where 1 is right, for balls of 10 to 50 columns anywhere in the view, or tags.
#[test]
fn sigmas_are_those_of_the_errors() {
    use pixy_emulator::Model as Emulated;
    // 2,000 squares of normal errors have their mean within 0.9 to 1.1 in 99.8 % of all cases.
    // 2,000 squares of normal errors have their mean within 0.9 to 1.1 in 99.8 % of all cases; those of whole
    // columns are even. The middle of a ball of an even number of columns is between two, and rounded to the right.
    for (emulated, model, mean) in [
        (Emulated::Pixy2, Model::Pixy2, 0.1),
        (Emulated::Pixy, Model::Pixy, 0.1),
        (Emulated::OpenMv, Model::OpenMv, 0.2),
        (Emulated::OpenMvTags, Model::OpenMvTags, 0.1),
    ] {
        let mut node = Node::of(emulated);
        wait(node.sight.start_up()).unwrap();
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let (mut squares, mut errors, mut widths, mut refused) = (0.0, 0.0, 0.0, 0);
        const LOOKS: usize = 2_000;
        for _ in 0..LOOKS {
            let bearing = random.random_range(-0.4..0.4);
            let radius = random.random_range(0.018..0.09);
            let mut seen = ball_before(model, bearing, radius);
            if model == Model::OpenMvTags {
                seen = ball_before(model, bearing, 0.05 + radius);
                seen.shape = Shape::Tag(3);
            }
            node.show(vec![seen]);
            let Ok(Look::Steady(seen)) = node.look() else {
                refused += 1;
                continue;
            };
            let off = (f64::from(seen.bearing) - bearing) / f64::from(seen.sigma);
            errors += off / LOOKS as f64;
            squares += off * off / LOOKS as f64;
            let half = f64::from(seen.half_width) * 1e-4;
            widths += (half - radius) / f64::from(seen.sigma) / LOOKS as f64;
        }
        let refused = f64::from(refused) / LOOKS as f64;
        let told = format!(
            "{model:?}: mean {errors:.3}, squares {squares:.3}, widths {widths:.3}, refused {refused}"
        );
        assert!((0.85..1.1).contains(&squares), "{told}");
        let is_ball = model != Model::OpenMvTags;
        assert!(
            errors.abs() < mean && (widths.abs() < 0.1 || !is_ball),
            "{told}"
        );
        // Small balls that lost too much of their right edge.
        assert!(refused < 0.01, "{told}");
    }
}

/// A camera that streams tells pictures unasked; a target beside it is another one by its number.
#[test]
fn a_tag_is_told_by_its_number() {
    let mut node = Node::of(pixy_emulator::Model::OpenMvTags);
    wait(node.sight.start_up()).unwrap();
    let tag = |number, bearing| {
        let mut tag = ball_before(Model::OpenMvTags, bearing, 0.08);
        tag.shape = Shape::Tag(number);
        tag
    };
    assert_eq!(node.look(), Ok(Look::Nothing));
    node.show(vec![tag(2, 0.3)]);
    assert_eq!(node.look(), Ok(Look::Nothing));
    node.show(vec![tag(2, 0.3), tag(3, -0.2)]);
    let seen = node.seen();
    assert!((seen.bearing + 0.2).abs() < 5.0 * seen.sigma);
    // Two of one number are none that is known.
    node.show(vec![tag(3, 0.3), tag(3, -0.2)]);
    assert_eq!(node.look(), Ok(Look::Lopsided));
    assert_eq!(wait(node.sight.learn_colour()), Err(VisionError::Unable));
    assert_eq!(wait(node.sight.begin(BALL)), Err(VisionError::Unable));
}

#[test]
fn another_ball_of_the_colour_is_noticed_and_another_colour_is_none() {
    let mut node = Node::new(Configuration::default());
    wait(node.sight.start_up()).unwrap();
    node.show(vec![ball(0.1, 0.04), ball(-0.2, 0.035)]);
    assert_eq!(node.look(), Ok(Look::Lopsided));
    let mut green = ball(-0.2, 0.06);
    green.colour = [40, 160, 60];
    node.show(vec![ball(0.1, 0.04), green]);
    let seen = node.seen();
    assert!((seen.bearing - 0.1).abs() < 5.0 * seen.sigma);
    // Half of the ball is behind a wall.
    let mut wall = ball(0.1 + 0.04, 0.04);
    (wall.colour, wall.shape) = ([110; 3], Shape::Box);
    node.show(vec![ball(0.1, 0.04), wall]);
    assert_eq!(node.look(), Ok(Look::Lopsided));
    node.show(vec![ball(0.52, 0.06)]);
    assert_eq!(node.look(), Ok(Look::Clipped));
}

/// Damaged answers are asked for again; a camera without power is silent, and starts again.
#[test]
fn damage_and_a_power_cut_are_survived() {
    use pixy_emulator::Model as Emulated;
    for (emulated, model) in [
        (Emulated::Pixy2, Model::Pixy2),
        (Emulated::Pixy, Model::Pixy),
        (Emulated::OpenMv, Model::OpenMv),
    ] {
        let mut node = Node::new(Configuration {
            model: emulated,
            corrupt_line: 0.1,
            seed: 3,
            ..Configuration::default()
        });
        wait(node.sight.start_up()).unwrap();
        node.show(vec![ball_before(model, 0.1, 0.04)]);
        for _ in 0..20 {
            let seen = node.seen();
            assert!((seen.bearing - 0.1).abs() < 5.0 * seen.sigma, "{model:?}");
        }
        let now = node.bench.now.get();
        node.bench.camera.borrow_mut().power_cycle(now);
        assert_eq!(node.look(), Err(VisionError::Silent), "{model:?}");
        assert_eq!(wait(node.sight.start_up()), Ok(()), "{model:?}");
        node.seen();
    }
}
