//! The start, the tasks and the end.

use core::{ffi::CStr, panic::PanicInfo};

use board_support::{clock::EmbassyClock, failure::describe};
use cortex_m_rt::{ExceptionFrame, entry, exception};
use defmt_semihosting as _;
use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_executor::{SpawnError, SpawnToken, Spawner};
use node_firmware::{
    config::{
        Config,
        page::{self, PAGE_MAX},
    },
    run::{Seams, run},
};
use semihosting::process::ExitCode;
use static_cell::StaticCell;
use zigbee_link::{spinel::SpinelRadio, wire::Eui64};

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

type NodeSeams = Seams<
    Uart,
    SpinelRadio<Uart, EmbassyClock>,
    EmbassyClock,
    BlockingAsync<Flash>,
    Steps,
    Lamps,
    PushButtons,
    (),
>;

#[entry]
fn main() -> ! {
    executor::run(begin)
}

fn begin(spawner: Spawner) {
    static CONFIG: StaticCell<Config> = StaticCell::new();
    timer::start();
    interrupts::enable();
    let config = match page::decode(&config_page()) {
        Ok(config) => CONFIG.init(config),
        Err(error) => {
            defmt::error!("no configuration: {}", error);
            stop()
        }
    };
    let Some(flash) = open_flash() else {
        defmt::error!("no flash");
        stop()
    };
    // The board has no address of its own: a locally administered one, of the node's number.
    let [high, low] = config.id.to_be_bytes();
    let own = Eui64([0x02, 0, 0, 0, 0, 0, high, low]);
    let extended = config.extended().unwrap_or(own);
    let seams = Seams {
        uart: DEVICE.open(),
        radio: SpinelRadio::new(RADIO.open(), EmbassyClock),
        clock: EmbassyClock,
        flash: BlockingAsync::new(flash),
        layout: LAYOUT,
        steps: Steps,
        indicator: Lamps,
        buttons: PushButtons,
        observer: (),
        extended,
        // There is no other source of chance; what happens on the lines differs anyway.
        seed: u64::from_be_bytes(extended.0),
    };
    let (receive, send) = PANEL.open().split();
    spawn(spawner, panel::listen(receive));
    spawn(spawner, panel::tell(send));
    spawn(spawner, run_node(config, seams));
    defmt::info!("started");
}

/// Each task is spawned once, so there is room for it.
fn spawn<S>(spawner: Spawner, task: Result<SpawnToken<S>, SpawnError>) {
    if let Ok(task) = task {
        spawner.spawn(task);
    }
}

#[embassy_executor::task]
async fn run_node(config: &'static Config, seams: NodeSeams) {
    let failure = run(config, seams).await;
    defmt::error!("stopped: {=str}", describe(&failure));
    stop()
}

/// What the emulator has loaded there.
fn config_page() -> [u8; PAGE_MAX] {
    const PAGE: *const [u8; PAGE_MAX] = 0x003f_f000 as *const _;
    #[allow(unsafe_code, reason = "memory outside the language")]
    // SAFETY: code memory of 4 MiB begins at 0, the image ends before its first MiB does, and any
    // bytes are a value.
    unsafe {
        PAGE.read_volatile()
    }
}

fn open_flash() -> Option<Flash> {
    const PATH_MAX: usize = 256;
    let arguments = semihosting::experimental::env::args::<PATH_MAX>().ok()?;
    let mut path = [0; PATH_MAX + 1];
    // The image's own name comes first.
    let argument = (&arguments).nth(1).and_then(Result::ok).unwrap_or_default();
    for (to, from) in path.iter_mut().zip(argument.bytes()) {
        *to = from;
    }
    let path = CStr::from_bytes_until_nul(&path).ok()?;
    Flash::open(Some(path).filter(|path| !path.is_empty())).ok()
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
