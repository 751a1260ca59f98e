//! The radio medium.

use std::{cell::RefCell, collections::BTreeSet, rc::Rc};

use embassy_futures::select::select;
use virtual_hardware::{
    executor::{Ended, Executor, Time},
    medium::{
        Abilities, Arrival, Capture, Disturbance, Kind, LogDistance, Medium, NRF52840, NodeId,
        Place, Propagation, Radio, RadioError, Reason,
    },
};
use zigbee_link::{
    radio::{Channel, FRAME_MAX, PSDU_MAX, Radio as _, RadioConfig, Received, TxOutcome},
    wire::{Eui64, PanId, ShortAddress, fcs, has_good_fcs},
};

use crate::support::{MICROSECOND, MILLISECOND, SECOND};

const CHANNEL: Channel = Channel::FIRST;
/// Assessment and turnaround before a frame, by hand from the standard.
const LEAD: Time = (128 + 192) * MICROSECOND;

fn config(node: NodeId) -> RadioConfig {
    RadioConfig {
        channel: CHANNEL,
        tx_power: 0,
        pan: PanId(0xBEEF),
        short: ShortAddress(node.0 as u16),
        extended: Eui64([0; 8]),
        coordinator: false,
        promiscuous: true,
        sampled: false,
    }
}

/// A frame of so many bytes.
fn frame(len: usize) -> Vec<u8> {
    let mut frame = vec![0x41, 0x98, 1, 0xEF, 0xBE, 0xFF, 0xFF, 9, 0];
    frame.resize(len, 0x55);
    frame
}

type Heard = Rc<RefCell<Vec<(Time, Received, Vec<u8>)>>>;

struct Bench {
    executor: Executor,
    medium: Medium,
}

impl Bench {
    fn new(propagation: Propagation) -> Self {
        let executor = Executor::new();
        let medium = Medium::new(&executor.clock(), propagation, 1);
        Self { executor, medium }
    }

    fn disk(range: f64, loss: f64) -> Self {
        Self::new(Propagation::UnitDisk { range, loss })
    }

    async fn switched_on(medium: Medium, node: NodeId, abilities: Abilities) -> Radio {
        let mut radio = medium.radio(node, abilities);
        radio.configure(&config(node)).await.unwrap();
        radio
    }

    /// A node that sends frames of so many bytes, beginning at these times.
    fn sender(
        &mut self,
        place: Place,
        sent: &[(Time, usize)],
    ) -> (NodeId, Rc<RefCell<Vec<TxOutcome>>>) {
        let node = self.medium.attach(place);
        let (medium, clock, sent) = (self.medium.clone(), self.executor.clock(), sent.to_vec());
        let outcomes = Rc::new(RefCell::new(Vec::new()));
        let list = outcomes.clone();
        self.executor.spawn(async move {
            let mut radio = Self::switched_on(medium, node, NRF52840).await;
            for (at, len) in sent {
                clock.sleep_until_time(at).await;
                let outcome = radio.transmit(&frame(len)).await.unwrap();
                list.borrow_mut().push(outcome);
            }
            std::future::pending::<()>().await;
        });
        (node, outcomes)
    }

    /// A node that writes down the frames that it hears.
    fn listener(&mut self, place: Place, abilities: Abilities) -> (NodeId, Heard) {
        let node = self.medium.attach(place);
        let heard = Heard::default();
        let (medium, clock, list) = (self.medium.clone(), self.executor.clock(), heard.clone());
        self.executor.spawn(async move {
            let mut radio = Self::switched_on(medium, node, abilities).await;
            let mut buffer = [0; PSDU_MAX];
            loop {
                let received = radio.receive(&mut buffer).await.unwrap();
                let bytes = buffer[..received.len].to_vec();
                list.borrow_mut().push((clock.time(), received, bytes));
            }
        });
        (node, heard)
    }

