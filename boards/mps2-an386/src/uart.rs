//! The UARTs: CMSDK APB UART (ARM DDI 0479), driven by interrupts.
//!
//! Each direction has a ring of bytes. When the receive ring is full the receive interrupt is
//! switched off until somebody reads: the next byte waits in the UART, and the emulator holds back
//! those after it, so nothing is lost. On the hardware the UART would lose them. When the
//! send ring is full, writing waits. No byte is dropped by either.

use core::convert::Infallible;

use critical_section::CriticalSection;
use embassy_sync::{blocking_mutex::raw::CriticalSectionRawMutex, pipe::Pipe};
use embedded_io_async::{ErrorType, Read, Write};

use crate::register::{Block, UART0, UART1, UART2};

const DATA: u16 = 0x00;
const STATE: u16 = 0x04;
const CTRL: u16 = 0x08;
/// Reads which interrupts are due; writing a bit takes it back.
const INTERRUPTS: u16 = 0x0c;
const BAUD_DIVISOR: u16 = 0x10;

const SEND_FULL: u32 = 1;
const RECEIVE_FULL: u32 = 1 << 1;

const ENABLE: u32 = 0b11;
const SEND_INTERRUPT: u32 = 1 << 2;
const RECEIVE_INTERRUPT: u32 = 1 << 3;

/// The smallest that the UART takes. The emulator makes nothing of it: its lines are sockets.
const FASTEST: u32 = 16;

/// Bytes of each ring.
const RING: usize = 256;

/// To the camera, or to the PC of a coordinator.
pub(crate) static DEVICE: Line = Line::new(UART0);
/// To the radio co-processor.
pub(crate) static RADIO: Line = Line::new(UART1);
/// To steps, lamps and buttons.
pub(crate) static PANEL: Line = Line::new(UART2);

type Ring = Pipe<CriticalSectionRawMutex, RING>;

/// A UART and its rings.
pub(crate) struct Line {
    registers: Block,
    received: Ring,
    to_send: Ring,
}

impl Line {
    const fn new(registers: Block) -> Self {
        Self {
            registers,
            received: Ring::new(),
            to_send: Ring::new(),
        }
    }

    /// Switches the UART on.
    pub(crate) fn open(&'static self) -> Uart {
        self.registers.write(BAUD_DIVISOR, FASTEST);
        let control = ENABLE | SEND_INTERRUPT | RECEIVE_INTERRUPT;
        self.registers.write(CTRL, control);
        Uart(self)
    }

    pub(crate) fn on_interrupt(&self) {
        critical_section::with(|cs| {
            let due = self.registers.read(INTERRUPTS);
            self.registers.write(INTERRUPTS, due);
            self.receive(cs);
            self.send(cs);
        });
    }

    /// Takes what has come, as far as there is room.
    fn receive(&self, _: CriticalSection<'_>) {
        let others = ENABLE | SEND_INTERRUPT;
        // Before the look: a byte that comes while the interrupt is off would never cause one.
        self.registers.write(CTRL, others | RECEIVE_INTERRUPT);
        while self.registers.read(STATE) & RECEIVE_FULL != 0 {
            if self.received.is_full() {
                return self.registers.write(CTRL, others);
            }
            let byte = self.registers.read(DATA) as u8;
            // There is room, and nobody else writes.
            let _ = self.received.try_write(&[byte]);
        }
    }

    /// Hands over what the UART takes; it says when it takes more.
    fn send(&self, _: CriticalSection<'_>) {
        let mut byte = [0];
        while self.registers.read(STATE) & SEND_FULL == 0
            && self.to_send.try_read(&mut byte).is_ok()
        {
            let [byte] = byte;
            self.registers.write(DATA, byte.into());
        }
    }
}

/// A line as a UART. Dropping a `read` or `write` loses no byte that it had not returned.
pub(crate) struct Uart(&'static Line);

impl ErrorType for Uart {
    type Error = Infallible;
}

impl Read for Uart {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        let len = self.0.received.read(buffer).await;
        critical_section::with(|cs| self.0.receive(cs));
        Ok(len)
    }
}

impl Write for Uart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        let len = self.0.to_send.write(bytes).await;
        critical_section::with(|cs| self.0.send(cs));
        Ok(len)
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        // What is in the ring goes out by itself, and the other end of a socket has no turnaround
        // time to be kept.
        Ok(())
    }
}

impl Uart {
    /// A second handle, for lines that two tasks use, one for each direction.
    pub(crate) const fn split(self) -> (Self, Self) {
        (Self(self.0), self)
    }
}
