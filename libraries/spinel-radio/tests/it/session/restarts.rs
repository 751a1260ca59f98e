//! Restarts of the co-processor, and calls that are dropped.

use spinel_radio::{
    RcpFault,
    frame::{Body, SpinelMessage, Tid},
    property::{Property, PropertyKey},
    session::{RcpOutcome, RcpRequest},
    status::SpinelStatus,
};
use zigbee_link::radio::{Channel, RadioConfig};

use crate::session::bench::{
    BROADCAST, Bench, CONFIG, POLICY, SENT, UNICAST, received, restart, status, with_fcs, works,
};

#[test]
fn a_restart_is_repaired_before_the_request_goes_on() {
    let mut bench = Bench::configured();
    // During the transmission: it is sent again afterwards.
    let mut restarts = 2;
    let peer = |message: &SpinelMessage<'_>| match message.body {
        Body::Set(Property::Send(_)) if restarts > 0 => {
            restarts -= 1;
            restart()
        }
        _ => works(message),
    };
    assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), peer), SENT);
    assert_eq!(bench.heard.len(), 3 + 2 * 13);
    assert_eq!(bench.session.counters().restarts, 2);
    assert!(!bench.commands().contains(&"reset Stack".to_owned()));

    // Between two calls.
    bench.heard.clear();
    bench.session.input(&restart(), bench.now);
    assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), works), SENT);
    assert_eq!(bench.heard.len(), 14);

    // Its message was lost; that it lacks its configuration shows when it is to transmit.
    bench.heard.clear();
    let mut forgot = true;
    let peer = |message: &SpinelMessage<'_>| match message.body {
        Body::Set(Property::Send(_)) if forgot => {
            forgot = false;
            status(message.header.tid, SpinelStatus::INVALID_STATE)
        }
        _ => works(message),
    };
    assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), peer), SENT);
    assert_eq!(bench.commands()[1], "reset Stack");
    assert_eq!(bench.heard.len(), 16);
}

/// A request has all its attempts, even if an earlier one that was dropped has used up some.
#[test]
fn attempts_are_counted_anew() {
    for second in [RcpRequest::Transmit(UNICAST), RcpRequest::Configure(CONFIG)] {
        let mut bench = Bench::configured();
        bench.session.input(&restart(), bench.now);
        bench.session.begin(RcpRequest::Listen, bench.now);
        for _ in 0..POLICY.retries {
            bench.exchange(&mut |_| Vec::new());
            bench.wait();
        }
        let mut lost = 0;
        let peer = |message: &SpinelMessage<'_>| {
            lost += 1;
            if lost > POLICY.retries {
                works(message)
            } else {
                Vec::new()
            }
        };
        assert!(bench.run(second, peer).is_ok(), "{second:?}");
    }
}

/// It tells that it has got power, and then of the reset that it was told to make.
#[test]
fn two_messages_of_a_restart_at_power_on() {
    let mut bench = Bench::new();
    let mut is_first = true;
    let peer = |message: &SpinelMessage<'_>| match message.body {
        Body::Get(PropertyKey::PROTOCOL_VERSION) if is_first => {
            is_first = false;
            [restart(), works(message)].concat()
        }
        _ => works(message),
    };
    let outcome = bench.run(RcpRequest::Configure(CONFIG), peer);
    assert_eq!(outcome, Ok(RcpOutcome::Configured));
    assert_eq!(bench.session.counters(), Default::default());
}

#[test]
fn a_repair_that_was_dropped_goes_on() {
    let mut bench = Bench::configured();
    let forgot =
        |message: &SpinelMessage<'_>| status(message.header.tid, SpinelStatus::INVALID_STATE);
    bench
        .session
        .begin(RcpRequest::Transmit(UNICAST), bench.now);
    bench.exchange(&mut |message| forgot(message));
    // The caller of the transmission is gone before the repair begins, and in its middle.
    bench.heard.clear();
    for first in ["reset Stack", "get 0x1", "get 0x5"] {
        bench
            .session
            .begin(RcpRequest::Transmit(UNICAST), bench.now);
        bench.exchange(&mut works);
        assert_eq!(bench.commands(), [first]);
        bench.heard.clear();
    }
    assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), works), SENT);
    assert_eq!(bench.heard.len(), 12);

    // Configured anew while it is being set up: the new one holds.
    bench.session.input(&restart(), bench.now);
    for _ in 0..6 {
        bench.exchange(&mut works);
    }
    bench.heard.clear();
    let elsewhere = RadioConfig {
        channel: Channel::LAST,
        ..CONFIG
    };
    let outcome = bench.run(RcpRequest::Configure(elsewhere), works);
    assert_eq!(outcome, Ok(RcpOutcome::Configured));
    let channels = bench
        .heard
        .iter()
        .filter(|content| content[1..] == [3, 0x21, 26])
        .count();
    assert_eq!(channels, 1);
}

#[test]
fn restarting_for_ever_is_an_error() {
    let always = |_: &SpinelMessage<'_>| restart();
    let mut bench = Bench::new();
    let outcome = bench.run(RcpRequest::Configure(CONFIG), always);
    assert_eq!(outcome, Err(RcpFault::Restarting));
    // The reset, and the first question after it and after each restart that is put up with.
    assert_eq!(bench.heard.len(), 2 + usize::from(POLICY.restarts));
    let when_sending = |message: &SpinelMessage<'_>| match message.body {
        Body::Set(Property::Send(_)) => restart(),
        _ => works(message),
    };
    let mut bench = Bench::configured();
    assert_eq!(
        bench.run(RcpRequest::Transmit(UNICAST), when_sending),
        Err(RcpFault::Restarting)
    );
    let sent = bench
        .commands()
        .iter()
        .filter(|command| *command == "set 0x71")
        .count();
    assert_eq!(sent, 3);
}

