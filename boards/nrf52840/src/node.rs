//! The tasks. What they do at their start is [`board_support::start`].

use core::pin::pin;

use board_support::{
    clock::EmbassyClock,
    flash::NRF52840,
    memory::Paged,
    pins::{Lamps, PushButtons},
    start::{self, configuration, step_sensor},
    tasks::spawn,
};
use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_nrf::{
    gpio::{Input, Output},
    nvmc::Nvmc,
    radio::ieee802154,
};
use embassy_time::Delay;
use node_firmware::{
    config::CheckedConfig,
    hardware::{Hardware, Peripherals},
    steps::InertialSteps,
};
use static_cell::StaticCell;
use zigbee_link::radio::Csma;

use crate::{
    board::Board,
    identity::{factory_address, random},
    line::Lossless,
    memory::Flash,
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
    static STEPS: StaticCell<Steps> = StaticCell::new();
    static PERIPHERALS: StaticCell<Option<Peripherals<Board>>> = StaticCell::new();
    let board = Board::new();
    let mut flash = Nvmc::new(board.flash);
    let config = configuration(reset_cause(), &mut flash, &NRF52840).await;
    let seed = random(board.random);
    let shared = SHARED.init(Shared::new());
    let peripherals = PERIPHERALS.init(Some(Peripherals {
        uart: Lossless(board.line.open(config)),
        radio: Csma::new(OnChip::new(shared), Delay, seed),
        clock: EmbassyClock,
        flash: Paged(flash),
        layout: NRF52840.layout,
        steps: STEPS.init(step_sensor(board.sensor, config).await),
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
async fn run_node(
    config: &'static CheckedConfig,
    peripherals: &'static mut Option<Peripherals<Board>>,
) {
    start::run_node(config, peripherals, (&LIVENESS, NODE)).await;
}
