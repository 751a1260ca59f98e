//! Tests of `node-firmware` through what it offers, one program.

mod any_input;
mod cmucam2;
mod facts;
mod judgement;
mod mishaps;
mod networks;
mod roles;
mod run;
mod single;
mod steps;
mod support;
mod target_sigmas;
mod wire;
