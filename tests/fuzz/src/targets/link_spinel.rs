//! Any bytes from a co-processor: no panic, a message that is understood survives being written, every request
//! ends, and afterwards a co-processor that works is brought to work.
//!
//! The input is cut at 0xF6. The first byte of a part selects the request; then 0xF7 lets the next deadline pass,
//! 0xF5 wraps the bytes up to the next of these into a good HDLC frame, and everything else comes as it is.

use spinel_radio::{
    RcpPolicy,
    frame::{Body, SpinelMessage},
    hdlc,
    property::{Capabilities, Property, PropertyKey, ProtocolVersion},
    session::{RcpOutcome, RcpRequest, RcpSession},
    status::SpinelStatus,
};
use zigbee_link::{
    Instant,
    radio::{Channel, FRAME_MAX, FRAME_MIN, PSDU_MAX, RadioConfig},
    wire::{Eui64, PanId, ShortAddress},
};

const CONFIG: RadioConfig = RadioConfig {
    channel: Channel::FIRST,
    tx_power: 0,
    pan: PanId(0x3412),
    short: ShortAddress(1),
    extended: Eui64([1; 8]),
    coordinator: true,
    promiscuous: false,
    sampled: false,
};
const FRAME: &[u8] = &[0x61, 0x88, 7, 0x34, 0x12, 9, 0, 1, 0, b'h', b'i'];

struct Bench {
    session: RcpSession<2>,
    now: Instant,
}

/// Tries one input.
pub(crate) fn run(input: &[u8]) {
    let mut bench = Bench {
        session: RcpSession::new(RcpPolicy::default()),
        now: Instant(0),
    };
    for part in input.split(|&byte| byte == 0xF6) {
        let Some((&selector, happenings)) = part.split_first() else {
            continue;
        };
        bench.session.begin(request(selector), bench.now);
        bench.happen(happenings);
    }
    bench.work(RcpRequest::Configure(CONFIG));
    bench.work(RcpRequest::Transmit(FRAME));
}

fn request(selector: u8) -> RcpRequest<'static> {
    match selector % 5 {
        0 | 1 => RcpRequest::Configure(CONFIG),
        2 => RcpRequest::Transmit(FRAME),
        3 => RcpRequest::Transmit(&[]),
        _ => RcpRequest::Listen,
    }
}

impl Bench {
    fn happen(&mut self, happenings: &[u8]) {
        let mut rest = happenings;
        while let Some((&first, tail)) = rest.split_first() {
            // Bytes to be sent go out, in pieces of any size.
            self.session.output(&mut [0; 64][..usize::from(first % 64)]);
            match first {
                0xF7 => {
                    self.pass();
                    rest = tail;
                }
                0xF5 => {
                    let end = tail.iter().position(|byte| matches!(byte, 0xF5 | 0xF7));
                    let (content, next) = tail.split_at(end.unwrap_or(tail.len()));
                    survives(content);
                    let line: Vec<u8> = hdlc::encode(content).collect();
                    self.session.input(&line, self.now);
                    rest = next;
                }
                byte => {
                    self.session.input(&[byte], self.now);
                    rest = tail;
                }
            }
            let _ = self.session.outcome();
            let mut buffer = [0; PSDU_MAX];
            if let Some(received) = self.session.receive(&mut buffer) {
                assert!((FRAME_MIN..=FRAME_MAX).contains(&received.len));
            }
        }
    }

    fn pass(&mut self) {
        if let Some(deadline) = self.session.deadline() {
            self.now = deadline;
            self.session.tick(deadline);
        }
    }

    /// With a co-processor that works.
    fn work(&mut self, request: RcpRequest<'_>) {
        let mut decoder = hdlc::Decoder::<256>::new();
        self.session.begin(request, self.now);
        for _ in 0..1000 {
            match self.session.outcome() {
                Some(Ok(RcpOutcome::Configured | RcpOutcome::Transmitted(_))) => return,
                Some(Err(fault)) => panic!("{request:?}: {fault}"),
                None => {}
            }
            let mut line = [0; 512];
            let len = self.session.output(&mut line);
            if len == 0 {
                self.pass();
            }
            for &byte in &line[..len] {
                if let Some(content) = decoder.push(byte) {
                    let message = SpinelMessage::parse(content).expect("it speaks Spinel");
                    self.session.input(&answer(&message), self.now);
                }
            }
        }
        panic!("{request:?} never ends");
    }
}

fn answer(message: &SpinelMessage<'_>) -> Vec<u8> {
    let property = match message.body {
        Body::Reset(_) => Property::LastStatus(SpinelStatus::RESET_POWER_ON, None),
        Body::Get(PropertyKey::PROTOCOL_VERSION) => {
            Property::ProtocolVersion(ProtocolVersion { major: 4, minor: 3 })
        }
        Body::Get(PropertyKey::CAPS) => Property::Capabilities(Capabilities(&[0x81, 0x04])),
        Body::Get(PropertyKey::HWADDR) => Property::HardwareAddress(Eui64([2; 8])),
        Body::Get(PropertyKey::NCP_VERSION) => Property::NcpVersion(b"A"),
        Body::Set(property) if property.key() != PropertyKey::STREAM_RAW => property,
        _ => Property::LastStatus(SpinelStatus::OK, None),
    };
    let mut content = [0; 256];
    let answer = SpinelMessage {
        header: message.header,
        body: Body::Is(property),
    };
    let len = answer.emit(&mut content).expect("it is short");
    hdlc::encode(&content[..len]).collect()
}

/// A message that was understood stays the same when it is written and read again.
fn survives(content: &[u8]) {
    let Ok(message) = SpinelMessage::parse(content) else {
        return;
    };
    let mut buffer = vec![0; content.len() + 64];
    let len = message.emit(&mut buffer).expect("there is room");
    assert_eq!(SpinelMessage::parse(&buffer[..len]), Ok(message));
}
