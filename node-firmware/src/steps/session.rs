//! Order and times of the requests to the chips.
//!
//! First comes a script, from a reset on, since the earlier state of the chips is not known. Then, again
//! and again: the number of words in the FIFO, these words, the compass, and one of the settings,
//! which a supply that is weak or noise on the bus may change.

use core::{ops::Range, time::Duration};

use nalgebra::Vector3;
use zigbee_link::Instant;

use super::{
    debug,
    fault::{Chip, SensorError, SensorFault},
    lis3mdl::{self, Extent},
    lsm6dsox::{self, Scale, Slots, WORD},
    stuck::Stuck,
    triple, vector,
};

/// Between two looks at the chips: as often as the compass has something new.
const POLL: Duration = Duration::from_millis(50);
/// Chips that were reset have started up (the manufacturer's own examples wait 10 ms for the
/// LSM6DSOX, and as long as this for the LIS3MDL).
const START: Duration = Duration::from_millis(20);
/// Times that a transfer is repeated before the bus counts as broken, and the time between: single errors are
/// usual on long wires.
const REPEATS: u8 = 3;
const REPEAT: Duration = Duration::from_millis(10);
/// Looks in a row at which a chip had nothing new, before it counts as silent: half a second.
const SILENT: u8 = 10;
/// First samples that are not used: the gyroscope takes 70 ms to turn on (LSM6DSOX datasheet,
/// "Mechanical characteristics"), and filters settle for some samples more.
const SETTLING: u8 = 10;
/// Samples, and readings of the compass, that are equal to the last bit, before a chip counts as
/// stuck. Noise is more than a bit in each axis.
const STUCK_SAMPLES: u8 = 52;
const STUCK_READINGS: u8 = 20;
/// Between the samples before a start and those after it: more than
/// [`Pedestrian`](pedestrian::Pedestrian) takes for continuous.
const GAP_US: u64 = 1_000_000;
/// Readings of the compass between two reports of their extent.
const REPORT: u8 = 200;

/// Words of the FIFO that are read at once. When a read was cut off, it is not known whether its words have
/// gone. Up to three slots, of two words each, that are missing between two complete ones are told by the
/// numbers of slots, which have two bits, and are not yet a gap to [`Pedestrian`](pedestrian::Pedestrian). If
/// more are missing, the time of every four is lost: when two reads in a row are cut off, or one that began
/// in the middle of a slot.
const WORDS: u16 = 6;

/// The register of a chip's identity, in both chips.
const WHO_AM_I: u8 = 0x0F;

impl Chip {
    /// With the address pins of the breakout left open, which it pulls to ground (LSM6DSOX datasheet,
    /// "I2C interface": `SA0`; LIS3MDL datasheet, "I2C operation": `SA1`).
    pub(super) const fn address(self) -> u8 {
        match self {
            Self::Motion => 0x6A,
            Self::Compass => 0x1C,
        }
    }

    /// Identity that it answers (LSM6DSOX datasheet, "`WHO_AM_I` (0Fh)"; LIS3MDL datasheet, "`WHO_AM_I`
    /// (0Fh)").
    const fn identity(self) -> u8 {
        match self {
            Self::Motion => 0x6C,
            Self::Compass => 0x3D,
        }
    }
}

/// Next action.
#[derive(Debug)]
pub(super) enum Want {
    /// Nothing before this.
    Wait(Instant),
    /// A chip is asked for something, or told.
    Ask(Request),
}

/// A question or an order to a chip.
#[derive(Debug)]
pub(super) struct Request {
    pub(super) chip: Chip,
    what: What,
}

#[derive(Clone, Copy, Debug)]
enum What {
    /// A register gets a value.
    Set([u8; 2]),
    /// Its identity.
    Identity,
    /// Error of its clock.
    Frequency,
    /// Number of words that wait.
    Waiting,
    /// So many words of the FIFO.
    Words(u16),
    /// Asks whether the compass has a new reading.
    IsNew,
    /// The numbers of the new reading.
    Reading,
    /// A register that was set: whether it still has its value.
    Check([u8; 2]),
}

