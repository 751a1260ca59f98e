//! Parts of a record, each told by an event of its own.
//!
//! A stream of events adds up to a record. This is the other way: the events that tell a record as it is, one for each
//! part, in any order after the first.

use super::{
    RunRecord,
    event::{EVENT_FORMAT, What},
    summary::Summary,
};

/// Part of a record that one event tells as a whole. The order is that of telling.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// All that no other part has, such as the scenario's name.
    Begin,
    /// Network of this number.
    Network(u16),
    /// Obstacles and the area.
    Obstacles,
    /// Node of this number.
    Node(u16),
    /// Target of this number, with its stops.
    Target(u16),
    /// Sightings of this network.
    Measured(u16),
    /// Quality of the tracking of this network.
    Tracking(u16),
    /// Radio traffic.
    Traffic,
}

impl Part {
    /// Part that an event changes, of those that tell one.
    pub fn changed_by(what: &What) -> Option<Self> {
        Some(match what {
            What::Begin { .. } => Self::Begin,
            What::Network { is } => Self::Network(is.network),
            What::Obstacles { .. } => Self::Obstacles,
            What::Node { is, .. } => Self::Node(is.id),
            What::Target { is } => Self::Target(is.id),
            What::Stop { target, .. } => Self::Target(*target),
            What::Measured { is } => Self::Measured(is.network),
            What::Tracking { is } => Self::Tracking(is.network),
            What::Traffic { .. } => Self::Traffic,
            _ => return None,
        })
    }
}

impl RunRecord {
    /// All parts that there are.
    pub fn parts(&self) -> impl Iterator<Item = Part> {
        let has_obstacles = !self.obstacles.is_empty() || !self.area.is_empty();
        let networks = self.networks.iter().map(|own| Part::Network(own.network));
        let nodes = self.nodes.iter().map(|node| Part::Node(node.id));
        let targets = self.targets.iter().map(|own| Part::Target(own.id));
        let measured = self.sightings.iter().map(|own| Part::Measured(own.network));
        let tracking = self.tracking.iter().map(|own| Part::Tracking(own.network));
        [Part::Begin]
            .into_iter()
            .chain(networks)
            .chain(has_obstacles.then_some(Part::Obstacles))
            .chain(nodes)
            .chain(targets)
            .chain(measured)
            .chain(tracking)
            .chain(self.radio.is_some().then_some(Part::Traffic))
    }

    /// Event that tells a part as it is; `None` if there is no such part.
    pub fn told(&self, part: Part) -> Option<What> {
        Some(match part {
            Part::Begin => What::Begin {
                events: EVENT_FORMAT,
                record: Box::new(self.without_parts()),
            },
            Part::Network(number) => What::Network {
                is: *self.networks.iter().find(|own| own.network == number)?,
            },
            Part::Obstacles if self.obstacles.is_empty() && self.area.is_empty() => return None,
            Part::Obstacles => What::Obstacles {
                outlines: self.obstacles.clone(),
                area: self.area.clone(),
            },
            Part::Node(id) => What::Node {
                news: Vec::new(),
                is: Box::new(self.nodes.iter().find(|node| node.id == id)?.clone()),
            },
            Part::Target(id) => What::Target {
                is: self.targets.iter().find(|own| own.id == id)?.clone(),
            },
            Part::Measured(number) => What::Measured {
                is: { self.sightings.iter() }
                    .find(|own| own.network == number)?
                    .clone(),
            },
            Part::Tracking(number) => What::Tracking {
                is: *self.tracking.iter().find(|own| own.network == number)?,
            },
            Part::Traffic => What::Traffic {
                radio: self.radio.clone()?,
            },
        })
    }

    /// Takes a part out.
    pub fn forget(&mut self, part: Part) {
        match part {
            Part::Begin => {}
            Part::Network(number) => self.networks.retain(|own| own.network != number),
            Part::Obstacles => {
                self.obstacles.clear();
                self.area.clear();
            }
            Part::Node(id) => {
                self.nodes.retain(|node| node.id != id);
                self.summary = Summary::of(&self.nodes);
            }
            Part::Target(id) => self.targets.retain(|own| own.id != id),
            Part::Measured(number) => self.sightings.retain(|own| own.network != number),
            Part::Tracking(number) => self.tracking.retain(|own| own.network != number),
            Part::Traffic => self.radio = None,
        }
    }

    fn without_parts(&self) -> Self {
        Self {
            scenario: self.scenario.clone(),
            published: self.published.clone(),
            unit: self.unit.clone(),
            networks: Vec::new(),
            nodes: Vec::new(),
            targets: Vec::new(),
            sightings: Vec::new(),
            obstacles: Vec::new(),
            area: Vec::new(),
            summary: Summary::of(&[]),
            radio: None,
            tracking: Vec::new(),
            wall_seconds: None,
            ..*self
        }
    }
}
