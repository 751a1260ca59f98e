//! Frames coming in.

use core::time::Duration;

use super::{
    Delivery, Incoming, Link, LinkEvent, count,
    freshness::ReplyKind,
    outgoing::AT_ONCE,
    packet::{self, Kind, Packet},
};
use crate::{
    Instant,
    log::debug,
    security::{Envelope, Key, Opened, Refused, Sender},
    wire::{Address, Eui64, FrameType, Header, MacCommand, Malformed, PanId, Panned, ShortAddress},
};

/// Receivers of a broadcast that ask after it do so within this time.
const BROADCAST_SPREAD: Duration = Duration::from_millis(20);

impl<const PEERS: usize, const QUEUE: usize> Link<PEERS, QUEUE> {
    /// Takes in a frame without FCS, which is decrypted in place.
    pub fn handle(&mut self, now: Instant, frame: &mut [u8]) -> LinkEvent {
        let Ok(envelope) = Envelope::parse(frame) else {
            return LinkEvent::Nothing;
        };
        let Some(broadcast) = self.is_for_us(envelope.destination) else {
            return LinkEvent::Nothing;
        };
        let opened = match self.session.open_parsed(now, &envelope, frame) {
            Ok(opened) => opened,
            Err(refused) => {
                count(&mut self.counts.refused);
                debug!("refused: {}", refused);
                // A wrong code or an old counter: the address may meanwhile belong to another node. If it does,
                // that node speaks to this one sooner or later. Every node would ask after a broadcast.
                let is_in_doubt = match refused {
                    Refused::UnknownShort(_) => true,
                    Refused::Mic | Refused::Replayed => !broadcast,
                    _ => false,
                };
                if is_in_doubt
                    && let Some(Address::Short(short)) = envelope.source
                    && short.is_unicast()
                {
                    self.ask_sender(now, broadcast, Address::Short(short));
                }
                return LinkEvent::Nothing;
            }
        };
        if !broadcast {
            self.sleep.on_answered();
        }
        let event = match opened.frame_type {
            FrameType::Command => self.command(now, broadcast, &opened),
            _ => self.packet(now, broadcast, &opened),
        };
        event.unwrap_or_else(|malformed| {
            count(&mut self.counts.unknown);
            debug!("unknown: {}", malformed);
            LinkEvent::Nothing
        })
    }

    /// Takes in an empty frame that is not secured.
    pub(crate) fn on_wake(&mut self, now: Instant, header: &Header) {
        if let Some(is_broadcast) = self.is_for_us(header.destination)
            && let Some(Address::Short(from)) = header.source.address
        {
            self.sleep.on_wake(now, from, is_broadcast);
        }
    }

    /// Asks the sender of a frame to prove that it is fresh. Every node hears a broadcast at once, and would ask
    /// at once, and again and again.
    fn ask_sender(&mut self, now: Instant, broadcast: bool, sender: Address) {
        if !broadcast {
            self.challenge(now, sender);
        } else if self.challenges.may_ask_after_broadcast(now) {
            let at = now + self.jitter.up_to(BROADCAST_SPREAD);
            self.challenge(at, sender);
        }
    }

    /// Returns `None` if a frame is not for this node; otherwise, true if it is for all.
    fn is_for_us(&self, destination: Panned) -> Option<bool> {
        let attachment = self.attachment?;
        if ![attachment.pan, PanId::BROADCAST].contains(&destination.pan?) {
            return None;
        }
        match destination.address? {
            Address::Short(ShortAddress::BROADCAST) => Some(true),
            Address::Short(short) if short == attachment.short && short.is_unicast() => Some(false),
            Address::Extended(extended) if extended == self.session.extended() => Some(false),
            _ => None,
        }
    }

    /// A peer speaks the next key, in other words than a challenge: every member has it. Only the coordinator
    /// knows that first, and follows no other node.
    fn follow_key(&mut self, now: Instant, index: u8) {
        let is_next = |next: Key| next.index() == index;
        if self.session.keys.next().is_some_and(is_next)
            && self.short() != Some(ShortAddress::COORDINATOR)
        {
            let activated = self.activate_key(index, now);
            debug_assert!(activated.is_ok(), "it is the next one");
        }
    }

    fn command(
        &mut self,
        now: Instant,
        broadcast: bool,
        opened: &Opened<'_>,
    ) -> Result<LinkEvent, Malformed> {
        let command = MacCommand::parse(opened.payload)?;
        match opened.sender {
            Sender::Peer(from) => {
                self.follow_key(now, opened.key);
                Ok(LinkEvent::Command { from, command })
            }
            Sender::Stranger(extended) => {
                self.ask_sender(now, broadcast, Address::Extended(extended));
                Ok(LinkEvent::Nothing)
            }
        }
    }

