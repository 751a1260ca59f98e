//! Tests of `cmucam2-driver` through what it offers, one program.

mod chaos;
mod clock;
mod command;
mod common;
mod dialogue;
mod parser;
mod random;
mod restore;
mod soak;
mod stream;
