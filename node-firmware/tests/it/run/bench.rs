//! The hardware of a node, as a test supplies it, and a site of three nodes.

use std::{
    cell::{Cell, RefCell},
    collections::{BTreeMap, HashSet},
    convert::Infallible,
    future::{Future, pending},
    pin::Pin,
    rc::Rc,
};

use crate::run::former_networks::link;
use crate::run::support::{
    flash::{Faults, Faulty, Flash, PAGE, chip, length},
    site::{camera_config, target_config},
};
use calib_core::dead_reckoning::Step;
use embassy_futures::block_on;
use embassy_sync::{blocking_mutex::raw::NoopRawMutex, channel::Channel};
use embedded_io_async::{ErrorType, Read, Write};
use node_firmware::{
    config::{Config, CoordinatorConfig, RoleConfig, SiteKey},
    console::{FRAME_MAX, Frames, FromPc, ToPc, encode},
    facts,
    hardware::{FlashLayout, Hardware, Indication, Indicator, Observer, Peripherals, StepSensor},
    liveness::Liveness,
    message::{CameraCommand, Duty, MemberKind, Message, Restart, Sight},
    run::{Devices, run},
};
use virtual_hardware::{
    executor::{Clock, Ended, Executor, TaskId, Time},
    line::{Line, Port, PortError, Side, Uart},
    medium::{Event, Medium, NRF52840, NodeId, Propagation, Radio},
};
use zigbee_link::{
    radio::Csma,
    security::Protection,
    wire::{Eui64, Frame, ShortAddress},
};

pub(super) const SECOND: Time = 1_000_000_000;

/// Extended address of the sender, index of the key, and frame counter of every frame: no nonce occurs
/// twice.
type Nonces = Rc<RefCell<HashSet<(Eui64, u8, u32)>>>;

/// The flash of each sender, and the extended address in it, once it was looked up since the start.
type Senders = Rc<RefCell<BTreeMap<NodeId, (Flash, Option<Eui64>)>>>;

/// Surroundings of the nodes under test.
pub(super) struct Bench {
    pub(super) executor: Executor,
    pub(super) clock: Clock,
    medium: Medium,
    senders: Senders,
    running: BTreeMap<NodeId, TaskId>,
}

impl Bench {
    pub(super) fn new() -> Self {
        let executor = Executor::new();
        let clock = executor.clock();
        let air = Propagation::UnitDisk {
            range: 1.0,
            loss: 0.0,
        };
        let medium = Medium::new(&clock, air, 1);
        let all = Nonces::default();
        let senders = Senders::default();
        let known = senders.clone();
        medium.watch(move |_, event: Event<'_>| {
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
        Self {
            executor,
            clock,
            medium,
            senders,
            running: BTreeMap::new(),
        }
    }

    pub(super) fn run_for(&mut self, time: Time) {
        let ended = self.executor.run_until(self.clock.time() + time);
        assert_eq!(ended, Ended::TimeUp);
    }
}

/// The extended address that a node keeps in its flash.
pub(super) fn extended(flash: &Flash) -> Eui64 {
    link(flash).0.extended.unwrap()
}

/// A CMUcam2 that follows its commands and sees as the test says: column, or nothing.
#[derive(Default)]
pub(super) struct Camera {
    sees: Cell<Option<u8>>,
    /// It adapted to another light, and sees nothing before it does so again.
    dazzled: Cell<bool>,
    heard: RefCell<Vec<String>>,
}

impl Camera {
    async fn run(self: Rc<Self>, mut uart: Port, clock: Clock) {
        let mut line = String::new();
        loop {
            let mut byte = [0];
            uart.read(&mut byte).await.unwrap();
            if byte != *b"\r" {
                line.push(byte[0].into());
                continue;
            }
            let (after, answer) = self.obey(&line);
            self.heard.borrow_mut().push(std::mem::take(&mut line));
            clock.sleep(after).await;
            uart.write_all(answer.as_bytes()).await.unwrap();
        }
    }

    /// The manual's answers, by the letters of the command, and their times.
    fn obey(&self, command: &str) -> (Time, String) {
        const MILLISECOND: Time = SECOND / 1000;
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
                    Some(x) => [x, 70, x - 4, 61, x + 4, 79, 60, 200],
                    None => [0; 8],
                };
                let numbers = packet.map(|n| n.to_string()).join(" ");
                (60 * MILLISECOND, format!("ACK\rT {numbers}\r:"))
            }
            _ => (MILLISECOND, "ACK\r:".to_owned()),
        }
    }
}

