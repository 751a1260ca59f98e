//! Patience of the session.

use core::time::Duration;

/// Times and counts.
///
/// The defaults serve lines from 115200 baud on, where the longest frame takes 28 ms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct RcpPolicy {
    /// Silence after which a command was not heard.
    pub answer: Duration,
    /// Silence after which a transmission has failed. Must be longer than the longest one: 5
    /// backoffs and the frame itself take up to 42 ms, the wait for an acknowledgement up to 16 ms,
    /// and all that four times.
    pub transmission: Duration,
    /// Silence after which a reset was not heard.
    pub reset: Duration,
    /// Pause before a command is repeated that the co-processor was too busy for.
    pub pause: Duration,
    /// Number of repetitions of a command before it fails; also of a transmission during which the co-processor
    /// restarts.
    pub retries: u8,
    /// Number of restarts in a row that are put up with.
    pub restarts: u8,
}

impl RcpPolicy {
    /// Value of [`Default`].
    pub const DEFAULT: Self = Self {
        answer: Duration::from_millis(500),
        transmission: Duration::from_secs(2),
        reset: Duration::from_secs(2),
        pause: Duration::from_millis(20),
        retries: 2,
        restarts: 3,
    };
}

impl Default for RcpPolicy {
    fn default() -> Self {
        Self::DEFAULT
    }
}
