//! Tests of `pixy-driver` through what it offers, one program.

mod session;
mod streaming;
