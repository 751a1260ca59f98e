//! Forming, joining and leaving a network.
//!
//! A [`Node`] is a [`Link`] and its place in a network: coordinator or device. It is sans-IO:
//! frames and the time go in, [`Action`]s come out. [`runner`](crate::runner) connects it.
//!
//! # Coordinator
//! It scans its channels for other PANs, takes the quietest channel and a free identifier, and
//! starts the network; the store remembers it, and every member's short address, over a restart. It
//! admits devices whose EUI-64 is on the allow-list, or any that holds the site key while a join
//! window is open; members may come back at any time. A full table answers "at capacity".
//!
//! A member that is [removed](Node::remove) is told so once. If it misses that, it is told again as
//! soon as it has to prove itself to the coordinator, which it has to with its next frame, at the
//! latest when it asks whether the coordinator is there. Meanwhile nobody else gets its address:
//! addresses are given in turn, after a restart of the coordinator from behind the highest one in
//! the table.
//!
//! # Device
//! It scans, and tries the networks it heard, its former one first. Joining is authenticated both
//! ways: device and coordinator first prove freshness to each other with the site key (see
//! [`security`](crate::security)); only then the association request and its answer count. A device
//! asks a silent coordinator every [`KEEP_ALIVE`] whether it is there. When it is not, the device
//! is an orphan: it scans and joins again, and gets the same short address. The orphan scan of the
//! standard is not used: it would find the same coordinator with one frame less. A coordinator
//! answers the orphan notification of a member all the same, if it is secured.
//!
//! # PAN conflict
//! A coordinator that hears a beacon with its own identifier, or is told so by a member, takes
//! another one and announces it by a secured coordinator realignment. Who misses it, rejoins.
//! Beacons can be forged, so this happens once a minute at most.

mod coordinate;
mod coordinator;
mod device;
mod keep_up;
mod scan;

use core::time::Duration;

use self::{
    coordinator::{Coordinator, Rotation},
    device::Device,
    scan::{Found, Scan, beacon_payload, parse_beacon},
};
pub use self::{
    coordinator::{JOIN_WINDOW_MAX, KeyChange, MembersFull},
    device::KEEP_ALIVE,
    scan::{Channels, SCAN_TIME},
};
use crate::{
    Instant,
    jitter::Jitter,
    link::Link,
    radio::{Channel, Config, FRAME_MAX},
    security::{Counter, Key, Protection, RotationError, Session},
    slots::Slots,
    store::{Member, Membership, Record, Saved},
    wire::{
        Address, AssociationStatus, Beacon, Command, Eui64, Frame, FrameType, Header, PanId,
        Panned, ShortAddress, Superframe, is_secured,
    },
};

/// Commands waiting to be sent.
const COMMANDS: usize = 8;

/// What a node is built for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Settings {
    /// The own extended address.
    pub extended: Eui64,
    /// Channels to form or look for a network on.
    pub channels: Channels,
    /// Transmit power, dBm.
    pub tx_power: i8,
    /// How frames are secured.
    pub protection: Protection,
    /// Spreads waiting times and chooses PAN identifiers; should differ between nodes and restarts.
    pub seed: u64,
}

/// What is to be done, in this order, before anything else is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use]
pub enum Action {
    /// Write this down, then call [`Node::saved`].
    Save(Record),
    /// Configure the radio.
    Configure(Config),
    /// Send the first so many bytes of the buffer.
    Transmit(usize),
}

/// Where a node stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Status {
    /// It belongs to no network and looks for none.
    Out,
    /// It looks for a network, or for a free place for its own. With the last refusal, if any.
    Searching(Option<AssociationStatus>),
    /// It belongs to a network.
    Joined(Membership),
}

#[derive(Debug)]
enum Role<const MEMBERS: usize> {
    Coordinator(Coordinator<MEMBERS>),
    Device(Device),
}

/// What changed and is not yet written down, members apart. What it is now, the node knows: so
/// nothing queues, and nothing is lost however much changes.
#[derive(Clone, Copy, Debug, Default)]
struct Unsaved {
    active_key: bool,
    next_key: bool,
    network: bool,
}

/// A secured command on its way out.
#[derive(Clone, Copy, Debug)]
struct Outbound {
    destination: Address,
    command: Command,
    due: Instant,
}

