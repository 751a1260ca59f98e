//! Every other node: it looks for its network, joins it and notices when it is gone.

use core::time::Duration;

use super::{
    Common, FACT_NETWORK, NetworkStatus,
    scan::{Found, Scan, Step},
};
use crate::{
    Instant,
    link::{Link, LinkEvent},
    log::debug,
    radio::{Channel, RadioConfig},
    store::Membership,
    wire::{
        Address, Association, AssociationStatus, DeviceCapabilities, Eui64, MacCommand,
        ShortAddress,
    },
};

/// Wait for an answer of the coordinator while joining.
const JOIN_WAIT: Duration = Duration::from_millis(300);
/// Attempts of each step of joining.
const JOIN_ATTEMPTS: u8 = 8;
/// Attempts to make a coordinator prove itself that is one of more than [`FEW`]: most of so many are
/// forged.
const CROWD_ATTEMPTS: u8 = 3;
const FEW: usize = 4;
/// A coordinator that was silent for so long is asked whether it is there.
pub const KEEP_ALIVE: Duration = Duration::from_secs(30);
/// Wait for that answer.
const ALIVE_WAIT: Duration = Duration::from_secs(1);
/// Questions without answer until the coordinator counts as lost: with half of all frames lost each
/// way, once in 30 times wrongly.
const ALIVE_ATTEMPTS: u8 = 12;
/// Mean pause after the first unsuccessful scan; doubled after each.
const PAUSE_FIRST: Duration = Duration::from_secs(1);
/// Longest mean pause.
const PAUSE_MAX: Duration = Duration::from_secs(8);

#[derive(Debug)]
pub(super) struct Device {
    state: State,
    /// The scan going on, or the last one, whose results are tried one after the other.
    scan: Scan,
    /// The network it belongs to, or last belonged to.
    home: Option<Membership>,
    /// It looks whether another network is heard better than its home.
    is_roaming: bool,
    pauses: u8,
    /// The last refusal.
    refusal: Option<AssociationStatus>,
}

#[derive(Debug)]
enum State {
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
    /// A member of this network, or, without one, about to look for one.
    pub(super) const fn new(now: Instant, network: Option<Membership>, common: &Common) -> Self {
        let state = match network {
            Some(membership) => State::Joined {
                membership,
                unanswered: 0,
                check: now,
            },
            None => State::Scanning,
        };
        Self {
            state,
            scan: Scan::new(common.settings.channels),
            home: network,
            is_roaming: false,
            pauses: 0,
            refusal: None,
        }
    }

    pub(super) const fn status(&self) -> NetworkStatus {
        match self.state {
            State::Out => NetworkStatus::Out,
            State::Joined { membership, .. } => NetworkStatus::Joined(membership),
            State::Pausing(_) | State::Scanning | State::Joining { .. } => {
                NetworkStatus::Searching(self.refusal)
            }
        }
    }

    /// The network to remember.
    pub(super) const fn network(&self) -> Option<Membership> {
        self.home
    }

    pub(super) const fn is_joined(&self) -> bool {
        matches!(self.state, State::Joined { .. })
    }

    /// Time to [`poll`](Self::poll).
    pub(super) fn deadline(&self) -> Option<Instant> {
        match self.state {
            State::Out => None,
            State::Pausing(until) => Some(until),
            State::Scanning => Some(self.scan.until()),
            State::Joining { due, .. } => Some(due),
            State::Joined { check, .. } => Some(check),
        }
    }

    /// Configuration of the radio now; `None` for as it is.
    pub(super) fn radio(&self, common: &Common) -> Option<RadioConfig> {
        match &self.state {
            State::Out | State::Pausing(_) => None,
            State::Scanning => Some(common.nowhere(self.scan.channel()?)),
            State::Joining { candidate, .. } => Some(RadioConfig {
                pan: candidate.pan,
                ..common.nowhere(candidate.channel)
            }),
            State::Joined { membership, .. } => Some(common.at(membership)),
        }
    }

