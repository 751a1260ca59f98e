//! Messages between members of a network.
//!
//! A message is anything [`Serialize`], encoded by [`postcard`], in one secured data frame. A
//! unicast is acknowledged end to end by a secured frame, repeated until then with a jittered,
//! doubling wait, and delivered at most once for as long as the receiver runs. Its [`Delivery`] is
//! always told. A receiver that restarts in the middle of a message may deliver it once more: what
//! the application knew of it is gone too.
//!
//! # Queues and their policy
//! - Outgoing: `QUEUE` messages. Full, [`Link::send`] refuses. To each destination they go one at
//!   a time, in order; destinations do not wait for each other.
//! - Incoming: `QUEUE` messages. Full, a unicast is not acknowledged, so its sender tries again
//!   later; a broadcast is lost, and counted.
//! - Acknowledgements and answers: 8. Full, they are lost; the peer asks again.
//!
//! # Bytes on the air
//! With level 6 and short addresses a message of 20 bytes takes 53 bytes, 1696 us:
//!
//! | bytes | |
//! |---|---|
//! | 6 | preamble, start of frame, length |
//! | 9 | frame control 2, sequence number 1, PAN 2, destination 2, source 2 |
//! | 6 | security control 1, frame counter 4, key index 1 |
//! | 2 | version and kind 1, age 1 |
//! | 20 | message |
//! | 8 | integrity code |
//! | 2 | frame check sequence |
//!
//! Its acknowledgement takes 36 bytes, 1152 us. Saving the key index would cost the change of keys,
//! the sequence number the immediate acknowledgements of the hardware, the age the rejection of
//! duplicates.

mod freshness;
mod outgoing;
mod packet;
mod receive;
mod sleep;
#[cfg(test)]
mod tests;

use core::time::Duration;

use serde::{Serialize, de::DeserializeOwned};

use self::{
    freshness::{Challenges, Reply, ReplyKind},
    outgoing::{AT_ONCE, Outgoing},
    packet::{Kind, MESSAGE_HEADER, Packet},
    sleep::Sleep,
};
pub use self::{
    outgoing::{ATTEMPTS, BROADCAST_COPIES, Delivery, RETRY_FIRST, RETRY_MAX, SendError, Ticket},
    packet::VERSION,
    sleep::{WAKE_FOR, WAKING},
};
use crate::{
    Instant,
    jitter::Jitter,
    log::debug,
    radio::FRAME_MAX,
    security::{FrameSecurity, Key, RotationError, SealError},
    slots::Slots,
    wire::{Address, Eui64, FrameType, Header, MacCommand, PanId, Panned, ShortAddress},
};

/// Bytes of the longest message: of a frame without FCS, less header 9, security 6, packet 2 and
/// integrity code 8.
pub const MESSAGE_MAX: usize = FRAME_MAX - 9 - 6 - MESSAGE_HEADER - 8;

/// Time for which frames under the former key are accepted after a change.
pub const KEY_WINDOW: Duration = Duration::from_secs(60);

/// Broadcasts from the extended address after a node has joined. Its short address may have been that of another
/// one, for which peers would take it: a wrong code of a broadcast makes no node ask.
const INTRODUCTIONS: u8 = 4 * BROADCAST_COPIES;

/// Mean time between two broadcasts of a node that broadcasts. Several are within
/// [`FRESH_FOR`](crate::security::FRESH_FOR), for some are lost.
const PRESENCE: Duration = Duration::from_secs(15);
/// The same where frames were lost lately: with 30 % loss, all of eight are lost in 7 of 100,000 cases. A receiver
/// that hears none believes no broadcast before its sender has proven that it is fresh.
const PRESENCE_IN_LOSSY_AIR: Duration = Duration::from_millis(7_500);
/// A repeated message counts as much as two that came at once: with 30 % loss every other one is repeated.
const LOSS: u8 = 2;
/// Measure of losses from which on the air is lossy; collisions alone do not reach it.
const LOSSY: u8 = 6;
/// Upper limit of the measure of losses: more is forgotten.
const LOSSES: u8 = 12;
/// Time for which a node says that it is there, after its last message to all.
const PRESENT_FOR: Duration = Duration::from_secs(600);

/// Times at which a node says to all that it is there.
#[derive(Clone, Copy, Debug, Default)]
struct Presence {
    due: Option<Instant>,
    /// Time after which it is said no more.
    until: Option<Instant>,
    /// True if it is said for as long as it is attached.
    always: bool,
}

