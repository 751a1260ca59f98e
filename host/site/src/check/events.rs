//! Checks that events can happen.

use std::collections::BTreeSet;

use super::{Checked, fault_rates, refuse};
use crate::{
    event::{Action, Subject},
    file::{NetworkTable, Scenario},
};

/// `ids` are the numbers of all cameras and targets.
pub(super) fn check(scenario: &Scenario, ids: &BTreeSet<u16>) -> Checked {
    let networks = &scenario.networks;
    let targets: BTreeSet<_> = networks
        .iter()
        .flat_map(|network| &network.targets)
        .map(|target| target.id)
        .collect();
    let channels: BTreeSet<_> = networks.iter().flat_map(NetworkTable::channels).collect();
    for (n, event) in (1..).zip(&scenario.events) {
        let name = |field: &str| format!("event {n}.{field}");
        for id in event.action.nodes() {
            let is_target = targets.contains(id);
            let is_known = ids.contains(id);
            let (may_be, allowed) = match event.action.subject() {
                Subject::Any => (
                    is_known || *id == 0,
                    "the `id` of a camera or a target, or 0 for the first network's coordinator",
                ),
                Subject::Camera => (is_known && !is_target, "the `id` of a camera"),
                Subject::Target => (is_target, "the `id` of a target"),
                Subject::Coordinator => (*id == 0, "0, for the first network's coordinator"),
            };
            if !may_be {
                return Err(refuse(name("node"), id, allowed));
            }
        }
        match &event.action {
            Action::Jam {
                channel: Some(channel),
                ..
            } if !channels.contains(channel) => {
                let used: Vec<_> = channels.iter().map(u8::to_string).collect();
                let allowed = format!("a channel that a network uses: {}", used.join(", "));
                return Err(refuse(name("channel"), channel, allowed));
            }
            Action::Jam { at, reach, .. } if at.is_some() != reach.is_some() => {
                return Err(refuse(
                    name("jam"),
                    "half a place",
                    "`at` and `reach`, or neither",
                ));
            }
            Action::Partition { nodes, .. } => {
                let apart: BTreeSet<_> = nodes.iter().collect();
                // Coordinators of further networks have no number here, and stay on the other side.
                let everybody = networks.len() == 1
                    && apart.contains(&0)
                    && ids.iter().all(|id| apart.contains(id));
                if everybody {
                    let allowed = "some of the nodes: those left out are the other side";
                    return Err(refuse(name("nodes"), "everybody", allowed));
                }
            }
            Action::CameraFaults { faults, .. } => {
                fault_rates(&name("action.camera-faults"), faults)?;
            }
            Action::Replay { .. } if event.at_s <= 0.0 => {
                let allowed = "after something was sent: above 0 seconds";
                return Err(refuse(name("at_s"), event.at_s, allowed));
            }
            _ => {}
        }
    }
    Ok(())
}
