//! The co-processor against `zigbee-link`'s driver of one, which is tested against `ot-rcp`.

use std::{cell::Cell, future::Future, rc::Rc};

use embassy_futures::join::join;
use spinel_radio::SpinelRadio;
use virtual_bench::{
    co_processor::CoProcessor,
    executor::{Clock, Executor},
    line::{Line, Port, Side, Uart},
    medium::{Disturbance, Kind, Medium, NodeId, Propagation},
};
use zigbee_link::{
    radio::{Channel, PSDU_MAX, Radio, RadioConfig, TxOutcome},
    wire::{PanId, ShortAddress},
};

use crate::support::{SECOND, eui};

/// A data frame from 1 to 2 in PAN 0x1234, sequence number 7, without acknowledgement.
const FRAME: [u8; 12] = [
    0x41, 0x88, 7, 0x34, 0x12, 0x02, 0x00, 0x01, 0x00, b'a', b'b', b'c',
];

type Host = SpinelRadio<Port, Clock>;

/// Two hosts with a co-processor each, on one medium.
struct Bench {
    executor: Executor,
    medium: Medium,
    hosts: [Host; 2],
}

impl Bench {
    fn new() -> Self {
        let mut executor = Executor::new();
        let clock = executor.clock();
        let propagation = Propagation::UnitDisk {
            range: 10.0,
            loss: 0.0,
        };
        let medium = Medium::new(&clock, propagation, 1);
        let hosts = [1_u32, 2].map(|number| {
            let antenna = medium.attach([f64::from(number), 0.0]);
            let uart = Uart {
                receive_buffer: 1024,
                transmit_buffer: 1024,
                ..Uart::new(1_000_000)
            };
            let line = Line::between_ports(&clock, uart, uart);
            let host = SpinelRadio::new(line.open(Side::Node), clock.clone());
            let far = line.open(Side::Far);
            let address = eui(100 + number);
            let device =
                CoProcessor::new(far, &medium, antenna, clock.clone(), address, number.into());
            executor.spawn(async move {
                let _ = device.run().await;
            });
            host
        });
        Self {
            executor,
            medium,
            hosts,
        }
    }

    fn run<F: Future<Output = ()> + 'static>(mut self, test: impl FnOnce([Host; 2]) -> F) {
        let is_over = Rc::new(Cell::new(false));
        let test = test(self.hosts);
        let over = is_over.clone();
        self.executor.spawn(async move {
            test.await;
            over.set(true);
        });
        let _ = self.executor.run_until(60 * SECOND);
        assert!(is_over.get(), "it hangs");
    }
}

fn config(short: u16) -> RadioConfig {
    RadioConfig {
        channel: Channel::new(20).unwrap(),
        tx_power: 0,
        pan: PanId(0x1234),
        short: ShortAddress(short),
        extended: eui(short.into()),
        coordinator: false,
        promiscuous: false,
    }
}

#[test]
fn a_frame_crosses_the_air_unchanged() {
    Bench::new().run(|[mut one, mut two]| async move {
        one.configure(&config(1)).await.unwrap();
        two.configure(&config(2)).await.unwrap();
        let identity = one.session().identity().unwrap();
        assert_eq!(identity.address, eui(101));
        assert_eq!(identity.firmware(), b"host-sim");
        let mut buffer = [0; PSDU_MAX];
        let (sent, received) = join(one.transmit(&FRAME), two.receive(&mut buffer)).await;
        assert_eq!(sent.unwrap(), TxOutcome::Sent);
        let received = received.unwrap();
        assert_eq!(buffer[..received.len], FRAME);
        assert_eq!(received.channel, config(1).channel);
    });
}

#[test]
fn frames_for_others_are_not_received() {
    Bench::new().run(|[mut one, mut two]| async move {
        one.configure(&config(1)).await.unwrap();
        two.configure(&config(3)).await.unwrap();
        assert_eq!(one.transmit(&FRAME).await.unwrap(), TxOutcome::Sent);
        // The same radio as 2 gets the next frame, and not the one before.
        two.configure(&config(2)).await.unwrap();
        let mut next = FRAME;
        next[2] = 8;
        let mut buffer = [0; PSDU_MAX];
        let (_, received) = join(one.transmit(&next), two.receive(&mut buffer)).await;
        assert_eq!(buffer[..received.unwrap().len], next);
    });
}

#[test]
fn what_asks_for_an_acknowledgement_is_sent_all_the_same() {
    Bench::new().run(|[mut one, mut two]| async move {
        one.configure(&config(1)).await.unwrap();
        two.configure(&config(2)).await.unwrap();
        let mut frame = FRAME;
        frame[0] |= 0x20;
        let outcome = one.transmit(&frame).await.unwrap();
        assert_eq!(outcome, TxOutcome::Sent);
    });
}

#[test]
fn a_busy_channel_is_told() {
    let bench = Bench::new();
    bench.medium.disturb(Disturbance {
        during: 0..60 * SECOND,
        kind: Kind::Jammer {
            channel: None,
            disk: None,
        },
    });
    bench.run(|[mut one, _]| async move {
        one.configure(&config(1)).await.unwrap();
        assert_eq!(one.transmit(&FRAME).await.unwrap(), TxOutcome::ChannelBusy);
    });
}

#[test]
fn an_antenna_is_silent_before_its_radio_is_enabled() {
    let bench = Bench::new();
    let medium = bench.medium.clone();
    bench.run(|[mut one, two]| async move {
        one.configure(&config(1)).await.unwrap();
        assert_eq!(one.transmit(&FRAME).await.unwrap(), TxOutcome::Sent);
        assert_eq!(medium.counters(NodeId(0)).frames, 1);
        assert_eq!(medium.counters(NodeId(1)).received, 0);
        drop(two);
    });
}
