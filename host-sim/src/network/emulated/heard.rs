//! Whether anything has come from a line.

use std::cell::Cell;

use embedded_io_async::{ErrorType, Read, Write};

/// A line, and a note of whether anything has come from it.
pub(super) struct Heard<'a, U> {
    line: U,
    is_heard: &'a Cell<bool>,
}

impl<'a, U> Heard<'a, U> {
    pub(super) const fn new(line: U, is_heard: &'a Cell<bool>) -> Self {
        Self { line, is_heard }
    }
}

impl<U: ErrorType> ErrorType for Heard<'_, U> {
    type Error = U::Error;
}

impl<U: Read> Read for Heard<'_, U> {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, U::Error> {
        let count = self.line.read(buffer).await?;
        if count > 0 {
            self.is_heard.set(true);
        }
        Ok(count)
    }
}

impl<U: Write> Write for Heard<'_, U> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, U::Error> {
        self.line.write(bytes).await
    }

    async fn flush(&mut self) -> Result<(), U::Error> {
        self.line.flush().await
    }
}
