//! `zigbee_link` as the network that roles need.

use core::{cell::Cell, time::Duration};

use zigbee_link::{
    Instant,
    link::{Delivery, Effort, SendError, Ticket},
    network::{NetworkStatus, Node},
    runner::{Clock, Happened, Shared},
    wire::ShortAddress,
};

use super::{PEERS, QUEUE};
use crate::{
    config::SiteKey,
    console::{KeyChangeReport, NetworkInfo},
    limits::MEMBERS,
    log::debug,
    message::Message,
    network::{
        Administration, Attachment, Network, NetworkEvent, NetworkIdentity, PostError, Receipt,
    },
};

/// State that the link's runner and a role share.
pub(super) struct ZigbeeNetwork<C> {
    pub(super) node: Shared<C, PEERS, QUEUE, MEMBERS>,
    /// The state of the link that the role was told, or does not care about.
    known: Cell<NetworkStatus>,
}

impl<C> ZigbeeNetwork<C> {
    // for less stack
    #[inline(always)]
    pub(super) const fn new(node: Shared<C, PEERS, QUEUE, MEMBERS>) -> Self {
        Self {
            node,
            known: Cell::new(NetworkStatus::Out),
        }
    }
}

fn attachment(status: NetworkStatus) -> Option<Attachment> {
    match status {
        NetworkStatus::Joined(membership) => Some(Attachment {
            network: NetworkIdentity {
                number: membership.pan.0,
                founder: membership.coordinator.0,
            },
            own: membership.short.0,
        }),
        _ => None,
    }
}

impl<C: Clock> Network for ZigbeeNetwork<C> {
    type Ticket = Ticket;

    fn post(
        &self,
        to: ShortAddress,
        message: &Message,
        receipt: Receipt,
    ) -> Result<Ticket, PostError> {
        let effort = match receipt {
            Receipt::Wanted => Effort::Acknowledged,
            Receipt::NotWanted => Effort::Once,
        };
        let posted = self.node.post_with(to, message, effort);
        posted.map_err(|error| match error {
            SendError::QueueFull => PostError::Full,
            error => {
                debug!("not sent: {}", error);
                PostError::Refused
            }
        })
    }

    fn roam(&self) {
        self.node.with(|node, _| node.roam());
    }

    fn is_asleep(&self) -> bool {
        self.node.is_quiet()
    }

    async fn happened(&self, known: Option<Attachment>) -> NetworkEvent<Ticket> {
        loop {
            match self.node.happened(self.known.get()).await {
                Happened::Message(from, message) => return NetworkEvent::Message(from, message),
                Happened::Settled(ticket, delivery) => {
                    let delivered = delivery != Delivery::NoAnswer;
                    return NetworkEvent::Settled { ticket, delivered };
                }
                Happened::Status(status) => {
                    self.known.set(status);
                    let now = attachment(status);
                    if now != known {
                        return NetworkEvent::Attached(now);
                    }
                }
            }
        }
    }
}

impl<C: Clock> Administration for ZigbeeNetwork<C> {
    fn info(&self) -> Option<NetworkInfo> {
        match self.node.with(|node, _| node.status())? {
            NetworkStatus::Joined(membership) => Some(NetworkInfo {
                pan: membership.pan.0,
                channel: membership.channel.number(),
            }),
            _ => None,
        }
    }

    fn open_join_window(&self, time: Duration) {
        self.node.with(|node, now| node.open_join_window(now, time));
    }

    fn remove(&self, member: ShortAddress) -> bool {
        let removed = self.node.with(|node, now| {
            let member = node.members().find(|known| known.short == member);
            member.is_some_and(|member| node.remove(now, member.extended))
        });
        removed == Some(true)
    }

    fn change_identifier(&self) -> bool {
        let changes = self.node.with(Node::change_pan);
        changes == Some(true)
    }

    fn conflict_s(&self) -> Option<u32> {
        let age = |now: Instant, then: Instant| now.0.saturating_sub(then.0) / 1_000_000;
        let seconds = self
            .node
            .with(|node, now| node.last_conflict().map(|then| age(now, then)))
            .flatten()?;
        Some(u32::try_from(seconds).unwrap_or(u32::MAX))
    }

    fn change_key(&self, key: SiteKey) -> bool {
        let begun = self.node.with(|node, _| Some(node.change_key(key.key()?)));
        matches!(begun.flatten(), Some(Ok(())))
    }

    fn key_change(&self) -> Option<KeyChangeReport> {
        let change = self.node.with(|node, _| node.key_change()).flatten()?;
        Some(KeyChangeReport {
            index: change.index,
            check: change.check,
            done: change.is_done,
            unreached: change.unreached,
        })
    }
}