impl Request {
    /// The first register, and the number that is read.
    const fn registers(&self) -> ([u8; 2], usize) {
        let (register, length) = match self.what {
            What::Set(register) => return (register, 0),
            What::Identity => (WHO_AM_I, 1),
            What::Frequency => (lsm6dsox::FREQUENCY, 1),
            What::Waiting => (lsm6dsox::FIFO_STATUS, 2),
            What::Words(words) => (lsm6dsox::FIFO_OUT, words as usize * WORD),
            What::IsNew => (lis3mdl::STATUS, 1),
            What::Reading => (lis3mdl::OUT, lis3mdl::DATA),
            What::Check([register, _]) => (register, 1),
        };
        ([register, 0], length)
    }

    /// Returns true if the chip answers something.
    pub(super) const fn is_read(&self) -> bool {
        !matches!(self.what, What::Set(_))
    }
}

/// Acts of the chips' start.
enum Act {
    Ask(Chip, What),
    Pause,
}

const SCRIPT: [Act; 18] = {
    use Chip::{Compass, Motion};
    const fn set(chip: Chip, register: [u8; 2]) -> Act {
        Act::Ask(chip, What::Set(register))
    }
    let [m0, m1, m2, m3, m4, m5] = lsm6dsox::SETTINGS;
    let [c0, c1, c2, c3, c4] = lis3mdl::SETTINGS;
    [
        Act::Ask(Motion, What::Identity),
        Act::Ask(Compass, What::Identity),
        set(Motion, lsm6dsox::BYPASS),
        set(Motion, lsm6dsox::RESET),
        set(Compass, lis3mdl::RESET),
        Act::Pause,
        Act::Ask(Motion, What::Frequency),
        set(Motion, m0),
        set(Motion, m1),
        set(Motion, m2),
        set(Motion, m3),
        set(Motion, m4),
        set(Motion, m5),
        set(Compass, c0),
        set(Compass, c1),
        set(Compass, c2),
        set(Compass, c3),
        set(Compass, c4),
    ]
};

/// Where the settings are in it, up to its end, and those of the compass.
const SETTINGS: u8 = COMPASS_SETTINGS - lsm6dsox::SETTINGS.len() as u8;
const COMPASS_SETTINGS: u8 = (SCRIPT.len() - lis3mdl::SETTINGS.len()) as u8;

/// Measurement at one time, in SI units; the field in uT.
pub(super) struct Sample {
    /// In the chip's time, from any moment.
    pub(super) time_us: u64,
    pub(super) acceleration: Vector3<f32>,
    pub(super) angular_rate: Vector3<f32>,
    pub(super) field: Option<Vector3<f32>>,
}

/// A conversation with the chips.
#[derive(Debug)]
pub(super) struct Session {
    /// Progress of the script.
    done: u8,
    /// Nothing is asked before this.
    wait_until: Option<Instant>,
    running: Running,
    buffer: [u8; WORDS as usize * WORD],
    /// Time of the last sample.
    time_us: u64,
    extent: Extent,
    reports: u8,
    scale: Scale,
}

/// State that ends with a new start.
#[derive(Debug, Default)]
struct Running {
    period_us: u64,
    next: Next,
    /// It has failed, and nothing shows yet that it works again.
    is_doubted: bool,
    /// Words that are still in the FIFO.
    waiting: u16,
    /// Words in the buffer that were not yet taken from it.
    unread: Range<usize>,
    slots: Slots,
    /// For the next sample, which is taken right after it.
    field: Option<Vector3<f32>>,
    settled: u8,
    /// Looks since the last sample, and since the last reading of the compass.
    idle: u8,
    compass_idle: u8,
    /// Failures of the next transfer so far.
    failures: u8,
    /// Number of the setting that is checked next.
    checked: u8,
    /// It had another value when it was looked at last.
    differs: bool,
    samples: Stuck<{ 2 * lsm6dsox::DATA }>,
    readings: Stuck<{ lis3mdl::DATA }>,
}

/// After the words in the FIFO were read.
#[derive(Clone, Copy, Debug, Default)]
enum Next {
    #[default]
    Look,
    AskCompass,
    ReadCompass,
    Check,
}

