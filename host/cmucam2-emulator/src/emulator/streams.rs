//! Packets and frames, one after the other.

use super::{Activity, Dump, Emulator, Note, Source, Stream, Time};
use crate::{
    blob::{self, Blob},
    colour::Bounds,
    differencing::Grid,
    frame_dump,
    modes::servo_position,
    packet::Packet,
    statistics::{Levels, Statistics},
    view::Snapshot,
};

/// The most frames a second of frame differencing.
const DIFFERENCES_PER_SECOND: u64 = 26;
const SECOND: Time = 1_000_000_000;

impl Emulator {
    /// Time that one frame takes.
    fn frame_time(&self, source: Source) -> Time {
        let time = self.modes.frame_time(self.switches());
        match source {
            Source::Difference(_) => time.max(SECOND / DIFFERENCES_PER_SECOND),
            Source::Colour | Source::Mean | Source::Histogram(_) => time,
        }
    }

    /// Time when the first frame is complete that is not over before this time.
    pub(super) fn next_frame_from(&self, source: Source, from: Time) -> Time {
        let time = self.frame_time(source);
        from.div_ceil(time) * time
    }

    /// The frame is complete: its packet, if there is one.
    pub(super) fn next_packet(&mut self, mut stream: Stream) {
        let now = stream.next_at;
        self.answer_at = now;
        let snapshot = self.capture(now);
        if let Some(margin) = stream.learn.take() {
            self.learn(&snapshot, margin);
        }
        let (packet, lost) = match stream.source {
            Source::Colour => self.track(&snapshot),
            Source::Difference(threshold) => self.compare(&snapshot, threshold),
            Source::Mean => (self.measure(&snapshot), false),
            Source::Histogram(channel) => (self.count(&snapshot, channel), false),
        };
        let first_counts = self.switches().filter_first == 1;
        let skip = lost && stream.lost.unwrap_or(!first_counts);
        if !(self.modes.is_on(b"PF") && skip) {
            for row in self.rows_before(stream.source, &snapshot) {
                self.say(&row);
            }
            self.send_packet(packet);
        }
        if self.breaks_down(now, self.wire.free_at().max(now)) {
            return;
        }
        stream.lost = Some(lost);
        if stream.single {
            self.activity = Activity::Command;
            return self.prompt();
        }
        let skipped = u64::from(self.modes.number(b"PS")) * self.frame_time(stream.source);
        stream.next_at =
            self.next_frame_from(stream.source, (now + skipped + 1).max(self.wire.free_at()));
        self.activity = Activity::Stream(stream);
    }

    fn send_packet(&mut self, packet: Packet) {
        let other = packet.letter != b'T';
        let raw =
            self.modes.raw_output() && !(other && self.configuration.switches.raw_packets == 0);
        let line = if raw { packet.raw() } else { packet.line() };
        let mut bytes = &line[..];
        if self.faults.cut.strikes() {
            self.note(|| Note::Fault("cut"));
            bytes = &bytes[..self.faults.cut.pick(bytes.len() as u64) as usize];
        }
        match bytes.strip_suffix(b"\r") {
            Some(text) if !raw => {
                self.last_packet = bytes.to_vec();
                self.say_line(text);
            }
            _ => self.say(bytes),
        }
        let end = self.wire.free_at();
        self.note(|| Note::Packet { packet, end });
    }

    /// Binary rows of a line mode.
    fn rows_before(&self, source: Source, snapshot: &Snapshot) -> Vec<Vec<u8>> {
        let region = self.modes.region(self.switches());
        let view = || self.view(snapshot);
        let [tracking, statistics, differencing] = self.modes.line_modes;
        match (source, tracking, statistics, differencing) {
            (Source::Colour, 1, _, _) => frame_dump::bitmap(&view(), region, &self.filter()),
            (Source::Colour, 2, _, _) => {
                let ((left, _), origin) = (self.corner(), self.switches().origin);
                frame_dump::rows(&view(), region, &self.filter(), left, origin)
            }
            (Source::Mean, _, 1 | 2, _) => {
                let height = self.switches().mean_lines_height == 1;
                frame_dump::means(&view(), region, statistics == 2, height)
            }
            (Source::Difference(threshold), _, _, 1 | 2) => {
                let channel = self.modes.number(b"DC");
                let now = Grid::of(&view(), region, channel, self.modes.is_on(b"HD"));
                if differencing == 2 {
                    return frame_dump::deltas(&now, &self.reference);
                }
                let differing = now.differing(&self.reference, threshold);
                frame_dump::difference_bitmap(now.side(), &differing)
            }
            _ => Vec::new(),
        }
    }

    /// The column and row from which coordinates count.
    fn corner(&self) -> (u8, u8) {
        let switches = self.switches();
        if switches.window_relative == 0 {
            return (0, 0);
        }
        let region = self.modes.region(switches);
        (region.x1, region.y1)
    }

    fn learn(&mut self, snapshot: &Snapshot, margin: u8) {
        let middle = self.modes.region(self.switches()).middle();
        let statistics = Levels::of(&self.view(snapshot), middle).statistics();
        self.modes.bounds = Bounds::around(statistics.mean, margin);
        if self.switches().window_mean == 1 {
            let packet = self.statistics_packet(&statistics);
            self.send_packet(packet);
        }
    }

    fn statistics_packet(&self, statistics: &Statistics) -> Packet {
        let numbers = [statistics.mean.levels(), statistics.deviation.levels()];
        Packet::masked(b'S', numbers.as_flattened(), self.modes.masks[1])
    }

