#![doc = include_str!("../README.md")]
//!
//! | module | job |
//! |---|---|
//! | [`executor`] | Virtual time: tasks, timers, power cuts, pace. |
//! | [`medium`] | Radio: range, losses and their reasons, behind `zigbee_link`'s `Radio`. |
//! | [`mod@line`] | UARTs with the time that bytes take, to an emulated camera or to a program. |
//! | [`polled`] | Sockets and devices as UARTs, in real time. |
//! | [`flash`] | NOR flash that outlasts its node and may be torn by a power cut. |
//! | [`worn`] | The same, whose operations fail or are lost. |
//! | [`random`] | Chance: one root seed, named streams. |
//!
//! A test makes an [`Executor`](executor::Executor), gives its clock to all else, spawns firmware, and runs it
//! until a time. Parts that outlast a node that loses its power (its flash, its place on the air, its line) belong
//! to the test; the node gets handles.
//!
//! # Example
//! A node that sends every second, another one that hears it, and a power cut between the third
//! and the fourth frame:
//! ```
//! use std::{cell::Cell, rc::Rc};
//! use virtual_hardware::{
//!     executor::{Ended, Executor, Time},
//!     medium::{Medium, NRF52840, Propagation},
//! };
//! use zigbee_link::{
//!     radio::{Channel, RadioConfig, PSDU_MAX, Radio},
//!     wire::{Eui64, PanId, ShortAddress},
//! };
//!
//! const SECOND: Time = 1_000_000_000;
//! let config = RadioConfig {
//!     channel: Channel::FIRST,
//!     tx_power: 0,
//!     pan: PanId(1),
//!     short: ShortAddress(2),
//!     extended: Eui64([3; 8]),
//!     coordinator: false,
//!     promiscuous: true,
//!     sampled: false,
//! };
//! let mut executor = Executor::new();
//! let clock = executor.clock();
//! let disk = Propagation::UnitDisk { range: 10.0, loss: 0.0 };
//! let medium = Medium::new(&clock, disk, 1);
//! let [here, there] = [[0.0, 0.0], [3.0, 4.0]].map(|place| medium.attach(place));
//!
//! let mut radio = medium.radio(here, NRF52840);
//! let sender = executor.spawn(async move {
//!     radio.configure(&config).await.unwrap();
//!     loop {
//!         clock.sleep(SECOND).await;
//!         radio.transmit(&[0x41, 0x88, 0, 1, 0, 2, 0, 3, 0]).await.unwrap();
//!     }
//! });
//! let mut radio = medium.radio(there, NRF52840);
//! let heard = Rc::new(Cell::new(0));
//! let count = heard.clone();
//! executor.spawn(async move {
//!     radio.configure(&config).await.unwrap();
//!     let mut buffer = [0; PSDU_MAX];
//!     loop {
//!         radio.receive(&mut buffer).await.unwrap();
//!         count.set(count.get() + 1);
//!     }
//! });
//!
//! assert_eq!(executor.run_until(7 * SECOND / 2), Ended::TimeUp);
//! executor.kill(sender);
//! assert_eq!(executor.run_until(3600 * SECOND), Ended::TimeUp);
//! assert_eq!(heard.get(), 3);
//! ```

pub mod executor;
pub mod flash;
pub mod line;
pub mod medium;
pub mod polled;
pub mod random;
pub mod worn;
