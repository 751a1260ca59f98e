//! Tests in real time, against real programs. `cargo xtask peers` builds the programs and runs these.
#![cfg(unix)]

mod co_processor;
mod node;
mod openmv;
#[expect(dead_code, reason = "its own tests use more of it")]
#[path = "../../../../libraries/spinel-radio/tests/it/peer/mod.rs"]
mod peer;
mod port;
#[path = "../../../../zigbee-link/tests/it/support/mod.rs"]
mod support;
