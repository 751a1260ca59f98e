//! Verdicts on a network that goes on, one after the other.
//!
//! The next stop takes long to find, and depends on one network alone: it is found again only if something of
//! that network changed.

use std::collections::BTreeMap;

use super::{Unchecked, Verdict, unchecked};
use crate::record::{
    Limits, Network, Node, RunRecord, Target,
    next_stop::{self, Proposed, Wish},
    sightings::Sightings,
};

/// Finds verdicts, and remembers their parts.
#[derive(Clone, Debug, Default)]
pub struct Judge {
    site: Option<Site>,
    networks: BTreeMap<u16, Known>,
}

/// Findings that concern all networks.
#[derive(Clone, Debug, PartialEq)]
struct Site {
    limits: Limits,
    networks: Vec<Network>,
    obstacles: Vec<Vec<[f64; 2]>>,
    area: Vec<[f64; 2]>,
}

/// One network, and the findings on it.
#[derive(Clone, Debug)]
struct Known {
    part: Part,
    unchecked: Option<Unchecked>,
    /// For these wishes.
    proposed: Option<(Vec<Wished>, Proposed)>,
}

/// Number of a camera that a stop is wanted for, and two properties of what is wanted.
type Wished = (u16, bool, bool);

/// Content of a record about one network.
#[derive(Clone, Debug, Default)]
struct Part {
    nodes: Vec<Node>,
    targets: Vec<Target>,
    sightings: Vec<Sightings>,
}

impl Judge {
    /// The verdict on the present record: that of [`Verdict::of`].
    pub fn verdict(&mut self, record: &RunRecord) -> Verdict {
        self.learn(record);
        Verdict::found(record, self)
    }

    /// Forgets the findings on networks that changed.
    fn learn(&mut self, record: &RunRecord) {
        let site = Site {
            limits: record.limits,
            networks: record.networks.clone(),
            obstacles: record.obstacles.clone(),
            area: record.area.clone(),
        };
        if self.site.as_ref() != Some(&site) {
            self.networks.clear();
            self.site = Some(site);
        }
        let mut parts = BTreeMap::<u16, View<'_>>::new();
        for node in &record.nodes {
            parts.entry(node.network).or_default().nodes.push(node);
        }
        for target in &record.targets {
            parts
                .entry(target.network)
                .or_default()
                .targets
                .push(target);
        }
        for sightings in &record.sightings {
            let part = parts.entry(sightings.network).or_default();
            part.sightings.push(sightings);
        }
        self.networks
            .retain(|network, _| parts.contains_key(network));
        for (network, part) in parts {
            let is_same = |known: &Known| part.is_like(&known.part);
            if !self.networks.get(&network).is_some_and(is_same) {
                let known = Known {
                    part: part.to_owned(),
                    unchecked: None,
                    proposed: None,
                };
                self.networks.insert(network, known);
            }
        }
    }

    pub(super) fn unchecked(&mut self, record: &RunRecord, network: u16) -> Unchecked {
        let find = || unchecked(record, network);
        match self.networks.get_mut(&network) {
            Some(known) => known.unchecked.get_or_insert_with(find).clone(),
            None => find(),
        }
    }

    pub(super) fn propose(
        &mut self,
        record: &RunRecord,
        network: u16,
        wishes: &[Wish<'_>],
    ) -> Proposed {
        let find = || next_stop::propose(record, network, wishes);
        // A guest's stops are another network's.
        let Some(known) = { self.networks.get_mut(&network) }.filter(|known| known.part.is_alone())
        else {
            return find();
        };
        let told = wishes.iter().map(Wish::told).collect();
        match &known.proposed {
            Some((before, stops)) if *before == told => stops.clone(),
            _ => known.proposed.insert((told, find())).1.clone(),
        }
    }
}

/// A [`Part`] of a record, where it is.
#[derive(Default)]
struct View<'a> {
    nodes: Vec<&'a Node>,
    targets: Vec<&'a Target>,
    sightings: Vec<&'a Sightings>,
}

impl View<'_> {
    fn is_like(&self, part: &Part) -> bool {
        self.nodes.len() == part.nodes.len()
            && { self.nodes.iter().zip(&part.nodes) }.all(|(a, b)| a.is_like(b))
            && self.targets.iter().copied().eq(&part.targets)
            && self.sightings.iter().copied().eq(&part.sightings)
    }

    fn to_owned(&self) -> Part {
        Part {
            nodes: self.nodes.iter().copied().cloned().collect(),
            targets: self.targets.iter().copied().cloned().collect(),
            sightings: self.sightings.iter().copied().cloned().collect(),
        }
    }
}

impl Part {
    /// Returns true if its cameras saw its own targets only.
    fn is_alone(&self) -> bool {
        let is_own = |target: u16| self.targets.iter().any(|own| own.id == target);
        let mut seen = self.nodes.iter().flat_map(|node| &node.residuals);
        seen.all(|seen| is_own(seen.target))
    }
}