/// Replies in the queue.
const REPLIES: usize = 8;

/// Counts of a [`Link`] since its start. Counters stay at their maximum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Counts {
    /// Frames that were not authentic, not new, or no frames.
    pub refused: u32,
    /// Authentic frames of an unknown version or kind, and messages that did not decode.
    pub unknown: u32,
    /// Messages that came again.
    pub duplicates: u32,
    /// Broadcasts lost because the incoming queue was full.
    pub lost_broadcasts: u32,
    /// Peers that found no place in the table.
    pub table_full: u32,
}

fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}

/// A received message.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Incoming {
    /// The sender's short address.
    pub from: ShortAddress,
    /// The sender's extended address.
    pub extended: Eui64,
    /// Sent to everybody.
    pub broadcast: bool,
    /// The message, encoded.
    pub bytes: heapless::Vec<u8, MESSAGE_MAX>,
}

/// Meaning of a received frame beyond messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum LinkEvent {
    /// At most a message, or a reply that is queued: nothing for the layer above.
    Nothing,
    /// A MAC command of a peer, authentic and new.
    Command {
        /// Its sender's extended address.
        from: Eui64,
        /// The command, in clear.
        command: MacCommand,
    },
    /// A peer has just proven that its frames are fresh.
    Fresh {
        /// Its extended address.
        peer: Eui64,
        /// Its short address, if it has one.
        short: ShortAddress,
    },
}

/// Effort made for a message to one member.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Effort {
    /// It is repeated until the member acknowledges it.
    Acknowledged,
    /// It is sent once, also to all, for an application that repeats it itself until its own answer comes.
    Once,
}

/// Place where a link is attached: the PAN and the own short address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Attachment {
    pan: PanId,
    short: ShortAddress,
}

/// The messages of one node, with up to `PEERS` peers and `QUEUE` messages each way.
#[derive(Debug)]
pub struct Link<const PEERS: usize, const QUEUE: usize> {
    /// Keys, own frame counter and known peers.
    pub session: FrameSecurity<PEERS>,
    attachment: Option<Attachment>,
    /// The node that may hand on the next key; `None`: any node that has the coordinator's address.
    authority: Option<Eui64>,
    presence: Presence,
    sleep: Sleep,
    /// Broadcasts that are still to be sent from the extended address.
    introductions: u8,
    /// Messages to members in a row that came at the first attempt, [`AT_ONCE`] at most.
    at_once: u8,
    /// Measure of losses: [`LOSS`] for each repetition, less what came at once, [`LOSSES`] at most.
    losses: u8,
    outgoing: Slots<Outgoing, QUEUE>,
    incoming: heapless::Deque<Incoming, QUEUE>,
    replies: Slots<Reply, REPLIES>,
    challenges: Challenges,
    next_ticket: u16,
    sequence: u8,
    jitter: Jitter,
    counts: Counts,
    keys_changed: bool,
}

impl<const PEERS: usize, const QUEUE: usize> Link<PEERS, QUEUE> {
    /// A link that is not attached. `seed` should differ between nodes.
    // for less stack
    #[inline(always)]
    pub fn new(session: FrameSecurity<PEERS>, seed: u64) -> Self {
        Self {
            session,
            attachment: None,
            authority: None,
            presence: Presence::default(),
            sleep: Sleep::new(),
            introductions: 0,
            at_once: 0,
            losses: 0,
            outgoing: Slots::new(),
            incoming: heapless::Deque::new(),
            replies: Slots::new(),
            challenges: Challenges::default(),
            next_ticket: 0,
            sequence: seed as u8,
            jitter: Jitter::new(seed),
            counts: Counts::default(),
            keys_changed: false,
        }
    }

    /// Returns the counts.
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    /// Attaches to a PAN. Without a short address ([`ShortAddress::UNASSIGNED`]) no messages can be
    /// sent, but peers can be made fresh.
    pub fn attach(&mut self, pan: PanId, short: ShortAddress) {
        self.attachment = Some(Attachment { pan, short });
    }

    /// From now on tells the others that it is there, for as long as it is attached, so that no member has to ask.
    pub(crate) const fn stay_present(&mut self) {
        self.presence = Presence {
            due: Some(Instant(0)),
            until: None,
            always: true,
        };
    }

