//! Use of each pin. The defaults are those of the NUCLEO-L476RG; another board changes this file.

use board_support::pins::{Lamps, PushButtons};
use embassy_stm32::{
    Config, Peri, Peripherals, bind_interrupts,
    exti::{self, ExtiInput},
    gpio::{AnyPin, Level, Output, Pull, Speed},
    interrupt::typelevel,
    mode::Async,
    pac, peripherals,
    rcc::{
        LsConfig, LseConfig, LseDrive, LseMode, Pll, PllMul, PllPreDiv, PllQDiv, PllRDiv,
        PllSource, RtcClockSource, Sysclk, mux::Clk48sel,
    },
    time::Hertz,
};
use node_firmware::config::{BaudRate, CheckedConfig, RoleConfig};

use crate::{
    line::{Divisor, HasLine, InterruptHandler, Line, Uart},
    sensor_bus::SensorBus,
};

/// Rate of `ot-rcp` on most chips. Some are built for another rate, which their maker tells: 460,800 is usual,
/// too.
const RADIO_BAUD: u32 = 115_200;

/// Clock of the processor and its peripherals.
pub(crate) const CLOCK_HZ: u32 = 48_000_000;

bind_interrupts!(struct Irqs {
    EXTI9_5 => exti::InterruptHandler<typelevel::EXTI9_5>;
    EXTI15_10 => exti::InterruptHandler<typelevel::EXTI15_10>;
    USART1 => InterruptHandler<peripherals::USART1>;
    USART2 => InterruptHandler<peripherals::USART2>;
    USART3 => InterruptHandler<peripherals::USART3>;
});

impl HasLine for peripherals::USART1 {
    fn line() -> &'static Line {
        static LINE: Line = Line::new(pac::USART1);
        &LINE
    }
}

impl HasLine for peripherals::USART2 {
    fn line() -> &'static Line {
        static LINE: Line = Line::new(pac::USART2);
        &LINE
    }
}

impl HasLine for peripherals::USART3 {
    fn line() -> &'static Line {
        static LINE: Line = Line::new(pac::USART3);
        &LINE
    }
}

/// Parts of the chip that a node uses.
pub(crate) struct Board {
    pub(crate) lines: Lines,
    pub(crate) lamps: Lamps<Output<'static>>,
    pub(crate) buttons: PushButtons<ExtiInput<'static, Async>>,
    pub(crate) sensor: SensorBus,
    pub(crate) flash: Peri<'static, peripherals::FLASH>,
    pub(crate) random: Peri<'static, peripherals::RNG>,
    pub(crate) watchdog: Peri<'static, peripherals::IWDG>,
}

/// The peripherals of the UARTs, whose rates are not known before the configuration is.
pub(crate) struct Lines {
    camera: Peri<'static, peripherals::USART1>,
    camera_receive: Peri<'static, peripherals::PA10>,
    camera_send: Peri<'static, peripherals::PA9>,
    /// The kit's debug probe makes a serial port of it.
    console: Peri<'static, peripherals::USART2>,
    console_receive: Peri<'static, peripherals::PA3>,
    console_send: Peri<'static, peripherals::PA2>,
    radio: Peri<'static, peripherals::USART3>,
    radio_receive: Peri<'static, peripherals::PC11>,
    radio_send: Peri<'static, peripherals::PC10>,
}

impl Board {
    pub(crate) fn new() -> Self {
        let p: Peripherals = embassy_stm32::init(clocks());
        // The kit's own lamp, and others, are between their pin and ground.
        let lamp = |pin: Peri<'static, AnyPin>| Output::new(pin, Level::Low, Speed::Low);
        Self {
            lines: Lines {
                camera: p.USART1,
                camera_receive: p.PA10,
                camera_send: p.PA9,
                console: p.USART2,
                console_receive: p.PA3,
                console_send: p.PA2,
                radio: p.USART3,
                radio_receive: p.PC11,
                radio_send: p.PC10,
            },
            lamps: Lamps {
                lit: true,
                joined: lamp(p.PA5.into()),
                target_seen: lamp(p.PA6.into()),
                calibrated: lamp(p.PA7.into()),
                may_walk: lamp(p.PB6.into()),
            },
            buttons: PushButtons {
                join_window: ExtiInput::new(p.PC13, p.EXTI13, Pull::Up, Irqs),
                learn_colour: ExtiInput::new(p.PB5, p.EXTI5, Pull::Up, Irqs),
            },
            sensor: SensorBus {
                peripheral: p.I2C1,
                data: p.PB9,
                clock: p.PB8,
                idle: false,
            },
            flash: p.FLASH,
            random: p.RNG,
            watchdog: p.IWDG,
        }
    }
}

/// [`CLOCK_HZ`] for the processor, and for the random numbers, which need just that; made of the internal
/// oscillator of 4 MHz, which the crystal of 32,768 Hz keeps right: time should pass as it does
/// elsewhere.
fn clocks() -> Config {
    let mut config = Config::default();
    config.rcc.ls = LsConfig {
        rtc: RtcClockSource::DISABLE,
        lsi: false,
        lse: Some(LseConfig {
            frequency: Hertz(32_768),
            mode: LseMode::Oscillator(LseDrive::MediumHigh),
        }),
    };
    // Its other end may be 64 to 344 MHz (data sheet, "PLL characteristics").
    config.rcc.pll = Some(Pll {
        source: PllSource::MSI,
        prediv: PllPreDiv::DIV1,
        mul: PllMul::MUL24,
        divp: None,
        divq: Some(PllQDiv::DIV2),
        divr: Some(PllRDiv::DIV2),
    });
    config.rcc.sys = Sysclk::PLL1_R;
    config.rcc.mux.clk48sel = Clk48sel::PLL1_Q;
    config
}

impl Lines {
    /// The UART to the camera, or the PC of a coordinator, and the one to the radio.
    pub(crate) fn open(self, config: &CheckedConfig) -> (Uart, Uart) {
        let rate = match config.baud() {
            BaudRate::B1200 => const { Divisor::of(1_200) },
            BaudRate::B2400 => const { Divisor::of(2_400) },
            BaudRate::B4800 => const { Divisor::of(4_800) },
            BaudRate::B9600 => const { Divisor::of(9_600) },
            BaudRate::B19200 => const { Divisor::of(19_200) },
            BaudRate::B38400 => const { Divisor::of(38_400) },
            BaudRate::B57600 => const { Divisor::of(57_600) },
            BaudRate::B115200 => const { Divisor::of(115_200) },
        };
        let device = match config.settings().role {
            RoleConfig::Coordinator(_) => {
                Uart::open(self.console, self.console_receive, self.console_send, rate)
            }
            RoleConfig::Camera(_) | RoleConfig::Target(_) => {
                Uart::open(self.camera, self.camera_receive, self.camera_send, rate)
            }
        };
        let rate = const { Divisor::of(RADIO_BAUD) };
        let radio = Uart::open(self.radio, self.radio_receive, self.radio_send, rate);
        (device, radio)
    }
}
