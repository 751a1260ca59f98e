//! Unslotted CSMA-CA (IEEE 802.15.4-2006, 7.5.1.4), for radios with one clear-channel assessment.

use core::future::Future;

use embedded_hal_async::delay::DelayNs;

use super::{CSMA_BACKOFFS, PSDU_MAX, Radio, RadioConfig, Received, TxOutcome};
use crate::jitter::Jitter;

/// `aUnitBackoffPeriod`, us.
const BACKOFF_UNIT_US: u32 = 320;
/// `macMinBE`.
const MIN_EXPONENT: u8 = 3;
/// `macMaxBE`.
const MAX_EXPONENT: u8 = 5;

/// A radio that backs off before each attempt to send.
///
/// A radio without a queue hears nothing during the backoffs, which are 2 ms in
/// the mean.
#[derive(Clone, Debug)]
pub struct Csma<R, D> {
    radio: R,
    delay: D,
    jitter: Jitter,
}

impl<R, D> Csma<R, D> {
    /// Over this radio. `seed` should differ between nodes, and from that of the [network](crate::network::NetworkSettings).
    pub const fn new(radio: R, delay: D, seed: u64) -> Self {
        Self {
            radio,
            delay,
            jitter: Jitter::new(seed),
        }
    }
}

impl<R: Radio, D: DelayNs> Radio for Csma<R, D> {
    type Error = R::Error;

    fn configure(&mut self, config: &RadioConfig) -> impl Future<Output = Result<(), R::Error>> {
        self.radio.configure(config)
    }

    async fn transmit(&mut self, frame: &[u8]) -> Result<TxOutcome, R::Error> {
        for attempt in 0..=CSMA_BACKOFFS {
            let exponent = (MIN_EXPONENT + attempt).min(MAX_EXPONENT);
            let units = self.jitter.below(1 << exponent);
            self.delay.delay_us(units * BACKOFF_UNIT_US).await;
            match self.radio.transmit(frame).await? {
                TxOutcome::ChannelBusy => {}
                outcome => return Ok(outcome),
            }
        }
        Ok(TxOutcome::ChannelBusy)
    }

    fn receive(
        &mut self,
        buffer: &mut [u8; PSDU_MAX],
    ) -> impl Future<Output = Result<Received, R::Error>> {
        self.radio.receive(buffer)
    }
}
