//! Requests to a session, and their results.

use zigbee_link::radio::{RadioConfig, TxOutcome};

/// Request of the caller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RcpRequest<'a> {
    /// Work like this. Ends with [`RcpOutcome::Configured`].
    Configure(RadioConfig),
    /// Send this frame, which has no FCS. Ends with [`RcpOutcome::Transmitted`].
    Transmit(&'a [u8]),
    /// Receive. Ends only when it fails.
    Listen,
}

/// Result of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use]
pub enum RcpOutcome {
    /// The co-processor works as it was told.
    Configured,
    /// Result of the transmission.
    Transmitted(TxOutcome),
}

/// Counts of faults that went by unnoticed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counters {
    /// Restarts of the configured co-processor.
    pub restarts: u32,
    /// Commands that were sent again because there was no answer.
    pub repeated: u32,
    /// HDLC frames that do not follow the Spinel format.
    pub malformed: u32,
    /// Frames received with an error, or of an impossible length.
    pub unusable: u32,
    /// Frames lost because the queue was full.
    pub queue_full: u32,
}
