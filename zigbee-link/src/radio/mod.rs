//! The seam to the hardware: [`Radio`].
//!
//! # Contract
//! Promises of an implementation, on which a caller may rely. "Frame" is a PSDU without its frame check sequence:
//! MAC header and payload. A radio that carries bare PSDUs keeps the contract below a [`Checksum`].
//!
//! **Configuration**
//! 1. A radio does nothing before its first [`configure`](Radio::configure): [`Radio::transmit`]
//!    and [`Radio::receive`] then fail with the radio's error.
//! 2. `configure` may be called at any time between other calls. When it has returned `Ok`, every
//!    frame sent is sent with the new configuration. Frames already queued may still be delivered.
//! 3. When `configure` fails or is dropped half-way, the radio is unconfigured as in rule 1.
//!
//! **Transmitting**
//! 4. A transmission is one operation, from the clear-channel assessment to the result. It returns
//!    after the last bit has left the antenna. Frames request no immediate acknowledgement; if one
//!    does, its absence is no error.
//! 5. A radio backs off up to [`CSMA_BACKOFFS`] times at random, or makes exactly one assessment,
//!    and [`Csma`] over it does the rest. If the channel stays busy the result is
//!    [`TxOutcome::ChannelBusy`] and nothing was sent.
//! 6. The bytes go out unchanged, apart from an FCS that the radio appends. A radio never secures
//!    a frame and never touches its sequence number or frame counter.
//! 7. A frame shorter than [`FRAME_MIN`] or longer than [`FRAME_MAX`] is an error; it is never cut
//!    off.
//! 8. Dropping the future of `transmit` leaves open whether the frame was sent. The next call of
//!    any method works and concerns only its own frame.
//!
//! **Receiving**
//! 9. `receive` is cancel-safe: dropping its future loses no frame that it had not returned.
//! 10. Each frame is delivered once, whole, in the order of arrival.
//! 11. Frames that arrive while no `receive` is pending, during a transmission too, should be
//!     queued. When the queue is full the frame that arrives is lost without notice, as is a
//!     frame lost on the air.
//! 12. A frame with a wrong FCS is never delivered.
//! 13. Frames for other devices need not be delivered, and may be: the receiver looks at the
//!     addresses again. Every frame to the configured addresses or to all must be delivered;
//!     so must every beacon of the configured PAN, or of any PAN if that is [`PanId::BROADCAST`]; and,
//!     [promiscuous](RadioConfig::promiscuous), every frame.
//!     A radio that [samples](RadioConfig::sampled) delivers those frames that begin while it listens.
//! 14. Frames that arrive are untrusted: a radio must deliver any bytes at all without failing.
//!
//! **Errors**
//! 15. An error says that the radio does not work, not that the medium did not: a busy channel is a
//!     [`TxOutcome`]. After an error the caller may call `configure` again, which starts from a
//!     reset.
//!
//! # Stacking
//! The wrappers of this module are radios over radios. Each adds what the one below does not do.

mod checksum;
mod csma;
mod fault;
mod trace;

use core::{fmt, future::Future, time::Duration};

pub use self::{
    checksum::{Checksum, ChecksumError},
    csma::Csma,
    fault::{FaultInjector, Faults},
    trace::{PCAP_HEADER_LEN, PCAP_RECORD_MAX, Sink, Tracer, pcap_header, pcap_record},
};

use crate::wire::{Eui64, PanId, ShortAddress};

/// Bytes of the longest PSDU, FCS included.
pub const PSDU_MAX: usize = 127;
/// Bytes of the frame check sequence.
pub const FCS_LEN: usize = 2;
/// Bytes of the longest frame without its FCS.
pub const FRAME_MAX: usize = PSDU_MAX - FCS_LEN;
/// Bytes of the shortest frame without its FCS: frame control and sequence number, as in an
/// immediate acknowledgement.
pub const FRAME_MIN: usize = 3;
/// `macMaxCSMABackoffs`: backoffs before the channel counts as busy.
pub const CSMA_BACKOFFS: u8 = 4;

/// Time in which a radio that [samples](RadioConfig::sampled) listens once.
pub const SAMPLE_PERIOD: Duration = Duration::from_secs(1);
/// Time for which it listens then: two empty frames of 544 us, the longest random backoff between them, which has
/// 2,240 us, its clear-channel assessment and turnaround of 320 us, and as long again for the software.
pub const SAMPLE: Duration = Duration::from_millis(5);

