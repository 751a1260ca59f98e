//! Reactions of the camera to commands.

use super::{Activity, Emulator, MILLISECOND, Note, Source, Stream, Time};
use crate::{
    colour::Bounds,
    command::{Command, Refusal},
    differencing::Grid,
    modes::{RawMode, ServoAxis, ServoMask, ServoPin},
    sensor::Sensor,
    statistics::BINS,
};

/// Margin of `TW` to either side of the mean, unless the command gives one.
const LEARN_MARGIN: u8 = 30;
/// Bins that the numbers 0, 1 and 2 of `HC` select, if they do not mean themselves.
const SELECTED_BINS: [u8; 3] = [BINS, BINS / 2, BINS / 4];

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
        if !self.modes.raw.suppresses_replies() {
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
        if self.modes.raw.output() && self.switches().raw_values == 1 {
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
            single: self.modes.poll || one_packet,
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
            (b"GS", &[servo]) => self.values(&[self.modes.servo_value(usize::from(servo))]),
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
                if self.modes.buffer {
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
        self.reference = Grid::uploaded(blocks, self.modes.fine_grid);
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
        let modes = &mut self.modes;
        let arguments = &command.arguments[..];
        let first = arguments.first().copied().unwrap_or(0);
        let on = first != 0;
        match (&command.letters, arguments) {
            (b"BM", _) => {
                modes.buffer = on;
                self.held = None;
                if on {
                    self.held = Some(self.capture(now));
                }
            }
            (b"CP", _) => modes.power = on,
            (b"CR", pairs) => {
                if pairs.is_empty() {
                    modes.reset_registers();
                }
                for pair in pairs.as_chunks::<2>().0 {
                    modes.set_register(pair[0], pair[1]);
                }
            }
            (b"CT", _) => {
                modes.sensor = if on { Sensor::Ov7620 } else { Sensor::Ov6620 };
                modes.window = None;
            }
            (b"DC", _) => modes.difference_channel = first,
            (b"DS", &[x, y]) => {
                modes.down_sampling = [x, y];
                modes.window = None;
            }
            (b"FS", _) => modes.frame_stream = on,
            (b"HC", more) => {
                modes.histogram_bins = if self.configuration.switches.histogram_bins == 1 {
                    first.clamp(1, BINS)
                } else {
                    SELECTED_BINS[usize::from(first).min(SELECTED_BINS.len() - 1)]
                };
                modes.histogram_scale = more.get(1).copied().unwrap_or(0);
            }
            (b"HD", _) if modes.fine_grid != on => {
                modes.fine_grid = on;
                self.reference = Grid::dark(on);
                self.masked.clear();
            }
            (b"HR", _) => {
                modes.high_resolution = on;
                modes.window = None;
            }
            (b"HT", _) => modes.histogram_tracked = on,
            (b"L0", _) => modes.leds[0] = first,
            (b"L1", _) => modes.leds[1] = first,
            (b"LM", &[kind, mode]) => modes.line_modes[usize::from(kind)] = mode,
            (b"NF", _) => modes.noise_filter = first,
            (b"OM", &[0, mask]) => modes.tracking_mask = mask,
            (b"OM", &[_, mask]) => modes.statistics_mask = mask,
            (b"PD", _) => modes.pixel_difference = on,
            (b"PF", _) => modes.packet_filter = on,
            (b"PM", _) => modes.poll = on,
            (b"PS", _) => modes.packet_skip = first,
            (b"RM", _) => {
                modes.raw = RawMode(first);
                self.raw_input.clear();
            }
            (b"SM", _) => modes.servo_mask = ServoMask(first),
            (b"SO", &[servo, high]) => {
                modes.servos[usize::from(servo)] = ServoPin::Output(high != 0);
            }
            (b"SP", axes) => {
                for (axis, numbers) in modes
                    .servo_axes
                    .iter_mut()
                    .zip(axes.as_chunks::<3>().0.iter())
                {
                    *axis = ServoAxis {
                        far: numbers[0],
                        near: numbers[1],
                        step: numbers[2],
                    };
                }
            }
            (b"SV", &[servo, position]) => {
                modes.servos[usize::from(servo)] = ServoPin::at(position);
            }
            (b"ST", bounds) => self.set_bounds(bounds),
            (b"TI", _) => modes.invert = on,
            (b"VW", window) => modes.window = window.try_into().ok(),
            // All others are executed, not set, or set already.
            _ => {}
        }
    }

    fn grid(&mut self, now: Time) -> Grid {
        let snapshot = self.capture(now);
        let channel = self.modes.difference_channel;
        let region = self.modes.region(self.switches());
        Grid::of(&self.view(&snapshot), region, channel, self.modes.fine_grid)
    }
}
