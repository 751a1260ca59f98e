//! Whole nodes: runner, stacked radios, store in a flash, clock; and the wrappers one by one.

use crate::support;

use std::{
    cell::{Cell, RefCell},
    collections::VecDeque,
    convert::Infallible,
    future::pending,
    panic::catch_unwind,
    rc::Rc,
};

use embassy_futures::{block_on, join::join, select::select};
use embedded_hal_async::delay::DelayNs;
use support::{
    aether::eui,
    node::{LEN, air, provisioned, settings},
};
use virtual_hardware::{
    executor::{Clock, Ended, Executor},
    medium::Abilities,
};
use zigbee_link::{
    link::{Delivery, SendError},
    network::{MembersFull, NetworkStatus, Node},
    radio::{
        Channel, Checksum, Csma, FRAME_MAX, FaultInjector, Faults, PSDU_MAX, Radio, RadioConfig,
        Received, Tracer, TxOutcome,
    },
    runner::{Clock as _, Shared, run},
    store::Store,
    wire::{Eui64, PanId, ShortAddress, fcs},
};

const SECOND: u64 = 1_000_000_000;

/// A radio that hears what it is told, and notes what it sends: PSDUs with FCS, one assessment, no
/// filter.
#[derive(Clone, Default)]
struct Bare {
    heard: Rc<RefCell<VecDeque<Vec<u8>>>>,
    sent: Rc<RefCell<Vec<Vec<u8>>>>,
    attempts: Rc<Cell<u32>>,
    /// The channel is so for so many attempts.
    busy_for: Rc<Cell<u32>>,
}

impl Bare {
    fn hear(&self, psdu: &[u8]) {
        self.heard.borrow_mut().push_back(psdu.to_vec());
    }
}

impl Radio for Bare {
    type Error = Infallible;

    async fn configure(&mut self, _: &RadioConfig) -> Result<(), Infallible> {
        Ok(())
    }

    async fn transmit(&mut self, psdu: &[u8]) -> Result<TxOutcome, Infallible> {
        self.attempts.update(|attempts| attempts + 1);
        if let Some(left) = self.busy_for.get().checked_sub(1) {
            self.busy_for.set(left);
            return Ok(TxOutcome::ChannelBusy);
        }
        self.sent.borrow_mut().push(psdu.to_vec());
        Ok(TxOutcome::Sent)
    }

    async fn receive(&mut self, buffer: &mut [u8; PSDU_MAX]) -> Result<Received, Infallible> {
        let Some(psdu) = self.heard.borrow_mut().pop_front() else {
            return pending().await;
        };
        buffer[..psdu.len()].copy_from_slice(&psdu);
        Ok(Received {
            len: psdu.len(),
            channel: Channel::FIRST,
            rssi: Some(-40),
            lqi: None,
        })
    }
}

