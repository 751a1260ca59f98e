//! Roles of nodes: coordinator, camera, moving target.
//!
//! A role is a state machine without input or output. It is told events with the time, and asked for its
//! outputs until it has none. [`run`](crate::run) connects it to radio, flash and devices; tests connect
//! roles to each other.

mod last_network;
mod notifications;
mod outbox;
mod reports;
mod unsaved;

pub mod camera;
pub mod coordinator;
pub mod moving_target;

pub use self::reports::{CONTRADICTION, contradiction};
pub(crate) use self::{
    last_network::LastNetwork,
    notifications::{Notification, Notifications, RETRY},
    outbox::Outbox,
    reports::{Reports, is_news},
    unsaved::Unsaved,
};

use zigbee_link::{Instant, wire::ShortAddress};

use crate::{
    facts::Fact,
    hardware::Indication,
    message::{Memory, Message, Restart},
    network::Attachment,
};

/// The coordinator's address.
pub const COORDINATOR: ShortAddress = ShortAddress(0);

/// Something a role wants done.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use]
pub enum Output<Notification, Task> {
    /// Send a message. With a `notification`, report its delivery: [`Role::on_sent`].
    Send {
        /// The receiver, or [`ShortAddress::BROADCAST`].
        to: ShortAddress,
        /// The message.
        message: Message,
        /// Handed back with the result.
        notification: Option<Notification>,
    },
    /// Write this down before anything else is done.
    Save(Fact),
    /// A task for the role's devices.
    Task(Task),
}

/// The state machine of a node.
pub trait Role {
    /// Names a message of which the role must know whether it was delivered.
    type Notification: Copy;
    /// Task of the devices of this role.
    type Task;
    /// Event of these devices.
    type Event;

    /// Takes a fact that was written down before a restart. Called before all others.
    fn restore(&mut self, fact: &Fact);

    /// The node joined, or formed, this network, or lost it.
    fn on_attached(&mut self, now: Instant, network: Option<Attachment>);

    /// A message came.
    fn on_message(&mut self, now: Instant, from: ShortAddress, message: &Message);

    /// A message was delivered, or not. A broadcast counts as delivered.
    fn on_sent(&mut self, now: Instant, notification: Self::Notification, delivered: bool);

    /// A device told something.
    fn on_event(&mut self, now: Instant, event: Self::Event);

    /// The memory of the node's facts from now on, and the reason of its start. Called after
    /// [`restore`](Self::restore), and again when the flash fails.
    fn on_node(&mut self, now: Instant, memory: Memory, restart: Restart);

    /// Does computations that need time and stack. Call it after the others and before [`poll`](Self::poll),
    /// from where little of the stack is in use.
    fn compute(&mut self, _now: Instant) {}

    /// The next output. Call it until it returns `None`.
    fn poll(&mut self, now: Instant) -> Option<Output<Self::Notification, Self::Task>>;

    /// When to call [`poll`](Self::poll) again, if nothing happens before.
    fn next_deadline(&self) -> Option<Instant>;

    /// State of the lamps.
    fn indication(&self) -> Indication;
}

/// The earliest of several deadlines.
pub(crate) fn earliest<const N: usize>(deadlines: [Option<Instant>; N]) -> Option<Instant> {
    deadlines.into_iter().flatten().min()
}
