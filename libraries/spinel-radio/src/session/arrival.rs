//! Received frames until the caller asks for them.

use heapless::{Deque, Vec};

use super::{Counters, count};
use crate::stream::RxFrame;
use zigbee_link::radio::{Channel, FCS_LEN, FRAME_MAX, FRAME_MIN, PSDU_MAX, RadioConfig, Received};

/// A frame without its FCS, and its metadata.
#[derive(Clone, Debug)]
pub(super) struct Arrival {
    frame: Vec<u8, FRAME_MAX>,
    received: Received,
}

impl Arrival {
    /// A frame as it is to be delivered.
    ///
    /// # Errors
    /// It was received with an error, or its length is impossible.
    fn new(frame: &RxFrame<'_>, config: &RadioConfig) -> Result<Self, Unusable> {
        if frame.error != 0 || frame.flags & RxFrame::BAD_FCS != 0 {
            return Err(Unusable);
        }
        let len = frame.psdu.len().saturating_sub(FCS_LEN);
        let bytes = frame.psdu.get(..len).ok_or(Unusable)?;
        if len < FRAME_MIN {
            return Err(Unusable);
        }
        let bytes = Vec::from_slice(bytes).map_err(|_| Unusable)?;
        Ok(Self {
            frame: bytes,
            received: Received {
                len,
                channel: Channel::new(frame.channel).unwrap_or(config.channel),
                rssi: (frame.rssi != RxFrame::NO_RSSI).then_some(frame.rssi),
                lqi: (frame.lqi != 0).then_some(frame.lqi),
            },
        })
    }

    /// Writes the frame to the start of `buffer`.
    pub(super) fn deliver(&self, buffer: &mut [u8; PSDU_MAX]) -> Received {
        for (place, &byte) in buffer.iter_mut().zip(&self.frame) {
            *place = byte;
        }
        self.received
    }
}

struct Unusable;

/// Queues a frame, or counts the reason why not.
pub(super) fn arrived<const QUEUE: usize>(
    frame: &RxFrame<'_>,
    config: &RadioConfig,
    queue: &mut Deque<Arrival, QUEUE>,
    counters: &mut Counters,
) {
    match Arrival::new(frame, config) {
        Ok(arrival) => {
            if queue.push_back(arrival).is_err() {
                count(&mut counters.queue_full);
            }
        }
        Err(Unusable) => count(&mut counters.unusable),
    }
}