/// One node: a link and its place in a network.
///
/// `PEERS` nodes can be talked to, `QUEUE` messages queue each way, and a coordinator has up to
/// `MEMBERS` members, at most [`MEMBERS_MAX`](crate::store::MEMBERS_MAX). With 0 members, a node is
/// a device, and the code of a coordinator is left out.
#[derive(Debug)]
pub struct Node<const PEERS: usize, const QUEUE: usize, const MEMBERS: usize> {
    /// Messages.
    pub link: Link<PEERS, QUEUE>,
    settings: Settings,
    role: Role<MEMBERS>,
    commands: Slots<Outbound, COMMANDS>,
    unsaved: Unsaved,
    configured: Option<Config>,
    beacon_request_due: bool,
    jitter: Jitter,
    /// After a conflict: the identifier to change to once it is announced.
    realignment: Option<PanId>,
}

impl<const PEERS: usize, const QUEUE: usize, const MEMBERS: usize> Node<PEERS, QUEUE, MEMBERS> {
    /// A coordinator with what its store remembers.
    #[inline(always)]
    pub fn coordinator(
        settings: Settings,
        saved: &Saved,
        members: [Option<Member>; MEMBERS],
    ) -> Self {
        const { assert!(MEMBERS > 0 && MEMBERS <= crate::store::MEMBERS_MAX) };
        let state = match saved.network {
            Some(network) => coordinator::State::Running(network),
            None => coordinator::State::Scanning(Scan::new(settings.channels)),
        };
        let mut node = Self::new(
            settings,
            saved,
            Role::Coordinator(Coordinator::new(state, members)),
        );
        if let Some(network) = saved.network {
            node.link.attach(network.pan, network.short);
        }
        node
    }

    /// A device with what its store remembers. It looks for a network at once.
    #[inline(always)]
    pub fn device(now: Instant, settings: Settings, saved: &Saved) -> Self {
        let state = match saved.network {
            Some(membership) => device::State::Joined {
                membership,
                unanswered: 0,
                check: now,
            },
            None => device::State::Scanning,
        };
        let device = Device::new(state, settings.channels, saved.network);
        let mut node = Self::new(settings, saved, Role::Device(device));
        if let Some(network) = saved.network {
            node.link.attach(network.pan, network.short);
        }
        node
    }

    // A node is large, and each call that returns one may copy it on the stack: inlined, it is made
    // in its place.
    #[inline(always)]
    fn new(settings: Settings, saved: &Saved, role: Role<MEMBERS>) -> Self {
        let counter = Counter::resume(saved.counter_limit);
        let protection = settings.protection;
        let mut session = Session::new(settings.extended, protection, saved.active_key, counter);
        if let Some(next) = saved.next_key {
            // With the same index it is the active one, saved but not yet cleared.
            let _ = session.keys.install(next);
        }
        Self {
            link: Link::new(session, settings.seed),
            settings,
            role,
            commands: Slots::new(),
            unsaved: Unsaved::default(),
            configured: None,
            beacon_request_due: false,
            jitter: Jitter::new(!settings.seed),
            realignment: None,
        }
    }

    /// Where the node stands.
    pub fn status(&self) -> Status {
        match &self.role {
            Role::Coordinator(Coordinator { state, .. }) => match state {
                coordinator::State::Scanning(_) => Status::Searching(None),
                coordinator::State::Running(network) => Status::Joined(*network),
            },
            Role::Device(device) => match &device.state {
                device::State::Out => Status::Out,
                device::State::Joined { membership, .. } => Status::Joined(*membership),
                _ => Status::Searching(device.refusal),
            },
        }
    }

    /// The members of this coordinator.
    pub fn members(&self) -> impl Iterator<Item = Member> {
        let members = match &self.role {
            Role::Coordinator(coordinator) => coordinator.members.as_slice(),
            Role::Device(_) => &[],
        };
        members.iter().copied().flatten()
    }

    /// Lets a device join this coordinator's network at any time. Means nothing to a device.
    ///
    /// # Errors
    /// As many devices as the network can have are expected already.
    pub fn allow(&mut self, device: Eui64) -> Result<(), MembersFull> {
        match &mut self.role {
            Role::Coordinator(coordinator) => coordinator.allow(device),
            Role::Device(_) => Ok(()),
        }
    }

