//! A node on this computer, and the devices on its lines.

use std::{
    cell::{Cell, RefCell},
    collections::VecDeque,
    convert::Infallible,
    future::{Future, pending},
    rc::Rc,
    task::Poll,
    time::Instant,
};

use calib_core::dead_reckoning::Step;
use cmucam2_emulator::{Configuration, Emulator, Extent, Note, Scene, Shape, Time};
use embedded_io_async::{ErrorType, Read, Write};
use node_firmware::{
    config::{CheckedConfig, Config},
    console::{Frames, ToPc},
    facts,
    hardware::{
        Button, Buttons, FlashLayout, Hardware, Indication, Indicator, Peripherals, StepSensor,
    },
    liveness::Liveness,
    message::Restart,
    run::run,
    steps::SensorError,
};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use virtual_hardware::flash::{Flash, PAGE};

use super::peer::{Rcp, StdClock};

/// Start bit, eight data bits, stop bit.
const BYTE_BITS: Time = 10;
const SECOND: Time = 1_000_000_000;

/// Pages of the link's memory, which are in front of those of the role's.
const LINK: u32 = 4 * PAGE as u32;

/// One end of a line that takes no time.
pub(crate) struct Line {
    from: Rc<RefCell<VecDeque<u8>>>,
    to: Rc<RefCell<VecDeque<u8>>>,
}

impl Line {
    /// Both ends.
    pub(crate) fn new() -> [Self; 2] {
        let (one, other) = (Rc::default(), Rc::default());
        let here = Self {
            from: Rc::clone(&one),
            to: Rc::clone(&other),
        };
        let there = Self {
            from: other,
            to: one,
        };
        [here, there]
    }

    fn take(&self) -> Vec<u8> {
        self.from.borrow_mut().drain(..).collect()
    }

    fn put(&self, bytes: &[u8]) {
        self.to.borrow_mut().extend(bytes);
    }

    /// Waits for bytes.
    async fn wait(&self) -> Vec<u8> {
        std::future::poll_fn(|_| match self.take() {
            bytes if bytes.is_empty() => Poll::Pending,
            bytes => Poll::Ready(bytes),
        })
        .await
    }
}

impl node_firmware::hardware::Line for Line {}

impl ErrorType for Line {
    type Error = Infallible;
}

impl Read for Line {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        std::future::poll_fn(|_| {
            let mut from = self.from.borrow_mut();
            let count = buffer.len().min(from.len());
            for (byte, came) in buffer.iter_mut().zip(from.drain(..count)) {
                *byte = came;
            }
            match count {
                0 => Poll::Pending,
                _ => Poll::Ready(Ok(count)),
            }
        })
        .await
    }
}

impl Write for Line {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        self.put(bytes);
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// A node. Its flash keeps its contents when it is switched off.
pub(crate) struct Machine {
    config: CheckedConfig,
    flash: Flash,
    starts: u64,
}

/// Lamps and buttons of a node.
#[derive(Clone, Default)]
pub(crate) struct Panel {
    shown: Rc<Cell<Indication>>,
    presses: Rc<Cell<usize>>,
}

impl Panel {
    /// Looks at the lamps until they are as wanted.
    pub(crate) async fn until(&self, wanted: impl Fn(Indication) -> bool) {
        std::future::poll_fn(|_| match wanted(self.shown.get()) {
            true => Poll::Ready(()),
            false => Poll::Pending,
        })
        .await;
    }

    /// Presses the button that lets devices join.
    pub(crate) fn press_join_window(&self) {
        self.presses.set(self.presses.get() + 1);
    }
}

impl Indicator for Panel {
    fn show(&mut self, indication: Indication) {
        self.shown.set(indication);
    }
}

impl Buttons for Panel {
    async fn pressed(&mut self) -> Button {
        std::future::poll_fn(|_| match self.presses.get() {
            0 => Poll::Pending,
            presses => {
                self.presses.set(presses - 1);
                Poll::Ready(Button::JoinWindow)
            }
        })
        .await
    }
}

/// There is no target here.
pub(crate) struct NoSteps;

impl StepSensor for NoSteps {
    async fn next(&mut self) -> Result<Option<Step<f32>>, SensorError> {
        pending().await
    }
}

/// A real co-processor, and this computer's time.
struct Here;

impl Hardware for Here {
    type Uart = Line;
    type Radio = Rcp;
    type Clock = StdClock;
    type Flash = Flash;
    type Steps = NoSteps;
    type Indicator = Panel;
    type Buttons = Panel;
    type Observer = ();
}

impl Machine {
    pub(crate) fn new(config: &Config) -> Self {
        let pages = (LINK + facts::BYTES) as usize / PAGE;
        Self {
            config: config.clone().check().unwrap(),
            flash: Flash::without_time(pages, ChaCha8Rng::seed_from_u64(0)),
            starts: 0,
        }
    }

