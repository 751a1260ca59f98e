//! The node that runs a network and admits the others.

use core::{fmt, time::Duration};

use super::{
    Common, FACT_FORMER_KEY, FACT_NETWORK, FACT_NEXT_KEY, NetworkStatus, Outbound,
    scan::{Found, Scan, Step},
};
use crate::{
    Instant,
    link::{Delivery, Link, LinkEvent, SendError, Ticket},
    log::debug,
    radio::{Channel, RadioConfig},
    security::{Key, RotationError},
    store::{MEMBERS_MAX, Member, Membership, Record},
    wire::{Address, Association, AssociationStatus, Eui64, MacCommand, PanId, ShortAddress},
};
use flash_log::DirtySet;

/// The longest join window.
pub const JOIN_WINDOW_MAX: Duration = Duration::from_secs(600);
/// Announcements of a new PAN identifier, and the time between them.
const REALIGNMENTS: u32 = 3;
const REALIGNMENT_PAUSE: Duration = Duration::from_millis(100);
/// Other coordinators answer a beacon request at the same time: the longest wait before that.
const BEACON_WAIT: Duration = Duration::from_millis(30);

/// The table of members or of expected devices is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MembersFull;

impl fmt::Display for MembersFull {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the table is full: remove a member or build for more")
    }
}

impl core::error::Error for MembersFull {}

#[derive(Debug)]
pub(super) struct Coordinator<const MEMBERS: usize> {
    state: State,
    /// A place keeps its number, by which the store knows it.
    members: [Option<Member>; MEMBERS],
    /// Places that are to be written down.
    unsaved: DirtySet<{ MEMBERS_MAX.div_ceil(32) }>,
    /// The address given last. Addresses are given in turn: the former owner of one may not have heard yet that it
    /// is no longer a member.
    last: ShortAddress,
    /// Numbers of devices.
    allowed: heapless::Vec<u16, MEMBERS>,
    window: Option<Instant>,
    rotation: Option<Rotation>,
    /// The key in use, on its way to a member that missed the change.
    handing_over: Option<(Ticket, Eui64)>,
    /// A member was sent away since the last change of key: the former key is of no more use.
    shuts_out: bool,
    /// Time when a beacon of another network with the same identifier was last heard.
    last_conflict: Option<Instant>,
    /// The identifier to change to once it is announced.
    realignment: Option<PanId>,
    beacon_due: Option<Instant>,
}

#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "there is no heap to put it on")]
enum State {
    Scanning(Scan),
    Running(Membership),
}

/// Handing on the next key, one member after the other.
#[derive(Clone, Copy, Debug)]
struct Rotation {
    change: KeyChange,
    /// The place in the table to serve next.
    place: usize,
    ticket: Option<Ticket>,
    /// The member that the ticket is for.
    asked: Option<Eui64>,
}

/// A change of key, as a coordinator sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct KeyChange {
    /// The index of the new key.
    pub index: u8,
    /// Its [check value](Key::check_value).
    pub check: [u8; 3],
    /// It has been offered to every member, and is in use.
    pub is_done: bool,
    /// Members that have not acknowledged it yet. They may have it all the same, if only their answers
    /// were lost; else they get it when they are heard again.
    pub unreached: u8,
}

impl<const MEMBERS: usize> Coordinator<MEMBERS> {
    /// A coordinator of this network, or, without one, about to look for a free place for its own.
    // for less stack
    #[inline(always)]
    pub(super) fn new(
        network: Option<Membership>,
        members: [Option<Member>; MEMBERS],
        common: &Common,
    ) -> Self {
        let mut last = ShortAddress::COORDINATOR;
        for member in members.iter().flatten() {
            last = last.max(member.short);
        }
        Self {
            state: match network {
                Some(network) => State::Running(network),
                None => State::Scanning(Scan::new(common.settings.channels)),
            },
            last,
            members,
            unsaved: DirtySet::new(),
            allowed: heapless::Vec::new(),
            window: None,
            rotation: None,
            handing_over: None,
            shuts_out: false,
            last_conflict: None,
            realignment: None,
            beacon_due: None,
        }
    }

