//! Prints results to compare between machines, over semihosting: `cargo xtask cortex-m` runs it on each
//! processor, and `cargo xtask test --stage chip` on an emulated nRF52840, too.
#![cfg_attr(target_os = "none", no_std, no_main)]
#![forbid(unsafe_code)]

#[cfg(target_os = "none")]
mod on_board {
    use core::{fmt, panic::PanicInfo};

    use bench_cortex_m::bits;
    use cortex_m as _;
    use cortex_m_semihosting::{debug, hio, hprintln};
    use memory_functions as _;

    fn print() -> fmt::Result {
        let mut output = hio::hstdout().map_err(|()| fmt::Error)?;
        // The other one has no room for all.
        if cfg!(target_abi = "eabihf") {
            bits::print_all(&mut output)
        } else {
            bits::print_small(&mut output)
        }
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let status = match print() {
            Ok(()) => debug::EXIT_SUCCESS,
            Err(fmt::Error) => debug::EXIT_FAILURE,
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
}

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this runs on an emulated processor: type `cargo xtask cortex-m`");
    std::process::exit(1);
}
