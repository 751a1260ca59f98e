//! Power cuts of whole nodes: store, frame counter, network and runner together.
//!
//! `ZIGBEE_LINK_CUTS=1000000 cargo test --release --test power` for as many as that.

mod support;

use std::{
    cell::{Cell, RefCell},
    collections::{HashSet, VecDeque},
    convert::Infallible,
    env,
    future::poll_fn,
    pin::Pin,
    rc::Rc,
    task::{Context, Poll, Waker},
    time::Duration,
};

use embassy_embedded_hal::flash::partition::Partition;
use embassy_futures::select::select;
use embassy_sync::{blocking_mutex::raw::NoopRawMutex, mutex::Mutex};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use support::{
    aether::eui,
    flash::MockFlash,
    node::{provisioned, settings},
};
use zigbee_link::{
    Instant,
    network::{Node, Status},
    radio::{Capabilities, Channel, Config, PSDU_MAX, Radio, Received, TxOutcome},
    runner::{Clock, Shared, run},
    store::{Member, Membership, Store},
    wire::{Frame, KeyId, ShortAddress},
};

const NODES: usize = 3;
type Flash = MockFlash<4>;
type Chip = Mutex<NoopRawMutex, Flash>;

fn cuts() -> u32 {
    env::var("ZIGBEE_LINK_CUTS").map_or(10_000, |count| count.parse().unwrap())
}

/// Everything outside the nodes.
struct World {
    now: Cell<u64>,
    /// When the next sleeper wakes.
    next: Cell<u64>,
    random: RefCell<ChaCha8Rng>,
    /// Nobody leaves.
    is_calm: Cell<bool>,
    queues: RefCell<[VecDeque<Vec<u8>>; NODES]>,
    /// Sender, key and frame counter of every secured frame ever sent.
    nonces: RefCell<HashSet<(usize, u8, u32)>>,
    /// What each node surely has in its store.
    memberships: RefCell<[Option<Membership>; NODES]>,
}

#[derive(Clone)]
struct Handle {
    world: Rc<World>,
    node: usize,
    channel: Option<Channel>,
}

impl Handle {
    fn sleep(&self, duration: Duration) -> impl Future<Output = ()> {
        self.sleep_until(self.now() + duration)
    }

    fn below(&self, bound: u32) -> u32 {
        self.world.random.borrow_mut().random_range(0..bound)
    }

    fn membership(&self) -> Option<Membership> {
        self.world.memberships.borrow()[self.node]
    }

    fn set_membership(&self, membership: Option<Membership>) {
        self.world.memberships.borrow_mut()[self.node] = membership;
    }
}

impl Clock for Handle {
    fn now(&self) -> Instant {
        Instant(self.world.now.get())
    }

    fn sleep_until(&self, time: Instant) -> impl Future<Output = ()> {
        poll_fn(move |_| {
            if self.now() >= time {
                return Poll::Ready(());
            }
            let next = &self.world.next;
            next.set(next.get().min(time.0));
            Poll::Pending
        })
    }
}

impl Radio for Handle {
    type Error = Infallible;

    fn capabilities(&self) -> Capabilities {
        Capabilities {
            fcs: true,
            csma: true,
            rx_queue: true,
            ..Capabilities::default()
        }
    }

    async fn configure(&mut self, config: &Config) -> Result<(), Infallible> {
        self.channel = Some(config.channel);
        Ok(())
    }

    async fn transmit(&mut self, frame: &[u8]) -> Result<TxOutcome, Infallible> {
        if let Some(security) = Frame::parse(frame).unwrap().header().security {
            let KeyId::Index(key) = security.key else {
                panic!("no such key")
            };
            let nonce = (self.node, key, security.counter.unwrap());
            let is_new = self.world.nonces.borrow_mut().insert(nonce);
            assert!(is_new, "{nonce:?} used twice");
        }
        for (to, queue) in self.world.queues.borrow_mut().iter_mut().enumerate() {
            if to != self.node && self.below(10) > 0 {
                queue.push_back(frame.to_vec());
            }
        }
        self.sleep(Duration::from_micros(32 * (frame.len() as u64 + 8)))
            .await;
        Ok(TxOutcome::Sent)
    }

    async fn receive(&mut self, buffer: &mut [u8; PSDU_MAX]) -> Result<Received, Infallible> {
        poll_fn(|_| {
            let Some(frame) = self.world.queues.borrow_mut()[self.node].pop_front() else {
                return Poll::Pending;
            };
            buffer[..frame.len()].copy_from_slice(&frame);
            Poll::Ready(Ok(Received {
                len: frame.len(),
                channel: Channel::FIRST,
                rssi: None,
                lqi: None,
            }))
        })
        .await
    }
}

/// From power on until the flash fails.
async fn life(chip: &Chip, mut handle: Handle) {
    let flash = Partition::new(chip, 0, Flash::LEN);
    let mut store = Store::new(flash, 0..Flash::LEN).unwrap();
    let Ok(saved) = store.load().await else {
        // Only a loss of power does that.
        assert!(!chip.try_lock().unwrap().has_power());
        return;
    };
    let known = handle.membership();
    assert!(known.is_none() || saved.network == known, "{saved:?}");
    let node = if handle.node == 0 {
        let mut members = [None; NODES];
        for (place, member) in (0..).zip(&mut members) {
            let Ok(read) = store.member(place).await else {
                return;
            };
            *member = read;
        }
        for (device, membership) in handle.world.memberships.borrow().iter().enumerate().skip(1) {
            let member = membership.map(|membership| Member {
                extended: eui(device),
                short: membership.short,
            });
            assert!(
                member.is_none() || members.contains(&member),
                "{device} is forgotten: {members:?}"
            );
        }
        let mut node = Node::<4, 4, NODES>::coordinator(settings(0), &saved, members);
        for device in 1..NODES {
            node.allow(eui(device)).unwrap();
        }
        node
    } else {
        Node::device(handle.now(), settings(handle.node), &saved)
    };
    let shared = Shared::new(node, handle.clone());
    let application = talk(&shared, handle.clone());
    select(run(&shared, &mut handle, &mut store), application).await;
}

