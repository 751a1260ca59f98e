//! Sockets and devices of the operating system as UARTs of tasks in virtual time.
//!
//! They are asked every millisecond of that time, so it has to pass at the rate of real time.

use std::io;

use embedded_io_async::{ErrorType, Read, Write};

use super::executor::{Clock, Time};

/// Interval at which a quiet line is looked at. The operating system keeps bytes that come in between.
const PERIOD: Time = 1_000_000;

/// Something that reads and writes without waiting: with nothing to do it fails with
/// [`io::ErrorKind::WouldBlock`] or [`io::ErrorKind::TimedOut`].
pub struct Polled<T> {
    inner: T,
    clock: Clock,
}

impl<T> Polled<T> {
    /// A UART of it.
    pub const fn new(inner: T, clock: Clock) -> Self {
        Self { inner, clock }
    }

    async fn attempt(
        &mut self,
        mut attempt: impl FnMut(&mut T) -> io::Result<usize>,
    ) -> io::Result<usize> {
        loop {
            match attempt(&mut self.inner) {
                Err(error) => match error.kind() {
                    io::ErrorKind::Interrupted => {}
                    io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => {
                        self.clock.sleep(PERIOD).await;
                    }
                    _ => return Err(error),
                },
                done => return done,
            }
        }
    }
}

impl<T> ErrorType for Polled<T> {
    type Error = io::Error;
}

impl<T: io::Read> Read for Polled<T> {
    async fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.attempt(|inner| inner.read(buffer)).await
    }
}

impl<T: io::Write> Write for Polled<T> {
    async fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.attempt(|inner| inner.write(bytes)).await
    }

    async fn flush(&mut self) -> io::Result<()> {
        self.attempt(|inner| inner.flush().map(|()| 0)).await?;
        Ok(())
    }
}
