//! Shared parts of the tests of this crate.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "every test binary uses a part of this module"
)]

pub mod bus;
#[path = "../../../../libraries/flash-log/tests/it/support/mod.rs"]
pub mod flash;
pub mod net;
pub mod site;
pub mod target;
