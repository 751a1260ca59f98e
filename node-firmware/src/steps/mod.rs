//! A step sensor made of an accelerometer, a gyroscope and a compass worn by the target's carrier:
//! an LSM6DSOX and a LIS3MDL on one I2C bus, as on Adafruit's breakout 4517.
//!
//! | module | job |
//! |---|---|
//! | here | [`InertialSteps`]: requests to the bus, samples to [`Pedestrian`], steps out |
//! | `session` | Order and times of the requests to the chips; without input or output |
//! | `lsm6dsox` | Accelerometer and gyroscope: registers, and words of its FIFO |
//! | `lis3mdl` | Compass: registers, and readings |
//! | `stuck` | Readings that never change |
//! | `fault` | [`SensorError`]: the fault, and what to do about it |
//!
//! # How it is worn
//! Flat, the chips up, the arrow of the x axis on the breakout forward, firmly on the trunk: belt or
//! chest. Both chips have their axes as printed, x and y on the board and z out of it, right-handed;
//! so they are the body frame of [`ImuSample`] as they are. A lean of some ten degrees does no harm.
//!
//! # Time
//! Samples are timed by the clock of the accelerometer, which knows its own error: they wait in its
//! FIFO, for 4.9 s at most, and are numbered there. So it does not matter when this code comes to
//! read them.
//!
//! # Settings
//! The compass's hard iron, of which the chip alone may have 100 uT (LIS3MDL datasheet, "Magnetic
//! characteristics", zero-gauss level) beside the earth's 20 across the vertical: without it there
//! is no heading. See [`SensorConfig::hard_iron`]. The gyroscope's bias is estimated all the time.
//!
//! Headings are counter-clockwise from magnetic east. The reference cameras find the direction of the site
//! against that.

mod fault;
mod lis3mdl;
mod lsm6dsox;
mod session;
mod stuck;

use core::time::Duration;

use calib_core::dead_reckoning::Step;
use embedded_hal_async::i2c::{Error, ErrorKind, I2c, Operation};
use nalgebra::Vector3;
use pedestrian::{ImuSample, InvalidSetting, Pedestrian, PedestrianSettings};
use zigbee_link::runner::Clock;

pub use self::fault::{Chip, SensorError, SensorFault};
use self::session::{Session, Want};
use crate::{
    config::SensorConfig,
    hardware::StepSensor,
    log::{debug, warning},
};

/// The step sensor: [`Pedestrian`] fed from chips on an I2C bus.
///
/// A transfer that fails is repeated some times. A chip that fails is reported once by [`StepSensor::next`]; the next
/// call sets both up anew. They count as working again when both have measured for two seconds what they should.
/// A call that is dropped loses the samples of one read of six words at most. These are three, or
/// four if the read begins in the middle of one; less than a step. Up to three that are missing in a
/// row are counted by the chip's two-bit numbers, so that no time is lost. Of more, as after a second
/// drop before a complete sample was read again, the time of every four is.
#[derive(Debug)]
pub struct InertialSteps<I, C> {
    bus: I,
    clock: C,
    hard_iron: Vector3<f32>,
    person: Pedestrian<f32>,
    session: Session,
}

impl<I: I2c, C: Clock> InertialSteps<I, C> {
    /// The chips are first spoken to by [`StepSensor::next`].
    ///
    /// # Errors
    /// A step length out of its range.
    pub fn new(bus: I, clock: C, config: &SensorConfig) -> Result<Self, InvalidSetting> {
        let mut settings = PedestrianSettings::default();
        settings.length.k = config.step_length;
        Ok(Self {
            bus,
            clock,
            hard_iron: Vector3::from(config.hard_iron),
            person: Pedestrian::new(settings)?,
            session: Session::default(),
        })
    }

    /// The next action before there can be news; or a step, or that the chips work again.
    // Apart from the future of a whole node, in which it would be larger.
    #[inline(never)] // for less flash
    fn advance(&mut self) -> Result<Result<Option<Step<f32>>, Want>, SensorError> {
        if self.session.has_recovered() {
            return Ok(Ok(None));
        }
        while let Some(sample) = self.session.sample()? {
            let reading = ImuSample {
                acceleration: sample.acceleration,
                angular_rate: sample.angular_rate,
                magnetic_field: sample.field.map(|field| field - self.hard_iron),
            };
            let time = Duration::from_micros(sample.time_us);
            match self.person.update(time, &reading) {
                Ok(Some(step)) => {
                    debug!("a step of {} towards {} rad", step.distance, step.heading);
                    return Ok(Ok(Some(step)));
                }
                Ok(None) => {}
                // A chip's measurement is usable, and a later sample is later.
                Err(error) => debug_assert!(false, "{error}"),
            }
        }
        Ok(Err(self.session.want(self.clock.now())))
    }

    async fn step(&mut self) -> Result<Option<Step<f32>>, SensorError> {
        loop {
            let request = match self.advance()? {
                Ok(step) => return Ok(step),
                Err(Want::Wait(until)) => {
                    self.clock.sleep_until(until).await;
                    continue;
                }
                Err(Want::Ask(request)) => request,
            };
            let (sent, received) = self.session.buffers(&request);
            // A read sends the register alone.
            let count = if request.is_read() { 1 } else { 2 };
            let sent = sent.get(..count).unwrap_or_default();
            let mut operations = [Operation::Write(sent), Operation::Read(received)];
            // One place for both: each wait for the bus takes half a kilobyte of flash.
            let count = if request.is_read() { 2 } else { 1 };
            let operations = operations.get_mut(..count).unwrap_or_default();
            let address = request.chip.address();
            let result = self.bus.transaction(address, operations).await;
            if let Err(error) = result {
                if self.session.may_repeat(self.clock.now()) {
                    continue;
                }
                return Err(request.chip.is(match error.kind() {
                    ErrorKind::NoAcknowledge(_) => SensorFault::Absent,
                    _ => SensorFault::Bus,
                }));
            }
            self.session.answered(&request, self.clock.now())?;
        }
    }
}

impl<I: I2c, C: Clock> StepSensor for InertialSteps<I, C> {
    async fn next(&mut self) -> Result<Option<Step<f32>>, SensorError> {
        let step = self.step().await;
        if let Err(error) = &step {
            warning!("{}", error);
            self.session.begin_anew();
        }
        step
    }
}

/// Three numbers of two bytes each, the low byte first.
fn triple(data: &[u8; 6]) -> [i16; 3] {
    let [x0, x1, y0, y1, z0, z1] = *data;
    [[x0, x1], [y0, y1], [z0, z1]].map(i16::from_le_bytes)
}

/// The same in another unit.
fn vector(numbers: [i16; 3], unit: f32) -> Vector3<f32> {
    Vector3::from(numbers.map(f32::from)) * unit
}
