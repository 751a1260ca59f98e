//! Tasks of the images.

use core::{hint::black_box, time::Duration};

use embassy_futures::select::select;
use zigbee_link::{
    Instant,
    link::Link,
    network::{NetworkSettings, NetworkStatus, Node},
    radio::{FRAME_MAX, PSDU_MAX, Radio},
    runner::{Clock, Shared, run},
    security::{Counter, FrameSecurity, Key, Protection},
    store::{Record, Saved, Store},
    wire::{Eui64, PanId, ShortAddress},
};

use crate::stub::{FLASH_LEN, Flash, Timer, Transceiver};

/// Peers of a node.
const PEERS: usize = 16;
/// Messages in each queue.
const QUEUE: usize = 4;
/// Members of a coordinator.
const MEMBERS: usize = 16;

/// Message of a node.
type Message = (u8, [u8; 8]);

/// Nothing: the start of the processor, and the parts that every image has.
pub async fn empty() {}

fn protection() -> Protection {
    // A setting that is not known before the node reads its configuration.
    black_box(Protection::EncMic64)
}

async fn load(store: &mut Store<Flash>) -> Option<Saved> {
    if let Some(key) = Key::new(black_box(1), black_box([7; 16])) {
        store
            .provision(key, Eui64(black_box([2; 8])), 0)
            .await
            .ok()?;
    }
    store.load().await.ok()
}

/// Takes up, sends and receives messages once.
async fn exchange(link: &mut Link<PEERS, QUEUE>, radio: &mut Transceiver) -> Option<()> {
    let mut frame = [0; PSDU_MAX];
    let now = Timer.now();
    if let Some((from, message)) = link.recv::<Message>() {
        black_box(link.send(now, from, &message).ok());
    }
    black_box(link.result());
    {
        let buffer: &mut [u8; FRAME_MAX] = frame.first_chunk_mut()?;
        while let Some(len) = link.poll_transmit(now, buffer) {
            black_box(radio.transmit(buffer.get(..len)?).await.is_ok());
        }
    }
    let received = radio.receive(&mut frame).await.ok()?;
    black_box(link.handle(now, frame.get_mut(..received.len)?));
    black_box(link.deadline());
    Some(())
}

fn attached(key: Key, counter: Counter) -> Link<PEERS, QUEUE> {
    let extended = Eui64(black_box([2; 8]));
    let session = FrameSecurity::new(extended, protection(), key, counter);
    let mut link = Link::new(session, black_box(1));
    link.attach(PanId(black_box(0xBEEF)), ShortAddress(black_box(1)));
    link
}

/// Messages with peers whose addresses are known; no network, and no memory of the frame counter.
pub async fn link() {
    let Some(key) = Key::new(black_box(1), black_box([7; 16])) else {
        return;
    };
    let mut link = attached(key, Counter::resume(black_box(0)));
    let mut radio = Transceiver;
    loop {
        if let Some(limit) = link.session.counter.wanted() {
            link.session.counter.reserved(limit);
        }
        black_box(exchange(&mut link, &mut radio).await);
    }
}

/// The same, with the key and the frame counter in flash.
pub async fn store() {
    let Ok(mut store) = Store::new(Flash, 0..FLASH_LEN) else {
        return;
    };
    let Some(saved) = load(&mut store).await else {
        return;
    };
    let mut link = attached(saved.active_key, Counter::resume(saved.counter_limit));
    let mut radio = Transceiver;
    loop {
        if let Some(limit) = link.session.counter.wanted() {
            if store.save(Record::CounterLimit(limit)).await.is_err() {
                return;
            }
            link.session.counter.reserved(limit);
        }
        black_box(exchange(&mut link, &mut radio).await);
    }
}

fn settings() -> NetworkSettings {
    let mut settings = NetworkSettings::new(Eui64(black_box([2; 8])), black_box(1));
    settings.protection = protection();
    settings
}

/// Runs a node, and answers every message with itself.
async fn echo<const MEMBERS: usize>(
    shared: &Shared<Timer, PEERS, QUEUE, MEMBERS>,
    store: &mut Store<Flash>,
) {
    let mut radio = Transceiver;
    let application = async {
        loop {
            let (from, message): (_, Message) = shared.recv().await;
            let sent = shared.send(from, &message).await;
            shared.with(act);
            black_box(sent.ok());
        }
    };
    select(run(shared, &mut radio, store), application).await;
}

/// Calls the functions that an application may call.
fn act<const MEMBERS: usize>(node: &mut Node<PEERS, QUEUE, MEMBERS>, now: Instant) {
    if MEMBERS == 0 {
        node.leave(now);
        node.join();
    } else {
        let device = Eui64(black_box([3; 8]));
        node.open_join_window(now, Duration::from_secs(60));
        black_box(node.allow(device.number()).ok());
        black_box(node.remove(now, device));
        if let Some(key) = Key::new(black_box(2), black_box([9; 16])) {
            black_box(node.change_key(key).ok());
        }
        black_box(node.members().count());
    }
    black_box(matches!(node.status(), NetworkStatus::Joined(_)));
}

/// A device: scans, joins, rejoins, leaves.
pub async fn device() {
    let Ok(mut store) = Store::new(Flash, 0..FLASH_LEN) else {
        return;
    };
    if let Some(saved) = load(&mut store).await {
        let node = Node::<_, _, 0>::device(Timer.now(), settings(), &saved);
        echo(&Shared::new(node, Timer), &mut store).await;
    }
}

/// A node that can be either, as its configuration says.
pub async fn coordinator() {
    let Ok(mut store) = Store::new(Flash, 0..FLASH_LEN) else {
        return;
    };
    let Some(saved) = load(&mut store).await else {
        return;
    };
    let node = if black_box(true) {
        let mut members = [None; MEMBERS];
        for (place, member) in (0..).zip(&mut members) {
            *member = store.member(place).await.unwrap_or_default();
        }
        Node::coordinator(settings(), &saved, members)
    } else {
        Node::device(Timer.now(), settings(), &saved)
    };
    echo(&Shared::new(node, Timer), &mut store).await;
}