    /// Devices of the network sleep while it is quiet.
    pub(crate) const fn sleep_when_quiet(&mut self) {
        self.sleep.begin();
    }

    /// Listens for a while.
    pub(crate) fn stay_awake(&mut self, now: Instant) {
        self.sleep.stay_awake(now);
    }

    /// Takes note of the time, for its sleep. It listens before it sends: an answer may come at once.
    pub(crate) fn poll_sleep(&mut self, now: Instant) {
        self.sleep.poll(now);
        if self.deadline().is_some_and(|at| at <= now) {
            self.sleep.on_asking(now);
        }
    }

    /// Returns true if it sleeps, unless it is a coordinator.
    pub(crate) const fn is_asleep(&self) -> bool {
        self.sleep.is_asleep()
    }

    /// Returns true if it sleeps, or only listens for the answer to a question of its own.
    pub(crate) const fn is_quiet(&self) -> bool {
        self.sleep.is_quiet()
    }

    /// Wakes all devices that sleep, before anything else is sent.
    pub(crate) fn wake_all(&mut self, now: Instant) {
        if self.sleep.has_to_wake(now, ShortAddress::BROADCAST, 0) {
            self.sleep.wake(now, ShortAddress::BROADCAST);
        }
    }

    /// Returns true while others are woken.
    pub(crate) fn is_waking(&self) -> bool {
        self.sleep.waking().is_some()
    }

    /// Takes the next key only from this one.
    pub(crate) const fn obey(&mut self, authority: Eui64) {
        self.authority = Some(authority);
    }

    /// Sends the next broadcasts from the extended address: the short one was just given.
    pub(crate) const fn introduce(&mut self) {
        self.introductions = INTRODUCTIONS;
    }

    /// Leaves the PAN. Every message on its way is reported as unanswered. Peers stay known, their short addresses
    /// do not: in the next network they belong to other nodes.
    pub fn detach(&mut self) {
        self.attachment = None;
        self.sleep.give_up();
        self.presence.due = None;
        self.session.peers.forget_addresses();
        self.replies.clear();
        self.challenges.clear();
        for outgoing in self.outgoing.iter_mut() {
            outgoing.result.get_or_insert(Delivery::NoAnswer);
        }
    }

    /// The own short address, if there is one.
    pub fn short(&self) -> Option<ShortAddress> {
        let attachment = self.attachment.as_ref()?;
        attachment.short.is_unicast().then_some(attachment.short)
    }

    /// Takes a message for sending, to [`ShortAddress::BROADCAST`] or one member.
    ///
    /// # Errors
    /// The message was not taken, see [`SendError`].
    pub fn send<T: Serialize + ?Sized>(
        &mut self,
        now: Instant,
        destination: ShortAddress,
        message: &T,
    ) -> Result<Ticket, SendError> {
        self.send_with(now, destination, message, Effort::Acknowledged)
    }

    /// The same as [`send`](Self::send), with less effort if that is wanted. The result of what is sent
    /// [`Once`](Effort::Once) is [`Delivery::Broadcast`].
    ///
    /// # Errors
    /// The message was not taken, see [`SendError`].
    pub fn send_with<T: Serialize + ?Sized>(
        &mut self,
        now: Instant,
        destination: ShortAddress,
        message: &T,
        effort: Effort,
    ) -> Result<Ticket, SendError> {
        let mut buffer = [0; MESSAGE_MAX];
        let bytes = postcard::to_slice(message, &mut buffer).map_err(|_| SendError::TooLong)?;
        let kind = match effort {
            _ if destination == ShortAddress::BROADCAST => Kind::Broadcast,
            Effort::Acknowledged => Kind::Unicast,
            Effort::Once => Kind::Once,
        };
        let is_last_copy = kind == Kind::Broadcast && effort == Effort::Once;
        let attempts = if is_last_copy {
            BROADCAST_COPIES - 1
        } else {
            0
        };
        self.enqueue(now, (kind, attempts), destination, bytes)
    }

    /// Hands the next key on to a member, as reliably as a message. It is accepted there at once
    /// and used from the first frame under it on, challenges apart. Only
    /// [`result_of`](Self::result_of) tells what became of it.
    ///
    /// # Errors
    /// The message was not taken, see [`SendError`].
    pub fn send_next_key(
        &mut self,
        now: Instant,
        destination: ShortAddress,
        next: &Key,
    ) -> Result<Ticket, SendError> {
        let bytes = packet::emit_next_key(next);
        self.enqueue(now, (Kind::Control, 0), destination, &bytes)
    }

