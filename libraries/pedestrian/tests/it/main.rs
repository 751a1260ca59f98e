//! Tests of `pedestrian` through what it offers, one program.

mod walker;
mod walks;