    /// Lets any device with the site key join this coordinator's network for a while, at most
    /// [`JOIN_WINDOW_MAX`]. Means nothing to a device.
    pub fn open_join_window(&mut self, now: Instant, duration: Duration) {
        if let Role::Coordinator(coordinator) = &mut self.role {
            coordinator.open_window(now, duration);
        }
    }

    /// Ends the join window.
    pub fn close_join_window(&mut self) {
        if let Role::Coordinator(coordinator) = &mut self.role {
            coordinator.close_window();
        }
    }

    /// Sends a member away; a device that does not hear it is told again when it is next heard.
    /// Whether it was a member. It may come back if it is on the allow-list or a window is open; to
    /// keep out a captured node, [change the key](Self::change_key) for all others.
    pub fn remove(&mut self, now: Instant, device: Eui64) -> bool {
        let is_removed = match &mut self.role {
            Role::Coordinator(coordinator) => coordinator.remove(device),
            Role::Device(_) => false,
        };
        if is_removed {
            self.dismiss(now, device);
        }
        is_removed
    }

    /// Leaves the network and looks for no other until [`join`](Self::join).
    pub fn leave(&mut self, now: Instant) {
        let Role::Device(device) = &mut self.role else {
            return;
        };
        if let device::State::Joined { membership, .. } = device.state {
            let command = Command::Disassociation { reason: 2 };
            self.command(now, Address::Extended(membership.coordinator), command);
        }
        self.depart(device::State::Out);
    }

    /// Looks for a network, if the node has none.
    pub fn join(&mut self) {
        if let Role::Device(device) = &mut self.role
            && matches!(device.state, device::State::Out)
        {
            device.scan(self.settings.channels);
        }
    }

    /// Hands a new key on to all members, one after the other, and then uses it. Members that
    /// cannot be reached must be provisioned anew, [`key_change`](Self::key_change) counts them.
    /// Frames under the former key are accepted for [`KEY_WINDOW`](crate::link::KEY_WINDOW) more. A
    /// coordinator that restarts meanwhile has to be told again.
    ///
    /// # Errors
    /// The key in use has this index, or this node is no coordinator.
    pub fn change_key(&mut self, next: Key) -> Result<(), RotationError> {
        let Role::Coordinator(coordinator) = &mut self.role else {
            return Err(RotationError::NotInstalled);
        };
        self.link.session.keys.install(next)?;
        if let Some(ticket) = coordinator.rotation.and_then(|former| former.ticket) {
            self.link.withdraw(ticket);
        }
        coordinator.rotation = Some(Rotation {
            change: KeyChange {
                index: next.index(),
                is_done: false,
                unreached: 0,
            },
            place: 0,
            ticket: None,
        });
        self.unsaved.next_key = true;
        Ok(())
    }

    /// How the last change of key since the start goes. `None` without one, and for a device.
    pub fn key_change(&self) -> Option<KeyChange> {
        match &self.role {
            Role::Coordinator(coordinator) => Some(coordinator.rotation?.change),
            Role::Device(_) => None,
        }
    }

    /// The store has written the record down.
    pub fn saved(&mut self, record: Record) {
        if let Record::CounterLimit(limit) = record {
            return self.link.session.counter.reserved(limit);
        }
        // What changed meanwhile has to be written again.
        if self.unsaved() != Some(record) {
            return;
        }
        match record {
            Record::CounterLimit(_) => {}
            Record::ActiveKey(_) => self.unsaved.active_key = false,
            Record::NextKey(_) => self.unsaved.next_key = false,
            Record::Network(_) => self.unsaved.network = false,
            Record::Member(place, _) => {
                if let Role::Coordinator(coordinator) = &mut self.role {
                    coordinator.saved(place);
                }
            }
        }
    }

    /// The next record to write down.
    #[inline(never)]
    fn unsaved(&self) -> Option<Record> {
        let keys = &self.link.session.keys;
        // The key in use first: without a next key, it is the one that was next.
        if self.unsaved.active_key {
            Some(Record::ActiveKey(keys.active()))
        } else if self.unsaved.next_key {
            Some(Record::NextKey(keys.next()))
        } else if self.unsaved.network {
            Some(Record::Network(self.network()))
        } else if let Role::Coordinator(coordinator) = &self.role {
            coordinator.unsaved()
        } else {
            None
        }
    }

