//! A site of three nodes on the public test bench, whose cameras see as a test says, and a watch for nonces.

use std::{
    cell::{Cell, RefCell},
    collections::{BTreeMap, HashSet},
    ops::{Deref, DerefMut},
    rc::Rc,
};

use crate::run::former_networks::link;
use crate::run::support::{
    flash::Flash,
    site::{camera_config, target_config},
};
use node_firmware::{
    config::{Config, CoordinatorConfig, RoleConfig},
    console::{FromPc, ToPc},
    message::{CameraCommand, Duty, MemberKind},
};
use node_test::Script;
pub(super) use node_test::{FACTS as END, LINK, Pc, SECOND};
use virtual_hardware::{
    executor::Time,
    medium::{Event, NodeId},
};
use zigbee_link::wire::{Eui64, Frame};

/// Extended address of the sender, index of the key, and frame counter of every frame: no nonce occurs
/// twice.
type Nonces = Rc<RefCell<HashSet<(Eui64, u8, u32)>>>;

/// The flash of each sender, and the extended address in it, once it was looked up since the start.
type Senders = Rc<RefCell<BTreeMap<NodeId, (Flash, Option<Eui64>)>>>;

/// Surroundings of the nodes under test, in which no nonce occurs twice.
pub(super) struct Bench {
    bench: node_test::Bench,
    senders: Senders,
}

impl Deref for Bench {
    type Target = node_test::Bench;

    fn deref(&self) -> &node_test::Bench {
        &self.bench
    }
}

impl DerefMut for Bench {
    fn deref_mut(&mut self) -> &mut node_test::Bench {
        &mut self.bench
    }
}

impl Bench {
    pub(super) fn new() -> Self {
        let bench = node_test::Bench::new(1);
        let all = Nonces::default();
        let senders = Senders::default();
        let known = senders.clone();
        bench.medium.watch(move |_, event: Event<'_>| {
            if let Event::Sent { from, frame, .. } = event
                && let header = *Frame::parse(frame).unwrap().header()
                && let Some(security) = header.security
            {
                let mut known = known.borrow_mut();
                let (flash, own) = known.get_mut(&from).unwrap();
                let own = *own.get_or_insert_with(|| extended(flash));
                let nonce = (own, security.key_index, security.counter);
                assert!(all.borrow_mut().insert(nonce), "{nonce:?} twice");
            }
        });
        Self { bench, senders }
    }
}

/// The extended address that a node keeps in its flash.
pub(super) fn extended(flash: &Flash) -> Eui64 {
    link(flash).0.extended.unwrap()
}

/// A CMUcam2 that follows its commands and sees as the test says: column, or nothing.
#[derive(Default)]
struct Camera {
    sees: Cell<Option<u8>>,
    /// It adapted to another light, and sees nothing before it does so again.
    dazzled: Cell<bool>,
    heard: RefCell<Vec<String>>,
}

impl Camera {
    /// The manual's answers, by the letters of the command, and their times.
    fn obey(&self, command: &str) -> (Time, String) {
        const MILLISECOND: Time = SECOND / 1000;
        self.heard.borrow_mut().push(command.to_owned());
        match command.get(..2) {
            Some("GV") => (MILLISECOND, "ACK\rCMUcam2 v1.01 c6\r:".to_owned()),
            Some("RS") => {
                self.dazzled.set(false);
                (700 * MILLISECOND, "ACK\r\rCMUcam2 v1.01 c6\r:".to_owned())
            }
            Some("GT") => (MILLISECOND, "ACK\r130 190 90 150 40 100\r:".to_owned()),
            Some(kind @ ("TC" | "TW" | "FD")) => {
                let packet = match self.sees.get().filter(|_| !self.dazzled.get()) {
                    // In units of 16 x 16 blocks.
                    Some(x) if kind == "FD" => [x, 8, x - 1, 7, x + 1, 9, 6, 255],
                    Some(x) => [x, 70, x - 6, 57, x + 6, 82, 34, 200],
                    None => [0; 8],
                };
                let numbers = packet.map(|n| n.to_string()).join(" ");
                (60 * MILLISECOND, format!("ACK\rT {numbers}\r:"))
            }
            _ => (MILLISECOND, "ACK\r:".to_owned()),
        }
    }
}

/// A node without its firmware, and its camera, if it has one.
pub(super) struct Board {
    board: node_test::Board,
    camera: Rc<Camera>,
}

impl Deref for Board {
    type Target = node_test::Board;

    fn deref(&self) -> &node_test::Board {
        &self.board
    }
}

impl DerefMut for Board {
    fn deref_mut(&mut self) -> &mut node_test::Board {
        &mut self.board
    }
}

