//! The coordinator of a real network, seen from the PC on its line: the parts of `host-sim console`.
//! Nothing here opens a port or reads a clock. The coordinator's messages make a
//! [`NetworkView`](results::view::NetworkView).
//!
//! | module | job |
//! |---|---|
//! | [`session`] | Bytes in, bytes out: asks for everything, and for one wish after the other. |
//! | [`output`] | The members as a table. |
//! | [`update`] | An update by radio. |

pub mod output;
pub mod session;
pub mod update;
