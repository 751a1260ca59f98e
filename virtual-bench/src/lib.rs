//! The machinery on which firmware runs in virtual time.
//!
//! Thousands of nodes, each an async function over the seams of the hardware, run in one process
//! on one thread, and the same seed gives the same run.
//!
//! | module | job |
//! |---|---|
//! | [`executor`] | Virtual time: tasks, timers, power cuts, pace. |
//! | [`medium`] | Radio: who hears whom and what is lost why, behind `zigbee_link`'s `Radio`. |
//! | [`mod@line`] | UARTs with the time that bytes take, to an emulated camera or to a program. |
//! | [`co_processor`] | A radio co-processor that speaks Spinel on a UART. |
//! | [`polled`] | Sockets and devices as UARTs, in real time. |
//! | [`flash`] | NOR flash that outlasts its node and may be torn by a power cut. |
//! | [`random`] | Chance: one root seed, named streams. |

pub mod co_processor;
pub mod executor;
pub mod flash;
pub mod line;
pub mod medium;
pub mod polled;
pub mod random;
