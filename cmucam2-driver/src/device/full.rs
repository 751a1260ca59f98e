//! Functions that tracking does not need: a reset that keeps the modes; images row by row, and the upload of
//! one.

use super::{Call, Cmucam2, commands::done};
use crate::{
    command::Command,
    session::{Answer, Request},
};

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
    /// ([`Command::LineMode`]): a header, a row, an end, or a packet between images. A row goes into `row`, which must
    /// hold [`row_bytes`](crate::parser::ImageHeader::row_bytes); a full colour row of 176 pixels has 528.
    pub fn next_part<'a>(&'a mut self, row: &'a mut [u8]) -> Call<'a, U, D, Answer, K> {
        let request = Request::NextPart { row: row.len() };
        Call {
            row,
            ..self.request(request)
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