    fn run(&mut self, until: Time) {
        assert_eq!(self.executor.run_until(until), Ended::TimeUp);
    }

    fn dropped(&self, node: NodeId, reason: Reason) -> u64 {
        self.medium.counters(node).dropped(reason)
    }
}

/// A frame of 20 bytes has a PSDU of 22 and takes (6 + 22) * 32 us = 896 us.
#[test]
fn airtime_by_hand() {
    let mut bench = Bench::disk(10.0, 0.0);
    let (sender, outcomes) = bench.sender([0.0, 0.0], &[(MILLISECOND, 20)]);
    let (listener, heard) = bench.listener([3.0, 4.0], NRF52840);
    bench.run(SECOND);
    let heard = heard.borrow();
    assert_eq!(heard.len(), 1);
    let (at, received, bytes) = &heard[0];
    assert_eq!(*at, MILLISECOND + LEAD + 896 * MICROSECOND);
    assert_eq!((bytes, received.channel), (&frame(20), CHANNEL));
    assert_eq!(received.rssi, Some(-65));
    assert_eq!(*outcomes.borrow(), [TxOutcome::Sent]);
    let counters = bench.medium.counters(sender);
    assert_eq!(
        (counters.frames, counters.bytes, counters.airtime),
        (1, 22, 896 * MICROSECOND)
    );
    assert_eq!(bench.medium.counters(listener).received, 1);
    assert_eq!(bench.medium.totals().frames, 1);
}

/// Two radios that begin within the turnaround collide; one that begins later hears the other.
#[test]
fn collisions_and_the_busy_channel() {
    for (later, collide) in [(0, true), (191, true), (200, false)] {
        let mut bench = Bench::disk(10.0, 0.0);
        let (a, first) = bench.sender([0.0, 0.0], &[(MILLISECOND, 20)]);
        let (b, second) = bench.sender([1.0, 0.0], &[(MILLISECOND + later * MICROSECOND, 20)]);
        let (listener, heard) = bench.listener([0.0, 1.0], NRF52840);
        bench.run(SECOND);
        assert_eq!(*first.borrow(), [TxOutcome::Sent]);
        if collide {
            assert_eq!(*second.borrow(), [TxOutcome::Sent]);
            assert_eq!(heard.borrow().len(), 0);
            assert_eq!(bench.dropped(listener, Reason::Collision), 2);
            assert_eq!(bench.dropped(a, Reason::HalfDuplex), 1);
            assert_eq!(bench.dropped(b, Reason::HalfDuplex), 1);
        } else {
            assert_eq!(*second.borrow(), [TxOutcome::ChannelBusy]);
            assert_eq!(bench.dropped(b, Reason::Busy), 1);
            assert_eq!(heard.borrow().len(), 1);
        }
    }
}

/// Two nodes that do not hear one another collide at the one between them, whenever they overlap.
#[test]
fn hidden_terminal() {
    let mut bench = Bench::disk(10.0, 0.0);
    let frames = [(MILLISECOND, 100), (20 * MILLISECOND, 100)];
    let (a, left) = bench.sender([-8.0, 0.0], &frames);
    let late = [(3 * MILLISECOND, 100), (30 * MILLISECOND, 100)];
    let (_, right) = bench.sender([8.0, 0.0], &late);
    let (middle, heard) = bench.listener([0.0, 0.0], NRF52840);
    bench.run(SECOND);
    assert_eq!(*left.borrow(), [TxOutcome::Sent; 2]);
    assert_eq!(*right.borrow(), [TxOutcome::Sent; 2]);
    assert_eq!(bench.dropped(middle, Reason::Collision), 2);
    assert_eq!(heard.borrow().len(), 2);
    // Each is out of the other's range.
    assert_eq!(bench.dropped(a, Reason::OutOfRange), 2);
}