impl Default for Session {
    fn default() -> Self {
        Self {
            done: 0,
            wait_until: None,
            running: Running::default(),
            buffer: [0; WORDS as usize * WORD],
            time_us: 0,
            extent: Extent::default(),
            reports: 0,
            scale: Scale::default(),
        }
    }
}

impl Session {
    /// The chips are set up anew; unread samples are lost.
    pub(super) fn begin_anew(&mut self) {
        self.done = 0;
        self.wait_until = None;
        self.running = Running {
            is_doubted: true,
            ..Running::default()
        };
        self.scale.weigh();
        self.time_us = self.time_us.saturating_add(GAP_US);
    }

    /// Returns true once after a failure, when both chips measure what they should again: as long as gravity is
    /// weighed, a chip that is silent, stuck or in a wrong scale is noticed.
    pub(super) const fn has_recovered(&mut self) -> bool {
        let recovers = self.running.is_doubted && self.scale.is_weighed();
        if recovers {
            self.running.is_doubted = false;
        }
        recovers
    }

    /// Notes a failed transfer. Returns true if it is to be repeated. Words of the FIFO that were to be read wait there,
    /// and are asked for anew.
    pub(super) fn may_repeat(&mut self, now: Instant) -> bool {
        let repeats = self.running.failures < REPEATS;
        if repeats {
            self.running.failures += 1;
            self.wait_until = Some(now + REPEAT);
        }
        repeats
    }

    /// The next action when there are no more samples.
    pub(super) fn want(&mut self, now: Instant) -> Want {
        if let Some(until) = self.wait_until {
            if now < until {
                return Want::Wait(until);
            }
            self.wait_until = None;
        }
        match SCRIPT.get(usize::from(self.done)) {
            Some(&Act::Ask(chip, what)) => return Want::Ask(Request { chip, what }),
            Some(Act::Pause) => {
                self.done += 1;
                let until = now + START;
                self.wait_until = Some(until);
                return Want::Wait(until);
            }
            None => {}
        }
        let running = &mut self.running;
        let (chip, what) = match running.next {
            _ if running.waiting > 0 => {
                let words = running.waiting.min(WORDS);
                // Before the answer: if the wait for it is dropped, the words may have gone.
                running.waiting -= words;
                (Chip::Motion, What::Words(words))
            }
            Next::Look => (Chip::Motion, What::Waiting),
            Next::AskCompass => (Chip::Compass, What::IsNew),
            Next::ReadCompass => (Chip::Compass, What::Reading),
            Next::Check => running.check(),
        };
        Want::Ask(Request { chip, what })
    }

