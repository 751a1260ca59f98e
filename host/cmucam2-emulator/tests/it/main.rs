//! The emulated CMUcam2: its command line, its pictures, its faults, and the driver against it.

mod clients;
mod commands;
mod faults;
mod pictures;
mod support;
mod transcripts;