/// The frame that is received survives a later one that is 6 dB weaker, but not one that is 2 dB
/// weaker; a later one is lost even if it is stronger. At 10 units the exponent makes -50 dBm.
#[test]
fn capture() {
    for (later, survives) in [(-56.0, true), (-52.0, false), (-40.0, false)] {
        let mut bench = Bench::new(Propagation::LogDistance(LogDistance {
            loss_at_one: 30.0,
            exponent: 2.0,
            shadowing: 0.0,
            // They do not wait for one another.
            clear_channel: 0.0,
            ..LogDistance::default()
        }));
        let away = 10_f64.powf((-later - 30.0) / 20.0);
        bench.sender([10.0, 0.0], &[(MILLISECOND, 100)]);
        bench.sender([0.0, away], &[(2 * MILLISECOND, 20)]);
        let (listener, heard) = bench.listener([0.0; 2], NRF52840);
        bench.run(SECOND);
        let expected = (usize::from(survives), 2 - u64::from(survives));
        let lost = bench.dropped(listener, Reason::Collision);
        assert_eq!((heard.borrow().len(), lost), expected, "{later} dBm");
    }
}

/// 30 % of 10,000 frames: within four standard deviations (0.46 %) of that. Another node changes
/// nothing.
#[test]
fn loss_is_as_asked_and_independent_of_others() {
    let arrivals = |nodes: usize| {
        let mut bench = Bench::disk(10.0, 0.3);
        let times: Vec<_> = (1..=10_000).map(|n| (n * 5 * MILLISECOND, 20)).collect();
        bench.sender([0.0, 0.0], &times);
        let (listener, heard) = bench.listener([1.0, 0.0], NRF52840);
        for n in 0..nodes {
            bench.listener([0.0, n as f64], NRF52840);
        }
        bench.run(60 * SECOND);
        let lost = bench.dropped(listener, Reason::Loss);
        assert_eq!(heard.borrow().len() as u64 + lost, 10_000);
        assert!(
            (lost as f64 / 10_000.0 - 0.3).abs() < 4.0 * 0.0046,
            "{lost}"
        );
        let times: Vec<Time> = heard.borrow().iter().map(|(at, ..)| *at).collect();
        times
    };
    assert_eq!(arrivals(0), arrivals(3));
}

/// Fates of frames that no task waits for, and of frames for others.
#[test]
fn queues_and_filters() {
    let times: Vec<_> = (1..=12).map(|n| (n * 5 * MILLISECOND, 20)).collect();
    let mut bench = Bench::disk(10.0, 0.0);
    bench.sender([0.0, 0.0], &times);
    let off = bench.medium.attach([1.0, 0.0]);
    let deaf = bench.medium.attach([2.0, 0.0]);
    let full = bench.medium.attach([3.0, 0.0]);
    let other = bench.medium.attach([4.0, 0.0]);
    let medium = bench.medium.clone();
    let late = Rc::new(RefCell::new(0));
    let (count, clock) = (late.clone(), bench.executor.clock());
    bench.executor.spawn(async move {
        let no_queue = Abilities {
            rx_queue: false,
            ..NRF52840
        };
        let _deaf = Bench::switched_on(medium.clone(), deaf, no_queue).await;
        let mut full = Bench::switched_on(medium.clone(), full, NRF52840).await;
        let mut other = medium.radio(other, NRF52840);
        let foreign = RadioConfig {
            pan: PanId(0x1234),
            promiscuous: false,
            sampled: false,
            ..config(off)
        };
        other.configure(&foreign).await.unwrap();
        clock.sleep(SECOND / 2).await;
        let mut buffer = [0; PSDU_MAX];
        let drain = async {
            loop {
                full.receive(&mut buffer).await.unwrap();
                *count.borrow_mut() += 1;
            }
        };
        select(drain, clock.sleep(SECOND)).await;
    });
    bench.run(SECOND);
    assert_eq!(bench.dropped(deaf, Reason::NotListening), 12);
    assert_eq!(
        (bench.dropped(full, Reason::QueueFull), *late.borrow()),
        (4, 8)
    );
    assert_eq!(bench.dropped(other, Reason::Filtered), 12);
    assert_eq!(bench.medium.counters(off), Default::default());
}

