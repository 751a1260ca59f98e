//! Results of a calibration.
//!
//! The same answers for recorded sightings, a rehearsed network and a real one: poses with their
//! status, how well sightings fit them, a verdict with the next stop, records, drawings and exports.
//!
//! | module | job |
//! |---|---|
//! | [`recorded`] | Reads sightings, true poses and stops from CSV files. |
//! | [`answer`] | Gives every recorded case one answer. |
//! | [`accuracy`] | Compares answers with the truth: error quantiles, and how honest the sigmas are. |
//! | [`record`] | Keeps the results of one run of a network: its data, statistics, verdict; many runs together. |
//! | [`report`] | Prints answers and runs as tables or as JSON. |
//! | [`view`] | Keeps what a PC on a coordinator's line knows of its network, simulated or real. |
//! | [`network`] | Solves a whole network again from its measurements. |
//! | [`export`] | Writes the poses of a network for other programs: CSV, YAML, ROS 2. |
//! | [`plot`] | Draws answers and runs. |

#![forbid(unsafe_code)]

pub mod accuracy;
pub mod answer;
pub mod export;
pub mod lens;
mod mirror;
pub mod network;
pub mod plot;
pub mod record;
pub mod recorded;
pub mod report;
pub mod view;
