//! A UART that plays a script, and time that passes only in delays.
#![allow(dead_code, reason = "not every test needs everything")]

use std::{
    cell::{Cell, RefCell},
    collections::VecDeque,
    future::Future,
    pin::pin,
    rc::Rc,
    task::{Context, Poll, Waker},
};

use cmucam2_driver::{Cmucam2, Error, device::Call};

/// Bytes that come when the host has sent something.
#[derive(Clone, Default)]
struct Exchange {
    expected: Vec<u8>,
    replies: Vec<(u64, Vec<u8>)>,
}

#[derive(Default)]
struct State {
    now: Cell<u64>,
    script: RefCell<VecDeque<Exchange>>,
    sent: RefCell<Vec<u8>>,
    /// All that was ever sent.
    transcript: RefCell<Vec<u8>>,
    incoming: RefCell<VecDeque<(u64, u8)>>,
    /// Reads return so many bytes at most.
    chunk: Cell<usize>,
    /// True if anything may be sent without a script.
    deaf: Cell<bool>,
    fail_read: Cell<bool>,
    /// Byte that a line that never falls silent carries.
    babble: Cell<Option<u8>>,
}

/// A script under construction.
#[derive(Clone, Default)]
pub(crate) struct Script {
    exchanges: VecDeque<Exchange>,
    chunk: usize,
}

impl Script {
    pub(crate) fn new() -> Self {
        Self {
            exchanges: VecDeque::new(),
            chunk: 5,
        }
    }

    /// The stop sequence as an idle camera answers it.
    pub(crate) fn idle() -> Self {
        Self::new().on("\r", "ACK\r:").on("\r", "ACK\r:")
    }

    /// The stop sequence as a streaming camera answers it.
    pub(crate) fn stopped(self) -> Self {
        self.on("\r", ":").on("\r", "ACK\r:")
    }

    /// When exactly this was sent, that comes after a millisecond.
    pub(crate) fn on(self, expected: &str, reply: impl AsRef<[u8]>) -> Self {
        self.on_bytes(expected.as_bytes(), reply)
    }

    pub(crate) fn on_bytes(mut self, expected: &[u8], reply: impl AsRef<[u8]>) -> Self {
        self.exchanges.push_back(Exchange {
            expected: expected.to_vec(),
            replies: vec![(1_000, reply.as_ref().to_vec())],
        });
        self
    }

    /// And this so many microseconds later.
    pub(crate) fn then(mut self, after_us: u64, reply: impl AsRef<[u8]>) -> Self {
        let exchange = self.exchanges.back_mut().unwrap();
        exchange.replies.push((after_us, reply.as_ref().to_vec()));
        self
    }

    pub(crate) fn chunk(mut self, bytes: usize) -> Self {
        self.chunk = bytes;
        self
    }

    pub(crate) fn open(self) -> (MockUart, MockDelay) {
        let state = Rc::new(State::default());
        *state.script.borrow_mut() = self.exchanges;
        state.chunk.set(self.chunk);
        (MockUart(state.clone()), MockDelay(state))
    }

    pub(crate) fn camera(self) -> (Cmucam2<MockUart, MockDelay>, MockUart) {
        let (uart, delay) = self.open();
        let line = MockUart(uart.0.clone());
        (Cmucam2::new(uart, delay), line)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Overrun;

impl std::fmt::Display for Overrun {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("overrun")
    }
}

impl std::error::Error for Overrun {}

impl embedded_io::Error for Overrun {
    fn kind(&self) -> embedded_io::ErrorKind {
        embedded_io::ErrorKind::Other
    }
}

pub(crate) struct MockUart(Rc<State>);

impl std::fmt::Debug for MockUart {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("MockUart")
    }
}

impl MockUart {
    /// The whole script was played.
    #[track_caller]
    pub(crate) fn assert_finished(&self) {
        let left: Vec<_> = self
            .0
            .script
            .borrow()
            .iter()
            .map(|exchange| String::from_utf8_lossy(&exchange.expected).into_owned())
            .collect();
        assert!(left.is_empty(), "never sent: {left:?}");
    }

    /// Number of exchanges that were not played yet.
    pub(crate) fn left(&self) -> usize {
        self.0.script.borrow().len()
    }

    /// From now on nothing is answered.
    pub(crate) fn unplug(&self) {
        self.0.deaf.set(true);
        self.0.script.borrow_mut().clear();
        self.0.incoming.borrow_mut().clear();
    }

    /// From now on another script is played.
    pub(crate) fn replace(&self, script: Script) {
        self.0.incoming.borrow_mut().clear();
        self.0.sent.borrow_mut().clear();
        *self.0.script.borrow_mut() = script.exchanges;
    }

    pub(crate) fn fail_next_read(&self) {
        self.0.fail_read.set(true);
    }

    pub(crate) fn babble(&self, byte: u8) {
        self.unplug();
        self.0.babble.set(Some(byte));
    }

    /// These come now, unasked.
    pub(crate) fn inject(&self, bytes: impl AsRef<[u8]>) {
        let now = self.0.now.get();
        let mut incoming = self.0.incoming.borrow_mut();
        incoming.extend(bytes.as_ref().iter().map(|&byte| (now, byte)));
    }

