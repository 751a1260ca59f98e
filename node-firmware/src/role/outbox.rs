//! Messages that wait for being sent.

use zigbee_link::{Instant, wire::ShortAddress};

use crate::{log::debug, message::Message};

/// Answers and other messages that are sent once, each when it is due.
#[derive(Clone, Debug)]
pub(crate) struct Outbox<Notification, const N: usize> {
    waiting: heapless::Vec<Letter<Notification>, N>,
}

#[derive(Clone, Debug)]
struct Letter<Notification> {
    due: Instant,
    to: ShortAddress,
    message: Message,
    notification: Option<Notification>,
}

impl<Notification, const N: usize> Outbox<Notification, N> {
    pub(crate) const fn new() -> Self {
        Self {
            waiting: heapless::Vec::new(),
        }
    }

    /// `false` if there is no room: the message is lost, and whoever waits for it asks again.
    pub(crate) fn push(
        &mut self,
        due: Instant,
        to: ShortAddress,
        message: Message,
        notification: Option<Notification>,
    ) -> bool {
        let letter = Letter {
            due,
            to,
            message,
            notification,
        };
        let has_room = self.waiting.push(letter).is_ok();
        if !has_room {
            debug!("a message is lost: the outbox is full");
        }
        has_room
    }

    /// The first that is due.
    pub(crate) fn pop(
        &mut self,
        now: Instant,
    ) -> Option<(ShortAddress, Message, Option<Notification>)> {
        let place = self.waiting.iter().position(|letter| letter.due <= now)?;
        let letter = self.waiting.remove(place);
        Some((letter.to, letter.message, letter.notification))
    }

    /// When the next one is due.
    pub(crate) fn deadline(&self) -> Option<Instant> {
        self.waiting.iter().map(|letter| letter.due).min()
    }
}
