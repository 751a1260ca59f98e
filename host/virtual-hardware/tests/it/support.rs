//! Items that these tests share.

use std::{cell::RefCell, rc::Rc};

use embassy_futures::block_on;
use virtual_hardware::{
    executor::{Clock, Executor, TaskId, Time},
    flash::{Flash, PAGE},
    medium::{Medium, NRF52840, NodeId},
    random::Root,
};
use zigbee_link::{
    network::{Channels, NetworkSettings, NetworkStatus, Node},
    radio::{Channel, Csma},
    runner::{Shared, run},
    security::{Key, Protection},
    store::Store,
    wire::Eui64,
};

pub(crate) const MICROSECOND: Time = 1_000;
pub(crate) const MILLISECOND: Time = 1_000_000;
pub(crate) const SECOND: Time = 1_000_000_000;

pub(crate) type SharedNode = Shared<Clock, 33, 8, 32>;

pub(crate) fn eui(number: u32) -> Eui64 {
    Eui64((0x0200_0000_0000_0000 | u64::from(number)).to_be_bytes())
}

fn site_key() -> Key {
    Key::new(1, core::array::from_fn(|i| 0xC1 + i as u8)).unwrap()
}

/// The flash of a node that has the site key and nothing else.
pub(crate) fn provisioned(clock: &Clock, root: Root, number: u32) -> Flash {
    let flash = Flash::new(clock, 2, root.stream("flash", number.into()));
    let mut store = Store::new(flash.programmer(), 0..2 * PAGE as u32).unwrap();
    block_on(store.provision(site_key(), eui(number), 0)).unwrap();
    flash
}

/// A handle to the node that a task runs, while it runs.
pub(crate) type Window = Rc<RefCell<Option<Rc<SharedNode>>>>;

/// Runs a `zigbee-link` node over the machinery, from its flash to the air. Number 0 is the
/// coordinator and admits `members`.
pub(crate) async fn firmware(
    clock: Clock,
    medium: Medium,
    id: NodeId,
    flash: Flash,
    root: Root,
    members: u32,
    window: Window,
) {
    let mut store = Store::new(flash, 0..2 * PAGE as u32).unwrap();
    let saved = store.load().await.unwrap();
    let mut table = [None; 32];
    for (place, member) in (0..).zip(&mut table) {
        *member = store.member(place).await.unwrap();
    }
    let mut settings =
        NetworkSettings::new(eui(id.0), root.seed("link", id.0.into()) ^ clock.time());
    settings.channels = Channels::only(Channel::FIRST);
    settings.protection = Protection::EncMic32;
    let node = if id.0 == 0 {
        let mut node = Node::coordinator(settings, &saved, table);
        for member in 1..=members {
            node.allow(eui(member).number()).unwrap();
        }
        node
    } else {
        Node::device(zigbee_link::runner::Clock::now(&clock), settings, &saved)
    };
    let shared = Rc::new(SharedNode::new(node, clock.clone()));
    *window.borrow_mut() = Some(shared.clone());
    let radio = medium.radio(id, NRF52840);
    let mut radio = Csma::new(radio, clock, root.seed("csma", id.0.into()));
    let stopped = run(&shared, &mut radio, &mut store).await;
    panic!("node {} stopped: {stopped:?}", id.0);
}

pub(crate) fn is_joined(window: &Window) -> bool {
    let node = window.borrow();
    node.as_ref().is_some_and(|node| {
        matches!(
            node.with(|node, _| node.status()),
            Some(NetworkStatus::Joined(_))
        )
    })
}

/// Nodes in a network, each with its flash and its task.
pub(crate) struct Network {
    pub(crate) executor: Executor,
    pub(crate) medium: Medium,
    pub(crate) root: Root,
    pub(crate) flashes: Vec<Flash>,
    pub(crate) windows: Vec<Window>,
    pub(crate) tasks: Vec<TaskId>,
}

impl Network {
    pub(crate) fn new(
        executor: Executor,
        medium: Medium,
        root: Root,
        places: impl IntoIterator<Item = [f64; 2]>,
    ) -> Self {
        let mut network = Self {
            executor,
            medium,
            root,
            flashes: Vec::new(),
            windows: Vec::new(),
            tasks: Vec::new(),
        };
        for place in places {
            let id = network.medium.attach(place);
            let clock = network.executor.clock();
            network.flashes.push(provisioned(&clock, root, id.0));
            network.windows.push(Window::default());
        }
        for id in 0..network.flashes.len() {
            let task = network.start(id);
            network.tasks.push(task);
        }
        network
    }

    /// Switches a node on.
    pub(crate) fn start(&mut self, id: usize) -> TaskId {
        self.windows[id] = Window::default();
        let firmware = firmware(
            self.executor.clock(),
            self.medium.clone(),
            NodeId(id as u32),
            self.flashes[id].clone(),
            self.root,
            self.flashes.len() as u32 - 1,
            self.windows[id].clone(),
        );
        self.executor.spawn(firmware)
    }

    pub(crate) fn joined(&self) -> usize {
        self.windows
            .iter()
            .filter(|window| is_joined(window))
            .count()
    }
}