#[test]
fn scripted_disturbances() {
    let times: Vec<_> = (0..60)
        .map(|n| (10 * MILLISECOND + n * SECOND / 10, 20))
        .collect();
    let mut bench = Bench::disk(10.0, 0.0);
    let raw = Abilities {
        fcs: false,
        ..NRF52840
    };
    let (sender, outcomes) = bench.sender([0.0, 0.0], &times);
    let (listener, heard) = bench.listener([5.0, 0.0], NRF52840);
    let (_, damaged) = bench.listener([5.0, 0.0], raw);
    let kinds = [
        Kind::Partition(BTreeSet::from([listener])),
        Kind::Loss(1.0),
        // Reaches the listeners, not the sender.
        Kind::Jammer {
            channel: Some(CHANNEL),
            disk: Some(([7.0, 0.0], 3.0)),
        },
        Kind::Jammer {
            channel: None,
            disk: None,
        },
    ];
    for (second, kind) in (1..).zip(kinds) {
        let during = second * SECOND..(second + 1) * SECOND;
        bench.medium.disturb(Disturbance { during, kind });
    }
    bench.run(10 * SECOND);
    let reasons = [
        (Reason::Partitioned, 10),
        (Reason::Loss, 10),
        (Reason::Jammed, 10),
    ];
    for (reason, count) in reasons {
        assert_eq!(bench.dropped(listener, reason), count, "{reason:?}");
    }
    assert_eq!(bench.dropped(sender, Reason::Busy), 10);
    assert_eq!(outcomes.borrow()[40..50], [TxOutcome::ChannelBusy; 10]);
    assert_eq!(heard.borrow().len(), 20);
    // A radio without FCS gets the frame as the air left it.
    let intact = |second: u64| -> Vec<bool> {
        let during = second * SECOND..(second + 1) * SECOND;
        let damaged = damaged.borrow();
        let within = damaged.iter().filter(|(at, ..)| during.contains(at));
        within.map(|(_, _, bytes)| has_good_fcs(bytes)).collect()
    };
    assert_eq!(intact(0), [true; 10]);
    assert_eq!(intact(1), [true; 10]);
    assert_eq!(intact(3), [false; 10]);
    assert_eq!(intact(5), [true; 10]);
}

/// Rules 1, 8 and 9 of the contract.
#[test]
fn radios_that_are_used_against_their_contract() {
    let mut bench = Bench::disk(10.0, 0.0);
    let (_, heard) = bench.listener([5.0, 0.0], NRF52840);
    let node = bench.medium.attach([0.0, 0.0]);
    let (medium, clock) = (bench.medium.clone(), bench.executor.clock());
    bench.executor.spawn(async move {
        let mut radio = medium.radio(node, NRF52840);
        let refused = radio.transmit(&frame(20)).await;
        assert_eq!(refused, Err(RadioError::NotConfigured));
        let refused = radio.receive(&mut [0; PSDU_MAX]).await;
        assert_eq!(refused.err(), Some(RadioError::NotConfigured));
        radio.configure(&config(node)).await.unwrap();
        for length in [2, FRAME_MAX + 1] {
            let refused = radio.transmit(&vec![0; length]).await;
            assert_eq!(refused, Err(RadioError::Length(length)));
        }
        select(radio.transmit(&frame(60)), clock.sleep(MILLISECOND)).await;
        assert_eq!(radio.transmit(&frame(20)).await, Ok(TxOutcome::Sent));
        // The first frame, begun at 0, went out; the second followed it.
        let first = LEAD + (6 + 62) * 32 * MICROSECOND;
        let second = LEAD + (6 + 22) * 32 * MICROSECOND;
        assert_eq!(clock.time(), first + second);
    });
    bench.run(SECOND);
    assert_eq!(bench.executor.tasks(), 1);
    let lengths: Vec<_> = heard.borrow().iter().map(|(_, r, _)| r.len).collect();
    assert_eq!(lengths, [60, 20]);
}

