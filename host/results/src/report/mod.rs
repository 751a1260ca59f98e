//! Answers and runs for people and for programs.

pub mod json;
pub mod network;
pub mod run;
pub mod sweep;
pub mod table;
