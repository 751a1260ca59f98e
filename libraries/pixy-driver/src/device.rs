//! The camera behind a UART: 8 data bits, no parity, one stop bit, no flow control.
//!
//! Every request of [`Pixy`] returns a [`Call`]. It is driven by [`Call::run`] when the UART and the delay are async
//! ones, by [`Call::wait`] when they block; both only carry bytes and time to and from the [`Session`], where the
//! dialogue is decided.
//!
//! A call that is dropped before its end leaves nothing behind: the next one begins anew. Async: `read`
//! may be dropped while it waits without losing bytes, as buffered UARTs do. Blocking: `ReadReady`,
//! because `Read` alone waits for ever.

use core::{
    fmt,
    future::{Future, poll_fn},
    marker::PhantomData,
    pin::{Pin, pin},
    task::Poll,
};

use crate::{
    model::Model,
    packet::{Request, Signatures},
    session::{Answer, Blocks, Fault, Policy, Session, Version},
};

/// The longest pause, microseconds: time is counted in these.
const SLICE_US: u32 = 5_000;

/// Bytes read at once.
const CHUNK: usize = 32;

/// Reason why a call failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Error<E> {
    /// The UART failed. The call may be repeated.
    Uart(E),
    /// The UART has come to its end: the port was closed.
    Closed,
    /// The camera failed, or its answer.
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

/// A camera of the family on a UART. It counts its own delays, and needs no clock.
#[derive(Debug)]
pub struct Pixy<U, D> {
    uart: U,
    delay: D,
    session: Session,
    now: u64,
}

impl<U, D> Pixy<U, D> {
    /// Nothing is sent before the first call.
    pub fn new(model: Model, uart: U, delay: D) -> Self {
        Self::with_policy(model, uart, delay, Policy::default())
    }

    /// The same with other times and counts.
    pub fn with_policy(model: Model, uart: U, delay: D, policy: Policy) -> Self {
        Self {
            uart,
            delay,
            session: Session::new(model, policy),
            now: 0,
        }
    }

    /// The model that it was said to be.
    pub fn model(&self) -> Model {
        self.session.model()
    }

    /// The UART and the delay.
    pub fn release(self) -> (U, D) {
        (self.uart, self.delay)
    }

    /// The UART, which may be switched off between two calls, unless the model streams.
    pub fn uart(&mut self) -> &mut U {
        &mut self.uart
    }

    /// The dialogue: the model, and the blobs of the last answer.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Any request to the [session](crate::session), with its answer as it is: where each kind of answer in a program of
    /// its own would take too much flash.
    pub fn request(&mut self, request: Request) -> Call<'_, U, D, Answer> {
        self.call(request)
    }

    /// Version of the camera. Waits for one that is starting.
    pub fn version(&mut self) -> Call<'_, U, D, Version> {
        self.call(Request::Version)
    }

    /// Columns and rows of the frames in which it finds blobs: 316 and 208.
    pub fn resolution(&mut self) -> Call<'_, U, D, (u16, u16)> {
        self.call(Request::Resolution)
    }

    /// The largest blobs of these signatures in the next frame, the largest first; at most so many.
    pub fn blocks(&mut self, of: Signatures, most: u8) -> Call<'_, U, D, Blocks<'_>> {
        self.call(Request::Blocks { of, most })
    }

    fn call<T>(&mut self, request: Request) -> Call<'_, U, D, T> {
        Call {
            camera: self,
            request,
            reply: PhantomData,
        }
    }

    /// The reply to the request that was driven.
    fn driven<'a, T: Reply<'a>, E>(
        &'a mut self,
        asked: Result<Answer, Error<E>>,
    ) -> Result<T, Error<E>> {
        if !matches!(asked, Err(Error::Camera(_)) | Ok(_)) {
            self.session.line_error();
        }
        // The session answers with no other kind than it was asked for.
        T::of(asked?, &self.session).ok_or(Error::Camera(Fault::Garbled))
    }

    /// Longest wait for bytes.
    fn slice(&self, most: u32) -> u32 {
        let left = self.session.deadline().unwrap_or(self.now);
        let left = left.saturating_sub(self.now);
        u32::try_from(left).unwrap_or(most).min(most).max(1)
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

/// Gives bytes to the session; bytes after an answer are dropped, those of a stream are not.
fn feed(session: &mut Session, now: u64, bytes: &[u8]) -> Option<Result<Answer, Fault>> {
    for &byte in bytes {
        session.receive(byte, now);
    }
    session.outcome()
}

/// So much time has passed.
fn passed(session: &mut Session, now: &mut u64, micros: u32) -> Option<Result<Answer, Fault>> {
    *now = now.saturating_add(micros.into());
    session.tick(*now);
    session.outcome()
}

/// A request to the camera, to be answered by a `T`. Does nothing until it is driven.
#[must_use = "a call does nothing until it is driven by `run().await` or `wait()`"]
pub struct Call<'a, U, D, T> {
    camera: &'a mut Pixy<U, D>,
    request: Request,
    reply: PhantomData<fn() -> T>,
}

/// Value that a [`Call`] returns, out of an answer. Sealed.
pub trait Reply<'a>: Sized + sealed::Sealed {
    /// `None` for an answer of another kind: the session gives none.
    #[doc(hidden)]
    fn of(answer: Answer, session: &'a Session) -> Option<Self>;
}

mod sealed {
    pub trait Sealed {}
}

