//! Answers in print: [`table`] for people, [`json`] for programs.

pub mod json;
pub mod table;
