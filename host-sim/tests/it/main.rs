//! Tests of the commands and the library together, in one program: each suite is a module.

mod common;
mod small;

mod camera_line;
mod chip_process;
mod chip_walk;
mod chips;
mod console;
mod decryption;
mod deploy;
mod events;
mod live;
mod logging;
mod probe;
mod pseudo_terminal;
mod real_time;
mod run;
mod solve;
mod solve_network;
mod solve_reference;
mod solve_space;
mod start;
mod tracking;
mod video;