    /// The network to remember.
    const fn network(&self) -> Option<Membership> {
        match &self.role {
            Role::Coordinator(coordinator) => match coordinator.state {
                coordinator::State::Scanning(_) => None,
                coordinator::State::Running(network) => Some(network),
            },
            Role::Device(device) => device.home,
        }
    }

    // Not inlined: a large value is moved, and there are many callers.
    #[inline(never)]
    fn command(&mut self, due: Instant, destination: Address, command: Command) {
        // When the queue is full, the peer asks again.
        let _ = self.commands.put(Outbound {
            destination,
            command,
            due,
        });
    }

    /// When to call [`poll`](Self::poll) next, unless something else happens.
    pub fn deadline(&self) -> Option<Instant> {
        let own = match &self.role {
            Role::Coordinator(coordinator) => match &coordinator.state {
                coordinator::State::Scanning(scan) => Some(scan.until()),
                coordinator::State::Running(_) => coordinator.beacon_due,
            },
            Role::Device(device) => match &device.state {
                device::State::Out => None,
                device::State::Pausing(until) => Some(*until),
                device::State::Scanning => Some(device.scan.until()),
                device::State::Joining { due, .. } => Some(*due),
                device::State::Joined { check, .. } => Some(*check),
            },
        };
        let commands = self.commands.iter().map(|outbound| outbound.due);
        [own, self.link.deadline()]
            .into_iter()
            .flatten()
            .chain(commands)
            .min()
    }

    /// What to do next. Call it until it returns `None` and the deadline is not past, then again at
    /// the [`deadline`](Self::deadline), after each received frame and after each call of another
    /// method.
    pub fn poll(&mut self, now: Instant, buffer: &mut [u8; FRAME_MAX]) -> Option<Action> {
        if let Some(limit) = self.link.session.counter.wanted() {
            return Some(Action::Save(Record::CounterLimit(limit)));
        }
        match &self.role {
            // Without members, no node is a coordinator, and its code is left out.
            Role::Coordinator(_) if MEMBERS > 0 => self.coordinate(now),
            Role::Coordinator(_) => {}
            Role::Device(_) => self.keep_up(now),
        }
        if self.link.take_keys_changed() {
            self.unsaved.active_key = true;
            self.unsaved.next_key = true;
        }
        if let Some(record) = self.unsaved() {
            return Some(Action::Save(record));
        }
        if let Some(config) = self.config()
            && self.configured != Some(config)
        {
            self.configured = Some(config);
            return Some(Action::Configure(config));
        }
        self.transmit(now, buffer).map(Action::Transmit)
    }

    /// How the radio should be configured now; `None` for as it is.
    fn config(&self) -> Option<Config> {
        let nowhere = |channel| (channel, PanId::BROADCAST, ShortAddress::BROADCAST);
        let at = |network: &Membership| (network.channel, network.pan, network.short);
        let (channel, pan, short) = match &self.role {
            Role::Coordinator(Coordinator { state, .. }) => match state {
                coordinator::State::Scanning(scan) => nowhere(scan.channel()?),
                coordinator::State::Running(network) => at(network),
            },
            Role::Device(Device { state, scan, .. }) => match state {
                device::State::Out | device::State::Pausing(_) => return None,
                device::State::Scanning => nowhere(scan.channel()?),
                device::State::Joining { candidate, .. } => {
                    (candidate.channel, candidate.pan, ShortAddress::BROADCAST)
                }
                device::State::Joined { membership, .. } => at(membership),
            },
        };
        Some(Config {
            channel,
            tx_power: self.settings.tx_power,
            pan,
            short,
            extended: self.settings.extended,
            coordinator: matches!(self.role, Role::Coordinator(_)),
            promiscuous: false,
        })
    }

    fn transmit(&mut self, now: Instant, buffer: &mut [u8; FRAME_MAX]) -> Option<usize> {
        if core::mem::take(&mut self.beacon_request_due) {
            let to = Panned::new(PanId::BROADCAST, Address::Short(ShortAddress::BROADCAST));
            let header = Header {
                destination: to,
                ..Header::new(FrameType::Command, self.link.next_sequence())
            };
            let len = header.emit(buffer).ok()?;
            let command = Command::BeaconRequest.emit(buffer.get_mut(len..)?).ok()?;
            return Some(len + command);
        }
        self.transmit_beacon(now, buffer)
            .or_else(|| self.transmit_command(now, buffer))
            .or_else(|| self.link.poll_transmit(now, buffer))
    }

