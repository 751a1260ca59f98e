//! Tests across the crates, one program.

mod network;
mod pixy;
mod ray_scan;
mod recorded;
mod sight;
mod told_wrong;
