//! A bad medium, reproducibly.

use super::{PSDU_MAX, Radio, RadioConfig, Received, TxOutcome};
use crate::jitter::Jitter;

/// Faults of the medium. Probabilities are in thousandths, and independent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Faults {
    /// A frame is sent, and no radio hears it.
    pub tx_lost: u16,
    /// A received frame is lost.
    pub rx_lost: u16,
    /// A bit of a received frame is flipped.
    pub rx_flipped: u16,
    /// A received frame is cut off.
    pub rx_truncated: u16,
    /// A received frame is delivered twice.
    pub rx_doubled: u16,
}

/// A radio that loses, damages and doubles frames. It breaks rules 10 and 12 of the contract on purpose.
#[derive(Clone, Debug)]
pub struct FaultInjector<R> {
    radio: R,
    faults: Faults,
    jitter: Jitter,
    again: Option<([u8; PSDU_MAX], Received)>,
}

impl<R> FaultInjector<R> {
    /// Over this radio; the same seed makes the same faults.
    pub const fn new(radio: R, faults: Faults, seed: u64) -> Self {
        Self {
            radio,
            faults,
            jitter: Jitter::new(seed),
            again: None,
        }
    }

    fn happens(&mut self, thousandths: u16) -> bool {
        self.jitter.below(1000) < u32::from(thousandths)
    }
}

impl<R: Radio> Radio for FaultInjector<R> {
    type Error = R::Error;

    async fn configure(&mut self, config: &RadioConfig) -> Result<(), R::Error> {
        self.radio.configure(config).await
    }

    async fn transmit(&mut self, frame: &[u8]) -> Result<TxOutcome, R::Error> {
        if self.happens(self.faults.tx_lost) {
            return Ok(TxOutcome::Sent);
        }
        self.radio.transmit(frame).await
    }

    async fn receive(&mut self, buffer: &mut [u8; PSDU_MAX]) -> Result<Received, R::Error> {
        if let Some((bytes, received)) = self.again.take() {
            *buffer = bytes;
            return Ok(received);
        }
        loop {
            let mut received = self.radio.receive(buffer).await?;
            if self.happens(self.faults.rx_lost) {
                continue;
            }
            if self.happens(self.faults.rx_flipped) {
                let bit = self.jitter.below(received.len as u32 * 8) as usize;
                if let Some(byte) = buffer.get_mut(bit / 8) {
                    *byte ^= 1 << (bit % 8);
                }
            }
            if self.happens(self.faults.rx_truncated) {
                received.len = self.jitter.below(received.len as u32) as usize;
            }
            if self.happens(self.faults.rx_doubled) {
                self.again = Some((*buffer, received));
            }
            return Ok(received);
        }
    }
}
