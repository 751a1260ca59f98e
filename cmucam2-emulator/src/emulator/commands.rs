//! What the camera does when it is told something.

use cmucam2_driver::{
    argument::ArgumentError,
    colour::{ColourBounds, ColourChannel},
    command::{Command, CommandError, LineMode, OutputMask},
    register::Registers,
};

use super::{Activity, Emulator, MILLISECOND, Note, Source, Stream, Time};
use crate::{
    differencing::Grid,
    modes::{Bounds, ServoPin},
    statistics::BINS,
};

/// Bins that the numbers 0, 1 and 2 of `HC` select, if they do not mean themselves.
const SELECTED_BINS: [u8; 3] = [BINS, BINS / 2, BINS / 4];

impl Emulator {
    /// One line, without its carriage return.
    pub(super) fn obey(&mut self, line: &[u8], now: Time) {
        let command = match Command::parse(line) {
            Ok(Command::Idle) => {
                self.acknowledge();
                return self.prompt();
            }
            Ok(command) => command,
            Err(error) => return self.not_a_command(line, error, now),
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
        self.note(|| Note::Command(command));
        self.execute(command, now);
    }

    fn refuse(&mut self) {
        if !self.modes.raw.suppress_replies() {
            self.say(b"NCK\r");
        }
        self.prompt();
    }

    /// Bounds that are turned round may be accepted all the same.
    fn not_a_command(&mut self, line: &[u8], error: CommandError, now: Time) {
        let inverted = error == CommandError::Argument(ArgumentError::BoundsOrder)
            && self.switches().inverted_bounds == 1;
        if !inverted {
            self.note(|| Note::Refused {
                line: line.to_vec(),
                why: error.to_string(),
            });
            return self.refuse();
        }
        let mut values = [0; 6];
        let numbers = String::from_utf8_lossy(&line[2..]).into_owned();
        for (value, number) in values.iter_mut().zip(numbers.split_ascii_whitespace()) {
            *value = number.parse().unwrap_or(0);
        }
        self.modes.bounds = Bounds::Nothing(values);
        if line[0].eq_ignore_ascii_case(&b'T') {
            self.begin(Source::Colour, now);
        } else {
            self.done();
        }
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
        self.begin_stream(source, false, now);
    }

    fn begin_stream(&mut self, source: Source, learn: bool, now: Time) {
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

    fn execute(&mut self, command: Command, now: Time) {
        match command {
            Command::GetButton => {
                let pressed = std::mem::take(&mut self.button);
                self.values(&[u8::from(pressed)]);
            }
            Command::GetInputs => self.values(&[self.inputs]),
            Command::GetServo(servo) => {
                self.values(&[self.modes.servo_value(usize::from(servo.number()))]);
            }
            Command::GetTrackingBounds => {
                let [a, b, c, d, e, f] = self.modes.bounds.values();
                if self.switches().bounds_order == 0 {
                    self.values(&[a, b, c, d, e, f]);
                } else {
                    self.values(&[a, c, e, b, d, f]);
                }
            }
            Command::GetVersion => {
                self.acknowledge();
                self.say_banner(self.switches().version_return == 1);
                self.prompt();
            }
            Command::GetWindow => {
                let region = self.modes.region(self.switches());
                let origin = self.switches().origin;
                self.values(
                    &[region.x1, region.y1, region.x2, region.y2].map(|corner| corner + origin),
                );
            }
            Command::GetMean => self.begin(Source::Mean, now),
            Command::GetHistogram(channel) => self.begin(Source::Histogram(channel), now),
            Command::FrameDifference(threshold) => self.begin(Source::Difference(threshold), now),
            Command::TrackColour(bounds) => {
                if let Some(bounds) = bounds {
                    self.modes.bounds = Bounds::Colours(bounds);
                }
                self.begin(Source::Colour, now);
            }
            Command::TrackWindow => self.begin_stream(Source::Colour, true, now),
            Command::SendFrame(channel) => self.begin_dump(channel, now),
            Command::UploadDifference => {
                if self.switches().upload_ack == 0 {
                    self.acknowledge();
                }
                self.activity = Activity::Upload {
                    blocks: [0; 64],
                    len: 0,
                };
            }
            Command::Sleep | Command::DeepSleep => {
                self.acknowledge();
                if self.switches().sleep_prompt == 1 {
                    self.prompt();
                }
                self.activity = Activity::Sleep {
                    deep: command == Command::DeepSleep,
                };
            }
            Command::Reset => self.reset(),
            Command::LoadFrame => {
                self.reference = self.grid(now);
                self.done();
            }
            Command::MaskDifference(threshold) => {
                self.masked = self.grid(now).differing(&self.reference, threshold);
                self.done();
            }
            Command::ReadFrame => {
                if self.modes.buffer {
                    self.held = None;
                    self.held = Some(self.capture(now));
                }
                self.done();
            }
            Command::CharacterDelay(bits) => {
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

    /// Commands that only set something.
    fn set(&mut self, command: Command, now: Time) {
        // Until now the sensor has adapted as it was told before.
        self.adapt(now);
        let modes = &mut self.modes;
        match command {
            Command::BufferMode(on) => {
                modes.buffer = on;
                self.held = None;
                if on {
                    self.held = Some(self.capture(now));
                }
            }
            Command::CameraPower(on) => modes.power = on,
            Command::Registers(registers) => self.write_registers(&registers),
            Command::CameraType(sensor) => {
                modes.sensor = sensor;
                modes.window = None;
            }
            Command::DifferenceChannel(channel) => modes.difference_channel = channel,
            Command::DownSample(sampling) => {
                modes.down_sampling = sampling;
                modes.window = None;
            }
            Command::FrameStream(on) => modes.frame_stream = on,
            Command::HistogramConfiguration { bins, scale } => {
                modes.histogram_bins = if self.configuration.switches.histogram_bins == 1 {
                    bins.clamp(1, BINS)
                } else {
                    SELECTED_BINS[usize::from(bins).min(SELECTED_BINS.len() - 1)]
                };
                modes.histogram_scale = scale;
            }
            Command::HighResolutionDifference(on) if modes.fine_grid != on => {
                modes.fine_grid = on;
                self.reference = Grid::dark(on);
                self.masked.clear();
            }
            Command::HighResolution(on) => {
                modes.high_resolution = on;
                modes.window = None;
            }
            Command::HistogramTracked(on) => modes.histogram_tracked = on,
            Command::Led0(mode) => modes.leds[0] = mode,
            Command::Led1(mode) => modes.leds[1] = mode,
            Command::LineMode(LineMode::Tracking(lines)) => modes.tracking_lines = lines,
            Command::LineMode(LineMode::Statistics(lines)) => modes.statistics_lines = lines,
            Command::NoiseFilter(pixels) => modes.noise_filter = pixels,
            Command::OutputMask(OutputMask::Tracking(mask)) => modes.tracking_mask = mask,
            Command::OutputMask(OutputMask::Statistics(mask)) => modes.statistics_mask = mask,
            Command::PixelDifference(on) => modes.pixel_difference = on,
            Command::PacketFilter(on) => modes.packet_filter = on,
            Command::PollMode(on) => modes.poll = on,
            Command::PacketSkip(packets) => modes.packet_skip = packets,
            Command::RawMode(mode) => modes.raw = mode,
            Command::ServoMask(mask) => modes.servo_mask = mask,
            Command::ServoOutput(servo, high) => {
                modes.servos[usize::from(servo.number())] = ServoPin::Output(high);
            }
            Command::ServoParameters(parameters) => modes.servo_parameters = parameters,
            Command::ServoPosition(servo, position) => {
                modes.servos[usize::from(servo.number())] = ServoPin::Position(position);
            }
            Command::SetBounds(bounds) => modes.bounds = Bounds::Colours(bounds),
            Command::TrackInvert(on) => modes.invert = on,
            Command::VirtualWindow(window) => modes.window = window,
            // All others are executed, not set, or set already.
            _ => {}
        }
    }

    fn write_registers(&mut self, registers: &Registers) {
        if registers.is_empty() {
            self.modes.reset_registers();
        }
        for (register, value) in registers.iter() {
            self.modes.set_register(register, value);
        }
    }

    fn grid(&mut self, now: Time) -> Grid {
        let snapshot = self.capture(now);
        let channel: ColourChannel = self.modes.difference_channel;
        let region = self.modes.region(self.switches());
        Grid::of(&self.view(&snapshot), region, channel, self.modes.fine_grid)
    }

    pub(super) fn learned(&mut self, bounds: ColourBounds) {
        self.modes.bounds = Bounds::Colours(bounds);
    }
}