/// A transceiver for IEEE 802.15.4 frames. The module documentation is its contract.
pub trait Radio {
    /// Reason why the radio does not work.
    type Error: fmt::Debug;

    /// Takes over the channel, the power and the addresses, and starts to receive.
    ///
    /// # Errors
    /// The hardware failed or does not support the configuration.
    fn configure(&mut self, config: &RadioConfig) -> impl Future<Output = Result<(), Self::Error>>;

    /// Sends one frame.
    ///
    /// # Errors
    /// The hardware failed, the radio is not configured, or the length is impossible.
    fn transmit(&mut self, frame: &[u8]) -> impl Future<Output = Result<TxOutcome, Self::Error>>;

    /// Waits for the next frame and writes it to the start of `buffer`.
    ///
    /// # Errors
    /// The hardware failed or the radio is not configured.
    fn receive(
        &mut self,
        buffer: &mut [u8; PSDU_MAX],
    ) -> impl Future<Output = Result<Received, Self::Error>>;
}

impl<R: Radio> Radio for &mut R {
    type Error = R::Error;

    fn configure(&mut self, config: &RadioConfig) -> impl Future<Output = Result<(), Self::Error>> {
        R::configure(self, config)
    }

    fn transmit(&mut self, frame: &[u8]) -> impl Future<Output = Result<TxOutcome, Self::Error>> {
        R::transmit(self, frame)
    }

    fn receive(
        &mut self,
        buffer: &mut [u8; PSDU_MAX],
    ) -> impl Future<Output = Result<Received, Self::Error>> {
        R::receive(self, buffer)
    }
}

/// A channel of the 2.4 GHz band.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Channel(u8);

impl Channel {
    /// The lowest channel, 11 (2405 MHz).
    pub const FIRST: Self = Self(11);
    /// The highest channel, 26 (2480 MHz).
    pub const LAST: Self = Self(26);

    /// The channel with this number, if there is one: 11 to 26.
    pub const fn new(number: u8) -> Option<Self> {
        if number >= Self::FIRST.0 && number <= Self::LAST.0 {
            Some(Self(number))
        } else {
            None
        }
    }

    /// The number, 11 to 26.
    pub const fn number(self) -> u8 {
        self.0
    }
}

impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Configuration of a radio.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RadioConfig {
    /// The channel to send and listen on.
    pub channel: Channel,
    /// Transmit power, dBm. A radio takes the nearest it has.
    pub tx_power: i8,
    /// The own PAN, [`PanId::BROADCAST`] for none.
    pub pan: PanId,
    /// The own short address, [`ShortAddress::BROADCAST`] for none.
    pub short: ShortAddress,
    /// The own extended address.
    pub extended: Eui64,
    /// True if this device is the PAN's coordinator, which also receives frames without a destination address.
    pub coordinator: bool,
    /// Deliver every frame, for any address.
    pub promiscuous: bool,
    /// Listen for [`SAMPLE`] of each [`SAMPLE_PERIOD`] only, and longer while a frame arrives. A radio that cannot
    /// listens always.
    pub sampled: bool,
}

/// Result of a transmission.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use]
#[non_exhaustive]
pub enum TxOutcome {
    /// The frame was on the air. Only the layers above know which nodes heard it.
    Sent,
    /// Not sent: the channel was busy throughout.
    ChannelBusy,
}

/// Facts about a received frame besides its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Received {
    /// Bytes of the frame in the buffer, at most [`PSDU_MAX`].
    pub len: usize,
    /// The channel it came on.
    pub channel: Channel,
    /// Received signal strength, dBm, if the radio measures it.
    pub rssi: Option<i8>,
    /// Link quality, 0 worst to 255 best, if the radio measures it.
    pub lqi: Option<u8>,
}

impl Received {
    /// Strength of the frame, more for better, by any measure the radio has: to compare with other frames that the
    /// same radio received. 0 if it has none.
    pub fn strength(&self) -> u8 {
        match (self.rssi, self.lqi) {
            (Some(rssi), _) => rssi.cast_unsigned() ^ 0x80,
            (None, lqi) => lqi.unwrap_or(0),
        }
    }

    /// The frame in the buffer that it was received into.
    pub fn frame<'b>(&self, buffer: &'b [u8; PSDU_MAX]) -> &'b [u8] {
        debug_assert!(self.len <= PSDU_MAX, "{} bytes received", self.len);
        buffer.get(..self.len).unwrap_or_default()
    }
}
