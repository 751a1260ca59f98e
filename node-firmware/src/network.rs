//! The seam between roles and the network that carries their messages.
//!
//! Roles need little of it: a message goes to a member or to all, its arrival is known, and a node knows when
//! it is attached, and whether that is still the same network. Any network that gives that can carry them,
//! over one hop or many: [`run`](crate::run::run) connects them to `zigbee_link`,
//! [`run_over`](crate::run::run_over) to anything else.
//!
//! Promises of a network:
//! - The sender of a message is a member, and said just this. No message comes from outside.
//! - A message arrives whole or not at all, in any order, perhaps twice, and perhaps late.
//! - A message to one member is settled within about a minute, whether it arrived or not. One to all is
//!   settled when it is sent, for its receivers are not known.
//! - The coordinator's address is [`COORDINATOR`](crate::role::COORDINATOR). An address is one member's
//!   for as long as the [`Attachment`]s of all stay the same.

use core::{future::Future, time::Duration};

use serde::{Deserialize, Serialize};
use zigbee_link::wire::ShortAddress;

use crate::{
    config::SiteKey,
    console::{KeyChangeReport, NetworkInfo},
    message::{MemberAddress, Message},
};

/// Carries the messages of one node.
pub trait Network {
    /// Names a message on its way.
    type Ticket: Copy + PartialEq;

    /// Takes a message for one member, or for all: [`ShortAddress::BROADCAST`].
    ///
    /// # Errors
    /// It was not taken, and nothing more will be told of it.
    fn post(
        &self,
        to: ShortAddress,
        message: &Message,
        receipt: Receipt,
    ) -> Result<Self::Ticket, PostError>;

    /// Waits for the next event. Cancel-safe: an event that was not returned is told next time. `known` is
    /// the attachment that the caller knows.
    fn happened(
        &self,
        known: Option<Attachment>,
    ) -> impl Future<Output = NetworkEvent<Self::Ticket>>;

    /// The node should rather be in the network of the site that it hears best. It looks for that, and tells
    /// by events where it is attached. Nothing happens where there is only one network.
    fn roam(&self) {}

    /// Returns true while the node sleeps: nothing is to be done before it is woken. That it asks in between whether its
    /// coordinator is there changes nothing.
    fn is_asleep(&self) -> bool {
        false
    }
}

/// Request for a receipt of a message to one member.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Receipt {
    /// It is sent again until it arrives, or for about a minute.
    Wanted,
    /// It is not worth to be sent again: it is settled when it is sent.
    NotWanted,
}

/// Administration of a network by people at the coordinator. A node that is no coordinator answers that there
/// is nothing.
pub trait Administration {
    /// Identifier and channel of the network, if it runs.
    fn info(&self) -> Option<NetworkInfo>;

    /// Lets any device with the site key join for a while.
    fn open_join_window(&self, time: Duration);

    /// Sends a member away. Returns true if it was one.
    fn remove(&self, member: ShortAddress) -> bool;

    /// Begins to take another identifier, because a foreign network has the same one. Returns true if it
    /// could begin.
    fn change_identifier(&self) -> bool;

    /// Seconds since such a network was last heard.
    fn conflict_s(&self) -> Option<u32>;

    /// Begins to give all members another site key. Returns true if it could begin.
    fn change_key(&self, key: SiteKey) -> bool;

    /// Progress of the last change of the site key.
    fn key_change(&self) -> Option<KeyChangeReport>;
}

/// Attachment of a node. As long as it is the same, addresses are the same members'.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Attachment {
    /// Identity of the network.
    pub network: NetworkIdentity,
    /// The own address there.
    pub own: MemberAddress,
}

/// Identity of a network, among all present and former ones. Only the network knows the meaning of its
/// numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NetworkIdentity {
    /// Tells those apart that one founder formed one after the other. It may change while a node is
    /// attached, without a change of addresses.
    pub number: u16,
    /// Founder of the network.
    pub founder: [u8; 8],
}

/// Event in a network.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum NetworkEvent<Ticket> {
    /// A member sent a message.
    Message(ShortAddress, Message),
    /// A message that was posted arrived, or it is not known to have arrived. Told once of each.
    Settled {
        /// Result of [`Network::post`].
        ticket: Ticket,
        /// It arrived; of a message to all: it was sent.
        delivered: bool,
    },
    /// The node is attached so now, or to no network.
    Attached(Option<Attachment>),
}

/// Reason why a message was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum PostError {
    /// Too many are on their way: try again after the next event.
    Full,
    /// It cannot be sent: no receiver, too long, or not attached.
    Refused,
}

impl core::fmt::Display for PostError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Full => "too many messages are on their way",
            Self::Refused => "the message cannot be sent",
        })
    }
}

impl core::error::Error for PostError {}
