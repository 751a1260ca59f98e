//! Functions that tracking does not need: a reset that keeps the modes; images row by row, and the upload of
//! one.

use super::{Call, Cmucam2, commands::done};
use crate::{
    command::Command,
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
        /// Number of its bytes.
        bytes: u16,
        /// True if it is complete and every byte is possible.
        intact: bool,
    },
    /// The image is over.
    End {
        /// Number of rows that came.
        rows: u16,
        /// True if all of it was as announced.
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

/// A camera that no longer understands anything.
impl<U, D, K> Cmucam2<U, D, K> {
    /// Resets the camera and sets all modes again.
    /// A stream goes on with the next packet that is asked for.
    pub fn recover(&mut self) -> Call<'_, U, D, (), K> {
        self.call(Request::Recover, done)
    }
}

/// Images.
impl<U, D, K> Cmucam2<U, D, K> {
    /// The next part of a frame ([`Command::SendFrame`]) or of a stream with line mode
    /// ([`Command::LineMode`]). A row goes into `row`, which must hold [`ImageHeader::row_bytes`]; a
    /// full colour row of 176 pixels has 528.
    pub fn next_part<'a>(&'a mut self, row: &'a mut [u8]) -> Call<'a, U, D, Part, K> {
        let request = Request::NextPart { row: row.len() };
        Call {
            row,
            ..self.call(request, part)
        }
    }

    /// Sends a reference frame for frame differencing: one level for each block of the 8 x 8 grid,
    /// row by row.
    pub fn upload_difference<'a>(&'a mut self, blocks: &'a [u8; 64]) -> Call<'a, U, D, Answer, K> {
        Call {
            payload: blocks,
            ..self.command(Command::UploadDifference)
        }
    }
}
