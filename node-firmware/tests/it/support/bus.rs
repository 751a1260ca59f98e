//! Roles, connected directly. The radio in between is ideal, or has the faults of radios.
//!
//! Facts that roles save go through a real [`FactStore`] in a flash of their own, and every message is
//! encoded and decoded, so a restart and the wire are tested along the way. Three things are required of
//! every role whenever it wants nothing more: that this took a bounded number of polls, that its deadline
//! lies in the future, and that all it sent fits a frame.

use std::collections::{BTreeSet, VecDeque};

use embassy_futures::block_on;
use node_firmware::{
    facts::{Fact, FactStore},
    message::Message,
    role::{Output, Role},
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use zigbee_link::{
    Instant,
    link::MESSAGE_MAX,
    wire::{PanId, ShortAddress},
};

use node_firmware::network::{Attachment, NetworkIdentity};

use super::flash::{Flash, chip, length};

/// Two pages of 4 KiB, as on the boards.
const LEN: u32 = length(32);

/// A station's memory is its own.
const OWNER: u32 = 1;

/// The most outputs of a role at one time.
const POLLS: usize = 200;

/// Effects of the radio on messages.
#[derive(Clone, Copy, Debug, Default)]
pub struct Faults {
    /// Share of messages that are lost, and of those that arrive, but of which the sender does not
    /// hear that they did.
    pub loss: f64,
    /// Share of messages that come twice.
    pub double: f64,
    /// The most a message is late, microseconds. So they overtake each other.
    pub delay: u64,
}

/// Nothing.
pub const PERFECT: Faults = Faults {
    loss: 0.0,
    double: 0.0,
    delay: 0,
};

struct OnTheWay {
    at: u64,
    from: ShortAddress,
    to: ShortAddress,
    bytes: Vec<u8>,
}

/// The radio.
pub struct Air {
    pub faults: Faults,
    pub sent: Vec<Sent>,
    queue: Vec<OnTheWay>,
    rng: ChaCha8Rng,
}

/// A message that was sent, for tests to see.
#[derive(Clone, Debug)]
pub struct Sent {
    pub at: u64,
    pub from: ShortAddress,
    pub to: ShortAddress,
    pub message: Message,
}

impl Air {
    pub fn new(faults: Faults, seed: u64) -> Self {
        Self {
            faults,
            sent: Vec::new(),
            queue: Vec::new(),
            rng: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// Sends a message; returns true if the sender hears that it arrived.
    fn send(&mut self, now: u64, from: ShortAddress, to: ShortAddress, message: Message) -> bool {
        let mut buffer = [0; 256];
        let bytes = postcard::to_slice(&message, &mut buffer).unwrap();
        assert!(bytes.len() <= MESSAGE_MAX, "{message:?} is too long");
        let bytes = bytes.to_vec();
        self.sent.push(Sent {
            at: now,
            from,
            to,
            message,
        });
        let Faults {
            loss,
            double,
            delay,
        } = self.faults;
        let is_broadcast = to == ShortAddress::BROADCAST;
        if self.rng.random_bool(loss) {
            return is_broadcast;
        }
        for _ in 0..1 + u8::from(self.rng.random_bool(double)) {
            self.queue.push(OnTheWay {
                at: now + 5_000 + self.rng.random_range(0..=delay),
                from,
                to,
                bytes: bytes.clone(),
            });
        }
        is_broadcast || !self.rng.random_bool(loss)
    }
}

/// Effect of a task on the devices of a role: an event, and its time.
pub type Devices<R> = Box<dyn FnMut(u64, <R as Role>::Task) -> Option<(u64, <R as Role>::Event)>>;

/// A role with its flash and its devices.
pub struct Station<R: Role> {
    pub role: R,
    pub address: ShortAddress,
    /// The network it is in.
    pub pan: PanId,
    pub facts: Vec<Fact>,
    make: Box<dyn Fn() -> R>,
    devices: Devices<R>,
    flash: Flash,
    settled: VecDeque<(u64, R::Notification, bool)>,
    events: Vec<(u64, R::Event)>,
    /// Sends nothing and hears nothing.
    pub is_off: bool,
    /// Sends nothing.
    pub is_mute: bool,
    /// Its power fails when it has written down so many more facts.
    pub facts_left: Option<usize>,
}

impl<R: Role> Station<R> {
    pub fn new(address: u16, make: impl Fn() -> R + 'static, devices: Devices<R>) -> Self {
        Self {
            role: make(),
            address: ShortAddress(address),
            pan: PanId(0x1234),
            facts: Vec::new(),
            make: Box::new(make),
            devices,
            flash: chip(32, address.into()),
            settled: VecDeque::new(),
            events: Vec::new(),
            is_off: false,
            is_mute: false,
            facts_left: None,
        }
    }

    fn membership(&self) -> Attachment {
        Attachment {
            network: NetworkIdentity {
                number: self.pan.0,
                founder: [2, 0, 0, 0, 0, 0, 0, 0],
            },
            own: self.address.0,
        }
    }

    pub fn attach(&mut self, now: u64) {
        self.role.on_attached(Instant(now), Some(self.membership()));
    }

    /// It hears nothing of its network any more.
    pub fn detach(&mut self, now: u64) {
        self.role.on_attached(Instant(now), None);
    }

    /// It belongs to this network from now on.
    pub fn join(&mut self, now: u64, pan: u16, address: u16) {
        (self.pan, self.address) = (PanId(pan), ShortAddress(address));
        self.attach(now);
    }

    /// Its flash is erased.
    pub fn erase(&mut self) {
        self.flash = chip(32, self.address.0.into());
        self.facts.clear();
    }

    /// Power off and on: only the flash is left.
    pub fn restart(&mut self, now: u64) {
        self.role = (self.make)();
        self.settled.clear();
        self.events.clear();
        let role = &mut self.role;
        block_on(async {
            let mut memory = FactStore::open(&mut self.flash, 0..LEN, OWNER)
                .await
                .unwrap();
            memory.recall(|fact| role.restore(fact)).await.unwrap();
        });
        self.attach(now);
    }

    /// The record of this fact rots away.
    pub fn lose(&mut self, fact: &Fact) {
        let mut value = [0; 96];
        let value = postcard::to_slice(fact, &mut value).unwrap();
        // The variant and the place in its list, behind version and key.
        let mut bytes = self.flash.bytes_mut();
        let banks = bytes.chunks_mut(LEN as usize / 2);
        let slots = banks.flat_map(|bank| bank.chunks_mut(96));
        for slot in slots.filter(|slot| slot[0] == 1 && slot[1] < 128 && slot[2..4] == value[..2]) {
            slot[50] ^= 0xFF;
            slot[60] ^= 0xFF;
        }
    }

    /// Facts that a restart would find.
    pub fn recalled(&mut self) -> Vec<Fact> {
        let mut facts = Vec::new();
        block_on(async {
            let mut memory = FactStore::open(&mut self.flash, 0..LEN, OWNER)
                .await
                .unwrap();
            memory.recall(|fact| facts.push(*fact)).await.unwrap();
        });
        facts
    }

    /// Number of sightings that a restart would find.
    pub fn recalled_sightings(&mut self) -> usize {
        let facts = self.recalled();
        let stops = facts.iter().filter_map(|fact| match fact {
            Fact::Sighting(_, Some(kept)) => Some((kept.target, kept.stop)),
            _ => None,
        });
        stops.collect::<BTreeSet<_>>().len()
    }

    pub fn event(&mut self, at: u64, event: R::Event) {
        self.events.push((at, event));
    }
}

/// A station of any role.
pub trait AnyStation {
    fn address(&self) -> ShortAddress;
    fn hear(&mut self, now: u64, from: ShortAddress, message: &Message);
    /// Does all that is to be done now. Returns the time to call it again.
    fn act(&mut self, now: u64, air: &mut Air) -> Option<u64>;
}

impl<R: Role> AnyStation for Station<R> {
    fn address(&self) -> ShortAddress {
        self.address
    }

    fn hear(&mut self, now: u64, from: ShortAddress, message: &Message) {
        if !self.is_off {
            self.role.on_message(Instant(now), from, message);
        }
    }

    fn act(&mut self, now: u64, air: &mut Air) -> Option<u64> {
        if self.facts_left == Some(0) {
            return None;
        }
        while let Some(place) = self.settled.iter().position(|(at, ..)| *at <= now) {
            let (_, notification, delivered) = self.settled.remove(place).unwrap();
            self.role.on_sent(Instant(now), notification, delivered);
        }
        while let Some(place) = self.events.iter().position(|(at, _)| *at <= now) {
            let (_, event) = self.events.remove(place);
            self.role.on_event(Instant(now), event);
        }
        let mut polls = 0;
        self.role.compute(Instant(now));
        while let Some(output) = self.role.poll(Instant(now)) {
            polls += 1;
            assert!(polls < POLLS, "it never has enough");
            match output {
                Output::Send {
                    to,
                    message,
                    notification,
                } => {
                    let is_heard = !self.is_off && !self.is_mute;
                    let delivered = is_heard && air.send(now, self.address, to, message);
                    if let Some(notification) = notification {
                        let after = if delivered { 10_000 } else { 150_000 };
                        self.settled
                            .push_back((now + after, notification, delivered));
                    }
                }
                Output::Save(fact) => {
                    block_on(async {
                        let mut memory = FactStore::open(&mut self.flash, 0..LEN, OWNER)
                            .await
                            .unwrap();
                        memory.save(&fact).await.unwrap();
                    });
                    self.facts.push(fact);
                    if let Some(left) = &mut self.facts_left {
                        *left -= 1;
                        if *left == 0 {
                            return None;
                        }
                    }
                }
                Output::Task(task) => self.events.extend((self.devices)(now, task)),
            }
        }
        let deadline = self.role.next_deadline().map(|deadline| deadline.0);
        assert!(
            deadline.is_none_or(|deadline| deadline > now),
            "it wants nothing, but to be asked again at once"
        );
        let settled = self.settled.iter().map(|(at, ..)| *at);
        let events = self.events.iter().map(|(at, _)| *at);
        settled.chain(events).chain(deadline).min()
    }
}

/// Runs everything that happens until then.
pub fn run(now: &mut u64, until: u64, air: &mut Air, stations: &mut [&mut dyn AnyStation]) {
    loop {
        while let Some(place) = air.queue.iter().position(|on| on.at <= *now) {
            let OnTheWay {
                from, to, bytes, ..
            } = air.queue.remove(place);
            let message: Message = postcard::from_bytes(&bytes).unwrap();
            for station in stations.iter_mut() {
                let is_for = to == station.address() || to == ShortAddress::BROADCAST;
                if is_for && station.address() != from {
                    station.hear(*now, from, &message);
                }
            }
        }
        let next = stations
            .iter_mut()
            .filter_map(|station| station.act(*now, air))
            .min();
        let next = next.into_iter().chain(air.queue.iter().map(|on| on.at));
        *now = next
            .min()
            .unwrap_or(until)
            .clamp(*now + 1, until.max(*now + 1));
        if *now >= until {
            return;
        }
    }
}
