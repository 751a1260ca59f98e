//! Nodes on a lossy medium, in virtual time, without async.

use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use zigbee_link::{
    Instant,
    network::{Action, Channels, NetworkSettings, NetworkStatus, Node},
    radio::{Channel, FRAME_MAX, RadioConfig, SAMPLE, SAMPLE_PERIOD},
    security::Key,
    store::{Member, Record, Saved},
    wire::{Eui64, ShortAddress},
};

pub const MEMBERS: usize = 4;
pub type TestNode = Node<8, 4, MEMBERS>;

pub fn key(index: u8) -> Key {
    Key::new(index, key_bytes(index)).unwrap()
}

pub fn key_bytes(index: u8) -> [u8; 16] {
    core::array::from_fn(|i| 0xC0 + i as u8 + index)
}

pub fn eui(n: usize) -> Eui64 {
    Eui64([2, 0, 0, 0, 0, 0, 0, n as u8])
}

/// A node, its store and its radio. Number 0 is a coordinator, as is every one from 100 on.
pub struct Station {
    pub node: TestNode,
    pub number: usize,
    pub extended: Eui64,
    pub saved: Saved,
    pub members: [Option<Member>; MEMBERS],
    pub config: Option<RadioConfig>,
    /// Time of its last configuration, and time for which its radio has listened until then.
    configured: Instant,
    listened: Duration,
    /// Neither hears nor is heard.
    pub is_out_of_range: bool,
    /// Strength with which it is heard.
    pub strength: u8,
    /// All that it wrote down.
    pub written: Vec<Record>,
}

/// A frame that was on the air.
pub struct OnAir {
    pub at: Instant,
    /// The place of the sender.
    pub from: usize,
    pub channel: Channel,
    pub frame: Vec<u8>,
}

pub struct Aether {
    pub stations: Vec<Station>,
    pub now: Instant,
    pub loss: f64,
    pub rng: ChaCha8Rng,
    pub heard: Vec<OnAir>,
    /// Every application fetches every result as soon as it is there.
    pub fetches_results: bool,
    /// Devices sleep while it is quiet.
    pub sleeps: bool,
}

impl Station {
    /// Time for which its radio has listened.
    pub fn listened(&self, now: Instant) -> Duration {
        let time = now.since(self.configured);
        let is_sampled = self.config.is_some_and(|config| config.sampled);
        let time = match is_sampled {
            true => time * SAMPLE.as_millis() as u32 / SAMPLE_PERIOD.as_millis() as u32,
            false => time,
        };
        self.listened + time
    }

    /// Returns true if it hears a frame that begins now.
    fn listens(&self, now: Instant) -> bool {
        let is_sampled = self.config.is_some_and(|config| config.sampled);
        let time = now.since(self.configured).as_micros() % SAMPLE_PERIOD.as_micros();
        !is_sampled || time < SAMPLE.as_micros()
    }
}

fn settings(number: usize, extended: Eui64, seed: u64) -> NetworkSettings {
    let mut settings = NetworkSettings::new(extended, seed ^ number as u64);
    settings.channels = Channels::only(Channel::new(15).unwrap()).and(Channel::LAST);
    settings
}

impl Aether {
    pub fn new(loss: f64, seed: u64) -> Self {
        Self {
            stations: Vec::new(),
            now: Instant(0),
            loss,
            rng: ChaCha8Rng::seed_from_u64(seed),
            heard: Vec::new(),
            fetches_results: false,
            sleeps: false,
        }
    }

    /// Adds a station that was provisioned with a key, and returns its place.
    pub fn add(&mut self, number: usize, key: Key) -> usize {
        let saved = Saved {
            counter_limit: 0,
            active_key: key,
            next_key: None,
            network: None,
            extended: None,
            former_key: None,
        };
        let members = [None; MEMBERS];
        let node = self.start(number, eui(number), &saved, members);
        self.stations.push(Station {
            node,
            number,
            extended: eui(number),
            saved,
            members,
            config: None,
            configured: self.now,
            listened: Duration::ZERO,
            is_out_of_range: false,
            strength: 100,
            written: Vec::new(),
        });
        self.stations.len() - 1
    }

