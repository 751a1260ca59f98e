//! What only the feature `full` can ask for, because its replies are of another form: frames, line
//! modes, raw output, masked packets, reports of servos, histograms, uploads; or silence is one.

use super::{Call, Cmucam2};
use crate::{
    colour::ColourChannel,
    command::{Command, LineMode, OutputMask, RawMode, StatisticsLines, TrackingLines},
    packet::{Histogram, Packet},
    parser::ImageHeader,
    servo::{Servo, ServoMask},
    session::{Answer, Modes, Request},
};

/// A part of a stream that carries images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Part {
    /// An image begins.
    Header(ImageHeader),
    /// A row is in the caller's buffer.
    Row {
        /// How many bytes of it.
        bytes: u16,
        /// Whether it is complete and every byte is possible.
        intact: bool,
    },
    /// The image is over.
    End {
        /// How many rows came.
        rows: u16,
        /// Whether all of it was as announced.
        intact: bool,
    },
    /// A packet between images.
    Packet(Packet),
    /// Nothing is tracked, and packet filter is on.
    Quiet,
}

fn part(answer: Answer, _: &Modes) -> Option<Part> {
    Some(match answer {
        Answer::Header(header) => Part::Header(header),
        Answer::Row { bytes, intact } => Part::Row { bytes, intact },
        Answer::End { rows, intact } => Part::End { rows, intact },
        Answer::Packet(packet) => Part::Packet(packet),
        Answer::Quiet => Part::Quiet,
        Answer::Done | Answer::Values(_) | Answer::Version(_) | Answer::Bounds(_) => return None,
    })
}

fn histogram(answer: Answer, _: &Modes) -> Option<Histogram> {
    match answer {
        Answer::Packet(Packet::Histogram(histogram)) => Some(histogram),
        _ => None,
    }
}

/// Frames, and rows between packets.
impl<U, D, K> Cmucam2<U, D, K> {
    /// Sends a frame of one channel or all three: [`Cmucam2::next_part`] reads it row by row.
    pub fn send_frame(&mut self, channel: Option<ColourChannel>) -> Call<'_, U, D, (), K> {
        self.stream(Command::SendFrame(channel))
    }

    /// Whether further frames follow the first.
    pub fn frame_stream(&mut self, on: bool) -> Call<'_, U, D, (), K> {
        self.simple(Command::FrameStream(on))
    }

    /// Row data before each colour-tracking packet.
    pub fn tracking_lines(&mut self, lines: TrackingLines) -> Call<'_, U, D, (), K> {
        self.simple(Command::LineMode(LineMode::Tracking(lines)))
    }

    /// Row data before each statistics packet.
    pub fn statistics_lines(&mut self, lines: StatisticsLines) -> Call<'_, U, D, (), K> {
        self.simple(Command::LineMode(LineMode::Statistics(lines)))
    }

    /// The next part of a frame or of a stream with line mode. A row goes into `row`, which must
    /// hold [`ImageHeader::row_bytes`]; a full colour row of 176 pixels has 528.
    pub fn next_part<'a>(&'a mut self, row: &'a mut [u8]) -> Call<'a, U, D, Part, K> {
        let request = Request::NextPart { row: row.len() };
        Call {
            row,
            ..self.call(request, part)
        }
    }
}

/// Packets of another form, or fewer of them.
impl<U, D, K> Cmucam2<U, D, K> {
    /// Binary packets: shorter, but hardly any corruption can be detected. Firmware 1.00 has bugs
    /// here.
    pub fn raw_output(&mut self, on: bool) -> Call<'_, U, D, (), K> {
        self.simple(Command::RawMode(if on {
            RawMode::OUTPUT
        } else {
            RawMode::OFF
        }))
    }

    /// Which fields packets carry.
    pub fn output_mask(&mut self, mask: OutputMask) -> Call<'_, U, D, (), K> {
        self.simple(Command::OutputMask(mask))
    }

    /// The histogram of a channel, once.
    pub fn histogram(&mut self, channel: ColourChannel) -> Call<'_, U, D, Histogram, K> {
        self.ask(Command::GetHistogram(channel), histogram)
    }

    /// Bins and scale of the histogram, as numbers of the firmware.
    pub fn histogram_configuration(&mut self, bins: u8, scale: u8) -> Call<'_, U, D, (), K> {
        self.simple(Command::HistogramConfiguration { bins, scale })
    }

    /// Histogram of tracked pixels only.
    pub fn histogram_tracked(&mut self, on: bool) -> Call<'_, U, D, (), K> {
        self.simple(Command::HistogramTracked(on))
    }

    /// Sends a reference frame: one level for each block of the 8 x 8 grid, row by row.
    pub fn upload_difference<'a>(&'a mut self, blocks: &'a [u8; 64]) -> Call<'a, U, D, (), K> {
        Call {
            payload: blocks,
            ..self.simple(Command::UploadDifference)
        }
    }

    /// What the camera does with pan and tilt while it tracks.
    pub fn servo_mask(&mut self, mask: ServoMask) -> Call<'_, U, D, (), K> {
        self.simple(Command::ServoMask(mask))
    }

    /// After the target is lost, sends only the first empty packet.
    pub fn packet_filter(&mut self, on: bool) -> Call<'_, U, D, (), K> {
        self.simple(Command::PacketFilter(on))
    }

    /// Skips so many packets between two that are sent.
    pub fn packet_skip(&mut self, packets: u8) -> Call<'_, U, D, (), K> {
        self.simple(Command::PacketSkip(packets))
    }

    /// A servo pin as a digital output.
    pub fn servo_output(&mut self, servo: Servo, high: bool) -> Call<'_, U, D, (), K> {
        self.simple(Command::ServoOutput(servo, high))
    }
}