/// A coordinator and a device with stacked radios form a network and talk over a bad medium, and
/// what is in their flash then is enough to go on after a restart.
#[test]
fn two_nodes_from_flash_to_air() {
    let mut executor = Executor::new();
    let clock = executor.clock();
    let medium = air(&clock, 0.0);
    let antennas = [medium.attach([0.0; 2]), medium.attach([0.0; 2])];
    let captured = Rc::new(Cell::new(0));
    let faults = Faults {
        tx_lost: 50,
        rx_lost: 100,
        rx_flipped: 100,
        rx_truncated: 50,
        rx_doubled: 100,
    };
    let bare = Abilities {
        rx_queue: true,
        ..Abilities::default()
    };
    let flashes = [provisioned(), provisioned()].map(Store::into_flash);
    for round in 0..3_u32 {
        let [mut store0, store1] = [0, 1].map(|node: usize| {
            let mut store = Store::new(flashes[node].clone(), 0..LEN).unwrap();
            (block_on(store.load()).unwrap(), store)
        });
        let members = [0, 1].map(|place| block_on(store0.1.member(place)).unwrap());
        assert_eq!(members[0].is_some(), round > 0);
        let mut coordinator = Node::<4, 4, 2>::coordinator(settings(0), &store0.0, members);
        coordinator.allow(eui(1).number()).unwrap();
        let device = Node::<4, 4, 2>::device(clock.now(), settings(1), &store1.0);
        let nodes = [coordinator, device].map(|node| Rc::new(Shared::new(node, clock.clone())));
        let mut tasks = Vec::new();
        for (n, (_, mut store)) in (0..).zip([store0, store1]) {
            let (node, clock, captured) = (nodes[n].clone(), clock.clone(), captured.clone());
            let seed = n as u64 + 1;
            let bad = FaultInjector::new(medium.radio(antennas[n], bare), faults, seed);
            let radio = Checksum::new(Csma::new(bad, clock.clone(), seed));
            tasks.push(executor.spawn(async move {
                let count = |_: &[u8]| captured.update(|count| count + 1);
                let mut radio = Tracer::new(radio, clock, count);
                panic!("{:?}", run(&node, &mut radio, &mut store).await);
            }));
        }
        let is_done = Rc::new(Cell::new(false));
        let (done, later) = (is_done.clone(), clock.clone());
        let [coordinator, device] = nodes;
        tasks.push(executor.spawn(async move {
            while !matches!(
                device.with(|node, _| node.status()),
                Some(NetworkStatus::Joined(_))
            ) {
                later.sleep(SECOND / 10).await;
            }
            for number in 0..20 {
                let message = (round, number, [0x5A_u8; 30]);
                let (sent, received) = join(
                    device.send(ShortAddress::COORDINATOR, &message),
                    coordinator.recv(),
                )
                .await;
                assert_eq!(sent, Ok(Delivery::Delivered));
                assert_eq!(received, (ShortAddress(1), message));
            }
            done.set(true);
        }));
        let limit = clock.time() + 600 * SECOND;
        let ended = executor.run_until_time_or(limit, || is_done.get());
        assert_eq!(ended, Ended::ConditionMet);
        tasks.into_iter().for_each(|task| executor.kill(task));
    }
    assert!(captured.get() > 200);
}

/// The compiler does not let a node be used while it is in use, see `Shared::with`. A caller that gets round that,
/// here by a thread's local, fails where assertions are checked, and elsewhere gets nothing and goes on.
#[test]
fn a_node_in_use_is_nobody_elses() {
    thread_local! {
        static SHARED: Shared<Clock, 4, 4, 2> = {
            let saved = block_on(provisioned().load()).unwrap();
            let node = Node::coordinator(settings(0), &saved, [None; 2]);
            Shared::new(node, Executor::new().clock())
        };
    }
    let allow =
        |device| SHARED.with(|shared| shared.with(|node, _| node.allow(eui(device).number())));
    let nested = || SHARED.with(|shared| shared.with(|_, _| allow(2)));
    let outcome = catch_unwind(nested).ok();
    let expected = (!cfg!(debug_assertions)).then_some(Some(None));
    assert_eq!(outcome, expected);
    // It is free again, and the one that got nothing did nothing.
    assert_eq!(allow(1), Some(Ok(())));
    assert_eq!(allow(3), Some(Ok(())));
    assert_eq!(allow(4), Some(Err(MembersFull)));
    // A message that is not taken is worth another attempt.
    let post = || SHARED.with(|shared| shared.post(ShortAddress(1), &()));
    let nested = || SHARED.with(|shared| shared.with(|_, _| post()));
    let outcome = catch_unwind(nested).ok();
    let expected = (!cfg!(debug_assertions)).then_some(Some(Err(SendError::QueueFull)));
    assert_eq!(outcome, expected);
}

/// A flash that fails stops the node: nothing goes out under counters that are not written down.
#[test]
fn no_store_no_frames() {
    let mut executor = Executor::new();
    let clock = executor.clock();
    let bare = Bare::default();
    let attempts = bare.attempts.clone();
    let mut radio = Checksum::new(bare);
    let mut store = provisioned();
    let saved = block_on(store.load()).unwrap();
    let flash = store.into_flash();
    flash.power(Some(0));
    let mut store = Store::new(flash, 0..LEN).unwrap();
    let node = Node::<4, 4, 2>::coordinator(settings(0), &saved, [None; 2]);
    executor.spawn(async move {
        let shared = Shared::new(node, clock);
        run(&shared, &mut radio, &mut store).await;
    });
    assert_eq!(executor.run_until(600 * SECOND), Ended::TimeUp);
    assert_eq!(executor.tasks(), 0);
    assert_eq!(attempts.get(), 0);
}

