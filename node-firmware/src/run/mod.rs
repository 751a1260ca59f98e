//! A node at work: its role connected to its hardware.
//!
//! A board or a simulation only calls [`run`]. It returns only when the node cannot go on. Then the board
//! restarts, and the node goes on from the facts in its flash. [`run_over`] is its part above the
//! [`Network`], for a network of another kind.
//!
//! Three futures run side by side, in one task:
//!
//! 1. `zigbee_link::runner` moves frames between radio and link, and writes down the facts that the link must
//!    not forget. It shares the link with the second one.
//! 2. `drive` tells the role its events (messages from the link, results of sent messages, events of devices,
//!    the time) and asks it for its outputs: a message goes to the link, a fact to the flash before anything
//!    else, a task to the devices.
//! 3. The devices of the role (`camera`: a CMUcam2; `coordinator`: a PC; `moving_target`: a step
//!    sensor) take tasks from one channel, and put events into another. A camera and a coordinator
//!    have buttons besides.

// Parts of it that not all roles use.
#![cfg_attr(
    not(all(feature = "camera", feature = "coordinator", feature = "target")),
    allow(dead_code, unused_imports, unused_variables)
)]

#[cfg(feature = "camera")]
mod camera;
#[cfg(feature = "coordinator")]
mod coordinator;
mod drive;
#[cfg(feature = "target")]
mod moving_target;
mod outlined;
mod shared_flash;
mod update;
mod zigbee;

use core::{convert::Infallible, fmt, pin::pin};

use embassy_futures::select::{Either3, select3};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash};
use flash_log::LogError;
use zigbee_link::{
    network::{NetworkSettings, Node},
    radio::Radio,
    runner::{self, Clock, RunnerError, Shared},
    store::{Member, Record, Saved, Store, StoreError},
    wire::Eui64,
};

use self::{
    drive::Services, outlined::Outlined, shared_flash::SharedFlash, update::Mail,
    zigbee::ZigbeeNetwork,
};
use crate::{
    config::{CheckedConfig, RoleConfig},
    facts::FactStore,
    hardware::{Hardware, Peripherals},
    limits::MEMBERS,
    liveness::{Liveness, WatchedRadio},
    log::warning,
    network::{Administration, Network},
};

/// Nodes that one talks to: all members and the coordinator.
const PEERS: usize = MEMBERS + 1;
/// Messages each way that wait.
const QUEUE: usize = 4;

/// Attempts to open a flash that fails.
const ATTEMPTS: usize = 2;

/// Failure of the radio.
pub type RadioError<H> = <<H as Hardware>::Radio as Radio>::Error;

/// Failure of the flash.
pub type FlashError<H> = <<H as Hardware>::Flash as ErrorType>::Error;

/// Reason why a node cannot go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Failure<R, F> {
    /// The radio failed, or the link's part of the flash, so that the next frame would repeat a nonce.
    Link(RunnerError<R, F>),
    /// The role's part of the flash does not fit.
    Facts(LogError<F>),
    /// The boot loader is to change images, forth or back.
    #[cfg(feature = "update")]
    Update,
}

impl<R, F> fmt::Display for Failure<R, F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Link(stopped) => stopped.fmt(f),
            Self::Facts(error) => error.fmt(f),
            #[cfg(feature = "update")]
            Self::Update => f.write_str("the boot loader changes images"),
        }
    }
}

impl<R: fmt::Debug, F: fmt::Debug> core::error::Error for Failure<R, F> {}

impl<R, F> From<RunnerError<R, F>> for Failure<R, F> {
    fn from(stopped: RunnerError<R, F>) -> Self {
        Self::Link(stopped)
    }
}

impl<R, F> From<StoreError<F>> for Failure<R, F> {
    fn from(error: StoreError<F>) -> Self {
        Self::Link(error.into())
    }
}

impl<R, F> From<LogError<F>> for Failure<R, F> {
    fn from(error: LogError<F>) -> Self {
        Self::Facts(error)
    }
}

