//! Frames from the air by a co-processor on a mock: `cargo run -p spinel-radio --example listen`.
//!
//! The other end of the UART is a small co-processor in memory, made of the same messages in the other direction. On a
//! board, UART and clock come from its HAL; on a PC, the UART is a dongle with `ot-rcp`. Nothing else changes.

use std::{collections::VecDeque, convert::Infallible, future::pending};

use embassy_futures::block_on;
use embedded_io_async::{ErrorType, Read, Write};
use spinel_radio::{
    SpinelRadio,
    frame::{Body, SpinelHeader, SpinelMessage, Tid},
    hdlc,
    property::{Capabilities, Property, PropertyKey, ProtocolVersion},
    status::SpinelStatus,
    stream::RxFrame,
};
use zigbee_link::{
    Instant,
    radio::{Channel, PSDU_MAX, Radio, RadioConfig},
    runner::Clock,
    wire::{Eui64, PanId, ShortAddress},
};

/// A frame as a co-processor hands it over: a broadcast in PAN 0x1234 from 9 that says "hi", and its FCS.
const ON_AIR: &[u8] = &[
    0x41, 0x88, 7, 0x34, 0x12, 0xFF, 0xFF, 9, 0, b'h', b'i', 0xAA, 0xBB,
];

/// A UART with a co-processor at its other end, which hears one frame once it is configured.
struct Uart {
    commands: hdlc::Decoder<256>,
    answers: VecDeque<u8>,
}

impl Uart {
    fn tell(&mut self, tid: Tid, property: Property<'_>) {
        let message = SpinelMessage {
            header: SpinelHeader::new(tid),
            body: Body::Is(property),
        };
        let mut content = [0; 256];
        if let Ok(len) = message.emit(&mut content) {
            self.answers.extend(hdlc::encode(&content[..len]));
        }
    }

    fn obey(&mut self, content: &[u8]) {
        let Ok(message) = SpinelMessage::parse(content) else {
            return;
        };
        let tid = message.header.tid;
        match message.body {
            // 114: it has restarted because it was told to.
            Body::Reset(_) => self.tell(
                Tid::UNSOLICITED,
                Property::LastStatus(SpinelStatus(114), None),
            ),
            Body::Get(PropertyKey::PROTOCOL_VERSION) => {
                let version = ProtocolVersion { major: 4, minor: 3 };
                self.tell(tid, Property::ProtocolVersion(version));
            }
            // 5 is "controls its radio", and 0x81, 0x04 is 513: "raw frames".
            Body::Get(PropertyKey::CAPS) => {
                self.tell(tid, Property::Capabilities(Capabilities(&[5, 0x81, 0x04])));
            }
            Body::Get(PropertyKey::HWADDR) => {
                self.tell(tid, Property::HardwareAddress(Eui64([9; 8])));
            }
            Body::Get(_) => self.tell(tid, Property::NcpVersion(b"EXAMPLE/1.0")),
            Body::Set(property) => {
                self.tell(tid, property);
                if property == Property::MacRawStream(true) {
                    self.tell(Tid::UNSOLICITED, Property::Received(RxFrame::new(ON_AIR)));
                }
            }
            _ => self.tell(tid, Property::LastStatus(SpinelStatus::FAILURE, None)),
        }
    }
}

impl ErrorType for Uart {
    type Error = Infallible;
}

impl Write for Uart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        for &byte in bytes {
            let command = self.commands.push(byte).map(<[u8]>::to_vec);
            if let Some(command) = command {
                self.obey(&command);
            }
        }
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl Read for Uart {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        if self.answers.is_empty() {
            return pending().await;
        }
        let count = self.answers.len().min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(self.answers.drain(..count)) {
            *place = byte;
        }
        Ok(count)
    }
}

/// A clock that stands still: this co-processor is never late.
struct Still;

impl Clock for Still {
    fn now(&self) -> Instant {
        Instant(0)
    }

    async fn sleep_until(&self, _: Instant) {
        pending::<()>().await;
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let uart = Uart {
        commands: hdlc::Decoder::new(),
        answers: VecDeque::new(),
    };
    let config = RadioConfig {
        channel: Channel::FIRST,
        tx_power: 0,
        pan: PanId(0x1234),
        short: ShortAddress(2),
        extended: Eui64([3; 8]),
        coordinator: false,
        promiscuous: false,
        sampled: false,
    };
    let mut radio: SpinelRadio<_, _> = SpinelRadio::new(uart, Still);
    let mut buffer = [0; PSDU_MAX];
    block_on(async {
        radio.configure(&config).await?;
        let received = radio.receive(&mut buffer).await?;
        let frame = &buffer[..received.len];
        println!("{frame:02x?}");
        assert!(ON_AIR.starts_with(frame), "not as it was on the air");
        Ok(())
    })
}
