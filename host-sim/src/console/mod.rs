//! The coordinator of a real network, seen from the PC on its line: what `host-sim console` is made
//! of. Nothing here opens a port or reads a clock.
//!
//! | module | job |
//! |---|---|
//! | [`known`] | What the coordinator has told: network, members, poses. |
//! | [`session`] | Bytes in, bytes out: asks for everything, and for one wish after the other. |
//! | [`output`] | What is known as a table, CSV and JSON. |

pub mod known;
pub mod output;
pub mod session;
