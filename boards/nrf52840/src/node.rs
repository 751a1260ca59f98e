//! The start, and the tasks.

use core::pin::pin;

use board_support::{
    clock::EmbassyClock,
    failure::describe,
    flash::NRF52840,
    pins::{Lamps, PushButtons},
    retained,
    tasks::{sensor_config, spawn, stop, tell_start},
};
use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_nrf::{
    gpio::{Input, Output},
    radio::ieee802154,
};
use embassy_time::Delay;
use node_firmware::{
    config::{Config, page::PageError},
    hardware::{Hardware, Peripherals},
    run::run,
    steps::InertialSteps,
};
use static_cell::StaticCell;
use zigbee_link::radio::Csma;

use crate::{
    board::Board,
    identity::{factory_address, random},
    line::Lossless,
    memory::{self, Flash},
    radio::{self, OnChip, Shared},
    sensor_bus::SensorBus,
    watchdog::{self, LIVENESS, NODE, RADIO, reset_cause},
};

defmt::timestamp!("{=u64:us}", embassy_time::Instant::now().as_micros());

type Steps = InertialSteps<SensorBus, EmbassyClock>;

impl Hardware for Board {
    type Uart = Lossless;
    type Radio = Csma<OnChip, Delay>;
    type Clock = EmbassyClock;
    type Flash = Flash;
    type Steps = &'static mut Steps;
    type Indicator = Lamps<Output<'static>, false>;
    type Buttons = PushButtons<Input<'static>>;
    type Observer = ();
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    static SHARED: StaticCell<Shared> = StaticCell::new();
    static CONFIG: StaticCell<Config> = StaticCell::new();
    static STEPS: StaticCell<Steps> = StaticCell::new();
    static PERIPHERALS: StaticCell<Option<Peripherals<Board>>> = StaticCell::new();
    let board = Board::new();
    tell_start(reset_cause(), &retained::take());
    let (flash, config) = memory::open(board.flash);
    let config = match config {
        Ok(config) => CONFIG.init(config),
        Err(error) => stop(error).await,
    };
    let Some(uart) = board.line.open(config) else {
        // Refused where configurations are checked.
        stop(PageError::Body).await;
    };
    let Ok(steps) = InertialSteps::new(board.sensor, EmbassyClock, sensor_config(config)) else {
        // Refused where configurations are checked.
        stop(PageError::Body).await;
    };
    let seed = random(board.random);
    let shared = SHARED.init(Shared::new());
    let peripherals = PERIPHERALS.init(Some(Peripherals {
        uart: Lossless(uart),
        radio: Csma::new(OnChip::new(shared), Delay, seed),
        clock: EmbassyClock,
        flash,
        layout: NRF52840.layout,
        steps: STEPS.init(steps),
        indicator: board.lamps,
        buttons: board.buttons,
        observer: (),
        extended: factory_address(),
        seed,
    }));
    spawn(spawner, run_radio(board.radio, shared));
    spawn(spawner, run_node(config, peripherals));
    spawn(spawner, watchdog::feed(board.watchdog));
}

#[embassy_executor::task]
async fn run_radio(radio: ieee802154::Radio<'static>, shared: &'static Shared) {
    let driver = pin!(radio::drive(radio, shared));
    LIVENESS.watch(RADIO, driver).await;
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
