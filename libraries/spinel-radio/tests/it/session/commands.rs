//! Commands, their answers, and answers that do not come.

use std::collections::VecDeque;

use spinel_radio::{
    RcpFault,
    frame::{Body, SpinelMessage},
    property::{Capabilities, Property, PropertyKey, ProtocolVersion},
    session::{RcpOutcome, RcpRequest},
    status::SpinelStatus,
};
use zigbee_link::{
    radio::{RadioConfig, TxOutcome},
    wire::Eui64,
};

use crate::session::bench::{
    BROADCAST, Bench, CONFIG, POLICY, SENT, UNICAST, key, line, status, works,
};

#[test]
fn configuring_byte_for_byte() {
    let mut bench = Bench::new();
    assert_eq!(
        bench.run(RcpRequest::Configure(CONFIG), works),
        Ok(RcpOutcome::Configured)
    );
    let expected: [&[u8]; 14] = [
        &[0x80, 1, 2],
        &[0x81, 2, 1],
        &[0x82, 2, 5],
        &[0x83, 2, 8],
        &[0x84, 2, 2],
        &[0x85, 3, 0x20, 1],
        &[0x86, 3, 0x21, 11],
        &[0x87, 3, 0x25, 0xFD],
        &[0x88, 3, 0x36, 0x34, 0x12],
        &[0x89, 3, 0x35, 0x42, 0x00],
        &[0x8A, 3, 0x34, 1, 2, 3, 4, 5, 6, 7, 8],
        &[0x8B, 3, 0x83, 0x26, 1],
        &[0x8C, 3, 0x38, 0],
        &[0x8D, 3, 0x37, 1],
    ];
    assert_eq!(bench.heard, expected);
    let identity = bench.session.identity().unwrap();
    assert_eq!(identity.firmware(), b"A/1; B");
    assert_eq!(identity.address, Eui64([9; 8]));

    // A later one needs no reset.
    bench.heard.clear();
    assert_eq!(
        bench.run(RcpRequest::Configure(CONFIG), works),
        Ok(RcpOutcome::Configured)
    );
    assert_eq!(bench.heard.len(), 9);

    // It is not told when it may sleep, for it never does.
    bench.heard.clear();
    for sampled in [true, false] {
        let config = RadioConfig { sampled, ..CONFIG };
        let configured = bench.run(RcpRequest::Configure(config), works);
        assert_eq!(configured, Ok(RcpOutcome::Configured));
    }
    assert!(bench.heard.is_empty());
    let elsewhere = RadioConfig {
        sampled: true,
        tx_power: 4,
        ..CONFIG
    };
    let configured = bench.run(RcpRequest::Configure(elsewhere), works);
    assert_eq!(configured, Ok(RcpOutcome::Configured));
    assert_eq!(bench.heard.len(), 9);
}

#[test]
fn transmitting_byte_for_byte() {
    let mut bench = Bench::configured();
    assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), works), SENT);
    let mut expected = vec![0x8E, 3, 0x71, 13, 0];
    expected.extend(UNICAST);
    // FCS; channel, backoffs, retries, CSMA, header updated, no repetition, secured; no delay;
    // the same channel afterwards.
    expected.extend([0, 0, 11, 4, 3, 1, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 11]);
    assert_eq!(bench.heard, [expected]);
}

#[test]
fn results_of_a_transmission() {
    let mut bench = Bench::configured();
    assert_eq!(bench.run(RcpRequest::Transmit(BROADCAST), works), SENT);
    for (told, outcome) in [
        (SpinelStatus::NO_ACK, TxOutcome::Sent),
        (SpinelStatus::CCA_FAILURE, TxOutcome::ChannelBusy),
    ] {
        let outcome = Ok(RcpOutcome::Transmitted(outcome));
        let answer = |message: &SpinelMessage<'_>| status(message.header.tid, told);
        assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), answer), outcome);
    }
    let refused = Err(RcpFault::Refused {
        key: PropertyKey::STREAM_RAW,
        status: SpinelStatus::PARSE_ERROR,
    });
    let answer =
        |message: &SpinelMessage<'_>| status(message.header.tid, SpinelStatus::PARSE_ERROR);
    assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), answer), refused);
    // Refusing one frame says nothing about the next one.
    assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), works), SENT);
    assert_eq!(bench.commands(), vec!["set 0x71"; 5]);
}

/// Each command of a configuration and a transmission is lost once, and each answer.
#[test]
fn any_command_or_answer_may_be_lost() {
    for lost in 0..15 {
        let mut bench = Bench::new();
        let mut number = 0;
        let mut peer = |message: &SpinelMessage<'_>| {
            number += 1;
            if number == lost + 1 {
                Vec::new()
            } else {
                works(message)
            }
        };
        assert_eq!(
            bench.run(RcpRequest::Configure(CONFIG), &mut peer),
            Ok(RcpOutcome::Configured)
        );
        assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), &mut peer), SENT);
        assert_eq!(bench.heard.len(), 16);
        assert_eq!(bench.session.counters().repeated, 1, "{lost}");
        // The transaction identifier says which answer it is.
        let unanswered = &bench.heard[lost];
        let again = &bench.heard[lost + 1];
        assert_eq!(unanswered[1..], again[1..]);
        assert!(lost == 0 || unanswered[0] != again[0]);
    }
}