    fn transmit_beacon(&mut self, now: Instant, buffer: &mut [u8; FRAME_MAX]) -> Option<usize> {
        let Role::Coordinator(coordinator) = &mut self.role else {
            return None;
        };
        let coordinator::State::Running(network) = coordinator.state else {
            return None;
        };
        coordinator
            .beacon_due
            .take_if(|due| MEMBERS > 0 && *due <= now)?;
        let header = Header {
            source: Panned::new(network.pan, Address::Extended(self.settings.extended)),
            ..Header::new(FrameType::Beacon, self.link.next_sequence())
        };
        let len = header.emit(buffer).ok()?;
        let payload = beacon_payload(coordinator.is_full());
        let superframe = Superframe::beaconless(coordinator.invites(now));
        let beacon = Beacon::new(superframe, &payload);
        Some(len + beacon.emit(buffer.get_mut(len..)?).ok()?)
    }

    fn transmit_command(&mut self, now: Instant, buffer: &mut [u8; FRAME_MAX]) -> Option<usize> {
        let outbound = self.commands.take(|outbound| outbound.due <= now)?;
        let pan = self.configured?.pan;
        let header = Header {
            destination: Panned::new(pan, outbound.destination),
            source: Panned::compressed(Address::Extended(self.settings.extended)),
            ..Header::new(FrameType::Command, self.link.next_sequence())
        };
        let mut payload = [0; 16];
        let len = outbound.command.emit(&mut payload).ok()?;
        // Without a frame counter the command is lost, and the peer asks again.
        let sealed = self.link.session.seal(&header, payload.get(..len)?, buffer);
        sealed.ok().map(|sealed| sealed.len)
    }

    /// Takes in a frame without FCS, which is decrypted in place.
    pub fn handle(&mut self, now: Instant, frame: &mut [u8]) {
        let Some(config) = self.configured else {
            return;
        };
        // Most of what is heard is secured and for somebody else, which the link sees at once.
        if !is_secured(frame) && self.handle_open(now, frame, config.channel) {
            return;
        }
        let event = self.link.handle(now, frame);
        match &mut self.role {
            Role::Coordinator(_) if MEMBERS > 0 => self.coordinator_event(now, event),
            Role::Coordinator(_) => {}
            Role::Device(_) => self.device_event(now, event),
        }
    }

    /// Beacons and beacon requests, which are not secured. Whether it was one.
    fn handle_open(&mut self, now: Instant, bytes: &[u8], channel: Channel) -> bool {
        let Ok(frame) = Frame::parse(bytes) else {
            return true;
        };
        if let Some(found) = parse_beacon(&frame, channel) {
            self.heard_beacon(now, found);
            return true;
        }
        let header = frame.header();
        let is_request = header.frame_type == FrameType::Command
            && header.security.is_none()
            && Command::parse(frame.payload()) == Ok(Command::BeaconRequest);
        if let (true, Role::Coordinator(coordinator)) = (is_request, &mut self.role) {
            // Other coordinators answer at the same time.
            let due = now + self.jitter.up_to(Duration::from_millis(30));
            coordinator.beacon_due.get_or_insert(due);
        }
        is_request
    }

    fn heard_beacon(&mut self, now: Instant, found: Found) {
        match &mut self.role {
            Role::Coordinator(coordinator) => match &mut coordinator.state {
                coordinator::State::Scanning(scan) => scan.heard(found),
                coordinator::State::Running(network) => {
                    if MEMBERS > 0 && found.pan == network.pan {
                        self.conflict(now);
                    }
                }
            },
            Role::Device(device) => match &mut device.state {
                device::State::Scanning => device.scan.heard(found),
                device::State::Joined { membership, .. } => {
                    let stranger = found.coordinator != Some(membership.coordinator);
                    if found.pan == membership.pan
                        && stranger
                        && self.commands.iter().next().is_none()
                    {
                        let coordinator = Address::Extended(membership.coordinator);
                        self.command(now, coordinator, Command::PanIdConflict);
                    }
                }
                _ => {}
            },
        }
    }
}

#[cfg(feature = "defmt")]
impl<const PEERS: usize, const QUEUE: usize, const MEMBERS: usize> defmt::Format
    for Node<PEERS, QUEUE, MEMBERS>
{
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{}, {}", self.status(), self.link);
    }
}
