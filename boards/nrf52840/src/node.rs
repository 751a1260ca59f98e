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
    run::{Seams, run},
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

type NodeSeams = Seams<
    Lossless,
    Csma<OnChip, Delay>,
    EmbassyClock,
    Flash,
    &'static mut Steps,
    Lamps<Output<'static>, false>,
    PushButtons<Input<'static>>,
    (),
>;

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    static SHARED: StaticCell<Shared> = StaticCell::new();
    static CONFIG: StaticCell<Config> = StaticCell::new();
    static STEPS: StaticCell<Steps> = StaticCell::new();
    static SEAMS: StaticCell<Option<NodeSeams>> = StaticCell::new();
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
    let seams = SEAMS.init(Some(Seams {
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
    spawn(spawner, run_node(config, seams));
    spawn(spawner, watchdog::feed(board.watchdog));
}

#[embassy_executor::task]
async fn run_radio(radio: ieee802154::Radio<'static>, shared: &'static Shared) {
    let driver = pin!(radio::drive(radio, shared));
    LIVENESS.watch(RADIO, driver).await;
}

#[embassy_executor::task]
async fn run_node(config: &'static Config, seams: &'static mut Option<NodeSeams>) {
    // Not passed by value: the whole future of the node would be copied on the stack with them.
    let Some(seams) = seams.take() else {
        return;
    };
    let node = pin!(run(config, seams));
    let failure = LIVENESS.watch(NODE, node).await;
    // Nothing reports any more: the watchdog restarts the node.
    defmt::error!("stopped: {=str}", describe(&failure));
}
