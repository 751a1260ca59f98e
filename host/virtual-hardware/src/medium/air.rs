//! All transmissions and receptions of a medium.

use std::{collections::VecDeque, task::Waker};

use slab::Slab;
use zigbee_link::{
    radio::{
        Channel, FCS_LEN, FRAME_MIN, PSDU_MAX, RadioConfig, Received, SAMPLE, SAMPLE_PERIOD,
        TxOutcome,
    },
    wire::{fcs, has_good_fcs},
};

use super::{
    Abilities, Arrival, Counters, Ear, Event, NodeId, Place, Reason, Watcher,
    disturbance::Disturbances,
    filter,
    links::Links,
    propagation::{Link, Propagation, Thresholds},
};
use crate::{
    executor::{EventId, Time},
    random::{mix, share},
};

const MICROSECOND: Time = 1_000;
/// Eight symbols.
const ASSESSMENT: Time = 128 * MICROSECOND;
/// `aTurnaroundTime`, twelve symbols.
const TURNAROUND: Time = 192 * MICROSECOND;
const BYTE: Time = 32 * MICROSECOND;
/// Preamble, delimiter and length.
const PHY_HEADER: usize = 6;
/// Frames that a radio with a queue holds.
const QUEUE: usize = 8;
/// LQI grows to 255 over so many dB above the sensitivity.
const LQI_SPAN: f32 = 40.0;
/// The sensitivity that LQI refers to where the model has none, dBm.
const LQI_ZERO: f32 = -95.0;

/// Event that is due for a transmission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Due {
    /// A node has looked at the channel.
    Assessed(u32),
    /// A node begins to send.
    Start(u32),
    /// A transmission is over.
    End(u32),
}

impl Due {
    pub(super) fn token(self) -> u64 {
        let (kind, number) = match self {
            Self::Assessed(node) => (0, node),
            Self::Start(node) => (1, node),
            Self::End(transmission) => (2, transmission),
        };
        u64::from(number) << 2 | kind
    }

