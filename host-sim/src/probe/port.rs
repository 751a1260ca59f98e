//! A serial port as the UART of the driver.

use std::{
    collections::VecDeque,
    fmt, io,
    os::fd::OwnedFd,
    path::Path,
    str::FromStr,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use cmucam2_driver::{
    Cmucam2, Command, Error,
    session::{Fault, Policy},
};
use rustix::{
    fs::{Mode, OFlags},
    termios::{OptionalActions, isatty, tcgetattr, tcsetattr},
};
use serialport::{SerialPort, SerialPortInfo};

use super::{
    Device,
    stranger::{self, HEARD_MAX, Stranger},
};

/// The rates that the camera's jumpers can select, the likeliest first: the fastest, and the
/// thesis's.
pub const BAUD_RATES: [u32; 8] = [115_200, 38_400, 57_600, 19_200, 9_600, 4_800, 2_400, 1_200];

/// Sized for the slowest line: a command takes 0.3 s at 1200 baud.
const WRITE_TIMEOUT: Duration = Duration::from_secs(5);

/// Time for a camera's answers to the way out of raw mode: 17 characters at the slowest rate that a
/// host uses before it, and as many back.
const LEAVING: Duration = Duration::from_millis(300);

/// Period with which a quiet line is looked at. The operating system keeps the bytes that come in between.
const POLL_US: u32 = 1_000;

/// Silences after which something is wrong, longer than a board's: an adapter on USB holds bytes back. So does
/// a busy computer, where the camera is another program on it.
const REPLY_US: u32 = 1_000_000;
const DRAIN_US: u32 = 300_000;
const SETTLE_US: u32 = 100_000;

/// Number of times that the stop sequence is repeated at each rate, by round. The second round is for
/// noisy lines, and for cameras that were just switched on and slept through the right rate.
const SEARCH_RETRIES: [u8; 2] = [1, 3];

/// Silence after which a rate is given up: twelve characters of the slowest one.
const SEARCH_DRAIN_US: u32 = 100_000;

/// Rates at which the line is listened to when something talks without being asked: as an original Pixy is
/// shipped, and others that people set.
const OVERHEARD_RATES: [u32; 6] = [19_200, 115_200, 57_600, 38_400, 230_400, 9_600];

/// Time at each rate: ten pictures of an original Pixy.
const OVERHEARD: Duration = Duration::from_millis(200);

/// Bits per second, or to be found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Baud {
    /// This one.
    Rate(u32),
    /// All that are usual for the camera are tried.
    Auto,
}

impl Baud {
    /// The same, if a CMUcam2 can have it.
    ///
    /// # Errors
    /// Rate that the camera's jumpers select.
    pub fn of_jumpers(self) -> Result<Self, String> {
        match self {
            Self::Rate(rate) if !BAUD_RATES.contains(&rate) => Err(format!(
                "--baud {rate}: the camera's jumpers select {}; `auto` tries them all",
                BAUD_RATES.map(|rate| rate.to_string()).join(", ")
            )),
            baud => Ok(baud),
        }
    }
}

impl FromStr for Baud {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        match text.parse() {
            Ok(rate) if rate > 0 => Ok(Self::Rate(rate)),
            _ => Err("a number of bits per second, or `auto`".to_owned()),
        }
    }
}

/// Reason why a port cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// There is no such device.
    #[error("{path} does not exist: {} {}", advice(.path), list(.found))]
    Missing {
        /// The path that was asked for.
        path: String,
        /// Serial ports of this computer.
        found: Vec<String>,
    },
    /// The user may not open it.
    #[error(
        "{path} may not be opened by you: add yourself to the group that owns it (usually \
         `sudo usermod -aG dialout $USER`) and log in again"
    )]
    Forbidden {
        /// The path that was asked for.
        path: String,
    },
    /// Another program has it.
    #[error(
        "{path} is in use: close the terminal program or the other probe that has it open \
         (`fuser {path}` names it)"
    )]
    Busy {
        /// The path that was asked for.
        path: String,
    },
    /// Something else, such as a path of something else.
    #[error("{path} cannot be used as a serial port: {reason}. {}", list(.found))]
    Unusable {
        /// The path that was asked for.
        path: String,
        /// The operating system's answer.
        reason: String,
        /// Serial ports of this computer.
        found: Vec<String>,
    },
}

