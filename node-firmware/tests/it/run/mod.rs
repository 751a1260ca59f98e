//! Whole nodes on the host: the firmware as a board runs it, over hardware that a test supplies.
//!
//! This is also how to test firmware of your own. A test needs
//! - a clock that moves only when every node waits: [`bench::Clock`] and [`bench::Bench::run_until`]. Hours
//!   pass in milliseconds, and the same test always does the same;
//! - a UART with a device on its end: [`bench::CameraUart`] answers as a CMUcam2 does, [`bench::PcUart`] is a
//!   PC;
//! - a radio: [`bench::Antenna`] hands frames to all others;
//! - flash, steps and lamps: a few lines each.

mod at_work;
mod bench;
mod coordinator_anew;
mod former_networks;
mod mesh;
mod provisioned_again;
use crate::support;
mod worn_flash;
