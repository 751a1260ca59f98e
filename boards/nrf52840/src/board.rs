//! Use of each pin. The defaults are those of the nRF52840-DK; another board changes this file.

use board_support::pins::{Lamps, PushButtons};
use embassy_nrf::{
    Peri, Peripherals, bind_interrupts,
    buffered_uarte::{self, Baudrate, BufferedUarte},
    config::{HfclkSource, LfclkSource},
    gpio::{AnyPin, Input, Level, Output, OutputDrive, Pull},
    pac::{
        self,
        common::{RW, Reg},
        gpio::{regs::PinCnf, vals},
    },
    peripherals, radio, uarte,
};
use node_firmware::config::{BaudRate, CheckedConfig, RoleConfig};
use static_cell::StaticCell;

use crate::sensor_bus::SensorBus;

bind_interrupts!(struct Irqs {
    RADIO => radio::InterruptHandler<peripherals::RADIO>;
    UARTE0 => buffered_uarte::InterruptHandler<peripherals::UARTE0>;
});

/// Half of it is free at least. An erasure of a page stops the processor for up to 85 ms (Product
/// Specification, "NVMC"), in which 979 bytes come at 115,200 baud if the line is never idle.
const UART_RECEIVE: usize = 2048;
/// Longer than any command to a camera; bytes to a PC wait.
const UART_SEND: usize = 64;

/// Parts of the chip that a node uses.
pub(crate) struct Board {
    pub(crate) line: Line,
    pub(crate) lamps: Lamps<Output<'static>, false>,
    pub(crate) buttons: PushButtons<Input<'static>>,
    pub(crate) sensor: SensorBus,
    pub(crate) radio: radio::ieee802154::Radio<'static>,
    pub(crate) flash: Peri<'static, peripherals::NVMC>,
    pub(crate) random: Peri<'static, peripherals::RNG>,
    pub(crate) watchdog: Peri<'static, peripherals::WDT>,
}

/// The peripherals of the UART to the camera or the PC, whose rate is not known before the configuration is.
pub(crate) struct Line {
    uart: Peri<'static, peripherals::UARTE0>,
    timer: Peri<'static, peripherals::TIMER1>,
    channels: (
        Peri<'static, peripherals::PPI_CH0>,
        Peri<'static, peripherals::PPI_CH1>,
    ),
    group: Peri<'static, peripherals::PPI_GROUP0>,
    camera: Wires,
    /// The kit's debug probe makes a serial port of them.
    console: Wires,
}

struct Wires {
    receive: Peri<'static, AnyPin>,
    /// Configuration of the same pin.
    configuration: Reg<PinCnf, RW>,
    send: Peri<'static, AnyPin>,
}

impl Board {
    pub(crate) fn new() -> Self {
        let mut config = embassy_nrf::config::Config::default();
        // The radio needs the crystal's accuracy, and time should pass as it does elsewhere.
        config.hfclk_source = HfclkSource::ExternalXtal;
        config.lfclk_source = LfclkSource::ExternalXtal;
        // Half the current of the receiver, which is always on. A board without the inductor between
        // DCC and DEC4 must leave this out.
        config.dcdc.reg1 = true;
        let p: Peripherals = embassy_nrf::init(config);
        // Lamps and buttons of the kit connect their pin to ground.
        let lamp =
            |pin: Peri<'static, AnyPin>| Output::new(pin, Level::High, OutputDrive::Standard);
        Self {
            line: Line {
                uart: p.UARTE0,
                timer: p.TIMER1,
                channels: (p.PPI_CH0, p.PPI_CH1),
                group: p.PPI_GROUP0,
                camera: Wires {
                    receive: p.P1_01.into(),
                    configuration: pac::P1.pin_cnf(1),
                    send: p.P1_02.into(),
                },
                console: Wires {
                    receive: p.P0_08.into(),
                    configuration: pac::P0.pin_cnf(8),
                    send: p.P0_06.into(),
                },
            },
            lamps: Lamps {
                joined: lamp(p.P0_13.into()),
                target_seen: lamp(p.P0_14.into()),
                calibrated: lamp(p.P0_15.into()),
                may_walk: lamp(p.P0_16.into()),
            },
            buttons: PushButtons {
                join_window: Input::new(p.P0_11, Pull::Up),
                learn_colour: Input::new(p.P0_12, Pull::Up),
            },
            sensor: SensorBus {
                peripheral: p.TWISPI0,
                data: p.P0_26,
                clock: p.P0_27,
                idle: false,
            },
            radio: radio::ieee802154::Radio::new(p.RADIO, Irqs),
            flash: p.NVMC,
            random: p.RNG,
            watchdog: p.WDT,
        }
    }
}

impl Line {
    /// The UART to the camera, or the PC of a coordinator.
    pub(crate) fn open(self, node: &CheckedConfig) -> BufferedUarte<'static> {
        static RECEIVE: StaticCell<[u8; UART_RECEIVE]> = StaticCell::new();
        static SEND: StaticCell<[u8; UART_SEND]> = StaticCell::new();
        let mut config = uarte::Config::default();
        config.baudrate = match node.baud() {
            BaudRate::B1200 => Baudrate::Baud1200,
            BaudRate::B2400 => Baudrate::Baud2400,
            BaudRate::B4800 => Baudrate::Baud4800,
            BaudRate::B9600 => Baudrate::Baud9600,
            BaudRate::B19200 => Baudrate::Baud19200,
            BaudRate::B38400 => Baudrate::Baud38400,
            BaudRate::B57600 => Baudrate::Baud57600,
            BaudRate::B115200 => Baudrate::Baud115200,
        };
        let wires = match node.role {
            RoleConfig::Coordinator(_) => self.console,
            RoleConfig::Camera(_) | RoleConfig::Target(_) => self.camera,
        };
        let line = BufferedUarte::new(
            self.uart,
            self.timer,
            self.channels.0,
            self.channels.1,
            self.group,
            wires.receive,
            wires.send,
            Irqs,
            config,
            RECEIVE.init([0; UART_RECEIVE]),
            SEND.init([0; UART_SEND]),
        );
        // Without a camera or a PC the line would float, and its noise would be bytes.
        let configuration = wires.configuration;
        configuration.modify(|w| w.set_pull(vals::Pull::Pullup));
        line
    }
}
