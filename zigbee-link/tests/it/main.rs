//! Tests of `zigbee-link` through what it offers, one program.

mod attacks;
mod capture;
mod network;
mod power;
mod runner;
mod sleep;
mod store;
mod support;
mod wire;
mod words;