    /// Runs the node until this is dropped; returns only the reason why it cannot go on.
    pub(crate) fn run(
        &mut self,
        uart: Line,
        radio: Rcp,
        panel: Panel,
    ) -> impl Future<Output = String> + '_ {
        self.starts += 1;
        let peripherals = Peripherals::<Here> {
            uart,
            radio,
            clock: StdClock::new(),
            flash: self.flash.clone(),
            layout: FlashLayout {
                link: 0..LINK,
                facts: LINK..LINK + facts::BYTES,
            },
            steps: NoSteps,
            indicator: panel.clone(),
            buttons: panel,
            observer: (),
            seed: self.starts,
            update: None,
        };
        let config = &self.config;
        async move {
            let liveness = Liveness::new(Restart::Ordinary);
            format!("{:?}", run(config, peripherals, &liveness).await)
        }
    }
}

/// Columns and rows of the CMUcam2 as it starts (manual, p. 34: 88 by 143).
const PICTURE: (f64, f64) = (88.0, 143.0);
/// Columns of the ball; a column is as wide as two rows are high.
const BALL: f64 = 18.0;

/// A CMUcam2 in front of a ball, in real time.
pub(crate) struct Camera {
    line: Line,
    emulator: Emulator,
    start: Instant,
    byte_time: Time,
    free_at: Time,
    pub(crate) notes: Vec<Note>,
}

impl Camera {
    pub(crate) fn new(line: Line, baud: u32) -> Self {
        let configuration = Configuration {
            baud,
            host_baud: baud,
            watched: true,
            ..Configuration::default()
        };
        Self {
            line,
            emulator: Emulator::new(configuration, Scene::default()),
            start: Instant::now(),
            byte_time: BYTE_BITS * SECOND / Time::from(baud),
            free_at: 0,
            notes: Vec::new(),
        }
    }

    /// Never ends. The middle of the ball is in this column, counted from 0 at the middle of the first one.
    pub(crate) async fn run(&mut self, ball: &Cell<f64>) {
        std::future::poll_fn::<(), _>(|_| {
            self.work(ball.get() + 0.5);
            Poll::<()>::Pending
        })
        .await;
    }

    fn work(&mut self, middle: f64) {
        let columns = [middle - BALL / 2.0, middle + BALL / 2.0];
        let rows = [PICTURE.1 / 2.0 - BALL, PICTURE.1 / 2.0 + BALL];
        let extent = Extent::of_pixels(columns, rows, PICTURE.0, PICTURE.1);
        *self.emulator.scene_mut() = Scene::with_object([220, 110, 40], Shape::Disc, extent);
        let now = self.start.elapsed().as_nanos() as Time;
        for byte in self.line.take() {
            // A line would carry bytes one after the other; so early is late enough here.
            self.free_at = now.max(self.free_at + self.byte_time);
            self.emulator.receive(byte, self.free_at);
        }
        while let Some((_, byte)) = self.emulator.transmit(now.max(self.free_at)) {
            self.line.put(&[byte]);
        }
        while let Some(note) = self.emulator.take_note() {
            self.notes.push(note);
        }
    }
}

/// A PC on the coordinator's line.
pub(crate) struct Console {
    line: Line,
    frames: Frames,
}

impl Console {
    pub(crate) fn new(line: Line) -> Self {
        Self {
            line,
            frames: Frames::default(),
        }
    }

    /// Reads until this is told.
    pub(crate) async fn until(&mut self, wanted: impl Fn(&ToPc) -> bool) {
        loop {
            for byte in self.line.wait().await {
                let told = self.frames.push::<ToPc>(byte);
                if told.is_some_and(|told| wanted(&told)) {
                    return;
                }
            }
        }
    }
}
