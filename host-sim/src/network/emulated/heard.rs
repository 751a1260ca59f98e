//! When something came from a line.

use std::cell::Cell;

use embedded_io_async::{ErrorType, Read, Write};
use virtual_bench::executor::{Clock, Time};

/// A line, and a note of when something came from it last.
pub(super) struct Heard<'a, U> {
    line: U,
    clock: &'a Clock,
    last: &'a Cell<Option<Time>>,
}

impl<'a, U> Heard<'a, U> {
    pub(super) const fn new(line: U, clock: &'a Clock, last: &'a Cell<Option<Time>>) -> Self {
        Self { line, clock, last }
    }
}

impl<U: ErrorType> ErrorType for Heard<'_, U> {
    type Error = U::Error;
}

impl<U: Read> Read for Heard<'_, U> {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, U::Error> {
        let count = self.line.read(buffer).await?;
        if count > 0 {
            self.last.set(Some(self.clock.time()));
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
