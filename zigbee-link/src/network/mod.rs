//! Forming, joining and leaving a network.
//!
//! A [`Node`] is a [`Link`] and its place in a network: coordinator or device. It is sans-IO:
//! frames and the time go in, [`Action`]s come out. [`runner`](crate::runner) connects it.
//!
//! # Coordinator
//! It scans its channels for other PANs, takes the quietest channel and a free identifier, and
//! starts the network; the store remembers it, and every member's short address, over a restart. It
//! admits devices whose [number](Eui64::number) is on the allow-list, or any that holds the site key
//! while a join window is open; members may come back at any time. A full table answers "at capacity".
//!
//! A device that comes back with the number of a member and another address was erased, and has drawn
//! a new one: it takes the member's place, with the same short address. Two devices with one number
//! would go on taking it from each other.
//!
//! A member that is [removed](Node::remove) is told so once. If it misses that, it is told again as soon as it has
//! to prove itself to the coordinator, which it has to with its next frame, at the latest when it asks whether the
//! coordinator is there. Meanwhile no other device gets its address: addresses are given in turn, after a restart
//! of the coordinator from behind the highest one in the table.
//!
//! # Device
//! It scans, and tries the networks it heard, its former one first. Joining is authenticated both
//! ways: device and coordinator first prove freshness to each other with the site key (see
//! [`security`](crate::security)); only then the association request and its answer count. A coordinator
//! says every 15 s that it is there, or twice as often where frames get lost, and a device asks one that
//! was silent for [`KEEP_ALIVE`]. When it is not, the device is an orphan: it scans and joins again, and
//! gets the same short address. The orphan scan of the standard is not used: it would find the same
//! coordinator with one frame less. A coordinator answers the orphan notification of a member all the
//! same, if it is secured.
//!
//! A device that is carried about may [look](Node::roam) whether it hears another network with the same
//! site key better than its own, and goes over to it then. Its frame counter goes on: the key is the
//! same, and so is its address, so no nonce is used again. The former coordinator keeps its place.
//!
//! # PAN conflict
//! Two networks with one identifier disturb each other little: frames of the other one are not
//! authentic. Beacons can be forged, so no network moves by itself: a coordinator
//! [remembers](Node::last_conflict) that it heard another one, and [takes another
//! identifier](Node::change_pan) when a person wants that. It announces it by a secured coordinator
//! realignment; a member that misses that rejoins.

mod coordinator;
mod device;
mod scan;

use core::time::Duration;

use self::{
    coordinator::Coordinator,
    device::Device,
    scan::{Found, beacon_payload, parse_beacon},
};
pub use self::{
    coordinator::{JOIN_WINDOW_MAX, KeyChange, MembersFull},
    device::KEEP_ALIVE,
    scan::{Channels, SCAN_TIME},
};
use crate::{
    Instant,
    jitter::Jitter,
    link::{Link, LinkEvent},
    radio::{Channel, FRAME_MAX, RadioConfig},
    security::{Counter, FrameSecurity, Key, Protection, RotationError},
    slots::Slots,
    store::{Member, Membership, Record, Saved},
    wire::{
        Address, AssociationStatus, Beacon, Eui64, Frame, FrameType, Header, MacCommand, PanId,
        Panned, ShortAddress, Superframe, is_secured,
    },
};
use flash_log::DirtySet;

/// Commands waiting to be sent.
const COMMANDS: usize = 8;

/// Every device of every network.
const EVERYBODY: Panned = Panned::new(PanId::BROADCAST, Address::Short(ShortAddress::BROADCAST));

/// Settings of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct NetworkSettings {
    /// The own extended address.
    pub extended: Eui64,
    /// Channels to form or look for a network on.
    pub channels: Channels,
    /// Transmit power, dBm.
    pub tx_power: i8,
    /// Protection of frames.
    pub protection: Protection,
    /// Spreads waiting times and chooses PAN identifiers; should differ between nodes and restarts.
    pub seed: u64,
    /// Devices sleep while the network is quiet, and are woken for messages. All nodes of a network must have the same:
    /// one that does not know of it reaches only devices that are awake.
    pub sleeps: bool,
}

