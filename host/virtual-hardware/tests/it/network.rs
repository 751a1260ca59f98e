//! `zigbee-link` nodes on the machinery.

use std::{cell::RefCell, rc::Rc};

use virtual_hardware::{
    executor::{Ended, Executor, Time},
    medium::{Digest, Event, Medium, NodeId, Propagation, Watcher},
    random::Root,
};
use zigbee_link::{
    link::Delivery,
    radio::Channel,
    wire::{ShortAddress, fcs},
};

use crate::support::{MILLISECOND, Network, SECOND};

fn network(nodes: u32, loss: f64, seed: u64) -> Network {
    let executor = Executor::new();
    let root = Root(seed);
    let disk = Propagation::UnitDisk { range: 20.0, loss };
    let medium = Medium::new(&executor.clock(), disk, root.seed("medium", 0));
    let places = (0..nodes).map(|n| [f64::from(n % 4), f64::from(n / 4)]);
    Network::new(executor, medium, root, places)
}

/// Two nodes form a network and one joins, with 30 % of all frames lost; then 20 messages arrive,
/// each once.
#[test]
fn two_nodes_join_and_talk_over_a_lossy_medium() {
    for seed in 0..10 {
        let mut network = network(2, 0.3, seed);
        let ended = network.executor.run_until(120 * SECOND);
        assert_eq!(ended, Ended::TimeUp);
        assert_eq!(network.joined(), 2, "seed {seed}");
        let nodes: Vec<_> = network
            .windows
            .iter()
            .map(|window| window.borrow().clone().unwrap())
            .collect();
        let (sender, receiver) = (nodes[1].clone(), nodes[0].clone());
        let delivered = Rc::new(RefCell::new(0));
        let received = Rc::new(RefCell::new(Vec::new()));
        let count = delivered.clone();
        network.executor.spawn(async move {
            for number in 0..20_u32 {
                let sent = sender.send(ShortAddress::COORDINATOR, &number).await;
                *count.borrow_mut() += u32::from(sent == Ok(Delivery::Delivered));
            }
        });
        let list = received.clone();
        network.executor.spawn(async move {
            loop {
                let (from, number) = receiver.recv::<u32>().await;
                assert_eq!(from, ShortAddress(1));
                list.borrow_mut().push(number);
            }
        });
        assert_eq!(network.executor.run_until(400 * SECOND), Ended::TimeUp);
        let received = received.borrow();
        assert!(received.is_sorted_by(|a, b| a < b), "{received:?}");
        assert!(received.len() as u32 >= *delivered.borrow());
        assert!(*delivered.borrow() >= 18, "{delivered:?}");
    }
}

/// Thirteen nodes, one of which is cut off and comes back.
fn eventful_run(seed: u64, nodes: u32) -> (u64, Network) {
    let mut network = network(nodes, 0.1, seed);
    let digest = Rc::new(RefCell::new(Digest::default()));
    let all = digest.clone();
    let watch = move |at: Time, event: Event<'_>| all.borrow_mut().event(at, event);
    network.medium.watch(watch);
    assert_eq!(network.executor.run_until(30 * SECOND), Ended::TimeUp);
    network.executor.kill(network.tasks[3]);
    assert_eq!(network.executor.run_until(31 * SECOND), Ended::TimeUp);
    network.start(3);
    assert_eq!(network.executor.run_until(120 * SECOND), Ended::TimeUp);
    let value = digest.borrow().value();
    (value, network)
}

#[test]
fn the_same_seed_is_the_same_run() {
    let (first, network) = eventful_run(7, 13);
    assert_eq!(network.joined(), 13);
    assert_eq!(eventful_run(7, 13).0, first);
    assert_ne!(eventful_run(8, 13).0, first);
    let again = std::thread::spawn(|| eventful_run(7, 13).0);
    assert_eq!(again.join().ok(), Some(first));
}

/// A node that is cut off in every write of its flash, over and over, still joins when it is left
/// alone, with the same address.
#[test]
fn power_cuts_within_writes_do_not_spoil_a_node() {
    let mut network = network(2, 0.0, 5);
    let mut task = network.tasks[1];
    let mut torn = 0;
    for cut in 0..40 {
        let (flash, clock) = (network.flashes[1].clone(), network.executor.clock());
        let spawner = network.executor.spawner();
        let killer = network.executor.spawn(async move {
            flash.next_operation().await;
            clock.sleep(20_000 + cut * 41_000).await;
            spawner.kill(task);
        });
        let end = network.executor.clock().time() + 5 * SECOND;
        assert_eq!(network.executor.run_until(end), Ended::TimeUp);
        network.executor.kill(killer);
        network.executor.kill(task);
        task = network.start(1);
        torn = network.flashes[1].wear().torn;
    }
    assert!(torn >= 5, "{torn}");
    let end = network.executor.clock().time() + 100 * SECOND;
    assert_eq!(network.executor.run_until(end), Ended::TimeUp);
    assert_eq!(network.joined(), 2);
}

/// Everything that was on the air is sent again later from elsewhere: no node takes a message twice.
#[test]
fn replayed_frames_deliver_nothing() {
    let mut network = network(3, 0.0, 11);
    let attacker = NodeId(2);
    network.executor.kill(network.tasks[2]);
    let recorded = Rc::new(RefCell::new(Vec::new()));
    let list = recorded.clone();
    network.medium.watch(move |_: Time, event: Event<'_>| {
        if let Event::Sent { from, frame, .. } = event
            && from != attacker
        {
            list.borrow_mut().push(frame.to_vec());
        }
    });
    assert_eq!(network.executor.run_until(60 * SECOND), Ended::TimeUp);
    let nodes: Vec<_> = network.windows[..2]
        .iter()
        .map(|window| window.borrow().clone().unwrap())
        .collect();
    let received = Rc::new(RefCell::new(Vec::new()));
    let (list, receiver, sender) = (received.clone(), nodes[0].clone(), nodes[1].clone());
    network.executor.spawn(async move {
        loop {
            let (_, number) = receiver.recv::<u32>().await;
            list.borrow_mut().push(number);
        }
    });
    network.executor.spawn(async move {
        for number in 0..5_u32 {
            let sent = sender.send(ShortAddress::COORDINATOR, &number).await;
            assert_eq!(sent, Ok(Delivery::Delivered));
        }
    });
    assert_eq!(network.executor.run_until(70 * SECOND), Ended::TimeUp);
    assert_eq!(*received.borrow(), [0, 1, 2, 3, 4]);
    let frames = recorded.borrow().clone();
    assert!(frames.len() > 10);
    let (medium, clock) = (network.medium.clone(), network.executor.clock());
    network.executor.spawn(async move {
        for mut psdu in frames {
            psdu.extend(fcs(&psdu).to_le_bytes());
            medium.inject(attacker, Channel::FIRST, &psdu);
            clock.sleep(20 * MILLISECOND).await;
        }
    });
    let before = network.medium.counters(NodeId(0)).received;
    assert_eq!(network.executor.run_until(100 * SECOND), Ended::TimeUp);
    assert!(network.medium.counters(NodeId(0)).received > before + 5);
    assert_eq!(*received.borrow(), [0, 1, 2, 3, 4]);
    assert_eq!(nodes.len(), 2);
}
