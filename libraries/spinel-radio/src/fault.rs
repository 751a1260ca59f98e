//! Reasons why a co-processor does not work.

use core::fmt;

use super::{
    property::{PropertyKey, ProtocolVersion},
    status::SpinelStatus,
};

/// Reason why a request failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum RcpFault {
    /// There is no configuration: the first one is missing, or the last one failed or was dropped.
    NotConfigured,
    /// The frame is shorter than [`FRAME_MIN`](zigbee_link::radio::FRAME_MIN) or longer than
    /// [`FRAME_MAX`](zigbee_link::radio::FRAME_MAX) bytes.
    FrameLength,
    /// No answer, after all repetitions.
    Silent,
    /// The co-processor restarts again and again.
    Restarting,
    /// It speaks another version of the protocol than 4.
    Version(ProtocolVersion),
    /// It is no radio co-processor.
    NoRadio,
    /// It refuses a property, or to tell or to take it.
    Refused {
        /// The property that was refused.
        key: PropertyKey,
        /// Status that the co-processor answered.
        status: SpinelStatus,
    },
}

impl fmt::Display for RcpFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotConfigured => f.write_str("the radio is not configured"),
            Self::FrameLength => f.write_str("the frame is too short or too long"),
            Self::Silent => f.write_str("the co-processor does not answer"),
            Self::Restarting => f.write_str("the co-processor restarts again and again"),
            Self::Version(version) => {
                write!(f, "the co-processor speaks Spinel {version}, not 4")
            }
            Self::NoRadio => f.write_str("the co-processor gives no access to its radio"),
            Self::Refused { key, status } => {
                write!(
                    f,
                    "the co-processor refused property {:#x}: {status}",
                    key.0
                )
            }
        }
    }
}

impl core::error::Error for RcpFault {}