/// Folder of devices.
const DEVICES: &str = "/dev";

fn advice(path: &str) -> String {
    match Path::new(path).starts_with(DEVICES) {
        true => "is the adapter plugged in?".to_owned(),
        false => format!(
            "if it is that of a simulation, start that first: `host-sim run SITE --console {path}`, or of one camera \
             `host-sim camera --pty {path}`."
        ),
    }
}

fn list(found: &[String]) -> String {
    if found.is_empty() {
        "No serial port was found on this computer".to_owned()
    } else {
        format!("Serial ports found: {}", found.join(", "))
    }
}

/// The serial ports of this computer, as far as it tells.
pub(super) fn available() -> Vec<SerialPortInfo> {
    // The library panics where this folder is missing, as in some containers.
    if cfg!(target_os = "linux") && !Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    serialport::available_ports().unwrap_or_default()
}

fn ports() -> Vec<String> {
    let found = available().into_iter();
    let mut names: Vec<_> = found.map(|port| port.port_name).collect();
    names.sort();
    names
}

/// The last bytes that came in.
#[derive(Clone, Debug, Default)]
pub struct Heard(Arc<Mutex<VecDeque<u8>>>);

impl Heard {
    fn push(&self, bytes: &[u8]) {
        if let Ok(mut heard) = self.0.lock() {
            heard.extend(bytes);
            let over = heard.len().saturating_sub(HEARD_MAX);
            heard.drain(..over);
        }
    }

    fn forget(&self) {
        if let Ok(mut heard) = self.0.lock() {
            heard.clear();
        }
    }

    /// These bytes, the oldest first.
    pub fn bytes(&self) -> Vec<u8> {
        let heard = self.0.lock();
        heard.map_or_else(|_| Vec::new(), |heard| heard.iter().copied().collect())
    }
}

/// A line to a device, with the clock by which it is waited for: a serial port, or an emulated camera in virtual
/// time. Errors are those of the operating system.
pub trait Wire: Send {
    /// Time since it was opened.
    fn now(&self) -> Duration;
    /// Lets so much time pass.
    fn sleep(&mut self, time: Duration);
    /// Sets the rate, bits per second.
    fn set_baud_rate(&mut self, rate: u32) -> io::Result<()>;
    /// Tells whether bytes have come.
    fn is_ready(&mut self) -> io::Result<bool>;
    /// Reads bytes, one at least.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize>;
    /// Writes bytes, one at least.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize>;
    /// Waits until all is sent.
    fn flush(&mut self) -> io::Result<()>;
    /// Drops what has come.
    fn clear(&mut self) -> io::Result<()>;
}

/// A serial port, in real time.
struct Serial {
    port: Box<dyn SerialPort>,
    /// The same device.
    modes: Option<OwnedFd>,
    opened: Instant,
}

impl Serial {
    fn open(path: &str, baud_rate: u32) -> Result<Self, OpenError> {
        // Before the port is locked; where it is already, that is told below.
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let modes = rustix::fs::open(path, flags, Mode::empty()).ok();
        let port = open(path, baud_rate, WRITE_TIMEOUT)?;
        let opened = Instant::now();
        let this = Self {
            port,
            modes,
            opened,
        };
        this.name_rate(baud_rate);
        Ok(this)
    }

    /// The library sets every rate as a number. Programs at the other end of a pseudo-terminal that only know
    /// the usual rates by their names see none then, so these are set by name.
    fn name_rate(&self, rate: u32) {
        let named = self.modes.as_ref().and_then(|device| {
            let mut modes = tcgetattr(device).ok()?;
            modes.set_speed(rate).ok()?;
            tcsetattr(device, OptionalActions::Now, &modes).ok()
        });
        // The rate itself is set in any case.
        named.unwrap_or_default();
    }
}

impl Wire for Serial {
    fn now(&self) -> Duration {
        self.opened.elapsed()
    }

    fn sleep(&mut self, time: Duration) {
        thread::sleep(time);
    }

    fn set_baud_rate(&mut self, rate: u32) -> io::Result<()> {
        self.port.set_baud_rate(rate)?;
        self.name_rate(rate);
        Ok(())
    }

