//! Answers and runs for people and for programs.

pub mod json;
pub mod run;
pub mod sweep;
pub mod table;
