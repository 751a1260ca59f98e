//! Results of commands.

use core::fmt;

/// A status code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SpinelStatus(pub u32);

impl SpinelStatus {
    /// The command did what it was to do.
    pub const OK: Self = Self(0);
    /// The command failed for no particular reason.
    pub const FAILURE: Self = Self(1);
    /// The co-processor cannot do this.
    pub const UNIMPLEMENTED: Self = Self(2);
    /// A value is out of its range.
    pub const INVALID_ARGUMENT: Self = Self(3);
    /// Not now: the radio is not enabled.
    pub const INVALID_STATE: Self = Self(4);
    /// The command was not understood.
    pub const PARSE_ERROR: Self = Self(9);
    /// No memory at the moment.
    pub const NO_MEMORY: Self = Self(11);
    /// Another command is under way.
    pub const BUSY: Self = Self(12);
    /// The co-processor does not have this property.
    pub const PROPERTY_NOT_FOUND: Self = Self(13);
    /// The frame was sent and not acknowledged.
    pub const NO_ACK: Self = Self(17);
    /// The channel stayed busy.
    pub const CCA_FAILURE: Self = Self(18);
    /// The first of the statuses that tell why the co-processor restarted.
    pub const RESET_POWER_ON: Self = Self(112);

    /// Returns true if this tells that the co-processor restarted.
    pub const fn is_reset(self) -> bool {
        self.0 >= Self::RESET_POWER_ON.0 && self.0 < 128
    }

    const fn name(self) -> Option<&'static str> {
        Some(match self {
            Self::OK => "ok",
            Self::FAILURE => "failure",
            Self::UNIMPLEMENTED => "not implemented",
            Self::INVALID_ARGUMENT => "invalid argument",
            Self::INVALID_STATE => "invalid state",
            Self::PARSE_ERROR => "not understood",
            Self::NO_MEMORY => "no memory",
            Self::BUSY => "busy",
            Self::PROPERTY_NOT_FOUND => "no such property",
            Self::NO_ACK => "no acknowledgement",
            Self::CCA_FAILURE => "channel busy",
            _ if self.is_reset() => "restarted",
            _ => return None,
        })
    }
}

impl fmt::Display for SpinelStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.name() {
            Some(name) => write!(f, "{name} ({})", self.0),
            None => write!(f, "status {}", self.0),
        }
    }
}
