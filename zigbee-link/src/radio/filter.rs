//! Address filtering, for radios without it.

use super::{Capabilities, Config, PSDU_MAX, Radio, Received, TxOutcome};
use crate::wire::{Address, Frame, FrameType, PanId, ShortAddress};

impl Config {
    /// Whether a radio with this configuration, not promiscuous, delivers a frame (third level of
    /// filtering, IEEE 802.15.4-2006, 7.5.6.2). An FCS at the end makes no difference.
    ///
    /// Frames that are not understood are not delivered.
    pub fn accepts(&self, frame: &[u8]) -> bool {
        let Ok(frame) = Frame::parse(frame) else {
            return false;
        };
        let header = frame.header();
        let own_pan = |pan: Option<PanId>| pan.is_some_and(|pan| pan == self.pan);
        match header.frame_type {
            FrameType::Acknowledgement => return false,
            // Of its own network, or of any while it has none.
            FrameType::Beacon => return own_pan(header.source.pan) || self.pan == PanId::BROADCAST,
            FrameType::Data | FrameType::Command => {}
        }
        let destination = header.destination;
        if destination.pan.is_none() && destination.address.is_none() {
            return self.coordinator && own_pan(header.source.pan);
        }
        // A compressed identifier is the other address's, which then is of the same network.
        let pan = destination.pan.or(header.source.pan);
        if !own_pan(pan) && pan.is_some_and(|pan| pan != PanId::BROADCAST) {
            return false;
        }
        match destination.address {
            None => self.coordinator,
            Some(Address::Extended(extended)) => extended == self.extended,
            Some(Address::Short(short)) => {
                short == ShortAddress::BROADCAST || (short == self.short && short.is_unicast())
            }
        }
    }
}

/// A radio that delivers only frames for its configured addresses.
#[derive(Clone, Debug)]
pub struct Filter<R> {
    radio: R,
    config: Option<Config>,
}

impl<R> Filter<R> {
    /// Over this radio.
    pub const fn new(radio: R) -> Self {
        Self {
            radio,
            config: None,
        }
    }
}

impl<R: Radio> Radio for Filter<R> {
    type Error = R::Error;

    fn capabilities(&self) -> Capabilities {
        Capabilities {
            address_filter: true,
            ..self.radio.capabilities()
        }
    }

    async fn configure(&mut self, config: &Config) -> Result<(), R::Error> {
        self.config = Some(*config);
        self.radio.configure(config).await
    }

    async fn transmit(&mut self, frame: &[u8]) -> Result<TxOutcome, R::Error> {
        self.radio.transmit(frame).await
    }

    async fn receive(&mut self, buffer: &mut [u8; PSDU_MAX]) -> Result<Received, R::Error> {
        loop {
            let received = self.radio.receive(buffer).await?;
            let frame = buffer.get(..received.len).unwrap_or_default();
            let is_for_us = |config: &Config| config.promiscuous || config.accepts(frame);
            if self.config.as_ref().is_none_or(is_for_us) {
                return Ok(received);
            }
        }
    }
}