    pub(super) fn of(token: u64) -> Self {
        let number = (token >> 2) as u32;
        match token & 3 {
            0 => Self::Assessed(number),
            1 => Self::Start(number),
            _ => Self::End(number),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sending {
    Idle,
    Assessing,
    Turning,
    OnAir(u32),
}

/// A carrier at a receiver.
#[derive(Clone, Copy)]
struct Carrier {
    transmission: u32,
    strength: f32,
}

/// The frame that a receiver stays with.
struct Lock {
    transmission: u32,
    strength: f32,
    loss: f32,
    broken: Option<Reason>,
}

pub(super) struct Node {
    /// Ear of a radio elsewhere.
    pub(super) ear: Option<Box<dyn Ear>>,
    pub(super) config: Option<RadioConfig>,
    /// Time of the last configuration, from which on a radio that samples counts its periods.
    configured: Time,
    abilities: Abilities,
    counters: Counters,
    carriers: Vec<Carrier>,
    lock: Option<Lock>,
    sending: Sending,
    /// The event that a power cut takes off the plan.
    event: Option<EventId>,
    /// Next frame to send: PSDU as handed over, channel, power.
    frame: Vec<u8>,
    channel: Channel,
    pub(super) power: i8,
    pub(super) outcome: Option<TxOutcome>,
    pub(super) sender: Option<Waker>,
    pub(super) queue: VecDeque<(Received, [u8; PSDU_MAX])>,
    pub(super) receiver: Option<Waker>,
}

impl Node {
    pub(super) fn is_idle(&self) -> bool {
        self.sending == Sending::Idle
    }

    fn finish(&mut self, outcome: TxOutcome) {
        self.sending = Sending::Idle;
        self.outcome = Some(outcome);
        if let Some(waker) = self.sender.take() {
            waker.wake();
        }
    }

    /// Returns true if the radio listens, so that it receives a frame that begins now.
    fn listens(&self, now: Time) -> bool {
        let is_sampled = self.config.is_some_and(|config| config.sampled);
        let within = (now - self.configured) % SAMPLE_PERIOD.as_nanos() as Time;
        !is_sampled || within < SAMPLE.as_nanos() as Time
    }

    /// Returns true if a frame of this strength stands out from all others, dBm.
    fn stands_out(&self, transmission: u32, strength: f32, thresholds: Thresholds) -> bool {
        stands_out(&self.carriers, transmission, strength, thresholds)
    }
}

/// Returns true if a frame of this strength stands out from all other carriers on its channel, dBm.
fn stands_out(
    carriers: &[Carrier],
    transmission: u32,
    strength: f32,
    thresholds: Thresholds,
) -> bool {
    let others = carriers
        .iter()
        .filter(|carrier| carrier.transmission != transmission);
    let Some(capture) = thresholds.capture else {
        return others.count() == 0;
    };
    let milliwatts = |dbm: f32| libm::exp10f(dbm / 10.0);
    let sum: f32 = others.map(|carrier| milliwatts(carrier.strength)).sum();
    sum == 0.0 || milliwatts(strength - capture) >= sum
}

struct Transmission {
    from: u32,
    /// Number among the frames of its sender.
    number: u64,
    channel: Channel,
    start: Time,
    /// PSDU, FCS included unless `is_sealed`.
    bytes: Vec<u8>,
    /// The radio appends a correct FCS, which need not be computed.
    is_sealed: bool,
    is_cut: bool,
    /// Nodes that hear at least a carrier.
    hearers: Vec<u32>,
}

impl Transmission {
    /// Without FCS.
    fn frame(&self) -> &[u8] {
        if self.is_sealed {
            &self.bytes
        } else {
            &self.bytes[..self.bytes.len() - FCS_LEN]
        }
    }

    fn is_intact(&self) -> bool {
        self.is_sealed || has_good_fcs(&self.bytes)
    }

    fn psdu_len(&self) -> usize {
        self.frame().len() + FCS_LEN
    }
}

pub(super) struct Air {
    pub(super) links: Links,
    pub(super) disturbances: Disturbances,
    pub(super) watchers: Vec<Box<dyn Watcher>>,
    seed: u64,
    thresholds: Thresholds,
    nodes: Vec<Node>,
    /// Those on the air.
    transmissions: Slab<Transmission>,
    /// Bytes and hearers of those that are over.
    spare: Vec<(Vec<u8>, Vec<u32>)>,
    /// Radios on each channel.
    listeners: [u64; CHANNELS],
    /// The channel of each node's radio: most of those in reach of a frame are on another one, and are passed
    /// over without a look at all the rest of them.
    tuned: Vec<Tuned>,
}

/// Channel to which a radio listens.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Tuned {
    Off,
    To(Channel),
    /// A radio elsewhere tells itself.
    Elsewhere,
}

const CHANNELS: usize = (Channel::LAST.number() - Channel::FIRST.number()) as usize + 1;

fn index(channel: Channel) -> usize {
    usize::from(channel.number() - Channel::FIRST.number())
}

impl Air {
    pub(super) fn new(propagation: Propagation, seed: u64) -> Self {
        Self {
            thresholds: propagation.thresholds(),
            links: Links::new(propagation, seed),
            disturbances: Disturbances::default(),
            watchers: Vec::new(),
            seed,
            nodes: Vec::new(),
            transmissions: Slab::new(),
            spare: Vec::new(),
            listeners: [0; CHANNELS],
            tuned: Vec::new(),
        }
    }

    /// A node has a radio elsewhere from now on, or no longer; returns that of before.
    pub(super) fn set_ear(
        &mut self,
        id: NodeId,
        ear: Option<Box<dyn Ear>>,
    ) -> Option<Box<dyn Ear>> {
        let old = std::mem::replace(&mut self.node_mut(id).ear, ear);
        self.retune(id);
        old
    }

    fn retune(&mut self, id: NodeId) {
        let node = self.node(id);
        self.tuned[id.0 as usize] = match (&node.ear, &node.config) {
            (Some(_), _) => Tuned::Elsewhere,
            (None, Some(config)) => Tuned::To(config.channel),
            (None, None) => Tuned::Off,
        };
    }

    pub(super) fn add(&mut self, place: Place) -> NodeId {
        self.tuned.push(Tuned::Off);
        self.nodes.push(Node {
            ear: None,
            config: None,
            configured: 0,
            abilities: Abilities::default(),
            counters: Counters::default(),
            carriers: Vec::new(),
            lock: None,
            sending: Sending::Idle,
            event: None,
            frame: Vec::new(),
            channel: Channel::FIRST,
            power: 0,
            outcome: None,
            sender: None,
            queue: VecDeque::new(),
            receiver: None,
        });
        NodeId(self.links.add(place))
    }

    pub(super) fn node(&self, node: NodeId) -> &Node {
        &self.nodes[node.0 as usize]
    }

    pub(super) fn node_mut(&mut self, node: NodeId) -> &mut Node {
        &mut self.nodes[node.0 as usize]
    }

    pub(super) fn counters(&self, node: NodeId) -> Counters {
        self.node(node).counters
    }

    pub(super) fn totals(&self) -> Counters {
        let mut totals = Counters::default();
        for node in &self.nodes {
            totals += node.counters;
        }
        totals
    }

    fn tell(&mut self, at: Time, event: Event<'_>) {
        for watcher in &mut self.watchers {
            watcher.event(at, event);
        }
    }

    fn drop_at(&mut self, now: Time, by: u32, from: u32, reason: Reason) {
        self.nodes[by as usize].counters.drop(reason, 1);
        let (from, by) = (NodeId(from), NodeId(by));
        self.tell(now, Event::Dropped { from, by, reason });
    }

    /// Channels that a disturbance jams at a node now.
    pub(super) fn jammed(&self, now: Time, node: NodeId) -> Vec<Channel> {
        let place = self.links.place(node.0);
        let all = Channel::FIRST.number()..=Channel::LAST.number();
        all.filter_map(Channel::new)
            .filter(|&channel| self.disturbances.jams(now..now, channel, place))
            .collect()
    }

    pub(super) fn switch_on(&mut self, node: NodeId, abilities: Abilities) {
        self.node_mut(node).abilities = abilities;
    }

    /// Returns an event that must not come any more.
    pub(super) fn switch_off(&mut self, id: NodeId) -> Option<EventId> {
        if let Some(config) = self.node_mut(id).config.take() {
            self.listeners[index(config.channel)] -= 1;
        }
        self.retune(id);
        let node = &mut self.nodes[id.0 as usize];
        node.carriers.clear();
        node.lock = None;
        node.queue.clear();
        node.outcome = None;
        node.sender = None;
        node.receiver = None;
        let event = node.event.take();
        match std::mem::replace(&mut node.sending, Sending::Idle) {
            Sending::OnAir(transmission) => {
                self.transmissions[transmission as usize].is_cut = true;
                None
            }
            Sending::Idle | Sending::Assessing | Sending::Turning => event,
        }
    }

    pub(super) fn configure(&mut self, now: Time, id: NodeId, config: RadioConfig) {
        let node = self.node_mut(id);
        node.configured = now;
        let old = node.config.replace(config);
        self.retune(id);
        if old.is_some_and(|old| old.channel == config.channel) {
            return;
        }
        if let Some(old) = old {
            self.listeners[index(old.channel)] -= 1;
        }
        self.listeners[index(config.channel)] += 1;
        let node = &mut self.nodes[id.0 as usize];
        node.lock = None;
        node.carriers.clear();
        // Carriers on the new channel are heard; their frames began too early.
        for (number, transmission) in &mut self.transmissions {
            if transmission.channel != config.channel {
                continue;
            }
            let power = self.nodes[transmission.from as usize].power;
            let links = self.links.of(transmission.from);
            let Ok(at) = links.binary_search_by_key(&id.0, |link| link.to) else {
                continue;
            };
            let link = links[at];
            transmission.hearers.push(id.0);
            self.nodes[id.0 as usize].carriers.push(Carrier {
                transmission: number as u32,
                strength: self.links.propagation.received(link, power),
            });
        }
    }

    /// Takes over a frame to be sent. Returns the next event, and its time.
    pub(super) fn begin(&mut self, now: Time, id: NodeId, frame: &[u8]) -> (Time, Due) {
        let node = self.node_mut(id);
        node.sending = Sending::Assessing;
        node.outcome = None;
        node.frame.clear();
        node.frame.extend_from_slice(frame);
        if let Some(config) = &node.config {
            (node.channel, node.power) = (config.channel, config.tx_power);
        }
        (now + ASSESSMENT, Due::Assessed(id.0))
    }

    pub(super) fn planned(&mut self, due: Due, event: EventId) {
        if let Due::Assessed(node) | Due::Start(node) = due {
            self.nodes[node as usize].event = Some(event);
        }
    }

    /// Something is due. Returns the next event, and its time.
    pub(super) fn event(&mut self, now: Time, due: Due) -> Option<(Time, Due)> {
        match due {
            Due::Assessed(node) => self.assessed(now, node),
            Due::Start(node) => Some(self.start(now, node)),
            Due::End(transmission) => {
                self.end(now, transmission);
                None
            }
        }
    }

    fn assessed(&mut self, now: Time, id: u32) -> Option<(Time, Due)> {
        let clear = self.thresholds.clear_channel;
        let node = &mut self.nodes[id as usize];
        let is_jammed = self
            .disturbances
            .jams(now..now, node.channel, self.links.place(id));
        if is_jammed
            || node
                .carriers
                .iter()
                .any(|carrier| carrier.strength >= clear)
        {
            node.finish(TxOutcome::ChannelBusy);
            self.drop_at(now, id, id, Reason::Busy);
            return None;
        }
        node.sending = Sending::Turning;
        if let Some(lock) = node.lock.take() {
            let from = self.transmissions[lock.transmission as usize].from;
            self.drop_at(now, id, from, Reason::HalfDuplex);
        }
        Some((now + TURNAROUND, Due::Start(id)))
    }

    fn start(&mut self, now: Time, id: u32) -> (Time, Due) {
        let node = &mut self.nodes[id as usize];
        let channel = node.channel;
        let is_sealed = node.abilities.fcs;
        let frame = std::mem::take(&mut node.frame);
        let number = self.put(now, id, channel, &frame, is_sealed);
        let node = &mut self.nodes[id as usize];
        node.frame = frame;
        node.sending = Sending::OnAir(number);
        (self.end_of(number), Due::End(number))
    }

    pub(super) fn inject(
        &mut self,
        now: Time,
        from: NodeId,
        channel: Channel,
        psdu: &[u8],
    ) -> (Time, Due) {
        let number = self.put(now, from.0, channel, psdu, false);
        (self.end_of(number), Due::End(number))
    }

    fn end_of(&self, number: u32) -> Time {
        let transmission = &self.transmissions[number as usize];
        transmission.start + (PHY_HEADER + transmission.psdu_len()) as Time * BYTE
    }

    /// Puts a frame on the air.
    fn put(
        &mut self,
        now: Time,
        from: u32,
        channel: Channel,
        bytes: &[u8],
        is_sealed: bool,
    ) -> u32 {
        let counters = &mut self.nodes[from as usize].counters;
        counters.frames += 1;
        let (mut buffer, hearers) = self.spare.pop().unwrap_or_default();
        buffer.extend_from_slice(bytes);
        let transmission = Transmission {
            from,
            number: counters.frames,
            channel,
            start: now,
            bytes: buffer,
            is_sealed,
            is_cut: false,
            hearers,
        };
        let len = transmission.psdu_len();
        counters.bytes += len as u64;
        counters.airtime += (PHY_HEADER + len) as Time * BYTE;
        for watcher in &mut self.watchers {
            let (from, frame) = (NodeId(from), transmission.frame());
            watcher.event(
                now,
                Event::Sent {
                    from,
                    channel,
                    frame,
                },
            );
        }
        let slot = self.transmissions.insert(transmission) as u32;
        self.spread(now, slot);
        slot
    }

    /// Every node in reach hears a new carrier.
    fn spread(&mut self, now: Time, slot: u32) {
        let Transmission { from, channel, .. } = self.transmissions[slot as usize];
        let power = self.nodes[from as usize].power;
        let mut audible = 0;
        let links = self.links.of(from).len();
        for at in 0..links {
            let link = self.links.of(from)[at];
            let tuned = self.tuned[link.to as usize];
            let has_ear = tuned == Tuned::Elsewhere;
            if !has_ear && tuned != Tuned::To(channel) {
                continue;
            }
            let strength = self.links.propagation.received(link, power);
            if strength < self.thresholds.floor {
                continue;
            }
            if has_ear {
                self.tell_ear(now, slot, link, strength);
                continue;
            }
            if self.disturbances.separates(now, from, link.to) {
                audible += 1;
                self.drop_at(now, link.to, from, Reason::Partitioned);
                continue;
            }
            self.transmissions[slot as usize].hearers.push(link.to);
            let is_strong = strength >= self.thresholds.sensitivity;
            audible += u64::from(is_strong);
            if let Some(reason) = self.hear(now, slot, link, strength, is_strong) {
                self.drop_at(now, link.to, from, reason);
            }
        }
        let is_own = self.nodes[from as usize]
            .config
            .is_some_and(|config| config.channel == channel);
        let others = self.listeners[index(channel)] - u64::from(is_own);
        let counters = &mut self.nodes[from as usize].counters;
        counters.drop(Reason::OutOfRange, others - audible);
    }

    /// A carrier begins at a radio elsewhere. Returns true if it stands out there, and the senders whose frames do
    /// not any more.
    fn overlap(&mut self, slot: u32, link: Link, strength: f32) -> (bool, Vec<NodeId>) {
        let channel = self.transmissions[slot as usize].channel;
        let node = &mut self.nodes[link.to as usize];
        let carrier = Carrier {
            transmission: slot,
            strength,
        };
        node.carriers.push(carrier);
        let on_channel = |carrier: &&Carrier| {
            let transmission = self.transmissions.get(carrier.transmission as usize);
            transmission.is_some_and(|transmission| transmission.channel == channel)
        };
        let carriers: Vec<Carrier> = node.carriers.iter().filter(on_channel).copied().collect();
        let stands_out = |carrier: &Carrier| {
            stands_out(
                &carriers,
                carrier.transmission,
                carrier.strength,
                self.thresholds,
            )
        };
        let spoilt = { carriers.iter() }
            .filter(|other| other.transmission != slot && !stands_out(other))
            .map(|other| NodeId(self.transmissions[other.transmission as usize].from));
        let spoils = spoilt.collect();
        let is_clear = stands_out(&carrier);
        self.transmissions[slot as usize].hearers.push(link.to);
        (is_clear, spoils)
    }

    /// A frame begins at a radio elsewhere.
    fn tell_ear(&mut self, now: Time, slot: u32, link: Link, strength: f32) {
        let Transmission { from, channel, .. } = self.transmissions[slot as usize];
        if self.disturbances.separates(now, from, link.to) {
            self.drop_at(now, link.to, from, Reason::Partitioned);
            return;
        }
        let (stands_out, spoils) = self.overlap(slot, link, strength);
        let transmission = &self.transmissions[slot as usize];
        let during = now..self.end_of(slot);
        let place = self.links.place(link.to);
        let lost = if strength < self.thresholds.sensitivity {
            Some(Reason::OutOfRange)
        } else if self.is_lost(during.end, transmission, link.to, link.loss) {
            Some(Reason::Loss)
        } else {
            let is_jammed = self.disturbances.jams(during, channel, place);
            is_jammed.then_some(Reason::Jammed)
        };
        if let Some(ear) = &mut self.nodes[link.to as usize].ear {
            ear.hear(Arrival {
                from: NodeId(from),
                channel,
                psdu: &transmission.bytes,
                strength,
                lost,
                stands_out,
                spoils: &spoils,
            });
        }
        if let Some(reason) = lost {
            self.drop_at(now, link.to, from, reason);
        }
    }

    /// Returns true if a link loses a frame by chance.
    fn is_lost(&self, end: Time, transmission: &Transmission, by: u32, loss: f32) -> bool {
        let kept = (1.0 - f64::from(loss)) * (1.0 - self.disturbances.loss(end));
        share(mix(self.chance(transmission, by))) >= kept
    }

    fn chance(&self, transmission: &Transmission, by: u32) -> u64 {
        mix(self.seed ^ mix(transmission.number))
            ^ u64::from(transmission.from) << 32
            ^ u64::from(by)
    }

    /// A carrier begins at a receiver. Returns the reason why its frame is lost already.
    fn hear(
        &mut self,
        now: Time,
        slot: u32,
        link: Link,
        strength: f32,
        is_strong: bool,
    ) -> Option<Reason> {
        let thresholds = self.thresholds;
        let node = &mut self.nodes[link.to as usize];
        node.carriers.push(Carrier {
            transmission: slot,
            strength,
        });
        if matches!(node.sending, Sending::Turning | Sending::OnAir(_)) {
            return is_strong.then_some(Reason::HalfDuplex);
        }
        if !node.listens(now) {
            return is_strong.then_some(Reason::NotListening);
        }
        if let Some(mut lock) = node.lock.take() {
            if !node.stands_out(lock.transmission, lock.strength, thresholds) {
                lock.broken = lock.broken.or(Some(Reason::Collision));
            }
            node.lock = Some(lock);
            return is_strong.then_some(Reason::Collision);
        }
        if is_strong {
            let stands_out = node.stands_out(slot, strength, thresholds);
            node.lock = Some(Lock {
                transmission: slot,
                strength,
                loss: link.loss,
                broken: (!stands_out).then_some(Reason::Collision),
            });
        }
        None
    }

    fn end(&mut self, now: Time, slot: u32) {
        let transmission = self.transmissions.remove(slot as usize);
        let sender = &mut self.nodes[transmission.from as usize];
        if sender.sending == Sending::OnAir(slot) {
            sender.finish(TxOutcome::Sent);
        }
        for &hearer in &transmission.hearers {
            let node = &mut self.nodes[hearer as usize];
            node.carriers.retain(|carrier| carrier.transmission != slot);
            if let Some(lock) = node.lock.take_if(|lock| lock.transmission == slot) {
                match self.arrive(now, hearer, &transmission, &lock) {
                    Some(reason) => self.drop_at(now, hearer, transmission.from, reason),
                    None => {
                        self.nodes[hearer as usize].counters.received += 1;
                        let (from, by) = (NodeId(transmission.from), NodeId(hearer));
                        self.tell(now, Event::Received { from, by });
                    }
                }
            }
        }
        let Transmission {
            mut bytes,
            mut hearers,
            ..
        } = transmission;
        bytes.clear();
        hearers.clear();
        self.spare.push((bytes, hearers));
    }

    /// A frame is over at the receiver that stayed with it. Returns the reason why it is lost, if it is.
    fn arrive(
        &mut self,
        now: Time,
        by: u32,
        transmission: &Transmission,
        lock: &Lock,
    ) -> Option<Reason> {
        if self.is_lost(now, transmission, by, lock.loss) {
            return Some(Reason::Loss);
        }
        let chance = self.chance(transmission, by);
        let place = self.links.place(by);
        let during = transmission.start..now;
        let damage = if transmission.is_cut {
            Some(Reason::CutOff)
        } else if lock.broken.is_some() {
            lock.broken
        } else {
            let is_jammed = self.disturbances.jams(during, transmission.channel, place);
            is_jammed.then_some(Reason::Jammed)
        };
        let node = &mut self.nodes[by as usize];
        let config = node.config?;
        if node.abilities.fcs && damage.is_some() {
            return damage;
        }
        if node.abilities.fcs && !transmission.is_intact() {
            return Some(Reason::Corrupted);
        }
        let is_wanted = !node.abilities.address_filter
            || config.promiscuous
            || filter::accepts(&config, transmission.frame());
        if !is_wanted {
            return Some(Reason::Filtered);
        }
        if !node.abilities.rx_queue && node.receiver.is_none() {
            return Some(Reason::NotListening);
        }
        if node.queue.len() >= if node.abilities.rx_queue { QUEUE } else { 1 } {
            return Some(Reason::QueueFull);
        }
        let frame = transmission.frame();
        let mut bytes = [0; PSDU_MAX];
        bytes[..frame.len()].copy_from_slice(frame);
        let mut len = frame.len();
        if !node.abilities.fcs {
            len = transmission.psdu_len();
            let check = if transmission.is_sealed {
                fcs(frame).to_le_bytes()
            } else {
                [transmission.bytes[len - 2], transmission.bytes[len - 1]]
            };
            bytes[frame.len()..len].copy_from_slice(&check);
            if damage.is_some() {
                spoil(&mut bytes[..len], chance);
            }
        }
        let zero = if self.thresholds.sensitivity.is_finite() {
            self.thresholds.sensitivity
        } else {
            LQI_ZERO
        };
        let received = Received {
            len,
            channel: transmission.channel,
            // Saturating casts.
            rssi: Some(lock.strength.round() as i8),
            lqi: Some(((lock.strength - zero) * 255.0 / LQI_SPAN) as u8),
        };
        node.queue.push_back((received, bytes));
        if let Some(waker) = &node.receiver {
            waker.wake_by_ref();
        }
        damage
    }
}

/// Damages the second half of a frame.
fn spoil(bytes: &mut [u8], chance: u64) {
    let random = mix(chance ^ 1 << 62);
    let half = (bytes.len() / 2).max(FRAME_MIN).min(bytes.len());
    for (place, byte) in (0..).zip(&mut bytes[half..]) {
        *byte = mix(random ^ place) as u8;
    }
}
