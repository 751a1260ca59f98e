//! Items that the tests of this crate share.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "every test binary uses a part of this module"
)]

pub mod aether;
#[path = "../../../../libraries/flash-log/tests/it/support/mod.rs"]
pub mod flash;
pub mod node;
