//! The chips on a bus, in a world, and a caller that waits for steps.

use std::{
    cell::{Cell, RefCell},
    future::{Future, pending, poll_fn},
    pin::pin,
    rc::Rc,
    task::{Context, Poll, Waker},
};

use embedded_hal_async::i2c::{ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation};
use nalgebra::Vector3;
use node_firmware::{
    config::SensorConfig,
    hardware::StepSensor,
    steps::{InertialSteps, SensorError},
};
use rand::RngExt;
use test_support::{Random, generator, walker};
use zigbee_link::{Instant, runner::Clock};

use crate::steps::chips::{Lis3mdl, Lsm6dsox, World};

/// Readings of a person's sensors, at any time: in between, in proportion.
pub(crate) struct Recording(pub(crate) Vec<walker::Reading>);

impl Recording {
    fn end_us(&self) -> u64 {
        (self.0.len() as f64 / walker::RATE * 1e6) as u64
    }
}

impl World for Recording {
    fn at(&self, time_us: f64) -> [Vector3<f64>; 3] {
        let place = time_us * 1e-6 * walker::RATE;
        let reading = |at: usize| {
            let reading = &self.0[at.min(self.0.len() - 1)];
            let field = reading.magnetic_field.unwrap();
            [reading.acceleration, reading.angular_rate, field]
        };
        let (before, after) = (reading(place as usize), reading(place as usize + 1));
        [0, 1, 2].map(|i| before[i].lerp(&after[i], place.fract()))
    }
}

/// Faults of the bus, beside the chips.
#[derive(Default)]
pub(crate) struct Faults {
    pub(crate) no_motion: bool,
    pub(crate) no_compass: bool,
    /// All transactions fail.
    pub(crate) broken: bool,
    /// The most that a waiting is too long, us.
    pub(crate) late_us: u64,
    /// A call is cut off after so many bytes at most.
    pub(crate) cut: Option<u32>,
    /// So many transfers of so many are not acknowledged.
    pub(crate) refused: Option<(u32, u32)>,
    /// All that is read is random.
    pub(crate) noise: bool,
}

pub(crate) struct Bench {
    now_us: Cell<u64>,
    recording: Recording,
    pub(crate) motion: RefCell<Lsm6dsox>,
    pub(crate) compass: RefCell<Lis3mdl>,
    pub(crate) faults: RefCell<Faults>,
    rng: RefCell<Random>,
    bytes_to_cut: Cell<u32>,
    transfers: Cell<u32>,
    /// True if the last call was cut off, and does not just wait for ever.
    is_cut: Cell<bool>,
}

/// A step, a failure or its end, and its time.
pub(crate) type Happened = (
    f64,
    Result<Option<calib_core::dead_reckoning::Step<f32>>, SensorError>,
);

impl Bench {
    pub(crate) fn new(recording: Vec<walker::Reading>) -> Rc<Self> {
        Rc::new(Self {
            now_us: Cell::new(0),
            recording: Recording(recording),
            motion: RefCell::new(Lsm6dsox::new()),
            compass: RefCell::new(Lis3mdl::new()),
            faults: RefCell::default(),
            rng: RefCell::new(generator(1)),
            bytes_to_cut: Cell::new(100),
            transfers: Cell::new(0),
            is_cut: Cell::new(false),
        })
    }

    pub(crate) fn sensor(self: &Rc<Self>, config: &SensorConfig) -> Sensor {
        let (bus, clock) = (Wires(self.clone()), Time(self.clone()));
        InertialSteps::new(bus, clock, config).unwrap()
    }