impl NetworkSettings {
    /// A node on any channel, at 0 dBm, with 64 bits of integrity in each frame. Other values are set in the fields.
    pub const fn new(extended: Eui64, seed: u64) -> Self {
        Self {
            extended,
            channels: Channels::ALL,
            tx_power: 0,
            protection: Protection::EncMic64,
            seed,
            sleeps: false,
        }
    }
}

/// Something to do, in this order, before anything else is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use]
pub enum Action {
    /// Write this down, then call [`Node::saved`].
    Save(Record),
    /// Configure the radio.
    Configure(RadioConfig),
    /// Send the first so many bytes of the buffer.
    Transmit(usize),
}

/// State of a node in its network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum NetworkStatus {
    /// It belongs to no network and looks for none.
    Out,
    /// It looks for a network, or for a free place for its own. With the last refusal, if any.
    Searching(Option<AssociationStatus>),
    /// It belongs to a network.
    Joined(Membership),
}

/// Facts of every node that are to be written down, in this order, for power may go after each. Once another key
/// is in use, members that missed it have only the former one; without a next key, the key in use is the one that
/// was next. The node knows their present values.
const FACT_FORMER_KEY: usize = 0;
const FACT_ACTIVE_KEY: usize = 1;
const FACT_NEXT_KEY: usize = 2;
const FACT_NETWORK: usize = 3;

/// A node's part in its network, with all that only this part knows.
#[derive(Debug)]
enum Role<const MEMBERS: usize> {
    Coordinator(Coordinator<MEMBERS>),
    Device(Device),
}

/// Things that both parts work with, beside the link.
#[derive(Debug)]
struct Common {
    settings: NetworkSettings,
    commands: Slots<Outbound, COMMANDS>,
    /// Facts to write down, except members, of which only a coordinator knows.
    unsaved: DirtySet<1>,
    beacon_request_due: bool,
    jitter: Jitter,
}

/// A secured command on its way out.
#[derive(Clone, Copy, Debug)]
struct Outbound {
    destination: Address,
    command: MacCommand,
    due: Instant,
}

/// One node: a link and its place in a network.
///
/// `PEERS` nodes can be talked to, `QUEUE` messages queue each way, and a coordinator has up to
/// `MEMBERS` members, at most [`MEMBERS_MAX`](crate::store::MEMBERS_MAX). With 0 members, a node is
/// a device, and the code of a coordinator is left out.
#[derive(Debug)]
pub struct Node<const PEERS: usize, const QUEUE: usize, const MEMBERS: usize> {
    /// The messages of the node, to send and to receive.
    pub link: Link<PEERS, QUEUE>,
    common: Common,
    role: Role<MEMBERS>,
    configured: Option<RadioConfig>,
}

impl<const PEERS: usize, const QUEUE: usize, const MEMBERS: usize> Node<PEERS, QUEUE, MEMBERS> {
    /// A coordinator with what its store remembers.
    // for less stack
    #[inline(always)]
    pub fn coordinator(
        settings: NetworkSettings,
        saved: &Saved,
        members: [Option<Member>; MEMBERS],
    ) -> Self {
        const { assert!(MEMBERS > 0 && MEMBERS <= crate::store::MEMBERS_MAX) };
        let common = Common::new(settings);
        let role = Role::Coordinator(Coordinator::new(saved.network, members, &common));
        Self::new(saved, common, role)
    }

    /// A device with what its store remembers. It looks for a network at once.
    // for less stack
    #[inline(always)]
    pub fn device(now: Instant, settings: NetworkSettings, saved: &Saved) -> Self {
        let common = Common::new(settings);
        let role = Role::Device(Device::new(now, saved.network, &common));
        Self::new(saved, common, role)
    }