#[test]
fn listening_restores() {
    let mut bench = Bench::configured();
    bench.session.begin(RcpRequest::Listen, bench.now);
    assert_eq!(bench.session.deadline(), None);
    bench.session.input(&restart(), bench.now);
    // Dropped and called again in the middle.
    for _ in 0..5 {
        assert!(bench.exchange(&mut works));
        bench.session.begin(RcpRequest::Listen, bench.now);
    }
    while bench.exchange(&mut works) {}
    assert_eq!(bench.session.deadline(), None);
    assert_eq!(bench.heard.len(), 13);
    // As often as it happens, as long as each time it can be repaired.
    for _ in 0..10 {
        bench.session.input(&restart(), bench.now);
        while bench.exchange(&mut works) {}
    }
    assert_eq!(bench.session.outcome(), None);
    assert_eq!(bench.session.counters().restarts, 11);
    bench
        .session
        .input(&received(&with_fcs(BROADCAST)), bench.now);
    assert_eq!(bench.receive().as_deref(), Some(BROADCAST));
}

#[test]
fn a_transmission_that_was_given_up_is_waited_for() {
    let mut bench = Bench::configured();
    bench
        .session
        .begin(RcpRequest::Transmit(BROADCAST), bench.now);
    let mut first = None;
    assert!(bench.exchange(&mut |message| {
        first = Some(message.header.tid);
        Vec::new()
    }));
    // Dropped. The next one is held back ...
    bench
        .session
        .begin(RcpRequest::Transmit(UNICAST), bench.now);
    assert!(!bench.exchange(&mut works));
    // ... and the result of the first is not taken for its own.
    bench
        .session
        .input(&status(first.unwrap(), SpinelStatus::NO_ACK), bench.now);
    assert_eq!(bench.session.outcome(), None);
    assert!(bench.exchange(&mut works));
    assert_eq!(bench.session.outcome(), Some(SENT));

    // So may one that was asked twice answer twice.
    let mut answers = 0;
    let late = |message: &SpinelMessage<'_>| {
        answers += 1;
        match answers {
            1 => Vec::new(),
            2 => {
                let before = Tid::new((message.header.tid.number() + 13) % 15 + 1).unwrap();
                [status(before, SpinelStatus::NO_ACK), works(message)].concat()
            }
            _ => works(message),
        }
    };
    assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), late), SENT);

    // A result that never comes holds nothing up for ever.
    bench
        .session
        .begin(RcpRequest::Transmit(BROADCAST), bench.now);
    bench.exchange(&mut |_| Vec::new());
    let start = bench.now;
    assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), works), SENT);
    assert_eq!(bench.now.since(start), POLICY.transmission);

    // A new configuration waits, too: the channel is not changed under it. A restart ends it.
    bench
        .session
        .begin(RcpRequest::Transmit(BROADCAST), bench.now);
    bench.exchange(&mut |_| Vec::new());
    bench
        .session
        .begin(RcpRequest::Configure(CONFIG), bench.now);
    assert!(!bench.exchange(&mut works));
    let start = bench.now;
    bench.session.input(&restart(), bench.now);
    while bench.exchange(&mut works) {}
    assert_eq!(bench.session.outcome(), Some(Ok(RcpOutcome::Configured)));
    assert_eq!(bench.now, start);

    // Half a command is none: the next one ends it.
    bench
        .session
        .begin(RcpRequest::Transmit(BROADCAST), bench.now);
    let mut chunk = [0; 9];
    assert_eq!(bench.session.output(&mut chunk), 9);
    chunk
        .iter()
        .for_each(|&byte| assert!(bench.decoder.push(byte).is_none()));
    let start = bench.now;
    assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), works), SENT);
    assert_eq!(bench.now, start);
}

#[test]
fn a_configuration_that_was_dropped_is_none() {
    let mut bench = Bench::configured();
    bench
        .session
        .begin(RcpRequest::Configure(CONFIG), bench.now);
    bench.exchange(&mut works);
    assert_eq!(
        bench.run(RcpRequest::Transmit(UNICAST), works),
        Err(RcpFault::NotConfigured)
    );
    assert_eq!(
        bench.run(RcpRequest::Listen, works),
        Err(RcpFault::NotConfigured)
    );
    assert_eq!(
        bench.run(RcpRequest::Configure(CONFIG), works),
        Ok(RcpOutcome::Configured)
    );
    assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), works), SENT);
}

#[test]
fn lost_output_is_sent_again() {
    let mut bench = Bench::new();
    bench
        .session
        .begin(RcpRequest::Configure(CONFIG), bench.now);
    // Nothing of it reaches the line.
    assert!(bench.session.output(&mut [0; 100]) > 0);
    bench.session.output_lost(bench.now);
    assert!(bench.exchange(&mut works));
    while bench.exchange(&mut works) {}
    assert_eq!(bench.session.outcome(), Some(Ok(RcpOutcome::Configured)));
}
