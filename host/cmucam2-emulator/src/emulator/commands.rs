//! Reactions of the camera to commands.

use super::{Activity, Emulator, MILLISECOND, Note, Source, Stream, Time};
use crate::{
    colour::Bounds,
    command::{Command, Refusal},
    differencing::Grid,
    modes::servo_position,
    sensor::Sensor,
};

/// Margin of `TW` to either side of the mean, unless the command gives one.
const LEARN_MARGIN: u8 = 30;

impl Emulator {
    /// A carriage return of its own.
    pub(super) fn idle(&mut self) {
        self.done();
    }

    /// Obeys what was heard, which is this command.
    pub(super) fn obey(&mut self, heard: &[u8], command: Result<Command, Refusal>, now: Time) {
        let command = command.and_then(|command| self.judge(command));
        let command = match command {
            Ok(command) => command,
            Err(why) => {
                self.note(|| Note::Refused {
                    line: heard.to_vec(),
                    why: why.to_owned(),
                });
                return self.refuse();
            }
        };
        if self.breaks_down(now, now) {
            return;
        }
        if self.faults.slow.strikes() {
            self.note(|| Note::Fault("slow"));
            self.answer_at += (100 + self.faults.slow.pick(600)) * MILLISECOND;
        }
        if self.faults.nck.strikes() {
            self.note(|| Note::Fault("nck"));
            return self.refuse();
        }
        self.note(|| Note::Command(command.clone()));
        self.execute(&command, now);
    }

    fn refuse(&mut self) {
        if !self.modes.suppresses_replies() {
            self.say_line(b"NCK");
        }
        self.prompt();
    }

    /// Bounds that are turned round may be refused.
    fn judge(&self, command: Command) -> Result<Command, Refusal> {
        let refuses = self.switches().inverted_bounds == 0;
        let sets_bounds = matches!(&command.letters, b"TC" | b"ST");
        let mut pairs = command.arguments.as_chunks::<2>().0.iter();
        if refuses && sets_bounds && pairs.any(|pair| pair[0] > pair[1]) {
            return Err("a lower bound is above its upper bound");
        }
        Ok(command)
    }

    fn done(&mut self) {
        self.acknowledge();
        self.prompt();
    }

    fn values(&mut self, values: &[u8]) {
        self.acknowledge();
        if self.modes.raw_output() && self.switches().raw_values == 1 {
            let mut bytes = vec![0xFF];
            bytes.extend(values.iter().map(|value| value.min(&254)));
            self.say(&bytes);
        } else {
            let numbers: Vec<String> = values.iter().map(u8::to_string).collect();
            self.say(format!("{}\r", numbers.join(" ")).as_bytes());
        }
        self.prompt();
    }

    fn begin(&mut self, source: Source, now: Time) {
        self.begin_stream(source, None, now);
    }

    fn begin_stream(&mut self, source: Source, learn: Option<u8>, now: Time) {
        self.acknowledge();
        let one_packet =
            matches!(source, Source::Histogram(_)) && self.switches().histogram_stream == 0;
        let stream = Stream {
            source,
            next_at: self.next_frame_from(source, now.max(self.wire.free_at())),
            single: self.modes.is_on(b"PM") || one_packet,
            learn,
            lost: None,
        };
        self.activity = Activity::Stream(stream);
    }