#[test]
fn silence_is_an_error_in_bounded_time() {
    let silent = |_: &SpinelMessage<'_>| Vec::new();
    let mut bench = Bench::new();
    let start = bench.now;
    assert_eq!(
        bench.run(RcpRequest::Configure(CONFIG), silent),
        Err(RcpFault::Silent)
    );
    assert_eq!(bench.now.since(start), 3 * POLICY.reset);
    // The last resort is the reset of the whole processor.
    assert_eq!(
        bench.commands(),
        ["reset Stack", "reset Stack", "reset Platform"]
    );
    assert_eq!(bench.session.deadline(), None);
    assert_eq!(
        bench.run(RcpRequest::Listen, silent),
        Err(RcpFault::NotConfigured)
    );

    let mut bench = Bench::configured();
    let start = bench.now;
    assert_eq!(
        bench.run(RcpRequest::Transmit(UNICAST), silent),
        Err(RcpFault::Silent)
    );
    assert_eq!(bench.now.since(start), 3 * POLICY.transmission);
    assert_eq!(bench.run(RcpRequest::Listen, silent), Err(RcpFault::Silent));
    // It is there again: set up, then the frame.
    bench.heard.clear();
    assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), works), SENT);
    assert_eq!(bench.heard.len(), 15);
}

#[test]
fn busy_is_asked_again_after_a_pause() {
    let mut bench = Bench::configured();
    let mut answers = VecDeque::from([SpinelStatus::BUSY, SpinelStatus::NO_MEMORY]);
    let start = bench.now;
    let peer = |message: &SpinelMessage<'_>| match answers.pop_front() {
        Some(answer) => status(message.header.tid, answer),
        None => works(message),
    };
    assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), peer), SENT);
    assert_eq!(bench.now.since(start), 2 * POLICY.pause);

    let peer = |message: &SpinelMessage<'_>| status(message.header.tid, SpinelStatus::BUSY);
    let refused = Err(RcpFault::Refused {
        key: PropertyKey::STREAM_RAW,
        status: SpinelStatus::BUSY,
    });
    assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), peer), refused);
}

#[test]
fn only_a_radio_of_this_protocol() {
    let other = |message: &SpinelMessage<'_>| match message.body {
        Body::Get(PropertyKey::PROTOCOL_VERSION) => {
            let version = Property::ProtocolVersion(ProtocolVersion { major: 5, minor: 0 });
            line(message.header.tid, version)
        }
        _ => works(message),
    };
    let fault = RcpFault::Version(ProtocolVersion { major: 5, minor: 0 });
    assert_eq!(
        Bench::new().run(RcpRequest::Configure(CONFIG), other),
        Err(fault)
    );

    let no_radio = |message: &SpinelMessage<'_>| match message.body {
        Body::Get(PropertyKey::CAPS) => {
            let capabilities = Capabilities(&[5, 34, 0x80, 0x04]);
            line(message.header.tid, Property::Capabilities(capabilities))
        }
        _ => works(message),
    };
    let mut bench = Bench::new();
    assert_eq!(
        bench.run(RcpRequest::Configure(CONFIG), no_radio),
        Err(RcpFault::NoRadio)
    );
    assert_eq!(bench.session.identity(), None);
    assert_eq!(
        bench.run(RcpRequest::Transmit(UNICAST), works),
        Err(RcpFault::NotConfigured)
    );
}

#[test]
fn what_a_radio_may_lack() {
    for (refused, may) in [
        (PropertyKey::PHY_TX_POWER, true),
        (PropertyKey::MAC_SRC_MATCH_ENABLED, true),
        (PropertyKey::PHY_CHAN, false),
        (PropertyKey::MAC_15_4_LADDR, false),
        (PropertyKey::MAC_RAW_STREAM_ENABLED, false),
    ] {
        let peer = |message: &SpinelMessage<'_>| {
            if key(message) == Some(refused) {
                status(message.header.tid, SpinelStatus::UNIMPLEMENTED)
            } else {
                works(message)
            }
        };
        let outcome = Bench::new().run(RcpRequest::Configure(CONFIG), peer);
        let fault = RcpFault::Refused {
            key: refused,
            status: SpinelStatus::UNIMPLEMENTED,
        };
        assert_eq!(
            outcome,
            if may {
                Ok(RcpOutcome::Configured)
            } else {
                Err(fault)
            }
        );
    }
}
