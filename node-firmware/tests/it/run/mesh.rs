//! Whole roles over a network of another kind: many hops, which lose, delay and double messages, and of which
//! only the promises of [`Network`] are known.

use std::{
    cell::{Cell, RefCell},
    collections::{BTreeMap, VecDeque},
    rc::Rc,
    time::Duration,
};

use embassy_futures::select::select;
use embassy_sync::{blocking_mutex::raw::NoopRawMutex, signal::Signal};
use node_firmware::{
    config::{CoordinatorConfig, RoleConfig, SiteKey},
    console::{FromPc, KeyChangeReport, NetworkInfo, ToPc},
    facts::FactStore,
    liveness::Liveness,
    message::{CameraCommand, CommandOutcome, CommandResult, Duty, Message, Restart, Sight},
    network::{
        Administration, Attachment, Network, NetworkEvent, NetworkIdentity, PostError, Receipt,
    },
    run::run_over,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use virtual_hardware::{
    executor::{Clock, Time},
    line::Side,
};
use zigbee_link::wire::ShortAddress;

use crate::run::{
    bench::{Bench, Board, END, LINK, Pc, SECOND},
    support::site::{camera_config, target_config},
};

const INFO: NetworkInfo = NetworkInfo {
    pan: 1,
    channel: 11,
};
/// Time of each hop.
const HOP: Time = SECOND / 20;
/// Messages on their way from one node.
const ROOM: usize = 4;
/// A message to one member is tried so often.
const ATTEMPTS: u32 = 6;

type Event = NetworkEvent<u32>;

/// Nodes in a row, each in reach of its neighbours.
struct Mesh {
    clock: Clock,
    /// Share of messages that one hop loses.
    loss: f64,
    rng: RefCell<ChaCha8Rng>,
    /// Events with their nodes and times.
    coming: RefCell<BTreeMap<(Time, u64), (u16, Event)>>,
    planned: Cell<u64>,
    changed: Signal<NoopRawMutex, ()>,
    nodes: Vec<Inbox>,
}

#[derive(Default)]
struct Inbox {
    events: RefCell<VecDeque<Event>>,
    told: Signal<NoopRawMutex, ()>,
    on_the_way: Cell<usize>,
    removed: Cell<bool>,
}

impl Mesh {
    fn new(clock: &Clock, nodes: usize, loss: f64, seed: u64) -> Rc<Self> {
        Rc::new(Self {
            clock: clock.clone(),
            loss,
            rng: RefCell::new(ChaCha8Rng::seed_from_u64(seed)),
            coming: RefCell::default(),
            planned: Cell::new(0),
            changed: Signal::new(),
            nodes: (0..nodes).map(|_| Inbox::default()).collect(),
        })
    }

    /// The node attaches after a while.
    fn join(self: &Rc<Self>, own: u16) -> Node {
        let network = NetworkIdentity {
            number: 1,
            founder: *b"row mesh",
        };
        let attachment = Attachment { network, own };
        let after = SECOND * Time::from(own + 1);
        self.plan(after, own, NetworkEvent::Attached(Some(attachment)));
        Node {
            mesh: self.clone(),
            own,
            next: Cell::new(0),
        }
    }

    fn plan(&self, after: Time, to: u16, event: Event) {
        let number = self.planned.get();
        self.planned.set(number + 1);
        let at = self.clock.time() + after;
        self.coming.borrow_mut().insert((at, number), (to, event));
        self.changed.signal(());
    }

    /// Time of a message on its way over so many hops, if it arrives.
    fn way(&self, hops: u16) -> Option<Time> {
        let mut rng = self.rng.borrow_mut();
        let mut time = 0;
        for _ in 0..hops {
            if rng.random_bool(self.loss) {
                return None;
            }
            time += rng.random_range(HOP / 2..HOP * 2);
        }
        Some(time)
    }

    async fn run(self: Rc<Self>) {
        loop {
            let next = self.coming.borrow().keys().next().map(|(at, _)| *at);
            match next {
                Some(at) if at <= self.clock.time() => {
                    let (_, (to, event)) = self.coming.borrow_mut().pop_first().unwrap();
                    let node = &self.nodes[usize::from(to)];
                    if matches!(event, NetworkEvent::Settled { .. }) {
                        node.on_the_way.set(node.on_the_way.get() - 1);
                    }
                    node.events.borrow_mut().push_back(event);
                    node.told.signal(());
                }
                Some(at) => {
                    select(self.clock.sleep_until_time(at), self.changed.wait()).await;
                }
                None => self.changed.wait().await,
            }
        }
    }
}

/// One member of it.
struct Node {
    mesh: Rc<Mesh>,
    own: u16,
    next: Cell<u32>,
}

impl Network for Node {
    type Ticket = u32;

    fn post(&self, to: ShortAddress, message: &Message, _: Receipt) -> Result<u32, PostError> {
        let mesh = &*self.mesh;
        let room = &mesh.nodes[usize::from(self.own)].on_the_way;
        if room.get() == ROOM {
            return Err(PostError::Full);
        }
        let is_for_all = to == ShortAddress::BROADCAST;
        if !is_for_all && usize::from(to.0) >= mesh.nodes.len() || to.0 == self.own {
            return Err(PostError::Refused);
        }
        room.set(room.get() + 1);
        let ticket = self.next.replace(self.next.get() + 1);
        let event = NetworkEvent::Message(ShortAddress(self.own), message.clone());
        let hops = |to: u16| to.abs_diff(self.own);
        if is_for_all {
            for to in (0..mesh.nodes.len() as u16).filter(|to| *to != self.own) {
                // A flood comes by several ways.
                for after in [mesh.way(hops(to)), mesh.way(hops(to))]
                    .into_iter()
                    .flatten()
                {
                    mesh.plan(after, to, event.clone());
                }
            }
            let delivered = true;
            mesh.plan(HOP, self.own, NetworkEvent::Settled { ticket, delivered });
            return Ok(ticket);
        }
        let mut time = 0;
        let mut delivered = false;
        for _ in 0..ATTEMPTS {
            if let Some(way) = mesh.way(hops(to.0)) {
                mesh.plan(time + way, to.0, event.clone());
                if let Some(back) = mesh.way(hops(to.0)) {
                    time += way + back;
                    delivered = true;
                    break;
                }
            }
            time += SECOND;
        }
        mesh.plan(time, self.own, NetworkEvent::Settled { ticket, delivered });
        Ok(ticket)
    }

    async fn happened(&self, _: Option<Attachment>) -> Event {
        let node = &self.mesh.nodes[usize::from(self.own)];
        loop {
            if let Some(event) = node.events.borrow_mut().pop_front() {
                return event;
            }
            node.told.wait().await;
        }
    }
}

impl Administration for Node {
    fn info(&self) -> Option<NetworkInfo> {
        Some(INFO)
    }

    fn open_join_window(&self, _: Duration) {}

    fn remove(&self, member: ShortAddress) -> bool {
        let node = self.mesh.nodes.get(usize::from(member.0));
        node.is_some_and(|node| !node.removed.replace(true))
    }

    fn change_identifier(&self) -> bool {
        false
    }

    fn conflict_s(&self) -> Option<u32> {
        None
    }

    fn change_key(&self, _: SiteKey) -> bool {
        false
    }

    fn key_change(&self) -> Option<KeyChangeReport> {
        None
    }
}

/// A coordinator, two nodes that only pass messages on, a camera, and a target.
struct Site {
    bench: Bench,
    pc: Pc,
    camera: Rc<Board>,
    target: Rc<Board>,
}

impl Site {
    fn new(loss: f64, seed: u64) -> Self {
        let mut bench = Bench::new();
        let coordinator = RoleConfig::Coordinator(CoordinatorConfig::default());
        let coordinator = Rc::new(Board::new(&mut bench, coordinator));
        let camera = RoleConfig::Camera(camera_config(Some(Duty::First)));
        let camera = Rc::new(Board::new(&mut bench, camera));
        let target = RoleConfig::Target(target_config(0));
        let target = Rc::new(Board::new(&mut bench, target));
        let pc = Pc::new(coordinator.line.open(Side::Far));
        let mesh = Mesh::new(&bench.clock, 5, loss, seed);
        bench.executor.spawn(mesh.clone().run());
        for (own, board) in [(0, &coordinator), (CAMERA, &camera), (4, &target)] {
            let network = mesh.join(own);
            let (board, clock) = (board.clone(), bench.clock.clone());
            let memory = FactStore::open(board.flash.clone(), LINK..END, board.config.owner());
            let config = board.config.clone().check().unwrap();
            bench.executor.spawn(async move {
                let liveness = Liveness::new(Restart::Ordinary);
                let devices = board.devices(&clock, &liveness, seed);
                let mut facts = memory.await.unwrap();
                match run_over(&config, devices, &mut facts, &network).await {}
            });
        }
        Self {
            bench,
            pc,
            camera,
            target,
        }
    }
}

const CAMERA: u16 = 3;

#[test]
fn nodes_work_over_many_hops_that_lose_messages() {
    for seed in 0..10 {
        let mut site = Site::new(0.1, seed);
        site.camera.sees(Some(40));
        site.bench.run_for(60 * SECOND);

        // They present themselves, and look.
        let told = site.pc.told();
        let hellos = told.iter().filter_map(|told| match told {
            ToPc::Member { address, hello } => Some((*address, hello.id)),
            _ => None,
        });
        let members: BTreeMap<u16, u16> = hellos.collect();
        let expected = [&site.camera, &site.target].map(|board| board.config.id);
        assert!(
            members.values().copied().eq(expected),
            "{seed}: {members:?}"
        );
        let lamps = site.target.lamps();
        assert!(
            lamps.joined && lamps.may_walk && lamps.target_seen,
            "{seed}"
        );
        assert_eq!(site.camera.looks().last(), Some(&Sight::InView));

        // The PC's commands reach the camera, and its answers come back.
        let command = CameraCommand::LearnBackground;
        site.pc.wish(FromPc::Command {
            address: CAMERA,
            command,
        });
        site.bench.run_for(20 * SECOND);
        let done = |success| ToPc::Done {
            address: CAMERA,
            done: CommandResult {
                command,
                outcome: CommandOutcome::of(success),
            },
        };
        let told = site.pc.told();
        // It may be done although its arrival is not known.
        assert!(
            told.contains(&done(true)) || told.contains(&done(false)),
            "{seed}: {told:?}"
        );

        // Requests to the network go to this one.
        site.pc.wish(FromPc::Remove(CAMERA));
        site.pc.wish(FromPc::ChangeKey(SiteKey::new(2, [7; 16])));
        site.pc.wish(FromPc::Refresh);
        site.bench.run_for(5 * SECOND);
        let told = site.pc.told();
        assert!(told.contains(&ToPc::Removed {
            address: CAMERA,
            success: true
        }));
        assert!(told.contains(&ToPc::KeyChange(None)));
        assert!(told.contains(&ToPc::Network(Some(INFO))));
    }
}
