//! Cameras that look at video: their measurements, and the results of nodes.

#![cfg(unix)]

mod bearings;
mod command;
mod film;
mod modes;
mod rooms;
