//! Joint estimation against walks whose truth is known, and against a dense batch adjustment.

mod batch;
mod consistency;
mod faults;
mod geometry;
mod keeping;
mod lenses;
mod ranges;
mod rounds;
mod support;
