//! Tests of `flash-log` through what it offers, one program.

mod log;
mod sequential_storage;
mod spoilt;
mod support;