    /// Uses the next key from now on.
    ///
    /// # Errors
    /// None with this index is installed.
    pub fn activate_key(&mut self, index: u8, now: Instant) -> Result<(), RotationError> {
        self.session.keys.activate(index, now, KEY_WINDOW)?;
        self.keys_changed = true;
        debug!("key {} is in use", index);
        Ok(())
    }

    fn enqueue(
        &mut self,
        now: Instant,
        (kind, attempts): (Kind, u8),
        destination: ShortAddress,
        bytes: &[u8],
    ) -> Result<Ticket, SendError> {
        let own = self.short().ok_or(SendError::NotJoined)?;
        if destination == own || destination == ShortAddress::UNASSIGNED {
            return Err(SendError::Destination);
        }
        let ticket = Ticket(self.next_ticket);
        let outgoing = Outgoing {
            ticket,
            kind,
            destination,
            bytes: heapless::Vec::from_slice(bytes).map_err(|_| SendError::TooLong)?,
            counters: None,
            attempts,
            due: now,
            result: None,
        };
        if !self.outgoing.put(outgoing) {
            return Err(SendError::QueueFull);
        }
        self.next_ticket = self.next_ticket.wrapping_add(1);
        Ok(ticket)
    }

    /// The next message that came, if it decodes as a `T`. Others are counted and dropped.
    pub fn recv<T: DeserializeOwned>(&mut self) -> Option<(ShortAddress, T)> {
        while let Some(incoming) = self.recv_bytes() {
            match postcard::take_from_bytes(&incoming.bytes) {
                Ok((message, [])) => return Some((incoming.from, message)),
                _ => count(&mut self.counts.unknown),
            }
        }
        None
    }

    /// The next message that came, encoded.
    pub fn recv_bytes(&mut self) -> Option<Incoming> {
        self.incoming.pop_front()
    }

    /// Returns true if [`recv_bytes`](Self::recv_bytes) has something.
    pub fn has_message(&self) -> bool {
        !self.incoming.is_empty()
    }

    /// Returns true if [`result`](Self::result) has something.
    pub fn has_result(&self) -> bool {
        self.outgoing.iter().any(Outgoing::is_settled_message)
    }

    /// The result of any message, once. Its place in the queue is free then. Keys that are handed on are no
    /// messages: their sender waits for just theirs.
    pub fn result(&mut self) -> Option<(Ticket, Delivery)> {
        let settled = self.outgoing.take(Outgoing::is_settled_message)?;
        Some((settled.ticket, settled.result?))
    }

    /// Gives up a message, or its result.
    pub(crate) fn withdraw(&mut self, ticket: Ticket) {
        let _ = self.outgoing.take(|outgoing| outgoing.ticket == ticket);
    }

    /// The result of one message, once. `None` while it is on its way.
    pub fn result_of(&mut self, ticket: Ticket) -> Option<Delivery> {
        let is_settled = |outgoing: &Outgoing| outgoing.ticket == ticket && !outgoing.is_waiting();
        self.outgoing.take(is_settled)?.result
    }

    /// Asks a node to prove that its frames are fresh, unless it was asked just now.
    pub fn challenge(&mut self, now: Instant, target: Address) {
        self.ask(now, target, false);
    }

    /// A [`challenge`](Self::challenge), under the next key if that is wanted and there is one: the
    /// key may have come into use unheard, and the one in use here may be accepted no longer.
    pub(crate) fn ask(&mut self, now: Instant, target: Address, under_next: bool) {
        let waits = |reply: &Reply| {
            matches!(reply.kind, ReplyKind::Challenge { .. }) && reply.destination == target
        };
        if !self.replies.iter().any(waits) && self.challenges.may_ask(now, target) {
            self.reply(now, ReplyKind::Challenge { under_next }, target);
        }
    }

    /// A full queue loses the reply: the peer asks again.
    fn reply(&mut self, due: Instant, kind: ReplyKind, destination: Address) {
        let reply = Reply {
            kind,
            destination,
            due,
        };
        let _ = self.replies.put(reply);
    }

