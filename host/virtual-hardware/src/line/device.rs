//! A device at the far end.

use std::any::Any;

use super::end::End;
use crate::executor::Time;

/// A device on the far end of a line, in place of a program. It has no clock, takes bytes with the times at which
/// they arrive, and sends bytes with the times at which their stop bits are over.
pub trait Device: Any {
    /// It has its power back and starts anew.
    fn power_up(&mut self, now: Time);

    /// Time when it next does something by itself that may not wait until a reader listens.
    fn next_action(&self) -> Option<Time>;

    /// Does what is due at this time.
    fn act(&mut self, now: Time);

    /// Takes a byte.
    fn receive(&mut self, byte: u8, at: Time);

    /// The next byte that is sent until now.
    fn transmit(&mut self, now: Time) -> Option<(Time, u8)>;

    /// Time when all that it sends without a pause is sent, or so many bytes of it.
    fn next_burst(&self, room: usize) -> Option<Time>;
}

/// A device and its supply.
pub(super) struct Powered {
    pub(super) device: Box<dyn Device>,
    pub(super) has_power: bool,
}

impl Powered {
    pub(super) fn new(device: Box<dyn Device>) -> Self {
        Self {
            device,
            has_power: true,
        }
    }

    pub(super) fn power_up(&mut self, now: Time) {
        if !self.has_power {
            self.has_power = true;
            self.device.power_up(now);
        }
    }

    /// Does its actions, and takes the bytes that it is sent, in their order, until now.
    pub(super) fn advance(&mut self, now: Time, node: &mut End, is_plugged: bool) {
        if !self.has_power {
            while node.next_sent(now).is_some() {}
            return;
        }
        loop {
            let sent = node.next_sent_at().filter(|&at| at <= now);
            let action = self.device.next_action().filter(|&at| at <= now);
            match (action, sent) {
                (Some(action), sent) if sent.is_none_or(|sent| action <= sent) => {
                    self.device.act(action);
                }
                (_, Some(_)) => {
                    let Some((at, byte)) = node.next_sent(now) else {
                        break;
                    };
                    if is_plugged {
                        self.device.receive(byte, at);
                    }
                }
                _ => break,
            }
        }
        while let Some((_, byte)) = self.device.transmit(now) {
            if is_plugged {
                node.receive(byte);
            }
        }
    }

    /// Time of the next event that must be handled: an action, the end of a line that it is sent, or bytes that
    /// the node waits for.
    pub(super) fn next(&self, node: &End) -> Option<Time> {
        if !self.has_power {
            return None;
        }
        let heard = if node.is_waiting() {
            self.device.next_burst(node.room())
        } else {
            None
        };
        [self.device.next_action(), node.line_at(), heard]
            .into_iter()
            .flatten()
            .min()
    }
}