    pub(super) const fn status(&self) -> NetworkStatus {
        match self.state {
            State::Scanning(_) => NetworkStatus::Searching(None),
            State::Running(network) => NetworkStatus::Joined(network),
        }
    }

    /// The network to remember.
    pub(super) const fn network(&self) -> Option<Membership> {
        match self.state {
            State::Scanning(_) => None,
            State::Running(network) => Some(network),
        }
    }

    pub(super) fn members(&self) -> impl Iterator<Item = Member> {
        self.members.iter().copied().flatten()
    }

    /// Time to [`poll`](Self::poll) or to send a beacon.
    pub(super) fn deadline(&self) -> Option<Instant> {
        match &self.state {
            State::Scanning(scan) => Some(scan.until()),
            State::Running(_) => self.beacon_due,
        }
    }

    /// Configuration of the radio now; `None` for as it is.
    pub(super) fn radio(&self, common: &Common) -> Option<RadioConfig> {
        Some(match &self.state {
            State::Scanning(scan) => common.nowhere(scan.channel()?),
            State::Running(network) => common.at(network),
        })
    }

    pub(super) fn poll<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        now: Instant,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        match &mut self.state {
            State::Scanning(scan) => match scan.step(now) {
                Step::Request => common.beacon_request_due = true,
                Step::Listen => {}
                Step::Done => {
                    let pan = scan.free_pan(|| common.jitter.next() as u16);
                    if let Some(channel) = scan.quietest() {
                        let network = Membership {
                            pan,
                            channel,
                            short: ShortAddress::COORDINATOR,
                            coordinator: common.settings.extended,
                        };
                        self.start(network, link, common);
                    }
                }
            },
            State::Running(network) => {
                let network = *network;
                self.rotate(now, link, common);
                self.hand_over(now, link, common);
                self.realign(network, link, common);
            }
        }
    }

    /// Runs, or goes on, as this.
    fn start<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        network: Membership,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        self.state = State::Running(network);
        debug!("runs {} on channel {}", network.pan, network.channel);
        link.attach(network.pan, network.short);
        common.unsaved.mark(FACT_NETWORK);
    }

    /// Hands a new key on to all members from now on, in place of another that was under way.
    pub(super) fn change_key<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        next: Key,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) -> Result<(), RotationError> {
        link.session.keys.install(next)?;
        if let Some(ticket) = self.rotation.and_then(|former| former.ticket) {
            link.withdraw(ticket);
        }
        self.rotation = Some(Rotation {
            change: KeyChange {
                index: next.index(),
                check: next.check_value(),
                is_done: false,
                unreached: 0,
            },
            place: 0,
            ticket: None,
            asked: None,
        });
        // Members that missed the change before have a key that will be unknown.
        link.session.abandon_late();
        if let Some((ticket, _)) = self.handing_over.take() {
            link.withdraw(ticket);
        }
        common.unsaved.mark(FACT_NEXT_KEY);
        Ok(())
    }

    pub(super) fn key_change(&self) -> Option<KeyChange> {
        Some(self.rotation?.change)
    }

    /// Hands the next key on to the next member, and uses it after the last.
    fn rotate<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        now: Instant,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        let Some(rotation) = self.rotation.as_mut() else {
            return;
        };
        if rotation.change.is_done {
            return;
        }
        if let Some(ticket) = rotation.ticket {
            let Some(delivery) = link.result_of(ticket) else {
                return;
            };
            let is_delivered = delivery == Delivery::Delivered;
            rotation.change.unreached += u8::from(!is_delivered);
            rotation.ticket = None;
            if let Some(extended) = rotation.asked.take()
                && !is_delivered
            {
                link.session.await_late(extended);
            }
        }
        let next = link.session.keys.next();
        let mut members = self.members.iter().enumerate().skip(rotation.place);
        let member = members.find_map(|(place, member)| Some((place, (*member)?)));
        if let (Some((place, member)), Some(next)) = (member, next) {
            let sent = link.send_next_key(now, member.short, &next);
            if sent != Err(SendError::QueueFull) {
                rotation.place = place + 1;
                rotation.ticket = sent.ok();
                rotation.asked = Some(member.extended);
                rotation.change.unreached += u8::from(sent.is_err());
                if sent.is_err() {
                    link.session.await_late(member.extended);
                }
            }
        } else {
            rotation.change.is_done = true;
            // Not installed: the owner of the node installed or used another meanwhile.
            let _ = link.activate_key(rotation.change.index, now);
            if core::mem::take(&mut self.shuts_out) {
                link.session.abandon_late();
            }
            common.unsaved.mark(FACT_FORMER_KEY);
        }
    }

    /// Gives the key in use to a member that spoke under the former one.
    fn hand_over<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        now: Instant,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        if let Some((ticket, extended)) = self.handing_over
            && let Some(delivery) = link.result_of(ticket)
        {
            self.handing_over = None;
            if delivery == Delivery::Delivered {
                link.session.caught_up(extended);
            }
        }
        if self
            .rotation
            .is_some_and(|rotation| !rotation.change.is_done)
        {
            return;
        }
        if link.session.late() == 0 && link.session.keys.expire(now) {
            common.unsaved.mark(FACT_FORMER_KEY);
        }
        if self.handing_over.is_some() {
            return;
        }
        let Some(extended) = link.session.take_late_heard() else {
            return;
        };
        let member = self.members().find(|member| member.extended == extended);
        // It may not have come so far that it can be spoken to.
        let short = member.map(|member| member.short);
        if let Some(short) = short.filter(|&short| link.session.peers.by_short(short).is_some()) {
            let key = link.session.keys.active();
            let sent = link.send_next_key(now, short, &key);
            self.handing_over = sent.ok().map(|ticket| (ticket, extended));
        }
    }

    /// Changes the PAN identifier once every announcement has been sent.
    fn realign<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        network: Membership,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        let announcement = |outbound: &Outbound| {
            matches!(outbound.command, MacCommand::CoordinatorRealignment { .. })
        };
        if common.commands.iter().any(announcement) {
            return;
        }
        if let Some(pan) = self.realignment.take() {
            self.start(Membership { pan, ..network }, link, common);
        }
    }

    /// Time when another network with the same identifier was last heard.
    pub(super) const fn last_conflict(&self) -> Option<Instant> {
        self.last_conflict
    }

    /// Takes another identifier, and announces it. Returns true if the network runs, and no other change is under
    /// way.
    pub(super) fn change_pan(&mut self, now: Instant, common: &mut Common) -> bool {
        let State::Running(network) = self.state else {
            return false;
        };
        if self.realignment.is_some() {
            return false;
        }
        let pan = loop {
            let drawn = PanId(common.jitter.next() as u16);
            if drawn.0 < ShortAddress::UNASSIGNED.0 && drawn != network.pan {
                break drawn;
            }
        };
        self.realignment = Some(pan);
        for announcement in 0..REALIGNMENTS {
            let command = realignment(pan, network.channel, ShortAddress::BROADCAST);
            let everybody = Address::Short(ShortAddress::BROADCAST);
            common.command(now + REALIGNMENT_PAUSE * announcement, everybody, command);
        }
        true
    }

    /// A device looks for networks.
    pub(super) fn on_beacon_request(&mut self, now: Instant, common: &mut Common) {
        let due = now + common.jitter.up_to(BEACON_WAIT);
        self.beacon_due.get_or_insert(due);
    }

    /// Returns the content of a beacon if one is to be sent now.
    pub(super) fn take_beacon(&mut self, now: Instant) -> Option<Invitation> {
        let State::Running(network) = self.state else {
            return None;
        };
        self.beacon_due.take_if(|due| *due <= now)?;
        Some(Invitation {
            pan: network.pan,
            is_full: self.is_full(),
            admits: self.invites(now),
        })
    }

    pub(super) fn on_beacon(&mut self, now: Instant, found: Found, common: &mut Common) {
        match &mut self.state {
            State::Scanning(scan) => scan.on_beacon(found, &mut common.jitter),
            // Anybody can send a beacon, so nothing is done about it but to say so.
            State::Running(network) if found.pan == network.pan => self.last_conflict = Some(now),
            State::Running(_) => {}
        }
    }

    pub(super) fn on_event<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        now: Instant,
        event: LinkEvent,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        let (from, command) = match event {
            LinkEvent::Command { from, command } => (from, command),
            LinkEvent::Fresh { peer, short } => {
                return self.on_presented(now, peer, short, link, common);
            }
            LinkEvent::Nothing => return,
        };
        match command {
            MacCommand::AssociationRequest(_) => self.on_request(now, from, link, common),
            MacCommand::Disassociation { .. } => {
                let was_member = self.strike_off(from);
                if was_member {
                    link.session.peers.forget(from);
                }
            }
            MacCommand::Orphan => self.on_orphan(now, from, common),
            _ => {}
        }
    }

    /// A device is there, and says which address it has. If no member has that, it missed that it was sent away.
    fn on_presented<const PEERS: usize, const QUEUE: usize>(
        &self,
        now: Instant,
        device: Eui64,
        short: ShortAddress,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        let member = Member {
            extended: device,
            short,
        };
        if short.is_unicast() && !self.members().any(|other| other == member) {
            dismiss(now, device, link, common);
        }
    }

    /// Tells a member where it belongs.
    fn on_orphan(&self, now: Instant, device: Eui64, common: &mut Common) {
        let member = self.members().find(|member| member.extended == device);
        if let (Some(member), State::Running(network)) = (member, &self.state) {
            let command = realignment(network.pan, network.channel, member.short);
            common.command(now, Address::Extended(device), command);
        }
    }

    /// A device wants to join.
    fn on_request<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        now: Instant,
        device: Eui64,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        let is_former = |member: &Member| {
            member.extended != device && member.extended.number() == device.number()
        };
        let former = self.members().find(is_former);
        let former = former.map(|member| member.extended);
        let association = self.admit(now, device);
        if association.status == AssociationStatus::Successful {
            if let Some(former) = former {
                link.session.peers.forget(former);
            }
            link.session.peers.rename(device, association.short);
            // A change of the key that has passed its place offers it none any more.
            if self
                .rotation
                .is_some_and(|rotation| !rotation.change.is_done)
            {
                link.session.await_late(device);
            }
        }
        // Before the answer goes out, it is written down.
        let command = MacCommand::AssociationResponse(association);
        common.command(now, Address::Extended(device), command);
    }

    /// Sends a member away. Returns true if it was one.
    pub(super) fn remove<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        now: Instant,
        device: Eui64,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) -> bool {
        let is_removed = self.strike_off(device);
        if is_removed {
            self.shuts_out = true;
            link.session.abandon_late();
            common.unsaved.mark(FACT_FORMER_KEY);
            dismiss(now, device, link, common);
        }
        is_removed
    }

    pub(super) fn allow(&mut self, device: u16) -> Result<(), MembersFull> {
        if self.allowed.contains(&device) {
            return Ok(());
        }
        self.allowed.push(device).map_err(|_| MembersFull)
    }

    pub(super) fn open_window(&mut self, now: Instant, duration: Duration) {
        self.window = Some(now + duration.min(JOIN_WINDOW_MAX));
    }

    pub(super) const fn close_window(&mut self) {
        self.window = None;
    }

    fn admits_anybody(&self, now: Instant) -> bool {
        self.window.is_some_and(|until| now < until)
    }

    fn is_full(&self) -> bool {
        self.members.iter().all(Option::is_some)
    }

    /// Returns true if a beacon should invite devices.
    fn invites(&self, now: Instant) -> bool {
        self.admits_anybody(now) || !self.allowed.is_empty()
    }

    /// Decides on a device. A change has to be written down before it is told.
    fn admit(&mut self, now: Instant, device: Eui64) -> Association {
        let refuse = |status| Association {
            short: ShortAddress::BROADCAST,
            status,
        };
        let welcome = |short| Association {
            short,
            status: AssociationStatus::Successful,
        };
        let known = self.members.iter().flatten();
        if let Some(member) = known.clone().find(|member| member.extended == device) {
            return welcome(member.short);
        }
        // Erased, it has forgotten its address, but not its number.
        let mut places = self.members.iter_mut().enumerate();
        let same = places.find_map(|(number, place)| {
            Some((number, place.as_mut()?))
                .filter(|(_, member)| member.extended.number() == device.number())
        });
        if let Some((number, member)) = same {
            member.extended = device;
            self.unsaved.mark(number);
            return welcome(member.short);
        }
        let known = self.members.iter().flatten();
        if !self.admits_anybody(now) && !self.allowed.contains(&device.number()) {
            return refuse(AssociationStatus::Denied);
        }
        let mut short = after(self.last);
        while known.clone().any(|member| member.short == short) {
            short = after(short);
        }
        let mut places = self.members.iter_mut().enumerate();
        let Some((number, place)) = places.find(|(_, place)| place.is_none()) else {
            return refuse(AssociationStatus::AtCapacity);
        };
        *place = Some(Member {
            extended: device,
            short,
        });
        self.unsaved.mark(number);
        self.last = short;
        welcome(short)
    }

    /// Takes a member out of the table. Returns true if it was one.
    fn strike_off(&mut self, device: Eui64) -> bool {
        let is_it = |member: &Member| member.extended == device;
        let mut places = self.members.iter_mut().enumerate();
        match places.find(|(_, place)| place.as_ref().is_some_and(is_it)) {
            Some((number, place)) => {
                *place = None;
                self.unsaved.mark(number);
                true
            }
            None => false,
        }
    }

    /// The next place to write down.
    pub(super) fn unsaved(&self) -> Option<Record> {
        let place = self.unsaved.first()?;
        let number = u8::try_from(place).ok()?;
        Some(Record::Member(number, *self.members.get(place)?))
    }

    /// A place has been written down as it is.
    pub(super) fn saved(&mut self, number: u8) {
        self.unsaved.clear(number.into());
    }
}

