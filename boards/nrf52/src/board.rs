//! Pins of a board, and the peripherals that they belong to.

use board_support::pins::{Lamps, PushButtons};
use embassy_nrf::{
    Peri, Peripherals, bind_interrupts,
    config::{HfclkSource, LfclkSource},
    gpio::{AnyPin, Input, Level, Output, OutputDrive, Pull},
    peripherals, radio,
};

use crate::{line::Line, sensor_bus::SensorBus, watchdog};

bind_interrupts!(struct Irqs {
    RADIO => radio::InterruptHandler<peripherals::RADIO>;
});

/// Pins of a board.
pub struct Pins {
    /// Of a CMUcam2 or another camera.
    pub camera: Wires,
    /// Of a coordinator's PC that is not at a USB plug; without them it has those of the camera.
    pub console: Option<Wires>,
    /// The level at which lamps shine.
    pub lit: Level,
    /// Joined, target seen, calibrated, may walk.
    pub lamps: [Peri<'static, AnyPin>; 4],
    /// Join window and learn colour, which connect their pin to ground.
    pub buttons: [Peri<'static, AnyPin>; 2],
    /// Data and clock of a target's sensor.
    pub sensor: [Peri<'static, AnyPin>; 2],
}

/// Pins of a UART.
pub struct Wires {
    /// Receives.
    pub receive: Peri<'static, AnyPin>,
    /// Sends.
    pub send: Peri<'static, AnyPin>,
}

/// The USB device of the chip.
#[cfg(feature = "usb")]
pub type Usb = Peri<'static, peripherals::USBD>;
/// No USB device.
#[cfg(not(feature = "usb"))]
pub type Usb = ();

/// Peripherals that a node uses on every board.
pub struct Parts {
    /// UART to the camera or the PC, with what counts and moves its bytes.
    pub uart: Peri<'static, peripherals::UARTE0>,
    /// See [`uart`](Self::uart).
    pub timer: Peri<'static, peripherals::TIMER1>,
    /// See [`uart`](Self::uart).
    pub channels: (
        Peri<'static, peripherals::PPI_CH0>,
        Peri<'static, peripherals::PPI_CH1>,
    ),
    /// See [`uart`](Self::uart).
    pub group: Peri<'static, peripherals::PPI_GROUP0>,
    /// The plug of a coordinator's PC.
    pub usb: Usb,
    /// Bus of the step sensor.
    pub sensor: Peri<'static, peripherals::TWISPI0>,
    /// The radio.
    pub radio: Peri<'static, peripherals::RADIO>,
    /// The flash.
    pub flash: Peri<'static, peripherals::NVMC>,
    /// The generator of random numbers.
    pub random: Peri<'static, peripherals::RNG>,
    /// The watchdog.
    pub watchdog: Peri<'static, peripherals::WDT>,
}

/// A board, with what a node uses of it.
pub struct Board {
    pub(crate) line: Line,
    pub(crate) usb: Usb,
    pub(crate) lamps: Lamps<Output<'static>>,
    pub(crate) buttons: PushButtons<Input<'static>>,
    pub(crate) sensor: SensorBus,
    pub(crate) radio: radio::ieee802154::Radio<'static>,
    pub(crate) flash: Peri<'static, peripherals::NVMC>,
    pub(crate) random: Peri<'static, peripherals::RNG>,
    pub(crate) watchdog: Peri<'static, peripherals::WDT>,
}

/// Starts the chip: its watchdog first, then its clocks. Once.
pub fn start() -> Peripherals {
    watchdog::start();
    let mut config = embassy_nrf::config::Config::default();
    // The radio needs the crystal's accuracy, and time should pass as it does elsewhere.
    config.hfclk_source = HfclkSource::ExternalXtal;
    config.lfclk_source = LfclkSource::ExternalXtal;
    // Half the current of the receiver, which is always on. A board without the inductor between
    // DCC and DEC4 must leave this out.
    config.dcdc.reg1 = true;
    embassy_nrf::init(config)
}

impl Board {
    pub(crate) fn new(pins: Pins, parts: Parts) -> Self {
        let lit = bool::from(pins.lit);
        let lamp = |pin| Output::new(pin, Level::from(!lit), OutputDrive::Standard);
        let [joined, target_seen, calibrated, may_walk] = pins.lamps.map(lamp);
        let [join_window, learn_colour] = pins.buttons.map(|pin| Input::new(pin, Pull::Up));
        let [data, clock] = pins.sensor;
        Self {
            line: Line {
                uart: parts.uart,
                timer: parts.timer,
                channels: parts.channels,
                group: parts.group,
                camera: pins.camera,
                console: pins.console,
            },
            usb: parts.usb,
            lamps: Lamps {
                lit,
                joined,
                target_seen,
                calibrated,
                may_walk,
            },
            buttons: PushButtons {
                join_window,
                learn_colour,
            },
            sensor: SensorBus {
                peripheral: parts.sensor,
                data,
                clock,
                idle: false,
            },
            radio: radio::ieee802154::Radio::new(parts.radio, Irqs),
            flash: parts.flash,
            random: parts.random,
            watchdog: parts.watchdog,
        }
    }
}
