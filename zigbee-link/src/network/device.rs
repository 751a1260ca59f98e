//! The part of every other node.

use core::time::Duration;

use super::scan::{Found, Scan};
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
const PAUSE_MAX: Duration = Duration::from_secs(30);

#[derive(Debug)]
pub(super) struct Device {
    pub state: State,
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
    Scanning(Scan),
    Joining {
        candidate: Found,
        /// The scan, whose other results come next.
        scan: Scan,
        /// The place of the candidate among these.
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
    pub(super) const fn new(state: State, home: Option<Membership>) -> Self {
        Self {
            state,
            home,
            pauses: 0,
            refusal: None,
        }
    }

    pub(super) fn pause(&mut self, now: Instant, jitter: &mut Jitter) {
        let mean = (PAUSE_FIRST * (1 << self.pauses.min(6))).min(PAUSE_MAX);
        self.pauses = self.pauses.saturating_add(1);
        self.state = State::Pausing(now + jitter.around(mean));
    }

    /// The next PAN to try after the first `tried` of the scan's: first the former home.
    pub(super) fn candidate(&self, scan: &Scan, tried: usize) -> Option<Found> {
        let home = self.home.map(|home| home.coordinator);
        let is_home = |found: &&Found| home.is_some() && found.coordinator == home;
        let found = scan.found().iter();
        let homes = found.clone().filter(is_home);
        let others = found.filter(|found| !is_home(found) && found.is_open);
        let mut all = homes
            .chain(others)
            .filter(|found| found.coordinator.is_some());
        all.nth(tried).copied()
    }
}
