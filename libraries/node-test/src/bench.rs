//! The surroundings of the nodes under test.

use std::collections::BTreeMap;

use cmucam2_emulator::{Configuration, Emulator, Scene};
use node_firmware::{
    config::{CameraConfig, Config, CoordinatorConfig, RoleConfig, SiteKey, TargetConfig},
    limits::CONSOLE_BAUD,
    vision::CameraKind,
};
use virtual_hardware::{
    executor::{Clock, Ended, Executor, TaskId, Time},
    line::{Device, Line, Uart},
    medium::{Medium, NodeId, Propagation},
    random::Root,
};
use zigbee_link::security::Protection;

use crate::{Board, CameraDevice, PixyDevice};

/// A second of virtual time.
pub const SECOND: Time = 1_000_000_000;

/// Number of the first node; the next ones follow.
const FIRST_NODE: u16 = 100;

/// Surroundings of nodes: time, air, and the nodes that run. The same seed gives the same run.
pub struct Bench {
    /// Runs the nodes, and whatever else a test spawns.
    pub executor: Executor,
    /// The time.
    pub clock: Clock,
    /// The air between the nodes.
    pub medium: Medium,
    root: Root,
    nodes: u16,
    starts: u64,
    running: BTreeMap<NodeId, TaskId>,
}

impl Bench {
    /// Nodes that all hear each other.
    pub fn new(seed: u64) -> Self {
        let everywhere = Propagation::UnitDisk {
            range: 1e6,
            loss: 0.0,
        };
        Self::in_air(everywhere, seed)
    }

    /// Nodes in air that loses frames, or where nodes are out of reach. Nodes stand at x = 0, 1, 2 and so on.
    pub fn in_air(propagation: Propagation, seed: u64) -> Self {
        let executor = Executor::new();
        let clock = executor.clock();
        let root = Root(seed);
        Self {
            medium: Medium::new(&clock, propagation, root.seed("air", 0)),
            executor,
            clock,
            root,
            nodes: 0,
            starts: 0,
            running: BTreeMap::new(),
        }
    }

    /// A node that has no device at the far end of its UART, but a port: a coordinator's is the [PC](Board::pc).
    pub fn node(&mut self, role: RoleConfig) -> Board {
        let uart = Uart::new(CONSOLE_BAUD);
        // The test looks at times for new bytes.
        let far = Uart {
            receive_buffer: 1 << 20,
            transmit_buffer: 1 << 10,
            ..uart
        };
        let line = Line::between_ports(&self.clock, uart, far);
        self.board(role, line)
    }

    /// A coordinator.
    pub fn coordinator(&mut self, config: CoordinatorConfig) -> Board {
        self.node(RoleConfig::Coordinator(config))
    }

    /// A target, which takes the [steps](Board::step) that it is told.
    pub fn target(&mut self, config: TargetConfig) -> Board {
        self.node(RoleConfig::Target(config))
    }

    /// A camera node with an emulated camera of its kind. `scene` is called with the time before each frame is taken, to
    /// put things where they are then.
    pub fn camera(
        &mut self,
        config: CameraConfig,
        scene: impl FnMut(Time, &mut Scene) + 'static,
    ) -> Board {
        let (baud, seed) = (config.baud, self.root.seed("camera", self.nodes.into()));
        let model = match config.kind {
            CameraKind::Cmucam2 => {
                let configuration = Configuration {
                    baud,
                    host_baud: baud,
                    seed,
                    ..Configuration::default()
                };
                let emulator = Emulator::new(configuration, Scene::default());
                return self.camera_on(config, CameraDevice::new(emulator, scene));
            }
            CameraKind::Pixy2 => pixy_emulator::Model::Pixy2,
            CameraKind::Pixy => pixy_emulator::Model::Pixy,
            CameraKind::OpenMv => pixy_emulator::Model::OpenMv,
            CameraKind::OpenMvTags => pixy_emulator::Model::OpenMvTags,
        };
        let configuration = pixy_emulator::Configuration {
            model,
            baud,
            seed,
            ..pixy_emulator::Configuration::default()
        };
        let emulator = pixy_emulator::Emulator::new(configuration, Scene::default());
        self.camera_on(config, PixyDevice::new(emulator, scene))
    }

    /// A camera node with this device on its UART: an emulated camera with faults, or a [script](crate::Script).
    pub fn camera_on(&mut self, config: CameraConfig, device: impl Device) -> Board {
        let line = Line::to_device(&self.clock, Uart::new(config.baud), device);
        self.board(RoleConfig::Camera(config), line)
    }

    fn board(&mut self, role: RoleConfig, line: Line) -> Board {
        let number = self.nodes;
        self.nodes += 1;
        let antenna = self.medium.attach([number.into(), 0.0]);
        let key = SiteKey::new(1, *b"0123456789abcdef");
        let mut config = Config::new(FIRST_NODE + number, key, role);
        config.channels = 1 << 15;
        config.protection = Protection::EncMic32;
        Board::new(
            config,
            antenna,
            line,
            self.root.stream("flash", number.into()),
        )
    }

    /// Lets time pass.
    ///
    /// # Panics
    /// Tasks wake each other without time passing, or a node stopped.
    pub fn run_for(&mut self, time: Time) {
        let ended = self.executor.run_until(self.clock.time() + time);
        assert_eq!(ended, Ended::TimeUp);
    }

    /// Switches nodes on; off before, where they were on. The firmware of each starts with the present contents of its
    /// flash.
    pub fn switch_on<'a>(&mut self, boards: impl IntoIterator<Item = &'a Board>) {
        for board in boards {
            self.starts += 1;
            self.start(board, self.root.seed("start", self.starts));
        }
    }

    /// The same for one node, with what its random number generator gives at this start.
    pub fn start(&mut self, board: &Board, seed: u64) {
        self.switch_off(board);
        let firmware = board.firmware(self, seed);
        let id = board.config.id;
        let task = self.executor.spawn(async move {
            panic!("node {id} stopped: {}", firmware.await);
        });
        self.running.insert(board.antenna, task);
    }

    /// Switches a node off, in the middle of its work.
    pub fn switch_off(&mut self, board: &Board) {
        if let Some(task) = self.running.remove(&board.antenna) {
            self.executor.kill(task);
        }
    }
}
