//! Whether events can happen.

use std::collections::BTreeSet;

use super::{Checked, refuse};
use crate::{
    event::Action,
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
        let is_camera_only = matches!(
            event.action,
            Action::UnplugCamera { .. } | Action::StickCamera { .. }
        );
        for id in event.action.nodes() {
            let coordinator = *id == 0 && !is_camera_only;
            if !(ids.contains(id) || coordinator) || (is_camera_only && targets.contains(id)) {
                let allowed = if is_camera_only {
                    "the `id` of a camera"
                } else {
                    "the `id` of a camera or a target, or 0 for the first network's coordinator"
                };
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
            Action::Replay { .. } if event.at_s <= 0.0 => {
                let allowed = "after something was sent: above 0 seconds";
                return Err(refuse(name("at_s"), event.at_s, allowed));
            }
            _ => {}
        }
        dark(scenario, n, name("at_s"))?;
    }
    Ok(())
}

/// Refuses what is done to a node alone while it has no power, by the event of this number.
fn dark(scenario: &Scenario, number: usize, field: String) -> Checked {
    let event = &scenario.events[number - 1];
    let [node] = event.action.nodes() else {
        return Ok(());
    };
    let is_about_power = matches!(
        event.action,
        Action::Restart { .. }
            | Action::PowerCut { .. }
            | Action::UnplugCamera { .. }
            | Action::StickCamera { .. }
    );
    for (n, other) in (1..).zip(&scenario.events) {
        if let Action::PowerCut {
            node: cut,
            for_s,
            in_flash_write: false,
        } = &other.action
            && is_about_power
            && n != number
            && cut == node
            && (other.at_s..other.at_s + for_s).contains(&event.at_s)
            // Of two at one time, the second one.
            && (other.at_s < event.at_s || n < number)
        {
            let allowed = format!(
                "outside of {} to {} seconds: node {node} has no power then, by event {n}",
                other.at_s,
                other.at_s + for_s
            );
            return Err(refuse(field, event.at_s, allowed));
        }
    }
    Ok(())
}