    fn is_ready(&mut self) -> io::Result<bool> {
        Ok(self.port.bytes_to_read()? > 0)
    }

    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.port.read(buffer)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.port.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.port.flush()
    }

    fn clear(&mut self) -> io::Result<()> {
        Ok(self.port.clear(serialport::ClearBuffer::Input)?)
    }
}

/// The clock of a line, and the delay of a driver.
#[derive(Clone)]
pub struct Clock(Arc<Mutex<dyn Wire>>);

impl Clock {
    fn wire(&self) -> MutexGuard<'_, dyn Wire + 'static> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Time since the line was opened.
    pub fn now(&self) -> Duration {
        self.wire().now()
    }

    fn sleep(&self, time: Duration) {
        self.wire().sleep(time);
    }
}

impl fmt::Debug for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Clock").finish_non_exhaustive()
    }
}

impl embedded_hal::delay::DelayNs for Clock {
    fn delay_ns(&mut self, ns: u32) {
        self.sleep(Duration::from_nanos(u64::from(ns)));
    }
}

/// An open line. A serial port has 8 data bits, no parity, one stop bit, no flow control.
pub struct Port {
    clock: Clock,
    interrupted: Arc<AtomicBool>,
    heard: Heard,
}

impl Port {
    /// Opens a port. As soon as `interrupted` is set every call on it fails with
    /// [`PortError::Interrupted`].
    ///
    /// # Errors
    /// [`OpenError`]
    pub fn open(
        path: &str,
        baud_rate: u32,
        interrupted: Arc<AtomicBool>,
    ) -> Result<Self, OpenError> {
        let wire = Arc::new(Mutex::new(Serial::open(path, baud_rate)?));
        Ok(Self::on(wire, interrupted))
    }

    /// A port on another line.
    pub fn on(wire: Arc<Mutex<dyn Wire>>, interrupted: Arc<AtomicBool>) -> Self {
        Self {
            clock: Clock(wire),
            interrupted,
            heard: Heard::default(),
        }
    }

    /// The clock of its line.
    pub fn clock(&self) -> Clock {
        self.clock.clone()
    }

    /// The last bytes that came, also after the port was given away.
    pub fn heard(&self) -> Heard {
        self.heard.clone()
    }

    /// Tells a camera that was left in a raw mode to leave it. A camera that takes raw commands
    /// understands the first form, one that only suppresses its acknowledgements the second.
    ///
    /// # Errors
    /// Those of the port.
    fn leave_raw_modes(&mut self) -> Result<(), PortError> {
        self.send_all(b"\rRM\x01\x00\rRM 0\r\r")?;
        self.clock.sleep(LEAVING);
        // The answers belong to none of the driver's commands.
        self.patiently(|wire| wire.clear())
    }

    fn send_all(&mut self, mut bytes: &[u8]) -> Result<(), PortError> {
        while !bytes.is_empty() {
            let sent = self.patiently(|wire| wire.write(bytes))?;
            bytes = bytes.get(sent..).unwrap_or_default();
        }
        Ok(())
    }

    fn set_baud_rate(&mut self, rate: u32) -> Result<(), PortError> {
        self.patiently(|wire| wire.set_baud_rate(rate))
    }

    /// Returns true if any byte comes within a while. The bytes are dropped.
    fn is_busy(&mut self) -> Result<bool, PortError> {
        let begun = self.clock.now();
        while self.clock.now().saturating_sub(begun) < SILENT {
            if self.patiently(|wire| wire.is_ready())? {
                self.patiently(|wire| wire.clear())?;
                self.clock.sleep(SILENT / 10);
                return Ok(true);
            }
            self.clock.sleep(SILENT / 10);
        }
        Ok(false)
    }

    /// Device that talks without being asked, if that can be told at one of the usual rates.
    fn overhear(&mut self) -> Result<Option<Overheard>, PortError> {
        for rate in OVERHEARD_RATES {
            self.set_baud_rate(rate)?;
            self.patiently(|wire| wire.clear())?;
            self.heard.forget();
            let begun = self.clock.now();
            while self.clock.now().saturating_sub(begun) < OVERHEARD {
                if self.patiently(|wire| wire.is_ready())? {
                    embedded_io::Read::read(self, &mut [0; HEARD_MAX])?;
                }
                self.clock.sleep(OVERHEARD / 20);
            }
            let heard = self.heard.bytes();
            if let Some(who) = stranger::name(&heard).filter(|who| who.talks_unasked()) {
                return Ok(Some(Overheard { rate, heard, who }));
            }
        }
        Ok(None)
    }

