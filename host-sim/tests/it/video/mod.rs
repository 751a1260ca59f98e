//! Cameras that look at video: what they measure, and what nodes make of it.

#![cfg(unix)]

mod bearings;
mod command;
mod film;
mod modes;
mod rooms;
