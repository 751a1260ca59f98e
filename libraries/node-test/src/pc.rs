//! The PC of a coordinator.

use std::cell::RefCell;

use embassy_futures::block_on;
use embedded_io_async::Write;
use node_firmware::console::{FRAME_MAX, Frames, FromPc, ToPc, encode};
use virtual_hardware::line::Port;

/// A PC, which writes and notes messages of the console.
pub struct Pc(RefCell<Desk>);

struct Desk {
    uart: Port,
    frames: Frames,
    told: Vec<ToPc>,
}

impl Pc {
    /// A PC at this end of a line.
    pub fn new(uart: Port) -> Self {
        Self(RefCell::new(Desk {
            uart,
            frames: Frames::default(),
            told: Vec::new(),
        }))
    }

    /// Writes a request.
    ///
    /// # Panics
    /// More of them wait than the line takes at once.
    pub fn wish(&self, wish: FromPc) {
        let mut buffer = [0; FRAME_MAX];
        let frame = encode(&wish, &mut buffer).expect("a frame has room for each message");
        // A zero before it ends the frame that noise, or a cut frame, may have begun.
        let frame = [&[0], frame].concat();
        let written = block_on(self.0.borrow_mut().uart.write_all(&frame));
        written.expect("a port does not fail");
    }

    /// All that it was told, oldest first, since it last [forgot](Self::forget).
    pub fn told(&self) -> Vec<ToPc> {
        let Desk { uart, frames, told } = &mut *self.0.borrow_mut();
        let come = uart.received().into_iter();
        told.extend(come.filter_map(|byte| frames.push::<ToPc>(byte)));
        told.clone()
    }

    /// Forgets what it was told.
    pub fn forget(&self) {
        self.told();
        self.0.borrow_mut().told.clear();
    }
}
