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
    pub(super) const fn new(state: State, members: [Option<Member>; MEMBERS]) -> Self {
        Self {
            state,
            members,
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

    /// Decides on a device, and what to write down first.
    pub(super) fn admit(&mut self, now: Instant, device: Eui64) -> (Association, Option<Record>) {
        let refuse = |status| {
            let association = Association {
                short: ShortAddress::BROADCAST,
                status,
            };
            (association, None)
        };
        let welcome = |short| Association {
            short,
            status: AssociationStatus::Successful,
        };
        let known = self.members.iter().flatten();
        if let Some(member) = known.clone().find(|member| member.extended == device) {
            return (welcome(member.short), None);
        }
        if !self.admits_anybody(now) && !self.allowed.contains(&device) {
            return refuse(AssociationStatus::Denied);
        }
        let used = |short| known.clone().any(|member| member.short == short);
        let short = (1..ShortAddress::UNASSIGNED.0)
            .map(ShortAddress)
            .find(|&short| !used(short));
        let place = self.members.iter().position(Option::is_none);
        let number = place.and_then(|place| u8::try_from(place).ok());
        match (
            short,
            number,
            place.and_then(|place| self.members.get_mut(place)),
        ) {
            (Some(short), Some(number), Some(place)) => {
                let member = Member {
                    extended: device,
                    short,
                };
                *place = Some(member);
                (welcome(short), Some(Record::Member(number, Some(member))))
            }
            _ => refuse(AssociationStatus::AtCapacity),
        }
    }

    /// Strikes a member off, and what to write down then.
    pub(super) fn remove(&mut self, device: Eui64) -> Option<Record> {
        let is_it = |member: &Option<Member>| member.is_some_and(|it| it.extended == device);
        let place = self.members.iter().position(is_it)?;
        *self.members.get_mut(place)? = None;
        Some(Record::Member(u8::try_from(place).ok()?, None))
    }
}