    pub(crate) fn transcript(&self) -> String {
        String::from_utf8_lossy(&self.0.transcript.borrow()).into_owned()
    }

    pub(crate) fn now(&self) -> u64 {
        self.0.now.get()
    }

    fn ready(&self) -> bool {
        let due = |&(at, _): &(u64, u8)| at <= self.0.now.get();
        self.0.fail_read.get()
            || self.0.babble.get().is_some()
            || self.0.incoming.borrow().front().is_some_and(due)
    }

    fn take(&self, buffer: &mut [u8]) -> Result<usize, Overrun> {
        if self.0.fail_read.replace(false) {
            return Err(Overrun);
        }
        if let Some(byte) = self.0.babble.get() {
            buffer[0] = byte;
            return Ok(1);
        }
        let mut incoming = self.0.incoming.borrow_mut();
        let mut count = 0;
        while count < buffer.len().min(self.0.chunk.get()) {
            match incoming.front() {
                Some(&(at, byte)) if at <= self.0.now.get() => buffer[count] = byte,
                _ => break,
            }
            incoming.pop_front();
            count += 1;
        }
        Ok(count)
    }

    fn put(&self, bytes: &[u8]) -> usize {
        let bytes = &bytes[..bytes.len().min(self.0.chunk.get())];
        self.0.transcript.borrow_mut().extend_from_slice(bytes);
        if self.0.deaf.get() {
            return bytes.len();
        }
        let mut sent = self.0.sent.borrow_mut();
        sent.extend_from_slice(bytes);
        let mut script = self.0.script.borrow_mut();
        let Some(next) = script.front() else {
            panic!("not in the script: {:?}", String::from_utf8_lossy(&sent));
        };
        assert!(
            next.expected.starts_with(&sent),
            "sent {:?} instead of {:?}, all: {:?}",
            String::from_utf8_lossy(&sent),
            String::from_utf8_lossy(&next.expected),
            self.transcript(),
        );
        if *sent == next.expected {
            sent.clear();
            let exchange = script.pop_front().unwrap();
            let mut at = self.0.now.get();
            let mut incoming = self.0.incoming.borrow_mut();
            for (after, reply) in exchange.replies {
                at += after;
                incoming.extend(reply.into_iter().map(|byte| (at, byte)));
            }
        }
        bytes.len()
    }
}

impl embedded_io::ErrorType for MockUart {
    type Error = Overrun;
}

impl embedded_io::Read for MockUart {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Overrun> {
        assert!(self.ready(), "would block for ever");
        self.take(buffer)
    }
}

impl embedded_io::ReadReady for MockUart {
    fn read_ready(&mut self) -> Result<bool, Overrun> {
        Ok(self.ready())
    }
}

impl embedded_io::Write for MockUart {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Overrun> {
        Ok(self.put(bytes))
    }

    fn flush(&mut self) -> Result<(), Overrun> {
        Ok(())
    }
}

impl embedded_io_async::Read for MockUart {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Overrun> {
        std::future::poll_fn(|_| {
            if self.ready() {
                Poll::Ready(self.take(buffer))
            } else {
                Poll::Pending
            }
        })
        .await
    }
}

impl embedded_io_async::Write for MockUart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Overrun> {
        Ok(self.put(bytes))
    }

    async fn flush(&mut self) -> Result<(), Overrun> {
        Ok(())
    }
}

pub(crate) struct MockDelay(Rc<State>);

impl embedded_hal::delay::DelayNs for MockDelay {
    fn delay_ns(&mut self, ns: u32) {
        self.0
            .now
            .set(self.0.now.get() + u64::from(ns / 1_000).max(1));
    }
}

impl embedded_hal_async::delay::DelayNs for MockDelay {
    /// Time passes a little each time it is looked at.
    async fn delay_ns(&mut self, ns: u32) {
        let until = self.0.now.get() + u64::from(ns / 1_000);
        std::future::poll_fn(|_| {
            if self.0.now.get() >= until {
                return Poll::Ready(());
            }
            self.0.now.set(self.0.now.get() + 100);
            Poll::Pending
        })
        .await;
    }
}

/// One of the two ways to drive a call.
pub(crate) trait Drive {
    fn drive<T>(call: Call<'_, MockUart, MockDelay, T>) -> Result<T, Error<Overrun>>;
}

pub(crate) struct Blocking;

impl Drive for Blocking {
    fn drive<T>(call: Call<'_, MockUart, MockDelay, T>) -> Result<T, Error<Overrun>> {
        call.wait()
    }
}

pub(crate) struct Async;

impl Drive for Async {
    fn drive<T>(call: Call<'_, MockUart, MockDelay, T>) -> Result<T, Error<Overrun>> {
        let mut future = pin!(call.run());
        let mut context = Context::from_waker(Waker::noop());
        loop {
            if let Poll::Ready(result) = future.as_mut().poll(&mut context) {
                return result;
            }
        }
    }
}

/// Runs the same test over both.
#[macro_export]
macro_rules! both {
    ($($(#[$meta:meta])* fn $name:ident<$drive:ident>() $body:block)*) => { $(
        $(#[$meta])*
        mod $name {
            use super::*;
            fn test<$drive: Drive>() $body
            #[test]
            fn blocking() { test::<Blocking>() }
            #[test]
            fn asynchronous() { test::<Async>() }
        }
    )* };
}
