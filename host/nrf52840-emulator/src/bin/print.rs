//! Runs a program for a Cortex-M4F on the emulated chip, alone, and prints what it prints over semihosting:
//! `print ELF`.

use std::{env, error::Error, path::Path};

/// It has so much virtual time.
const MOST: u64 = 60_000_000_000;

fn main() -> Result<(), Box<dyn Error>> {
    let image = env::args().nth(1).ok_or("type `print ELF`")?;
    print!("{}", nrf52840_emulator::print(Path::new(&image), MOST)?);
    Ok(())
}
