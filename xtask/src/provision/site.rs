//! All nodes of a site, from one file.
//!
//! A site file has, in this order of strength: what all nodes have in common, what all nodes of a
//! role have, and a table for each [`node`].
//!
//! ```toml
//! channels = [15, 20, 25, 26]     # of all nodes
//!
//! [camera]                        # of all cameras; also `coordinator`, `target`
//! stops = 4
//!
//! [[node]]
//! role = "coordinator"
//! id = 1
//!
//! [[node]]
//! role = "camera"
//! id = 2
//! reference = { duty = "first" }
//! ```
//!
//! The coordinator lets all nodes of the file join. So each has an address: the one written
//! there, or a locally administered one made of its number, 02:00:00:00:00:00 and two bytes.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, Result, bail, ensure};
use node_firmware::config::{CameraConfig, Config, Duty, Role, SiteKey};
use toml::{Table, Value};

use super::node::{self, address_text};

/// Makes the configurations of all nodes.
pub(super) fn configs(mut site: Table, key: SiteKey, first_counter: u32) -> Result<Vec<Config>> {
    let nodes = site
        .remove("node")
        .context("the site has no `[[node]]`: write one for each node")?;
    let nodes: Vec<Table> = nodes.try_into().context("each node is a `[[node]]`")?;
    let mut roles = BTreeMap::new();
    for role in ["camera", "coordinator", "target"] {
        if let Some(table) = site.remove(role) {
            let table: Table = table.try_into().with_context(|| format!("`[{role}]`"))?;
            roles.insert(role, table);
        }
    }
    let mut tables = Vec::new();
    for (place, own) in (1..).zip(nodes) {
        let mut table = site.clone();
        let role = own.get("role").and_then(Value::as_str).unwrap_or_default();
        node::merge(&mut table, roles.get(role).cloned().unwrap_or_default());
        node::merge(&mut table, own);
        let id = table.get("id").and_then(Value::as_integer);
        let name = id.map_or(format!("node number {place} of the file"), |id| {
            format!("node {id}")
        });
        if let Some(id) = id.and_then(|id| u16::try_from(id).ok()) {
            let [high, low] = id.to_be_bytes();
            let local = address_text([0x02, 0, 0, 0, 0, 0, high, low]);
            table.entry("extended").or_insert(local.into());
        }
        tables.push((name, table));
    }
    let config =
        |(name, table): (String, Table)| node::config(table, key, first_counter).context(name);
    let mut configs: Vec<_> = tables.into_iter().map(config).collect::<Result<_>>()?;
    check(&configs)?;
    allow_all(&mut configs)?;
    Ok(configs)
}

/// What is wrong of nodes only together.
fn check(configs: &[Config]) -> Result<()> {
    let mut ids = BTreeSet::new();
    let mut addresses = BTreeMap::new();
    for config in configs {
        let id = config.id;
        ensure!(
            ids.insert(id),
            "two nodes have the id {id}: give each another one"
        );
        if let Some(address) = config.extended
            && let Some(other) = addresses.insert(address, id)
        {
            bail!(
                "nodes {other} and {id} both have the address {}",
                address_text(address)
            );
        }
    }
    let coordinators = configs
        .iter()
        .filter(|config| is_coordinator(config))
        .count();
    ensure!(
        coordinators == 1,
        "a site has one coordinator, not {coordinators}"
    );
    let count = |duty| {
        let references = cameras(configs).filter_map(|camera| camera.reference);
        references.filter(|own| own.duty == duty).count()
    };
    let (first, second) = (count(Duty::First), count(Duty::Second));
    ensure!(
        (first, second) == (0, 0) || (first, second) == (1, 1),
        "a site has one first and one second reference camera, or none if they are elected, not \
         {first} and {second}"
    );
    for config in configs {
        let Role::Target(target) = &config.role else {
            continue;
        };
        ensure!(
            cameras(configs).all(|camera| camera.subjects.of_target(target.colour).is_some()),
            "a camera does not know colour {} of target {}: give its `subjects` more colours",
            target.colour,
            config.id
        );
    }
    Ok(())
}

fn is_coordinator(config: &Config) -> bool {
    matches!(config.role, Role::Coordinator(_))
}

fn cameras(configs: &[Config]) -> impl Iterator<Item = &CameraConfig> {
    configs.iter().filter_map(|config| match &config.role {
        Role::Camera(camera) => Some(camera),
        _ => None,
    })
}

/// Puts the other nodes before those that the coordinator's own list has.
fn allow_all(configs: &mut [Config]) -> Result<()> {
    let others = configs.iter().filter(|config| !is_coordinator(config));
    let mut all: Vec<_> = others.filter_map(|config| config.extended).collect();
    for config in configs {
        if let Role::Coordinator(coordinator) = &mut config.role {
            let own = coordinator.allow.iter().copied();
            let more: Vec<_> = own.filter(|address| !all.contains(address)).collect();
            all.extend(more);
            coordinator.allow = node::allow_list(&all)?;
        }
        config.check()?;
    }
    Ok(())
}