    fn start(
        &mut self,
        number: usize,
        extended: Eui64,
        saved: &Saved,
        members: [Option<Member>; MEMBERS],
    ) -> TestNode {
        let mut settings = settings(number, extended, self.rng.random());
        settings.sleeps = self.sleeps;
        if number == 0 || number >= 100 {
            Node::coordinator(settings, saved, members)
        } else {
            Node::device(self.now, settings, saved)
        }
    }

    /// Power off and on again: only the store survives.
    pub fn restart(&mut self, place: usize) {
        let station = &self.stations[place];
        let (number, saved, members) = (station.number, station.saved, station.members);
        let extended = station.extended;
        self.stations[place].node = self.start(number, extended, &saved, members);
        self.stations[place].config = None;
    }

    /// Power off and on again with an erased store: it gets this key, and draws another address.
    pub fn erase(&mut self, place: usize, key: Key) {
        let chance = self.rng.random();
        let station = &mut self.stations[place];
        station.extended = Eui64::of_node(station.number as u16, chance);
        station.members = [None; MEMBERS];
        station.saved = Saved {
            counter_limit: 0,
            active_key: key,
            next_key: None,
            network: None,
            extended: None,
            former_key: None,
        };
        self.restart(place);
    }

    /// Does the next thing a station wants. Returns true if there was one.
    fn act(&mut self, place: usize) -> bool {
        let mut buffer = [0; FRAME_MAX];
        let station = &mut self.stations[place];
        let action = station.node.poll(self.now, &mut buffer);
        while self.fetches_results && station.node.link.result().is_some() {}
        let Some(action) = action else {
            return false;
        };
        match action {
            Action::Save(record) => {
                match record {
                    Record::CounterLimit(limit) => station.saved.counter_limit = limit,
                    Record::ActiveKey(key) => station.saved.active_key = key,
                    Record::NextKey(key) => station.saved.next_key = key,
                    Record::Network(network) => station.saved.network = network,
                    Record::FormerKey(key) => station.saved.former_key = key,
                    Record::Extended(_) => unreachable!("written by its owner"),
                    Record::Member(place, member) => station.members[usize::from(place)] = member,
                }
                station.node.saved(record);
                station.written.push(record);
            }
            Action::Configure(config) => {
                station.listened = station.listened(self.now);
                station.configured = self.now;
                station.config = Some(config);
            }
            Action::Transmit(len) => self.transmit(place, &buffer[..len]),
        }
        true
    }

    fn transmit(&mut self, from: usize, frame: &[u8]) {
        let config = self.stations[from]
            .config
            .expect("sends before it is configured");
        self.heard.push(OnAir {
            at: self.now,
            from,
            channel: config.channel,
            frame: frame.to_vec(),
        });
        let strength = self.stations[from].strength;
        let began = self.now;
        self.now = self.now + Duration::from_micros(32 * (frame.len() as u64 + 8) + 192);
        for to in 0..self.stations.len() {
            let is_lost = self.rng.random_bool(self.loss);
            let in_range =
                !self.stations[from].is_out_of_range && !self.stations[to].is_out_of_range;
            let station = &mut self.stations[to];
            let on_channel = station
                .config
                .is_some_and(|to| to.channel == config.channel);
            if to != from && on_channel && in_range && !is_lost && station.listens(began) {
                (station.node).handle_at(self.now, &mut frame.to_vec(), strength);
            }
        }
    }

    /// Runs for a time.
    pub fn run(&mut self, duration: Duration) {
        let end = self.now + duration;
        let mut idle = 0;
        while self.now < end {
            let mut acted = false;
            for place in 0..self.stations.len() {
                acted |= self.act(place);
            }
            let deadlines = self
                .stations
                .iter()
                .filter_map(|station| station.node.deadline());
            let next = deadlines.min().unwrap_or(end);
            idle = if acted || next > self.now {
                0
            } else {
                idle + 1
            };
            // A deadline in the past that nothing comes of would be a busy loop on a node. A change
            // of state takes a poll.
            assert!(idle < 4, "a deadline that nothing comes of");
            if !acted {
                self.now = self.now.max(next.min(end));
            }
        }
    }

    pub fn short(&self, place: usize) -> Option<ShortAddress> {
        match self.stations[place].node.status() {
            NetworkStatus::Joined(membership) => Some(membership.short),
            _ => None,
        }
    }
}