fn config() -> RadioConfig {
    RadioConfig {
        channel: Channel::FIRST,
        tx_power: 0,
        pan: PanId(0xBEEF),
        short: ShortAddress(0x42),
        extended: Eui64([1, 2, 3, 4, 5, 6, 7, 8]),
        coordinator: false,
        promiscuous: false,
        sampled: false,
    }
}

#[test]
fn csma_tries_five_times_and_waits_between() {
    for (busy_for, outcome, attempts) in [
        (0, TxOutcome::Sent, 1),
        (4, TxOutcome::Sent, 5),
        (9, TxOutcome::ChannelBusy, 5),
    ] {
        let mut executor = Executor::new();
        let clock = executor.clock();
        let bare = Bare::default();
        bare.busy_for.set(busy_for);
        let mut radio = Csma::new(bare.clone(), clock.clone(), 1);
        executor.spawn(async move {
            radio.configure(&config()).await.unwrap();
            assert_eq!(radio.transmit(&[1, 2, 3]).await, Ok(outcome));
            // At most 7 + 15 + 31 + 31 + 31 units of 320 us.
            assert!(clock.time() <= 115 * 320_000);
            assert!(busy_for == 0 || clock.time() > 0);
        });
        assert_eq!(executor.run_until(SECOND), Ended::TimeUp);
        assert_eq!((executor.tasks(), bare.attempts.get()), (0, attempts));
    }
}

/// `macMinBE` 3, `macMaxBE` 5, and a unit of 320 us (IEEE 802.15.4-2006, 7.5.1.4).
#[test]
fn csma_waits_longer_each_time() {
    struct Noted<'a>(&'a RefCell<Vec<u32>>);

    impl DelayNs for Noted<'_> {
        async fn delay_ns(&mut self, ns: u32) {
            self.0.borrow_mut().push(ns / 1000);
        }
    }

    let waits = RefCell::new(Vec::new());
    let bare = Bare::default();
    bare.busy_for.set(u32::MAX);
    let mut radio = Csma::new(bare, Noted(&waits), 1);
    for _ in 0..500 {
        let outcome = block_on(radio.transmit(&[1, 2, 3]));
        assert_eq!(outcome, Ok(TxOutcome::ChannelBusy));
    }
    let waits = waits.into_inner();
    for (attempt, units) in [8, 16, 32, 32, 32].into_iter().enumerate() {
        let waited = waits.iter().skip(attempt).step_by(5);
        let mut drawn: Vec<_> = waited.map(|wait| (wait / 320, wait % 320)).collect();
        assert_eq!(drawn.len(), 500);
        drawn.sort_unstable();
        drawn.dedup();
        let all: Vec<_> = (0..units).map(|unit| (unit, 0)).collect();
        assert_eq!(drawn, all, "attempt {attempt}");
    }
}

#[test]
fn checksum() {
    let bare = Bare::default();
    let mut radio = Checksum::new(bare.clone());
    block_on(radio.configure(&config())).unwrap();
    assert!(block_on(radio.transmit(&[0; FRAME_MAX + 1])).is_err());
    assert!(block_on(radio.transmit(&[0; FRAME_MAX])).is_ok());
    bare.sent.borrow_mut().clear();
    let sent = block_on(radio.transmit(&[0x02, 0x00, 0x6A]));
    assert_eq!(sent, Ok(TxOutcome::Sent));
    let intact = [0x02, 0x00, 0x6A, 0xE4, 0x79];
    assert_eq!(*bare.sent.borrow(), [intact]);
    let damaged = [&[0x02, 0x00, 0x6B, 0xE4, 0x79][..], &[1], &[]];
    for psdu in damaged.into_iter().chain([&intact[..]]) {
        bare.hear(psdu);
    }
    let mut buffer = [0; PSDU_MAX];
    let received = block_on(radio.receive(&mut buffer)).unwrap();
    assert_eq!(buffer[..received.len], [0x02, 0x00, 0x6A]);
}

/// The same seed makes the same faults, about as often as asked.
#[test]
fn faults_are_reproducible() {
    let receive = |seed| {
        let bare = Bare::default();
        let faults = Faults {
            rx_lost: 300,
            rx_flipped: 300,
            ..Faults::default()
        };
        let mut radio = FaultInjector::new(bare.clone(), faults, seed);
        for n in 0..2000_u16 {
            let mut frame = n.to_le_bytes().to_vec();
            frame.extend(fcs(&frame).to_le_bytes());
            bare.hear(&frame);
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