    // for less stack
    #[inline(always)]
    fn new(saved: &Saved, common: Common, role: Role<MEMBERS>) -> Self {
        let settings = &common.settings;
        let counter = Counter::resume(saved.counter_limit);
        let mut session = FrameSecurity::new(
            settings.extended,
            settings.protection,
            saved.active_key,
            counter,
        );
        if let Some(next) = saved.next_key {
            // With the same index it is the active one, saved but not yet cleared.
            let _ = session.keys.install(next);
        }
        if let (Some(former), Role::Coordinator(coordinator)) = (saved.former_key, &role) {
            // The members that missed the change are not written down: any may have, until they are heard.
            session.keys.recall(former);
            for member in coordinator.members() {
                session.await_late(member.extended);
            }
        }
        let mut link = Link::new(session, settings.seed);
        // A coordinator obeys no other node.
        link.obey(settings.extended);
        if let Some(network) = saved.network {
            link.attach(network.pan, network.short);
            link.obey(network.coordinator);
        }
        if matches!(role, Role::Coordinator(_)) {
            link.stay_present();
        }
        if settings.sleeps {
            link.sleep_when_quiet();
        }
        Self {
            link,
            common,
            role,
            configured: None,
        }
    }

    /// Returns the node's place in the network.
    pub fn status(&self) -> NetworkStatus {
        match &self.role {
            Role::Coordinator(coordinator) => coordinator.status(),
            Role::Device(device) => device.status(),
        }
    }

    /// The members of this coordinator.
    pub fn members(&self) -> impl Iterator<Item = Member> {
        self.role
            .coordinator()
            .into_iter()
            .flat_map(Coordinator::members)
    }

    /// Lets the device with this [number](Eui64::number) join this coordinator's network at any time.
    /// Means nothing to a device.
    ///
    /// # Errors
    /// As many devices as the network can have are expected already.
    pub fn allow(&mut self, device: u16) -> Result<(), MembersFull> {
        let coordinator = self.role.coordinator_mut();
        coordinator.map_or(Ok(()), |coordinator| coordinator.allow(device))
    }

    /// Lets any device with the site key join this coordinator's network for a while, at most
    /// [`JOIN_WINDOW_MAX`]. Means nothing to a device.
    pub fn open_join_window(&mut self, now: Instant, duration: Duration) {
        if let Some(coordinator) = self.role.coordinator_mut() {
            coordinator.open_window(now, duration);
        }
    }

    /// Ends the join window.
    pub fn close_join_window(&mut self) {
        if let Some(coordinator) = self.role.coordinator_mut() {
            coordinator.close_window();
        }
    }

    /// Sends a member away; a device that does not hear it is told again when it is next heard. Returns true if it
    /// was a member. It may come back if it is on the allow-list or a window is open; to keep out a captured node,
    /// [change the key](Self::change_key) for all others.
    pub fn remove(&mut self, now: Instant, device: Eui64) -> bool {
        match self.role.coordinator_mut() {
            Some(coordinator) => coordinator.remove(now, device, &mut self.link, &mut self.common),
            None => false,
        }
    }

    /// Leaves the network and looks for no other until [`join`](Self::join).
    pub fn leave(&mut self, now: Instant) {
        if let Role::Device(device) = &mut self.role {
            device.leave(now, &mut self.link, &mut self.common);
        }
    }

    /// Looks for a network, if the node has none.
    pub fn join(&mut self) {
        if let Role::Device(device) = &mut self.role {
            device.join(&self.common);
        }
    }

    /// Hands a new key on to all members, one after the other, and then uses it. Frames under the
    /// former key are accepted for [`KEY_WINDOW`](crate::link::KEY_WINDOW) more. Members that could not be
    /// reached, which [`key_change`](Self::key_change) counts, are understood under the former key for
    /// longer, and given the one in use when they are heard: until all have it, the key changes again, or a
    /// member is [removed](Self::remove), which may have the former key and could speak in their names.
    /// Then they must be provisioned anew, as must those that missed two changes.
    ///
    /// A coordinator that restarts before the change is done has to be told again.
    ///
    /// # Errors
    /// The key in use has this index, or this node is no coordinator.
    pub fn change_key(&mut self, next: Key) -> Result<(), RotationError> {
        let coordinator = self.role.coordinator_mut();
        let coordinator = coordinator.ok_or(RotationError::NotInstalled)?;
        coordinator.change_key(next, &mut self.link, &mut self.common)
    }

