//! The line to a naive camera, and the time that passes on it.

use std::{
    cell::{Cell, RefCell},
    convert::Infallible,
    future::{Future, poll_fn},
    pin::pin,
    rc::Rc,
    task::{Context, Poll, Waker},
};

use cmucam2_driver::{Cmucam2, Error, device::Call};

use crate::naive::camera::{Camera, Habits};

pub(crate) struct World {
    pub(crate) camera: RefCell<Camera>,
    now: Cell<u64>,
    /// The UART holds a byte until it is fetched.
    held: Cell<Option<u8>>,
}

impl World {
    pub(crate) fn now(&self) -> u64 {
        self.now.get()
    }

    fn pass(&self, us: u64) {
        self.now.set(self.now.get() + us);
    }

    fn peek(&self) -> Option<u8> {
        if self.held.get().is_none() {
            self.held
                .set(self.camera.borrow_mut().sends(self.now.get()));
        }
        self.held.get()
    }

    fn take(&self) -> Option<u8> {
        self.peek();
        self.held.take()
    }

    fn send(&self, bytes: &[u8]) {
        for &byte in bytes {
            self.pass(87);
            self.camera.borrow_mut().hears(byte, self.now.get());
        }
    }

    fn read(&self, buffer: &mut [u8]) -> usize {
        let mut count = 0;
        while count < buffer.len()
            && let Some(byte) = self.take()
        {
            buffer[count] = byte;
            count += 1;
        }
        count
    }
}

#[derive(Clone)]
pub(crate) struct Line(pub(crate) Rc<World>);

pub(crate) type Device = Cmucam2<Line, Line>;

pub(crate) fn connect(habits: Habits) -> (Device, Rc<World>) {
    let world = Rc::new(World {
        camera: RefCell::new(Camera::new(habits)),
        now: Cell::new(0),
        held: Cell::new(None),
    });
    let line = Line(world.clone());
    (Cmucam2::new(line.clone(), line), world)
}

impl embedded_io::ErrorType for Line {
    type Error = Infallible;
}

impl embedded_io::Read for Line {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        assert!(self.0.peek().is_some(), "would block for ever");
        Ok(self.0.read(buffer))
    }
}

impl embedded_io::ReadReady for Line {
    fn read_ready(&mut self) -> Result<bool, Infallible> {
        Ok(self.0.peek().is_some())
    }
}

impl embedded_io::Write for Line {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        self.0.send(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl embedded_io_async::Read for Line {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        poll_fn(|_| match self.0.read(buffer) {
            0 => Poll::Pending,
            bytes => Poll::Ready(Ok(bytes)),
        })
        .await
    }
}

impl embedded_io_async::Write for Line {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        self.0.send(bytes);
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl embedded_hal::delay::DelayNs for Line {
    fn delay_ns(&mut self, ns: u32) {
        self.0.pass(u64::from(ns / 1_000).max(1));
    }
}

impl embedded_hal_async::delay::DelayNs for Line {
    /// Time passes while it is looked at.
    async fn delay_ns(&mut self, ns: u32) {
        let until = self.0.now() + u64::from(ns / 1_000);
        poll_fn(|_| {
            if self.0.now() >= until {
                return Poll::Ready(());
            }
            self.0.pass(200);
            Poll::Pending
        })
        .await;
    }
}

/// A UART that can be tried, and no more.
#[cfg(feature = "embedded-hal-nb")]
mod tried {
    use embedded_hal_nb::{nb, serial};

    use super::Line;

    impl serial::ErrorType for Line {
        type Error = serial::ErrorKind;
    }

    impl serial::Read for Line {
        fn read(&mut self) -> nb::Result<u8, serial::ErrorKind> {
            self.0.take().ok_or(nb::Error::WouldBlock)
        }
    }

    impl serial::Write for Line {
        fn write(&mut self, byte: u8) -> nb::Result<(), serial::ErrorKind> {
            self.0.send(&[byte]);
            Ok(())
        }

        fn flush(&mut self) -> nb::Result<(), serial::ErrorKind> {
            Ok(())
        }
    }
}

/// One of the two ways to drive a call.
pub(crate) trait Drive {
    fn drive<T>(call: Call<'_, Line, Line, T>) -> Result<T, Error<Infallible>>;
}

pub(crate) struct Blocking;

impl Drive for Blocking {
    fn drive<T>(call: Call<'_, Line, Line, T>) -> Result<T, Error<Infallible>> {
        call.wait()
    }
}

pub(crate) struct Async;

impl Drive for Async {
    fn drive<T>(call: Call<'_, Line, Line, T>) -> Result<T, Error<Infallible>> {
        let mut future = pin!(call.run());
        let mut context = Context::from_waker(Waker::noop());
        loop {
            if let Poll::Ready(result) = future.as_mut().poll(&mut context) {
                return result;
            }
        }
    }
}
