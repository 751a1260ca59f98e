//! An attacker that sends frames without the key.

use std::{
    cell::{Cell, RefCell},
    collections::BTreeSet,
    ops::Range,
    rc::Rc,
};

use rand::{Rng, RngExt};
use results::record::Attack;
use site::{Action, Forgery, Scenario};
use virtual_hardware::{
    executor::{Clock, Time},
    medium::{Event, Medium, NodeId},
};
use zigbee_link::{
    radio::{Channel, FRAME_MAX},
    wire::{Address, Eui64, Frame, FrameType, Panned, ShortAddress, fcs},
};

use super::{Simulation, events};

/// Preamble, start of frame and length, bytes.
const PHY_HEADER: u64 = 6;

/// Duration of a byte at 250 kbit/s, seconds.
const BYTE_S: f64 = 32e-6;

/// Count of the frames that came from no node.
#[derive(Clone, Default)]
pub(super) struct Attacker {
    frames: Rc<Cell<u64>>,
    bytes: Rc<Cell<u64>>,
}

impl Attacker {
    /// Puts a PSDU on the air.
    pub(super) fn send(&self, medium: &Medium, from: NodeId, channel: Channel, psdu: &[u8]) {
        self.frames.update(|frames| frames + 1);
        self.bytes
            .update(|bytes| bytes + PHY_HEADER + psdu.len() as u64);
        medium.inject(from, channel, psdu);
    }

    /// Record of the attack after so many seconds, if the scenario has one.
    pub(super) fn told(&self, scenario: &Scenario, seconds: f64) -> Option<Attack> {
        let attacks = |action: &Action| {
            matches!(
                action,
                Action::Replay { .. } | Action::Forge { .. } | Action::Jam { .. }
            )
        };
        let mut events = scenario.events.iter();
        if !events.any(|event| attacks(&event.action)) {
            return None;
        }
        let jammed = scenario.events.iter().map(|event| match event.action {
            Action::Jam { for_s, .. } => for_s.min(seconds - event.at_s).max(0.0),
            _ => 0.0,
        });
        let (frames, bytes) = (self.frames.get(), self.bytes.get());
        let airtime = jammed.sum::<f64>() + bytes as f64 * BYTE_S;
        Some(Attack {
            frames,
            bytes,
            airtime_share: match seconds > 0.0 {
                true => airtime / seconds,
                false => 0.0,
            },
        })
    }
}

/// A frame without its FCS, and the channel on which it was heard.
type Heard = (Channel, Vec<u8>);

/// The last frames that were heard of a network.
#[derive(Default)]
struct Last {
    frame: Option<Heard>,
    broadcast: Option<Heard>,
    beacon: Option<Heard>,
}

impl Last {
    fn hear(&mut self, channel: Channel, bytes: &[u8]) {
        let heard = || Some((channel, bytes.to_vec()));
        self.frame = heard();
        let Ok(frame) = Frame::parse(bytes) else {
            return;
        };
        let header = frame.header();
        let everybody = Some(Address::Short(ShortAddress::BROADCAST));
        if header.frame_type == FrameType::Beacon {
            self.beacon = heard();
        } else if header.security.is_some() && header.destination.address == everybody {
            self.broadcast = heard();
        }
    }

    fn forged(&self, what: Forgery, random: &mut impl Rng) -> Option<Heard> {
        match what {
            Forgery::Random => {
                let (channel, _) = self.frame.as_ref()?;
                Some((*channel, bytes(random.random_range(3..=FRAME_MAX), random)))
            }
            Forgery::Flipped => {
                let (channel, mut frame) = self.frame.clone()?;
                for _ in 0..random.random_range(1..=3) {
                    let bit = random.random_range(0..8 * frame.len());
                    frame[bit / 8] ^= 1 << (bit % 8);
                }
                Some((channel, frame))
            }
            Forgery::Broadcast => {
                let (channel, bytes_heard) = self.broadcast.as_ref()?;
                let frame = Frame::parse(bytes_heard).ok()?;
                let mut header = *frame.header();
                header.sequence = random.random();
                if let Some(security) = &mut header.security {
                    let later = random.random_range(1..1000);
                    security.counter = security.counter.saturating_add(later);
                }
                let mut forged = vec![0; FRAME_MAX];
                let len = header.emit(&mut forged).ok()?;
                forged.truncate(len);
                forged.extend(bytes(frame.payload().len(), random));
                Some((*channel, forged))
            }
            Forgery::Beacon => {
                let (channel, bytes_heard) = self.beacon.as_ref()?;
                let frame = Frame::parse(bytes_heard).ok()?;
                let mut header = *frame.header();
                let address = Address::Extended(Eui64(random.random()));
                header.source = Panned::new(header.source.pan?, address);
                header.sequence = random.random();
                let mut forged = vec![0; FRAME_MAX];
                let len = header.emit(&mut forged).ok()?;
                forged.truncate(len);
                forged.extend(frame.payload());
                Some((*channel, forged)).filter(|(_, forged)| forged.len() <= FRAME_MAX)
            }
        }
    }
}

fn bytes(count: usize, random: &mut impl Rng) -> Vec<u8> {
    let mut bytes = vec![0; count];
    random.fill_bytes(&mut bytes);
    bytes
}

/// A receiver of the attacker that hears all of the first network.
#[derive(Clone)]
pub(super) struct Ears {
    antenna: NodeId,
    medium: Medium,
    attacker: Attacker,
    last: Rc<RefCell<Last>>,
}

/// Puts the attacker's receiver beside the first network's coordinator, if the scenario has forged frames.
pub(super) fn listen(simulation: &Simulation) -> Option<Ears> {
    let mut events = simulation.scenario.events.iter();
    if !events.any(|event| matches!(event.action, Action::Forge { .. })) {
        return None;
    }
    let network = simulation.site.networks.first()?;
    let ids = { network.cameras.iter().map(|camera| camera.id) }
        .chain(network.targets.iter().map(|target| target.id))
        .chain([0]);
    let antennas = ids.filter_map(|id| Some(events::find(simulation, id)?.antenna));
    let antennas: BTreeSet<_> = antennas.collect();
    let coordinator = events::find(simulation, 0)?.antenna;
    let place = simulation.medium.place(coordinator);
    let ears = Ears {
        antenna: simulation.medium.attach(place),
        medium: simulation.medium.clone(),
        attacker: simulation.attacker.clone(),
        last: Rc::default(),
    };
    let last = ears.last.clone();
    simulation.medium.watch(move |_: Time, event: Event<'_>| {
        if let Event::Sent {
            from,
            channel,
            frame,
        } = event
            && antennas.contains(&from)
        {
            last.borrow_mut().hear(channel, frame);
        }
    });
    Some(ears)
}

/// Sends forged frames at a fixed period.
pub(super) async fn forge(
    clock: Clock,
    during: Range<Time>,
    every: Time,
    what: Forgery,
    ears: Ears,
    mut random: impl Rng,
) {
    let mut at = during.start;
    while at < during.end {
        clock.sleep_until_time(at).await;
        let forged = ears.last.borrow().forged(what, &mut random);
        if let Some((channel, mut psdu)) = forged {
            psdu.extend(fcs(&psdu).to_le_bytes());
            ears.attacker
                .send(&ears.medium, ears.antenna, channel, &psdu);
        }
        at += every;
    }
}
