//! Time-outs and counts of the driver.

/// Times in microseconds, and counts.
///
/// A time-out runs from the last byte that came, so the defaults serve every baud rate from 1200
/// on; a line that never falls silent is given up after a multiple of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Policy {
    /// Silence after which a command was not heard.
    pub reply_us: u32,
    /// Silence after which a reset failed. The camera takes 0.5 to 1 s.
    pub reset_us: u32,
    /// Silence after which a stream is dead, for each packet that may be skipped (`PS`). The
    /// slowest sensor setting gives 5 frames a second.
    pub packet_us: u32,
    /// Silence after which a carriage return did not stop the camera.
    pub drain_us: u32,
    /// Silence that shows that nothing of an earlier reply is still on its way, or that no prompt
    /// follows.
    pub settle_us: u32,
    /// Pause before a command is repeated.
    pub pause_us: u32,
    /// Longest time that a frame that is being sent may take to drain. A whole one of 176 x 255 pixels
    /// takes 35 s at 38400 baud.
    pub frame_us: u32,
    /// Pause of the blocking driver between two looks at a UART that has nothing. Keep it
    /// below the time of one character if the UART holds only one: 87 us at 115200 baud.
    pub poll_us: u32,
    /// Number of times that a command is repeated before it fails.
    pub retries: u8,
    /// After so many silent calls under packet filter the stream is stopped and started again, to see if the
    /// camera is still there.
    pub quiet_calls: u8,
    /// Drop T packets of colour tracking whose pixels and confidence contradict their box, see
    /// [`Tracking::is_consistent`](crate::packet::Tracking::is_consistent). Off by default: it
    /// finds more corruptions, but a firmware that computes these two otherwise would be mute.
    pub strict: bool,
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            reply_us: 500_000,
            reset_us: 2_000_000,
            packet_us: 1_500_000,
            drain_us: 200_000,
            settle_us: 50_000,
            pause_us: 20_000,
            frame_us: 60_000_000,
            poll_us: 50,
            retries: 3,
            quiet_calls: 10,
            strict: false,
        }
    }
}