#[test]
fn a_power_cut_within_a_frame() {
    let mut bench = Bench::disk(10.0, 0.0);
    let (listener, heard) = bench.listener([5.0, 0.0], NRF52840);
    let node = bench.medium.attach([0.0, 0.0]);
    let medium = bench.medium.clone();
    let task = bench.executor.spawn(async move {
        let mut radio = Bench::switched_on(medium, node, NRF52840).await;
        let _ = radio.transmit(&frame(100)).await;
    });
    bench.run(2 * MILLISECOND);
    bench.executor.kill(task);
    // It is switched on again before the end of what it had begun.
    let medium = bench.medium.clone();
    bench.executor.spawn(async move {
        let mut radio = Bench::switched_on(medium, node, NRF52840).await;
        assert_eq!(radio.transmit(&frame(20)).await, Ok(TxOutcome::Sent));
    });
    bench.run(SECOND);
    assert_eq!(bench.executor.tasks(), 1);
    assert_eq!(bench.dropped(listener, Reason::CutOff), 1);
    assert_eq!(
        heard.borrow().len() as u64 + bench.dropped(listener, Reason::Collision),
        1
    );
}

/// By hand, without shadowing: 10 m with exponent 3 is 40.2 + 30 dB; 80 m is 97.3 dB, too weak.
#[test]
fn log_distance() {
    let model = LogDistance {
        shadowing: 0.0,
        ..LogDistance::default()
    };
    let mut bench = Bench::new(Propagation::LogDistance(model));
    let (sender, _) = bench.sender([0.0, 0.0], &[(MILLISECOND, 20)]);
    let (_, near) = bench.listener([6.0, 8.0], NRF52840);
    let (_, far) = bench.listener([80.0, 0.0], NRF52840);
    bench.run(SECOND);
    assert_eq!(near.borrow()[0].1.rssi, Some(-70));
    // 24.8 dB above the sensitivity.
    assert_eq!(near.borrow()[0].1.lqi, Some(158));
    assert_eq!(far.borrow().len(), 0);
    assert_eq!(bench.dropped(sender, Reason::OutOfRange), 1);
}

#[test]
fn a_node_that_moves_away_is_no_longer_heard() {
    let mut bench = Bench::disk(10.0, 0.0);
    let times = [(MILLISECOND, 20), (2 * SECOND, 20), (4 * SECOND, 20)];
    let (sender, _) = bench.sender([0.0, 0.0], &times);
    let (_, heard) = bench.listener([5.0, 0.0], NRF52840);
    bench.run(SECOND);
    bench.medium.move_to(sender, [500.0, 0.0]);
    bench.run(3 * SECOND);
    assert_eq!(heard.borrow().len(), 1);
    bench.medium.move_to(sender, [0.0, 3.0]);
    bench.run(5 * SECOND);
    assert_eq!(heard.borrow().len(), 2);
}

#[derive(Clone, Default)]
struct File(Rc<RefCell<Vec<u8>>>);

