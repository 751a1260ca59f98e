//! Power cuts of whole nodes: store, frame counter, network and runner together.
//!
//! `ZIGBEE_LINK_CUTS=1000000 cargo test --release --test power` for as many as that.

use crate::support;

use std::{
    cell::{Cell, RefCell},
    collections::HashSet,
    env,
    rc::Rc,
    time::Duration,
};

use embassy_futures::select::select;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use support::{
    aether::eui,
    flash::Flash,
    node::{LEN, air, provisioned, radio, settings},
};
use virtual_hardware::{
    executor::{Clock, Ended, Executor, Sleep, TaskId},
    medium::{Event, Medium, NodeId},
};
use zigbee_link::{
    network::{NetworkStatus, Node},
    runner::{Shared, run},
    store::{Member, Membership, Store},
    wire::{Frame, ShortAddress},
};

const NODES: usize = 3;

fn cuts() -> u32 {
    env::var("ZIGBEE_LINK_CUTS").map_or(10_000, |count| count.parse().unwrap())
}

/// Sender, key and frame counter of every secured frame ever sent.
type Nonces = Rc<RefCell<HashSet<(u32, u8, u32)>>>;

/// Everything outside the nodes.
struct World {
    clock: Clock,
    medium: Medium,
    random: RefCell<ChaCha8Rng>,
    /// No node leaves.
    is_calm: Cell<bool>,
    /// Membership that each node surely has in its store.
    memberships: RefCell<[Option<Membership>; NODES]>,
}

impl World {
    fn new(clock: Clock, nonces: Nonces) -> Self {
        let medium = air(&clock, 0.1);
        medium.watch(move |_, event: Event<'_>| {
            if let Event::Sent { from, frame, .. } = event
                && let Some(security) = Frame::parse(frame).unwrap().header().security
            {
                let nonce = (from.0, security.key_index, security.counter);
                let is_new = nonces.borrow_mut().insert(nonce);
                assert!(is_new, "{nonce:?} used twice");
            }
        });
        Self {
            clock,
            medium,
            random: RefCell::new(ChaCha8Rng::seed_from_u64(0x0FF)),
            is_calm: Cell::new(true),
            memberships: RefCell::default(),
        }
    }

    fn sleep(&self, duration: Duration) -> Sleep {
        self.clock.sleep(duration.as_nanos() as u64)
    }

    fn below(&self, bound: u32) -> u32 {
        self.random.borrow_mut().random_range(0..bound)
    }
}

/// Life of a node from power on until the flash fails.
async fn life(flash: Flash, world: Rc<World>, number: usize) {
    let mut store = Store::new(flash.clone(), 0..LEN).unwrap();
    let Ok(saved) = store.load().await else {
        // Only a loss of power does that.
        assert!(!flash.has_power());
        return;
    };
    let known = world.memberships.borrow()[number];
    assert!(known.is_none() || saved.network == known, "{saved:?}");
    let node = if number == 0 {
        let mut members = [None; NODES];
        for (place, member) in (0..).zip(&mut members) {
            let Ok(read) = store.member(place).await else {
                return;
            };
            *member = read;
        }
        for (device, membership) in world.memberships.borrow().iter().enumerate().skip(1) {
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
            node.allow(eui(device).number()).unwrap();
        }
        node
    } else {
        let now = zigbee_link::runner::Clock::now(&world.clock);
        Node::device(now, settings(number), &saved)
    };
    let seed = world.random.borrow_mut().random();
    let antenna = NodeId(number as u32);
    let mut radio = radio(&world.medium, antenna, &world.clock, seed);
    let shared = Shared::new(node, world.clock.clone());
    let application = talk(&shared, &world, number);
    select(run(&shared, &mut radio, &mut store), application).await;
}

/// Sends to everybody, and now and then leaves and joins again.
async fn talk(shared: &Shared<Clock, 4, 4, NODES>, world: &World, number: usize) {
    let mut joined_since = None;
    loop {
        let pause = Duration::from_micros(world.below(100_000).into());
        world.sleep(pause).await;
        let to = ShortAddress(world.below(NODES as u32) as u16);
        let leaves = number != 0 && !world.is_calm.get() && world.below(100) == 0;
        let mut memberships = world.memberships.borrow_mut();
        let membership = &mut memberships[number];
        let done = shared.with(|node, now| {
            while node.link.result().is_some() || node.link.recv_bytes().is_some() {}
            let _ = node.link.send(now, to, &[0x5A_u8; 20]);
            match node.status() {
                NetworkStatus::Joined(joined) => {
                    // Written down by then.
                    let since = *joined_since.get_or_insert(now);
                    if now.since(since) > Duration::from_millis(50) {
                        *membership = Some(joined);
                    }
                }
                _ => joined_since = None,
            }
            if leaves {
                *membership = None;
                joined_since = None;
                node.leave(now);
                node.join();
            }
        });
        assert_eq!(done, Some(()));
    }
}

struct Nodes {
    executor: Executor,
    world: Rc<World>,
    nonces: Nonces,
    flashes: [Flash; NODES],
    lives: [Option<TaskId>; NODES],
}

impl Nodes {
    fn new() -> Self {
        let executor = Executor::new();
        let nonces = Nonces::default();
        let world = Rc::new(World::new(executor.clock(), nonces.clone()));
        let mut nodes = Self {
            executor,
            world,
            nonces,
            flashes: core::array::from_fn(|_| provisioned().into_flash()),
            lives: [None; NODES],
        };
        for node in 0..NODES {
            nodes.world.medium.attach([0.0; 2]);
            nodes.start(node, None);
        }
        nodes
    }

    /// Off, if it was not, and on again: for so many more changes of the flash.
    fn start(&mut self, node: usize, budget: Option<u32>) {
        // State that is not in flash is lost, and so is a write not yet finished.
        if let Some(life) = self.lives[node].take() {
            self.executor.kill(life);
        }
        let flash = &self.flashes[node];
        flash.power(budget);
        let life = life(flash.clone(), self.world.clone(), node);
        self.lives[node] = Some(self.executor.spawn(life));
    }

    /// Runs all until then, or until this one has no more power. Returns true if it has.
    fn run(&mut self, duration: Duration, victim: Option<usize>) -> bool {
        let spawner = self.executor.spawner();
        let lives = self.lives;
        let ended = || {
            lives
                .iter()
                .position(|life| !life.is_some_and(|life| spawner.is_alive(life)))
        };
        let end = self.world.clock.time() + duration.as_nanos() as u64;
        match self.executor.run_until_time_or(end, || ended().is_some()) {
            Ended::TimeUp => true,
            Ended::ConditionMet => {
                assert_eq!(ended(), victim, "only a loss of power ends a life");
                false
            }
            Ended::Stuck(_) => panic!("they keep each other busy, and time stands"),
        }
    }

    fn all_joined(&self) -> bool {
        self.world.memberships.borrow().iter().all(Option::is_some)
    }
}

/// A node at a time loses its power at any moment, most of them in the middle of a change of its flash. No nonce
/// occurs twice, and no node forgets its network.
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
        nodes.nonces.borrow().len()
    );
    assert!(in_flash > cuts() / 4, "{in_flash}");
    for flash in &nodes.flashes {
        let erasures = flash.wear().erasures;
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
