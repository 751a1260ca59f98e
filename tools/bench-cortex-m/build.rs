//! Chooses the emulated board by the target: the end of its memory, and the rate of its `SysTick`.

use std::{env, fs, io, path::PathBuf};

struct Board {
    target: &'static str,
    flash_end: u32,
    ram_end: u32,
    systick_hz: u32,
}

const BOARDS: [Board; 2] = [
    // mps2-an386: ARM application note 386, memory map; QEMU's `mps2.c` clocks it at 25 MHz. As much of its
    // 4 MiB each as an nRF52840 has, which `results` runs on too.
    Board {
        target: "thumbv7em-none-eabihf",
        flash_end: 0x0010_0000,
        ram_end: 0x2004_0000,
        systick_hz: 25_000_000,
    },
    // BBC micro:bit: nRF51822 product specification, memory map; 16 MHz.
    Board {
        target: "thumbv6m-none-eabi",
        flash_end: 0x0004_0000,
        ram_end: 0x2000_4000,
        systick_hz: 16_000_000,
    },
];

fn main() -> io::Result<()> {
    println!("cargo:rerun-if-changed=build.rs");
    let target = env::var("TARGET").unwrap_or_default();
    let Some(board) = BOARDS.iter().find(|board| board.target == target) else {
        return Ok(()); // a host: nothing to link for
    };
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default());
    let ram = 0x2000_0000;
    let script = format!(
        "MEMORY\n{{\n  FLASH : ORIGIN = 0, LENGTH = {:#x}\n  RAM : ORIGIN = {ram:#x}, LENGTH = {:#x}\n}}\n",
        board.flash_end,
        board.ram_end - ram,
    );
    // The one at the top of the repository includes the second.
    for name in ["memory.x", "board-memory.x"] {
        fs::write(out.join(name), &script)?;
    }
    println!("cargo:rustc-link-search={}", out.display());
    for argument in ["--nmagic", "-Tlink.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
    println!("cargo:rustc-env=SYSTICK_HZ={}", board.systick_hz);
    Ok(())
}