    /// Time to call [`poll_transmit`](Self::poll_transmit) next, unless something else happens.
    // for less flash
    #[inline(never)]
    pub fn deadline(&self) -> Option<Instant> {
        let replies = self.replies.iter().map(|reply| reply.due);
        let outgoing = self
            .outgoing
            .iter()
            .filter(|outgoing| self.is_next(outgoing))
            .map(|outgoing| outgoing.due);
        let presence = self.presence.due.filter(|_| self.short().is_some());
        let sleep = self.sleep.deadline();
        replies.chain(outgoing).chain(presence).chain(sleep).min()
    }

    /// Returns true if a message waits, and no earlier one to the same destination does.
    fn is_next(&self, outgoing: &Outgoing) -> bool {
        outgoing.is_waiting() && !self.outgoing.iter().any(|other| other.is_before(outgoing))
    }

    /// Writes the next frame that is due to `buffer` and returns its length.
    ///
    /// Reserve frame counters before, see [`Counter::wanted`](crate::security::Counter::wanted):
    /// what is due when there are none is lost like a frame on the air.
    pub fn poll_transmit(&mut self, now: Instant, buffer: &mut [u8; FRAME_MAX]) -> Option<usize> {
        self.attachment?;
        if let Some(to) = self.sleep.waking() {
            return self.transmit_wake(to, buffer);
        }
        if let Some(len) = self.transmit_reply(now, buffer) {
            return Some(len);
        }
        for place in 0..QUEUE {
            let Some(outgoing) = self.outgoing.get(place) else {
                continue;
            };
            if outgoing.due > now || !self.is_next(outgoing) {
                continue;
            }
            let (to, attempts) = (outgoing.destination, outgoing.attempts);
            if self.sleep.has_to_wake(now, to, attempts) {
                self.sleep.wake_for(now, to, attempts);
                return self.transmit_wake(self.sleep.waking()?, buffer);
            }
            match self.transmit_message(place, now, buffer) {
                Some(len) => return Some(len),
                // A stranger is asked first.
                None => {
                    if let Some(len) = self.transmit_reply(now, buffer) {
                        return Some(len);
                    }
                }
            }
        }
        self.transmit_presence(now, buffer)
    }

    /// An empty frame, which wakes this node or all.
    fn transmit_wake(&mut self, to: ShortAddress, buffer: &mut [u8; FRAME_MAX]) -> Option<usize> {
        let Attachment { pan, short } = self.attachment?;
        let header = Header {
            destination: Panned::new(pan, Address::Short(to)),
            source: Panned::compressed(Address::Short(short)),
            ..Header::new(FrameType::Data, self.next_sequence())
        };
        header.emit(buffer).ok()
    }

    fn transmit_presence(&mut self, now: Instant, buffer: &mut [u8; FRAME_MAX]) -> Option<usize> {
        let short = self.short()?;
        self.presence.due.filter(|due| *due <= now)?;
        if !self.presence.always && self.presence.until.is_none_or(|until| until <= now) {
            self.presence.due = None;
            return None;
        }
        self.presence.due = Some(now + self.presence_pause());
        let mut payload = [0; 1];
        let len = Packet::Presence.emit(&mut payload).ok()?;
        let everybody = Address::Short(ShortAddress::BROADCAST);
        let payload = payload.get(..len)?;
        let sealed = self.seal(false, Address::Short(short), everybody, payload, buffer);
        sealed.ok().map(|(len, _)| len)
    }

    fn transmit_reply(&mut self, now: Instant, buffer: &mut [u8; FRAME_MAX]) -> Option<usize> {
        let short = self.attachment?.short;
        let reply = self.replies.take(|reply| reply.due <= now)?;
        let (source, packet) = match reply.kind {
            ReplyKind::Acknowledgement { counter } => {
                (Address::Short(short), Packet::Acknowledgement { counter })
            }
            // From the extended address, which gives the nonce to a node that knows no other.
            ReplyKind::Challenge { .. } => (self.own_extended(), Packet::Challenge),
            ReplyKind::Response {
                counter,
                challenges,
            } => {
                let packet = Packet::Response {
                    challenges,
                    short,
                    counter,
                };
                (self.own_extended(), packet)
            }
        };
        let mut payload = [0; 8];
        let len = packet.emit(&mut payload).ok()?;
        // Without a frame counter the reply is lost, and the peer asks again.
        let under_next = matches!(reply.kind, ReplyKind::Challenge { under_next: true });
        let payload = payload.get(..len)?;
        let sealed = self.seal(under_next, source, reply.destination, payload, buffer);
        let (len, counter) = sealed.ok()?;
        if reply.asks() {
            self.challenges.asked(now, reply.destination, counter);
        }
        Some(len)
    }

