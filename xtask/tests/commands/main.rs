//! Commands that make a board a node, run as people run them.

mod flash;
mod place;
mod provision;
