//! A radio co-processor on a [`Medium`]: Spinel on a UART, as OpenThread's `ot-rcp` speaks it.
//!
//! It has the properties that [`spinel_radio::SpinelRadio`] uses, and appends frame check
//! sequences, filters addresses and backs off before a busy channel. It neither sends
//! acknowledgements nor waits for them: a frame that requests one is sent once and told as not
//! acknowledged.

use std::future::pending;

use embassy_futures::select::{Either, select};
use embedded_io_async::{Read, Write};
use spinel_radio::{
    frame::{Body, SpinelHeader, SpinelMessage, Tid},
    hdlc::{self, Decoder},
    property::{self, Property, PropertyKey, TxReport},
    status::SpinelStatus,
    stream::{RxFrame, TxFrame},
};
use zigbee_link::{
    radio::{
        Channel, Csma, FCS_LEN, FRAME_MIN, PSDU_MAX, Radio as _, RadioConfig, Received, TxOutcome,
    },
    wire::{Eui64, PanId, ShortAddress, fcs},
};

use super::{
    executor::Clock,
    medium::{Medium, NRF52840, NodeId, Radio},
};

/// OpenThread's.
const PROTOCOL: (u32, u32) = (4, 3);
/// `CONFIG_RADIO` and `MAC_RAW`, packed.
const CAPABILITIES: [u8; 3] = [34, 0x81, 0x04];
const FIRMWARE: &[u8] = b"host-sim";
/// `STATUS_RESET_SOFTWARE`.
const RESET_SOFTWARE: SpinelStatus = SpinelStatus(SpinelStatus::RESET_POWER_ON.0 + 2);

/// Content and CRC of the longest command.
const COMMAND_MAX: usize = 192;
/// Content of the longest answer.
const ANSWER_MAX: usize = 256;

/// A co-processor. See the [module](self).
pub struct CoProcessor<U> {
    uart: U,
    medium: Medium,
    antenna: NodeId,
    clock: Clock,
    address: Eui64,
    seed: u64,
    config: RadioConfig,
    streams: bool,
    /// While it is enabled.
    radio: Option<Csma<Radio, Clock>>,
}

impl<U: Read + Write> CoProcessor<U> {
    /// On this antenna, which no other radio uses. `address` is its own, which a host need not use;
    /// `seed` should differ between co-processors.
    pub fn new(
        uart: U,
        medium: &Medium,
        antenna: NodeId,
        clock: Clock,
        address: Eui64,
        seed: u64,
    ) -> Self {
        Self {
            uart,
            medium: medium.clone(),
            antenna,
            clock,
            address,
            seed,
            config: initial(),
            streams: false,
            radio: None,
        }
    }

    /// Works until the UART is closed.
    ///
    /// # Errors
    /// The UART failed.
    pub async fn run(mut self) -> Result<(), U::Error> {
        let mut decoder = Decoder::<COMMAND_MAX>::new();
        let mut chunk = [0; 64];
        let mut psdu = [0; PSDU_MAX];
        self.tell_status(Tid::UNSOLICITED, SpinelStatus::RESET_POWER_ON)
            .await?;
        loop {
            let heard = async {
                match &mut self.radio {
                    Some(radio) => radio.receive(&mut psdu).await,
                    None => pending().await,
                }
            };
            match select(self.uart.read(&mut chunk), heard).await {
                Either::First(count) => match count? {
                    0 => return Ok(()),
                    count => {
                        for &byte in &chunk[..count] {
                            if let Some(content) = decoder.push(byte) {
                                self.obey(content).await?;
                            }
                        }
                    }
                },
                Either::Second(Ok(received)) if self.streams => {
                    self.tell_frame(&mut psdu, received).await?;
                }
                Either::Second(_) => {}
            }
        }
    }

    async fn obey(&mut self, content: &[u8]) -> Result<(), U::Error> {
        let Ok(SpinelMessage { header, body }) = SpinelMessage::parse(content) else {
            let tid = content.first().and_then(|byte| Tid::new(byte & 0xF));
            let tid = tid.unwrap_or_default();
            return self.tell_status(tid, SpinelStatus::PARSE_ERROR).await;
        };
        let tid = header.tid;
        match body {
            Body::Noop => self.tell_status(tid, SpinelStatus::OK).await,
            Body::Reset(_) => {
                self.radio = None;
                self.streams = false;
                self.config = initial();
                self.tell_status(Tid::UNSOLICITED, RESET_SOFTWARE).await
            }
            Body::Get(key) => match self.get(key) {
                Some(property) => self.tell(tid, property).await,
                None => {
                    self.tell_status(tid, SpinelStatus::PROPERTY_NOT_FOUND)
                        .await
                }
            },
            Body::Set(Property::Send(frame)) => self.send(tid, &frame).await,
            Body::Set(property) => match self.set(&property).await {
                Ok(()) => self.tell(tid, property).await,
                Err(status) => self.tell_status(tid, status).await,
            },
            Body::Is(_) => self.tell_status(tid, SpinelStatus::UNIMPLEMENTED).await,
        }
    }

