//! The radio medium: range, losses and their reasons.
//!
//! A [`Medium`] is one piece of air with all sixteen channels. A node [attached](Medium::attach) to
//! it sends and receives through a [`Radio`], which keeps the contract of [`zigbee_link::radio`].
//! Nodes whose antennas cannot disturb one another may use several mediums.
//!
//! # Times (IEEE 802.15.4-2006, 6.5 and 6.9)
//! A transmission is a clear-channel assessment of 128 us, the turnaround of 192 us, and 32 us for
//! each byte: 6 of the PHY header and those of the PSDU, FCS included. The assessment looks at the
//! channel at its end. So two radios that begin within 192 us of one another do not notice, and
//! collide.
//!
//! # Reception
//! A receiver locks on to the first frame that it hears and stays with it to its end. Overlapping frames destroy
//! that frame unless it is stronger than all others together by the capture threshold of the [`Propagation`]; the
//! frame that came later is lost in any case. A radio that sends, from its turnaround on, hears nothing.
//!
//! A frame that was destroyed or damaged is dropped by a radio with FCS, and delivered with wrong
//! bytes by one without. Every drop has a [`Reason`]. The carrier of a sender that loses its power
//! lasts as long as its frame would have.
//!
//! # Radios elsewhere
//! A node may have an [`Ear`] in the place of a [`Radio`]: it is told of each frame as it begins, and of the
//! frame's fate where the radio stays with it, and sends with [`Medium::transmit`]. It is told which frames stand
//! out from the others; it decides itself with which it stays, and makes its own assessments and times.
//!
//! # Chance
//! The loss of a frame on a link depends on the seed, its two ends and the number of the frame at its sender:
//! nothing that happens elsewhere changes it.

mod air;
mod counters;
mod disturbance;
mod ear;
mod filter;
mod links;
mod propagation;
mod radio;
mod watch;

use std::{
    cell::RefCell,
    rc::{Rc, Weak},
};

use zigbee_link::radio::{Channel, FCS_LEN, FRAME_MIN, PSDU_MAX};

use self::air::{Air, Due};
pub use self::{
    counters::{Counters, Reason},
    disturbance::{Disturbance, Kind},
    ear::{Arrival, Ear},
    propagation::{LogDistance, Propagation},
    radio::{Radio, RadioError},
    watch::{Capture, Digest, Event, Watcher},
};
use super::executor::{Clock, EventId, Handler, Time};

/// A place in the plane, in the units of the [`Propagation`].
pub type Place = [f64; 2];

/// Abilities of the radio of an nRF52840, with a queue in its driver and a filter.
pub const NRF52840: Abilities = Abilities {
    fcs: true,
    address_filter: true,
    rx_queue: true,
};

/// Functions that a radio of a medium does by itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Abilities {
    /// Appends the frame check sequence, and drops received frames where it is wrong. Frames then
    /// cross the seam without it.
    pub fcs: bool,
    /// Delivers only frames for the configured addresses.
    pub address_filter: bool,
    /// Queues frames that arrive while no receive operation is pending.
    pub rx_queue: bool,
}

/// A node of a medium.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(pub u32);

/// Radio medium. See the [module](self).
#[derive(Clone)]
pub struct Medium(Rc<Shared>);

/// State that the handles share.
struct Shared {
    air: RefCell<Air>,
    clock: Clock,
    own: Weak<Shared>,
}

impl Shared {
    fn plan(&self, at: Time, due: Due) -> EventId {
        self.clock.call_at(at, self.own.clone(), due.token())
    }
}

impl Handler for Shared {
    fn event(&self, token: u64) {
        let now = self.clock.time();
        let planned = self.air.borrow_mut().event(now, Due::of(token));
        if let Some((at, due)) = planned {
            let event = self.plan(at, due);
            self.air.borrow_mut().planned(due, event);
        }
    }
}

impl Medium {
    /// Air without nodes.
    pub fn new(clock: &Clock, propagation: Propagation, seed: u64) -> Self {
        Self(Rc::new_cyclic(|own| Shared {
            air: RefCell::new(Air::new(propagation, seed)),
            clock: clock.clone(),
            own: own.clone(),
        }))
    }

    /// Adds a node. Nodes are numbered from 0.
    pub fn attach(&self, place: Place) -> NodeId {
        self.0.air.borrow_mut().add(place)
    }

    /// The radio of a node, which has just been switched on. Backing off is left to a wrapper. The
    /// radio is switched off when it is dropped; a node has one at a time.
    pub fn radio(&self, node: NodeId, abilities: Abilities) -> Radio {
        self.0.air.borrow_mut().switch_on(node, abilities);
        Radio::new(self.0.clone(), node, abilities)
    }

    /// Place of a node.
    pub fn place(&self, node: NodeId) -> Place {
        self.0.air.borrow().links.place(node.0)
    }

    /// Moves a node.
    pub fn move_to(&self, node: NodeId, place: Place) {
        self.0.air.borrow_mut().links.move_to(node.0, place);
    }

    /// Adds a fault.
    pub fn disturb(&self, disturbance: Disturbance) {
        self.0.air.borrow_mut().disturbances.add(disturbance);
    }

    /// Puts a PSDU, FCS included, on the air from the antenna of a node, independently of its own radio: a
    /// replayed or forged frame.
    ///
    /// # Panics
    /// The PSDU is shorter than an acknowledgement or longer than [`PSDU_MAX`].
    pub fn inject(&self, from: NodeId, channel: Channel, psdu: &[u8]) {
        assert!(
            (FRAME_MIN + FCS_LEN..=PSDU_MAX).contains(&psdu.len()),
            "no radio sends {} bytes",
            psdu.len()
        );
        let now = self.0.clock.time();
        let (at, due) = self.0.air.borrow_mut().inject(now, from, channel, psdu);
        self.0.plan(at, due);
    }

    /// A node has a radio elsewhere from now on, or no longer.
    pub fn set_ear(&self, node: NodeId, ear: Option<Box<dyn Ear>>) {
        let old = self.0.air.borrow_mut().set_ear(node, ear);
        drop(old);
    }

    /// A radio elsewhere begins to send a PSDU, FCS included, with a power in dBm. One that is no PSDU
    /// is not sent.
    pub fn transmit(&self, from: NodeId, channel: Channel, power: i8, psdu: &[u8]) {
        if (FRAME_MIN + FCS_LEN..=PSDU_MAX).contains(&psdu.len()) {
            self.0.air.borrow_mut().node_mut(from).power = power;
            self.inject(from, channel, psdu);
        }
    }

    /// Channels on which a [jammer](Kind::Jammer) is heard at a node now.
    pub fn jammed(&self, node: NodeId) -> Vec<Channel> {
        let now = self.0.clock.time();
        self.0.air.borrow().jammed(now, node)
    }

    /// Tells a watcher of all events from now on.
    pub fn watch(&self, watcher: impl Watcher + 'static) {
        self.0.air.borrow_mut().watchers.push(Box::new(watcher));
    }

    /// Counts of a node so far.
    pub fn counters(&self, node: NodeId) -> Counters {
        self.0.air.borrow().counters(node)
    }

    /// Counts of all nodes so far.
    pub fn totals(&self) -> Counters {
        self.0.air.borrow().totals()
    }
}
