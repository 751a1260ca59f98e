//! [`SpinelRadio`] against real peers: OpenThread's `ot-rcp` processes, which hear each other over
//! the loopback interface; and whole nodes over that. `cargo xtask peers` builds one, names it in `OT_RCP` and runs these.
#![cfg(unix)]

use crate::peer;
#[path = "../../../../zigbee-link/tests/it/support/mod.rs"]
mod support;

use std::time::Duration;

use embassy_futures::{
    join::{join, join4},
    select::{Either, Either3, select, select3},
};
use embedded_io_async::{Read, Write};
use peer::{Air, Process, Rcp, StdClock, Uart, block_on, poll_for};
use spinel_radio::{
    RcpError, RcpFault, RcpPolicy, SpinelRadio,
    frame::{Body, SpinelHeader, SpinelMessage, Tid},
    hdlc,
    property::{Property, PropertyKey, ProtocolVersion},
    status::SpinelStatus,
    stream::TxFrame,
};
use support::{
    aether::eui,
    node::{provisioned, settings},
};
use zigbee_link::{
    link::Delivery,
    network,
    radio::{Channel, FRAME_MAX, PSDU_MAX, Radio, RadioConfig, Received, TxOutcome},
    runner::{self, Clock, Shared},
    store::Member,
    wire::{Address, AuxHeader, Eui64, FrameType, Level, PanId, Panned, ShortAddress},
};

const PAN: PanId = PanId(0x1234);

fn config(node: u8) -> RadioConfig {
    RadioConfig {
        channel: Channel::FIRST,
        tx_power: 0,
        pan: PAN,
        short: ShortAddress(node.into()),
        extended: extended(node),
        coordinator: false,
        promiscuous: false,
        sampled: false,
    }
}

fn extended(node: u8) -> Eui64 {
    Eui64([0xAC, 0xDE, 0x48, 0, 0, 0, 0x10, node])
}

fn short(node: u16) -> Address {
    Address::Short(ShortAddress(node))
}

/// A data frame from node 1.
fn data(pan: PanId, to: Address, sequence: u8, payload: &[u8]) -> Vec<u8> {
    secured(pan, to, sequence, payload, None)
}

fn secured(
    pan: PanId,
    to: Address,
    sequence: u8,
    payload: &[u8],
    security: Option<AuxHeader>,
) -> Vec<u8> {
    let header = zigbee_link::wire::Header {
        destination: Panned::new(pan, to),
        source: Panned::compressed(short(1)),
        security,
        ..zigbee_link::wire::Header::new(FrameType::Data, sequence)
    };
    let mut frame = vec![0; FRAME_MAX];
    let len = header.emit(&mut frame).unwrap();
    frame.truncate(len);
    frame.extend(payload);
    frame
}

/// A co-processor and its radio.
struct Node {
    process: Process,
    radio: Rcp,
}

impl Node {
    fn new(air: &Air, node: u8) -> Self {
        let (process, radio) = air.node(node);
        Self { process, radio }
    }

    fn configure(&mut self, config: &RadioConfig) {
        block_on(self.radio.configure(config)).unwrap();
    }

    fn transmit(&mut self, frame: &[u8]) -> TxOutcome {
        block_on(self.radio.transmit(frame)).unwrap()
    }

    #[track_caller]
    fn send(&mut self, frame: &[u8]) {
        assert_eq!(self.transmit(frame), TxOutcome::Sent);
    }

    fn receive_with_info(&mut self) -> (Vec<u8>, Received) {
        let mut buffer = [0; PSDU_MAX];
        let received = block_on(self.radio.receive(&mut buffer)).unwrap();
        (buffer[..received.len].to_vec(), received)
    }

    fn receive(&mut self) -> Vec<u8> {
        self.receive_with_info().0
    }
}

/// Two configured nodes that hear each other.
fn pair(air: &Air) -> [Node; 2] {
    [1, 2].map(|number| {
        let mut node = Node::new(air, number);
        node.configure(&config(number));
        node
    })
}

#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn tells_who_it_is() {
    let air = Air::new();
    let mut node = Node::new(&air, 2);
    assert_eq!(node.radio.session().identity(), None);
    node.configure(&config(2));
    let identity = node.radio.session().identity().unwrap();
    assert_eq!(identity.protocol, ProtocolVersion { major: 4, minor: 3 });
    assert!(identity.is_radio);
    // The simulation's own addresses: its OUI and the number of the node.
    assert_eq!(identity.address, Eui64([0x18, 0xB4, 0x30, 0, 0, 0, 0, 2]));
    let firmware = String::from_utf8_lossy(identity.firmware());
    assert!(firmware.starts_with("OPENTHREAD/"), "{firmware}");
}

