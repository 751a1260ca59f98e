//! Bytes heard and lines said.

use super::{Activity, Emulator, MILLISECOND, Note, Time};
use crate::{
    command::{Command, RawHeard},
    differencing::Grid,
    light::Light,
    sensor::Sensor,
    switches::Switches,
};

/// Time from the last byte of a command to the first of its answer.
const LATENCY: Time = MILLISECOND / 5;
/// Time from the first byte to the end of sleep.
const WAKE: Time = 10 * MILLISECOND;
/// Longer lines are no commands.
const LINE_MAX: usize = 128;
/// Banners, by the switch of the version.
const BANNERS: [&str; 6] = [
    "CMUcam2 v1.00",
    "CMUcam2 v1.01",
    "CMUcam2 v1.0",
    "CMUcam2+ v1.00",
    "CMUcam2 v2.0+",
    "CMUcam3 v1.0",
];
/// Bytes that the camera keeps, of those that come while it starts.
const EARLY_MAX: usize = 128;

/// The blocks of an upload that is sent in the line of its command, as one program does. No level is a carriage
/// return.
fn uploaded(line: &[u8]) -> Option<&[u8; 64]> {
    let (letters, blocks) = line.split_first_chunk::<2>()?;
    letters
        .eq_ignore_ascii_case(b"UD")
        .then(|| blocks.try_into().ok())?
}

impl Emulator {
    /// One byte that arrived at the camera.
    pub(super) fn hear(&mut self, byte: u8, now: Time) {
        self.answer_at = now + LATENCY;
        let hears = !matches!(
            self.activity,
            Activity::Dead | Activity::Silent { .. } | Activity::Boot { .. }
        );
        if hears && self.switches().echo == 1 {
            self.say(&[byte]);
        }
        match &mut self.activity {
            Activity::Command => self.type_in(byte, now),
            Activity::Boot { early, .. } => {
                if self.configuration.switches.boot_input == 1 && early.len() < EARLY_MAX {
                    early.push(byte);
                }
            }
            Activity::Dead | Activity::Silent { .. } | Activity::Waking { .. } => {}
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
        self.is_late = self.switches().late_packet == 1 && !self.last_packet.is_empty();
        if self.switches().stop_ack == 1 {
            self.acknowledge();
        }
        self.prompt();
    }

    pub(super) fn type_in(&mut self, byte: u8, now: Time) {
        if self.modes.raw_input() {
            return match self.raw_input.push(byte) {
                RawHeard::Partial => {}
                RawHeard::Idle => self.idle(),
                RawHeard::Complete(bytes, command) => self.obey(&bytes, command, now),
            };
        }
        match byte {
            b'\r' => {
                let line = std::mem::take(&mut self.line);
                match Command::read(&line) {
                    Err(_) if let Some(blocks) = uploaded(&line) => {
                        self.reference = Grid::uploaded(blocks, self.modes.is_on(b"HD"));
                        self.idle();
                    }
                    Ok(None) => self.idle(),
                    Ok(Some(command)) => self.obey(&line, Ok(command), now),
                    Err(why) => self.obey(&line, Err(why), now),
                }
                // Keeps its memory for the next line.
                self.line = line;
                self.line.clear();
            }
            // Terminals send a line feed after a carriage return, some programs the end of a string.
            b'\n' | 0 => {}
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

    /// A line of text with its end.
    pub(super) fn say_line(&mut self, text: &[u8]) {
        let end = ["\r", " \r", "\r\n"][usize::from(self.switches().line_end)];
        self.say(&[text, end.as_bytes()].concat());
    }

    pub(super) fn acknowledge(&mut self) {
        if self.modes.suppresses_replies() {
            return;
        }
        if std::mem::take(&mut self.is_late) {
            self.say(b"AC");
            let late = std::mem::take(&mut self.last_packet);
            self.say(&late);
            return self.say_line(b"K");
        }
        self.say_line(b"ACK");
    }

    pub(super) fn prompt(&mut self) {
        let prompt = [":", ": ", "\r:\r"][usize::from(self.switches().prompt_line)];
        self.say(prompt.as_bytes());
    }

    pub(super) fn say_banner(&mut self, carriage_return: bool) {
        let Switches {
            version, module, ..
        } = *self.switches();
        let is_first = self.configuration.sensor == Sensor::Ov6620;
        let module = match module {
            2 => "",
            // The other way round.
            1 if is_first => " c7",
            1 => " c6",
            _ if is_first => " c6",
            _ => " c7",
        };
        let name = BANNERS.get(usize::from(version)).unwrap_or(&BANNERS[0]);
        let end = if carriage_return { "\r" } else { "" };
        let text = format!("{name}{module}{end}").into_bytes();
        self.say(&text);
    }
}
