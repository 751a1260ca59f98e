//! The camera behind a UART.
//!
//! Every method of [`Cmucam2`] returns a [`Call`]. It is driven by [`Call::run`] when the UART and
//! the delay are async ones, by [`Call::wait`] when they block; both only carry bytes and time to
//! and from the [`Session`], where the dialogue is decided.
//!
//! # Requirements on the UART and the delay
//! - 8 data bits, no parity, one stop bit, no flow control, at the rate set by the jumpers.
//! - A receive buffer that holds the bytes between two calls: at 38400 baud 4 bytes a millisecond. A stream
//!   sends whether it is read or not.
//! - Async: `read` may be dropped while it waits without losing bytes, as buffered UARTs do.
//! - Blocking: [`embedded_io::ReadReady`], because `Read` alone waits for ever and could not tell silence.
//!   Where a UART can only be tried, the feature `embedded-hal-nb` has a `ReadReady` over a one-byte peek:
//!   `serial::Peek`.
//!
//! # Time
//! The driver needs the time to know how long it has waited, and stamps packets with it: the program's clock, as a
//! closure ([`Cmucam2::with_clock`]). Without one it counts its own delays ([`SummedDelays`]): slices of at most 10 ms when async, and nothing
//! between two calls.
//!
//! # Streams
//! [`track_colour`](Cmucam2::track_colour) and [`stream`](Cmucam2::stream) begin a stream;
//! [`next_packet`](Cmucam2::next_packet) reads it. Any other command stops the camera first; the
//! next `next_packet` starts the same stream again, until [`stop`](Cmucam2::stop). In poll mode
//! each `next_packet` asks for one.
//!
//! A call that is dropped before its end leaves the camera in a state that the next call clears
//! up.

mod commands;
#[cfg(feature = "full")]
mod full;
mod time;

use core::{
    fmt,
    future::{Future, poll_fn},
    pin::{Pin, pin},
    task::Poll,
};

pub use time::{SummedDelays, TimeSource};

use crate::session::{Answer, Fault, Modes, Policy, Request, Session};

/// Longest delay of the async driver. [`SummedDelays`] stands still for less than this when bytes
/// come.
const SLICE_US: u32 = 10_000;

/// Number of bytes that are read at once.
const CHUNK: usize = 32;

/// Reason why a call failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Error<E> {
    /// The UART failed. The call may be repeated.
    Uart(E),
    /// The UART has come to its end: the port was closed.
    Closed,
    /// The camera failed, or its answer was wrong.
    Camera(Fault),
}

impl<E: fmt::Display> fmt::Display for Error<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Uart(error) => write!(f, "UART: {error}"),
            Self::Closed => f.write_str("the UART is closed"),
            Self::Camera(fault) => fault.fmt(f),
        }
    }
}

impl<E: core::error::Error> core::error::Error for Error<E> {
    /// The text holds that of the cause already.
    fn source(&self) -> Option<&(dyn core::error::Error + 'static)> {
        match self {
            Self::Uart(error) => error.source(),
            Self::Closed | Self::Camera(_) => None,
        }
    }
}

impl<E> From<Fault> for Error<E> {
    fn from(fault: Fault) -> Self {
        Self::Camera(fault)
    }
}

/// Bytes that were read but not yet looked at: they belong to the next call.
#[derive(Debug)]
struct Received {
    bytes: [u8; CHUNK],
    from: u8,
    to: u8,
}

impl Received {
    fn filled(&mut self, bytes: usize) {
        self.from = 0;
        self.to = bytes.min(CHUNK) as u8;
    }

    /// Gives bytes to the session until it answers, wants to send, or there are no more.
    fn feed(
        &mut self,
        session: &mut Session,
        now: u64,
        row: &mut [u8],
    ) -> Option<Result<Answer, Fault>> {
        loop {
            let outcome = session.outcome();
            if outcome.is_some() || !session.pending().is_empty() || self.from >= self.to {
                return outcome;
            }
            let byte = *self.bytes.get(usize::from(self.from))?;
            self.from += 1;
            session.receive(byte, now, row);
        }
    }
}

/// A CMUcam2 on a UART.
#[derive(Debug)]
pub struct Cmucam2<U, D, K = SummedDelays> {
    uart: U,
    delay: D,
    clock: K,
    session: Session,
    received: Received,
}

