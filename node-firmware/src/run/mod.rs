//! A node at work: its role connected to the seams.
//!
//! [`run`] is all a board or a simulation calls. It returns only when the node cannot go on: then
//! the board restarts, and the node goes on from what is in its flash.

mod camera;
mod coordinator;
mod drive;
mod target;

use core::{fmt, ops::Range, pin::pin};

use embassy_embedded_hal::flash::partition::{self, Partition};
use embassy_futures::select::{Either, select};
use embassy_sync::{blocking_mutex::raw::NoopRawMutex, mutex::Mutex};
use embedded_hal_async::delay::DelayNs;
use embedded_io_async::{Read, Write};
use embedded_storage_async::nor_flash::NorFlash;
use zigbee_link::{
    Instant,
    network::{Node, Settings},
    radio::Radio,
    runner::{self, Clock, Shared, Stopped},
    store::{Member, Saved, Store, StoreError, log::LogError},
    wire::Eui64,
};

use self::drive::Surroundings;
use crate::{
    config::{Config, Role},
    hardware::{Buttons, Indicator, Observer, StepSensor},
    log::warning,
    memory::Memory,
    message::MEMBERS,
};

/// Nodes that one talks to: all members and the coordinator.
const PEERS: usize = MEMBERS + 1;
/// Messages each way that wait.
const QUEUE: usize = 4;

/// What the link and the application share.
type SharedNode<C> = Shared<C, PEERS, QUEUE, MEMBERS>;

/// Everything a node needs of its surroundings.
#[derive(Debug)]
pub struct Seams<U, R, C, F, S, I, B, O> {
    /// A camera's CMUcam2, the coordinator's PC; unused by a target. Reads must be cancel-safe.
    pub uart: U,
    /// The radio.
    pub radio: R,
    /// The time.
    pub clock: C,
    /// Where the node keeps what it must not forget.
    pub flash: F,
    /// Which part of the flash is for what.
    pub layout: Layout,
    /// A target's step sensor.
    pub steps: S,
    /// Lamps.
    pub indicator: I,
    /// Buttons.
    pub buttons: B,
    /// Who watches; `()` for nobody.
    pub observer: O,
    /// The chip's own EUI-64, for a configuration that names none.
    pub extended: Eui64,
    /// Random, another one at each start.
    pub seed: u64,
}

/// Parts of a flash, bytes from its start. Each is an even number of erase units, aligned.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// For the radio link: two pages are enough.
    pub link: Range<u32>,
    /// For the role: two pages are enough.
    pub memory: Range<u32>,
}

/// Why a node cannot go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Failure<R, F> {
    /// The radio failed, or the link's part of the flash.
    Link(Stopped<R, F>),
    /// The role's part of the flash failed.
    Memory(LogError<F>),
}

impl<R, F> fmt::Display for Failure<R, F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Link(stopped) => stopped.fmt(f),
            Self::Memory(error) => error.fmt(f),
        }
    }
}

impl<R: fmt::Debug, F: fmt::Debug> core::error::Error for Failure<R, F> {}

