//! The pages of `host-sim live`, `host-sim edit` and `run --report` in a real browser: headless Chromium. Where
//! Chromium or its driver is missing, this fails: `cargo xtask test` installs them.

#![cfg(unix)]

mod browser;
mod drawing;
mod editor;
mod firefox;
mod lines;
mod looks;
mod memory;
mod mqtt;
mod pages;
mod thousand;
