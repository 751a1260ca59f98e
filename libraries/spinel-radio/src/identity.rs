//! Identity of the co-processor.

use heapless::Vec;

use super::property::{Capabilities, Property, ProtocolVersion};
use zigbee_link::wire::Eui64;

const FIRMWARE_MAX: usize = 64;

/// Facts that a co-processor tells of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Identity {
    /// Version of the protocol.
    pub protocol: ProtocolVersion,
    /// True if it sends and receives raw frames for a host.
    pub is_radio: bool,
    /// Its extended address from the factory.
    pub address: Eui64,
    firmware: Vec<u8, FIRMWARE_MAX>,
}

impl Identity {
    pub(crate) const UNKNOWN: Self = Self {
        protocol: ProtocolVersion { major: 0, minor: 0 },
        is_radio: false,
        address: Eui64([0; 8]),
        firmware: Vec::new(),
    };

    /// Name and version of the firmware, the first 64 bytes, usually ASCII.
    pub fn firmware(&self) -> &[u8] {
        &self.firmware
    }

    /// Takes the property of an answer.
    pub(crate) fn learn(&mut self, property: &Property<'_>) {
        match *property {
            Property::ProtocolVersion(version) => self.protocol = version,
            Property::Capabilities(capabilities) => {
                self.is_radio = capabilities.contains(Capabilities::MAC_RAW);
            }
            Property::HardwareAddress(address) => self.address = address,
            Property::NcpVersion(text) => {
                let start = text.get(..FIRMWARE_MAX).unwrap_or(text);
                let firmware = Vec::from_slice(start);
                debug_assert!(firmware.is_ok());
                self.firmware = firmware.unwrap_or_default();
            }
            _ => {}
        }
    }
}
