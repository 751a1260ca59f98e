//! The coordinator of a real network, seen from the PC on its line: what `host-sim console` is made
//! of. Nothing here opens a port or reads a clock. What it has told is a
//! [`NetworkView`](answers::view::NetworkView).
//!
//! | module | job |
//! |---|---|
//! | [`session`] | Bytes in, bytes out: asks for everything, and for one wish after the other. |
//! | [`output`] | The members as a table. |

pub mod output;
pub mod session;
