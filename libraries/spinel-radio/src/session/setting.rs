//! Properties that make up a configuration.

use crate::property::{Promiscuity, Property};
use zigbee_link::radio::RadioConfig;

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Need {
    Must,
    /// Not every radio can.
    Wish,
}

/// Properties to set for a configuration, in this order.
pub(super) fn setting(config: &RadioConfig, index: u8) -> Option<(Property<'static>, Need)> {
    Some(match index {
        0 => (Property::PhyEnabled(true), Need::Must),
        1 => (Property::PhyChannel(config.channel.number()), Need::Must),
        2 => (Property::PhyTxPower(config.tx_power), Need::Wish),
        3 => (Property::MacPan(config.pan), Need::Must),
        4 => (Property::MacShort(config.short), Need::Must),
        5 => (Property::MacExtended(config.extended), Need::Must),
        // Without it, acknowledgements claim to every device that a frame is pending.
        6 => (Property::MacSourceMatch(true), Need::Wish),
        7 => {
            let promiscuity = if config.promiscuous {
                Promiscuity::Full
            } else {
                Promiscuity::Off
            };
            (Property::MacPromiscuous(promiscuity), Need::Must)
        }
        8 => (Property::MacRawStream(true), Need::Must),
        _ => return None,
    })
}