    pub(super) fn poll<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        now: Instant,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        match &mut self.state {
            State::Out => {}
            State::Pausing(until) => {
                if *until <= now {
                    self.scan(common);
                }
            }
            State::Scanning => match self.scan.step(now) {
                Step::Request => common.beacon_request_due = true,
                Step::Listen => {}
                Step::Done => {
                    self.scan.sort();
                    self.try_candidate(now, 0, link, common);
                }
            },
            State::Joining {
                candidate,
                place,
                is_fresh,
                attempts,
                due,
            } if *due <= now => {
                let is_crowd = !*is_fresh && self.scan.found().len() > FEW;
                let most = if is_crowd {
                    CROWD_ATTEMPTS
                } else {
                    JOIN_ATTEMPTS
                };
                let Some(coordinator) = candidate.coordinator.filter(|_| *attempts < most) else {
                    let next = *place + 1;
                    return self.try_candidate(now, next, link, common);
                };
                *attempts += 1;
                *due = now + common.jitter.around(JOIN_WAIT);
                let to = Address::Extended(coordinator);
                if *is_fresh {
                    let request = MacCommand::AssociationRequest(DeviceCapabilities::LISTENING);
                    common.command(now, to, request);
                } else {
                    link.ask(now, to, *attempts > JOIN_ATTEMPTS / 2);
                }
            }
            State::Joined {
                membership,
                unanswered,
                check,
            } if *check <= now => {
                let coordinator = membership.coordinator;
                let peer = link.session.peers.by_extended(coordinator);
                match peer.filter(|peer| now < peer.heard + KEEP_ALIVE) {
                    Some(peer) => {
                        *unanswered = 0;
                        *check = peer.heard + KEEP_ALIVE;
                    }
                    None if *unanswered < ALIVE_ATTEMPTS => {
                        *unanswered += 1;
                        *check = now + common.jitter.around(ALIVE_WAIT);
                        let under_next = *unanswered > ALIVE_ATTEMPTS / 2;
                        link.ask(now, Address::Extended(coordinator), under_next);
                    }
                    None => {
                        debug!("lost {}", membership.pan);
                        self.scan(common);
                        link.detach();
                    }
                }
            }
            State::Joining { .. } | State::Joined { .. } => {}
        }
    }

    /// Looks for networks anew.
    fn scan(&mut self, common: &Common) {
        self.scan = Scan::new(common.settings.channels);
        self.state = State::Scanning;
    }

    /// Looks for a network that is heard better than its own. Returns true if it belongs to one.
    pub(super) fn roam<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        link: &mut Link<PEERS, QUEUE>,
        common: &Common,
    ) -> bool {
        let State::Joined { .. } = self.state else {
            return false;
        };
        self.is_roaming = true;
        self.scan(common);
        link.detach();
        true
    }

    /// Waits before it looks for networks again.
    fn pause(&mut self, now: Instant, common: &mut Common) {
        let pause = common.jitter.backoff(PAUSE_FIRST, PAUSE_MAX, self.pauses);
        self.pauses = self.pauses.saturating_add(1);
        self.state = State::Pausing(now + pause);
    }

    /// After a scan or a failed attempt: tries the network after the first `tried`, or pauses.
    fn try_candidate<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        now: Instant,
        tried: usize,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        link.detach();
        match self.candidate(tried) {
            Some(candidate) => {
                self.state = State::Joining {
                    candidate,
                    place: tried,
                    is_fresh: false,
                    attempts: 0,
                    due: now,
                };
                link.attach(candidate.pan, ShortAddress::UNASSIGNED);
            }
            None => self.pause(now, common),
        }
    }

    /// The next PAN to try after the first `tried` of the scan's: first the former home, unless it
    /// roams, then whichever is heard best.
    fn candidate(&self, tried: usize) -> Option<Found> {
        let home = self.home.map(|home| home.coordinator);
        let is_home = |found: &&Found| home.is_some() && found.coordinator == home;
        let comes_first = |found: &&Found| is_home(found) && !self.is_roaming;
        let found = self.scan.found().iter();
        let homes = found.clone().filter(comes_first);
        let others = found.filter(|found| !comes_first(found) && (found.is_open || is_home(found)));
        let mut all = homes
            .chain(others)
            .filter(|found| found.coordinator.is_some());
        all.nth(tried).copied()
    }

    /// Looks for a network, if it wanted none.
    pub(super) fn join(&mut self, common: &Common) {
        if matches!(self.state, State::Out) {
            self.scan(common);
        }
    }

    /// Says so to its coordinator, and wants no network from now on.
    pub(super) fn leave<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        now: Instant,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        if let State::Joined { membership, .. } = self.state {
            let command = MacCommand::Disassociation { reason: 2 };
            common.command(now, Address::Extended(membership.coordinator), command);
        }
        self.state = State::Out;
        self.forget_home(link, common);
    }

    /// Belongs to no network from now on.
    fn forget_home<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        self.home = None;
        link.detach();
        common.unsaved.mark(FACT_NETWORK);
    }

    pub(super) fn on_beacon(&mut self, found: Found, common: &mut Common) {
        if matches!(self.state, State::Scanning) {
            self.scan.on_beacon(found, &mut common.jitter);
        }
    }

    pub(super) fn on_event<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        now: Instant,
        event: LinkEvent,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        match event {
            LinkEvent::Nothing => {}
            LinkEvent::Fresh { peer, .. } => self.on_fresh(now, peer),
            LinkEvent::Command { from, command } => {
                self.on_command(now, from, command, link, common);
            }
        }
    }

    /// The coordinator it wants to join has proven itself: the request can go out.
    fn on_fresh(&mut self, now: Instant, peer: Eui64) {
        if let State::Joining {
            candidate,
            is_fresh,
            attempts,
            due,
            ..
        } = &mut self.state
            && candidate.coordinator == Some(peer)
        {
            *is_fresh = true;
            *attempts = 0;
            *due = now;
        }
    }

    /// A command of its coordinator, present or future. No other node has a say.
    fn on_command<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        now: Instant,
        from: Eui64,
        command: MacCommand,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        match (command, &self.state) {
            (
                MacCommand::AssociationResponse(association),
                &State::Joining {
                    candidate, place, ..
                },
            ) if candidate.coordinator == Some(from) => {
                let Association { short, status } = association;
                if status == AssociationStatus::Successful && short.is_unicast() {
                    let membership = Membership {
                        pan: candidate.pan,
                        channel: candidate.channel,
                        short,
                        coordinator: from,
                    };
                    self.settle(now, membership, link, common);
                    link.introduce();
                } else {
                    self.refusal = Some(status);
                    self.try_candidate(now, place + 1, link, common);
                }
            }
            (
                MacCommand::CoordinatorRealignment { pan, channel, .. },
                &State::Joined { membership, .. },
            ) if membership.coordinator == from => {
                let membership = Membership {
                    pan,
                    channel: Channel::new(channel).unwrap_or(membership.channel),
                    ..membership
                };
                self.settle(now, membership, link, common);
            }
            (MacCommand::Disassociation { .. }, State::Joined { membership, .. })
                if membership.coordinator == from =>
            {
                self.pause(now, common);
                self.forget_home(link, common);
            }
            _ => {}
        }
    }

    /// Belongs to this network from now on.
    fn settle<const PEERS: usize, const QUEUE: usize>(
        &mut self,
        now: Instant,
        membership: Membership,
        link: &mut Link<PEERS, QUEUE>,
        common: &mut Common,
    ) {
        self.state = State::Joined {
            membership,
            unanswered: 0,
            check: now,
        };
        self.home = Some(membership);
        debug!("joined {} as {}", membership.pan, membership.short);
        self.is_roaming = false;
        self.pauses = 0;
        self.refusal = None;
        link.attach(membership.pan, membership.short);
        link.obey(membership.coordinator);
        link.stay_awake(now);
        common.unsaved.mark(FACT_NETWORK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        network::{Channels, NetworkSettings},
        radio::FRAME_MAX,
        security::{Counter, FrameSecurity, Key, Protection},
        wire::Frame,
    };

    const COORDINATOR: Eui64 = Eui64([1; 8]);
    const ANYBODY: Eui64 = Eui64([2; 8]);
    const NOW: Instant = Instant(1000);
    const FOUND: Found = Found {
        pan: crate::wire::PanId(0xBEEF),
        channel: Channel::FIRST,
        coordinator: Some(COORDINATOR),
        is_open: true,
        strength: 0,
    };

    /// A device that has just begun to join a network.
    fn joining() -> (Device, Link<4, 2>, Common) {
        let mut common = Common::new(NetworkSettings {
            extended: Eui64([9; 8]),
            channels: Channels::ALL,
            tx_power: 0,
            protection: Protection::EncMic64,
            seed: 1,
            sleeps: false,
        });
        let key = Key::new(1, core::array::from_fn(|i| i as u8)).unwrap();
        let counter = Counter::resume(0);
        let session = FrameSecurity::new(Eui64([9; 8]), Protection::EncMic64, key, counter);
        let mut link = Link::new(session, 1);
        let mut device = Device::new(NOW, None, &common);
        device.scan.on_beacon(FOUND, &mut common.jitter);
        device.try_candidate(NOW, 0, &mut link, &mut common);
        (device, link, common)
    }

    fn admitted(from: Eui64, short: u16) -> LinkEvent {
        let command = MacCommand::AssociationResponse(Association {
            short: ShortAddress(short),
            status: AssociationStatus::Successful,
        });
        LinkEvent::Command { from, command }
    }

    #[test]
    fn only_its_coordinator_admits_a_device() {
        let (mut device, mut link, mut common) = joining();
        device.on_event(NOW, admitted(ANYBODY, 5), &mut link, &mut common);
        assert_eq!(device.status(), NetworkStatus::Searching(None));
        device.on_event(NOW, admitted(COORDINATOR, 5), &mut link, &mut common);
        let NetworkStatus::Joined(network) = device.status() else {
            panic!("{:?}", device.status());
        };
        assert_eq!((network.pan, network.short), (FOUND.pan, ShortAddress(5)));
        // An address of no device is no admission.
        for nobody in [0xFFFE, 0xFFFF] {
            let (mut device, mut link, mut common) = joining();
            device.on_event(NOW, admitted(COORDINATOR, nobody), &mut link, &mut common);
            assert!(matches!(device.status(), NetworkStatus::Searching(Some(_))));
        }
    }

    #[test]
    fn a_request_goes_to_a_coordinator_that_has_proven_itself() {
        for (peer, requests) in [(ANYBODY, 0), (COORDINATOR, 1)] {
            let (mut device, mut link, mut common) = joining();
            let short = ShortAddress(0);
            let fresh = LinkEvent::Fresh { peer, short };
            device.on_event(NOW, fresh, &mut link, &mut common);
            device.poll(NOW, &mut link, &mut common);
            assert_eq!(common.commands.iter().count(), requests);
        }
    }

    #[test]
    fn a_pause_lasts_until_its_end() {
        let (mut device, mut link, mut common) = joining();
        device.pause(NOW, &mut common);
        let until = device.deadline().unwrap();
        assert!(NOW + PAUSE_FIRST / 4 < until);
        device.poll(Instant(until.0 - 1), &mut link, &mut common);
        assert!(matches!(device.state, State::Pausing(_)));
        device.poll(until, &mut link, &mut common);
        assert!(matches!(device.state, State::Scanning));
    }

    /// The coordinator may have changed the key while the device slept: the second half of the
    /// questions is under the next key.
    #[test]
    fn a_silent_coordinator_is_asked_under_both_keys() {
        let (mut device, mut link, mut common) = joining();
        device.on_event(NOW, admitted(COORDINATOR, 5), &mut link, &mut common);
        let next = Key::new(2, core::array::from_fn(|i| 7 + i as u8)).unwrap();
        link.session.keys.install(next).unwrap();
        link.session.counter.reserved(1000);
        let mut keys = heapless::Vec::<u8, 16>::new();
        let mut frame = [0; FRAME_MAX];
        while matches!(device.state, State::Joined { .. }) {
            let now = device.deadline().unwrap();
            device.poll(now, &mut link, &mut common);
            if let Some(len) = link.poll_transmit(now, &mut frame) {
                let asked = Frame::parse(&frame[..len]).unwrap();
                keys.push(asked.header().security.unwrap().key_index)
                    .unwrap();
            }
        }
        assert_eq!(keys, [1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2, 2]);
    }
}
