//! The part of every other node.

use core::time::Duration;

use super::scan::{Channels, Found, Scan};
use crate::{Instant, jitter::Jitter, store::Membership, wire::AssociationStatus};

/// Wait for an answer of the coordinator while joining.
pub(super) const JOIN_WAIT: Duration = Duration::from_millis(300);
/// Attempts of each step of joining.
pub(super) const JOIN_ATTEMPTS: u8 = 8;
/// A coordinator that was silent for so long is asked whether it is there.
pub const KEEP_ALIVE: Duration = Duration::from_secs(30);
/// Wait for that answer.
pub(super) const ALIVE_WAIT: Duration = Duration::from_secs(1);
/// Questions without answer until the coordinator counts as lost: with half of all frames lost each
/// way, once in 30 times wrongly.
pub(super) const ALIVE_ATTEMPTS: u8 = 12;
/// Mean pause after the first unsuccessful scan; doubled after each.
const PAUSE_FIRST: Duration = Duration::from_secs(1);
/// Longest mean pause.
const PAUSE_MAX: Duration = Duration::from_secs(8);

#[derive(Debug)]
pub(super) struct Device {
    pub state: State,
    /// The scan going on, or the last one, whose results are tried one after the other.
    pub scan: Scan,
    /// The network it belongs to, or last belonged to.
    pub home: Option<Membership>,
    pub pauses: u8,
    /// The last refusal.
    pub refusal: Option<AssociationStatus>,
}

#[derive(Debug)]
pub(super) enum State {
    /// Wants no network.
    Out,
    Pausing(Instant),
    Scanning,
    Joining {
        candidate: Found,
        /// Its place among the results of the scan.
        place: usize,
        /// The coordinator has proven itself, so the request can go out.
        is_fresh: bool,
        attempts: u8,
        due: Instant,
    },
    Joined {
        membership: Membership,
        unanswered: u8,
        check: Instant,
    },
}

impl Device {
    pub(super) const fn new(state: State, channels: Channels, home: Option<Membership>) -> Self {
        Self {
            state,
            scan: Scan::new(channels),
            home,
            pauses: 0,
            refusal: None,
        }
    }

    /// Looks for networks anew.
    pub(super) fn scan(&mut self, channels: Channels) {
        self.scan = Scan::new(channels);
        self.state = State::Scanning;
    }

    pub(super) fn pause(&mut self, now: Instant, jitter: &mut Jitter) {
        let pause = jitter.backoff(PAUSE_FIRST, PAUSE_MAX, self.pauses);
        self.pauses = self.pauses.saturating_add(1);
        self.state = State::Pausing(now + pause);
    }

    /// The next PAN to try after the first `tried` of the scan's: first the former home.
    pub(super) fn candidate(&self, tried: usize) -> Option<Found> {
        let home = self.home.map(|home| home.coordinator);
        let is_home = |found: &&Found| home.is_some() && found.coordinator == home;
        let found = self.scan.found().iter();
        let homes = found.clone().filter(is_home);
        let others = found.filter(|found| !is_home(found) && found.is_open);
        let mut all = homes
            .chain(others)
            .filter(|found| found.coordinator.is_some());
        all.nth(tried).copied()
    }
}