impl<U, D> Cmucam2<U, D> {
    /// A camera of which nothing is known. Nothing is sent before the first call.
    pub fn new(uart: U, delay: D) -> Self {
        Self::with_policy(uart, delay, Policy::default())
    }

    /// The same with other times and counts.
    pub fn with_policy(uart: U, delay: D, policy: Policy) -> Self {
        Self::with_clock(uart, delay, SummedDelays::default(), policy)
    }
}

impl<U, D, K> Cmucam2<U, D, K> {
    /// The same with a clock, which counts the time between two calls, too: see [`Session::packet_at`].
    pub fn with_clock(uart: U, delay: D, clock: K, policy: Policy) -> Self {
        Self {
            uart,
            delay,
            clock,
            session: Session::new(policy),
            received: Received {
                bytes: [0; CHUNK],
                from: 0,
                to: 0,
            },
        }
    }

    /// The UART and the delay.
    pub fn release(self) -> (U, D) {
        (self.uart, self.delay)
    }

    /// The UART, which may be switched off between two calls while the camera sleeps.
    pub fn uart(&mut self) -> &mut U {
        &mut self.uart
    }

    /// The dialogue: modes, dropped bytes, number of restarts of the camera.
    pub fn session(&self) -> &Session {
        &self.session
    }

    fn call<T>(&mut self, request: Request, convert: Convert<T>) -> Call<'_, U, D, T, K> {
        Call {
            camera: self,
            request,
            row: &mut [],
            payload: &[],
            convert,
        }
    }
}

type Convert<T> = fn(Answer, &Modes) -> Option<T>;

/// A request to the camera. Does nothing until it is driven.
#[must_use = "a call does nothing until it is driven by `run().await` or `wait()`"]
pub struct Call<'a, U, D, T, K = SummedDelays> {
    camera: &'a mut Cmucam2<U, D, K>,
    request: Request,
    /// Buffer for a row.
    row: &'a mut [u8],
    /// Raw bytes that follow the command.
    payload: &'a [u8],
    convert: Convert<T>,
}

impl<U, D, T, K: TimeSource> Call<'_, U, D, T, K>
where
    U: embedded_io_async::Read + embedded_io_async::Write,
    D: embedded_hal_async::delay::DelayNs,
{
    /// Drives the call over async traits.
    ///
    /// # Errors
    /// [`Error`].
    pub async fn run(self) -> Result<T, Error<U::Error>> {
        let answer = self
            .camera
            .drive(self.request, self.row, self.payload)
            .await?;
        let session = &self.camera.session;
        (self.convert)(answer, session.modes()).ok_or_else(|| session.unexpected().into())
    }
}

impl<U, D, K: TimeSource> Cmucam2<U, D, K>
where
    U: embedded_io_async::Read + embedded_io_async::Write,
    D: embedded_hal_async::delay::DelayNs,
{
    /// For all kinds of answers, so that an image has it once.
    async fn drive(
        &mut self,
        request: Request,
        row: &mut [u8],
        payload: &[u8],
    ) -> Result<Answer, Error<U::Error>> {
        let Self {
            uart,
            delay,
            clock,
            session,
            received,
        } = self;
        session.begin(request, clock.now());
        let error = loop {
            match send_async(uart, session, payload, clock).await {
                Ok(()) => {}
                Err(error) => break error,
            }
            if let Some(outcome) = received.feed(session, clock.now(), row) {
                return outcome.map_err(Error::Camera);
            }
            if !session.pending().is_empty() {
                continue;
            }
            let slice = slice(session, clock.now());
            let mut pause = pin!(delay.delay_us(slice));
            // The pause goes on while bytes come.
            let error = loop {
                let (read, is_over) = first(uart.read(&mut received.bytes), pause.as_mut()).await;
                match read {
                    Some(Ok(0)) => break Some(Error::Closed),
                    Some(Ok(bytes)) => {
                        received.filled(bytes);
                        if let Some(outcome) = received.feed(session, clock.now(), row) {
                            return outcome.map_err(Error::Camera);
                        }
                    }
                    Some(Err(error)) => break Some(Error::Uart(error)),
                    None => {}
                }
                if is_over {
                    clock.passed(slice);
                    session.tick(clock.now());
                }
                if is_over || !session.pending().is_empty() || session.payload_due() {
                    break None;
                }
            };
            if let Some(error) = error {
                break error;
            }
        };
        session.line_error();
        Err(error)
    }
}

