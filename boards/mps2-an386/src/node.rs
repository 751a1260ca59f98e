//! The start, the tasks and the end.

use core::{ffi::CStr, panic::PanicInfo};

use board_support::{
    clock::EmbassyClock, failure::describe, flash::MPS2_AN386_CONFIG, tasks::spawn,
};
use cortex_m_rt::{ExceptionFrame, entry, exception};
use defmt_semihosting as _;
use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_executor::Spawner;
use node_firmware::{
    config::{
        CheckedConfig,
        page::{self, PAGE_MAX},
    },
    hardware::{Hardware, Peripherals},
    liveness::Liveness,
    message::Restart,
    run::run,
};
use semihosting::process::ExitCode;
use spinel_radio::SpinelRadio;
use static_cell::StaticCell;

use crate::{
    executor,
    flash::{Flash, LAYOUT},
    interrupts,
    panel::{self, Lamps, PushButtons, Steps},
    timer,
    uart::{DEVICE, PANEL, RADIO, Uart},
};

defmt::timestamp!("{=u64:us}", embassy_time::Instant::now().as_micros());

/// Exit code of a node that stopped.
const STOPPED: u8 = 1;
/// Exit code after a panic or a fault.
pub(crate) const BROKEN: u8 = 2;

/// The drivers of this board.
struct Board;

impl Hardware for Board {
    type Uart = Uart;
    type Radio = SpinelRadio<Uart, EmbassyClock>;
    type Clock = EmbassyClock;
    type Flash = BlockingAsync<Flash>;
    type Steps = Steps;
    type Indicator = Lamps;
    type Buttons = PushButtons;
    type Observer = ();
}

#[entry]
fn main() -> ! {
    executor::run(begin)
}

// stack: what it takes is not there while tasks run.
#[inline(never)]
fn begin(spawner: Spawner) {
    static CONFIG: StaticCell<CheckedConfig> = StaticCell::new();
    timer::start();
    interrupts::enable();
    let config = match page::decode(&config_page()) {
        Ok(config) => CONFIG.init(config),
        Err(error) => {
            defmt::error!("no configuration: {}", error);
            stop()
        }
    };
    let arguments = Arguments::read();
    let Some(flash) = arguments.as_ref().and_then(Arguments::open_flash) else {
        defmt::error!("no flash");
        stop()
    };
    // The emulator has no source of chance, so whoever starts it is asked for a number, another one
    // at each start of each node.
    let Some(seed) = arguments.and_then(|arguments| arguments.seed) else {
        defmt::error!("no random number");
        stop()
    };
    let peripherals = Peripherals::<Board> {
        uart: DEVICE.open(),
        radio: SpinelRadio::new(RADIO.open(), EmbassyClock),
        clock: EmbassyClock,
        flash: BlockingAsync::new(flash),
        layout: LAYOUT,
        steps: Steps,
        indicator: Lamps,
        buttons: PushButtons,
        observer: (),
        seed,
    };
    let (receive, send) = PANEL.open().split();
    spawn(spawner, panel::listen(receive));
    spawn(spawner, panel::tell(send));
    spawn(spawner, run_node(config, peripherals));
    defmt::info!("started");
}

#[embassy_executor::task]
async fn run_node(config: &'static CheckedConfig, peripherals: Peripherals<Board>) {
    let liveness = Liveness::new(Restart::Ordinary);
    let failure = run(config, peripherals, &liveness).await;
    defmt::error!("stopped: {=str}", describe(&failure));
    stop()
}

/// What the emulator has loaded there.
fn config_page() -> [u8; PAGE_MAX] {
    const PAGE: *const [u8; PAGE_MAX] = MPS2_AN386_CONFIG as *const _;
    #[allow(unsafe_code, reason = "memory outside the language")]
    // SAFETY: code memory of 4 MiB begins at 0, the image ends before its first MiB does, and any
    // bytes are a value.
    unsafe {
        PAGE.read_volatile()
    }
}

/// What the emulator was told for the node: the name of a file, and a random number.
struct Arguments {
    /// Ends with a zero; empty for none.
    file: [u8; Self::MAX + 1],
    seed: Option<u64>,
}

impl Arguments {
    /// Bytes of all of them together.
    const MAX: usize = 256;

    /// None if they are too long.
    fn read() -> Option<Self> {
        let all = semihosting::experimental::env::args::<{ Self::MAX }>().ok()?;
        // The first one is the program.
        let mut arguments = (&all).skip(1).map(Result::unwrap_or_default);
        let mut file = [0; Self::MAX + 1];
        let name = arguments.next().unwrap_or_default();
        for (to, from) in file.iter_mut().zip(name.bytes()) {
            *to = from;
        }
        let seed = arguments.next().and_then(|seed| seed.parse().ok());
        Some(Self { file, seed })
    }

    fn open_flash(&self) -> Option<Flash> {
        let file = CStr::from_bytes_until_nul(&self.file).ok()?;
        Flash::open(Some(file).filter(|file| !file.is_empty())).ok()
    }
}

fn stop() -> ! {
    ExitCode::from(STOPPED).exit_process()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    if let Some(place) = info.location() {
        defmt::error!("panic at {=str}:{=u32}", place.file(), place.line());
    }
    ExitCode::from(BROKEN).exit_process()
}

#[allow(unsafe_code, reason = "an exception")]
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    defmt::error!("fault at {=u32:#x}", frame.pc());
    ExitCode::from(BROKEN).exit_process()
}
