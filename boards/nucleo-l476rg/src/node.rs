//! The tasks. Their start is [`board_support::start`].

use core::pin::pin;

use board_facts::NUCLEO_L476RG;
use board_support::{
    clock::EmbassyClock,
    memory::Paged,
    pins::{Lamps, PushButtons},
    start,
    tasks::spawn,
};
use defmt_rtt as _;
use embassy_executor::{Executor, Spawner};
use embassy_stm32::{exti::ExtiInput, gpio::Output, mode::Async};
use node_firmware::{
    config::CheckedConfig,
    hardware::{Hardware, Peripherals},
    liveness::Liveness,
    run::run,
    steps::InertialSteps,
};
use spinel_radio::SpinelRadio;
use static_cell::StaticCell;

use crate::{
    board::Board,
    identity::random,
    line::{Lossless, Uart},
    memory::{self, Flash},
    sensor_bus::SensorBus,
    watchdog::{self, HEARTBEATS, NODE, reset_cause},
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
    type Indicator = Lamps<Output<'static>>;
    type Buttons = PushButtons<ExtiInput<'static, Async>>;
    type Observer = ();
}

#[cortex_m_rt::entry]
fn main() -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    let executor = EXECUTOR.init(Executor::new());
    executor.run(|spawner| spawn(spawner, begin(spawner)))
}

#[embassy_executor::task]
async fn begin(spawner: Spawner) {
    static RADIO: StaticCell<Radio> = StaticCell::new();
    static STEPS: StaticCell<Steps> = StaticCell::new();
    static PERIPHERALS: StaticCell<Option<Peripherals<Board>>> = StaticCell::new();
    let board = Board::new();
    let mut flash = memory::open(board.flash);
    let begun = start::begin(reset_cause(), (&mut flash, &NUCLEO_L476RG), board.sensor);
    let (config, steps, liveness) = match begun {
        Ok(begun) => begun,
        Err(error) => start::stop(error).await,
    };
    let (uart, radio) = board.lines.open(config);
    let peripherals = PERIPHERALS.init(Some(Peripherals {
        uart: Lossless(uart),
        radio: RADIO.init(SpinelRadio::new(radio, EmbassyClock)),
        clock: EmbassyClock,
        flash: Paged(flash),
        layout: start::layout(&NUCLEO_L476RG),
        steps: STEPS.init(steps),
        indicator: board.lamps,
        buttons: board.buttons,
        observer: (),
        seed: random(board.random),
        update: None,
    }));
    spawn(spawner, run_node(config, peripherals, liveness));
    spawn(spawner, watchdog::feed(board.watchdog, liveness));
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