    /// The packet, and true if nothing is tracked.
    fn track(&mut self, snapshot: &Snapshot) -> (Packet, bool) {
        let region = self.modes.region(self.switches());
        let view = self.view(snapshot);
        let blob = Blob::of(&view, region, &self.filter());
        let frame = view.frame();
        let pixels = blob::pixels(blob.count());
        let numbers = blob.numbers(self.corner(), self.switches().origin, pixels);
        let mut packet = Packet::masked(b'T', &numbers, self.modes.masks[0]);
        let reported = (0..2).filter(|&servo| self.modes.reports(servo));
        let position = |servo| self.modes.servos[usize::from(servo)];
        packet.numbers.extend(reported.map(position));
        if let Some((x, y)) = blob.middle() {
            self.follow(0, i16::from(x) - i16::from(frame.width / 2));
            self.follow(1, i16::from(frame.height / 2) - i16::from(y));
        }
        (packet, numbers == [0; 8])
    }

    /// Turns a servo that the camera controls towards a target that is so many pixels off: beyond `far` pixels from
    /// the middle by `step`, beyond `near` by half of that.
    fn follow(&mut self, servo: u8, off: i16) {
        let axes = self.modes.told(b"SP").as_chunks::<3>().0;
        let (position, axis) = (
            self.modes.servos[usize::from(servo)],
            axes.get(usize::from(servo)),
        );
        let (true, 2.., Some(&[far, near, step])) = (self.modes.controls(servo), position, axis)
        else {
            return;
        };
        let step = match off.unsigned_abs() {
            pixels if pixels > u16::from(far) => step,
            pixels if pixels > u16::from(near) => step / 2,
            _ => 0,
        };
        let next = if off > 0 {
            position.saturating_add(step)
        } else {
            position.saturating_sub(step)
        };
        // At the end of its travel it stays.
        if servo_position(next) == next {
            self.modes.servos[usize::from(servo)] = next;
        }
    }

    fn compare(&mut self, snapshot: &Snapshot, threshold: u8) -> (Packet, bool) {
        let region = self.modes.region(self.switches());
        let channel = self.modes.number(b"DC");
        let now = Grid::of(
            &self.view(snapshot),
            region,
            channel,
            self.modes.is_on(b"HD"),
        );
        let blob = now.blob(&self.reference, &self.masked, threshold);
        let pixels = if self.switches().difference_pixels == 1 {
            blob::pixels(blob.count())
        } else {
            u8::try_from(blob.count()).unwrap_or(u8::MAX)
        };
        let numbers = blob.numbers((0, 0), self.switches().origin, pixels);
        let packet = Packet::masked(b'T', &numbers, self.modes.masks[0]);
        (packet, numbers == [0; 8])
    }

    fn measure(&self, snapshot: &Snapshot) -> Packet {
        let region = self.modes.region(self.switches());
        let statistics = Levels::of(&self.view(snapshot), region).statistics();
        self.statistics_packet(&statistics)
    }

    fn count(&self, snapshot: &Snapshot, channel: u8) -> Packet {
        let region = self.modes.region(self.switches());
        let view = self.view(snapshot);
        let levels = if self.modes.is_on(b"HT") {
            Levels::of_tracked(&view, region, &self.filter())
        } else {
            Levels::of(&view, region)
        };
        let (bins, scale) = self.modes.histogram(self.switches());
        Packet {
            letter: b'H',
            numbers: levels.histogram(channel, bins, scale),
        }
    }

    pub(super) fn begin_dump(&mut self, channel: Option<u8>, now: Time) {
        self.acknowledge();
        self.dump_next_frame(channel, now);
    }

    fn dump_next_frame(&mut self, channel: Option<u8>, now: Time) {
        let from = now.max(self.wire.free_at());
        let next_at = self.next_frame_from(Source::Mean, from);
        self.activity = Activity::Dump(Box::new(Dump {
            // Taken when its time has come.
            snapshot: Snapshot::default(),
            channel,
            row: None,
            next_at,
            stopped: false,
        }));
    }

    /// The next row of a frame, when the one before has left.
    pub(super) fn next_row(&mut self, now: Time) {
        self.answer_at = now;
        let Activity::Dump(mut dump) = std::mem::replace(&mut self.activity, Activity::Command)
        else {
            return;
        };
        let region = self.modes.region(self.switches());
        let Some(y) = dump.row else {
            if self.breaks_down(now, now) {
                return;
            }
            dump.snapshot = self.capture(now);
            self.say(&frame_dump::header(region));
            dump.row = Some(region.y1);
            dump.next_at = self.wire.free_at();
            self.activity = Activity::Dump(dump);
            return;
        };
        // Between two rows there is one mark, whichever of them it belongs to.
        let switches = self.switches();
        let before = y == region.y1 && switches.first_row_mark == 1;
        let after = y < region.y2 || switches.last_row_mark == 1;
        let marks = [before, after].map(|mark| mark && switches.row_marks == 1);
        let view = self.view(&dump.snapshot);
        let row = frame_dump::row(&view, region, y, dump.channel, marks);
        self.say(&row);
        if y < region.y2 {
            dump.row = Some(y + 1);
            dump.next_at = self.wire.free_at();
            self.activity = Activity::Dump(dump);
            return;
        }
        self.say(&[frame_dump::END]);
        if self.modes.is_on(b"FS") && !dump.stopped {
            return self.dump_next_frame(dump.channel, now);
        }
        self.prompt();
        if dump.stopped && !self.modes.is_on(b"FS") {
            // The carriage return has waited; it finds the camera idle.
            self.acknowledge();
            self.prompt();
        }
    }
}
