//! The start, and the tasks.

use core::pin::pin;

use board_support::{clock::EmbassyClock, failure::describe, flash::NRF52840, tasks::spawn};
use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_nrf::radio::ieee802154;
use embassy_time::{Delay, Duration, Timer};
use node_firmware::{
    config::{Config, Role, SensorConfig, page::PageError},
    run::{Seams, run},
    steps::InertialSteps,
};
use static_cell::StaticCell;
use zigbee_link::radio::{Csma, Filter};

use crate::{
    board::Board,
    identity::{factory_address, random},
    line::Lossless,
    memory::{self, Flash},
    panel::{Lamps, PushButtons},
    radio::{self, OnChip, Shared},
    retained,
    sensor_bus::SensorBus,
    watchdog::{self, LIVENESS, NODE, RADIO, reset_cause},
};

defmt::timestamp!("{=u64:us}", embassy_time::Instant::now().as_micros());

type Steps = InertialSteps<SensorBus, EmbassyClock>;

type NodeSeams = Seams<
    Lossless,
    Filter<Csma<OnChip, Delay>>,
    EmbassyClock,
    Flash,
    &'static mut Steps,
    Lamps,
    PushButtons,
    (),
>;

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    static SHARED: StaticCell<Shared> = StaticCell::new();
    static CONFIG: StaticCell<Config> = StaticCell::new();
    static STEPS: StaticCell<Steps> = StaticCell::new();
    static SEAMS: StaticCell<Option<NodeSeams>> = StaticCell::new();
    let board = Board::new();
    defmt::info!("started: {=str}", reset_cause());
    if let Some(words) = retained::take().text() {
        defmt::error!("before that: {=str}", words);
    }
    let (flash, config) = memory::open(board.flash);
    let config = match config {
        Ok(config) => CONFIG.init(config),
        Err(error) => return stop(error).await,
    };
    let Some(uart) = board.line.open(config.baud()) else {
        // Refused where configurations are checked.
        return stop(PageError::Body).await;
    };
    let sensor = match &config.role {
        Role::Target(target) => &target.sensor,
        // Nobody looks at it.
        Role::Coordinator(_) | Role::Camera(_) => &SensorConfig::UNCALIBRATED,
    };
    let Ok(steps) = InertialSteps::new(board.sensor, EmbassyClock, sensor) else {
        // Refused where configurations are checked.
        return stop(PageError::Body).await;
    };
    let seed = random(board.random);
    let shared = SHARED.init(Shared::new());
    let seams = SEAMS.init(Some(Seams {
        uart: Lossless(uart),
        radio: Filter::new(Csma::new(OnChip::new(shared), Delay, seed)),
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

/// Without a configuration there is nothing to do, and a restart would not help.
async fn stop(error: PageError) {
    loop {
        defmt::error!("no configuration: {}", error);
        Timer::after(Duration::from_secs(10)).await;
    }
}