    /// Does it again when a signal has cut it short that does not mean Ctrl-C.
    fn patiently<T>(
        &mut self,
        mut call: impl FnMut(&mut dyn Wire) -> io::Result<T>,
    ) -> Result<T, PortError> {
        loop {
            if self.interrupted.load(Ordering::Relaxed) {
                return Err(PortError::Interrupted);
            }
            match call(&mut *self.clock.wire()) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                done => return Ok(done?),
            }
        }
    }
}

/// Opens a serial port whose calls wait at most so long.
pub(crate) fn open(
    path: &str,
    baud_rate: u32,
    timeout: Duration,
) -> Result<Box<dyn SerialPort>, OpenError> {
    serialport::new(path, baud_rate)
        .timeout(timeout)
        .open()
        .map_err(|error| open_error(path.to_owned(), &error))
}

/// Returns false for what is certainly no terminal.
fn is_terminal(path: &str) -> bool {
    let flags = OFlags::RDONLY | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    rustix::fs::open(path, flags, Mode::empty()).map_or(true, isatty)
}

fn open_error(path: String, error: &serialport::Error) -> OpenError {
    use serialport::ErrorKind;
    match error.kind() {
        ErrorKind::NoDevice if Path::new(&path).exists() => OpenError::Busy { path },
        ErrorKind::NoDevice | ErrorKind::Io(io::ErrorKind::NotFound) => OpenError::Missing {
            path,
            found: ports(),
        },
        ErrorKind::Io(io::ErrorKind::PermissionDenied) => OpenError::Forbidden { path },
        _ => OpenError::Unusable {
            // Files and other devices know none of a terminal's calls, and say so in various ways.
            reason: match is_terminal(&path) {
                true if error.to_string().contains("No such device") => {
                    "there is no device behind it: name another port".to_owned()
                }
                true => error.to_string(),
                false => "it is none".to_owned(),
            },
            path,
            found: ports(),
        },
    }
}

impl fmt::Debug for Port {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Port").finish_non_exhaustive()
    }
}

/// Reason why an open port failed.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// The user wants to stop.
    #[error("interrupted")]
    Interrupted,
    /// The operating system's answer.
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl embedded_io::Error for PortError {
    fn kind(&self) -> embedded_io::ErrorKind {
        match self {
            Self::Interrupted => embedded_io::ErrorKind::Interrupted,
            Self::Io(error) => embedded_io::Error::kind(error),
        }
    }
}

impl embedded_io::ErrorType for Port {
    type Error = PortError;
}

impl embedded_io::Read for Port {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, PortError> {
        let count = self.patiently(|wire| wire.read(buffer))?;
        self.heard.push(&buffer[..count]);
        Ok(count)
    }
}

impl embedded_io::ReadReady for Port {
    fn read_ready(&mut self) -> Result<bool, PortError> {
        self.patiently(|wire| wire.is_ready())
    }
}

impl embedded_io::Write for Port {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, PortError> {
        self.patiently(|wire| wire.write(bytes))
    }

    fn flush(&mut self) -> Result<(), PortError> {
        self.patiently(|wire| wire.flush())
    }
}

/// The camera on an open port. Nothing is sent yet.
pub fn device(port: Port) -> Device {
    let clock = port.clock();
    let mut policy = Policy::default();
    policy.reply_us = REPLY_US;
    policy.drain_us = DRAIN_US;
    policy.settle_us = SETTLE_US;
    policy.poll_us = POLL_US;
    Cmucam2::with_policy(port, clock, policy)
}

/// Tells the camera to leave the raw modes, in which other programs leave it: it does not
/// acknowledge commands then, or expects them in binary. The driver's knowledge of it is dropped.
///
/// # Errors
/// Those of the port.
pub fn leave_raw_modes(camera: Device) -> Result<Device, PortError> {
    let mut port = camera.release().0;
    port.leave_raw_modes()?;
    Ok(device(port))
}

