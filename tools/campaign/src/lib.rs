//! Random sites on which things go wrong, run in simulation, and the conditions that must hold of each.
//!
//! A run has a number. With the seed of the campaign that number alone makes its site: cameras, ways,
//! carriers and faults. It is a [`Scenario`](site::Scenario) like any other, which `host-sim run`
//! repeats from its file. The simulation knows the truth, so that every claim of a node can be held
//! against it.
//!
//! | module | job |
//! |---|---|
//! | [`scenario`] | Draws the scenario of a run |
//! | [`runs`] | Runs scenarios side by side, to any outcome |
//! | [`journal`] | Judgements in files, so that a campaign goes on and its parts add up |
//! | [`judgement`] | Conditions that must hold, and the check of them |
//! | [`calm`] | Cameras that saw enough once the last fault was over |
//! | [`minimal`] | Leaves out of a scenario what its failure does not need |
//! | [`tally`] | Counts over all runs |

#![forbid(unsafe_code)]

pub mod calm;
pub mod journal;
pub mod judgement;
pub mod minimal;
pub mod runs;
pub mod scenario;
pub mod tally;
