//! Messages that are sent once.

use zigbee_link::{Instant, wire::ShortAddress};

use super::Output;
use crate::{log::debug, message::Message};

/// Answers and other messages that are sent once, each when it is due. A node that misses one asks again: a
/// message that has to be told until it is delivered is one of the [`Notifications`](super::Notifications).
#[derive(Clone, Debug)]
pub(crate) struct Outbox<Notification, const N: usize> {
    queue: heapless::Vec<Queued<Notification>, N>,
}

#[derive(Clone, Debug)]
struct Queued<Notification> {
    due: Instant,
    to: ShortAddress,
    message: Message,
    notification: Option<Notification>,
}

impl<Notification, const N: usize> Outbox<Notification, N> {
    pub(crate) const fn new() -> Self {
        Self {
            queue: heapless::Vec::new(),
        }
    }

    /// `false` if there is no room: the message is lost, and the node that waits for it asks again.
    pub(crate) fn push(
        &mut self,
        due: Instant,
        to: ShortAddress,
        message: Message,
        notification: Option<Notification>,
    ) -> bool {
        let queued = Queued {
            due,
            to,
            message,
            notification,
        };
        let has_room = self.queue.push(queued).is_ok();
        if !has_room {
            debug!("a message is lost: the outbox is full");
        }
        has_room
    }

    /// The first that is due.
    pub(crate) fn take_due<Task>(&mut self, now: Instant) -> Option<Output<Notification, Task>> {
        let place = self.queue.iter().position(|queued| queued.due <= now)?;
        let queued = self.queue.remove(place);
        Some(Output::Send {
            to: queued.to,
            message: queued.message,
            notification: queued.notification,
        })
    }

    /// Time when the next one is due.
    pub(crate) fn next_due(&self) -> Option<Instant> {
        self.queue.iter().map(|queued| queued.due).min()
    }

    /// Nothing of it is to be sent any more.
    pub(crate) fn clear(&mut self) {
        self.queue.clear();
    }
}
