//! Anything at all.

use std::time::Duration;

use proptest::{collection::vec, prelude::*};
use spinel_radio::{
    frame::Tid,
    hdlc,
    session::{RcpOutcome, RcpRequest},
    status::SpinelStatus,
};

use crate::session::bench::{BROADCAST, Bench, CONFIG, SENT, UNICAST, restart, status, works};

#[derive(Clone, Debug)]
enum Happening {
    Begin(u8),
    Answer,
    Restart,
    SpinelStatus(u8, u32),
    Noise(Vec<u8>),
    Frame(Vec<u8>),
    Pause,
}

fn happening() -> impl Strategy<Value = Happening> {
    prop_oneof![
        (0..4_u8).prop_map(Happening::Begin),
        Just(Happening::Answer),
        Just(Happening::Answer),
        Just(Happening::Answer),
        Just(Happening::Restart),
        (0..16_u8, 0..120_u32).prop_map(|(tid, status)| Happening::SpinelStatus(tid, status)),
        vec(any::<u8>(), 0..50).prop_map(Happening::Noise),
        vec(any::<u8>(), 0..140).prop_map(Happening::Frame),
        Just(Happening::Pause),
    ]
}

fn request(number: u8) -> RcpRequest<'static> {
    match number {
        0 => RcpRequest::Configure(CONFIG),
        1 => RcpRequest::Transmit(BROADCAST),
        2 => RcpRequest::Transmit(UNICAST),
        _ => RcpRequest::Listen,
    }
}

proptest! {
    /// After any events, a co-processor that works again is brought to work.
    #[test]
    fn recovers_from_anything(happenings in vec(happening(), 0..60)) {
        let mut bench = Bench::new();
        for happening in happenings {
            match happening {
                Happening::Begin(number) => bench.session.begin(request(number), bench.now),
                Happening::Answer => {
                    bench.exchange(&mut works);
                }
                Happening::Restart => bench.session.input(&restart(), bench.now),
                Happening::SpinelStatus(tid, code) => {
                    let told = status(Tid::new(tid).unwrap(), SpinelStatus(code));
                    bench.session.input(&told, bench.now);
                }
                Happening::Noise(bytes) => bench.session.input(&bytes, bench.now),
                Happening::Frame(bytes) => {
                    let line: Vec<u8> = hdlc::encode(&bytes).collect();
                    bench.session.input(&line, bench.now);
                }
                Happening::Pause => {
                    if let Some(deadline) = bench.session.deadline() {
                        bench.now = deadline;
                        bench.session.tick(deadline);
                    }
                }
            }
        }
        // The rest of the last command may spoil one exchange, not the request.
        prop_assert_eq!(bench.run(RcpRequest::Configure(CONFIG), works), Ok(RcpOutcome::Configured));
        prop_assert_eq!(bench.run(RcpRequest::Transmit(UNICAST), works), SENT);
    }

    /// Nothing but time: every request that waits for something ends.
    #[test]
    fn every_request_ends(numbers in vec(0..4_u8, 1..10), answers in vec(any::<bool>(), 200)) {
        let mut bench = Bench::new();
        let mut answers = answers.into_iter();
        for number in numbers {
            let start = bench.now;
            bench.session.begin(request(number), start);
            loop {
                bench.exchange(&mut |message| match answers.next() {
                    Some(true) => works(message),
                    _ => Vec::new(),
                });
                if bench.session.outcome().is_some() {
                    break;
                }
                match bench.session.deadline() {
                    Some(deadline) => {
                        bench.now = deadline;
                        bench.session.tick(deadline);
                    }
                    None => {
                        prop_assert_eq!(request(number), RcpRequest::Listen);
                        break;
                    }
                }
                prop_assert!(bench.now.since(start) < Duration::from_secs(60));
            }
        }
    }
}
