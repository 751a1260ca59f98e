//! What a coordinator does.

use core::time::Duration;

use super::{
    Node, Role, Status,
    coordinator::{CONFLICT_PAUSE, State},
    scan::Step,
};
use crate::{
    Instant,
    link::{Delivery, Event, SendError},
    log::debug,
    store::{Member, Membership},
    wire::{Address, AssociationStatus, Command, Eui64, PanId, ShortAddress},
};

/// Announcements of a new PAN identifier, and the time between them.
const REALIGNMENTS: u32 = 3;
const REALIGNMENT_PAUSE: Duration = Duration::from_millis(100);

impl<const PEERS: usize, const QUEUE: usize, const MEMBERS: usize> Node<PEERS, QUEUE, MEMBERS> {
    pub(super) fn coordinate(&mut self, now: Instant) {
        let Role::Coordinator(coordinator) = &mut self.role else {
            return;
        };
        match &mut coordinator.state {
            State::Scanning(scan) => match scan.step(now) {
                Step::Request => self.beacon_request_due = true,
                Step::Listen => {}
                Step::Done => {
                    let jitter = &mut self.jitter;
                    let pan = scan.free_pan(|| jitter.next() as u16);
                    if let Some(channel) = scan.quietest() {
                        self.start(Membership {
                            pan,
                            channel,
                            short: ShortAddress::COORDINATOR,
                            coordinator: self.settings.extended,
                        });
                    }
                }
            },
            State::Running(_) => {
                self.rotate(now);
                self.realign();
            }
        }
    }

    /// Runs, or goes on, as this.
    fn start(&mut self, network: Membership) {
        if let Role::Coordinator(coordinator) = &mut self.role {
            coordinator.state = State::Running(network);
            debug!("runs {} on channel {}", network.pan, network.channel);
            self.link.attach(network.pan, network.short);
            self.unsaved.network = true;
        }
    }

    /// Hands the next key on to the next member, and uses it after the last.
    fn rotate(&mut self, now: Instant) {
        let Role::Coordinator(coordinator) = &mut self.role else {
            return;
        };
        let Some(rotation) = coordinator.rotation.as_mut() else {
            return;
        };
        if rotation.change.is_done {
            return;
        }
        if let Some(ticket) = rotation.ticket {
            let Some(delivery) = self.link.result_of(ticket) else {
                return;
            };
            rotation.change.unreached += u8::from(delivery != Delivery::Delivered);
            rotation.ticket = None;
        }
        let next = self.link.session.keys.next();
        let mut members = coordinator.members.iter().enumerate().skip(rotation.place);
        let member = members.find_map(|(place, member)| Some((place, (*member)?)));
        if let (Some((place, member)), Some(next)) = (member, next) {
            let sent = self.link.send_next_key(now, member.short, &next);
            if sent != Err(SendError::QueueFull) {
                rotation.place = place + 1;
                rotation.ticket = sent.ok();
                rotation.change.unreached += u8::from(sent.is_err());
            }
        } else {
            rotation.change.is_done = true;
            // Not installed means that another key was meanwhile.
            let _ = self.link.activate_key(rotation.change.index, now);
        }
    }

    /// Changes the PAN identifier once every announcement has been sent.
    fn realign(&mut self) {
        let Role::Coordinator(coordinator) = &self.role else {
            return;
        };
        let State::Running(network) = coordinator.state else {
            return;
        };
        let is_announcement =
            |command: &Command| matches!(command, Command::CoordinatorRealignment { .. });
        if self
            .commands
            .iter()
            .any(|outbound| is_announcement(&outbound.command))
        {
            return;
        }
        if let Some(pan) = self.realignment.take() {
            self.start(Membership { pan, ..network });
        }
    }

    /// Another network has the same PAN identifier.
    pub(super) fn conflict(&mut self, now: Instant) {
        let Role::Coordinator(coordinator) = &mut self.role else {
            return;
        };
        let State::Running(network) = coordinator.state else {
            return;
        };
        let recent = |last: Instant| now < last + CONFLICT_PAUSE;
        if coordinator.last_conflict.is_some_and(recent) {
            return;
        }
        coordinator.last_conflict = Some(now);
        let pan = loop {
            let drawn = PanId(self.jitter.next() as u16);
            if drawn.0 < ShortAddress::UNASSIGNED.0 && drawn != network.pan {
                break drawn;
            }
        };
        self.realignment = Some(pan);
        for announcement in 0..REALIGNMENTS {
            let command = Command::CoordinatorRealignment {
                pan,
                coordinator: ShortAddress::COORDINATOR,
                channel: network.channel.number(),
                short: ShortAddress::BROADCAST,
                page: None,
            };
            let everybody = Address::Short(ShortAddress::BROADCAST);
            self.command(now + REALIGNMENT_PAUSE * announcement, everybody, command);
        }
    }

    pub(super) fn coordinator_event(&mut self, now: Instant, event: Event) {
        let (from, command) = match event {
            Event::Command { from, command, .. } => (from, command),
            Event::Fresh { peer, short } => return self.presented(now, peer, short),
            Event::Nothing => return,
        };
        match command {
            Command::AssociationRequest(_) => self.requested(now, from),
            Command::Disassociation { .. } => {
                if let Role::Coordinator(coordinator) = &mut self.role
                    && coordinator.remove(from)
                {
                    self.link.session.peers.forget(from);
                }
            }
            Command::Orphan => self.orphaned(now, from),
            Command::PanIdConflict if self.members().any(|member| member.extended == from) => {
                self.conflict(now);
            }
            _ => {}
        }
    }

    /// Somebody is there, and says which address it has. If nobody has that, it missed that it was
    /// sent away.
    fn presented(&mut self, now: Instant, device: Eui64, short: ShortAddress) {
        let member = Member {
            extended: device,
            short,
        };
        if short.is_unicast() && !self.members().any(|other| other == member) {
            self.dismiss(now, device);
        }
    }

    /// Sends a device away. Nobody acknowledges that, so the device is a stranger from now on: when
    /// it is next heard it has to present itself, and is told again.
    pub(super) fn dismiss(&mut self, now: Instant, device: Eui64) {
        let command = Command::Disassociation { reason: 1 };
        self.command(now, Address::Extended(device), command);
        self.link.session.peers.forget(device);
    }

    /// Tells a member where it belongs.
    fn orphaned(&mut self, now: Instant, device: Eui64) {
        let member = self.members().find(|member| member.extended == device);
        if let (Some(member), Status::Joined(network)) = (member, self.status()) {
            let command = Command::CoordinatorRealignment {
                pan: network.pan,
                coordinator: ShortAddress::COORDINATOR,
                channel: network.channel.number(),
                short: member.short,
                page: None,
            };
            self.command(now, Address::Extended(device), command);
        }
    }

    fn requested(&mut self, now: Instant, device: Eui64) {
        let Role::Coordinator(coordinator) = &mut self.role else {
            return;
        };
        let association = coordinator.admit(now, device);
        if association.status == AssociationStatus::Successful {
            self.link.session.peers.rename(device, association.short);
        }
        // Before the answer goes out, it is written down.
        let command = Command::AssociationResponse(association);
        self.command(now, Address::Extended(device), command);
    }
}
