//! The start, and the tasks.

use core::pin::pin;

use board_support::{
    clock::EmbassyClock,
    failure::describe,
    flash::STM32L476RG,
    pins::{Lamps, PushButtons},
    retained,
    tasks::{sensor_config, spawn, stop, tell_start},
};
use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_stm32::{exti::ExtiInput, gpio::Output, mode::Async};
use node_firmware::{
    config::{Config, page::PageError},
    hardware::{Hardware, Peripherals},
    run::run,
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
    static CONFIG: StaticCell<Config> = StaticCell::new();
    static RADIO: StaticCell<Radio> = StaticCell::new();
    static STEPS: StaticCell<Steps> = StaticCell::new();
    static PERIPHERALS: StaticCell<Option<Peripherals<Board>>> = StaticCell::new();
    let board = Board::new();
    tell_start(reset_cause(), &retained::take());
    let (flash, config) = memory::open(board.flash);
    let config = match config {
        Ok(config) => CONFIG.init(config),
        Err(error) => stop(error).await,
    };
    let Some((uart, radio)) = board.lines.open(config) else {
        // Refused where configurations are checked.
        stop(PageError::Body).await;
    };
    let Ok(steps) = InertialSteps::new(board.sensor, EmbassyClock, sensor_config(config)) else {
        // Refused where configurations are checked.
        stop(PageError::Body).await;
    };
    let peripherals = PERIPHERALS.init(Some(Peripherals {
        uart: Lossless(uart),
        radio: RADIO.init(SpinelRadio::new(radio, EmbassyClock)),
        clock: EmbassyClock,
        flash,
        layout: STM32L476RG.layout,
        steps: STEPS.init(steps),
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
async fn run_node(config: &'static Config, peripherals: &'static mut Option<Peripherals<Board>>) {
    // Not passed by value: the whole future of the node would be copied on the stack with them.
    let Some(peripherals) = peripherals.take() else {
        return;
    };
    let node = pin!(run(config, peripherals));
    let failure = LIVENESS.watch(NODE, node).await;
    // Nothing reports any more: the watchdog restarts the node.
    defmt::error!("stopped: {=str}", describe(&failure));
}
