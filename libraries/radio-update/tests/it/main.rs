//! Tests of `radio-update` through what it offers, one program.

mod chip;
mod cuts;
mod spread;
