//! Commands, run as people run them.

mod help;
mod place;
mod setup;