    /// Looks whether another network of the site is heard better than its own, and goes over to it if so.
    /// Meanwhile this device is in none. Returns true if that begins: not while it looks for one already, nor on a
    /// coordinator.
    pub fn roam(&mut self) -> bool {
        match &mut self.role {
            Role::Coordinator(_) => false,
            Role::Device(device) => device.roam(&mut self.link, &self.common),
        }
    }

    /// Time when this coordinator last heard a beacon of another network with its identifier. Beacons can be
    /// forged.
    pub fn last_conflict(&self) -> Option<Instant> {
        self.role.coordinator()?.last_conflict()
    }

    /// Takes another PAN identifier, and tells all members. Returns true if that begins: not while the network
    /// does not run or is being moved, nor on a device.
    pub fn change_pan(&mut self, now: Instant) -> bool {
        match self.role.coordinator_mut() {
            Some(coordinator) => {
                self.link.wake_all(now);
                coordinator.change_pan(now, &mut self.common)
            }
            None => false,
        }
    }

    /// Progress of the last change of key since the start. `None` without one, and for a device.
    pub fn key_change(&self) -> Option<KeyChange> {
        let change = self.role.coordinator()?.key_change()?;
        Some(match change.is_done {
            false => change,
            true => KeyChange {
                unreached: self.link.session.late(),
                ..change
            },
        })
    }

    /// The store has written the record down.
    pub fn saved(&mut self, record: Record) {
        if let Record::CounterLimit(limit) = record {
            return self.link.session.counter.reserved(limit);
        }
        // A record that changed meanwhile has to be written again.
        if self.unsaved() != Some(record) {
            return;
        }
        match record {
            // The node's owner writes its address down, before the node is.
            Record::CounterLimit(_) | Record::Extended(_) => {}
            Record::ActiveKey(_) => self.common.unsaved.clear(FACT_ACTIVE_KEY),
            Record::NextKey(_) => self.common.unsaved.clear(FACT_NEXT_KEY),
            Record::Network(_) => self.common.unsaved.clear(FACT_NETWORK),
            Record::FormerKey(_) => self.common.unsaved.clear(FACT_FORMER_KEY),
            Record::Member(place, _) => {
                if let Some(coordinator) = self.role.coordinator_mut() {
                    coordinator.saved(place);
                }
            }
        }
    }

    /// The next record to write down.
    // for less flash
    #[inline(never)]
    fn unsaved(&self) -> Option<Record> {
        let keys = &self.link.session.keys;
        match self.common.unsaved.first() {
            Some(FACT_FORMER_KEY) => {
                let is_kept = self.link.session.late() > 0;
                Some(Record::FormerKey(keys.former().filter(|_| is_kept)))
            }
            Some(FACT_ACTIVE_KEY) => Some(Record::ActiveKey(keys.active())),
            Some(FACT_NEXT_KEY) => Some(Record::NextKey(keys.next())),
            Some(_) => Some(Record::Network(self.network())),
            None => self.role.coordinator()?.unsaved(),
        }
    }

    /// The network to remember.
    const fn network(&self) -> Option<Membership> {
        match &self.role {
            Role::Coordinator(coordinator) => coordinator.network(),
            Role::Device(device) => device.network(),
        }
    }

    /// Time to call [`poll`](Self::poll) next, unless something else happens.
    pub fn deadline(&self) -> Option<Instant> {
        let own = match &self.role {
            Role::Coordinator(coordinator) => coordinator.deadline(),
            Role::Device(device) => device.deadline(),
        };
        let commands = self.common.commands.iter().map(|outbound| outbound.due);
        [own, self.link.deadline()]
            .into_iter()
            .flatten()
            .chain(commands)
            .min()
    }

