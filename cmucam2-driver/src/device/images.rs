//! Frames and line modes.

use super::{Call, Cmucam2};
use crate::{
    colour::ColourChannel,
    command::{Command, LineMode, StatisticsLines, TrackingLines},
    packet::Packet,
    parser::ImageHeader,
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
    /// A packet.
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

/// Images.
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
