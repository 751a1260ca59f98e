//! The address filter of a radio.

use zigbee_link::{
    radio::RadioConfig,
    wire::{Address, Frame, FrameType, PanId, ShortAddress},
};

/// Returns true if a radio with this configuration, not promiscuous, delivers a frame (third level of filtering,
/// IEEE 802.15.4-2006, 7.5.6.2).
///
/// Frames that are not understood are not delivered.
pub(super) fn accepts(config: &RadioConfig, frame: &[u8]) -> bool {
    let Ok(frame) = Frame::parse(frame) else {
        return false;
    };
    let header = frame.header();
    let own_pan = |pan: Option<PanId>| pan.is_some_and(|pan| pan == config.pan);
    match header.frame_type {
        // Of its own network, or of any while it has none.
        FrameType::Beacon => return own_pan(header.source.pan) || config.pan == PanId::BROADCAST,
        FrameType::Data | FrameType::Command => {}
    }
    let destination = header.destination;
    if destination.pan.is_none() && destination.address.is_none() {
        return config.coordinator && own_pan(header.source.pan);
    }
    if !own_pan(destination.pan) && destination.pan != Some(PanId::BROADCAST) {
        return false;
    }
    match destination.address {
        None => config.coordinator,
        Some(Address::Extended(extended)) => extended == config.extended,
        Some(Address::Short(short)) => {
            short == ShortAddress::BROADCAST || (short == config.short && short.is_unicast())
        }
    }
}

#[cfg(test)]
mod tests {
    use zigbee_link::{radio::Channel, wire::Eui64};

    use super::*;

    #[test]
    fn who_gets_which_frame() {
        let device = RadioConfig {
            channel: Channel::FIRST,
            tx_power: 0,
            pan: PanId(0xBEEF),
            short: ShortAddress(0x42),
            extended: Eui64([1, 2, 3, 4, 5, 6, 7, 8]),
            coordinator: false,
            promiscuous: false,
            sampled: false,
        };
        let coordinator = RadioConfig {
            coordinator: true,
            ..device
        };
        let unjoined = RadioConfig {
            pan: PanId::BROADCAST,
            short: ShortAddress::BROADCAST,
            ..device
        };
        // Frame; delivered to the device, to the coordinator, to a device without a network.
        let cases: [(&[u8], [bool; 3]); 12] = [
            (
                &[0x41, 0x98, 1, 0xEF, 0xBE, 0x42, 0, 1, 0],
                [true, true, false],
            ),
            (
                &[0x41, 0x98, 1, 0xEF, 0xBE, 0x43, 0, 1, 0],
                [false, false, false],
            ),
            (
                &[0x41, 0x98, 1, 0xEE, 0xBE, 0x42, 0, 1, 0],
                [false, false, false],
            ),
            (
                &[0x41, 0x98, 1, 0xEF, 0xBE, 0xFF, 0xFF, 1, 0],
                [true, true, false],
            ),
            (
                &[0x41, 0x98, 1, 0xFF, 0xFF, 0xFF, 0xFF, 1, 0],
                [true, true, true],
            ),
            // To the extended address.
            (
                &[0x41, 0x9C, 1, 0xEF, 0xBE, 8, 7, 6, 5, 4, 3, 2, 1, 1, 0],
                [true, true, false],
            ),
            (
                &[0x41, 0x9C, 1, 0xEF, 0xBE, 9, 7, 6, 5, 4, 3, 2, 1, 1, 0],
                [false, false, false],
            ),
            // Without a destination, which means to the coordinator.
            (&[0x01, 0x90, 1, 0xEF, 0xBE, 1, 0], [false, true, false]),
            // A beacon of the own and of another network.
            (
                &[0x00, 0x90, 1, 0xEF, 0xBE, 0, 0, 0xFF, 0xCF, 0, 0],
                [true, true, true],
            ),
            (
                &[0x00, 0x90, 1, 0xEE, 0xBE, 0, 0, 0xFF, 0xCF, 0, 0],
                [false, false, true],
            ),
            // An acknowledgement, and no frame.
            (&[0x02, 0x00, 1], [false, false, false]),
            (&[0xFF, 0xFF, 1], [false, false, false]),
        ];
        for (frame, expected) in cases {
            let by = [device, coordinator, unjoined].map(|config| accepts(&config, frame));
            assert_eq!(by, expected, "{frame:02x?}");
        }
    }
}
