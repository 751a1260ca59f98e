//! Faults of the air by order of a script.

use std::{collections::BTreeSet, ops::Range};

use zigbee_link::radio::Channel;

use super::{NodeId, Place};
use crate::executor::Time;

/// A fault that lasts for a while.
#[derive(Clone, Debug, PartialEq)]
pub struct Disturbance {
    /// Time from begin to end, nanoseconds.
    pub during: Range<Time>,
    /// Kind of fault.
    pub kind: Kind,
}

/// Kind of a fault.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// A carrier: receivers in reach lose what they receive and find the channel busy.
    Jammer {
        /// Its channel, or all.
        channel: Option<Channel>,
        /// Its place and its reach, or everywhere.
        disk: Option<(Place, f64)>,
    },
    /// These nodes neither hear the others nor are heard by them.
    Partition(BTreeSet<NodeId>),
    /// Every link loses this share of its frames besides, 0 to 1.
    Loss(f64),
}

/// All that was ordered.
#[derive(Default)]
pub(super) struct Disturbances(Vec<Disturbance>);

impl Disturbances {
    pub(super) fn add(&mut self, disturbance: Disturbance) {
        self.0.push(disturbance);
    }

    fn within(&self, time: Range<Time>) -> impl Iterator<Item = &Kind> {
        let overlaps =
            move |d: &&Disturbance| d.during.start <= time.end && time.start < d.during.end;
        self.0.iter().filter(overlaps).map(|d| &d.kind)
    }

    pub(super) fn jams(&self, time: Range<Time>, at: Channel, place: Place) -> bool {
        self.within(time).any(|kind| match kind {
            Kind::Jammer { channel, disk } => {
                channel.is_none_or(|channel| channel == at)
                    && disk.is_none_or(|(centre, reach)| {
                        libm::hypot(place[0] - centre[0], place[1] - centre[1]) <= reach
                    })
            }
            _ => false,
        })
    }

    pub(super) fn separates(&self, now: Time, a: u32, b: u32) -> bool {
        self.within(now..now).any(|kind| match kind {
            Kind::Partition(nodes) => nodes.contains(&NodeId(a)) != nodes.contains(&NodeId(b)),
            _ => false,
        })
    }

    /// The share of frames lost.
    pub(super) fn loss(&self, now: Time) -> f64 {
        let kept = self.within(now..now).map(|kind| match kind {
            Kind::Loss(share) => 1.0 - share,
            Kind::Jammer { .. } | Kind::Partition(_) => 1.0,
        });
        1.0 - kept.product::<f64>()
    }
}
