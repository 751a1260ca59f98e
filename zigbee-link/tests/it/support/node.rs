//! Parts of a whole node.

use embassy_futures::block_on;
use virtual_hardware::{
    executor::Clock,
    medium::{Medium, NRF52840, NodeId, Propagation, Radio},
};
use zigbee_link::{
    network::{Channels, NetworkSettings},
    radio::{Channel, Csma},
    security::Protection,
    store::Store,
};

use super::{
    aether::{eui, key},
    flash::{Flash, chip, length},
};

/// Bytes of a node's flash.
pub const LEN: u32 = length(4);

pub fn settings(number: usize) -> NetworkSettings {
    let mut settings = NetworkSettings::new(eui(number), number as u64);
    settings.channels = Channels::only(Channel::FIRST);
    settings.protection = Protection::EncMic32;
    settings
}

/// A store that knows nothing but the site key.
pub fn provisioned() -> Store<Flash> {
    let mut store = Store::new(chip(4, 0), 0..LEN).unwrap();
    block_on(store.provision(key(1), eui(0), 0)).unwrap();
    store
}

/// Air in which all hear each other, but for a share of the frames.
pub fn air(clock: &Clock, loss: f64) -> Medium {
    Medium::new(clock, Propagation::UnitDisk { range: 1.0, loss }, 1)
}

/// The radio of an nRF52840, switched on.
pub fn radio(medium: &Medium, node: NodeId, clock: &Clock, seed: u64) -> Csma<Radio, Clock> {
    Csma::new(medium.radio(node, NRF52840), clock.clone(), seed)
}