    /// The next action. Call it until it returns `None` and the deadline is not past, then again at
    /// the [`deadline`](Self::deadline), after each received frame and after each call of another
    /// method.
    pub fn poll(&mut self, now: Instant, buffer: &mut [u8; FRAME_MAX]) -> Option<Action> {
        if let Some(limit) = self.link.session.counter.wanted() {
            return Some(Action::Save(Record::CounterLimit(limit)));
        }
        let Self { link, common, .. } = self;
        match &mut self.role {
            // Without members, no node is a coordinator, and its code is left out.
            Role::Coordinator(coordinator) if MEMBERS > 0 => coordinator.poll(now, link, common),
            Role::Coordinator(_) => {}
            Role::Device(device) => device.poll(now, link, common),
        }
        if self.link.take_keys_changed() {
            self.common.unsaved.mark(FACT_ACTIVE_KEY);
            self.common.unsaved.mark(FACT_NEXT_KEY);
        }
        if let Some(record) = self.unsaved() {
            return Some(Action::Save(record));
        }
        self.link.poll_sleep(now);
        if let Some(config) = self.config()
            && self.configured != Some(config)
        {
            self.configured = Some(config);
            return Some(Action::Configure(config));
        }
        self.transmit(now, buffer).map(Action::Transmit)
    }

    /// Configuration of the radio now; `None` for as it is.
    fn config(&self) -> Option<RadioConfig> {
        match &self.role {
            Role::Coordinator(coordinator) => Some(RadioConfig {
                coordinator: true,
                ..coordinator.radio(&self.common)?
            }),
            Role::Device(device) => Some(RadioConfig {
                sampled: device.is_joined() && self.link.is_asleep(),
                ..device.radio(&self.common)?
            }),
        }
    }

    /// Returns true while this device has nothing to do before it is woken, because its network is quiet: it sleeps, or
    /// listens for the answer to a question of its own.
    pub fn is_quiet(&self) -> bool {
        matches!(&self.role, Role::Device(device) if device.is_joined()) && self.link.is_quiet()
    }

    fn transmit(&mut self, now: Instant, buffer: &mut [u8; FRAME_MAX]) -> Option<usize> {
        if core::mem::take(&mut self.common.beacon_request_due) {
            let header = Header {
                destination: EVERYBODY,
                ..Header::new(FrameType::Command, self.link.next_sequence())
            };
            let len = header.emit(buffer).ok()?;
            let command = MacCommand::BeaconRequest
                .emit(buffer.get_mut(len..)?)
                .ok()?;
            return Some(len + command);
        }
        self.transmit_beacon(now, buffer)
            .or_else(|| match self.link.is_waking() {
                true => None,
                false => self.transmit_command(now, buffer),
            })
            .or_else(|| self.link.poll_transmit(now, buffer))
    }

    fn transmit_beacon(&mut self, now: Instant, buffer: &mut [u8; FRAME_MAX]) -> Option<usize> {
        let invitation = self.role.coordinator_mut()?.take_beacon(now)?;
        let own = Address::Extended(self.common.settings.extended);
        let header = Header {
            source: Panned::new(invitation.pan, own),
            ..Header::new(FrameType::Beacon, self.link.next_sequence())
        };
        let len = header.emit(buffer).ok()?;
        let payload = beacon_payload(invitation.is_full);
        let superframe = Superframe::beaconless(invitation.admits);
        let beacon = Beacon::new(superframe, &payload);
        Some(len + beacon.emit(buffer.get_mut(len..)?).ok()?)
    }

