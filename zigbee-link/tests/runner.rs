//! Whole nodes: runner, stacked radios, store in a flash, clock; and the wrappers one by one.

mod support;

use std::{
    cell::{Cell, RefCell},
    collections::VecDeque,
    convert::Infallible,
    future::{Future, poll_fn},
    rc::Rc,
    task::Poll,
    time::Duration,
};

use embassy_futures::{
    block_on,
    join::join,
    select::{Either, select, select4},
};
use embedded_hal_async::delay::DelayNs;
use support::{
    aether::eui,
    flash::MockFlash,
    node::{provisioned, settings},
};
use zigbee_link::{
    Instant,
    link::Delivery,
    network::{Node, Status},
    radio::{
        Capabilities, Channel, Checksum, Config, Csma, FRAME_MAX, FaultInjector, Faults, Filter,
        PSDU_MAX, Radio, Received, Tracer, TxOutcome,
    },
    runner::{Clock, Shared, run},
    store::Store,
    wire::{Eui64, PanId, ShortAddress, fcs},
};

/// Time that passes a little with every poll of [`VirtualClock::tick`].
#[derive(Clone, Default)]
struct VirtualClock(Rc<Cell<u64>>);

impl Clock for VirtualClock {
    fn now(&self) -> Instant {
        Instant(self.0.get())
    }

    fn sleep_until(&self, time: Instant) -> impl Future<Output = ()> {
        poll_fn(move |_| {
            if self.now() >= time {
                Poll::Ready(())
            } else {
                Poll::Pending
            }
        })
    }
}

impl VirtualClock {
    async fn tick(&self) {
        poll_fn::<(), _>(|_| {
            self.0.set(self.0.get() + 100);
            Poll::Pending
        })
        .await;
    }
}

impl DelayNs for VirtualClock {
    async fn delay_ns(&mut self, ns: u32) {
        let end = self.now() + Duration::from_nanos(ns.into());
        self.sleep_until(end).await;
    }
}

#[derive(Default)]
struct Medium {
    queues: Vec<VecDeque<(Channel, Vec<u8>)>>,
    channels: Vec<Option<Channel>>,
    busy_for: u32,
    attempts: u32,
}

/// A bare radio: PSDUs with FCS, one assessment, no filter.
struct Bare {
    medium: Rc<RefCell<Medium>>,
    number: usize,
}

impl Bare {
    fn new(medium: &Rc<RefCell<Medium>>) -> Self {
        let mut inner = medium.borrow_mut();
        inner.queues.push(VecDeque::new());
        inner.channels.push(None);
        Self {
            medium: medium.clone(),
            number: inner.queues.len() - 1,
        }
    }
}

impl Radio for Bare {
    type Error = Infallible;

    fn capabilities(&self) -> Capabilities {
        Capabilities {
            rx_queue: true,
            ..Capabilities::default()
        }
    }

    async fn configure(&mut self, config: &Config) -> Result<(), Infallible> {
        self.medium.borrow_mut().channels[self.number] = Some(config.channel);
        Ok(())
    }

    async fn transmit(&mut self, psdu: &[u8]) -> Result<TxOutcome, Infallible> {
        let medium = &mut *self.medium.borrow_mut();
        medium.attempts += 1;
        if medium.busy_for > 0 {
            medium.busy_for -= 1;
            return Ok(TxOutcome::ChannelBusy);
        }
        let channel = medium.channels[self.number].unwrap();
        for (number, queue) in medium.queues.iter_mut().enumerate() {
            if number != self.number && medium.channels[number] == Some(channel) {
                queue.push_back((channel, psdu.to_vec()));
            }
        }
        Ok(TxOutcome::Sent)
    }

    async fn receive(&mut self, buffer: &mut [u8; PSDU_MAX]) -> Result<Received, Infallible> {
        poll_fn(|_| {
            let queue = &mut self.medium.borrow_mut().queues[self.number];
            let Some((channel, psdu)) = queue.pop_front() else {
                return Poll::Pending;
            };
            buffer[..psdu.len()].copy_from_slice(&psdu);
            Poll::Ready(Ok(Received {
                len: psdu.len(),
                channel,
                rssi: Some(-40),
                lqi: None,
            }))
        })
        .await
    }
}