    fn packet(
        &mut self,
        now: Instant,
        broadcast: bool,
        opened: &Opened<'_>,
    ) -> Result<LinkEvent, Malformed> {
        let extended = opened.sender.extended();
        let packet = Packet::parse(opened.payload)?;
        if let Sender::Peer(_) = opened.sender
            && packet != Packet::Challenge
        {
            self.follow_key(now, opened.key);
        }
        match (packet, opened.sender) {
            (Packet::Message { kind, age, bytes }, Sender::Peer(_)) => {
                if broadcast != (kind == Kind::Broadcast) {
                    return Err(Malformed::Reserved);
                }
                let number = opened.counter.checked_sub(u32::from(age));
                let number = number.ok_or(Malformed::Reserved)?;
                let is_answered = !broadcast && kind != Kind::Once;
                if self.accept(kind, extended, number, bytes)? && is_answered {
                    let kind = ReplyKind::Acknowledgement {
                        counter: opened.counter,
                    };
                    self.reply(now, kind, opened.source);
                }
                Ok(LinkEvent::Nothing)
            }
            (Packet::Message { .. }, Sender::Stranger(_)) => {
                self.ask_sender(now, broadcast, Address::Extended(extended));
                Ok(LinkEvent::Nothing)
            }
            (Packet::Presence, Sender::Peer(_)) => Ok(LinkEvent::Nothing),
            (Packet::Presence, Sender::Stranger(_)) => {
                self.ask_sender(now, broadcast, Address::Extended(extended));
                Ok(LinkEvent::Nothing)
            }
            (Packet::Acknowledgement { counter }, Sender::Peer(_)) => {
                if let Address::Short(from) = opened.source {
                    self.acknowledged(from, counter);
                }
                Ok(LinkEvent::Nothing)
            }
            (Packet::Acknowledgement { .. }, Sender::Stranger(_)) => Ok(LinkEvent::Nothing),
            (Packet::Challenge, sender) => {
                let to = Address::Extended(extended);
                let challenges = matches!(sender, Sender::Stranger(_));
                // An old challenge can be replayed without limit, so strangers get answers only as often as they
                // are asked.
                if !challenges || self.challenges.may_ask(now, to) {
                    let kind = ReplyKind::Response {
                        counter: opened.counter,
                        challenges,
                    };
                    self.reply(now, kind, to);
                }
                Ok(LinkEvent::Nothing)
            }
            (
                Packet::Response {
                    challenges,
                    short,
                    counter,
                },
                _,
            ) => {
                if !self.challenges.is_answered(now, extended, short, counter) {
                    return Ok(LinkEvent::Nothing);
                }
                self.follow_key(now, opened.key);
                let entered = self
                    .session
                    .peers
                    .enter(extended, short, opened.counter, now);
                if entered.is_err() {
                    count(&mut self.counts.table_full);
                    return Ok(LinkEvent::Nothing);
                }
                if challenges {
                    let kind = ReplyKind::Response {
                        counter: opened.counter,
                        challenges: false,
                    };
                    self.reply(now, kind, Address::Extended(extended));
                }
                for outgoing in self.outgoing.iter_mut() {
                    if outgoing.destination == short {
                        outgoing.due = outgoing.due.min(now);
                    }
                }
                Ok(LinkEvent::Fresh {
                    peer: extended,
                    short,
                })
            }
        }
    }

    /// Takes in a message of a peer. Returns true if it is to be acknowledged: it is in the queue, or was before.
    fn accept(
        &mut self,
        kind: Kind,
        extended: Eui64,
        number: u32,
        bytes: &[u8],
    ) -> Result<bool, Malformed> {
        let peers = &mut self.session.peers;
        let peer = peers.by_extended_mut(extended).ok_or(Malformed::Reserved)?;
        let broadcast = kind == Kind::Broadcast;
        let last = if broadcast {
            &mut peer.last_broadcast
        } else {
            &mut peer.last_unicast
        };
        if last.is_some_and(|last| number <= last) {
            count(&mut self.counts.duplicates);
            // Behind the last one are only messages whose sender gave them up.
            return Ok(*last == Some(number));
        }
        if kind == Kind::Control {
            // A peer reports its own short address, which need not be true.
            let is_authority = self.authority.is_none_or(|authority| authority == extended);
            if peer.short != ShortAddress::COORDINATOR || !is_authority {
                return Err(Malformed::Reserved);
            }
            let next = packet::parse_next_key(bytes)?;
            *last = Some(number);
            self.keys_changed |= self.session.keys.install(next).is_ok();
            return Ok(true);
        }
        let incoming = Incoming {
            from: peer.short,
            extended,
            broadcast,
            bytes: heapless::Vec::from_slice(bytes).map_err(|_| Malformed::TrailingBytes)?,
        };
        let queued = self.incoming.push_back(incoming).is_ok();
        if queued {
            *last = Some(number);
        } else if broadcast {
            count(&mut self.counts.lost_broadcasts);
        }
        Ok(queued)
    }

    fn acknowledged(&mut self, from: ShortAddress, counter: u32) {
        let answered = self.outgoing.iter_mut().find(|outgoing| {
            outgoing.destination == from
                && outgoing.is_waiting()
                && outgoing.is_answered_by(counter)
        });
        if let Some(outgoing) = answered {
            outgoing.result = Some(Delivery::Delivered);
            if outgoing.attempts == 1 {
                self.at_once = (self.at_once + 1).min(AT_ONCE);
                self.losses = self.losses.saturating_sub(1);
            }
        }
    }
}
