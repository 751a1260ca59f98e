//! Commands, run as people run them.

mod flash;
mod help;
mod place;
mod provision;
mod setup;