/// Content of a beacon.
pub(super) struct Invitation {
    pub pan: PanId,
    pub is_full: bool,
    pub admits: bool,
}

/// Place of the network, present or future, for one member or, without address, for all.
const fn realignment(pan: PanId, channel: Channel, short: ShortAddress) -> MacCommand {
    MacCommand::CoordinatorRealignment {
        pan,
        coordinator: ShortAddress::COORDINATOR,
        channel: channel.number(),
        short,
        page: None,
    }
}

/// Sends a device away. That is not acknowledged, so the device is a stranger from now on: when it is next heard
/// it has to present itself, and is told again.
fn dismiss<const PEERS: usize, const QUEUE: usize>(
    now: Instant,
    device: Eui64,
    link: &mut Link<PEERS, QUEUE>,
    common: &mut Common,
) {
    let command = MacCommand::Disassociation { reason: 1 };
    common.command(now, Address::Extended(device), command);
    link.session.peers.forget(device);
}

/// The next address. A table never has as many members as there are addresses.
const fn after(ShortAddress(last): ShortAddress) -> ShortAddress {
    if last + 1 < ShortAddress::UNASSIGNED.0 {
        ShortAddress(last + 1)
    } else {
        ShortAddress(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        network::{Channels, NetworkSettings},
        security::{Counter, FrameSecurity, Protection},
    };

    const NOW: Instant = Instant(1000);
    const NETWORK: Membership = Membership {
        pan: PanId(0xBEEF),
        channel: Channel::FIRST,
        short: ShortAddress::COORDINATOR,
        coordinator: Eui64([9; 8]),
    };

    fn key(index: u8) -> Key {
        Key::new(index, core::array::from_fn(|i| index + i as u8)).unwrap()
    }

    /// A coordinator that runs, with members that have these addresses.
    fn running(shorts: [Option<u16>; 3]) -> (Coordinator<3>, Link<4, 2>, Common) {
        let common = Common::new(NetworkSettings {
            extended: NETWORK.coordinator,
            channels: Channels::ALL,
            tx_power: 0,
            protection: Protection::EncMic64,
            seed: 1,
            sleeps: false,
        });
        let counter = Counter::resume(0);
        let extended = NETWORK.coordinator;
        let session = FrameSecurity::new(extended, Protection::EncMic64, key(1), counter);
        let mut link = Link::new(session, 1);
        link.attach(NETWORK.pan, NETWORK.short);
        let members = shorts.map(|short| {
            let short = short?;
            Some(Member {
                extended: Eui64([short as u8; 8]),
                short: ShortAddress(short),
            })
        });
        (
            Coordinator::new(Some(NETWORK), members, &common),
            link,
            common,
        )
    }

    #[test]
    fn an_address_is_one_members_only() {
        // After the last address comes the first, which a member has.
        let (mut coordinator, ..) = running([Some(1), Some(0xFFFD), None]);
        coordinator.open_window(NOW, Duration::from_secs(1));
        let association = coordinator.admit(NOW, Eui64([7; 8]));
        assert_eq!(association.status, AssociationStatus::Successful);
        assert_eq!(association.short, ShortAddress(2));
    }

    #[test]
    fn a_key_waits_for_room_in_the_queue() {
        let (mut coordinator, mut link, mut common) = running([Some(1), None, None]);
        let mut send = || link.send(NOW, ShortAddress(1), &1_u8).unwrap();
        let tickets = [send(), send()];
        let changed = coordinator.change_key(key(2), &mut link, &mut common);
        assert_eq!(changed, Ok(()));
        coordinator.poll(NOW, &mut link, &mut common);
        let rotation = coordinator.rotation.unwrap();
        assert_eq!((rotation.place, rotation.ticket), (0, None));
        assert_eq!(rotation.change.unreached, 0);
        link.withdraw(tickets[0]);
        coordinator.poll(NOW, &mut link, &mut common);
        let rotation = coordinator.rotation.unwrap();
        assert!(rotation.place == 1 && rotation.ticket.is_some());
    }

    /// One that has forgotten the next key, and is not offered it again: it gets it once it is heard under the former one.
    #[test]
    fn a_member_that_joins_behind_a_change_of_key_is_waited_for() {
        let (mut coordinator, mut link, mut common) = running([Some(1), Some(2), None]);
        coordinator.open_window(NOW, Duration::from_secs(60));
        let changed = coordinator.change_key(key(2), &mut link, &mut common);
        assert_eq!(changed, Ok(()));
        let mut late = |coordinator: &mut Coordinator<3>, device: u8| {
            coordinator.on_request(NOW, Eui64([device; 8]), &mut link, &mut common);
            coordinator.poll(NOW, &mut link, &mut common);
            link.session.late()
        };
        assert_eq!(late(&mut coordinator, 1), 1);
        assert_eq!(coordinator.rotation.unwrap().place, 1);
        // Again, and another one.
        assert_eq!(late(&mut coordinator, 1), 1);
        assert_eq!(late(&mut coordinator, 7), 2);
    }

    #[test]
    fn a_change_of_key_that_is_done_hands_nothing_on() {
        let (mut coordinator, mut link, mut common) = running([None; 3]);
        let changed = coordinator.change_key(key(2), &mut link, &mut common);
        assert_eq!(changed, Ok(()));
        coordinator.poll(NOW, &mut link, &mut common);
        assert!(coordinator.key_change().unwrap().is_done);
        assert_eq!(link.session.keys.active(), key(2));
        // A device joins, and the owner of the node begins another change without the coordinator.
        coordinator.open_window(NOW, Duration::from_secs(1));
        coordinator.admit(NOW, Eui64([7; 8]));
        link.session.keys.install(key(3)).unwrap();
        coordinator.poll(NOW, &mut link, &mut common);
        assert_eq!(coordinator.rotation.unwrap().ticket, None);
        assert_eq!(link.session.keys.next(), Some(key(3)));
    }

    /// Others that answer the same request need not send in the same moment.
    #[test]
    fn a_beacon_waits_until_it_is_due() {
        let (mut coordinator, _, mut common) = running([None; 3]);
        coordinator.on_beacon_request(NOW, &mut common);
        let due = coordinator.deadline().unwrap();
        assert!(NOW < due && due <= NOW + BEACON_WAIT);
        assert!(coordinator.take_beacon(Instant(due.0 - 1)).is_none());
        assert!(coordinator.take_beacon(due).is_some());
        assert!(coordinator.take_beacon(due).is_none());
    }
}