/// A PC, which writes and notes its messages.
pub(super) struct Pc(RefCell<(Port, Frames, Vec<ToPc>)>);

impl Pc {
    pub(super) fn new(uart: Port) -> Self {
        Self(RefCell::new((uart, Frames::default(), Vec::new())))
    }

    pub(super) fn wish(&self, wish: FromPc) {
        let mut buffer = [0; FRAME_MAX];
        // A zero before it ends the frame that noise, or a cut frame, may have begun.
        let frame = [&[0], encode(&wish, &mut buffer).unwrap()].concat();
        block_on(self.0.borrow_mut().0.write_all(&frame)).unwrap();
    }

    pub(super) fn told(&self) -> Vec<ToPc> {
        let (uart, frames, told) = &mut *self.0.borrow_mut();
        let come = uart.received().into_iter();
        told.extend(come.filter_map(|byte| frames.push::<ToPc>(byte)));
        told.clone()
    }

    pub(super) fn forget(&self) {
        self.told();
        self.0.borrow_mut().2.clear();
    }
}

/// A node's end of a line whose other end may take nothing.
pub(super) struct NodeUart {
    port: Port,
    stalled: Rc<Cell<bool>>,
}

impl ErrorType for NodeUart {
    type Error = PortError;
}

impl Write for NodeUart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, PortError> {
        if self.stalled.get() {
            pending::<()>().await;
        }
        self.port.write(bytes).await
    }

    async fn flush(&mut self) -> Result<(), PortError> {
        self.port.flush().await
    }
}

impl Read for NodeUart {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, PortError> {
        self.port.read(buffer).await
    }
}

/// The link's part ends here, and the role's.
pub(super) const LINK: u32 = length(32);
pub(super) const END: u32 = LINK + facts::BYTES;

/// Steps, as the test wants them.
#[derive(Clone)]
pub(super) struct Steps(Rc<Channel<NoopRawMutex, Step<f32>, 4>>);

impl StepSensor for Steps {
    type Error = Infallible;

    async fn next(&mut self) -> Result<Step<f32>, Infallible> {
        Ok(self.0.receive().await)
    }
}

#[derive(Clone, Default)]
pub(super) struct Lamps(pub(super) Rc<Cell<Indication>>);

impl Indicator for Lamps {
    fn show(&mut self, indication: Indication) {
        self.0.set(indication);
    }
}

/// Messages that a node sent.
#[derive(Clone, Default)]
pub(super) struct Log(pub(super) Rc<RefCell<Vec<Message>>>);

impl Observer for Log {
    fn sends(&mut self, _: ShortAddress, message: &Message) {
        self.0.borrow_mut().push(message.clone());
    }
}

/// A node without its firmware.
pub(super) struct Board {
    pub(super) config: Config,
    antenna: NodeId,
    pub(super) line: Line,
    /// The device on its line takes nothing.
    pub(super) stalled: Rc<Cell<bool>>,
    camera: Rc<Camera>,
    /// Flash of 8 KiB for the link, and 8 KiB for the role.
    pub(super) flash: Flash,
    pub(super) faults: Faults,
    /// Since its last start.
    pub(super) liveness: Rc<RefCell<Rc<Liveness>>>,
    steps: Steps,
    pub(super) lamps: Lamps,
    pub(super) log: Log,
}

impl Hardware for Board {
    type Uart = NodeUart;
    type Radio = Csma<Radio, Clock>;
    type Clock = Clock;
    type Flash = Faulty;
    type Steps = Steps;
    type Indicator = Lamps;
    type Buttons = ();
    type Observer = Log;
}

impl Board {
    pub(super) fn new(bench: &mut Bench, role: RoleConfig) -> Self {
        let antenna = bench.medium.attach([0.0; 2]);
        let config = Config {
            id: 100 + antenna.0 as u16,
            site_key: SiteKey::new(1, *b"0123456789abcdef"),
            channels: 1 << 15,
            tx_power: 0,
            protection: Protection::EncMic32,
            role,
        };
        let is_camera = matches!(config.role, RoleConfig::Camera(_));
        let uart = Uart::new(if is_camera { 38_400 } else { 115_200 });
        // The test looks at times for new bytes.
        let far = Uart {
            receive_buffer: 1 << 20,
            transmit_buffer: 1 << 10,
            ..uart
        };
        let line = Line::between_ports(&bench.clock, uart, far);
        let camera = Rc::new(Camera::default());
        if is_camera {
            let running = camera
                .clone()
                .run(line.open(Side::Far), bench.clock.clone());
            bench.executor.spawn(running);
        }
        Self {
            config,
            antenna,
            line,
            stalled: Rc::default(),
            camera,
            flash: chip(END as usize / PAGE, antenna.0.into()),
            faults: Faults::default(),
            liveness: Rc::new(RefCell::new(Rc::new(Liveness::new(Restart::Ordinary)))),
            steps: Steps(Rc::new(Channel::new())),
            lamps: Lamps::default(),
            log: Log::default(),
        }
    }