/// Time without a byte after which a line counts as silent: twelve characters at 1200 baud, and the
/// pause between two packets of the slowest sensor setting.
const SILENT: Duration = Duration::from_millis(300);

/// Limit for this: a frame at 9600 baud takes 39 s.
const QUIETENED: Duration = Duration::from_secs(45);

/// Something that is no camera, and what it said.
#[derive(Debug)]
pub struct Overheard {
    /// At this rate.
    pub rate: u32,
    /// Its bytes.
    pub heard: Vec<u8>,
    /// Its name.
    pub who: Stranger,
}

impl fmt::Display for Overheard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rate, heard, who } = self;
        write!(f, "at {rate} baud, {who} ({})", stranger::shown(heard))
    }
}

/// Has a camera that sends a stream or a frame end it, whatever its rate, and waits until the line is
/// silent, as far as it ever is; `waiting` is called if there is something to wait for. What is no camera
/// and talks all the time is told instead.
///
/// # Errors
/// Those of the port.
pub fn quieten(
    mut port: Port,
    waiting: impl FnOnce(),
) -> Result<Result<Port, Overheard>, PortError> {
    let begun = port.clock.now();
    let mut was_busy = false;
    let mut waiting = Some(waiting);
    while port.clock.now().saturating_sub(begun) < QUIETENED && port.is_busy()? {
        if let Some(waiting) = waiting.take() {
            waiting();
        }
        if !was_busy {
            was_busy = true;
            if let Some(overheard) = port.overhear()? {
                return Ok(Err(overheard));
            }
            // So it also ends if no caller waits for it.
            for rate in BAUD_RATES {
                port.set_baud_rate(rate)?;
                port.send_all(b"\r")?;
                port.patiently(|wire| wire.flush())?;
                // Some adapters change their rate at once, before they have sent.
                port.clock.sleep(SILENT / 10);
            }
        }
    }
    port.set_baud_rate(BAUD_RATES[0])?;
    Ok(Ok(port))
}

/// Result of trying all rates.
#[derive(Debug)]
pub enum Search {
    /// The camera answers at this rate.
    Found(Port, u32),
    /// Bytes came, but never those of a camera.
    Garbage,
    /// Something else answers.
    Stranger(Overheard),
    /// Not one byte came.
    Silence,
}

