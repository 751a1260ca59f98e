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
//! | [`world`] | Cameras, targets and obstacles of the plane: what each camera sees, how targets walk. |
//! | [`scenario`] | Reads scenarios, and plans where targets stop. |
//! | [`sim`] | Runs firmware in virtual time, on simulated radios, lines and flash. |
//! | [`network`] | Runs a scenario: every node's firmware, in one world. |
//! | [`record`] | What one run of a network came to: its data, statistics, verdict; many runs together. |
//! | [`report`] | Prints answers and runs as tables or as JSON. |
//! | [`export`] | Writes the poses of a run for other programs: CSV, YAML, ROS 2. |
//! | [`plot`] | Draws answers and runs. |
//! | [`console`] | Talks to the coordinator of a real network: members, poses, commands. |
//! | [`probe`] | Talks to a CMUcam2 on a serial port: what it sees, a picture, sightings for a file. |

#![forbid(unsafe_code)]

pub mod accuracy;
pub mod answer;
pub mod camera;
pub mod console;
pub mod export;
pub mod network;
pub mod plot;
pub mod probe;
pub mod record;
pub mod recorded;
pub mod report;
pub mod scenario;
pub mod sim;
pub mod world;
