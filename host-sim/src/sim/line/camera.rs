//! An emulated camera at the far end.

use super::end::End;
use crate::{
    camera::{Emulator, Scene},
    sim::executor::Time,
};

type Hook = Box<dyn FnMut(Time, &mut Scene)>;

pub(super) struct Camera {
    pub(super) emulator: Emulator,
    pub(super) has_power: bool,
    scene: Hook,
}

impl Camera {
    pub(super) fn new(emulator: Emulator, scene: Hook) -> Self {
        Self {
            emulator,
            has_power: true,
            scene,
        }
    }

    pub(super) fn power_up(&mut self, now: Time) {
        if !self.has_power {
            self.has_power = true;
            self.emulator.power_cycle(now);
        }
    }

    /// Commands, frames and packets in their order, until now.
    pub(super) fn advance(&mut self, now: Time, node: &mut End, is_plugged: bool) {
        if !self.has_power {
            while node.next_sent(now).is_some() {}
            return;
        }
        loop {
            let sent = node.next_sent_at().filter(|&at| at <= now);
            let frame = self.emulator.next_frame().filter(|&at| at <= now);
            match (frame, sent) {
                (Some(frame), sent) if sent.is_none_or(|sent| frame <= sent) => {
                    (self.scene)(frame, self.emulator.scene_mut());
                    self.emulator.advance(frame);
                }
                (_, Some(_)) => {
                    let Some((at, byte)) = node.next_sent(now) else {
                        break;
                    };
                    if !is_plugged {
                        continue;
                    }
                    // Some commands take a frame by themselves.
                    if byte == b'\r' {
                        (self.scene)(at, self.emulator.scene_mut());
                    }
                    self.emulator.receive(byte, at);
                }
                _ => break,
            }
        }
        while let Some((_, byte)) = self.emulator.transmit(now) {
            if is_plugged {
                node.receive(byte);
            }
        }
    }

    /// When something happens that somebody must see: a frame, the end of a command, or bytes that
    /// the node waits for.
    pub(super) fn next(&self, node: &End) -> Option<Time> {
        if !self.has_power {
            return None;
        }
        let heard = if node.is_waiting() {
            self.emulator.next_burst(node.room())
        } else {
            None
        };
        [self.emulator.next_frame(), node.line_at(), heard]
            .into_iter()
            .flatten()
            .min()
    }
}
