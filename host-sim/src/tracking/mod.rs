//! Quality with which a calibrated network follows objects that cameras see and that have no radio.
//!
//! The coordinator's tracks are compared with the truth of a simulation, and with the best possible result
//! of the same looks.

mod bound;
mod score;

pub use bound::{Leg, Sight};
pub use score::{Causes, Change, Lack, Score};
