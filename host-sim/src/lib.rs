//! Camera networks on a computer.
//!
//! The command `host-sim` is built from these parts; benchmarks and tests use them directly.
//!
//! | module | job |
//! |---|---|
//! | [`network`] | Runs a scenario: every node's firmware, in one world. |
//! | [`console`] | Talks to the coordinator of a real network: members, poses, commands. |
//! | [`live`] | The page on which people see it, from a server or a file. |
//! | [`logging`] | Records of happenings, with levels, for commands that run for months. |
//! | [`mqtt`] | Tells a network's events to a broker, and hears those of a whole site. |
//! | [`probe`] | Talks to a CMUcam2 on a serial port: its view, a picture, sightings for a file. |
//! | [`tracking`] | Quality with which a calibrated network follows objects without a radio. |
//! | [`video`] | Video of any camera, for an emulated CMUcam2 to look at. |

#![forbid(unsafe_code)]

pub mod console;
pub mod live;
pub mod logging;
pub mod mqtt;
pub mod network;
pub mod probe;
pub mod tracking;
pub mod video;
