//! Cameras that look at video: what they measure, and what nodes make of it.

#![cfg(unix)]

mod bearings;
mod command;
#[path = "../common/mod.rs"]
mod common;
mod film;
mod modes;
mod rooms;
