//! What a whole node is made of, besides its radio and its clock.

use embassy_futures::block_on;
use zigbee_link::{
    network::{Channels, Settings},
    radio::Channel,
    security::Protection,
    store::Store,
};

use super::{
    aether::{eui, key},
    flash::MockFlash,
};

pub fn settings(number: usize) -> Settings {
    Settings {
        extended: eui(number),
        channels: Channels::only(Channel::FIRST),
        tx_power: 0,
        protection: Protection::EncMic32,
        seed: number as u64,
    }
}

/// A store that knows nothing but the site key.
pub fn provisioned() -> Store<MockFlash<4>> {
    let mut store = Store::new(MockFlash::new(0), 0..MockFlash::<4>::LEN).unwrap();
    block_on(store.provision(key(1), 0)).unwrap();
    store
}