    fn transmit_message(
        &mut self,
        place: usize,
        now: Instant,
        buffer: &mut [u8; FRAME_MAX],
    ) -> Option<usize> {
        let copies = self.copies();
        let outgoing = self.outgoing.get_mut(place)?;
        let (kind, destination) = (outgoing.kind, outgoing.destination);
        let is_known = self.session.peers.by_short(destination).is_some();
        // The age must fit its byte; see the packet format.
        let first = outgoing.counters.map(|(first, _)| first);
        if kind == Kind::Unicast && first.is_some() {
            self.at_once = 0;
            self.losses = (self.losses + LOSS).min(LOSSES);
        }
        let age = first.map_or(0, |first| {
            self.session.counter.upcoming().saturating_sub(first)
        });
        if outgoing.attempts >= ATTEMPTS || age > u32::from(u8::MAX) {
            outgoing.result = Some(Delivery::NoAnswer);
            return None;
        }
        let target = Address::Short(destination);
        if kind != Kind::Broadcast && !is_known {
            outgoing.attempted(now, &mut self.jitter, copies);
            self.challenge(now, target);
            return None;
        }
        let mut payload = [0; MESSAGE_HEADER + MESSAGE_MAX];
        let packet = Packet::Message {
            kind,
            age: age as u8,
            bytes: &outgoing.bytes,
        };
        let message_len = outgoing.bytes.len();
        let len = packet.emit(&mut payload).ok()?;
        let is_short = message_len + 6 <= MESSAGE_MAX;
        let source = if kind == Kind::Broadcast && is_short && self.introductions > 0 {
            self.introductions -= 1;
            self.own_extended()
        } else {
            Address::Short(self.attachment?.short)
        };
        let sealed = self.seal(false, source, target, payload.get(..len)?, buffer);
        let outgoing = self.outgoing.get_mut(place)?;
        // Without a frame counter, too: the attempts come to an end.
        outgoing.attempted(now, &mut self.jitter, copies);
        let (len, counter) = sealed.ok()?;
        outgoing.transmitted(counter);
        if kind == Kind::Broadcast && self.authority.is_some() {
            self.presence.due = Some(now + self.presence_pause());
            self.presence.until = Some(now + PRESENT_FOR);
        }
        Some(len)
    }

    fn presence_pause(&mut self) -> Duration {
        let mean = match self.losses {
            LOSSY.. => PRESENCE_IN_LOSSY_AIR,
            _ => PRESENCE,
        };
        self.jitter.around(mean)
    }

    /// Transmissions of a broadcast, as the air has been lately.
    const fn copies(&self) -> u8 {
        if self.introductions == 0 && self.at_once >= AT_ONCE {
            1
        } else {
            BROADCAST_COPIES
        }
    }

    const fn own_extended(&self) -> Address {
        Address::Extended(self.session.extended())
    }

    fn seal(
        &mut self,
        under_next: bool,
        source: Address,
        destination: Address,
        payload: &[u8],
        buffer: &mut [u8; FRAME_MAX],
    ) -> Result<(usize, u32), SealError> {
        let pan = self
            .attachment
            .map_or(PanId::BROADCAST, |attachment| attachment.pan);
        let header = Header {
            destination: Panned::new(pan, destination),
            source: Panned::compressed(source),
            ..Header::new(FrameType::Data, self.next_sequence())
        };
        let sealed = self
            .session
            .seal_under(under_next, &header, payload, buffer)?;
        Ok((sealed.len, sealed.counter))
    }

    /// The sequence number of the next frame, of whatever layer.
    pub const fn next_sequence(&mut self) -> u8 {
        self.sequence = self.sequence.wrapping_add(1);
        self.sequence
    }

    /// The next key became the one in use, or another was installed, since this was last asked.
    pub(crate) const fn take_keys_changed(&mut self) -> bool {
        core::mem::replace(&mut self.keys_changed, false)
    }
}

#[cfg(feature = "defmt")]
impl<const PEERS: usize, const QUEUE: usize> defmt::Format for Link<PEERS, QUEUE> {
    /// The attachment and the counts: the queues would fill the log.
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(
            f,
            "{} as {}, {}",
            self.session.extended(),
            self.short(),
            self.counts
        );
    }
}