    /// All but radio and flash.
    pub(super) fn devices<'a>(
        &self,
        clock: &'a Clock,
        liveness: &'a Liveness,
        seed: u64,
    ) -> Devices<'a, Self> {
        Devices {
            uart: NodeUart {
                port: self.line.open(Side::Node),
                stalled: self.stalled.clone(),
            },
            clock,
            steps: self.steps.clone(),
            indicator: self.lamps.clone(),
            buttons: (),
            observer: self.log.clone(),
            seed,
            liveness,
        }
    }

    /// The firmware from its start, with the present contents of the flash.
    pub(super) fn firmware(
        &self,
        bench: &Bench,
        seed: u64,
    ) -> Pin<Box<dyn Future<Output = String>>> {
        let clock = bench.clock.clone();
        let peripherals = Peripherals::<Self> {
            uart: NodeUart {
                port: self.line.open(Side::Node),
                stalled: self.stalled.clone(),
            },
            radio: Csma::new(
                bench.medium.radio(self.antenna, NRF52840),
                clock.clone(),
                seed,
            ),
            clock,
            flash: Faulty::new(self.flash.clone(), self.faults.clone()),
            layout: FlashLayout {
                link: 0..LINK,
                facts: LINK..END,
            },
            steps: self.steps.clone(),
            indicator: self.lamps.clone(),
            buttons: (),
            observer: self.log.clone(),
            seed,
        };
        let config = self.config.clone().check().unwrap();
        let liveness = self.liveness.clone();
        liveness.replace(Rc::new(Liveness::new(Restart::Ordinary)));
        let liveness = liveness.borrow().clone();
        Box::pin(async move { run(&config, peripherals, &liveness).await.to_string() })
    }

    pub(super) fn switch_off(&self, bench: &mut Bench) {
        if let Some(task) = bench.running.remove(&self.antenna) {
            bench.executor.kill(task);
        }
    }

    /// Off, if it was on, and on again.
    pub(super) fn power(&self, bench: &mut Bench, seed: u64) {
        self.switch_off(bench);
        let firmware = self.firmware(bench, seed);
        // One whose flash serves no more has another address at each start.
        let drawn = Eui64::of_node(self.config.id, !seed);
        let sender = (self.flash.clone(), self.faults.are_at(0).then_some(drawn));
        bench.senders.borrow_mut().insert(self.antenna, sender);
        let task = bench.executor.spawn(async move {
            panic!("a node stopped: {}", firmware.await);
        });
        bench.running.insert(self.antenna, task);
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

    /// Its answers to stops.
    pub(super) fn looks(&self) -> Vec<Sight> {
        let log = self.log.0.borrow();
        let looks = log.iter().filter_map(|message| match message {
            Message::Look(look) => Some(look.sight),
            _ => None,
        });
        looks.collect()
    }

    pub(super) fn forget_heard(&self) {
        self.camera.heard.borrow_mut().clear();
    }

    /// Its carrier goes so far, in that direction.
    pub(super) fn step(&self, distance: f32, heading: f32) {
        let step = Step {
            distance,
            heading,
            distance_sigma: 0.01,
            heading_sigma: 0.01,
        };
        self.steps.0.try_send(step).unwrap();
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
        let coordinator = RoleConfig::Coordinator(CoordinatorConfig {
            join_window_s: 60,
            ..CoordinatorConfig::default()
        });
        let coordinator = Board::new(&mut bench, coordinator);
        let camera = RoleConfig::Camera(camera_config(Some(Duty::First)));
        let camera = Board::new(&mut bench, camera);
        let target = Board::new(&mut bench, RoleConfig::Target(target_config(0)));
        let mut site = Self {
            bench,
            pc: Pc::new(coordinator.line.open(Side::Far)),
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
