//! The emulated board: its timer, its output, its start and its end.

use core::panic::PanicInfo;

use bench_cortex_m::{
    measure::{Bench, Counter, Error},
    routines,
};
use cortex_m::{
    Peripherals,
    asm::nop,
    peripheral::{SYST, syst::SystClkSource},
};
use cortex_m_semihosting::{debug, hio, hprintln};

/// `SysTick` counts down 24 bits.
const RELOAD: u32 = 0x00ff_ffff;

/// The emulator takes a nanosecond per instruction.
const INSTRUCTIONS_PER_SECOND: u64 = 1_000_000_000;

struct SysTick(SYST);

impl SysTick {
    const TICKS_PER_SECOND: u64 = match u64::from_str_radix(env!("SYSTICK_HZ"), 10) {
        Ok(hz) => hz,
        Err(_) => panic!("build.rs gives a number"),
    };
}

impl Counter for SysTick {
    fn start(&mut self) {
        self.0.disable_counter();
        self.0.set_clock_source(SystClkSource::Core);
        self.0.set_reload(RELOAD);
        self.0.clear_current();
        self.0.enable_counter();
        // The first tick leads from zero to the reload value.
        while SYST::get_current() == 0 {}
    }

    fn stop(&mut self) -> Option<u64> {
        let ticks = RELOAD - SYST::get_current();
        // After 2^24 ticks: 671 million instructions at 25 MHz, 1049 million at 16 MHz.
        let wrapped = self.0.has_wrapped();
        (!wrapped).then_some(u64::from(ticks) * INSTRUCTIONS_PER_SECOND / Self::TICKS_PER_SECOND)
    }
}

/// The same statement ten times.
macro_rules! ten_times {
    ($statement:expr) => {{
        $statement;
        $statement;
        $statement;
        $statement;
        $statement;
        $statement;
        $statement;
        $statement;
        $statement;
        $statement;
    }};
}

fn run() -> Result<(), Error> {
    let peripherals = Peripherals::take().expect("taken only here");
    let output = hio::hstdout().map_err(|()| Error::Output)?;
    let mut bench = Bench::new(SysTick(peripherals.SYST), output);
    bench.calibrate(1, nop)?;
    bench.calibrate(10, || ten_times!(nop()))?;
    bench.calibrate(100, || ten_times!(ten_times!(nop())))?;
    bench.calibrate(1000, || ten_times!(ten_times!(ten_times!(nop()))))?;
    routines::measure_all(&mut bench)?;
    // The other board has no room for it.
    #[cfg(target_abi = "eabihf")]
    {
        bench_cortex_m::references::measure_all(&mut bench)?;
        bench_cortex_m::joint::measure_all(&mut bench)?;
        bench_cortex_m::tracker::measure_all(&mut bench)?;
    }
    Ok(())
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let status = match run() {
        Ok(()) => debug::EXIT_SUCCESS,
        Err(error) => {
            hprintln!("error {}", error);
            debug::EXIT_FAILURE
        }
    };
    loop {
        debug::exit(status);
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    hprintln!("error {}", info);
    loop {
        debug::exit(debug::EXIT_FAILURE);
    }
}
