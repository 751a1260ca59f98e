//! The frame check sequence in software, for radios and media that carry bare PSDUs.

use core::fmt;

use super::{FRAME_MAX, PSDU_MAX, Radio, RadioConfig, Received, TxOutcome};
use crate::wire::{fcs, has_good_fcs};

/// A radio that appends the FCS, and drops frames where it is wrong.
#[derive(Clone, Debug)]
pub struct Checksum<R>(R);

/// Reason why such a radio does not work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ChecksumError<E> {
    /// The frame is longer than [`FRAME_MAX`].
    TooLong,
    /// The radio below failed.
    Radio(E),
}

impl<E> fmt::Display for ChecksumError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TooLong => "the frame leaves no room for its check sequence",
            Self::Radio(_) => "the radio failed",
        })
    }
}

impl<E: fmt::Debug> core::error::Error for ChecksumError<E> {}

impl<R> Checksum<R> {
    /// Over this radio, which must be one that carries bare PSDUs.
    pub const fn new(radio: R) -> Self {
        Self(radio)
    }
}

impl<R: Radio> Radio for Checksum<R> {
    type Error = ChecksumError<R::Error>;

    async fn configure(&mut self, config: &RadioConfig) -> Result<(), Self::Error> {
        let configured = self.0.configure(config).await;
        configured.map_err(ChecksumError::Radio)
    }

    async fn transmit(&mut self, frame: &[u8]) -> Result<TxOutcome, Self::Error> {
        let mut psdu = heapless::Vec::<u8, PSDU_MAX>::new();
        if frame.len() > FRAME_MAX {
            return Err(ChecksumError::TooLong);
        }
        let parts = [frame, &fcs(frame).to_le_bytes()];
        for part in parts {
            let appended = psdu.extend_from_slice(part);
            appended.map_err(|_| ChecksumError::TooLong)?;
        }
        self.0.transmit(&psdu).await.map_err(ChecksumError::Radio)
    }

    async fn receive(&mut self, buffer: &mut [u8; PSDU_MAX]) -> Result<Received, Self::Error> {
        loop {
            let received = self.0.receive(buffer).await;
            let received = received.map_err(ChecksumError::Radio)?;
            if has_good_fcs(received.frame(buffer)) {
                return Ok(Received {
                    len: received.len - super::FCS_LEN,
                    ..received
                });
            }
        }
    }
}