/// The result of a read, if it came, and true if the pause is over. Both are asked each time, the read first: a pause
/// that takes no time, as that of a mock, hides no byte, and time passes under chatter, too.
async fn first<T>(
    read: impl Future<Output = T>,
    mut pause: Pin<&mut impl Future<Output = ()>>,
) -> (Option<T>, bool) {
    let mut read = pin!(read);
    poll_fn(|context| {
        let read = match read.as_mut().poll(context) {
            Poll::Ready(read) => Some(read),
            Poll::Pending => None,
        };
        let is_over = pause.as_mut().poll(context).is_ready();
        if read.is_some() || is_over {
            Poll::Ready((read, is_over))
        } else {
            Poll::Pending
        }
    })
    .await
}

async fn send_async<U: embedded_io_async::Write, K: TimeSource>(
    uart: &mut U,
    session: &mut Session,
    payload: &[u8],
    clock: &K,
) -> Result<(), Error<U::Error>> {
    if session.pending().is_empty() && !session.payload_due() {
        return Ok(());
    }
    while !session.pending().is_empty() {
        let sent = uart.write(session.pending()).await.map_err(Error::Uart)?;
        session.sent(sent);
    }
    if session.payload_due() {
        uart.write_all(payload).await.map_err(Error::Uart)?;
        session.payload_sent(clock.now());
    }
    uart.flush().await.map_err(Error::Uart)
}

impl<U, D, T, K: TimeSource> Call<'_, U, D, T, K>
where
    U: embedded_io::Read + embedded_io::Write + embedded_io::ReadReady,
    D: embedded_hal::delay::DelayNs,
{
    /// Drives the call, blocking.
    ///
    /// # Errors
    /// [`Error`].
    pub fn wait(self) -> Result<T, Error<U::Error>> {
        let Self {
            camera:
                Cmucam2 {
                    uart,
                    delay,
                    clock,
                    session,
                    received,
                },
            request,
            row,
            payload,
            convert,
        } = self;
        session.begin(request, clock.now());
        let error = loop {
            if let Err(error) = send(uart, session, payload, clock.now()) {
                break error;
            }
            if let Some(outcome) = received.feed(session, clock.now(), row) {
                let answer = outcome?;
                return convert(answer, session.modes()).ok_or_else(|| session.unexpected().into());
            }
            if !session.pending().is_empty() || session.payload_due() {
                continue;
            }
            match uart.read_ready() {
                Ok(true) => match uart.read(&mut received.bytes) {
                    Ok(0) => break Error::Closed,
                    Ok(bytes) => {
                        received.filled(bytes);
                        // The clock must run under chatter, too; this is less than the truth.
                        clock.passed(1);
                    }
                    Err(error) => break Error::Uart(error),
                },
                Ok(false) => {
                    let pause = slice(session, clock.now()).min(session.policy().poll_us.max(1));
                    delay.delay_us(pause);
                    clock.passed(pause);
                }
                Err(error) => break Error::Uart(error),
            }
            session.tick(clock.now());
        };
        session.line_error();
        Err(error)
    }
}

fn send<U: embedded_io::Write>(
    uart: &mut U,
    session: &mut Session,
    payload: &[u8],
    now: u64,
) -> Result<(), Error<U::Error>> {
    if session.pending().is_empty() && !session.payload_due() {
        return Ok(());
    }
    while !session.pending().is_empty() {
        let sent = uart.write(session.pending()).map_err(Error::Uart)?;
        session.sent(sent);
    }
    if session.payload_due() {
        uart.write_all(payload).map_err(Error::Uart)?;
        session.payload_sent(now);
    }
    uart.flush().map_err(Error::Uart)
}

/// Longest time to wait for bytes.
fn slice(session: &Session, now: u64) -> u32 {
    let left = session.deadline().map_or(0, |at| at.saturating_sub(now));
    u32::try_from(left).unwrap_or(SLICE_US).min(SLICE_US)
}