/// Tries all of [`BAUD_RATES`] until the camera answers, and again if any byte came; `trying` is
/// called with each rate.
///
/// # Errors
/// Those of the port.
pub fn find_baud_rate(
    mut port: Port,
    mut trying: impl FnMut(u32),
) -> Result<Search, Error<PortError>> {
    let mut heard = false;
    let mut strangers = Vec::new();
    for (round, retries) in (0..).zip(SEARCH_RETRIES) {
        for rate in BAUD_RATES {
            trying(rate);
            port.heard.forget();
            port.set_baud_rate(rate).map_err(Error::Uart)?;
            if round > 0 {
                port.leave_raw_modes().map_err(Error::Uart)?;
            }
            let mut policy = Policy::default();
            policy.poll_us = POLL_US;
            policy.drain_us = SEARCH_DRAIN_US;
            policy.retries = retries;
            let clock = port.clock();
            let mut camera = Cmucam2::with_policy(port, clock, policy);
            let answer = camera.set(Command::Idle).wait();
            port = camera.release().0;
            match answer {
                Ok(()) => return Ok(Search::Found(port, rate)),
                Err(Error::Camera(Fault::Silence)) => {}
                Err(Error::Camera(_)) => {
                    heard = true;
                    let heard = port.heard.bytes();
                    if let Some(who) = stranger::name(&heard) {
                        strangers.push(Overheard { rate, heard, who });
                    }
                }
                Err(error) => return Err(error),
            }
        }
        if !heard {
            return Ok(Search::Silence);
        }
    }
    // At a wrong rate anything may look like one of those that say little.
    strangers.sort_by_key(|found| !found.who.is_certain());
    let first = strangers.into_iter().next();
    Ok(first.map_or(Search::Garbage, Search::Stranger))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_cameras_rates() {
        assert_eq!("38400".parse(), Ok(Baud::Rate(38_400)));
        assert_eq!("auto".parse(), Ok(Baud::Auto));
        assert_eq!(Baud::Auto.of_jumpers(), Ok(Baud::Auto));
        // A Pixy2 can have them, a CMUcam2 cannot.
        for rate in [14_400, 230_400] {
            let baud: Baud = rate.to_string().parse().unwrap();
            assert_eq!(baud, Baud::Rate(rate));
            assert!(baud.of_jumpers().unwrap_err().contains("jumpers"));
        }
        for text in ["0", "38400.0", "-1", "", "fast"] {
            assert!(Baud::from_str(text).unwrap_err().contains("`auto`"));
        }
    }

    /// An original Pixy, which talks without being asked, in virtual time; at another rate its bytes are others.
    struct Streaming {
        now: Duration,
        host_baud: u32,
        baud: u32,
        read: Duration,
    }

    impl Wire for Streaming {
        fn now(&self) -> Duration {
            self.now
        }

        fn sleep(&mut self, time: Duration) {
            self.now += time;
        }

        fn set_baud_rate(&mut self, rate: u32) -> io::Result<()> {
            self.host_baud = rate;
            Ok(())
        }

        fn is_ready(&mut self) -> io::Result<bool> {
            Ok(self.now.saturating_sub(self.read) >= Duration::from_millis(20))
        }

        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            self.read = self.now;
            let frame = b"\x55\xAA\x55\xAA\x43\x01\x01\0\x9E\0\x68\0\x1E\0\x1E\0";
            let garbled = u8::from(self.host_baud != self.baud);
            for (place, byte) in buffer.iter_mut().zip(frame) {
                *place = byte.rotate_left(garbled.into());
            }
            Ok(frame.len())
        }

        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }

        fn clear(&mut self) -> io::Result<()> {
            self.read = self.now;
            Ok(())
        }
    }

    /// A program at the other end may know usual rates by their names only: 0o16 is 19,200 baud, and 0o10000 a
    /// rate that is a number.
    #[cfg(target_os = "linux")]
    #[test]
    fn a_usual_rate_has_its_name() {
        const RATE_BITS: u32 = 0o10017;
        let (_other, end) = serialport::TTYPort::pair().unwrap();
        let name = end.name().unwrap();
        drop(end);
        let mut serial = Serial::open(&name, 19_200).unwrap();
        let mut bits = |rate| {
            serial.set_baud_rate(rate).unwrap();
            let modes = tcgetattr(serial.modes.as_ref().unwrap()).unwrap();
            assert_eq!(modes.output_speed(), rate);
            modes.control_modes.bits() & RATE_BITS
        };
        assert_eq!(bits(19_200), 0o16);
        assert_eq!(bits(14_400), 0o10000);
        assert_eq!(bits(115_200), 0o10002);
    }

    #[test]
    fn what_talks_all_the_time_is_not_waited_for() {
        for baud in [19_200, 230_400] {
            let wire = Streaming {
                now: Duration::ZERO,
                host_baud: BAUD_RATES[0],
                baud,
                read: Duration::ZERO,
            };
            let port = Port::on(Arc::new(Mutex::new(wire)), Arc::default());
            let clock = port.clock();
            let overheard = quieten(port, || {}).unwrap().unwrap_err();
            assert_eq!(
                (overheard.rate, overheard.who),
                (baud, Stranger::OriginalPixy)
            );
            assert!(clock.now() < Duration::from_secs(3), "{:?}", clock.now());
        }
    }

    #[test]
    fn what_the_operating_system_says_becomes_what_to_do() {
        use serialport::{Error, ErrorKind};
        let at = |path: &str, kind| open_error(path.to_owned(), &Error::new(kind, "said so"));
        let of = |kind| at("/dev/null", kind);
        let text = of(ErrorKind::Io(io::ErrorKind::PermissionDenied)).to_string();
        assert!(text.contains("dialout"), "{text}");
        let text = of(ErrorKind::Io(io::ErrorKind::NotFound)).to_string();
        assert!(text.contains("plugged in"), "{text}");
        // The library's word for a port that is locked.
        let text = of(ErrorKind::NoDevice).to_string();
        assert!(text.contains("in use"), "{text}");
        let text = of(ErrorKind::Unknown).to_string();
        assert!(text.contains("serial port: it is none."), "{text}");
        let text = at("/nowhere", ErrorKind::Unknown).to_string();
        assert!(text.contains("said so"), "{text}");
    }
}
