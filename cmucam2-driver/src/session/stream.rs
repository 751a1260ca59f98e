//! Packets and images as they come.

use super::{Answer, Fault, Job, Link, Phase, Session};
use crate::{
    command::{Command, Reply},
    packet::{Packet, PacketKind},
    parser::{Event, IMAGES, RowState},
};

impl Session {
    pub(super) fn enter_stream(&mut self, now: u64) {
        self.phase = Phase::Stream;
        self.heard = false;
        let packets = u32::from(self.modes.packet_skip()) + 1;
        self.wait(now, self.policy.packet_us.saturating_mul(packets));
    }

    /// Whether one packet ends the exchange.
    fn takes_one(&self) -> bool {
        self.modes.poll() || !matches!(self.job, Job::Next { .. })
    }

    fn is_frame(&self) -> bool {
        self.command.reply() == Reply::Frame
    }

    /// Whether the images between packets are wanted.
    fn wants_images(&self) -> bool {
        matches!(self.job, Job::Next { row: Some(_) })
    }

    pub(super) fn streamed(&mut self, event: Event, now: u64, row: &mut [u8]) {
        if self.phase == Phase::Trailing {
            return match event {
                Event::Prompt => {
                    self.link = Link::Prompt;
                    self.completed(now);
                }
                Event::Packet(_) | Event::Header(_) => self.goes_on(now),
                _ => {}
            };
        }
        match event {
            Event::Packet(packet) => self.packet(packet, now),
            Event::Header(_) | Event::Pixel(..) | Event::RowCut(_) | Event::ImageEnd { .. }
                if !IMAGES => {}
            Event::Header(header) => {
                self.row_bytes = header.row_bytes;
                self.row_at = 0;
                if self.wants_images() {
                    self.finish(Answer::Header(header));
                }
            }
            Event::Pixel(byte, state) => self.pixel(byte, state, row),
            Event::RowCut(bytes) => {
                self.row_at = 0;
                if self.wants_images() {
                    self.finish(Answer::Row {
                        bytes,
                        intact: false,
                    });
                }
            }
            Event::ImageEnd { rows, intact } => self.image_end(rows, intact, now),
            Event::Prompt => self.unexpected_prompt(now),
            Event::Ack | Event::Nck | Event::Banner(_) | Event::Values(_) => {}
        }
    }

    /// One packet was wanted and another one comes.
    fn goes_on(&mut self, now: u64) {
        // In poll mode it would not: the camera has forgotten that, so it has restarted.
        if self.modes.poll() && !self.is_frame() {
            self.restarted();
            if self.phase == Phase::Idle {
                return;
            }
        }
        self.synchronise_from(now);
    }

    fn packet(&mut self, packet: Packet, now: u64) {
        if self.command == Command::TrackWindow
            && let Packet::Statistics(statistics) = packet
        {
            self.window_mean = statistics.mean();
        }
        if !self.is_expected(&packet) {
            return;
        }
        self.lost = match packet {
            Packet::Tracking(tracking) => tracking.is_lost(),
            Packet::Statistics(_) | Packet::Histogram(_) => false,
        };
        self.quiet = 0;
        self.dropped_then = self.parser.dropped().bytes;
        self.answered(Answer::Packet(packet), now);
    }

    /// The answer to this request has come; the stream may go on.
    fn answered(&mut self, answer: Answer, now: u64) {
        if !self.takes_one() {
            return self.finish(answer);
        }
        self.trail(answer, now);
    }

    /// Only the prompt is missing.
    fn trail(&mut self, answer: Answer, now: u64) {
        self.answer = Some(answer);
        self.complete = true;
        self.phase = Phase::Trailing;
        self.wait(now, self.policy.settle_us);
    }

    fn pixel(&mut self, byte: u8, state: RowState, row: &mut [u8]) {
        if let Some(place) = row.get_mut(usize::from(self.row_at)) {
            *place = byte;
        }
        self.row_at = self.row_at.saturating_add(1);
        if state == RowState::Open {
            return;
        }
        let bytes = self.row_at;
        self.row_at = 0;
        if self.wants_images() {
            self.finish(Answer::Row {
                bytes,
                intact: state == RowState::Full,
            });
        }
    }

    fn image_end(&mut self, rows: u16, intact: bool, now: u64) {
        self.row_bytes = 0;
        let answer = Answer::End { rows, intact };
        if self.is_frame() && !self.modes.frame_stream() {
            self.stream = None;
            return self.trail(answer, now);
        }
        if self.wants_images() {
            self.finish(answer);
        }
    }

    /// In a stream a damaged character may look like a prompt, so only what must be followed by
    /// one believes it. If it was real, silence follows.
    fn unexpected_prompt(&mut self, now: u64) {
        if self.is_frame() {
            self.link = Link::Prompt;
            self.stream = None;
            return self.fail(Fault::Garbage);
        }
        if !self.takes_one() {
            return;
        }
        if self.quiet_is_right() {
            self.link = Link::Prompt;
            self.answer = Some(Answer::Quiet);
            return self.completed(now);
        }
        self.irregular(now);
    }

    /// Packet filter is on, and the last packet was empty or may have been dropped.
    fn quiet_is_right(&self) -> bool {
        self.modes.packet_filter()
            && matches!(
                self.command.reply(),
                Reply::Packets(PacketKind::Tracking | PacketKind::Difference)
            )
            && (self.lost || self.parser.dropped().bytes != self.dropped_then)
    }

    pub(super) fn stream_timeout(&mut self, now: u64) {
        if self.phase == Phase::Trailing {
            return self.synchronise_from(now);
        }
        let streaming = matches!(self.job, Job::Next { .. });
        if self.is_frame() {
            self.link = Link::Unknown;
            self.stream = None;
            return self.fail(self.nothing_useful());
        }
        if self.quiet_is_right() {
            if !streaming {
                return self.trail_quiet(now);
            }
            self.quiet = self.quiet.saturating_add(1);
            if self.quiet <= self.policy.quiet_calls {
                return self.finish(Answer::Quiet);
            }
        } else if !streaming {
            self.link = Link::Unknown;
            return self.attempt_failed(self.nothing_useful(), now);
        } else if self.attempts > 0 {
            self.link = Link::Unknown;
            return self.fail(self.nothing_useful());
        }
        // Stop the stream and start it again: that tells a camera that left it from one that is
        // gone.
        self.attempts = self.attempts.saturating_add(1);
        self.probing = true;
        self.link = Link::Unknown;
        self.proceed(now);
    }

    fn trail_quiet(&mut self, now: u64) {
        self.answer = Some(Answer::Quiet);
        self.complete = true;
        self.synchronise_from(now);
    }

    /// Whether the stream means the same after a restart of the camera.
    pub(super) fn stream_can_resume(&self) -> bool {
        match self.stream {
            Some(Command::TrackColour(_)) => self.modes.bounds().is_some(),
            Some(Command::GetMean | Command::GetHistogram(_)) => true,
            _ => false,
        }
    }
}
