#![doc = include_str!("../README.md")]
//!
//! | module | question |
//! |---|---|
//! | [`camera`] | In which direction does a pixel column look? |
//! | [`resection`] | Where is a camera that saw a target at three or more known places? |
//! | [`intersection`] | Where is a target that two or more cameras of known pose see? |
//! | [`mod@reference`] | Where do two cameras look, and where is the target, when only its displacements are known? |
//! | [`joint`] | Where are all cameras, the target's places, and what does its carrier get wrong, from everything together? |
//! | [`level`] | Is a camera level, as everything in the plane assumes? |
//! | [`space`] | Where is a camera that hangs high, tilted and rolled, from columns and rows? |
//! | [`tracking`] | Where are objects that move, when a camera cannot tell which one it saw? |
//! | [`dead_reckoning`] | Where is the target after some more steps? |
//! | [`fit`] | Do the measurements agree with the answer? |
//!
//! Everything but [`space`] works in the plane, as in the thesis this project builds on (section 2.4), allocates
//! nothing, and is generic over the scalar ([`Real`]): `f32` on a node, `f64` on a computer, from
//! the same source.
//!
//! # Conventions
//! - Angles are radians, counter-clockwise. Headings are in `[0, 2 pi)`, from the world's x axis.
//! - A bearing, or offset `phi`, is signed and relative to the camera's optical axis: positive when
//!   the target is *left* of it, that is at a *smaller* pixel column than the principal point.
//! - Lengths are in whatever unit the target's places are in.
//! - Every sigma is one standard deviation.
//! - An unanswerable question is [refused](Refusal) with a reason. No function returns NaN.
//! - The worth of a pose is one word: its [`Status`].
//!
//! # Size
//! A node has some 200 KB of flash, and a stack of 8 KB for everything. Where the compiler would copy
//! a function into its callers, or their frames would add up, it is kept apart: `#[inline(never)]`
//! "for less flash" or "for less stack" says which. Solvers work on slices of numbers ([`Method`] on up to
//! six unknowns), so that a node has their code once instead of once for each number of unknowns;
//! large values are filled in place instead of moved.
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

pub mod camera;
pub mod dead_reckoning;
pub mod fit;
pub mod intersection;
pub mod joint;
pub mod level;
pub mod reference;
pub mod resection;
pub mod space;
pub mod tracking;

mod error;
mod numerics;
mod pose;
mod refusal;
mod sighting;
mod status;

pub use error::Error;
pub use nalgebra;
pub use numerics::{
    angle,
    minimize::Method,
    real::{Real, lit},
};
pub use pose::{Ellipse, Pose, PoseError};
pub use refusal::Refusal;
pub use sighting::{Ray, Sighting};
pub use status::{Limits, Status};
