//! Joint estimation against walks whose truth is known, and against a dense batch adjustment.

mod batch;
mod consistency;
mod geometry;
mod support;
