//! The dialogue with co-processors that misbehave.

mod anything;
mod bench;
mod commands;
mod reception;
mod restarts;
