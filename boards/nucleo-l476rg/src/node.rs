//! The tasks. What they do at their start is [`board_support::start`].

use board_support::{
    clock::EmbassyClock,
    flash::STM32L476RG,
    memory::Paged,
    pins::{Lamps, PushButtons},
    start::{self, configuration, step_sensor},
    tasks::spawn,
};
use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_stm32::{exti::ExtiInput, gpio::Output, mode::Async};
use node_firmware::{
    config::CheckedConfig,
    hardware::{Hardware, Peripherals},
    steps::InertialSteps,
};
use spinel_radio::SpinelRadio;
use static_cell::StaticCell;

use crate::{
    board::Board,
    identity::{factory_address, random},
    line::{Lossless, Uart},
    memory::{self, Flash},
    sensor_bus::SensorBus,
    watchdog::{self, LIVENESS, NODE, reset_cause},
};

defmt::timestamp!("{=u64:us}", embassy_time::Instant::now().as_micros());

type Radio = SpinelRadio<Uart, EmbassyClock>;
type Steps = InertialSteps<SensorBus, EmbassyClock>;

impl Hardware for Board {
    type Uart = Lossless;
    type Radio = &'static mut Radio;
    type Clock = EmbassyClock;
    type Flash = Flash;
    type Steps = &'static mut Steps;
    type Indicator = Lamps<Output<'static>, true>;
    type Buttons = PushButtons<ExtiInput<'static, Async>>;
    type Observer = ();
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    static RADIO: StaticCell<Radio> = StaticCell::new();
    static STEPS: StaticCell<Steps> = StaticCell::new();
    static PERIPHERALS: StaticCell<Option<Peripherals<Board>>> = StaticCell::new();
    let board = Board::new();
    let mut flash = memory::open(board.flash);
    let config = configuration(reset_cause(), &mut flash, &STM32L476RG).await;
    let (uart, radio) = board.lines.open(config);
    let peripherals = PERIPHERALS.init(Some(Peripherals {
        uart: Lossless(uart),
        radio: RADIO.init(SpinelRadio::new(radio, EmbassyClock)),
        clock: EmbassyClock,
        flash: Paged(flash),
        layout: STM32L476RG.layout,
        steps: STEPS.init(step_sensor(board.sensor, config).await),
        indicator: board.lamps,
        buttons: board.buttons,
        observer: (),
        extended: factory_address(),
        seed: random(board.random),
    }));
    spawn(spawner, run_node(config, peripherals));
    spawn(spawner, watchdog::feed(board.watchdog));
}

#[embassy_executor::task]
async fn run_node(
    config: &'static CheckedConfig,
    peripherals: &'static mut Option<Peripherals<Board>>,
) {
    start::run_node(config, peripherals, (&LIVENESS, NODE)).await;
}
