//! A node at work: the sans-IO parts connected to a radio, a store and a clock.
//!
//! [`Shared`] holds the node, [`run`] drives it, and the methods of [`Shared`] send and receive
//! meanwhile. All of them run on one executor, joined or as tasks.
//!
//! Cancelling [`run`] is harmless: the node is as after a loss of power in the same moment.

use core::{
    cell::{Cell, RefCell, RefMut},
    fmt,
    future::Future,
};

use embassy_futures::select::{Either3, select3};
use embassy_sync::{blocking_mutex::raw::NoopRawMutex, signal::Signal};
use embedded_storage_async::nor_flash::NorFlash;
use serde::{Serialize, de::DeserializeOwned};

use crate::{
    Instant,
    link::{Delivery, SendError, Ticket},
    network::{Action, NetworkStatus, Node},
    radio::{FRAME_MAX, PSDU_MAX, Radio},
    store::{Store, StoreError},
    wire::ShortAddress,
};

/// The time, and waiting for it.
pub trait Clock {
    /// The time now.
    fn now(&self) -> Instant;

    /// Returns at `time` or soon after.
    fn sleep_until(&self, time: Instant) -> impl Future<Output = ()>;
}

impl<C: Clock> Clock for &C {
    fn now(&self) -> Instant {
        C::now(self)
    }

    fn sleep_until(&self, time: Instant) -> impl Future<Output = ()> {
        C::sleep_until(self, time)
    }
}

/// Why a node stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RunnerError<R, F> {
    /// The radio failed.
    Radio(R),
    /// The store failed. Nothing may be sent any more.
    Store(StoreError<F>),
}

impl<R, F> fmt::Display for RunnerError<R, F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Radio(_) => f.write_str("the radio failed"),
            Self::Store(error) => error.fmt(f),
        }
    }
}

impl<R: fmt::Debug, F: fmt::Debug> core::error::Error for RunnerError<R, F> {}

/// What happened to a node.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Happened<T> {
    /// A message came.
    Message(ShortAddress, T),
    /// A message that was sent has its result.
    Settled(Ticket, Delivery),
    /// The node's place in the network changed.
    Status(NetworkStatus),
}

/// A node that [`run`] and the application share.
pub struct Shared<C, const PEERS: usize, const QUEUE: usize, const MEMBERS: usize> {
    node: RefCell<Node<PEERS, QUEUE, MEMBERS>>,
    clock: C,
    /// For the runner: the application changed something.
    changed: Signal<NoopRawMutex, ()>,
    /// For whoever waits in [`recv`](Self::recv).
    received: Signal<NoopRawMutex, ()>,
    /// For whoever waits in [`send`](Self::send).
    settled: Signal<NoopRawMutex, ()>,
    /// For whoever waits in [`happened`](Self::happened).
    happened: Signal<NoopRawMutex, ()>,
    /// The status that it knows.
    known: Cell<NetworkStatus>,
}