#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn frames_both_ways() {
    let air = Air::new();
    let [mut a, mut b] = pair(&air);
    for sequence in 0..20 {
        let there = data(PAN, short(2), sequence, &[sequence; 20]);
        let mut buffer = [0; PSDU_MAX];
        // The receiver waits already; afterwards the frame is queued.
        let waiting = poll_for(Duration::ZERO, b.radio.receive(&mut buffer));
        assert!(waiting.is_none());
        a.send(&there);
        let (received, info) = b.receive_with_info();
        assert_eq!(received, there);
        assert_eq!(info.channel, Channel::FIRST);
        // Values that the simulation gives for every frame.
        assert_eq!((info.rssi, info.lqi), (Some(-20), None));

        let specials = [0x7E, 0x7D, 0x11, 0x13, 0xF8];
        let back = data(PAN, short(1), sequence, &specials);
        b.send(&back);
        assert_eq!(a.receive(), back);
    }
    for node in [&a, &b] {
        assert_eq!(node.radio.session().counters(), Default::default());
        assert_eq!(node.radio.session().dropped(), Default::default());
    }
}

#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn received_while_waiting() {
    let air = Air::new();
    let [mut a, mut b] = pair(&air);
    let frame = data(PAN, short(0xFFFF), 1, b"at once");
    let mut buffer = [0; PSDU_MAX];
    let both = join(b.radio.receive(&mut buffer), a.radio.transmit(&frame));
    let (received, outcome) = block_on(both);
    assert_eq!(outcome, Ok(TxOutcome::Sent));
    assert_eq!(buffer[..received.unwrap().len], frame);
}

#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn every_length_arrives_unchanged() {
    let air = Air::new();
    let [mut a, mut b] = pair(&air);
    let header = data(PAN, short(2), 0, &[]).len();
    for len in (0..FRAME_MAX - header)
        .step_by(9)
        .chain([FRAME_MAX - header])
    {
        let payload: Vec<u8> = (0..len).map(|i| (i * 37) as u8).collect();
        let frame = data(PAN, short(2), len as u8, &payload);
        a.send(&frame);
        assert_eq!(b.receive(), frame);
    }
}

/// The counter and the key index are the host's, and so is the ciphertext.
#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn secured_frames_are_left_alone() {
    let air = Air::new();
    let [mut a, mut b] = pair(&air);
    let security = AuxHeader {
        level: Level::EncMic64,
        counter: 0x0102_0304,
        key_index: 9,
    };
    let frame = secured(PAN, short(2), 1, &[0xA5; 30], Some(security));
    a.send(&frame);
    assert_eq!(b.receive(), frame);
}

#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn frames_for_others_are_not_delivered() {
    let air = Air::new();
    let [mut a, mut b] = pair(&air);
    for (pan, to) in [
        (PanId(0x4321), short(2)),
        (PAN, short(3)),
        (PAN, Address::Extended(extended(3))),
    ] {
        let frame = data(pan, to, 1, b"for another");
        a.send(&frame);
    }
    for (sequence, pan, to) in [
        (2, PAN, short(2)),
        (3, PAN, Address::Extended(extended(2))),
        (4, PanId::BROADCAST, short(2)),
    ] {
        let frame = data(pan, to, sequence, b"for node 2");
        a.send(&frame);
        assert_eq!(b.receive(), frame);
    }
    let everybody = data(PAN, short(0xFFFF), 5, b"for all");
    a.send(&everybody);
    assert_eq!(b.receive(), everybody);
}

#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn promiscuous_hears_everything() {
    let air = Air::new();
    let [mut a, mut b] = pair(&air);
    let curious = RadioConfig {
        promiscuous: true,
        sampled: false,
        ..config(2)
    };
    b.configure(&curious);
    for (sequence, to) in [(1, 2), (2, 3)] {
        let frame = data(PAN, short(to), sequence, b"overheard");
        a.send(&frame);
        assert_eq!(b.receive(), frame);
    }
}

#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn another_channel_is_another_world() {
    let air = Air::new();
    let [mut a, mut b] = pair(&air);
    let elsewhere = RadioConfig {
        channel: Channel::LAST,
        ..config(2)
    };
    b.configure(&elsewhere);
    let lost = data(PAN, short(2), 1, b"lost");
    a.send(&lost);
    a.configure(&RadioConfig {
        channel: Channel::LAST,
        ..config(1)
    });
    let found = data(PAN, short(2), 2, b"found");
    a.send(&found);
    assert_eq!(b.receive(), found);
}

