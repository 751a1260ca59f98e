//! Addresses of senders and receivers of frames.

use core::fmt;

/// A PAN identifier. Little-endian on the air.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PanId(pub u16);

impl PanId {
    /// Every PAN; as a radio's own identifier: none yet.
    pub const BROADCAST: Self = Self(0xFFFF);
}

/// A 16-bit address, given by the coordinator. Little-endian on the air.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ShortAddress(pub u16);

impl ShortAddress {
    /// Every device; as a radio's own address: none yet.
    pub const BROADCAST: Self = Self(0xFFFF);
    /// A member that was given no short address and uses its extended one.
    pub const UNASSIGNED: Self = Self(0xFFFE);
    /// The coordinator of every network of this crate.
    pub const COORDINATOR: Self = Self(0x0000);

    /// Returns true if this names one device: neither broadcast nor unassigned.
    pub const fn is_unicast(self) -> bool {
        self.0 < Self::UNASSIGNED.0
    }
}

/// A 64-bit extended address (EUI-64), most significant byte first, as printed on the device.
/// Reversed on the air.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Eui64(pub [u8; 8]);

impl Eui64 {
    /// A locally administered address of the node with this number: 46 bits of chance, and the
    /// number in the low 16. Drawn anew whenever a node has forgotten its frame counter, it keeps
    /// nonces from repeating.
    pub const fn of_node(number: u16, chance: u64) -> Self {
        let mut bytes = (chance << 16 | number as u64).to_be_bytes();
        bytes[0] = bytes[0] & !3 | 2;
        Self(bytes)
    }

    /// The number in its low 16 bits, see [`of_node`](Self::of_node).
    pub const fn number(self) -> u16 {
        let [.., high, low] = self.0;
        u16::from_be_bytes([high, low])
    }
}

/// A device's address, either kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Address {
    /// Of 16 bits, valid in one PAN.
    Short(ShortAddress),
    /// Of 64 bits, unique everywhere.
    Extended(Eui64),
}

impl fmt::Display for PanId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:#06x}", self.0)
    }
}

impl fmt::Display for ShortAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:#06x}", self.0)
    }
}

impl fmt::Display for Eui64 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, byte) in self.0.iter().enumerate() {
            let separator = if i == 0 { "" } else { ":" };
            write!(f, "{separator}{byte:02x}")?;
        }
        Ok(())
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Short(short) => short.fmt(f),
            Self::Extended(extended) => extended.fmt(f),
        }
    }
}
