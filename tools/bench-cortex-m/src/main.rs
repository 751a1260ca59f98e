//! Counts the instructions of the node's routines on an emulated board: `cargo xtask cortex-m`
//! builds it for each processor and runs it.
#![cfg_attr(target_os = "none", no_std, no_main)]
#![forbid(unsafe_code)]

#[cfg(target_os = "none")]
mod board;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this counts on an emulated processor: type `cargo xtask cortex-m`");
    std::process::exit(1);
}