    fn transmit_command(&mut self, now: Instant, buffer: &mut [u8; FRAME_MAX]) -> Option<usize> {
        let outbound = self.common.commands.take(|outbound| outbound.due <= now)?;
        let pan = self.configured?.pan;
        let header = Header {
            destination: Panned::new(pan, outbound.destination),
            source: Panned::compressed(Address::Extended(self.common.settings.extended)),
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
        self.handle_at(now, frame, 0);
    }

    /// The same of a frame that came [so strongly](crate::radio::Received::strength): a device that
    /// has the choice prefers the network that it hears best.
    pub fn handle_at(&mut self, now: Instant, frame: &mut [u8], strength: u8) {
        let Some(config) = self.configured else {
            return;
        };
        // Most frames heard are secured and for another node, which the link sees at once.
        if !is_secured(frame) && self.handle_open(now, frame, config.channel, strength) {
            return;
        }
        let event = self.link.handle(now, frame);
        if event == LinkEvent::Nothing {
            return;
        }
        let Self { link, common, .. } = self;
        match &mut self.role {
            Role::Coordinator(coordinator) if MEMBERS > 0 => {
                coordinator.on_event(now, event, link, common);
            }
            Role::Coordinator(_) => {}
            Role::Device(device) => device.on_event(now, event, link, common),
        }
    }

    /// Beacons, beacon requests and frames that wake, which are not secured. Returns true if it was one, or no frame.
    fn handle_open(&mut self, now: Instant, bytes: &[u8], channel: Channel, strength: u8) -> bool {
        let Ok(frame) = Frame::parse(bytes) else {
            return true;
        };
        if let Some(found) = parse_beacon(&frame, channel, strength) {
            self.on_beacon(now, found);
            return true;
        }
        let header = frame.header();
        if header.frame_type == FrameType::Data && frame.payload().is_empty() {
            self.link.on_wake(now, header);
            return true;
        }
        let is_request = header.frame_type == FrameType::Command
            && header.destination == EVERYBODY
            && MacCommand::parse(frame.payload()) == Ok(MacCommand::BeaconRequest);
        if is_request && let Some(coordinator) = self.role.coordinator_mut() {
            coordinator.on_beacon_request(now, &mut self.common);
        }
        is_request
    }

    fn on_beacon(&mut self, now: Instant, found: Found) {
        match &mut self.role {
            Role::Coordinator(coordinator) if MEMBERS > 0 => {
                coordinator.on_beacon(now, found, &mut self.common);
            }
            Role::Coordinator(_) => {}
            Role::Device(device) => device.on_beacon(found, &mut self.common),
        }
    }
}

impl<const MEMBERS: usize> Role<MEMBERS> {
    /// The coordinator's part. Without members, no node is one, and its code is left out.
    const fn coordinator(&self) -> Option<&Coordinator<MEMBERS>> {
        match self {
            Self::Coordinator(coordinator) if MEMBERS > 0 => Some(coordinator),
            _ => None,
        }
    }

    const fn coordinator_mut(&mut self) -> Option<&mut Coordinator<MEMBERS>> {
        match self {
            Self::Coordinator(coordinator) if MEMBERS > 0 => Some(coordinator),
            _ => None,
        }
    }
}

impl Common {
    // for less stack
    #[inline(always)]
    fn new(settings: NetworkSettings) -> Self {
        Self {
            settings,
            commands: Slots::new(),
            unsaved: DirtySet::new(),
            beacon_request_due: false,
            jitter: Jitter::new(!settings.seed),
        }
    }

    // for less flash
    #[inline(never)]
    fn command(&mut self, due: Instant, destination: Address, command: MacCommand) {
        // When the queue is full the command is lost, and the peer asks again.
        let _ = self.commands.put(Outbound {
            destination,
            command,
            due,
        });
    }

    /// Listening on a channel, to no network in particular.
    const fn nowhere(&self, channel: Channel) -> RadioConfig {
        RadioConfig {
            channel,
            tx_power: self.settings.tx_power,
            pan: PanId::BROADCAST,
            short: ShortAddress::BROADCAST,
            extended: self.settings.extended,
            coordinator: false,
            promiscuous: false,
            sampled: false,
        }
    }

    /// Belonging to a network.
    const fn at(&self, network: &Membership) -> RadioConfig {
        RadioConfig {
            pan: network.pan,
            short: network.short,
            ..self.nowhere(network.channel)
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

#[cfg(test)]
mod tests;