#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn nobody_there() {
    let air = Air::new();
    let mut node = Node::new(&air, 1);
    node.configure(&config(1));
    let mut frame = data(PAN, short(2), 1, b"anybody?");
    node.send(&frame);
    // With a request for an acknowledgement: sent four times.
    frame[0] |= 0x20;
    node.send(&frame);
}

#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn impossible_lengths_are_refused_here_and_there() {
    let air = Air::new();
    let [mut a, mut b] = pair(&air);
    for len in [0, 2, FRAME_MAX + 1, PSDU_MAX + 1, 1000] {
        let refused = block_on(a.radio.transmit(&vec![0x41; len]));
        assert_eq!(
            refused,
            Err(RcpError::Radio(RcpFault::FrameLength)),
            "{len}"
        );
    }
    let good = data(PAN, short(2), 1, b"still there");
    a.send(&good);
    assert_eq!(b.receive(), good);

    // The same asked of the co-processor itself.
    let (mut uart, _) = a.radio.release();
    let tid = Tid::new(7).unwrap();
    let send = TxFrame::new(&[0x41; PSDU_MAX + 1], 11);
    let answer = ask(&mut uart, tid, Body::Set(Property::Send(send)));
    assert_eq!(
        answer,
        Some((PropertyKey::LAST_STATUS, Some(SpinelStatus::PARSE_ERROR)))
    );
}

/// The property of the answer, and the status if it is one.
fn ask(uart: &mut Uart, tid: Tid, body: Body<'_>) -> Option<(PropertyKey, Option<SpinelStatus>)> {
    let mut content = [0; 256];
    let header = SpinelHeader::new(tid);
    let len = SpinelMessage { header, body }.emit(&mut content).unwrap();
    let line: Vec<u8> = hdlc::encode(&content[..len]).collect();
    block_on(async {
        uart.write_all(&line).await.unwrap();
        let mut decoder = hdlc::Decoder::<256>::new();
        let mut byte = [0];
        loop {
            uart.read_exact(&mut byte).await.unwrap();
            let Some(content) = decoder.push(byte[0]) else {
                continue;
            };
            match SpinelMessage::parse(content).unwrap() {
                SpinelMessage {
                    header,
                    body: Body::Is(property),
                } if header.tid == tid => {
                    let status = match property {
                        Property::LastStatus(status, _) => Some(status),
                        _ => None,
                    };
                    return Some((property.key(), status));
                }
                _ => {}
            }
        }
    })
}

/// As a watchdog resets a co-processor: its message is all there is.
#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn killed_and_restarted_while_listening() {
    let air = Air::new();
    let [mut a, mut b] = pair(&air);
    for sequence in 0..3 {
        b.process.kill();
        let frame = data(PAN, short(2), sequence, b"are you back?");
        a.send(&frame);
        b.process.restart();
        let received = block_on(select(
            async {
                loop {
                    assert_eq!(a.radio.transmit(&frame).await, Ok(TxOutcome::Sent));
                }
            },
            async {
                let mut buffer = [0; PSDU_MAX];
                while buffer[..frame.len()] != frame {
                    b.radio.receive(&mut buffer).await?;
                }
                Ok::<_, RcpError<_>>(())
            },
        ));
        let Either::Second(received) = received;
        assert_eq!(received, Ok(()));
        let restarts = b.radio.session().counters().restarts;
        assert_eq!(restarts, u32::from(sequence) + 1);
    }
}

#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn killed_and_restarted_between_transmissions() {
    let air = Air::new();
    let [mut a, mut b] = pair(&air);
    for sequence in 0..3 {
        a.process.kill();
        a.process.restart();
        let frame = data(PAN, short(2), sequence, b"after the restart");
        a.send(&frame);
        assert_eq!(b.receive(), frame);
    }
}

#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn dead_is_an_error_and_works_again_later() {
    let air = Air::new();
    let (process, uart) = Process::start(&air, 1);
    let mut impatient = RcpPolicy::default();
    impatient.answer = Duration::from_millis(200);
    impatient.transmission = Duration::from_millis(500);
    impatient.reset = Duration::from_millis(500);
    let mut a = Node {
        process,
        radio: SpinelRadio::with_policy(uart, StdClock::new(), impatient),
    };
    let mut b = Node::new(&air, 2);
    b.configure(&config(2));
    let frame = data(PAN, short(2), 1, b"alive");
    let mut buffer = [0; PSDU_MAX];
    let unconfigured = RcpError::Radio(RcpFault::NotConfigured);
    assert_eq!(block_on(a.radio.transmit(&frame)), Err(unconfigured));
    assert_eq!(block_on(a.radio.receive(&mut buffer)), Err(unconfigured));

    a.configure(&config(1));
    a.process.kill();
    let silent = RcpError::Radio(RcpFault::Silent);
    assert_eq!(block_on(a.radio.transmit(&frame)), Err(silent));
    assert_eq!(block_on(a.radio.receive(&mut buffer)), Err(silent));
    a.process.restart();
    a.send(&frame);
    assert_eq!(b.receive(), frame);

    // The other configuration failed, and the one before is no longer wanted.
    a.process.kill();
    assert_eq!(block_on(a.radio.configure(&config(1))), Err(silent));
    assert_eq!(block_on(a.radio.transmit(&frame)), Err(unconfigured));
    a.process.restart();
    a.configure(&config(1));
    a.send(&frame);
}