impl std::io::Write for File {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.borrow_mut().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// One record for each frame, however many hear it, at the time of its beginning.
#[test]
fn captures() {
    let mut bench = Bench::disk(10.0, 0.0);
    bench.sender([0.0, 0.0], &[(MILLISECOND, 20), (2 * SECOND, 30)]);
    bench.listener([5.0, 0.0], NRF52840);
    bench.listener([6.0, 0.0], NRF52840);
    let file = File::default();
    bench.medium.watch(Capture::new(file.clone()).unwrap());
    bench.run(3 * SECOND);
    let bytes = file.0.borrow();
    // Header; two records of 16 bytes, TAP header of 20, frame and FCS.
    assert_eq!(bytes.len(), 24 + (16 + 20 + 22) + (16 + 20 + 32));
    let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!((number(24), number(28)), (0, 1320));
    assert_eq!((number(82), number(86)), (2, 320));
}

/// Facts that a radio elsewhere is told: time, sender, strength, and the reason why it is lost.
type Told = Rc<RefCell<Vec<(Time, NodeId, f32, Option<Reason>)>>>;

/// Sender whose frame began, true if it stands out, and senders whose frames do not any more.
type Overlap = (NodeId, bool, Vec<NodeId>);

impl Bench {
    /// A node whose radio is elsewhere.
    fn elsewhere(&mut self, place: Place) -> (NodeId, Told) {
        let node = self.medium.attach(place);
        let (clock, told) = (self.executor.clock(), Told::default());
        let list = told.clone();
        let ear = move |arrival: Arrival<'_>| {
            assert!(has_good_fcs(arrival.psdu) && arrival.channel == CHANNEL);
            let Arrival {
                from,
                strength,
                lost,
                ..
            } = arrival;
            list.borrow_mut().push((clock.time(), from, strength, lost));
        };
        self.medium.set_ear(node, Some(Box::new(ear)));
        (node, told)
    }

    /// It sends a frame of 20 bytes.
    fn send_elsewhere(&mut self, node: NodeId, at: Time) {
        let (medium, clock) = (self.medium.clone(), self.executor.clock());
        self.executor.spawn(async move {
            clock.sleep_until_time(at).await;
            let frame = frame(20);
            let psdu = [frame.as_slice(), &fcs(&frame).to_le_bytes()].concat();
            medium.transmit(node, CHANNEL, 0, &psdu);
        });
    }
}

/// Radios elsewhere are told at the start of a frame; radios here receive theirs.
#[test]
fn a_radio_may_be_elsewhere() {
    let mut bench = Bench::disk(10.0, 0.0);
    let (one, told) = bench.elsewhere([0.0, 0.0]);
    let (other, other_told) = bench.elsewhere([3.0, 4.0]);
    let (here, heard) = bench.listener([6.0, 8.0], NRF52840);
    let (_, far_told) = bench.elsewhere([0.0, 11.0]);
    bench.send_elsewhere(one, MILLISECOND);
    bench.run(SECOND);
    assert_eq!(*other_told.borrow(), [(MILLISECOND, one, -65.0, None)]);
    assert!(told.borrow().is_empty() && far_told.borrow().is_empty());
    let came: Vec<_> = (heard.borrow().iter())
        .map(|(at, _, bytes)| (*at, bytes.clone()))
        .collect();
    assert_eq!(came, [(MILLISECOND + 896 * MICROSECOND, frame(20))]);
    let counters = bench.medium.counters(one);
    let airtime = 896 * MICROSECOND;
    assert_eq!(
        (counters.frames, counters.bytes, counters.airtime),
        (1, 22, airtime)
    );
    assert_eq!(counters.dropped(Reason::OutOfRange), 0);
    // A node that has no ear any more is not told.
    bench.medium.set_ear(other, None);
    bench.send_elsewhere(one, 2 * SECOND);
    bench.run(3 * SECOND);
    assert_eq!(other_told.borrow().len(), 1);
    assert_eq!(bench.medium.counters(here).received, 2);
}

