//! Instructions that the node's routines take on the processors a node may have.
//!
//! The emulator executes one instruction per nanosecond of its own time, so a timer on the
//! emulated board counts instructions, the same in every run. Instructions are not cycles: flash
//! wait states, the divider and taken branches cost more on a real part.
//!
//! | module | what it does |
//! |---|---|
//! | [`bits`] | results to compare between machines: the binary `results` prints them |
//! | [`joint`] | rounds of joint estimation, step by step |
//! | [`measure`] | counts a routine over many inputs, prints one line |
//! | [`pose`] | poses from three sightings, of which the bits are told |
//! | [`references`] | reference solves of twelve stops |
//! | [`routines`] | the routines that are counted; **a new routine is one more statement there** |
//! | [`scene`] | random cameras and targets to count with |
//! | [`total`] | a published three-object method, to compare with |
//! | [`tracker`] | looks of cameras that track four objects |
//!
//! The binary of the same name adds the board: its timer, its output, and a check of the count itself.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod bits;
pub mod joint;
pub mod measure;
pub mod pose;
pub mod references;
pub mod routines;
pub mod scene;
pub mod total;
pub mod tracker;