impl sealed::Sealed for Answer {}

impl Reply<'_> for Answer {
    fn of(answer: Answer, _: &Session) -> Option<Self> {
        Some(answer)
    }
}

impl sealed::Sealed for Version {}

impl Reply<'_> for Version {
    fn of(answer: Answer, _: &Session) -> Option<Self> {
        match answer {
            Answer::Version(version) => Some(version),
            _ => None,
        }
    }
}

impl sealed::Sealed for (u16, u16) {}

impl Reply<'_> for (u16, u16) {
    fn of(answer: Answer, _: &Session) -> Option<Self> {
        match answer {
            Answer::Resolution(columns, rows) => Some((columns, rows)),
            _ => None,
        }
    }
}

impl sealed::Sealed for Blocks<'_> {}

impl<'a> Reply<'a> for Blocks<'a> {
    fn of(_: Answer, session: &'a Session) -> Option<Self> {
        Some(session.blocks())
    }
}

impl<'a, U, D, T: Reply<'a>> Call<'a, U, D, T>
where
    U: embedded_io_async::Read + embedded_io_async::Write,
    D: embedded_hal_async::delay::DelayNs,
{
    /// Drives the call over async traits.
    ///
    /// # Errors
    /// [`Error`].
    pub async fn run(self) -> Result<T, Error<U::Error>> {
        let camera = self.camera;
        camera.session.begin(self.request, camera.now);
        let asked = camera.drive().await;
        camera.driven(asked)
    }
}

impl<U, D> Pixy<U, D>
where
    U: embedded_io_async::Read + embedded_io_async::Write,
    D: embedded_hal_async::delay::DelayNs,
{
    /// For all kinds of answers, so that an image has it once.
    async fn drive(&mut self) -> Result<Answer, Error<U::Error>> {
        loop {
            if !self.session.pending().is_empty() {
                let sent = self.uart.write(self.session.pending()).await;
                self.session.sent(sent.map_err(Error::Uart)?);
                if self.session.pending().is_empty() {
                    self.uart.flush().await.map_err(Error::Uart)?;
                }
                continue;
            }
            let slice = self.slice(SLICE_US);
            let Self {
                uart,
                delay,
                session,
                now,
            } = self;
            let mut pause = pin!(delay.delay_us(slice));
            // The pause goes on while bytes come.
            let outcome = loop {
                let mut chunk = [0; CHUNK];
                let (read, mut is_over) = first(uart.read(&mut chunk), pause.as_mut()).await;
                match read {
                    Some(Ok(0)) => return Err(Error::Closed),
                    Some(Ok(count)) => {
                        let bytes = chunk.get(..count).unwrap_or_default();
                        let outcome = feed(session, *now, bytes);
                        if outcome.is_some() || !session.pending().is_empty() {
                            break outcome;
                        }
                    }
                    // Streams overrun a UART that is not read all the time.
                    Some(Err(_)) if session.model().streams() => {
                        session.damaged();
                        if !is_over {
                            pause.as_mut().await;
                            is_over = true;
                        }
                    }
                    Some(Err(error)) => return Err(Error::Uart(error)),
                    None => {}
                }
                if is_over {
                    break passed(session, now, slice);
                }
            };
            if let Some(outcome) = outcome {
                return outcome.map_err(Error::Camera);
            }
        }
    }
}

impl<'a, U, D, T: Reply<'a>> Call<'a, U, D, T>
where
    U: embedded_io::Read + embedded_io::Write + embedded_io::ReadReady,
    D: embedded_hal::delay::DelayNs,
{
    /// Drives the call, blocking.
    ///
    /// # Errors
    /// [`Error`].
    pub fn wait(self) -> Result<T, Error<U::Error>> {
        let camera = self.camera;
        camera.session.begin(self.request, camera.now);
        let asked = camera.drive_wait();
        camera.driven(asked)
    }
}

impl<U, D> Pixy<U, D>
where
    U: embedded_io::Read + embedded_io::Write + embedded_io::ReadReady,
    D: embedded_hal::delay::DelayNs,
{
    fn drive_wait(&mut self) -> Result<Answer, Error<U::Error>> {
        loop {
            if !self.session.pending().is_empty() {
                let sent = self.uart.write(self.session.pending());
                self.session.sent(sent.map_err(Error::Uart)?);
                if self.session.pending().is_empty() {
                    self.uart.flush().map_err(Error::Uart)?;
                }
                continue;
            }
            let outcome = if self.uart.read_ready().map_err(Error::Uart)? {
                let mut chunk = [0; CHUNK];
                let outcome = match self.uart.read(&mut chunk) {
                    Ok(0) => return Err(Error::Closed),
                    Ok(count) => {
                        let bytes = chunk.get(..count).unwrap_or_default();
                        feed(&mut self.session, self.now, bytes)
                    }
                    Err(_) if self.session.model().streams() => {
                        self.session.damaged();
                        None
                    }
                    Err(error) => return Err(Error::Uart(error)),
                };
                // Time must pass under chatter, too; this is less than the truth.
                outcome.or_else(|| passed(&mut self.session, &mut self.now, 1))
            } else {
                let pause = self.slice(self.session.policy().poll_us.max(1));
                self.delay.delay_us(pause);
                passed(&mut self.session, &mut self.now, pause)
            };
            if let Some(outcome) = outcome {
                return outcome.map_err(Error::Camera);
            }
        }
    }
}
