//! The part of the coordinator.

use core::{fmt, time::Duration};

use super::scan::Scan;
use crate::{
    Instant,
    link::Ticket,
    store::{Member, Membership, Record},
    wire::{Association, AssociationStatus, Eui64, ShortAddress},
};

/// The longest join window.
pub const JOIN_WINDOW_MAX: Duration = Duration::from_secs(600);
/// The PAN identifier changes at most this often: whoever forges beacons makes it change.
pub(super) const CONFLICT_PAUSE: Duration = Duration::from_secs(60);

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
    pub state: State,
    /// A place keeps its number, by which the store knows it.
    pub members: [Option<Member>; MEMBERS],
    /// Places that are to be written down.
    pub unsaved: [bool; MEMBERS],
    /// The address given last. They are given in turn: whoever had one may not have heard yet that
    /// it is no longer a member.
    last: ShortAddress,
    allowed: heapless::Vec<Eui64, MEMBERS>,
    window: Option<Instant>,
    pub rotation: Option<Rotation>,
    pub last_conflict: Option<Instant>,
    pub beacon_due: Option<Instant>,
}

#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "there is no heap to put it on")]
pub(super) enum State {
    Scanning(Scan),
    Running(Membership),
}

/// Handing on the next key, one member after the other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rotation {
    pub change: KeyChange,
    /// The place in the table to serve next.
    pub place: usize,
    pub ticket: Option<Ticket>,
}

/// A change of key, as a coordinator sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct KeyChange {
    /// The index of the new key.
    pub index: u8,
    /// It has been offered to every member, and is in use.
    pub is_done: bool,
    /// Members that did not acknowledge it. They may have it all the same, if only their answers
    /// were lost; else they must be provisioned anew.
    pub unreached: u8,
}

impl<const MEMBERS: usize> Coordinator<MEMBERS> {
    // Inlined like the node it is part of.
    #[inline(always)]
    pub(super) fn new(state: State, members: [Option<Member>; MEMBERS]) -> Self {
        let mut last = ShortAddress::COORDINATOR;
        for member in members.iter().flatten() {
            last = last.max(member.short);
        }
        Self {
            state,
            last,
            members,
            unsaved: [false; MEMBERS],
            allowed: heapless::Vec::new(),
            window: None,
            rotation: None,
            last_conflict: None,
            beacon_due: None,
        }
    }

    pub(super) fn allow(&mut self, device: Eui64) -> Result<(), MembersFull> {
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

    pub(super) fn admits_anybody(&self, now: Instant) -> bool {
        self.window.is_some_and(|until| now < until)
    }

    pub(super) fn is_full(&self) -> bool {
        self.members.iter().all(Option::is_some)
    }

    /// Whether a beacon should invite devices.
    pub(super) fn invites(&self, now: Instant) -> bool {
        self.admits_anybody(now) || !self.allowed.is_empty()
    }

    /// Decides on a device. What changes has to be written down before it is told.
    pub(super) fn admit(&mut self, now: Instant, device: Eui64) -> Association {
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
        if !self.admits_anybody(now) && !self.allowed.contains(&device) {
            return refuse(AssociationStatus::Denied);
        }
        let mut short = after(self.last);
        while known.clone().any(|member| member.short == short) {
            short = after(short);
        }
        let mut places = self.members.iter_mut().zip(&mut self.unsaved);
        let Some((place, unsaved)) = places.find(|(place, _)| place.is_none()) else {
            return refuse(AssociationStatus::AtCapacity);
        };
        *place = Some(Member {
            extended: device,
            short,
        });
        *unsaved = true;
        self.last = short;
        welcome(short)
    }

    /// Strikes a member off. Whether it was one.
    pub(super) fn remove(&mut self, device: Eui64) -> bool {
        let is_it = |member: &Member| member.extended == device;
        let mut places = self.members.iter_mut().zip(&mut self.unsaved);
        match places.find(|(place, _)| place.as_ref().is_some_and(is_it)) {
            Some((place, unsaved)) => {
                *place = None;
                *unsaved = true;
                true
            }
            None => false,
        }
    }

    /// The next place to write down.
    pub(super) fn unsaved(&self) -> Option<Record> {
        let place = self.unsaved.iter().position(|&unsaved| unsaved)?;
        let number = u8::try_from(place).ok()?;
        Some(Record::Member(number, *self.members.get(place)?))
    }

    /// A place has been written down as it is.
    pub(super) fn saved(&mut self, number: u8) {
        if let Some(unsaved) = self.unsaved.get_mut(usize::from(number)) {
            *unsaved = false;
        }
    }
}

/// The next address. A table never has as many members as there are addresses.
const fn after(ShortAddress(last): ShortAddress) -> ShortAddress {
    if last + 1 < ShortAddress::UNASSIGNED.0 {
        ShortAddress(last + 1)
    } else {
        ShortAddress(1)
    }
}
