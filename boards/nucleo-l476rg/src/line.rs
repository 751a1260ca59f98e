//! The UARTs, driven by interrupts.
//!
//! Not with `embassy-stm32`: its driver does not report lost bytes, and a `write` that finds no room is never
//! woken.
//!
//! Each direction has a ring of bytes. The processor takes each byte before the next one is
//! complete, also while it writes to the flash: that is in another bank than the program. Only where
//! interrupts are off for longer, or the ring is full, bytes are lost, and this is noticed.

use core::{
    convert::Infallible,
    future::poll_fn,
    marker::PhantomData,
    mem,
    sync::atomic::{AtomicBool, Ordering},
    task::Poll,
};

use board_support::lost::Lost;
use embassy_stm32::{
    Peri,
    gpio::{AfType, Flex, OutputType, Pull, Speed},
    interrupt::typelevel::{Handler, Interrupt},
    pac::usart::{Usart, regs::Brr},
    rcc::{RccPeripheral, enable_and_reset},
    usart::{Instance, RxPin, TxPin},
};
use embassy_sync::{
    blocking_mutex::raw::CriticalSectionRawMutex, pipe::Pipe, waitqueue::AtomicWaker,
};
use embedded_io_async::{ErrorType, Read, Write};

use crate::board::CLOCK_HZ;

/// More than half of it is free at least. An erasure of a page stops the program for up to 25 ms
/// (data sheet, "Flash memory characteristics"), in which 288 bytes come at 115,200 baud if the line
/// is never idle.
const RECEIVE: usize = 1024;
/// Longer than any command to a camera; bytes to a PC or to the radio wait.
const SEND: usize = 64;

/// A peripheral with its line. Each has one of its own.
pub(crate) trait HasLine: Instance + RccPeripheral {
    fn line() -> &'static Line;
}

/// To be bound to the interrupt of the peripheral.
pub(crate) struct InterruptHandler<T>(PhantomData<T>);

#[allow(unsafe_code, reason = "an interrupt")]
impl<T: HasLine> Handler<T::Interrupt> for InterruptHandler<T> {
    unsafe fn on_interrupt() {
        T::line().on_interrupt();
    }
}

/// A UART and its rings.
pub(crate) struct Line {
    registers: Usart,
    received: Pipe<CriticalSectionRawMutex, RECEIVE>,
    to_send: Pipe<CriticalSectionRawMutex, SEND>,
    /// Waits until all is sent.
    sent: AtomicWaker,
    has_lost: AtomicBool,
}

impl Line {
    pub(crate) const fn new(registers: Usart) -> Self {
        Self {
            registers,
            received: Pipe::new(),
            to_send: Pipe::new(),
            sent: AtomicWaker::new(),
            has_lost: AtomicBool::new(false),
        }
    }

    fn on_interrupt(&self) {
        let state = self.registers.isr().read();
        if state.ore() {
            self.registers.icr().write(|flags| flags.set_ore(true));
            self.has_lost.store(true, Ordering::Relaxed);
        }
        if state.rxne() {
            let byte = self.registers.rdr().read().dr() as u8;
            if self.received.try_write(&[byte]).is_err() {
                self.has_lost.store(true, Ordering::Relaxed);
            }
        }
        let enabled = self.registers.cr1().read();
        let mut byte = [0];
        if state.txe() && enabled.txeie() {
            if self.to_send.try_read(&mut byte).is_ok() {
                let [byte] = byte;
                self.registers.tdr().write(|data| data.set_dr(byte.into()));
            } else {
                self.registers.cr1().modify(|enabled| {
                    enabled.set_txeie(false);
                    enabled.set_tcie(true);
                });
            }
        } else if state.tc() && enabled.tcie() {
            self.registers
                .cr1()
                .modify(|enabled| enabled.set_tcie(false));
            self.sent.wake();
        }
    }

    /// Hands the sending over to the interrupts.
    fn begin_to_send(&self) {
        critical_section::with(|_| {
            self.registers
                .cr1()
                .modify(|enabled| enabled.set_txeie(true));
        });
    }