    /// All that happens until this time, or until the recording ends.
    pub(crate) fn until(&self, sensor: &mut Sensor, end_s: f64) -> Vec<Happened> {
        let end_s = end_s.min(self.recording.end_us() as f64 * 1e-6);
        let mut all = Vec::new();
        while self.now_s() < end_s {
            self.is_cut.set(false);
            let next = pin!(sensor.next());
            match next.poll(&mut Context::from_waker(Waker::noop())) {
                Poll::Ready(result) => {
                    if result.is_err() {
                        // As the target's loop does.
                        self.now_us.set(self.now_us.get() + 1_000_000);
                    }
                    all.push((self.now_s(), result));
                }
                Poll::Pending if self.is_cut.get() => {}
                Poll::Pending => break,
            }
        }
        all
    }

    fn now_s(&self) -> f64 {
        self.now_us.get() as f64 * 1e-6
    }

    fn run(&self) {
        let now = self.now_us.get() as f64;
        self.motion.borrow_mut().run(now, &self.recording);
        self.compass.borrow_mut().run(now, &self.recording);
    }

    /// A byte is on the bus.
    async fn byte(&self) {
        self.now_us.set(self.now_us.get() + 36);
        self.run();
        let Some(most) = self.faults.borrow().cut else {
            return;
        };
        if let Some(left) = self.bytes_to_cut.get().checked_sub(1) {
            self.bytes_to_cut.set(left);
            return;
        }
        let next = self.rng.borrow_mut().random_range(1..=most);
        self.bytes_to_cut.set(next);
        self.is_cut.set(true);
        let mut waited = false;
        poll_fn(|_| match std::mem::replace(&mut waited, true) {
            true => Poll::Ready(()),
            false => Poll::Pending,
        })
        .await;
    }
}

pub(crate) type Sensor = InertialSteps<Wires, Time>;

pub(crate) struct Time(Rc<Bench>);

impl Clock for Time {
    fn now(&self) -> Instant {
        Instant(self.0.now_us.get())
    }

    async fn sleep_until(&self, time: Instant) {
        let bench = &self.0;
        let late = bench.faults.borrow().late_us;
        let late = bench.rng.borrow_mut().random_range(0..=late);
        let then = time.0.max(bench.now_us.get()) + late;
        if then >= bench.recording.end_us() {
            pending::<()>().await;
        }
        bench.now_us.set(then);
    }
}

pub(crate) struct Wires(Rc<Bench>);

impl ErrorType for Wires {
    type Error = ErrorKind;
}

const REFUSED: ErrorKind = ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data);

impl I2c for Wires {
    async fn transaction(
        &mut self,
        address: u8,
        operations: &mut [Operation<'_>],
    ) -> Result<(), ErrorKind> {
        let bench = &self.0;
        bench.byte().await;
        let Faults {
            no_motion,
            no_compass,
            broken,
            noise,
            refused,
            ..
        } = *bench.faults.borrow();
        let is_motion = match address {
            0x6A if !no_motion => true,
            0x1C if !no_compass => false,
            _ => return Err(ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address)),
        };
        if broken {
            return Err(ErrorKind::ArbitrationLoss);
        }
        let transfer = bench.transfers.get();
        bench.transfers.set(transfer + 1);
        if refused.is_some_and(|(some, of)| transfer % of < some) {
            return Err(REFUSED);
        }
        let mut register = None;
        for operation in operations {
            match operation {
                Operation::Write(bytes) => {
                    for &byte in *bytes {
                        bench.byte().await;
                        match register {
                            None => register = Some(byte),
                            Some(number) if is_motion => {
                                if !bench.motion.borrow_mut().write(number, byte) {
                                    return Err(REFUSED);
                                }
                            }
                            Some(number) => bench.compass.borrow_mut().write(number, byte),
                        }
                    }
                }
                Operation::Read(bytes) => {
                    for byte in bytes.iter_mut() {
                        bench.byte().await;
                        let number = register.unwrap();
                        let (value, next) = if is_motion {
                            bench.motion.borrow_mut().read(number)
                        } else {
                            bench.compass.borrow_mut().read(number)
                        };
                        register = Some(next);
                        *byte = if noise && number != 0x0F {
                            bench.rng.borrow_mut().random()
                        } else {
                            value
                        };
                    }
                }
            }
        }
        Ok(())
    }
}