/// A coordinator and a device with stacked radios form a network and talk over a bad medium, and
/// what is in their flash then is enough to go on after a restart.
#[test]
fn two_nodes_from_flash_to_air() {
    let clock = VirtualClock::default();
    let medium = Rc::new(RefCell::new(Medium::default()));
    let captured = RefCell::new(0);
    let faults = Faults {
        tx_lost: 50,
        rx_lost: 100,
        rx_flipped: 100,
        rx_truncated: 50,
        rx_doubled: 100,
    };
    let stack = |seed| {
        let bad = FaultInjector::new(Bare::new(&medium), faults, seed);
        let radio = Filter::new(Checksum::new(Csma::new(bad, clock.clone(), seed)));
        Tracer::new(radio, clock.clone(), |_: &[u8]| *captured.borrow_mut() += 1)
    };
    let mut radios = [stack(1), stack(2)];
    let [radio0, radio1] = &mut radios;
    let [mut store0, mut store1] = [provisioned(), provisioned()];
    for round in 0..3_u32 {
        let (saved0, saved1) = block_on(join(store0.load(), store1.load()));
        let (saved0, saved1) = (saved0.unwrap(), saved1.unwrap());
        let mut members = [None; 2];
        for (place, member) in members.iter_mut().enumerate() {
            *member = block_on(store0.member(place as u8)).unwrap();
        }
        assert_eq!(members[0].is_some(), round > 0);
        let mut coordinator = Node::<4, 4, 2>::coordinator(settings(0), &saved0, members);
        coordinator.allow(eui(1)).unwrap();
        let device = Node::<4, 4, 2>::device(clock.now(), settings(1), &saved1);
        let shared0 = Shared::new(coordinator, clock.clone());
        let shared1 = Shared::new(device, clock.clone());
        let talk = async {
            while !matches!(shared1.with(|node, _| node.status()), Status::Joined(_)) {
                let later = clock.now() + Duration::from_millis(100);
                clock.sleep_until(later).await;
            }
            for number in 0..20 {
                let message = (round, number, [0x5A_u8; 30]);
                let (sent, received) = join(
                    shared1.send(ShortAddress::COORDINATOR, &message),
                    shared0.recv(),
                )
                .await;
                assert_eq!(sent, Ok(Delivery::Delivered));
                assert_eq!(received, (ShortAddress(1), message));
            }
        };
        let runners = select(
            run(&shared0, radio0, &mut store0),
            run(&shared1, radio1, &mut store1),
        );
        let deadline = clock.sleep_until(clock.now() + Duration::from_secs(600));
        let done = block_on(select4(talk, runners, clock.tick(), deadline));
        assert!(matches!(done, embassy_futures::select::Either4::First(())));
    }
    assert!(*captured.borrow() > 200);
}

/// A flash that fails stops the node: nothing goes out under counters that are not written down.
#[test]
fn no_store_no_frames() {
    let clock = VirtualClock::default();
    let medium = Rc::new(RefCell::new(Medium::default()));
    let mut radio = Checksum::new(Bare::new(&medium));
    let mut store = provisioned();
    let saved = block_on(store.load()).unwrap();
    let mut flash = store.into_flash();
    flash.power(Some(0));
    let mut store = Store::new(flash, 0..MockFlash::<4>::LEN).unwrap();
    let shared = Shared::new(
        Node::<4, 4, 2>::coordinator(settings(0), &saved, [None; 2]),
        clock.clone(),
    );
    let stopped = block_on(select(run(&shared, &mut radio, &mut store), clock.tick()));
    assert!(matches!(stopped, Either::First(_)));
    assert_eq!(medium.borrow().attempts, 0);
}

fn config() -> Config {
    Config {
        channel: Channel::FIRST,
        tx_power: 0,
        pan: PanId(0xBEEF),
        short: ShortAddress(0x42),
        extended: Eui64([1, 2, 3, 4, 5, 6, 7, 8]),
        coordinator: false,
        promiscuous: false,
    }
}

#[test]
fn csma_tries_five_times_and_waits_between() {
    let clock = VirtualClock::default();
    let medium = Rc::new(RefCell::new(Medium::default()));
    let mut radio = Csma::new(Bare::new(&medium), clock.clone(), 1);
    assert!(radio.capabilities().csma);
    block_on(radio.configure(&config())).unwrap();
    let mut send = |busy_for| {
        medium.borrow_mut().busy_for = busy_for;
        medium.borrow_mut().attempts = 0;
        match block_on(select(radio.transmit(&[1, 2, 3]), clock.tick())) {
            Either::First(outcome) => (outcome.unwrap(), medium.borrow().attempts),
            Either::Second(()) => unreachable!(),
        }
    };
    assert_eq!(send(0), (TxOutcome::Sent, 1));
    assert_eq!(send(4), (TxOutcome::Sent, 5));
    let before = clock.now();
    assert_eq!(send(9), (TxOutcome::ChannelBusy, 5));
    // At most 7 + 15 + 31 + 31 + 31 units of 320 us, and the ticks of the clock.
    assert!(clock.now().since(before) <= Duration::from_micros(115 * 320 + 5 * 200));
}