impl<C: Clock, const PEERS: usize, const QUEUE: usize, const MEMBERS: usize>
    Shared<C, PEERS, QUEUE, MEMBERS>
{
    /// Shares a node.
    // stack
    #[inline(always)]
    pub const fn new(node: Node<PEERS, QUEUE, MEMBERS>, clock: C) -> Self {
        Self {
            node: RefCell::new(node),
            clock,
            changed: Signal::new(),
            received: Signal::new(),
            settled: Signal::new(),
            happened: Signal::new(),
            known: Cell::new(NetworkStatus::Out),
        }
    }

    /// The node, borrowed for a statement by one of the tasks of one executor, and so free. In one
    /// place, and without a branch to a panic: to a watchdog it is the same whether a node that breaks
    /// this stops or goes round.
    #[inline(never)] // size
    fn node(&self) -> RefMut<'_, Node<PEERS, QUEUE, MEMBERS>> {
        loop {
            let node = self.node.try_borrow_mut();
            debug_assert!(node.is_ok(), "the node is borrowed already");
            if let Ok(node) = node {
                return node;
            }
        }
    }

    /// Does something with the node, at the time now.
    ///
    /// `act` must not itself call a method of the same [`Shared`]: it would never return, or panic where
    /// assertions are checked.
    pub fn with<T>(&self, act: impl FnOnce(&mut Node<PEERS, QUEUE, MEMBERS>, Instant) -> T) -> T {
        let result = act(&mut self.node(), self.clock.now());
        self.changed.signal(());
        result
    }

    /// Wakes who waits for what there is.
    fn wake(&self) {
        let node = self.node();
        let (result, message) = (node.link.has_result(), node.link.has_message());
        if result {
            self.settled.signal(());
        }
        if message {
            self.received.signal(());
        }
        if result || message || node.status() != self.known.get() {
            self.happened.signal(());
        }
    }

    /// Sends a message and waits for its result. One task at a time may wait; others use
    /// [`Link::send`](crate::link::Link::send) through [`with`](Self::with).
    ///
    /// Dropping the future does not take the message back. Its result then keeps its place in the
    /// queue until [`Link::result`](crate::link::Link::result) fetches it.
    ///
    /// # Errors
    /// The message was not taken, see [`SendError`].
    pub async fn send<T: Serialize + ?Sized>(
        &self,
        destination: ShortAddress,
        message: &T,
    ) -> Result<Delivery, SendError> {
        let ticket = self.with(|node, now| node.link.send(now, destination, message))?;
        loop {
            let result = self.node().link.result_of(ticket);
            match result {
                Some(delivery) => return Ok(delivery),
                None => self.settled.wait().await,
            }
        }
    }

    /// Waits for the next message that decodes as a `T`. Cancel-safe. One task at a time may wait.
    pub async fn recv<T: DeserializeOwned>(&self) -> (ShortAddress, T) {
        loop {
            let message = self.node().link.recv();
            match message {
                Some(message) => return message,
                None => self.received.wait().await,
            }
        }
    }

    /// Waits for whatever happens next: for an application that is one loop. Cancel-safe. One task
    /// at a time may wait, and nobody in [`send`](Self::send) or [`recv`](Self::recv) meanwhile.
    ///
    /// `status` is the one the application knows.
    pub async fn happened<T: DeserializeOwned>(&self, status: NetworkStatus) -> Happened<T> {
        self.known.set(status);
        loop {
            match self.take(status) {
                Some(happened) => return happened,
                None => self.happened.wait().await,
            }
        }
    }

    fn take<T: DeserializeOwned>(&self, known: NetworkStatus) -> Option<Happened<T>> {
        let mut node = self.node();
        if let Some((ticket, delivery)) = node.link.result() {
            return Some(Happened::Settled(ticket, delivery));
        }
        if let Some((from, message)) = node.link.recv() {
            return Some(Happened::Message(from, message));
        }
        let status = node.status();
        (status != known).then_some(Happened::Status(status))
    }
}

/// Drives a node. Returns only when something failed.
///
/// The store must have been loaded, and the node made from that.
///
/// # Errors
/// The radio or the store failed.
pub async fn run<R, F, C, const PEERS: usize, const QUEUE: usize, const MEMBERS: usize>(
    shared: &Shared<C, PEERS, QUEUE, MEMBERS>,
    radio: &mut R,
    store: &mut Store<F>,
) -> RunnerError<R::Error, F::Error>
where
    R: Radio,
    F: NorFlash,
    C: Clock,
{
    let mut frame = [0; FRAME_MAX];
    let mut received = [0; PSDU_MAX];
    // A radio need not receive before it is configured.
    let mut is_configured = false;
    loop {
        let now = shared.clock.now();
        let action = shared.node().poll(now, &mut frame);
        shared.wake();
        match action {
            Some(Action::Save(record)) => {
                if let Err(error) = store.save(record).await {
                    return RunnerError::Store(error);
                }
                shared.node().saved(record);
            }
            Some(Action::Configure(config)) => {
                if let Err(error) = radio.configure(&config).await {
                    return RunnerError::Radio(error);
                }
                is_configured = true;
            }
            Some(Action::Transmit(len)) => {
                // Whatever became of it: what matters is acknowledged end to end.
                debug_assert!(len <= frame.len());
                let sent = radio.transmit(frame.get(..len).unwrap_or_default()).await;
                if let Err(error) = sent {
                    return RunnerError::Radio(error);
                }
            }
            None => {
                let deadline = shared.node().deadline();
                let receive = async {
                    if is_configured {
                        radio.receive(&mut received).await
                    } else {
                        core::future::pending().await
                    }
                };
                let sleep = async {
                    match deadline {
                        Some(deadline) => shared.clock.sleep_until(deadline).await,
                        None => core::future::pending().await,
                    }
                };
                match select3(receive, sleep, shared.changed.wait()).await {
                    Either3::First(Ok(reception)) => {
                        let now = shared.clock.now();
                        debug_assert!(reception.len <= received.len());
                        let frame = received.get_mut(..reception.len).unwrap_or_default();
                        shared.node().handle(now, frame);
                    }
                    Either3::First(Err(error)) => return RunnerError::Radio(error),
                    Either3::Second(()) | Either3::Third(()) => {}
                }
            }
        }
    }
}
