//! The machinery of simulated networks: virtual time, radio medium, lines, flash.

mod executor;
mod flash;
mod line;
mod medium;
mod network;
mod support;
