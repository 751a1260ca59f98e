//! A node's view of a line.

use std::{
    fmt,
    future::{Future, poll_fn},
    pin::Pin,
    rc::Rc,
    task::{Context, Poll},
};

use embedded_io_async::{ErrorKind, ErrorType, Read, Write};

use super::{
    Shared, Side, State,
    end::{End, Reader, Writer},
};

/// An open end of a line.
pub struct Port {
    shared: Rc<Shared>,
    side: Side,
}

/// A UART like this does not fail: faults of the line are lost bytes and wrong ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortError {}

impl fmt::Display for PortError {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}

impl std::error::Error for PortError {}

impl embedded_io_async::Error for PortError {
    fn kind(&self) -> ErrorKind {
        match *self {}
    }
}

impl Port {
    pub(super) fn new(shared: Rc<Shared>, side: Side) -> Self {
        Self { shared, side }
    }

    /// Bytes that have been received and not yet read, without waiting.
    pub fn received(&mut self) -> Vec<u8> {
        self.act(|end| end.received.drain(..).collect())
            .unwrap_or_default()
    }

    fn act<T>(&self, act: impl FnOnce(&mut End) -> T) -> Option<T> {
        self.shared
            .act(|state: &mut State, _| state.end(self.side).map(act))
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        self.shared.act(|state, now| {
            if let Some(end) = state.end(self.side) {
                end.close(now);
            }
        });
    }
}

impl ErrorType for Port {
    type Error = PortError;
}

impl Read for Port {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, PortError> {
        if buffer.is_empty() {
            return Ok(0);
        }
        Ok(Reading { port: self, buffer }.await)
    }
}

/// Waits for bytes; no task is woken for them once it is dropped.
struct Reading<'a> {
    port: &'a Port,
    buffer: &'a mut [u8],
}

impl Future for Reading<'_> {
    type Output = usize;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<usize> {
        let this = &mut *self;
        let buffer = &mut *this.buffer;
        let read = this.port.act(|end| {
            let count = end.received.len().min(buffer.len());
            for (place, byte) in buffer.iter_mut().zip(end.received.drain(..count)) {
                *place = byte;
            }
            if count == 0 {
                end.reader = Some(Reader {
                    most: buffer.len(),
                    waker: context.waker().clone(),
                });
            }
            count
        });
        match read {
            Some(count) if count > 0 => Poll::Ready(count),
            _ => Poll::Pending,
        }
    }
}

impl Drop for Reading<'_> {
    fn drop(&mut self) {
        // The plan stays: an event too many costs less than a new plan.
        if let Some(end) = self.port.shared.state.borrow_mut().end(self.port.side) {
            end.reader = None;
        }
    }
}

impl Port {
    /// Waits until at most so many bytes are still to be sent.
    async fn drain(&mut self, until: usize) {
        poll_fn(|context| {
            let ready = self.act(|end| {
                let is_ready = end.unsent() <= until;
                if !is_ready {
                    let waker = context.waker().clone();
                    end.writer = Some(Writer { until, waker });
                }
                is_ready
            });
            match ready {
                Some(true) => Poll::Ready(()),
                _ => Poll::Pending,
            }
        })
        .await;
    }
}

impl Write for Port {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, PortError> {
        if bytes.is_empty() {
            return Ok(0);
        }
        loop {
            let sent = self.shared.act(|state, now| {
                let end = state.end(self.side)?;
                Some((end.send(now, bytes), end.uart.transmit_buffer))
            });
            match sent {
                Some((0, buffer)) => self.drain(buffer / 2).await,
                Some((sent, _)) => return Ok(sent),
                None => return Ok(bytes.len()),
            }
        }
    }

    async fn flush(&mut self) -> Result<(), PortError> {
        self.drain(0).await;
        Ok(())
    }
}
