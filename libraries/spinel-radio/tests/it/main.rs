//! Tests of `spinel-radio` through what it offers, one program.

mod frames;
mod ot_rcp;
mod peer;
mod radio;
mod session;
