//! A node at work: the sans-IO parts connected to a radio, a store and a clock.
//!
//! [`Shared`] holds the node, [`run`] drives it, and the methods of [`Shared`] send and receive
//! meanwhile. All of them run on one executor, joined or as tasks.
//!
//! Cancelling [`run`] is harmless: the node is as after a loss of power in the same moment.

use core::{cell::Cell, fmt, future::Future};

use embassy_futures::select::{Either3, select3};
use embassy_sync::{blocking_mutex::raw::NoopRawMutex, signal::Signal};
use embedded_hal_async::delay::DelayNs;
use embedded_storage_async::nor_flash::NorFlash;
use serde::{Serialize, de::DeserializeOwned};

use self::exclusive::Exclusive;
use crate::{
    Instant,
    link::{Delivery, Effort, SendError, Ticket},
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

/// The delay of drivers, from the clock of the node: a board tells the time once.
#[derive(Clone, Copy, Debug, Default)]
pub struct Delay<C>(pub C);

impl<C: Clock> DelayNs for Delay<C> {
    fn delay_ns(&mut self, ns: u32) -> impl Future<Output = ()> {
        let Instant(now) = self.0.now();
        let micros = u64::from(ns).div_ceil(1000);
        self.0.sleep_until(Instant(now.saturating_add(micros)))
    }
}

/// Reason why a node stopped.
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

impl<R, F> From<StoreError<F>> for RunnerError<R, F> {
    fn from(error: StoreError<F>) -> Self {
        Self::Store(error)
    }
}

/// Event of a node.
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
    node: Exclusive<Node<PEERS, QUEUE, MEMBERS>>,
    clock: C,
    /// For the runner: the application changed something.
    changed: Signal<NoopRawMutex, ()>,
    /// For the caller that waits in [`recv`](Self::recv).
    received: Signal<NoopRawMutex, ()>,
    /// For the caller that waits in [`send`](Self::send).
    settled: Signal<NoopRawMutex, ()>,
    /// For the caller that waits in [`happened`](Self::happened).
    happened: Signal<NoopRawMutex, ()>,
    /// The status that the caller of `happened` knows.
    known: Cell<NetworkStatus>,
}