/// Sends to everybody, and now and then leaves and joins again.
async fn talk(shared: &Shared<Handle, 4, 4, NODES>, handle: Handle) {
    let mut joined_since = None;
    loop {
        handle
            .sleep(Duration::from_micros(u64::from(handle.below(20_000))))
            .await;
        shared.with(|node, now| {
            while node.link.result().is_some() || node.link.recv_bytes().is_some() {}
            let to = ShortAddress(handle.below(NODES as u32) as u16);
            let _ = node.link.send(now, to, &[0x5A_u8; 20]);
            match node.status() {
                Status::Joined(membership) => {
                    // Written down by then.
                    let since = *joined_since.get_or_insert(now);
                    if now.since(since) > Duration::from_millis(50) {
                        handle.set_membership(Some(membership));
                    }
                }
                _ => joined_since = None,
            }
            if handle.node != 0 && !handle.world.is_calm.get() && handle.below(500) == 0 {
                handle.set_membership(None);
                joined_since = None;
                node.leave(now);
                node.join();
            }
        });
    }
}

struct Nodes {
    world: Rc<World>,
    chips: [&'static Chip; NODES],
    lives: [Pin<Box<dyn Future<Output = ()>>>; NODES],
}

impl Nodes {
    fn new() -> Self {
        let world = Rc::new(World {
            now: Cell::new(0),
            next: Cell::new(0),
            random: RefCell::new(ChaCha8Rng::seed_from_u64(0x0FF)),
            is_calm: Cell::new(true),
            queues: RefCell::default(),
            nonces: RefCell::default(),
            memberships: RefCell::default(),
        });
        let chips = core::array::from_fn(|_| {
            let chip = Mutex::new(provisioned().into_flash());
            &*Box::leak(Box::new(chip))
        });
        let lives = core::array::from_fn(|_| Box::pin(async {}) as Pin<Box<_>>);
        let mut nodes = Self {
            world,
            chips,
            lives,
        };
        for node in 0..NODES {
            nodes.start(node, None);
        }
        nodes
    }

    /// Off, if it was not, and on again: for so many more changes of the flash.
    fn start(&mut self, node: usize, budget: Option<u32>) {
        // What is not in flash is lost, and so is a write not yet finished.
        self.lives[node] = Box::pin(async {});
        self.world.queues.borrow_mut()[node].clear();
        let chip = self.chips[node];
        chip.try_lock().unwrap().power(budget);
        let handle = Handle {
            world: self.world.clone(),
            node,
            channel: None,
        };
        self.lives[node] = Box::pin(life(chip, handle));
    }

    /// Runs all until then, or until this one has no more power. Whether it has.
    fn run(&mut self, duration: Duration, victim: Option<usize>) -> bool {
        let end = self.world.now.get() + duration.as_micros() as u64;
        let mut context = Context::from_waker(Waker::noop());
        while self.world.now.get() < end {
            self.world.next.set(end);
            for (node, life) in self.lives.iter_mut().enumerate() {
                if life.as_mut().poll(&mut context).is_ready() {
                    assert_eq!(Some(node), victim, "only a loss of power ends a life");
                    return false;
                }
            }
            let waiting = self.world.queues.borrow();
            let step = if waiting.iter().all(VecDeque::is_empty) {
                self.world.next.get()
            } else {
                self.world.now.get() + 100
            };
            self.world.now.set(step);
        }
        true
    }

    fn all_joined(&self) -> bool {
        self.world.memberships.borrow().iter().all(Option::is_some)
    }
}

/// A node at a time loses its power at any moment, most of them in the middle of a change of its
/// flash. No nonce occurs twice, and nobody forgets whom it belongs to.
#[test]
fn nonces_and_memberships_survive_power_cuts() {
    let mut nodes = Nodes::new();
    nodes.run(Duration::from_secs(60), None);
    assert!(nodes.all_joined());
    nodes.world.is_calm.set(false);
    let mut random = ChaCha8Rng::seed_from_u64(0xC07);
    let mut in_flash = 0;
    for _ in 0..cuts() {
        let victim = random.random_range(0..NODES);
        let exponent = random.random_range(0..8);
        let budget = 1 + random.random_range(0..1 << exponent);
        nodes.start(victim, Some(budget));
        let exponent = random.random_range(10..23);
        let moment = Duration::from_micros(random.random_range(1..1 << exponent));
        in_flash += u32::from(!nodes.run(moment, Some(victim)));
        nodes.start(victim, None);
        let pause = Duration::from_micros(random.random_range(1..200_000));
        nodes.run(pause, None);
    }
    println!(
        "{} cuts, {in_flash} of them in the middle of a change, {} frames",
        cuts(),
        nodes.world.nonces.borrow().len()
    );
    assert!(in_flash > cuts() / 4, "{in_flash}");
    for chip in nodes.chips {
        let erasures = chip.try_lock().unwrap().erasures;
        assert!(erasures.iter().all(|&erasures| erasures > 5));
    }
    // And all are well.
    nodes.world.is_calm.set(true);
    for node in 0..NODES {
        nodes.start(node, None);
        nodes.world.memberships.borrow_mut()[node] = None;
    }
    nodes.run(Duration::from_secs(120), None);
    assert!(nodes.all_joined());
}
