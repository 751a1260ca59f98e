//! The tasks. Their start is [`board_support::start`].

use core::pin::pin;

use board_support::{
    clock::EmbassyClock,
    flash::NRF52840,
    memory::Paged,
    pins::{Lamps, PushButtons},
    start,
    tasks::spawn,
};
use defmt_rtt as _;
use embassy_executor::{Executor, Spawner};
use embassy_nrf::{
    gpio::{Input, Output},
    nvmc::Nvmc,
    radio::ieee802154,
};
use embassy_time::Delay;
use node_firmware::{
    config::CheckedConfig,
    hardware::{Hardware, Peripherals},
    liveness::Liveness,
    run::run,
    steps::InertialSteps,
};
use static_cell::StaticCell;
use zigbee_link::radio::Csma;

use crate::{
    board::Board,
    identity::random,
    line::Lossless,
    memory::Flash,
    radio::{self, OnChip, Shared},
    sensor_bus::SensorBus,
    watchdog::{self, HEARTBEATS, NODE, RADIO, reset_cause},
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

#[cortex_m_rt::entry]
fn main() -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    watchdog::start();
    let executor = EXECUTOR.init(Executor::new());
    executor.run(|spawner| spawn(spawner, begin(spawner)))
}

#[embassy_executor::task]
async fn begin(spawner: Spawner) {
    static SHARED: StaticCell<Shared> = StaticCell::new();
    static STEPS: StaticCell<Steps> = StaticCell::new();
    static PERIPHERALS: StaticCell<Option<Peripherals<Board>>> = StaticCell::new();
    let board = Board::new();
    let mut flash = Nvmc::new(board.flash);
    let begun = start::begin(reset_cause(), (&mut flash, &NRF52840), board.sensor);
    let (config, steps, liveness) = match begun {
        Ok(begun) => begun,
        Err(error) => {
            spawn(spawner, watchdog::feed_always(board.watchdog));
            start::stop(error).await
        }
    };
    let seed = random(board.random);
    let shared = SHARED.init(Shared::new());
    let peripherals = PERIPHERALS.init(Some(Peripherals {
        uart: Lossless(board.line.open(config)),
        radio: Csma::new(OnChip::new(shared), Delay, seed),
        clock: EmbassyClock,
        flash: Paged(flash),
        layout: NRF52840.layout,
        steps: STEPS.init(steps),
        indicator: board.lamps,
        buttons: board.buttons,
        observer: (),
        seed,
    }));
    spawn(spawner, run_radio(board.radio, shared));
    spawn(spawner, run_node(config, peripherals, liveness));
    spawn(spawner, watchdog::feed(board.watchdog, liveness));
}

#[embassy_executor::task]
async fn run_radio(radio: ieee802154::Radio<'static>, shared: &'static Shared) {
    let driver = pin!(radio::drive(radio, shared));
    HEARTBEATS.watch(RADIO, driver).await;
}

#[embassy_executor::task]
async fn run_node(
    config: &'static CheckedConfig,
    peripherals: &'static mut Option<Peripherals<Board>>,
    liveness: &'static Liveness,
) {
    // Not passed by value: the whole future of the node would be copied on the stack with them.
    let Some(peripherals) = peripherals.take() else {
        return;
    };
    let node = pin!(run(config, peripherals, liveness));
    start::tell_failure(&HEARTBEATS.watch(NODE, node).await);
}