impl<C: Clock, const PEERS: usize, const QUEUE: usize, const MEMBERS: usize>
    Shared<C, PEERS, QUEUE, MEMBERS>
{
    /// Shares a node.
    // for less stack
    #[inline(always)]
    pub const fn new(node: Node<PEERS, QUEUE, MEMBERS>, clock: C) -> Self {
        Self {
            node: Exclusive::new(node),
            clock,
            changed: Signal::new(),
            received: Signal::new(),
            settled: Signal::new(),
            happened: Signal::new(),
            known: Cell::new(NetworkStatus::Out),
        }
    }

    /// Does something with the node, at the time now.
    ///
    /// `act` cannot use the same [`Shared`], which is why it has to be [`Send`]: what captures a
    /// [`Shared`] is not.
    ///
    /// ```
    /// # use zigbee_link::runner::{Clock, Shared};
    /// fn status_twice<C: Clock>(shared: &Shared<C, 4, 4, 1>) {
    ///     shared.with(|node, _| node.status());
    ///     shared.with(|node, _| node.status());
    /// }
    /// ```
    ///
    /// ```compile_fail,E0277
    /// # use zigbee_link::runner::{Clock, Shared};
    /// fn status_nested<C: Clock>(shared: &Shared<C, 4, 4, 1>) {
    ///     shared.with(|_, _| shared.with(|node, _| node.status()));
    /// }
    /// ```
    ///
    /// `None`, and nothing was done, only where it came back all the same: through a thread's local, or because an
    /// `unsafe` declaration lets several threads use the [`Shared`].
    pub fn with<T>(
        &self,
        act: impl FnOnce(&mut Node<PEERS, QUEUE, MEMBERS>, Instant) -> T + Send,
    ) -> Option<T> {
        let now = self.clock.now();
        let result = self.node.with(|node| act(node, now));
        self.changed.signal(());
        result
    }

    /// Wakes the waiting callers for which there is something.
    fn wake(&self) {
        let waiting = self.node.with(|node| {
            let link = &node.link;
            (link.has_result(), link.has_message(), node.status())
        });
        let Some((result, message, status)) = waiting else {
            return;
        };
        if result {
            self.settled.signal(());
        }
        if message {
            self.received.signal(());
        }
        if result || message || status != self.known.get() {
            self.happened.signal(());
        }
    }

    /// Returns true while the node has nothing to do before it is woken: [`Node::is_quiet`].
    pub fn is_quiet(&self) -> bool {
        self.node.with(|node| node.is_quiet()) == Some(true)
    }

    /// Sends a message, whose result comes by [`happened`](Self::happened) or
    /// [`Link::result_of`](crate::link::Link::result_of).
    ///
    /// # Errors
    /// The message was not taken, see [`SendError`].
    pub fn post<T: Serialize + Sync + ?Sized>(
        &self,
        destination: ShortAddress,
        message: &T,
    ) -> Result<Ticket, SendError> {
        self.post_with(destination, message, Effort::Acknowledged)
    }

    /// The same, with less effort if that is wanted: [`Link::send_with`](crate::link::Link::send_with).
    ///
    /// # Errors
    /// The message was not taken, see [`SendError`].
    pub fn post_with<T: Serialize + Sync + ?Sized>(
        &self,
        destination: ShortAddress,
        message: &T,
        effort: Effort,
    ) -> Result<Ticket, SendError> {
        let sent = self.with(|node, now| node.link.send_with(now, destination, message, effort));
        // Not taken, and worth another attempt, as by a full queue.
        sent.unwrap_or(Err(SendError::QueueFull))
    }

    /// Sends a message and waits for its result. One task at a time may wait; others
    /// [`post`](Self::post).
    ///
    /// Dropping the future does not take the message back. Its result then keeps its place in the
    /// queue until [`Link::result`](crate::link::Link::result) fetches it.
    ///
    /// # Errors
    /// The message was not taken, see [`SendError`].
    pub async fn send<T: Serialize + Sync + ?Sized>(
        &self,
        destination: ShortAddress,
        message: &T,
    ) -> Result<Delivery, SendError> {
        let ticket = self.post(destination, message)?;
        loop {
            match self.node.with(|node| node.link.result_of(ticket)).flatten() {
                Some(delivery) => return Ok(delivery),
                None => self.settled.wait().await,
            }
        }
    }

    /// Waits for the next message that decodes as a `T`. Cancel-safe. One task at a time may wait.
    pub async fn recv<T: DeserializeOwned>(&self) -> (ShortAddress, T) {
        loop {
            match self.node.with(|node| node.link.recv()).flatten() {
                Some(message) => return message,
                None => self.received.wait().await,
            }
        }
    }

    /// Waits for the next event of any kind: for an application that is one loop. Cancel-safe. One task at a time
    /// may wait, and none in [`send`](Self::send) or [`recv`](Self::recv) meanwhile.
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
        let happened = self.node.with(|node| {
            if let Some((ticket, delivery)) = node.link.result() {
                return Some(Happened::Settled(ticket, delivery));
            }
            if let Some((from, message)) = node.link.recv() {
                return Some(Happened::Message(from, message));
            }
            let status = node.status();
            (status != known).then_some(Happened::Status(status))
        });
        happened.flatten()
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
        let action = shared
            .node
            .with(|node| node.poll(now, &mut frame))
            .flatten();
        shared.wake();
        match action {
            Some(Action::Save(record)) => {
                if let Err(error) = store.save(record).await {
                    return error.into();
                }
                shared.node.with(|node| node.saved(record));
            }
            Some(Action::Configure(config)) => {
                if let Err(error) = radio.configure(&config).await {
                    return RunnerError::Radio(error);
                }
                is_configured = true;
            }
            Some(Action::Transmit(len)) => {
                // The result of the transmission does not matter: what matters is acknowledged end to end.
                debug_assert!(len <= frame.len());
                let sent = radio.transmit(frame.get(..len).unwrap_or_default()).await;
                if let Err(error) = sent {
                    return RunnerError::Radio(error);
                }
            }
            None => {
                let deadline = shared.node.with(|node| node.deadline()).flatten();
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
                        let strength = reception.strength();
                        shared
                            .node
                            .with(|node| node.handle_at(now, frame, strength));
                    }
                    Either3::First(Err(error)) => return RunnerError::Radio(error),
                    Either3::Second(()) | Either3::Third(()) => {}
                }
            }
        }
    }
}

/// A value that several tasks of one executor use, one after the other.
mod exclusive {
    use core::cell::{RefCell, RefMut};

    /// A value that is used by one closure at a time. It lends no guard that a caller could keep, and a closure
    /// that captures what it is in is not [`Send`]: so no caller uses it twice at once.
    pub(super) struct Exclusive<T>(RefCell<T>);

    impl<T> Exclusive<T> {
        // for less stack
        #[inline(always)]
        pub(super) const fn new(value: T) -> Self {
            Self(RefCell::new(value))
        }

        /// Uses the value. `None` if it is in use.
        pub(super) fn with<R>(&self, act: impl FnOnce(&mut T) -> R + Send) -> Option<R> {
            self.value().map(|mut value| act(&mut value))
        }

        // for less flash
        #[inline(never)]
        fn value(&self) -> Option<RefMut<'_, T>> {
            let value = self.0.try_borrow_mut();
            debug_assert!(value.is_ok(), "the node is in use already");
            value.ok()
        }
    }
}