    fn execute(&mut self, command: &Command, now: Time) {
        match (&command.letters, &command.arguments[..]) {
            (b"GB", _) => {
                let pressed = std::mem::take(&mut self.button);
                self.values(&[u8::from(pressed)]);
            }
            (b"GI", _) => self.values(&[self.inputs]),
            (b"GS", &[servo]) => self.values(&[self.modes.servos[usize::from(servo)]]),
            (b"GT", _) => {
                let [a, b, c, d, e, f] = self.modes.bounds.0;
                if self.switches().bounds_order == 0 {
                    self.values(&[a, b, c, d, e, f]);
                } else {
                    self.values(&[a, c, e, b, d, f]);
                }
            }
            (b"GV", _) => {
                self.acknowledge();
                self.say_banner(self.switches().version_return == 1);
                self.prompt();
            }
            (b"GW", _) => {
                let region = self.modes.region(self.switches());
                let origin = self.switches().origin;
                self.values(
                    &[region.x1, region.y1, region.x2, region.y2].map(|corner| corner + origin),
                );
            }
            (b"GM", _) => self.begin(Source::Mean, now),
            (b"GH", &[channel]) => self.begin(Source::Histogram(channel), now),
            (b"FD", &[threshold]) => self.begin(Source::Difference(threshold), now),
            (b"TC", bounds) => {
                self.set_bounds(bounds);
                self.begin(Source::Colour, now);
            }
            (b"TW", margin) => {
                let margin = margin.first().copied().unwrap_or(LEARN_MARGIN);
                self.begin_stream(Source::Colour, Some(margin), now);
            }
            (b"SF", channel) => self.begin_dump(channel.first().copied(), now),
            (b"UD", _) => {
                if self.switches().upload_ack == 0 {
                    self.acknowledge();
                }
                self.activity = Activity::Upload {
                    blocks: [0; 64],
                    len: 0,
                };
            }
            (b"SL" | b"SD", _) => {
                self.acknowledge();
                if self.switches().sleep_prompt == 1 {
                    self.prompt();
                }
                self.activity = Activity::Sleep {
                    deep: command.letters == *b"SD",
                };
            }
            (b"RS", _) => self.reset(),
            (b"LF", _) => {
                self.reference = self.grid(now);
                self.done();
            }
            (b"MD", &[threshold]) => {
                self.masked = self.grid(now).differing(&self.reference, threshold);
                self.done();
            }
            (b"RF", _) => {
                if self.modes.is_on(b"BM") {
                    self.held = None;
                    self.held = Some(self.capture(now));
                }
                self.done();
            }
            (b"DM", &[bits]) => {
                self.done();
                self.wire.pause_bits = bits;
            }
            _ => {
                self.set(command, now);
                self.done();
            }
        }
    }

    fn reset(&mut self) {
        self.acknowledge();
        self.restart(self.wire.free_at(), false);
    }

    pub(super) fn uploaded(&mut self, blocks: &[u8; 64]) {
        self.reference = Grid::uploaded(blocks, self.modes.is_on(b"HD"));
        self.activity = Activity::Command;
        if self.switches().upload_ack == 1 {
            self.acknowledge();
        }
        self.prompt();
    }

    fn set_bounds(&mut self, bounds: &[u8]) {
        if let Ok(bounds) = bounds.try_into() {
            self.modes.bounds = Bounds(bounds);
        }
    }

    /// Commands that only set something.
    fn set(&mut self, command: &Command, now: Time) {
        // Until now the sensor has adapted by its former settings.
        self.adapt(now);
        let grid_was_fine = self.modes.is_on(b"HD");
        self.modes.tell(command);
        let modes = &mut self.modes;
        match (&command.letters, &command.arguments[..]) {
            (b"BM", &[on]) => {
                self.held = None;
                if on != 0 {
                    self.held = Some(self.capture(now));
                }
            }
            (b"CR", pairs) => {
                if pairs.is_empty() {
                    modes.reset_registers();
                }
                for pair in pairs.as_chunks::<2>().0 {
                    modes.set_register(pair[0], pair[1]);
                }
            }
            (b"CT", &[second]) => {
                modes.sensor = if second != 0 {
                    Sensor::Ov7620
                } else {
                    Sensor::Ov6620
                };
                modes.open_window();
            }
            (b"DS" | b"HR", _) => modes.open_window(),
            (b"HD", &[fine]) if (fine != 0) != grid_was_fine => {
                self.reference = Grid::dark(fine != 0);
                self.masked.clear();
            }
            (b"LM", &[kind, mode]) => modes.line_modes[usize::from(kind)] = mode,
            (b"OM", &[kind, mask]) => modes.masks[usize::from(kind)] = mask,
            (b"RM", _) => self.raw_input.clear(),
            (b"SO", &[servo, high]) => modes.servos[usize::from(servo)] = high,
            (b"SV", &[servo, to]) => modes.servos[usize::from(servo)] = servo_position(to),
            (b"ST", bounds) => self.set_bounds(bounds),
            _ => {}
        }
    }

    fn grid(&mut self, now: Time) -> Grid {
        let snapshot = self.capture(now);
        let channel = self.modes.number(b"DC");
        let region = self.modes.region(self.switches());
        Grid::of(
            &self.view(&snapshot),
            region,
            channel,
            self.modes.is_on(b"HD"),
        )
    }
}
