#![doc = include_str!("../README.md")]
//!
//! | module | what it knows |
//! |---|---|
//! | [`hdlc`] | frames on a line of bytes |
//! | [`frame`], [`property`], [`stream`], [`status`] | commands and properties as types, read and written in both directions, so that an emulated co-processor can use them too |
//! | [`session`] | the dialogue as a state machine: reset, check, configure, transmit, receive, restore |
//!
//! [`SpinelRadio`] connects the last one to a UART and a clock and is a [`Radio`]. Source of the
//! protocol: draft-rquattle-spinel-unified, and the properties that OpenThread has added.
//!
//! The crate builds on `zigbee-link` for its seam to the hardware, and for nothing above it: the
//! [`Radio`] trait with its configuration, the [`Clock`] and the addresses and fields of IEEE
//! 802.15.4. `zigbee-link` knows nothing of this crate.
//!
//! # Requirements on the UART
//! - `read` may be dropped while it waits without losing bytes, as buffered UARTs do. `write` has no requirement:
//!   when it is dropped, the command is sent again.
//! - A receive buffer for the bytes between two calls, at 115200 baud 12 bytes a millisecond; or hardware flow
//!   control.
//!
//! A radio that only listens sets no timer.
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

#[cfg(test)]
extern crate std;

pub mod frame;
pub mod hdlc;
pub mod property;
pub mod session;
pub mod status;
pub mod stream;

mod fault;
mod identity;
mod policy;

use core::{fmt, future::pending};

use embassy_futures::select::{Either, select};
use embedded_io_async::{Read, Write};

pub use fault::RcpFault;
pub use heapless;
pub use identity::Identity;
pub use policy::RcpPolicy;
pub use zigbee_link;

use session::{RcpOutcome, RcpRequest, RcpSession};
use zigbee_link::{
    radio::{PSDU_MAX, Radio, RadioConfig, Received, TxOutcome},
    runner::Clock,
};

/// Most bytes that are read or written at once.
const CHUNK: usize = 32;

/// Reason why a call failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RcpError<E> {
    /// The UART failed.
    Uart(E),
    /// The UART has come to its end: the port was closed.
    Closed,
    /// The co-processor failed, or the request is impossible.
    Radio(RcpFault),
}

impl<E: fmt::Display> fmt::Display for RcpError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Uart(error) => write!(f, "UART: {error}"),
            Self::Closed => f.write_str("the UART is closed"),
            Self::Radio(fault) => fault.fmt(f),
        }
    }
}

impl<E: core::error::Error> core::error::Error for RcpError<E> {
    /// The text holds that of the cause already.
    fn source(&self) -> Option<&(dyn core::error::Error + 'static)> {
        match self {
            Self::Uart(error) => error.source(),
            Self::Closed | Self::Radio(_) => None,
        }
    }
}

impl<E> From<RcpFault> for RcpError<E> {
    fn from(fault: RcpFault) -> Self {
        Self::Radio(fault)
    }
}

/// A radio co-processor on a UART, with room for `QUEUE` received frames.
///
/// After any error but [`RcpFault::NotConfigured`] the calls go on to work as soon as the co-processor
/// does: it is reset and configured again first. Only a `configure` that failed has to be repeated.
#[derive(Debug)]
pub struct SpinelRadio<U, C, const QUEUE: usize = 4> {
    uart: U,
    clock: C,
    session: RcpSession<QUEUE>,
    /// A write is under way, or was dropped.
    writing: bool,
}

impl<U, C, const QUEUE: usize> SpinelRadio<U, C, QUEUE> {
    /// A co-processor of which nothing is known. Nothing is sent before the first call.
    pub const fn new(uart: U, clock: C) -> Self {
        Self::with_policy(uart, clock, RcpPolicy::DEFAULT)
    }

    /// The same with other times and counts.
    pub const fn with_policy(uart: U, clock: C, policy: RcpPolicy) -> Self {
        Self {
            uart,
            clock,
            session: RcpSession::new(policy),
            writing: false,
        }
    }

    /// The UART and the clock.
    pub fn release(self) -> (U, C) {
        (self.uart, self.clock)
    }

    /// The dialogue: the identity of the co-processor, and the faults that went by unnoticed.
    pub const fn session(&self) -> &RcpSession<QUEUE> {
        &self.session
    }
}

impl<U: Read + Write, C: Clock, const QUEUE: usize> SpinelRadio<U, C, QUEUE> {
    fn begin(&mut self, request: RcpRequest<'_>) {
        let now = self.clock.now();
        if self.writing {
            self.writing = false;
            self.session.output_lost(now);
        }
        self.session.begin(request, now);
    }

    /// Carries bytes and time to the session until the request ends.
    async fn run(&mut self, request: RcpRequest<'_>) -> Result<RcpOutcome, RcpError<U::Error>> {
        self.begin(request);
        loop {
            if let Some(outcome) = self.session.outcome() {
                return Ok(outcome?);
            }
            self.progress().await?;
        }
    }

    /// Sends the bytes that are to be sent, or waits for bytes, until the deadline.
    async fn progress(&mut self) -> Result<(), RcpError<U::Error>> {
        let Self {
            uart,
            clock,
            session,
            writing,
        } = self;
        let deadline = session.deadline();
        let elapsed = async {
            match deadline {
                Some(deadline) => clock.sleep_until(deadline).await,
                None => pending().await,
            }
        };
        if session.wants_to_send() {
            // A line that takes no bytes must not hold up the caller for ever.
            if let Either::First(sent) = select(send(uart, session, writing), elapsed).await {
                return sent.map_err(RcpError::Uart);
            }
        } else {
            let mut chunk = [0; CHUNK];
            if let Either::First(len) = select(uart.read(&mut chunk), elapsed).await {
                match len.map_err(RcpError::Uart)? {
                    0 => return Err(RcpError::Closed),
                    len => session.input(chunk.get(..len).unwrap_or(&chunk), clock.now()),
                }
            }
        }
        session.tick(clock.now());
        Ok(())
    }
}

async fn send<U: Write, const QUEUE: usize>(
    uart: &mut U,
    session: &mut RcpSession<QUEUE>,
    writing: &mut bool,
) -> Result<(), U::Error> {
    let mut chunk = [0; CHUNK];
    *writing = true;
    loop {
        let len = session.output(&mut chunk);
        let Some(bytes) = chunk.get(..len).filter(|bytes| !bytes.is_empty()) else {
            break;
        };
        uart.write_all(bytes).await?;
    }
    uart.flush().await?;
    *writing = false;
    Ok(())
}

impl<U: Read + Write, C: Clock, const QUEUE: usize> Radio for SpinelRadio<U, C, QUEUE> {
    type Error = RcpError<U::Error>;

    async fn configure(&mut self, config: &RadioConfig) -> Result<(), Self::Error> {
        self.run(RcpRequest::Configure(*config)).await.map(|_| ())
    }

    async fn transmit(&mut self, frame: &[u8]) -> Result<TxOutcome, Self::Error> {
        match self.run(RcpRequest::Transmit(frame)).await? {
            RcpOutcome::Transmitted(outcome) => Ok(outcome),
            RcpOutcome::Configured => Err(RcpError::Radio(RcpFault::NotConfigured)),
        }
    }

    async fn receive(&mut self, buffer: &mut [u8; PSDU_MAX]) -> Result<Received, Self::Error> {
        self.begin(RcpRequest::Listen);
        loop {
            if let Some(Err(fault)) = self.session.outcome() {
                return Err(fault.into());
            }
            if let Some(received) = self.session.receive(buffer) {
                return Ok(received);
            }
            self.progress().await?;
        }
    }
}
