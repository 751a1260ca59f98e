#![doc = include_str!("../README.md")]
//!
//! [`Pedestrian`] takes [samples](ImuSample) and gives the [steps](calib_core::dead_reckoning::Step)
//! that a [`Track`](calib_core::dead_reckoning::Track) adds to a place. It is made of three parts,
//! each of use alone:
//!
//! | part | question |
//! |---|---|
//! | [`StepDetector`] | Was that a step? |
//! | [`StepLength`] | How long was it? |
//! | [`HeadingFilter`] | Which way does the body face? |
//!
//! # Conventions
//! Angles and sigmas are those of [`calib_core`]: radians, counter-clockwise, headings in
//! `[0, 2 pi)`, one standard deviation. Lengths are in the world's unit, accelerations in m/s^2.
//! Everything is generic over the scalar ([`calib_core::Real`]), allocates nothing, and takes the
//! time from outside. A sample that no sensor can have measured is refused and changes nothing.
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

mod heading_filter;
mod person;
mod sample;
mod settings;
mod step_detector;
mod step_length;

pub use calib_core;
pub use heading_filter::{HeadingFilter, HeadingSettings, magnetic_north};
pub use nalgebra;
pub use person::{Pedestrian, PedestrianSettings};
pub use sample::{ImuError, ImuSample};
pub use settings::InvalidSetting;
pub use step_detector::{StepDetector, StepDetectorSettings, Swing};
pub use step_length::{StepLength, StepLengthError};