/// Runs a node, which reports to `liveness`.
///
/// A flash that is worn out or damaged is no reason to stop: the role then works from RAM, and so does the
/// link, with an extended address that it draws at each start, like a node whose store is blank.
///
/// # Errors
/// It returns only with the reason why the node cannot go on.
pub async fn run<H: Hardware>(
    config: &CheckedConfig,
    peripherals: Peripherals<H>,
    liveness: &Liveness,
) -> Failure<RadioError<H>, FlashError<H>> {
    let Peripherals {
        uart,
        radio,
        clock,
        flash,
        layout,
        steps,
        indicator,
        buttons,
        observer,
        seed,
        update,
    } = peripherals;
    let flash = SharedFlash::new(flash);

    let facts = FactStore::closed(flash.user(), layout.facts, config.settings().owner());
    let mut facts = match facts {
        Ok(facts) => facts,
        Err(error) => return error.into(),
    };
    let opened = async {
        for _ in 0..ATTEMPTS {
            if facts.reopen().await.is_ok() {
                return;
            }
        }
        facts.abandon();
    };
    Outlined(pin!(opened)).await;
    let mut store = match Store::new(flash.user(), layout.link) {
        Ok(store) => store,
        Err(error) => return error.into(),
    };
    let mut members = [None; MEMBERS];
    let opened = Outlined(pin!(open_store(
        (config, seed),
        &mut store,
        &mut facts,
        &mut members,
        liveness
    )))
    .await;
    let (saved, extended) = opened;

    let mut settings = NetworkSettings::new(extended, seed);
    settings.channels = config.channels();
    settings.tx_power = config.settings().tx_power;
    settings.protection = config.settings().protection;
    settings.sleeps = config.settings().sleeps;
    let network = share_node::<H>(&clock, &config.settings().role, settings, &saved, &members);
    if let RoleConfig::Coordinator(own) = &config.settings().role {
        for &device in &own.allow {
            let allowed = network.node.with(|node, _| node.allow(device));
            debug_assert!(
                allowed == Some(Ok(())),
                "the allow-list is longer than the table of members"
            );
        }
    }
    let mut radio = WatchedRadio {
        radio,
        clock: &clock,
        liveness,
    };
    let link = runner::run(&network.node, &mut radio, &mut store);
    let devices = Devices::<H> {
        uart,
        clock: &clock,
        steps,
        indicator,
        buttons,
        observer,
        seed,
        liveness,
    };
    let mail = Mail::new();
    let role = run_role(config, devices, &mut facts, (&network, &mail));
    let updated = update::run(update, config, &flash, (&network, &clock, &mail));
    // Pinned here: a future passed by value is kept twice, and these are large. The link takes no stack
    // while the role computes.
    match select3(Outlined(pin!(link)), pin!(role), Outlined(pin!(updated))).await {
        Either3::First(stopped) => Failure::Link(stopped),
        Either3::Second(never) => match never {},
        Either3::Third(ended) => ended.failure(),
    }
}

/// Devices of a role besides its network and its flash: the rest of [`Peripherals`].
pub struct Devices<'a, H: Hardware> {
    /// See [`Hardware::Uart`].
    pub uart: H::Uart,
    /// The time since the start.
    pub clock: &'a H::Clock,
    /// A target's step sensor.
    pub steps: H::Steps,
    /// Dark so far.
    pub indicator: H::Indicator,
    /// See [`Button`](crate::hardware::Button) for the request of each.
    pub buttons: H::Buttons,
    /// Called in the middle of the node's work: it must not wait.
    pub observer: H::Observer,
    /// Random, another one at each start.
    pub seed: u64,
    /// Receiver of the reports of radio and camera.
    pub liveness: &'a Liveness,
}

