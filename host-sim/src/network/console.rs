//! The PC on a coordinator's line: it knows what the network's users would know.

use std::{
    cell::{Cell, Ref, RefCell},
    collections::{BTreeMap, VecDeque},
    future::{pending, poll_fn},
    io,
    rc::Rc,
    task::{Poll, Waker},
    time::Duration,
};

use embassy_futures::select::{Either3, select3};
use embassy_sync::{blocking_mutex::raw::NoopRawMutex, channel::Channel};
use embedded_io_async::{Read, Write};
use node_firmware::console::{FRAME_MAX, Frames, FromPc, ToPc, encode};
use results::view::NetworkView;

use super::{
    journal::{Moment, SharedJournal},
    node::Node,
};
use virtual_hardware::{
    executor::{Clock, Time},
    line::{Port, Side},
    polled::Polled,
};

/// A terminal on which another program listens to the coordinator, and talks to it.
pub trait Terminal: io::Read + io::Write {}

impl<T: io::Read + io::Write> Terminal for T {}

/// A PC's knowledge of a network.
#[derive(Clone)]
pub(super) struct Console(Rc<Shared>);

struct Shared {
    id: u16,
    port: RefCell<Option<Port>>,
    terminal: RefCell<Option<Polled<Box<dyn Terminal>>>>,
    view: RefCell<NetworkView>,
    clock: Clock,
    expected: usize,
    complete: Rc<RollCall>,
    orders: RefCell<Option<Bytes>>,
    /// Words of carriers for the coordinator.
    said: Channel<NoopRawMutex, FromPc, 8>,
    journal: SharedJournal,
    /// Time at which each camera last told what it sees while it tracks.
    heard: RefCell<BTreeMap<u16, Duration>>,
    /// Time of the last message about an update by radio.
    updated: Cell<Option<Time>>,
    /// Messages about looks and objects since they were last taken.
    tracking: RefCell<Option<Vec<(Duration, ToPc)>>>,
}

/// Bytes for a coordinator.
type Bytes = Rc<RefCell<VecDeque<u8>>>;

/// A terminal on which only this program types.
#[derive(Default)]
struct Orders(Bytes);

impl io::Read for Orders {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match io::Read::read(&mut *self.0.borrow_mut(), buffer) {
            Ok(0) => Err(io::ErrorKind::WouldBlock.into()),
            done => done,
        }
    }
}

impl io::Write for Orders {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Flag that all nodes of a network have presented themselves, to wait for.
#[derive(Default)]
pub(super) struct RollCall {
    is_complete: Cell<bool>,
    waiting: RefCell<Vec<Waker>>,
}

impl RollCall {
    fn complete(&self) {
        self.is_complete.set(true);
        self.waiting.borrow_mut().drain(..).for_each(Waker::wake);
    }

    /// Returns when all nodes have presented themselves.
    pub(super) async fn completed(&self) {
        poll_fn(|context| {
            if self.is_complete.get() {
                return Poll::Ready(());
            }
            self.waiting.borrow_mut().push(context.waker().clone());
            Poll::Pending
        })
        .await;
    }
}

impl Console {
    pub(super) fn new(
        coordinator: &Node,
        expected: usize,
        clock: Clock,
        journal: SharedJournal,
    ) -> Self {
        Self(Rc::new(Shared {
            id: coordinator.id(),
            port: RefCell::new(Some(coordinator.line.open(Side::Far))),
            terminal: RefCell::default(),
            view: RefCell::default(),
            clock,
            expected,
            complete: Rc::default(),
            orders: RefCell::default(),
            said: Channel::new(),
            journal,
            heard: RefCell::default(),
            updated: Cell::default(),
            tracking: RefCell::default(),
        }))
    }

    /// Lets another program on the line too.
    pub(super) fn connect(&self, terminal: Box<dyn Terminal>) {
        let polled = Polled::new(terminal, self.0.clock.clone());
        *self.0.terminal.borrow_mut() = Some(polled);
    }

    pub(super) fn roll_call(&self) -> Rc<RollCall> {
        self.0.complete.clone()
    }

    /// Tells lengths in this unit.
    pub(super) fn tell_in(&self, unit: &str) {
        self.0.view.borrow_mut().tell_in(unit);
    }

    /// The network as the coordinator has told it.
    pub(super) fn view(&self) -> Ref<'_, NetworkView> {
        self.0.view.borrow()
    }

    /// Tells the coordinator something; [`take_orders`](Self::take_orders) must have been called before.
    pub(super) fn order(&self, message: &FromPc) {
        let mut buffer = [0; FRAME_MAX];
        if let (Some(orders), Some(frame)) =
            (&*self.0.orders.borrow(), encode(message, &mut buffer))
        {
            orders.borrow_mut().extend(frame);
        }
    }

    /// A carrier has the person at the PC tell the coordinator something.
    pub(super) fn say(&self, message: FromPc) {
        // A carrier who is not heard says it again.
        let _ = self.0.said.try_send(message);
    }

