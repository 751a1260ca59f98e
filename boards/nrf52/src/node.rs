//! The tasks. Their start is [`board_support::start`].

use core::{pin::pin, ptr};

use board_facts::Board as Facts;
use board_support::{
    clock::EmbassyClock,
    memory::Paged,
    pins::{Lamps, PushButtons},
    start,
    tasks::spawn,
};
use cortex_m::{asm, peripheral::NVIC, register::fpscr};
use defmt_rtt as _;
use embassy_executor::{Spawner, raw};
use embassy_nrf::{
    gpio::{Input, Output},
    interrupt::Interrupt,
    nvmc::Nvmc,
    radio::ieee802154,
};
use embassy_time::Delay;
use node_firmware::{
    config::CheckedConfig,
    hardware::{Hardware, Peripherals},
    liveness::Liveness,
    steps::InertialSteps,
};
use static_cell::StaticCell;
use zigbee_link::radio::Csma;

#[cfg(not(feature = "usb"))]
use crate::line::Uart as Port;
#[cfg(feature = "usb")]
use crate::plug::{self, Port};
use crate::{
    board::{Board, Parts, Pins},
    identity::random,
    memory::Flash,
    radio::{self, OnChip, Shared},
    sensor_bus::SensorBus,
    watchdog::{self, HEARTBEATS, RADIO, reset_cause},
};

defmt::timestamp!("{=u64:us}", embassy_time::Instant::now().as_micros());

type Steps = InertialSteps<SensorBus, EmbassyClock>;

impl Hardware for Board {
    type Uart = Port;
    type Radio = Csma<OnChip, Delay>;
    type Clock = EmbassyClock;
    type Flash = Flash;
    type Steps = &'static mut Steps;
    type Indicator = Lamps<Output<'static>>;
    type Buttons = PushButtons<Input<'static>>;
    type Observer = ();
}

/// Flags of exceptions in the status register of the FPU.
const FPU_FLAGS: u32 = 0x9f;

/// Runs tasks, beginning with this, and sleeps in between.
#[allow(
    unsafe_code,
    reason = "the loop of an executor, and a register of the processor"
)]
pub fn execute(begin: impl FnOnce(Spawner)) -> ! {
    static EXECUTOR: StaticCell<raw::Executor> = StaticCell::new();
    // A task that is woken sends an event, whatever is named here.
    let executor = EXECUTOR.init(raw::Executor::new(ptr::null_mut()));
    begin(executor.spawner());
    loop {
        // SAFETY: tasks do not call this, and nothing else runs the executor.
        unsafe { executor.poll() };
        // Flags that arithmetic leaves would keep the chip awake (Errata, 87: "Unexpected wake from System ON Idle when
        // using FPU").
        let state = fpscr::read().bits() & !FPU_FLAGS;
        // SAFETY: rounding and all else stay as they are.
        unsafe { fpscr::write(fpscr::Fpscr::from_bits(state)) };
        NVIC::unpend(Interrupt::FPU);
        asm::wfe();
    }
}

/// The stamp of the image.
#[cfg(feature = "update")]
pub type Stamp = &'static [u8; radio_update::stamp::STAMP];
/// No stamp.
#[cfg(not(feature = "update"))]
pub type Stamp = ();

/// A node that is ready to run: its configuration, its hardware, the receiver of its reports.
pub(crate) type Ready = (
    &'static CheckedConfig,
    &'static mut Option<Peripherals<Board>>,
    &'static Liveness,
);

/// Starts all tasks of this board but that of its node, which the board's own crate has: so the compiler optimises it
/// as a whole, which saves 5 KB.
///
/// The image has this stamp, where it is updated by radio.
pub async fn begin(
    spawner: Spawner,
    (facts, stamp): (&'static Facts, Stamp),
    pins: Pins,
    parts: Parts,
) -> Ready {
    static SHARED: StaticCell<Shared> = StaticCell::new();
    static STEPS: StaticCell<Steps> = StaticCell::new();
    static PERIPHERALS: StaticCell<Option<Peripherals<Board>>> = StaticCell::new();
    let board = Board::new(pins, parts);
    let mut flash = Nvmc::new(board.flash);
    let begun = start::begin(reset_cause(), (&mut flash, facts), board.sensor);
    let (config, steps, liveness) = match begun {
        Ok(begun) => begun,
        Err(error) => {
            // An image on trial that cannot use the configuration is not fed: the one before it comes back.
            #[cfg(feature = "update")]
            let may_go_back = start::is_on_trial(&mut flash, facts);
            #[cfg(not(feature = "update"))]
            let may_go_back = false;
            if !may_go_back {
                spawn(spawner, watchdog::feed_always(board.watchdog));
            }
            start::stop(error).await
        }
    };
    let seed = random(board.random);
    #[cfg(feature = "update")]
    let update = start::updates(&mut flash, facts, core::hint::black_box(stamp));
    #[cfg(not(feature = "update"))]
    let (update, ()) = (None, stamp);
    #[cfg(feature = "usb")]
    let uart = plug::open(spawner, config, (board.usb, facts), board.line);
    #[cfg(not(feature = "usb"))]
    let (uart, ()) = (board.line.open(config), board.usb);
    let shared = SHARED.init(Shared::new());
    let peripherals = PERIPHERALS.init(Some(Peripherals {
        uart,
        radio: Csma::new(OnChip::new(shared), Delay, seed.rotate_left(32)),
        clock: EmbassyClock,
        flash: Paged(flash),
        layout: start::layout(facts),
        steps: STEPS.init(steps),
        indicator: board.lamps,
        buttons: board.buttons,
        observer: (),
        seed,
        update,
    }));
    spawn(spawner, run_radio(board.radio, shared));
    spawn(spawner, watchdog::feed(board.watchdog, liveness));
    (config, peripherals, liveness)
}

#[embassy_executor::task]
async fn run_radio(radio: ieee802154::Radio<'static>, shared: &'static Shared) {
    let driver = pin!(radio::drive(radio, shared));
    HEARTBEATS.watch(RADIO, driver).await;
}