/// Runs a node's role and its devices over any [`Network`]. The network's own work is not done here.
///
/// The facts that `facts` remembers must be of that network: where addresses were given anew, they are to be
/// [forgotten](FactStore::forget) first. Where their flash does not serve, the role works from RAM.
pub async fn run_over<H: Hardware, N: Network + Administration, F: NorFlash>(
    config: &CheckedConfig,
    devices: Devices<'_, H>,
    facts: &mut FactStore<F>,
    network: &N,
) -> Infallible {
    // A network of another kind carries updates of its own.
    run_role(config, devices, facts, (network, &Mail::new())).await
}

async fn run_role<H: Hardware, N: Network + Administration, F: NorFlash>(
    config: &CheckedConfig,
    devices: Devices<'_, H>,
    facts: &mut FactStore<F>,
    (network, mail): (&N, &Mail),
) -> Infallible {
    let Devices {
        uart,
        clock,
        steps,
        mut indicator,
        buttons,
        mut observer,
        seed,
        liveness,
    } = devices;
    let seed = seed as u16;
    let services = Services::<'_, H, N, F> {
        network,
        clock,
        facts,
        observer: &mut observer,
        indicator: &mut indicator,
        liveness,
        mail,
    };
    match &config.settings().role {
        #[cfg(feature = "coordinator")]
        RoleConfig::Coordinator(own) => {
            Outlined(pin!(coordinator::run(own, services, (uart, buttons)))).await
        }
        #[cfg(feature = "camera")]
        RoleConfig::Camera(own) => {
            Outlined(pin!(camera::run(
                (
                    config.settings().id,
                    config.optics(),
                    config.settings().sleeps
                ),
                own,
                services,
                (uart, buttons)
            )))
            .await
        }
        #[cfg(feature = "target")]
        RoleConfig::Target(own) => {
            Outlined(pin!(moving_target::run(
                (config.settings().id, seed),
                own,
                services,
                steps
            )))
            .await
        }
        // Refused where configurations are checked.
        #[cfg(not(all(feature = "camera", feature = "coordinator", feature = "target")))]
        _ => core::future::pending().await,
    }
}

/// The role's side of the network.
fn share_node<'a, H: Hardware>(
    clock: &'a H::Clock,
    role: &RoleConfig,
    settings: NetworkSettings,
    saved: &Saved,
    members: &[Option<Member>; MEMBERS],
) -> ZigbeeNetwork<&'a H::Clock> {
    match role {
        #[cfg(feature = "coordinator")]
        RoleConfig::Coordinator(_) => share_coordinator::<H>(clock, settings, saved, members),
        _ => share_device::<H>(clock, settings, saved),
    }
}

// A node is large, and would take its place on the stack of every poll, or twice.
#[inline(never)] // for less stack
fn share_coordinator<'a, H: Hardware>(
    clock: &'a H::Clock,
    settings: NetworkSettings,
    saved: &Saved,
    members: &[Option<Member>; MEMBERS],
) -> ZigbeeNetwork<&'a H::Clock> {
    let node = Node::coordinator(settings, saved, *members);
    ZigbeeNetwork::new(Shared::new(node, clock))
}

#[inline(never)] // for less stack
fn share_device<'a, H: Hardware>(
    clock: &'a H::Clock,
    settings: NetworkSettings,
    saved: &Saved,
) -> ZigbeeNetwork<&'a H::Clock> {
    let node = Node::device(clock.now(), settings, saved);
    ZigbeeNetwork::new(Shared::new(node, clock))
}

