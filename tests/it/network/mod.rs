//! Whole networks, from their seeds: every node's firmware over emulated cameras and a simulated
//! radio, in virtual time.

mod attackers;
mod buildings;
mod carriers;
mod determinism;
mod faults;
mod kinds;
mod light;
mod long;
mod references;
mod restarts;
mod yard;
