//! Camera networks on a computer.
//!
//! The command `host-sim` is built from these parts; benchmarks and tests use them directly.
//!
//! | module | job |
//! |---|---|
//! | [`recorded`] | Reads sightings, true poses and stops from CSV files. |
//! | [`answer`] | Gives every recorded case one answer. |
//! | [`camera`] | Emulates a CMUcam2: bytes in, bytes out. |
//! | [`accuracy`] | Compares answers with the truth: error quantiles, and how honest the sigmas are. |
//! | [`report`] | Prints answers as a table or as JSON. |
//! | [`plot`] | Draws answers on a map. |
//! | [`probe`] | Talks to a CMUcam2 on a serial port: what it sees, a picture, sightings for a file. |

#![forbid(unsafe_code)]

pub mod accuracy;
pub mod answer;
pub mod camera;
pub mod plot;
pub mod probe;
pub mod recorded;
pub mod report;