    /// From now on an onlooker may tell the coordinator something too.
    pub(super) fn take_orders(&self) {
        let orders = Orders::default();
        *self.0.orders.borrow_mut() = Some(orders.0.clone());
        self.connect(Box::new(orders));
    }

    /// Time at which each camera last told what it sees while it tracks.
    pub(super) fn heard(&self) -> Ref<'_, BTreeMap<u16, Duration>> {
        self.0.heard.borrow()
    }

    /// Time of the coordinator's last message about an update by radio.
    pub(super) fn updated(&self) -> Option<Time> {
        self.0.updated.get()
    }

    /// The coordinator's messages about looks and objects since the last call, with the time; none at the
    /// first call.
    pub(super) fn tracking(&self) -> Vec<(Duration, ToPc)> {
        std::mem::take(self.0.tracking.borrow_mut().get_or_insert_default())
    }

    /// The number of the coordinator.
    pub(super) fn id(&self) -> u16 {
        self.0.id
    }

    pub(super) async fn listen(self) {
        let Some(mut port) = self.0.port.take() else {
            return;
        };
        // There may be no terminal yet, but there is one before anything runs.
        let mut terminal = None;
        let mut frames = Frames::default();
        let mut bytes = [0; 256];
        let mut typed = [0; 256];
        loop {
            terminal = terminal.or_else(|| self.0.terminal.take());
            let types = async {
                match &mut terminal {
                    Some(terminal) => terminal.read(&mut typed).await,
                    None => pending().await,
                }
            };
            match select3(port.read(&mut bytes), types, self.0.said.receive()).await {
                Either3::First(Ok(count @ 1..)) => {
                    for &byte in &bytes[..count] {
                        if let Some(message) = frames.push(byte) {
                            self.take(&message);
                        }
                    }
                    if let Some(terminal) = &mut terminal {
                        // Programs that listen there are no part of the rehearsal.
                        let _ = terminal.write_all(&bytes[..count]).await;
                    }
                }
                Either3::Second(Ok(count)) => {
                    let _ = port.write_all(&typed[..count]).await;
                }
                Either3::Second(Err(_)) => terminal = None,
                Either3::Third(message) => {
                    let mut buffer = [0; FRAME_MAX];
                    if let Some(frame) = encode(&message, &mut buffer) {
                        let _ = port.write_all(frame).await;
                    }
                }
                Either3::First(_) => break,
            }
        }
    }

    fn take(&self, message: &ToPc) {
        let shared = &self.0;
        let mut journal = shared.journal.borrow_mut();
        journal.note(shared.id, format_args!("to the PC: {message:?}"));
        let now = Duration::from_nanos(shared.clock.time());
        let mut view = shared.view.borrow_mut();
        // The member that had the address, and the one that has it now.
        let address = match *message {
            ToPc::Member { address, .. }
            | ToPc::Report { address, .. }
            | ToPc::Removed { address, .. } => Some(address),
            _ => None,
        };
        let before = address.and_then(|address| view.id_of(address));
        let words = view.take(now, message);
        let after = address.and_then(|address| view.id_of(address));
        for member in [before, after].into_iter().flatten() {
            journal.told(member, shared.id);
        }
        if let Some(words) = words {
            journal.moment(shared.id, || Moment::Said(words));
        }
        if let ToPc::Tracked { .. } | ToPc::Object { .. } = message
            && let Some(told) = &mut *shared.tracking.borrow_mut()
        {
            told.push((now, *message));
        }
        match message {
            ToPc::Update { .. } | ToPc::UpdateSent => shared.updated.set(Some(shared.clock.time())),
            ToPc::Tracked { address, tracked } => {
                if let Some(id) = view.id_of(*address) {
                    shared.heard.borrow_mut().insert(id, now);
                    journal.moment(id, || Moment::Tracked(*tracked));
                }
            }
            ToPc::Object { id, object } => {
                journal.moment(shared.id, || Moment::Object(*id, *object));
            }
            ToPc::Done { address, done } => {
                if let Some(id) = view.id_of(*address) {
                    journal.moment(id, || Moment::Done(done.command, done.outcome));
                }
            }
            ToPc::Member { .. } if view.present().len() >= shared.expected => {
                shared.complete.complete();
            }
            ToPc::Report { report, .. } if report.pose().is_some() => journal.calibrated(report.id),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use node_firmware::message::{Hello, MemberKind};

    use super::*;
    use crate::network::{Options, Simulation};
    use site::{Overrides, Scenario};

    #[test]
    fn a_camera_that_joins_again_elsewhere_is_counted_once() {
        let lab = Scenario::load("lab", &Overrides::default()).unwrap();
        let simulation = Simulation::new(lab, Options::default()).unwrap();
        let console = &simulation.consoles[0];
        let tell = |address, id| {
            let kind = MemberKind::Camera { reference: None };
            let hello = Hello { id, kind };
            console.take(&ToPc::Member { address, hello });
            console.roll_call().is_complete.get()
        };
        assert_eq!(console.0.expected, 7);
        for id in 1..=6 {
            assert!(!tell(id, id));
        }
        assert!(!tell(9, 1), "camera 7 is missing");
        assert!(tell(7, 7));
    }
}
