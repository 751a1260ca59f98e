//! Whole nodes on the host: the firmware as a board runs it, on the boards of `node-test`.

mod at_work;
mod bench;
mod coordinator_anew;
mod former_networks;
mod mesh;
mod provisioned_again;
use crate::support;
#[cfg(feature = "update")]
mod updated;
mod worn_flash;
