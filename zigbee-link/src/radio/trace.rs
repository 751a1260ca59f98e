//! Captures of everything a radio sends and receives.

use super::{Channel, PSDU_MAX, Radio, RadioConfig, Received, TxOutcome};
use crate::{Instant, runner::Clock, wire::fcs};

/// Bytes of the header of a pcap file.
pub const PCAP_HEADER_LEN: usize = 24;
/// Bytes of the longest pcap record: its header, the TAP header, a PSDU.
pub const PCAP_RECORD_MAX: usize = 16 + TAP_LEN + PSDU_MAX;

/// Link type 283, IEEE 802.15.4 TAP: each frame with its channel and signal strength.
const LINK_TYPE: u32 = 283;
/// TAP header (4) with the elements FCS type, channel (8 each), and RSS (8).
const TAP_LEN: usize = 4 + 8 + 8 + 8;

/// The header of a pcap file: microseconds, little-endian, link type 283.
///
/// Version 2.4 of the format; <https://www.tcpdump.org/manpages/pcap-savefile.5.html>.
pub fn pcap_header() -> [u8; PCAP_HEADER_LEN] {
    let mut header = [0; PCAP_HEADER_LEN];
    let fields = [0xA1B2_C3D4, 0x0004_0002, 0, 0, 65535, LINK_TYPE];
    for (place, field) in header.as_chunks_mut::<4>().0.iter_mut().zip(fields) {
        place.copy_from_slice(&u32::to_le_bytes(field));
    }
    header
}

/// One record of a pcap file: a frame without FCS, which is added.
///
/// TAP elements as in <https://github.com/jkcko/ieee802.15.4-tap>. `None` for a frame longer than
/// [`FRAME_MAX`](super::FRAME_MAX).
pub fn pcap_record(
    at: Instant,
    channel: Channel,
    rssi: Option<i8>,
    frame: &[u8],
) -> Option<heapless::Vec<u8, PCAP_RECORD_MAX>> {
    const FCS_TYPE: u16 = 0;
    const RSS: u16 = 1;
    const CHANNEL: u16 = 3;
    if frame.len() > super::FRAME_MAX {
        return None;
    }
    let tap = if rssi.is_some() { TAP_LEN } else { TAP_LEN - 8 };
    let len = u32::try_from(tap + frame.len() + super::FCS_LEN).ok()?;
    let mut record = heapless::Vec::new();
    let seconds = (at.0 / 1_000_000) as u32;
    let micros = (at.0 % 1_000_000) as u32;
    for field in [seconds, micros, len, len] {
        record.extend_from_slice(&field.to_le_bytes()).ok()?;
    }
    let tap = u16::try_from(tap).ok()?;
    // Version 0 and the length of the header; then elements of type, length and padded value.
    let rss = rssi.map(|rssi| {
        let [a, b, c, d] = f32::from(rssi).to_le_bytes();
        [
            RSS,
            4,
            u16::from_le_bytes([a, b]),
            u16::from_le_bytes([c, d]),
        ]
    });
    let halves = [0, tap]
        .into_iter()
        .chain([FCS_TYPE, 1, 1, 0])
        .chain([CHANNEL, 3, u16::from(channel.number()), 0])
        .chain(rss.into_iter().flatten());
    for half in halves {
        record.extend_from_slice(&half.to_le_bytes()).ok()?;
    }
    record.extend_from_slice(frame).ok()?;
    record.extend_from_slice(&fcs(frame).to_le_bytes()).ok()?;
    Some(record)
}

/// Takes captured records.
pub trait Sink {
    /// Takes one record, whole. The header is not among them.
    fn record(&mut self, record: &[u8]);
}

impl<F: FnMut(&[u8])> Sink for F {
    fn record(&mut self, record: &[u8]) {
        self(record);
    }
}

/// A radio that copies every frame sent and received to a pcap [`Sink`].
///
/// Frames are recorded with a fresh FCS.
#[derive(Clone, Debug)]
pub struct Tracer<R, C, S> {
    radio: R,
    clock: C,
    sink: S,
    channel: Channel,
}

impl<R, C: Clock, S: Sink> Tracer<R, C, S> {
    /// Over this radio.
    pub const fn new(radio: R, clock: C, sink: S) -> Self {
        Self {
            radio,
            clock,
            sink,
            channel: Channel::FIRST,
        }
    }

    fn trace(&mut self, channel: Channel, rssi: Option<i8>, frame: &[u8]) {
        if let Some(record) = pcap_record(self.clock.now(), channel, rssi, frame) {
            self.sink.record(&record);
        }
    }
}

impl<R: Radio, C: Clock, S: Sink> Radio for Tracer<R, C, S> {
    type Error = R::Error;

    async fn configure(&mut self, config: &RadioConfig) -> Result<(), R::Error> {
        self.channel = config.channel;
        self.radio.configure(config).await
    }

    async fn transmit(&mut self, frame: &[u8]) -> Result<TxOutcome, R::Error> {
        let outcome = self.radio.transmit(frame).await?;
        if outcome != TxOutcome::ChannelBusy {
            self.trace(self.channel, None, frame);
        }
        Ok(outcome)
    }

    async fn receive(&mut self, buffer: &mut [u8; PSDU_MAX]) -> Result<Received, R::Error> {
        let received = self.radio.receive(buffer).await?;
        self.trace(received.channel, received.rssi, received.frame(buffer));
        Ok(received)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::FRAME_MAX;

    #[test]
    fn file_of_one_frame() {
        let header = [
            0xD4, 0xC3, 0xB2, 0xA1, 2, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xFF, 0xFF, 0, 0, 0x1B, 1,
            0, 0,
        ];
        assert_eq!(pcap_header(), header);
        let frame = [0x02, 0x00, 0x6A];
        let record = |rssi| pcap_record(Instant(3_000_007), Channel::LAST, rssi, &frame).unwrap();
        let with_strength = [
            3, 0, 0, 0, 7, 0, 0, 0, 33, 0, 0, 0, 33, 0, 0, 0, // times and lengths
            0, 0, 28, 0, // TAP version 0, and its length
            0, 0, 1, 0, 1, 0, 0, 0, // FCS of 16 bits
            3, 0, 3, 0, 26, 0, 0, 0, // channel 26, page 0
            1, 0, 4, 0, 0, 0, 0x20, 0xC2, // -40 dBm
            0x02, 0x00, 0x6A, 0xE4, 0x79,
        ];
        assert_eq!(record(Some(-40)), with_strength);
        let without = [
            3, 0, 0, 0, 7, 0, 0, 0, 25, 0, 0, 0, 25, 0, 0, 0, 0, 0, 20, 0, 0, 0, 1, 0, 1, 0, 0, 0,
            3, 0, 3, 0, 26, 0, 0, 0, 0x02, 0x00, 0x6A, 0xE4, 0x79,
        ];
        assert_eq!(record(None), without);
    }

    #[test]
    fn the_longest_frame_fits() {
        let record = |len| pcap_record(Instant(0), Channel::FIRST, Some(0), &[0; 200][..len]);
        assert_eq!(record(FRAME_MAX).unwrap().len(), PCAP_RECORD_MAX);
        assert_eq!(record(FRAME_MAX + 1), None);
    }
}
