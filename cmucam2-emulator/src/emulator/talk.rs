//! Bytes heard and lines said.

use cmucam2_driver::{geometry::Sensor, packet::FirmwareVersion};

use super::{Activity, Emulator, MILLISECOND, Note, Time};
use crate::{light::Light, switches::Switches};

/// From the last byte of a command to the first of its answer.
const LATENCY: Time = MILLISECOND / 5;
/// From the first byte to the end of sleep.
const WAKE: Time = 10 * MILLISECOND;
/// Longer lines are no commands.
const LINE_MAX: usize = 64;

impl Emulator {
    /// One byte that arrived at the camera.
    pub(super) fn hear(&mut self, byte: u8, now: Time) {
        self.answer_at = now + LATENCY;
        match &mut self.activity {
            Activity::Command => self.type_in(byte, now),
            Activity::Dead
            | Activity::Boot { .. }
            | Activity::Silent { .. }
            | Activity::Waking { .. } => {}
            Activity::Sleep { deep } => {
                if *deep {
                    self.light = Light::new(now);
                }
                self.activity = Activity::Waking { at: now + WAKE };
            }
            Activity::Upload { blocks, len } => {
                blocks[*len] = byte;
                *len += 1;
                if *len == blocks.len() {
                    let blocks = *blocks;
                    self.uploaded(&blocks);
                }
            }
            Activity::Stream(_) if byte == b'\r' => self.stop(now),
            Activity::Dump(dump) if byte == b'\r' => {
                if self.configuration.switches.stop_within_frame == 1 {
                    self.stop(now);
                } else {
                    dump.stopped = true;
                }
            }
            Activity::Stream(_) | Activity::Dump(_) => {}
        }
    }

    fn stop(&mut self, now: Time) {
        let cuts =
            matches!(self.activity, Activity::Dump(_)) || self.switches().stop_within_packet == 1;
        if cuts {
            self.wire.cut(now);
        }
        self.note(|| Note::Stopped);
        self.activity = Activity::Command;
        if self.switches().stop_ack == 1 {
            self.acknowledge();
        }
        self.prompt();
    }

    fn type_in(&mut self, byte: u8, now: Time) {
        match byte {
            b'\r' => {
                let line = std::mem::take(&mut self.line);
                self.obey(&line, now);
                // Keeps its memory for the next line.
                self.line = line;
                self.line.clear();
            }
            // Terminals send it after a carriage return.
            b'\n' => {}
            _ if self.modes.raw.input() => {}
            _ if self.line.len() <= LINE_MAX => self.line.push(byte),
            _ => {}
        }
    }

    /// Puts one line or row on the wire, with whatever happens to it.
    pub(super) fn say(&mut self, bytes: &[u8]) {
        let mut line = bytes.to_vec();
        self.faults.damage(&mut line);
        for byte in line {
            let (wire, at) = (&mut self.wire, self.answer_at);
            self.faults.transmit(byte, |byte| wire.send(at, byte));
        }
    }

    pub(super) fn acknowledge(&mut self) {
        if !self.modes.raw.suppress_replies() {
            self.say(b"ACK\r");
        }
    }

    pub(super) fn prompt(&mut self) {
        self.say(b":");
    }

    pub(super) fn say_banner(&mut self, carriage_return: bool) {
        let Switches {
            version, module, ..
        } = *self.switches();
        let is_first = self.configuration.sensor == Sensor::Ov6620;
        let number = match module {
            2 => None,
            // The other way round.
            1 if is_first => Some(7),
            1 => Some(6),
            _ if is_first => Some(6),
            _ => Some(7),
        };
        let banner = FirmwareVersion {
            major: 1,
            minor: u8::from(version == 1),
            module: number,
        }
        .banner();
        let mut text = banner.as_bytes().to_vec();
        if version == 2 {
            // "v1.00" without its second digit.
            text.remove(b"CMUcam2 v1.0".len());
        }
        if carriage_return {
            text.push(b'\r');
        }
        self.say(&text);
    }
}
