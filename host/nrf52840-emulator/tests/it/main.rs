//! Tests of the emulated nRF52840 with the image that is flashed.

mod image;
mod plug;