    fn get(&self, key: PropertyKey) -> Option<Property<'static>> {
        Some(match key {
            PropertyKey::PROTOCOL_VERSION => Property::ProtocolVersion {
                major: PROTOCOL.0,
                minor: PROTOCOL.1,
            },
            PropertyKey::NCP_VERSION => Property::NcpVersion(FIRMWARE),
            PropertyKey::CAPS => Property::Capabilities(property::Capabilities(&CAPABILITIES)),
            PropertyKey::HWADDR => Property::HardwareAddress(self.address),
            PropertyKey::PHY_ENABLED => Property::PhyEnabled(self.radio.is_some()),
            PropertyKey::PHY_CHAN => Property::PhyChannel(self.config.channel.number()),
            PropertyKey::PHY_TX_POWER => Property::PhyTxPower(self.config.tx_power),
            PropertyKey::MAC_15_4_PANID => Property::MacPan(self.config.pan),
            PropertyKey::MAC_15_4_SADDR => Property::MacShort(self.config.short),
            PropertyKey::MAC_15_4_LADDR => Property::MacExtended(self.config.extended),
            PropertyKey::MAC_RAW_STREAM_ENABLED => Property::MacRawStream(self.streams),
            _ => return None,
        })
    }

    async fn set(&mut self, property: &Property<'_>) -> Result<(), SpinelStatus> {
        match *property {
            Property::PhyEnabled(false) => self.radio = None,
            Property::PhyEnabled(true) if self.radio.is_none() => {
                let radio = self.medium.radio(self.antenna, NRF52840);
                self.radio = Some(Csma::new(radio, self.clock.clone(), self.seed));
            }
            Property::PhyEnabled(true) | Property::MacSourceMatch(_) => {}
            Property::PhyChannel(number) => {
                self.config.channel = Channel::new(number).ok_or(SpinelStatus::INVALID_ARGUMENT)?;
            }
            Property::PhyTxPower(power) => self.config.tx_power = power,
            Property::MacPan(pan) => self.config.pan = pan,
            Property::MacShort(short) => self.config.short = short,
            Property::MacExtended(extended) => self.config.extended = extended,
            Property::MacRawStream(streams) => self.streams = streams,
            Property::MacPromiscuous(promiscuity) => {
                self.config.promiscuous = promiscuity != property::Promiscuity::Off;
            }
            _ => return Err(SpinelStatus::PROPERTY_NOT_FOUND),
        }
        match &mut self.radio {
            Some(radio) => radio
                .configure(&self.config)
                .await
                .map_err(|_| SpinelStatus::FAILURE),
            None => Ok(()),
        }
    }

    async fn send(&mut self, tid: Tid, frame: &TxFrame<'_>) -> Result<(), U::Error> {
        let (Some(radio), true) = (&mut self.radio, self.streams) else {
            return self.tell_status(tid, SpinelStatus::INVALID_STATE).await;
        };
        let bytes = match frame.psdu.len().checked_sub(FCS_LEN) {
            Some(len @ FRAME_MIN..) if frame.channel == self.config.channel.number() => {
                &frame.psdu[..len]
            }
            _ => return self.tell_status(tid, SpinelStatus::INVALID_ARGUMENT).await,
        };
        let wants_acknowledgement = bytes[0] & 0x20 != 0;
        let status = match radio.transmit(bytes).await {
            Ok(TxOutcome::ChannelBusy) => SpinelStatus::CCA_FAILURE,
            Ok(_) if wants_acknowledgement => SpinelStatus::NO_ACK,
            Ok(_) => SpinelStatus::OK,
            Err(_) => SpinelStatus::FAILURE,
        };
        let report = TxReport {
            frame_pending: false,
            header_updated: frame.header_updated,
            acknowledgement: (status == SpinelStatus::OK).then_some(RxFrame::new(&[])),
        };
        self.tell(tid, Property::LastStatus(status, Some(report)))
            .await
    }

    async fn tell_frame(
        &mut self,
        buffer: &mut [u8; PSDU_MAX],
        received: Received,
    ) -> Result<(), U::Error> {
        let end = received.len + FCS_LEN;
        let check = fcs(&buffer[..received.len]).to_le_bytes();
        buffer[received.len..end].copy_from_slice(&check);
        let frame = RxFrame {
            rssi: received.rssi.unwrap_or(RxFrame::NO_RSSI),
            channel: received.channel.number(),
            lqi: received.lqi.unwrap_or_default(),
            timestamp: self.clock.time() / 1_000,
            ..RxFrame::new(&buffer[..end])
        };
        self.tell(Tid::UNSOLICITED, Property::Received(frame)).await
    }

    async fn tell_status(&mut self, tid: Tid, status: SpinelStatus) -> Result<(), U::Error> {
        self.tell(tid, Property::LastStatus(status, None)).await
    }

    async fn tell(&mut self, tid: Tid, property: Property<'_>) -> Result<(), U::Error> {
        let message = SpinelMessage {
            header: SpinelHeader::new(tid),
            body: Body::Is(property),
        };
        let mut content = [0; ANSWER_MAX];
        // Every answer of this module fits.
        let len = message.emit(&mut content).unwrap_or(0);
        let line: Vec<u8> = hdlc::encode(&content[..len]).collect();
        self.uart.write_all(&line).await
    }
}

/// After a reset.
fn initial() -> RadioConfig {
    RadioConfig {
        channel: Channel::FIRST,
        tx_power: 0,
        pan: PanId::BROADCAST,
        short: ShortAddress::BROADCAST,
        extended: Eui64([0; 8]),
        // Nobody tells a co-processor; its host filters again.
        coordinator: true,
        promiscuous: false,
    }
}