/// Runs a node. `config` must have been [checked](Config::check).
///
/// # Errors
/// It never returns but with the reason why the node cannot go on.
pub async fn run<U, R, C, F, S, I, B, O>(
    config: &Config,
    seams: Seams<U, R, C, F, S, I, B, O>,
) -> Failure<R::Error, partition::Error<F::Error>>
where
    U: Read + Write,
    R: Radio,
    C: Clock,
    F: NorFlash,
    S: StepSensor,
    I: Indicator,
    B: Buttons,
    O: Observer,
{
    let Seams {
        uart,
        mut radio,
        clock,
        flash,
        layout,
        steps,
        indicator,
        buttons,
        mut observer,
        extended,
        seed,
    } = seams;
    let flash = Mutex::<NoopRawMutex, F>::new(flash);
    let part = |range: &Range<u32>| {
        let size = range.end.saturating_sub(range.start);
        (Partition::new(&flash, range.start, size), 0..size)
    };
    let (link_flash, link_range) = part(&layout.link);
    let (memory_flash, memory_range) = part(&layout.memory);

    let store = open_store(config, link_flash, link_range).await;
    let (mut store, saved) = match store {
        Ok(opened) => opened,
        Err(error) => return Failure::Link(Stopped::Store(error)),
    };
    let mut memory = match Memory::open(memory_flash, memory_range).await {
        Ok(memory) => memory,
        Err(error) => return Failure::Memory(error),
    };

    let settings = Settings {
        extended: config.extended().unwrap_or(extended),
        channels: config.channels(),
        tx_power: config.tx_power,
        protection: config.protection,
        seed,
    };
    let mut members = [None; MEMBERS];
    if let Role::Coordinator(_) = &config.role {
        for (place, member) in members.iter_mut().enumerate() {
            // A member that cannot be read joins again.
            *member = store.member(place as u8).await.ok().flatten();
        }
    }
    let shared = share_node(&clock, &config.role, settings, &saved, &members);
    if let Role::Coordinator(own) = &config.role {
        for &device in &own.allow {
            if shared.with(|node, _| node.allow(Eui64(device))).is_err() {
                warning!("the allow-list is longer than the table of members");
            }
        }
    }
    let link = runner::run(&shared, &mut radio, &mut store);
    let seed = seed as u16;
    let surroundings = Surroundings {
        shared: &shared,
        clock: &clock,
        memory: &mut memory,
        observer: &mut observer,
    };
    let role = async {
        match &config.role {
            Role::Coordinator(own) => {
                let seams = (uart, buttons, indicator);
                coordinator::run(own, surroundings, seams).await
            }
            Role::Camera(own) => {
                let seams = (uart, buttons, indicator);
                camera::run(config.id, own, surroundings, seams).await
            }
            Role::Target(own) => {
                let seams = (steps, indicator);
                target::run((config.id, seed), own, surroundings, seams).await
            }
        }
    };
    // Pinned here: a future passed by value is kept twice, and these are large.
    match select(pin!(link), pin!(role)).await {
        Either::First(stopped) => Failure::Link(stopped),
        Either::Second(error) => Failure::Memory(error),
    }
}

/// The role's side of the network.
// Not inlined: a node is large, and would take its place on the stack of every poll, or twice.
#[inline(never)]
fn share_node<'a, C: Clock>(
    clock: &'a C,
    role: &Role,
    settings: Settings,
    saved: &Saved,
    members: &[Option<Member>; MEMBERS],
) -> SharedNode<&'a C> {
    let node = match role {
        Role::Coordinator(_) => Node::coordinator(settings, saved, *members),
        Role::Camera(_) | Role::Target(_) => Node::device(clock.now(), settings, saved),
    };
    Shared::new(node, clock)
}

/// Opens the link's store, and provisions the node if its configuration is newer.
///
/// A configuration is newer when its frame counter is above all that may have been used: that of
/// a fresh node, or one provisioned later. So a counter is never used twice under one key, however
/// often a node is configured.
async fn open_store<F: NorFlash>(
    config: &Config,
    flash: F,
    range: Range<u32>,
) -> Result<(Store<F>, Saved), StoreError<F::Error>> {
    let mut store = Store::new(flash, range)?;
    let newer = match store.load().await {
        Ok(saved) if config.first_counter <= saved.counter_limit => return Ok((store, saved)),
        Ok(_) | Err(StoreError::NotProvisioned) => true,
        Err(error) => return Err(error),
    };
    if newer {
        // Refused where configurations are checked; such a node never transmits.
        let key = config.site_key.key().ok_or(StoreError::NotProvisioned)?;
        store.provision(key, config.first_counter).await?;
    }
    let saved = store.load().await?;
    Ok((store, saved))
}

/// Waiting, for drivers that wait.
struct ClockDelay<'a, C>(&'a C);

impl<C: Clock> DelayNs for ClockDelay<'_, C> {
    async fn delay_ns(&mut self, ns: u32) {
        let Instant(now) = self.0.now();
        let micros = u64::from(ns).div_ceil(1000);
        self.0
            .sleep_until(Instant(now.saturating_add(micros)))
            .await;
    }
}