    /// Bytes that are sent for a request, and the buffer for the answer.
    pub(super) fn buffers<'a>(&'a mut self, request: &Request) -> ([u8; 2], &'a mut [u8]) {
        let (sent, length) = request.registers();
        debug_assert!(length <= self.buffer.len(), "the longest read fits");
        (sent, self.buffer.get_mut(..length).unwrap_or_default())
    }

    /// The request was answered.
    pub(super) fn answered(&mut self, request: &Request, now: Instant) -> Result<(), SensorError> {
        let [first, second, ..] = self.buffer;
        let running = &mut self.running;
        running.failures = 0;
        match request.what {
            What::Set(_) => self.done += 1,
            What::Identity => {
                self.done += 1;
                if first != request.chip.identity() {
                    debug!("another chip: identity {}", first);
                    return Err(request.chip.is(SensorFault::Identity));
                }
            }
            What::Frequency => {
                self.done += 1;
                running.period_us = lsm6dsox::period_us(first);
            }
            What::Waiting => {
                running.waiting = lsm6dsox::waiting([first, second])?;
                running.next = Next::AskCompass;
                running.looked()?;
            }
            What::Words(words) => running.unread = 0..usize::from(words) * WORD,
            What::IsNew if lis3mdl::is_new(first) => running.next = Next::ReadCompass,
            What::IsNew => self.rest(now),
            What::Reading => {
                running.next = Next::Check;
                // Of a chip that measures nothing, that is told.
                if running.check().0 == Chip::Motion && running.idle > 0 {
                    self.rest(now);
                }
                self.take_field()?;
            }
            What::Check([_, value]) => {
                self.rest(now);
                self.checked(request.chip, first == value)?;
            }
        }
        Ok(())
    }

    /// A setting was looked at, and is as it was set or not.
    fn checked(&mut self, chip: Chip, is_right: bool) -> Result<(), SensorError> {
        let running = &mut self.running;
        if is_right {
            running.differs = false;
            running.checked += 1;
            if SETTINGS + running.checked >= SCRIPT.len() as u8 {
                running.checked = 0;
            }
            return Ok(());
        }
        // It may have been misread.
        if core::mem::replace(&mut running.differs, true) {
            return Err(chip.is(SensorFault::Changed));
        }
        if chip == Chip::Compass {
            // In whatever unit it is.
            running.field = None;
            self.done = COMPASS_SETTINGS;
        }
        Ok(())
    }

    fn rest(&mut self, now: Instant) {
        self.running.next = Next::Look;
        self.wait_until = Some(now + POLL);
    }

    fn take_field(&mut self) -> Result<(), SensorError> {
        let Some(data) = self.buffer.first_chunk() else {
            return Ok(());
        };
        let running = &mut self.running;
        running.compass_idle = 0;
        if running.readings.same(data) >= STUCK_READINGS {
            return Err(Chip::Compass.is(SensorFault::Stuck));
        }
        let numbers = triple(data);
        running.field = Some(vector(numbers, lis3mdl::FIELD));
        self.extent.add(numbers);
        self.reports += 1;
        if self.reports == REPORT {
            self.reports = 0;
            let [[a, b, c], [x, y, z]] = self.extent.in_ut();
            debug!(
                "middle of the compass's readings: {},{},{} uT, half of their extent: {},{},{}",
                a, b, c, x, y, z
            );
        }
        Ok(())
    }

    /// The next sample of the words that were read.
    pub(super) fn sample(&mut self) -> Result<Option<Sample>, SensorError> {
        let running = &mut self.running;
        while let Some([word, ..]) = self
            .buffer
            .get(running.unread.clone())
            .map(<[u8]>::as_chunks::<WORD>)
            .map(|(words, _)| words)
        {
            running.unread.start += WORD;
            let Some((data, periods)) = running.slots.take(word)? else {
                continue;
            };
            running.idle = 0;
            if running.samples.same(&data) >= STUCK_SAMPLES {
                return Err(Chip::Motion.is(SensorFault::Stuck));
            }
            let elapsed = running.period_us.saturating_mul(periods);
            self.time_us = self.time_us.saturating_add(elapsed);
            if running.settled < SETTLING {
                running.settled += 1;
                continue;
            }
            let (angular_rate, acceleration) = lsm6dsox::in_si(&data);
            let Some(acceleration) = self.scale.apply(acceleration)? else {
                // What was measured so far is of another scale.
                self.time_us = self.time_us.saturating_add(GAP_US);
                continue;
            };
            return Ok(Some(Sample {
                time_us: self.time_us,
                acceleration,
                angular_rate,
                field: running.field.take(),
            }));
        }
        Ok(None)
    }
}

impl Running {
    /// The setting that is checked next, and of which chip.
    fn check(&self) -> (Chip, What) {
        match SCRIPT.get(usize::from(SETTINGS + self.checked)) {
            Some(&Act::Ask(chip, What::Set(setting))) => (chip, What::Check(setting)),
            _ => {
                debug_assert!(false, "behind the settings");
                (Chip::Motion, What::Waiting)
            }
        }
    }

    /// At how much there is to read.
    fn looked(&mut self) -> Result<(), SensorError> {
        self.idle += 1;
        self.compass_idle += 1;
        for (chip, idle) in [
            (Chip::Motion, self.idle),
            (Chip::Compass, self.compass_idle),
        ] {
            if idle > SILENT {
                return Err(chip.is(SensorFault::Silent));
            }
        }
        Ok(())
    }
}