/// Opens the link's store, and provisions the node if it has no key, or if its configuration has
/// another key than the node was provisioned with. Memberships are then void.
///
/// No nonce occurs twice, whatever is erased or configured, and whenever the power fails:
/// - A node whose store is blank (new, or erased) forgot which frame counters it used. It draws a new
///   extended address before it sends anything, and so does one whose number changed. Thread
///   demands the same of a device that is commissioned (Thread 1.1, table 3-2).
/// - While the store is there, the frame counter only rises, under whichever key.
/// - It is the key of the provisioning that is compared: a node whose network changed its key does
///   not fall back to that of its page.
/// - A store that cannot be read or written serves no more. A node with such a store draws a new extended
///   address at each start, too, and writes nothing.
///
/// Another role keeps the key, the address and the counter, but is no member of the network that a
/// coordinator formed, or that a device joined, on the same board before.
///
/// With a membership go the facts that the role remembers, and a coordinator's members, for their addresses
/// are given anew. They go first: where the power fails in between, all this is done again.
async fn open_store<F: NorFlash>(
    (config, seed): (&CheckedConfig, u64),
    store: &mut Store<F>,
    facts: &mut FactStore<F>,
    members: &mut [Option<Member>; MEMBERS],
    liveness: &Liveness,
) -> (Saved, Eui64) {
    let drawn = Eui64::of_node(config.settings().id, seed);
    // A read may fail once.
    for _ in 0..ATTEMPTS {
        if let Ok(opened) = try_store((config, drawn), store, facts, members).await {
            return opened;
        }
    }
    warning!("the flash does not serve: the link works from RAM");
    liveness.on_flash_failed();
    // Not the one that may be in the flash by now: the next start may find it there.
    let drawn = Eui64::of_node(config.settings().id, !seed);
    let mut saved = Saved::of_new(config.key(), drawn);
    // The site may have another key than its page says.
    if let Ok(read) = store.load().await
        && store
            .first_key()
            .await
            .is_ok_and(|first| first == config.key())
    {
        saved = Saved {
            active_key: read.active_key,
            next_key: read.next_key,
            former_key: read.former_key,
            ..saved
        };
    }
    store.abandon();
    *members = [None; MEMBERS];
    // A coordinator forms another network, in which addresses are given anew. Others notice.
    let is_coordinator = matches!(config.settings().role, RoleConfig::Coordinator(_));
    if is_coordinator && facts.forget().await.is_err() {
        facts.abandon();
    }
    (saved, drawn)
}

/// The same with a flash that serves.
async fn try_store<F: NorFlash>(
    (config, drawn): (&CheckedConfig, Eui64),
    store: &mut Store<F>,
    facts: &mut FactStore<F>,
    members: &mut [Option<Member>; MEMBERS],
) -> Result<(Saved, Eui64), StoreError<F::Error>> {
    let key = config.key();
    let is_own = |extended: &Eui64| extended.number() == config.settings().id;
    let provisioned = match store.load().await {
        Ok(_) if store.first_key().await? == key => None,
        Ok(saved) => Some((saved.extended.filter(is_own), saved.counter_limit)),
        Err(StoreError::NotProvisioned) => Some((None, 0)),
        Err(error) => return Err(error),
    };
    if let Some((own, used)) = provisioned {
        // Facts that cannot be forgotten must not be taken for those of the next network.
        facts.forget().await.map_err(StoreError::from)?;
        store.provision(key, own.unwrap_or(drawn), used).await?;
    }
    let mut saved = store.load().await?;
    let own = saved.extended.filter(is_own);
    let is_coordinator = matches!(config.settings().role, RoleConfig::Coordinator(_));
    let is_void = saved
        .network
        .take_if(|network| own.is_none_or(|own| (network.coordinator == own) != is_coordinator))
        .is_some();
    if is_void {
        facts.forget().await.map_err(StoreError::from)?;
    }
    store.members(members).await?;
    if saved.network.is_none() {
        for (place, member) in (0..).zip(members) {
            if member.take().is_some() {
                store.save(Record::Member(place, None)).await?;
            }
        }
    }
    if is_void {
        store.save(Record::Network(None)).await?;
    }
    if own.is_none() {
        store.save(Record::Extended(drawn)).await?;
    }
    // Frame counters are reserved before the first frame. Where that is not possible, it is known now.
    let reserved = Record::CounterLimit(saved.counter_limit);
    store.save(reserved).await?;
    Ok((saved, own.unwrap_or(drawn)))
}