#[test]
fn filter() {
    let config = config();
    let coordinator = Config {
        coordinator: true,
        ..config
    };
    let unjoined = Config {
        pan: PanId::BROADCAST,
        short: ShortAddress::BROADCAST,
        ..config
    };
    // Frame; delivered to the device, to the coordinator, to a device without a network.
    let cases: [(&[u8], [bool; 3]); 12] = [
        (
            &[0x41, 0x98, 1, 0xEF, 0xBE, 0x42, 0, 1, 0],
            [true, true, false],
        ),
        (
            &[0x41, 0x98, 1, 0xEF, 0xBE, 0x43, 0, 1, 0],
            [false, false, false],
        ),
        (
            &[0x41, 0x98, 1, 0xEE, 0xBE, 0x42, 0, 1, 0],
            [false, false, false],
        ),
        (
            &[0x41, 0x98, 1, 0xEF, 0xBE, 0xFF, 0xFF, 1, 0],
            [true, true, false],
        ),
        (
            &[0x41, 0x98, 1, 0xFF, 0xFF, 0xFF, 0xFF, 1, 0],
            [true, true, true],
        ),
        // To the extended address.
        (
            &[0x41, 0x9C, 1, 0xEF, 0xBE, 8, 7, 6, 5, 4, 3, 2, 1, 1, 0],
            [true, true, false],
        ),
        (
            &[0x41, 0x9C, 1, 0xEF, 0xBE, 9, 7, 6, 5, 4, 3, 2, 1, 1, 0],
            [false, false, false],
        ),
        // To nobody, which is the coordinator.
        (&[0x01, 0x90, 1, 0xEF, 0xBE, 1, 0], [false, true, false]),
        // A beacon of the own and of another network.
        (
            &[0x00, 0x90, 1, 0xEF, 0xBE, 0, 0, 0xFF, 0xCF, 0, 0],
            [true, true, true],
        ),
        (
            &[0x00, 0x90, 1, 0xEE, 0xBE, 0, 0, 0xFF, 0xCF, 0, 0],
            [false, false, true],
        ),
        // An acknowledgement, and no frame.
        (&[0x02, 0x00, 1], [false, false, false]),
        (&[0xFF, 0xFF, 1], [false, false, false]),
    ];
    for (frame, accepted) in cases {
        let by = [config, coordinator, unjoined].map(|config| config.accepts(frame));
        assert_eq!(by, accepted, "{frame:02x?}");
    }
    // The wrapper delivers these only, and all when promiscuous.
    for promiscuous in [false, true] {
        let medium = Rc::new(RefCell::new(Medium::default()));
        let mut radio = Filter::new(Bare::new(&medium));
        let own = Config {
            promiscuous,
            ..config
        };
        block_on(radio.configure(&own)).unwrap();
        for (frame, _) in cases {
            let queue = &mut medium.borrow_mut().queues[0];
            queue.push_back((Channel::FIRST, frame.to_vec()));
        }
        let mut delivered = 0;
        let mut buffer = [0; PSDU_MAX];
        let drain = async {
            loop {
                let len = radio.receive(&mut buffer).await.unwrap().len;
                assert!(promiscuous || config.accepts(&buffer[..len]));
                delivered += 1;
            }
        };
        block_on(select(drain, async {}));
        assert_eq!(delivered, if promiscuous { 12 } else { 5 });
    }
}

#[test]
fn checksum() {
    let medium = Rc::new(RefCell::new(Medium::default()));
    let mut sender = Checksum::new(Bare::new(&medium));
    let mut receiver = Checksum::new(Bare::new(&medium));
    assert!(sender.capabilities().fcs);
    block_on(join(
        sender.configure(&config()),
        receiver.configure(&config()),
    ))
    .0
    .unwrap();
    assert!(block_on(sender.transmit(&[0; FRAME_MAX + 1])).is_err());
    assert_eq!(
        block_on(sender.transmit(&[0x02, 0x00, 0x6A])),
        Ok(TxOutcome::Sent)
    );
    assert_eq!(
        medium.borrow().queues[1][0].1,
        [0x02, 0x00, 0x6A, 0xE4, 0x79]
    );
    let damaged = [&[0x02, 0x00, 0x6B, 0xE4, 0x79][..], &[1], &[]];
    for psdu in damaged {
        medium.borrow_mut().queues[1].push_front((Channel::FIRST, psdu.to_vec()));
    }
    let mut buffer = [0; PSDU_MAX];
    let received = block_on(receiver.receive(&mut buffer)).unwrap();
    assert_eq!(buffer[..received.len], [0x02, 0x00, 0x6A]);
}

/// The same seed makes the same faults, about as often as asked.
#[test]
fn faults_are_reproducible() {
    let receive = |seed| {
        let medium = Rc::new(RefCell::new(Medium::default()));
        let faults = Faults {
            rx_lost: 300,
            rx_flipped: 300,
            ..Faults::default()
        };
        let mut radio = FaultInjector::new(Bare::new(&medium), faults, seed);
        for n in 0..2000_u16 {
            let mut frame = n.to_le_bytes().to_vec();
            frame.extend(fcs(&frame).to_le_bytes());
            medium.borrow_mut().queues[0].push_back((Channel::FIRST, frame));
        }
        let mut received = Vec::new();
        let mut buffer = [0; PSDU_MAX];
        let drain = async {
            loop {
                let len = radio.receive(&mut buffer).await.unwrap().len;
                received.push(buffer[..len].to_vec());
            }
        };
        block_on(select(drain, async {}));
        received
    };
    let first = receive(1);
    assert_eq!(first, receive(1));
    assert_ne!(first, receive(2));
    assert!((1300..1500).contains(&first.len()));
    let good = first
        .iter()
        .filter(|frame| zigbee_link::wire::has_good_fcs(frame))
        .count();
    assert!((900..1060).contains(&good), "{good}");
}
