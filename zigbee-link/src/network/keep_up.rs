//! What a device does.

use core::mem;

use super::{
    Node, Role,
    device::{ALIVE_ATTEMPTS, ALIVE_WAIT, JOIN_ATTEMPTS, JOIN_WAIT, KEEP_ALIVE, State},
    scan::Step,
};
use crate::{
    Instant,
    link::Event,
    log::debug,
    radio::Channel,
    store::Membership,
    wire::{
        Address, Association, AssociationStatus, Command, DeviceCapabilities, Eui64, PanId,
        ShortAddress,
    },
};

impl<const PEERS: usize, const QUEUE: usize, const MEMBERS: usize> Node<PEERS, QUEUE, MEMBERS> {
    pub(super) fn keep_up(&mut self, now: Instant) {
        let Role::Device(device) = &mut self.role else {
            return;
        };
        match &mut device.state {
            State::Out => {}
            State::Pausing(until) => {
                if *until <= now {
                    device.scan(self.settings.channels);
                }
            }
            State::Scanning => match device.scan.step(now) {
                Step::Request => self.beacon_request_due = true,
                Step::Listen => {}
                Step::Done => self.next_candidate(now),
            },
            State::Joining {
                candidate,
                is_fresh,
                attempts,
                due,
                ..
            } if *due <= now => {
                let Some(coordinator) = candidate.coordinator.filter(|_| *attempts < JOIN_ATTEMPTS)
                else {
                    return self.next_candidate(now);
                };
                *attempts += 1;
                *due = now + self.jitter.around(JOIN_WAIT);
                let to = Address::Extended(coordinator);
                if *is_fresh {
                    let request = Command::AssociationRequest(DeviceCapabilities::LISTENING);
                    self.command(now, to, request);
                } else {
                    self.link.ask(now, to, *attempts > JOIN_ATTEMPTS / 2);
                }
            }
            State::Joined {
                membership,
                unanswered,
                check,
            } if *check <= now => {
                let coordinator = membership.coordinator;
                let peer = self.link.session.peers.by_extended(coordinator);
                match peer.filter(|peer| now < peer.heard + KEEP_ALIVE) {
                    Some(peer) => {
                        *unanswered = 0;
                        *check = peer.heard + KEEP_ALIVE;
                    }
                    None if *unanswered < ALIVE_ATTEMPTS => {
                        *unanswered += 1;
                        *check = now + self.jitter.around(ALIVE_WAIT);
                        let under_next = *unanswered > ALIVE_ATTEMPTS / 2;
                        self.link
                            .ask(now, Address::Extended(coordinator), under_next);
                    }
                    None => {
                        debug!("lost {}", membership.pan);
                        device.scan(self.settings.channels);
                        self.link.detach();
                    }
                }
            }
            State::Joining { .. } | State::Joined { .. } => {}
        }
    }

    /// After a scan or a failed attempt: tries the next network, or pauses.
    fn next_candidate(&mut self, now: Instant) {
        let Role::Device(device) = &mut self.role else {
            return;
        };
        let place = match device.state {
            State::Scanning => 0,
            State::Joining { place, .. } => place + 1,
            _ => return,
        };
        self.link.detach();
        match device.candidate(place) {
            Some(candidate) => {
                device.state = State::Joining {
                    candidate,
                    place,
                    is_fresh: false,
                    attempts: 0,
                    due: now,
                };
                self.link.attach(candidate.pan, ShortAddress::UNASSIGNED);
            }
            None => device.pause(now, &mut self.jitter),
        }
    }

    /// Belongs to no network from now on.
    pub(super) fn depart(&mut self, state: State) {
        if let Role::Device(device) = &mut self.role {
            device.state = state;
            device.home = None;
            self.link.detach();
            self.unsaved.network = true;
        }
    }

    pub(super) fn device_event(&mut self, now: Instant, event: Event) {
        let Role::Device(device) = &mut self.role else {
            return;
        };
        match (event, &mut device.state) {
            (
                Event::Fresh { peer, .. },
                State::Joining {
                    candidate,
                    is_fresh,
                    attempts,
                    due,
                    ..
                },
            ) if candidate.coordinator == Some(peer) => {
                *is_fresh = true;
                *attempts = 0;
                *due = now;
            }
            (
                Event::Command {
                    from,
                    command: Command::AssociationResponse(association),
                    ..
                },
                State::Joining { candidate, .. },
            ) if candidate.coordinator == Some(from) => {
                let (pan, channel) = (candidate.pan, candidate.channel);
                self.decided(now, from, pan, channel, association);
            }
            (
                Event::Command {
                    from,
                    command: Command::CoordinatorRealignment { pan, channel, .. },
                    ..
                },
                State::Joined { membership, .. },
            ) if membership.coordinator == from => {
                let membership = Membership {
                    pan,
                    channel: Channel::new(channel).unwrap_or(membership.channel),
                    ..*membership
                };
                self.settle(now, membership);
            }
            (
                Event::Command {
                    from,
                    command: Command::Disassociation { .. },
                    ..
                },
                State::Joined { membership, .. },
            ) if membership.coordinator == from => {
                device.pause(now, &mut self.jitter);
                let pausing = mem::replace(&mut device.state, State::Out);
                self.depart(pausing);
            }
            _ => {}
        }
    }

    fn decided(
        &mut self,
        now: Instant,
        coordinator: Eui64,
        pan: PanId,
        channel: Channel,
        Association { short, status }: Association,
    ) {
        if status == AssociationStatus::Successful && short.is_unicast() {
            return self.settle(
                now,
                Membership {
                    pan,
                    channel,
                    short,
                    coordinator,
                },
            );
        }
        if let Role::Device(device) = &mut self.role {
            device.refusal = Some(status);
            self.next_candidate(now);
        }
    }

    /// Belongs to this network from now on.
    fn settle(&mut self, now: Instant, membership: Membership) {
        if let Role::Device(device) = &mut self.role {
            device.state = State::Joined {
                membership,
                unanswered: 0,
                check: now,
            };
            device.home = Some(membership);
            debug!("joined {} as {}", membership.pan, membership.short);
            device.pauses = 0;
            device.refusal = None;
            self.link.attach(membership.pan, membership.short);
            self.unsaved.network = true;
        }
    }
}
