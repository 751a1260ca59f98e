//! Prints results to compare between machines, over semihosting: `cargo xtask cortex-m` runs it on each
//! processor, and on this computer; `cargo xtask test --stage chip` on an emulated nRF52840, too.
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

/// The same on this computer; with `small`, what a processor prints that has no room for all.
#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    use bench_cortex_m::bits;

    let mut output = String::new();
    let options: Vec<String> = std::env::args().skip(1).collect();
    let printed = match options.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        [] => bits::print_all(&mut output),
        ["small"] => bits::print_small(&mut output),
        _ => {
            eprintln!("type `results`, or `results small`");
            return std::process::ExitCode::from(2);
        }
    };
    print!("{output}");
    match printed {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(_) => std::process::ExitCode::FAILURE,
    }
}