/// Radios elsewhere are told which of the frames that overlap stands out, by the rule that holds here.
#[test]
fn what_stands_out_is_told_elsewhere() {
    let model = LogDistance {
        shadowing: 0.0,
        ..LogDistance::default()
    };
    let mut bench = Bench::new(Propagation::LogDistance(model));
    let [near, as_near, far] =
        [[1.0, 0.0], [0.0, 1.0], [4.0, 0.0]].map(|place| bench.medium.attach(place));
    let node = bench.medium.attach([0.0, 0.0]);
    let told: Rc<RefCell<Vec<Overlap>>> = Rc::default();
    let list = told.clone();
    let ear = move |arrival: Arrival<'_>| {
        let entry = (arrival.from, arrival.stands_out, arrival.spoils.to_vec());
        list.borrow_mut().push(entry);
    };
    bench.medium.set_ear(node, Some(Box::new(ear)));
    let both = [near, as_near];
    for (second, [first, second_from]) in (1..).zip([[near, far], [far, near], both]) {
        bench.send_elsewhere(first, second * SECOND);
        bench.send_elsewhere(second_from, second * SECOND + 100 * MICROSECOND);
    }
    // One alone, on another channel than a strong one.
    bench.send_elsewhere(far, 4 * SECOND);
    let (medium, clock) = (bench.medium.clone(), bench.executor.clock());
    bench.executor.spawn(async move {
        clock.sleep_until_time(4 * SECOND + 100 * MICROSECOND).await;
        medium.transmit(near, Channel::LAST, 0, &[frame(20), vec![0, 0]].concat());
    });
    bench.run(5 * SECOND);
    let expected = [
        (near, true, vec![]),
        (far, false, vec![]),
        (far, true, vec![]),
        (near, true, vec![far]),
        (near, true, vec![]),
        (as_near, false, vec![near]),
        (far, true, vec![]),
        (near, true, vec![]),
    ];
    assert_eq!(*told.borrow(), expected);
}

/// A jammer is heard where it reaches, on its channel, while it lasts.
#[test]
fn who_asks_is_told_what_is_jammed() {
    let mut bench = Bench::disk(10.0, 0.0);
    let [near, far] = [[0.0, 0.0], [5.0, 0.0]].map(|place| bench.medium.attach(place));
    bench.medium.disturb(Disturbance {
        during: SECOND..2 * SECOND,
        kind: Kind::Jammer {
            channel: Some(CHANNEL),
            disk: Some(([0.0, 1.0], 2.0)),
        },
    });
    for (until, jammed) in [(SECOND / 2, 0), (SECOND, 1), (2 * SECOND, 0)] {
        bench.run(until);
        assert_eq!(bench.medium.jammed(near), vec![CHANNEL; jammed]);
        assert_eq!(bench.medium.jammed(far), []);
    }
}

/// A tenth is lost by chance, all while a jammer is near; a partition separates.
#[test]
fn what_goes_wrong_is_told_elsewhere_too() {
    let mut bench = Bench::disk(10.0, 0.1);
    let (one, _) = bench.elsewhere([0.0, 0.0]);
    let (other, told) = bench.elsewhere([3.0, 4.0]);
    for (number, kind) in [
        Kind::Jammer {
            channel: None,
            disk: Some(([3.0, 4.0], 1.0)),
        },
        Kind::Partition([one].into()),
    ]
    .into_iter()
    .enumerate()
    {
        let from = (number as Time + 10) * SECOND;
        bench.medium.disturb(Disturbance {
            during: from..from + SECOND,
            kind,
        });
    }
    for number in 0..1200 {
        bench.send_elsewhere(one, number * 10 * MILLISECOND);
    }
    bench.run(12 * SECOND);
    let told = told.borrow();
    assert_eq!(told.len(), 1100);
    let count = |reason| told.iter().filter(|told| told.3 == Some(reason)).count();
    assert!(
        (70..130).contains(&count(Reason::Loss)),
        "{}",
        count(Reason::Loss)
    );
    assert!(count(Reason::Jammed) > 80);
    assert!((told.iter()).all(|told| told.0 >= 10 * SECOND || told.3 != Some(Reason::Jammed)));
    assert_eq!(bench.dropped(other, Reason::Partitioned), 100);
    assert_eq!(
        bench.dropped(other, Reason::Jammed),
        count(Reason::Jammed) as u64
    );
}