/// A call is dropped at any point; the next one concerns only its own frame.
#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn dropped_calls() {
    let air = Air::new();
    let [mut a, mut b] = pair(&air);
    let mut sent = Vec::new();
    for round in 0..30_u8 {
        // To a node that is there, in steps of its 4 ms; to an address of no node, in steps of some 100 ms.
        let (to, step) = if round % 2 == 0 { (2, 150) } else { (3, 4000) };
        let time = Duration::from_micros(step * u64::from(round));
        let dropped = data(PAN, short(to), 2 * round, b"dropped");
        let _ = poll_for(time, a.radio.transmit(&dropped));
        sent.push(dropped);
        let frame = data(PAN, short(2), 2 * round + 1, &[round; 10]);
        a.send(&frame);
        sent.push(frame);
        // Nothing is lost when `receive` is dropped, however often.
        let mut buffer = [0; PSDU_MAX];
        let mut heard = Vec::new();
        while sent.last().is_none_or(|last| *last != heard) {
            let moment = Duration::from_micros(300);
            if let Some(received) = poll_for(moment, b.radio.receive(&mut buffer)) {
                heard = buffer[..received.unwrap().len].to_vec();
                assert!(sent.contains(&heard), "{heard:x?}");
            }
        }
    }
    assert_eq!(a.radio.session().counters(), Default::default());
}

/// From an empty network to a message each way, with nothing simulated but the air.
#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn two_nodes_exchange_messages() {
    type WholeNode = network::Node<4, 4, 2>;
    /// It takes about two seconds.
    const LIMIT: Duration = Duration::from_secs(30);

    let air = Air::new();
    let clock = StdClock::new();
    let [(_process0, mut radio0), (_process1, mut radio1)] = [1, 2].map(|node| air.node(node));
    let [mut store0, mut store1] = [provisioned(), provisioned()];
    let [saved0, saved1] = [&mut store0, &mut store1].map(|store| block_on(store.load()).unwrap());
    let mut coordinator = WholeNode::coordinator(settings(0), &saved0, [None; 2]);
    coordinator.allow(eui(1).number()).unwrap();
    let device = WholeNode::device(clock.now(), settings(1), &saved1);
    let [coordinator, device] = [coordinator, device].map(|node| Shared::new(node, &clock));

    let up = (7_u32, *b"from the device");
    let down = *b"from the coordinator";
    let talk = async {
        let address = loop {
            let status = device.with(|node, _| node.status());
            if let Some(network::NetworkStatus::Joined(membership)) = status {
                break membership.short;
            }
            let later = clock.now() + Duration::from_millis(20);
            clock.sleep_until(later).await;
        };
        let results = join4(
            device.send(ShortAddress::COORDINATOR, &up),
            coordinator.send(address, &down),
            coordinator.recv(),
            device.recv(),
        )
        .await;
        (address, results)
    };
    let nodes = select3(
        talk,
        runner::run(&coordinator, &mut radio0, &mut store0),
        runner::run(&device, &mut radio1, &mut store1),
    );
    let Some(ended) = poll_for(LIMIT, nodes) else {
        panic!(
            "no message each way within {LIMIT:?}: the coordinator is {:?}, the device is {:?}",
            coordinator.with(|node, _| node.status()),
            device.with(|node, _| node.status()),
        );
    };
    let (address, (sent1, sent0, received0, received1)) = match ended {
        Either3::First(exchanged) => exchanged,
        Either3::Second(stopped) => panic!("the coordinator stopped: {stopped:?}"),
        Either3::Third(stopped) => panic!("the device stopped: {stopped:?}"),
    };
    assert_eq!([sent0, sent1], [Ok(Delivery::Delivered); 2]);
    assert_eq!(received0, (address, up));
    assert_eq!(received1, (ShortAddress::COORDINATOR, down));
    let members: Option<Vec<_>> = coordinator.with(|node, _| node.members().collect());
    let member = Member {
        extended: eui(1),
        short: address,
    };
    assert_eq!(members, Some(vec![member]));
}