    /// Nothing waits, and the last bit has gone out.
    fn is_sent(&self) -> bool {
        self.to_send.is_empty() && {
            let enabled = self.registers.cr1().read();
            !enabled.txeie() && !enabled.tcie()
        }
    }

    /// Returns true if bytes were lost since the last time.
    fn takes_loss(&self) -> bool {
        self.has_lost.swap(false, Ordering::Relaxed)
    }
}

/// A line as a UART. Dropping a `read` or `write` loses no byte that it had not returned. Lost bytes are only
/// logged: messages on the line must have checksums.
pub(crate) struct Uart(&'static Line);

/// A rate: the number by which the clock of the UART is divided.
#[derive(Clone, Copy)]
pub(crate) struct Divisor(u32);

impl Divisor {
    /// The divisor for so many bits per second. Does not compile for a rate that a UART cannot have.
    pub(crate) const fn of(baud: u32) -> Self {
        let divisor = (CLOCK_HZ + baud / 2) / baud;
        // Reference manual RM0351, "USART baud rate generation".
        assert!(divisor >= 16 && divisor <= 0xffff);
        Self(divisor)
    }
}

impl Uart {
    /// The UART at this rate: 8 bits, no parity, one stop bit.
    pub(crate) fn open<T: HasLine>(
        _peripheral: Peri<'static, T>,
        receive: Peri<'static, impl RxPin<T>>,
        send: Peri<'static, impl TxPin<T>>,
        Divisor(divisor): Divisor,
    ) -> Self {
        let line = T::line();
        enable_and_reset::<T>();
        // A line that is open at its other end is idle.
        let (receives, sends) = (receive.af_num(), send.af_num());
        hand_over(Flex::new(receive), receives, AfType::input(Pull::Up));
        let output = AfType::output(OutputType::PushPull, Speed::Medium);
        hand_over(Flex::new(send), sends, output);
        line.registers.brr().write_value(Brr(divisor));
        line.registers.cr1().write(|enabled| {
            enabled.set_ue(true);
            enabled.set_te(true);
            enabled.set_re(true);
            enabled.set_rxneie(true);
        });
        #[allow(unsafe_code, reason = "an interrupt is switched on")]
        // SAFETY: no other code relies on it being off.
        unsafe {
            T::Interrupt::enable();
        }
        Self(line)
    }
}

/// Gives a pin to a peripheral, for ever.
fn hand_over(mut pin: Flex<'static>, function: u8, kind: AfType) {
    pin.set_as_af_unchecked(function, kind);
    mem::forget(pin);
}

impl ErrorType for Uart {
    type Error = Infallible;
}

impl Read for Uart {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        let len = self.0.received.read(buffer).await;
        if self.0.takes_loss() {
            defmt::warn!("a UART lost bytes");
        }
        Ok(len)
    }
}

impl Write for Uart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        let len = self.0.to_send.write(bytes).await;
        self.0.begin_to_send();
        Ok(len)
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        poll_fn(|context| {
            self.0.sent.register(context.waker());
            if self.0.is_sent() {
                Poll::Ready(Ok(()))
            } else {
                Poll::Pending
            }
        })
        .await
    }
}

/// A UART of which lost bytes are an error, after which it goes on: for a camera or a PC, whose messages would
/// have holes.
pub(crate) struct Lossless(pub(crate) Uart);

impl node_firmware::hardware::Line for Lossless {}

impl ErrorType for Lossless {
    type Error = Lost;
}

impl Read for Lossless {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Lost> {
        let line = self.0.0;
        let len = line.received.read(buffer).await;
        match line.takes_loss() {
            true => Err(Lost),
            false => Ok(len),
        }
    }
}

impl Write for Lossless {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Lost> {
        let Ok(len) = self.0.write(bytes).await;
        Ok(len)
    }

    async fn flush(&mut self) -> Result<(), Lost> {
        let Ok(()) = self.0.flush().await;
        Ok(())
    }
}
