//! The PC on a coordinator's line: collects what people would.

use std::{
    cell::{Cell, RefCell},
    collections::{BTreeMap, BTreeSet},
    future::poll_fn,
    rc::Rc,
    task::{Poll, Waker},
};

use embedded_io_async::Read;
use node_firmware::{
    console::{Frames, ToPc},
    message::{Address, Hello, Report},
    role::COORDINATOR,
};

use super::{journal::SharedJournal, node::Hardware};
use virtual_bench::line::{Port, Side};

/// What a PC knows of a network.
#[derive(Clone)]
pub(super) struct Console(Rc<Shared>);

struct Shared {
    id: u16,
    port: RefCell<Option<Port>>,
    pan: Cell<Option<u16>>,
    members: RefCell<BTreeMap<Address, Hello>>,
    reports: RefCell<BTreeMap<u16, Report>>,
    expected: usize,
    complete: Rc<RollCall>,
    journal: SharedJournal,
}

/// Whether all nodes of a network have presented themselves.
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

    /// Returns when they have.
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
    pub(super) fn new(coordinator: &Hardware, expected: usize, journal: SharedJournal) -> Self {
        Self(Rc::new(Shared {
            id: coordinator.id(),
            port: RefCell::new(Some(coordinator.line.open(Side::Far))),
            pan: Cell::default(),
            members: RefCell::default(),
            reports: RefCell::default(),
            expected,
            complete: Rc::default(),
            journal,
        }))
    }

    pub(super) fn roll_call(&self) -> Rc<RollCall> {
        self.0.complete.clone()
    }

    /// Cameras that reported a pose.
    pub(super) fn calibrated(&self) -> usize {
        let reports = self.0.reports.borrow();
        reports
            .values()
            .filter(|report| report.pose().is_some())
            .count()
    }

    /// The last report of a camera.
    pub(super) fn report(&self, id: u16) -> Option<Report> {
        self.0.reports.borrow().get(&id).copied()
    }

    /// The number of the member with this address.
    pub(super) fn id_of(&self, address: Address) -> Option<u16> {
        Some(self.0.members.borrow().get(&address)?.id)
    }

    /// The network's PAN identifier, and every short address in it with the number of its node.
    pub(super) fn addresses(&self) -> Option<(u16, Vec<(Address, u16)>)> {
        let members = self.0.members.borrow();
        let members = members.iter().map(|(address, hello)| (*address, hello.id));
        let coordinator = (COORDINATOR.0, self.0.id);
        Some((self.0.pan.get()?, members.chain([coordinator]).collect()))
    }

    pub(super) async fn listen(self) {
        let Some(mut port) = self.0.port.take() else {
            return;
        };
        let mut frames = Frames::default();
        let mut bytes = [0; 256];
        while let Ok(count @ 1..) = port.read(&mut bytes).await {
            for &byte in &bytes[..count] {
                if let Some(message) = frames.push(byte) {
                    self.take(&message);
                }
            }
        }
    }

    fn take(&self, message: &ToPc) {
        let shared = &self.0;
        let mut journal = shared.journal.borrow_mut();
        journal.note(shared.id, format_args!("to the PC: {message:?}"));
        match message {
            ToPc::Network(Some(network)) => shared.pan.set(Some(network.pan)),
            ToPc::Member { address, hello } => {
                let mut members = shared.members.borrow_mut();
                members.insert(*address, *hello);
                // Whoever joined again has two addresses.
                let present: BTreeSet<u16> = members.values().map(|hello| hello.id).collect();
                if present.len() >= shared.expected {
                    shared.complete.complete();
                }
            }
            ToPc::Report { report, .. } => {
                if report.pose().is_some() {
                    journal.calibrated(report.id);
                }
                shared.reports.borrow_mut().insert(report.id, *report);
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use node_firmware::message::Kind;

    use super::*;
    use crate::network::{Options, Simulation};
    use site::{Overrides, Scenario};

    #[test]
    fn a_camera_that_joins_again_elsewhere_is_counted_once() {
        let lab = Scenario::load("lab", &Overrides::default()).unwrap();
        let simulation = Simulation::new(lab, Options::default()).unwrap();
        let console = &simulation.consoles[0];
        let tell = |address, id| {
            let kind = Kind::Camera { reference: None };
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
