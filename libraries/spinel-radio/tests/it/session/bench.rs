//! A session without a line, and a co-processor without fault.

use spinel_radio::{
    RcpFault, RcpPolicy,
    frame::{Body, SpinelHeader, SpinelMessage, Tid},
    hdlc,
    property::{Capabilities, Property, PropertyKey, ProtocolVersion, TxReport},
    session::{RcpOutcome, RcpRequest, RcpSession},
    status::SpinelStatus,
    stream::RxFrame,
};
use zigbee_link::{
    Instant,
    radio::{Channel, PSDU_MAX, RadioConfig, TxOutcome},
    wire::{Eui64, PanId, ShortAddress},
};

pub(crate) const CONFIG: RadioConfig = RadioConfig {
    channel: Channel::FIRST,
    tx_power: -3,
    pan: PanId(0x1234),
    short: ShortAddress(0x0042),
    extended: Eui64([1, 2, 3, 4, 5, 6, 7, 8]),
    coordinator: false,
    promiscuous: false,
    sampled: false,
};
pub(crate) const POLICY: RcpPolicy = RcpPolicy::DEFAULT;
/// For all of the PAN, and for one device.
pub(crate) const BROADCAST: &[u8] = &[0x41, 0x88, 7, 0x34, 0x12, 0xFF, 0xFF, 1, 0, b'h', b'i'];
pub(crate) const UNICAST: &[u8] = &[0x41, 0x88, 7, 0x34, 0x12, 9, 0, 1, 0, b'h', b'i'];
pub(crate) const SENT: Result<RcpOutcome, RcpFault> = Ok(RcpOutcome::Transmitted(TxOutcome::Sent));

/// A session and the co-processor at the other end of its line.
pub(crate) struct Bench {
    pub(crate) session: RcpSession<2>,
    pub(crate) now: Instant,
    pub(crate) decoder: hdlc::Decoder<256>,
    /// Frames that the session has sent.
    pub(crate) heard: Vec<Vec<u8>>,
}

impl Bench {
    pub(crate) fn new() -> Self {
        Self {
            session: RcpSession::new(POLICY),
            now: Instant(1_000),
            decoder: hdlc::Decoder::new(),
            heard: Vec::new(),
        }
    }

    pub(crate) fn configured() -> Self {
        let mut bench = Self::new();
        let outcome = bench.run(RcpRequest::Configure(CONFIG), works);
        assert_eq!(outcome, Ok(RcpOutcome::Configured));
        bench.heard.clear();
        bench
    }

    /// Runs until the session waits; returns true if it has sent something.
    pub(crate) fn exchange(
        &mut self,
        peer: &mut impl FnMut(&SpinelMessage<'_>) -> Vec<u8>,
    ) -> bool {
        let mut chunk = [0; 7];
        let mut answers = Vec::new();
        let mut has_sent = false;
        loop {
            let len = self.session.output(&mut chunk);
            if len == 0 {
                break;
            }
            has_sent = true;
            for &byte in &chunk[..len] {
                if let Some(content) = self.decoder.push(byte) {
                    self.heard.push(content.to_vec());
                    answers.extend(peer(&SpinelMessage::parse(content).unwrap()));
                }
            }
        }
        self.session.input(&answers, self.now);
        has_sent
    }

    pub(crate) fn run(
        &mut self,
        request: RcpRequest<'_>,
        mut peer: impl FnMut(&SpinelMessage<'_>) -> Vec<u8>,
    ) -> Result<RcpOutcome, RcpFault> {
        self.session.begin(request, self.now);
        for _ in 0..1000 {
            if let Some(outcome) = self.session.outcome() {
                return outcome;
            }
            if !self.exchange(&mut peer) {
                self.wait();
            }
        }
        panic!("{request:?} never ends");
    }

    pub(crate) fn wait(&mut self) {
        self.now = self.session.deadline().expect("waits for nothing");
        self.session.tick(self.now);
    }

    pub(crate) fn receive(&mut self) -> Option<Vec<u8>> {
        let mut buffer = [0; PSDU_MAX];
        let received = self.session.receive(&mut buffer)?;
        Some(buffer[..received.len].to_vec())
    }

    pub(crate) fn commands(&self) -> Vec<String> {
        let show = |content: &Vec<u8>| match SpinelMessage::parse(content).unwrap().body {
            Body::Noop => "noop".to_owned(),
            Body::Reset(reset) => format!("reset {reset:?}"),
            Body::Get(key) => format!("get {:#x}", key.0),
            Body::Set(property) => format!("set {:#x}", property.key().0),
            Body::Is(property) => format!("is {:#x}", property.key().0),
        };
        self.heard.iter().map(show).collect()
    }
}

pub(crate) fn line(tid: Tid, property: Property<'_>) -> Vec<u8> {
    let mut content = [0; 300];
    let message = SpinelMessage {
        header: SpinelHeader::new(tid),
        body: Body::Is(property),
    };
    let len = message.emit(&mut content).unwrap();
    hdlc::encode(&content[..len]).collect()
}

pub(crate) fn status(tid: Tid, status: SpinelStatus) -> Vec<u8> {
    line(tid, Property::LastStatus(status, None))
}

pub(crate) fn restart() -> Vec<u8> {
    status(Tid::UNSOLICITED, SpinelStatus(114))
}

pub(crate) fn received(psdu: &[u8]) -> Vec<u8> {
    line(Tid::UNSOLICITED, Property::Received(RxFrame::new(psdu)))
}

pub(crate) fn with_fcs(frame: &[u8]) -> Vec<u8> {
    // Co-processors may leave anything in the place of the FCS.
    [frame, &[0xAA, 0xBB]].concat()
}

/// A co-processor without fault.
pub(crate) fn works(message: &SpinelMessage<'_>) -> Vec<u8> {
    let tid = message.header.tid;
    match message.body {
        Body::Reset(_) => restart(),
        Body::Get(PropertyKey::PROTOCOL_VERSION) => line(
            tid,
            Property::ProtocolVersion(ProtocolVersion { major: 4, minor: 3 }),
        ),
        // 513 is 0x81, 0x04.
        Body::Get(PropertyKey::CAPS) => {
            line(tid, Property::Capabilities(Capabilities(&[5, 0x81, 0x04])))
        }
        Body::Get(PropertyKey::HWADDR) => line(tid, Property::HardwareAddress(Eui64([9; 8]))),
        Body::Get(PropertyKey::NCP_VERSION) => line(tid, Property::NcpVersion(b"A/1; B")),
        Body::Set(Property::Send(_)) => {
            let report = TxReport {
                frame_pending: false,
                header_updated: true,
                acknowledgement: Some(RxFrame::new(&[])),
            };
            line(tid, Property::LastStatus(SpinelStatus::OK, Some(report)))
        }
        Body::Set(property) => line(tid, property),
        _ => status(tid, SpinelStatus::FAILURE),
    }
}

pub(crate) fn key(message: &SpinelMessage<'_>) -> Option<PropertyKey> {
    match message.body {
        Body::Get(key) => Some(key),
        Body::Set(property) => Some(property.key()),
        _ => None,
    }
}