impl Board {
    pub(super) fn new(bench: &mut Bench, role: RoleConfig) -> Self {
        let camera = Rc::new(Camera::default());
        let board = match role {
            RoleConfig::Camera(config) => {
                let seen = camera.clone();
                let script = Script::new(config.baud, move |line| seen.obey(line));
                bench.camera_on(config, script)
            }
            role => bench.node(role),
        };
        Self { board, camera }
    }

    pub(super) fn switch_off(&self, bench: &mut Bench) {
        bench.bench.switch_off(self);
    }

    /// Off, if it was on, and on again.
    pub(super) fn power(&self, bench: &mut Bench, seed: u64) {
        bench.bench.start(self, seed);
        // One whose flash serves no more has another address at each start.
        let drawn = Eui64::of_node(self.config.id, !seed);
        let sender = (self.flash.clone(), self.faults.are_at(0).then_some(drawn));
        bench.senders.borrow_mut().insert(self.antenna(), sender);
    }

    /// View of its camera from now on.
    pub(super) fn sees(&self, column: Option<u8>) {
        self.camera.sees.set(column);
    }

    /// The daylight is another one now.
    pub(super) fn dazzle(&self) {
        self.camera.dazzled.set(true);
    }

    /// Commands to its camera, from now on or since it was last forgotten.
    pub(super) fn heard(&self) -> Vec<String> {
        self.camera.heard.borrow().clone()
    }

    pub(super) fn forget_heard(&self) {
        self.camera.heard.borrow_mut().clear();
    }
}

/// A coordinator with a PC, a camera with a CMUcam2, and a target.
pub(super) struct Site {
    pub(super) bench: Bench,
    pub(super) pc: Pc,
    pub(super) coordinator: Board,
    pub(super) camera: Board,
    pub(super) target: Board,
}

impl Site {
    pub(super) fn new() -> Self {
        let mut bench = Bench::new();
        let mut coordinator = CoordinatorConfig::default();
        coordinator.join_window_s = 60;
        let coordinator = RoleConfig::Coordinator(coordinator);
        let coordinator = Board::new(&mut bench, coordinator);
        let camera = RoleConfig::Camera(camera_config(Some(Duty::First)));
        let camera = Board::new(&mut bench, camera);
        let target = Board::new(&mut bench, RoleConfig::Target(target_config(0)));
        let mut site = Self {
            bench,
            pc: coordinator.pc(),
            coordinator,
            camera,
            target,
        };
        site.restart(1);
        site
    }

    /// Switches all off.
    pub(super) fn switch_off(&mut self) {
        for board in [&self.coordinator, &self.camera, &self.target] {
            board.switch_off(&mut self.bench);
            board.lamps.0.take();
        }
    }

    /// Switches all off and on again, with the pages they have by then.
    pub(super) fn restart(&mut self, seed: u64) {
        self.switch_off();
        self.pc.forget();
        let boards = [&self.coordinator, &self.camera, &self.target];
        for (seed, board) in (seed..).zip(boards) {
            board.power(&mut self.bench, seed);
        }
    }

    pub(super) fn configs(&mut self) -> [&mut Config; 3] {
        [
            &mut self.coordinator.config,
            &mut self.camera.config,
            &mut self.target.config,
        ]
    }

    /// Kinds that members told, by number.
    pub(super) fn hellos(&self) -> BTreeMap<u16, MemberKind> {
        let hellos = self.pc.told().into_iter().filter_map(|told| match told {
            ToPc::Member { hello, .. } => Some((hello.id, hello.kind)),
            _ => None,
        });
        hellos.collect()
    }

    /// The camera's, which it had last.
    pub(super) fn camera_address(&self) -> u16 {
        let mut told = self.pc.told().into_iter().rev();
        let address = told.find_map(|message| match message {
            ToPc::Member { address, hello } if hello.id == self.camera.config.id => Some(address),
            _ => None,
        });
        address.unwrap()
    }

    /// The PC commands the camera, which answers in this time. Returns true if it succeeded.
    pub(super) fn command(&mut self, command: CameraCommand, within: Time) -> bool {
        let address = self.camera_address();
        self.pc.wish(FromPc::Command { address, command });
        self.bench.run_for(within);
        let told = self.pc.told();
        let [failed, done] = [false, true].map(|success| {
            told.iter().any(|told| match *told {
                ToPc::Done {
                    address: from,
                    done,
                } => {
                    (from, done.command) == (address, command)
                        && done.outcome.is_success() == success
                }
                _ => false,
            })
        });
        assert!(done != failed, "{told:?}");
        done
    }
}
