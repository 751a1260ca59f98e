//! The UART to the camera or the PC.

use core::mem::ManuallyDrop;

use board_support::lost::Lost;
use embassy_nrf::{
    Peri, bind_interrupts,
    buffered_uarte::{self, Baudrate, BufferedUarte},
    gpio::{AnyPin, Pin, Port},
    pac::{
        self,
        common::{RW, Reg},
        gpio::{regs::PinCnf, vals},
    },
    peripherals, uarte,
};
use embedded_io_async::{ErrorType, Read, Write};
use node_firmware::{
    config::{BaudRate, CheckedConfig, RoleConfig},
    hardware,
};
use static_cell::ConstStaticCell;

use crate::board::Wires;

bind_interrupts!(struct Irqs {
    UARTE0 => buffered_uarte::InterruptHandler<peripherals::UARTE0>;
});

/// Half of it is free at least. An erasure of a page stops the processor for up to 85 ms (Product
/// Specification, "NVMC"), in which 979 bytes come at 115,200 baud if the line is never idle.
const UART_RECEIVE: usize = 2048;
/// Longer than any command to a camera; bytes to a PC wait.
const UART_SEND: usize = 64;

/// Memory of the driver.
type Buffers = ([u8; UART_RECEIVE], [u8; UART_SEND]);

/// The peripherals of the UART to the camera or the PC, whose rate is not known before the configuration is.
pub(crate) struct Line {
    pub(crate) uart: Peri<'static, peripherals::UARTE0>,
    pub(crate) timer: Peri<'static, peripherals::TIMER1>,
    pub(crate) channels: (
        Peri<'static, peripherals::PPI_CH0>,
        Peri<'static, peripherals::PPI_CH1>,
    ),
    pub(crate) group: Peri<'static, peripherals::PPI_GROUP0>,
    pub(crate) camera: Wires,
    pub(crate) console: Option<Wires>,
}

impl Line {
    /// The UART to the camera, or the PC of a coordinator.
    pub(crate) fn open(mut self, node: &CheckedConfig) -> Uart {
        static BUFFERS: ConstStaticCell<Buffers> =
            ConstStaticCell::new(([0; UART_RECEIVE], [0; UART_SEND]));
        if let (RoleConfig::Coordinator(_), Some(console)) =
            (&node.settings().role, self.console.take())
        {
            self.camera = console;
        }
        Uart {
            baudrate: match node.baud() {
                BaudRate::B1200 => Baudrate::Baud1200,
                BaudRate::B2400 => Baudrate::Baud2400,
                BaudRate::B4800 => Baudrate::Baud4800,
                BaudRate::B9600 => Baudrate::Baud9600,
                BaudRate::B19200 => Baudrate::Baud19200,
                BaudRate::B38400 => Baudrate::Baud38400,
                BaudRate::B57600 => Baudrate::Baud57600,
                BaudRate::B115200 => Baudrate::Baud115200,
            },
            line: self,
            buffers: BUFFERS.take(),
            driver: None,
        }
    }
}

/// The UART. Bytes that found no room are an error, after which it goes on.
///
/// The driver finds its place in the ring by counting all bytes that arrive, also those for which
/// there was no room: after an overrun it would return old bytes for new ones for ever. So it is made anew then, and
/// what waits in both rings is lost too. The ring is long enough that this does not happen at the rates of a camera.
pub struct Uart {
    line: Line,
    baudrate: Baudrate,
    buffers: *mut Buffers,
    /// From the first transfer on, or the first after an overrun or a rest. It is dropped there alone: a node that ends
    /// restarts its chip.
    driver: Option<ManuallyDrop<BufferedUarte<'static>>>,
}

impl Uart {
    #[allow(unsafe_code, reason = "the driver is made again of the same parts")]
    fn driver(&mut self) -> &mut BufferedUarte<'static> {
        let Self { line, buffers, .. } = self;
        let mut config = uarte::Config::default();
        config.baudrate = self.baudrate;
        self.driver.get_or_insert_with(|| {
            // SAFETY: the driver that had these parts and buffers was dropped, and nothing else has them.
            let (receive, send) = unsafe { &mut **buffers };
            // SAFETY: as above.
            let (uart, timer, channels, group, from, to) = unsafe {
                (
                    line.uart.clone_unchecked(),
                    line.timer.clone_unchecked(),
                    (
                        line.channels.0.clone_unchecked(),
                        line.channels.1.clone_unchecked(),
                    ),
                    line.group.clone_unchecked(),
                    line.camera.receive.clone_unchecked(),
                    line.camera.send.clone_unchecked(),
                )
            };
            let configuration = configuration(&from);
            let (count, restart) = channels;
            let driver = BufferedUarte::new(
                uart, timer, count, restart, group, from, to, Irqs, config, receive, send,
            );
            // Without a camera or a PC the line would float, and its noise would be bytes.
            configuration.modify(|w| w.set_pull(vals::Pull::Pullup));
            ManuallyDrop::new(driver)
        })
    }

    /// Switches the UART off, and what counts its bytes, so that nothing needs the high-frequency clock.
    fn close(&mut self) {
        let Some(driver) = self.driver.take() else {
            return;
        };
        drop(ManuallyDrop::into_inner(driver));
        // A counter that was stopped alone goes on to draw current (Errata, 78: "High current consumption when using
        // timer STOP task only").
        pac::TIMER1.tasks_shutdown().write_value(1);
        // The other end must not take a line that floats for bytes. The driver left the level high.
        configuration(&self.line.camera.send).write(|w| {
            w.set_dir(vals::Dir::Output);
            w.set_input(vals::Input::Disconnect);
        });
    }
}

/// Settings of a pin.
fn configuration(pin: &Peri<'_, AnyPin>) -> Reg<PinCnf, RW> {
    let port = match pin.port() {
        Port::Port0 => pac::P0,
        Port::Port1 => pac::P1,
    };
    // The compiler sees that there are no more.
    port.pin_cnf(usize::from(pin.pin() % 32))
}

impl hardware::Line for Uart {
    fn rest(&mut self) {
        self.close();
    }
}

impl ErrorType for Uart {
    type Error = Lost;
}

impl Read for Uart {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Lost> {
        let read = self.driver().read(buffer).await;
        if read.is_err() {
            self.close();
        }
        read.map_err(|_| Lost)
    }
}

impl Write for Uart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Lost> {
        self.driver().write(bytes).await.map_err(|_| Lost)
    }

    async fn flush(&mut self) -> Result<(), Lost> {
        self.driver().flush().await.map_err(|_| Lost)
    }
}
