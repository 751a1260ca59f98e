//! One node's hardware, and its firmware running on it.

use std::{
    cell::{Cell, RefCell},
    pin::pin,
    rc::Rc,
};

use board_facts::NRF52840_DK;
use calib_core::dead_reckoning::Step;
use embassy_futures::select::{Either, select};
use embassy_sync::{blocking_mutex::raw::NoopRawMutex, channel::Channel as Queue, signal::Signal};
use nalgebra::{Point2, Vector2};
use node_firmware::{
    config::{CheckedConfig, RoleConfig},
    facts::{self, Fact},
    hardware::{
        Button, Buttons, FlashLayout, Hardware, Indication, Indicator, Peripherals, StepSensor,
        Updates,
    },
    limits::CONSOLE_BAUD,
    liveness::Liveness,
    message::{Health, Restart},
    run::{Failure, run},
    steps::{Chip, SensorError, SensorFault},
    vision::CameraKind,
};
use rand::{Rng, RngExt};
use results::record::verdict::health_words;
use zigbee_link::{radio::Csma, runner::Clock as _, wire::Eui64};

use super::{
    SharedWorld, Simulation, Trouble,
    device::{Device, Serial},
    emulated::{Surroundings, chips},
    journal::{Moment, SharedJournal, Witness},
    updated::Parts,
};
use crate::video::Video;
use cmucam2_emulator::{Background, Configuration, Emulator, FaultRates, Rgb, Scene};
use node_test::{CameraDevice, PixyDevice};
use site::world::{Mood, View};
use site::{CameraNode, Network, TargetNode};
use virtual_hardware::{
    executor::{Clock, Spawner, TaskId, Time},
    flash::{Flash, PAGE},
    line::{Line, Side, Uart},
    medium::{Medium, NRF52840, NodeId, Radio},
    random::Root,
};

/// Flash of a board for the link, and for the role.
const LINK: u32 = NRF52840_DK.regions.link.end - NRF52840_DK.regions.link.start;
const MEMORY: u32 = LINK + facts::BYTES;

/// Time after which a board that failed restarts.
const RESTART: Time = 1_000_000_000;

/// The emulator's model of a camera of the Pixy family.
const fn pixy_model(kind: CameraKind) -> pixy_emulator::Model {
    match kind {
        CameraKind::Cmucam2 | CameraKind::Pixy2 => pixy_emulator::Model::Pixy2,
        CameraKind::Pixy => pixy_emulator::Model::Pixy,
        CameraKind::OpenMv => pixy_emulator::Model::OpenMv,
        CameraKind::OpenMvTags => pixy_emulator::Model::OpenMvTags,
    }
}

/// Period of the watchdog: a shorter one would only cost time.
const WATCHDOG: Time = 30_000_000_000;

/// Colour that cameras see where nothing else is: a grey wall.
const BACKDROP: Rgb = [110; 3];

/// Returns the true place of a target.
type Whereabouts = Box<dyn Fn() -> Point2<f64>>;

/// Number of steps that a sensor keeps while the node is busy.
const STEPS: usize = 64;

/// The far ends of a target's sensor and lamps.
pub(super) struct Panel {
    /// State of the lamps.
    pub(super) shown: Cell<Indication>,
    /// The lamps have changed.
    pub(super) changed: Signal<NoopRawMutex, ()>,
    /// Steps on their way from the sensor; `None` where it was unplugged or put back.
    pub(super) steps: Queue<NoopRawMutex, Option<Step<f32>>, STEPS>,
    /// The last button that was pressed and not noticed yet.
    pressed: Signal<NoopRawMutex, Button>,
}

impl Panel {
    pub(super) fn show(&self, indication: Indication) {
        self.shown.set(indication);
        self.changed.signal(());
    }
}

/// View of a camera.
struct Outlook {
    world: SharedWorld,
    index: usize,
    /// View at the time when the camera began to stick.
    stuck: Rc<RefCell<Option<View>>>,
    /// Its usual faults, and those that it is to have.
    usual: FaultRates,
    faults: Rc<Cell<FaultRates>>,
    /// Video in the place of the world.
    video: Rc<RefCell<Option<Video>>>,
}

/// The node's end of the lamps.
pub(super) struct Lamps(Rc<Node>);

impl Indicator for Lamps {
    fn show(&mut self, indication: Indication) {
        self.0.panel.show(indication);
    }
}

/// The step sensor's end at the node.
pub(super) struct Steps {
    node: Rc<Node>,
    /// It was unplugged when it was asked last.
    failed: bool,
}

/// Fault of a sensor that is unplugged.
const UNPLUGGED: SensorError = Chip::Motion.is(SensorFault::Absent);

impl StepSensor for Steps {
    async fn next(&mut self) -> Result<Option<Step<f32>>, SensorError> {
        loop {
            if self.node.has_no_sensor() {
                self.failed = true;
                return Err(UNPLUGGED);
            }
            if std::mem::take(&mut self.failed) {
                return Ok(None);
            }
            if let Some(step) = self.node.panel.steps.receive().await {
                return Ok(Some(step));
            }
        }
    }
}

/// The buttons' end at the node.
pub(super) struct PushButtons(Rc<Node>);

impl Buttons for PushButtons {
    async fn pressed(&mut self) -> Button {
        self.0.panel.pressed.wait().await
    }
}

/// Disturbances of a node from outside, perhaps several at once.
#[derive(Default)]
struct Adversity {
    /// Power cuts under way.
    cuts: Cell<usize>,
    /// Number of times that the plug of its line was pulled and not put back yet.
    pulls: Cell<usize>,
    /// Number of times that its camera was made to stick and not freed yet.
    sticks: Cell<usize>,
    /// Errors that its step sensor adds to distances (a share) and headings (radians), each for
    /// as long as it is in the list.
    slips: RefCell<Vec<[f64; 2]>>,
    /// Number of times that its step sensor was unplugged and not put back yet.
    sensor_pulls: Cell<usize>,
    /// Number of times that its carrier was told to rest and not to go on yet.
    rests: Cell<usize>,
    /// Times that its carrier stands without heeding the lamp, each for as long as it is in the list.
    hurries: RefCell<Vec<Time>>,
}

/// Counts one more, or one less.
fn count(number: &Cell<usize>, is_more: bool) -> usize {
    let counted = match is_more {
        true => number.get() + 1,
        false => number.get().saturating_sub(1),
    };
    number.set(counted);
    counted
}

/// A node's end of its line. An emulated chip has its program's own buffers, so the line waits for no other.
fn uart(simulation: &Simulation, baud: u32) -> Uart {
    let usual = Uart::new(baud);
    let transmit_buffer = match simulation.chips {
        Some(_) => usize::MAX,
        None => usual.transmit_buffer,
    };
    Uart {
        transmit_buffer,
        ..usual
    }
}

/// One node.
pub(super) struct Node {
    config: CheckedConfig,
    clock: Clock,
    spawner: Spawner,
    medium: Medium,
    pub(super) antenna: NodeId,
    flash: Flash,
    /// Parts of the flash behind the memory, if it takes updates by radio.
    updates: Option<Parts>,
    /// Line to the camera, or to the PC.
    pub(super) line: Line,
    pub(super) panel: Panel,
    /// View of a camera node.
    outlook: Option<Outlook>,
    journal: SharedJournal,
    truth: RefCell<Option<Whereabouts>>,
    root: Root,
    starts: Cell<u64>,
    task: Cell<Option<TaskId>>,
    /// It has been switched on.
    is_on: Cell<bool>,
    adversity: Adversity,
    /// A real camera in the place of the one on the line.
    real: RefCell<Option<Serial>>,
    /// Emulated board that runs the firmware, if not this program.
    board: Option<Rc<chips::Board>>,
    trouble: Trouble,
}

/// The hardware of a node whose firmware runs in this program, not on an emulated board.
impl Hardware for Node {
    type Uart = Device;
    type Radio = Csma<Radio, Clock>;
    type Clock = Clock;
    type Flash = Flash;
    type Steps = Steps;
    type Indicator = Lamps;
    type Buttons = PushButtons;
    type Observer = Witness;
}

impl Node {
    fn new(
        simulation: &Simulation,
        config: CheckedConfig,
        place: Point2<f64>,
        (line, outlook): (Line, Option<Outlook>),
        root: Root,
    ) -> Rc<Self> {
        let id = config.settings().id.into();
        let most = simulation.scenario.clock_ppm * 1e3;
        let drift = root.stream("clock", id).random_range(-most..=most);
        let clock = simulation.executor.clock().drifting(drift as i32);
        let chip = simulation.chips.as_ref();
        let step_length = simulation.scenario.walk.step_length;
        let updates = simulation.update_key.filter(|_| chip.is_none());
        let updates = updates.and_then(|key| Parts::new(MEMORY, key));
        let end = updates.as_ref().map_or(MEMORY, Parts::end);
        let chip = chip.map(|chips| chips.board(&config, drift as i32, step_length));
        Rc::new(Self {
            board: chip,
            trouble: simulation.trouble.clone(),
            real: RefCell::default(),
            flash: Flash::new(&clock, end as usize / PAGE, root.stream("flash", id)),
            updates,
            antenna: simulation.medium.attach(super::antenna(place)),
            spawner: simulation.executor.spawner(),
            medium: simulation.medium.clone(),
            journal: simulation.journal.clone(),
            panel: Panel {
                shown: Cell::default(),
                changed: Signal::new(),
                steps: Queue::new(),
                pressed: Signal::new(),
            },
            outlook,
            truth: RefCell::default(),
            starts: Cell::new(0),
            task: Cell::new(None),
            is_on: Cell::new(false),
            adversity: Adversity::default(),
            config,
            clock,
            line,
            root,
        })
    }

    pub(super) fn coordinator(
        simulation: &Simulation,
        network: &Network,
        config: CheckedConfig,
        root: Root,
    ) -> Rc<Self> {
        let (uart, pc) = (uart(simulation, CONSOLE_BAUD), Uart::new(CONSOLE_BAUD));
        let line = Line::between_ports(&simulation.executor.clock(), uart, pc);
        Self::new(simulation, config, network.coordinator, (line, None), root)
    }

    pub(super) fn camera(
        simulation: &Simulation,
        camera: &CameraNode,
        config: CheckedConfig,
        root: Root,
    ) -> Rc<Self> {
        let seed = root.seed("camera", camera.id.into());
        let empty = Scene {
            background: Background::Plain(BACKDROP),
            noise: camera.noise,
            flicker: camera.flicker,
            ..Scene::default()
        };
        let index = camera.index;
        let outlook = Outlook {
            world: simulation.world.clone(),
            index,
            stuck: Rc::default(),
            usual: camera.faults,
            faults: Rc::new(Cell::new(camera.faults)),
            video: Rc::default(),
        };
        let (world, stuck) = (outlook.world.clone(), outlook.stuck.clone());
        let faults = outlook.faults.clone();
        let video = outlook.video.clone();
        let light = simulation.light.clone();
        let tags = camera.tags.clone();
        let worn = move |target| Some(tags.iter().position(|worn| *worn == target)? as u16);
        let mut seen = None;
        let scene = move |now: Time, scene: &mut Scene| {
            scene.light = light.get();
            if let Some(video) = &mut *video.borrow_mut() {
                // A picture that cannot be read is not seen: the last one stays.
                if let Ok(picture) = video.at(now as f64 * 1e-9) {
                    scene.background = Background::Picture(picture);
                }
                return;
            }
            if let Some(view) = &*stuck.borrow() {
                seen = None;
                view.paint(BACKDROP, &mut scene.objects);
                view.tag(&worn, &mut scene.objects);
                return;
            }
            let world = world.borrow();
            if seen != Some(world.revision()) {
                seen = Some(world.revision());
                let view = world.look(index);
                view.paint(BACKDROP, &mut scene.objects);
                view.tag(&worn, &mut scene.objects);
            }
        };
        let clock = simulation.executor.clock();
        let uart = uart(simulation, camera.baud);
        let line = match camera.kind {
            CameraKind::Cmucam2 => {
                let configuration = Configuration {
                    sensor: camera.sensor,
                    baud: camera.baud,
                    host_baud: camera.baud,
                    faults: camera.faults,
                    seed,
                    ..Configuration::default()
                };
                let emulator = Emulator::new(configuration, empty);
                let device = CameraDevice::new(emulator, scene).with_faults(faults);
                Line::to_device(&clock, uart, device)
            }
            kind => {
                let configuration = pixy_emulator::Configuration {
                    model: pixy_model(kind),
                    baud: camera.baud,
                    signatures: camera.taught.clone(),
                    seed,
                    ..pixy_emulator::Configuration::default()
                };
                let emulator = pixy_emulator::Emulator::new(configuration, empty);
                let device = PixyDevice::new(emulator, scene).with_faults(faults);
                Line::to_device(&clock, uart, device)
            }
        };
        let place = simulation.world.borrow().cameras()[index].place;
        Self::new(simulation, config, place, (line, Some(outlook)), root)
    }

    pub(super) fn target(
        simulation: &Simulation,
        target: &TargetNode,
        config: CheckedConfig,
        root: Root,
    ) -> Rc<Self> {
        let uart = Uart::new(CONSOLE_BAUD);
        let line = Line::between_ports(&simulation.executor.clock(), uart, uart);
        let world = simulation.world.clone();
        let index = target.index;
        let place = world.borrow().targets()[index].place;
        let node = Self::new(simulation, config, place, (line, None), root);
        *node.truth.borrow_mut() = Some(Box::new(move || world.borrow().targets()[index].place));
        node
    }

    pub(super) fn id(&self) -> u16 {
        self.config.settings().id
    }

    /// Returns true if it is a target.
    pub(super) fn is_target(&self) -> bool {
        matches!(self.config.settings().role, RoleConfig::Target(_))
    }

    /// The medium, with its counts of this node.
    pub(super) fn medium(&self) -> &Medium {
        &self.medium
    }

    /// Flips bits of its flash.
    pub(super) fn rot(&self, bits: u32, mut random: impl Rng) {
        match self.chip() {
            Some(chip) => chip.rot(bits, &mut random),
            None => {
                let mut bytes = self.flash.bytes_mut();
                for _ in 0..bits {
                    let at = random.random_range(0..bytes.len());
                    bytes[at] ^= 1 << random.random_range(0..8);
                }
            }
        }
    }

    /// Presses one of its buttons.
    pub(super) fn press(&self, button: Button) {
        match self.chip() {
            Some(chip) => chip.press(&self.clock, button),
            None if self.task.get().is_some() => self.panel.pressed.signal(button),
            None => {}
        }
    }

    /// Its flash keeps its present contents from now on.
    pub(super) fn wear_out(&self) {
        match self.chip() {
            Some(chip) => chip.wear_out(),
            None => self.flash.wear_out(),
        }
    }

    /// Tells its chip which channels are jammed at its place, until a time or the next call.
    pub(super) fn hears_jam(&self, until: Time) {
        if let Some(chip) = self.chip() {
            chip.jam(until, &self.medium.jammed(self.antenna));
        }
    }

    fn chip(&self) -> Option<&chips::Board> {
        self.board.as_deref()
    }

    /// Erasures of the page of its flash that was erased most; unknown of an emulated board.
    pub(super) fn page_erasures(&self) -> Option<u32> {
        match self.board {
            Some(_) => None,
            None => self.flash.most_erasures(),
        }
    }

    /// Returns true if its firmware runs on an emulated board.
    pub(super) fn is_emulated(&self) -> bool {
        self.board.is_some()
    }

    /// Writes a line of the log about it.
    pub(super) fn note(&self, what: &str) {
        let mut journal = self.journal.borrow_mut();
        journal.note(self.config.settings().id, format_args!("{what}"));
        journal.moment(self.config.settings().id, || Moment::Said(what.to_owned()));
    }

    /// Makes a step. A node that is off misses it.
    pub(super) fn step(&self, mut step: Step<f32>) {
        let is_on = self.task.get().is_some();
        if is_on {
            for [distance, heading] in &*self.adversity.slips.borrow() {
                step.distance *= (1.0 + distance) as f32;
                step.heading = calib_core::angle::wrap_positive(step.heading + *heading as f32);
            }
        }
        // The body under an emulated sensor moves in any case.
        let is_felt = is_on && !self.has_no_sensor();
        (self.journal.borrow_mut()).stepped(self.config.settings().id, &step, is_felt);
        if is_felt || is_on && self.is_emulated() {
            let _ = self.panel.steps.try_send(Some(step));
        }
    }

    /// Its step sensor is unplugged.
    pub(super) fn has_no_sensor(&self) -> bool {
        self.adversity.sensor_pulls.get() > 0
    }

    /// Pulls the plug of its step sensor, or puts it back.
    pub(super) fn unplug_sensor(&self, out: bool) {
        count(&self.adversity.sensor_pulls, out);
        match self.chip() {
            Some(chip) => chip.unplug_sensor(self.has_no_sensor()),
            None => drop(self.panel.steps.try_send(None)),
        }
        self.panel.changed.signal(());
    }

    /// Adds an error to its step sensor: a share to distances, and radians to headings; or takes it
    /// away again.
    pub(super) fn slip(&self, error: [f64; 2], slips: bool) {
        let mut under_way = self.adversity.slips.borrow_mut();
        match (slips, under_way.iter().position(|one| *one == error)) {
            (true, _) => under_way.push(error),
            (false, Some(place)) => drop(under_way.remove(place)),
            (false, None) => {}
        }
    }

    /// Its carrier's attitude to the lamp.
    pub(super) fn mood(&self) -> Mood {
        let shortest = self.adversity.hurries.borrow().iter().min().copied();
        match (self.adversity.rests.get(), shortest) {
            (0, None) => Mood::Heeds,
            (0, Some(stand)) => Mood::Ignores(stand),
            _ => Mood::Rests,
        }
    }

    /// Has its carrier rest, or go on.
    pub(super) fn rest(&self, rests: bool) {
        count(&self.adversity.rests, rests);
        self.panel.changed.signal(());
    }

    /// Has its carrier stand no longer than this at a stop, or heed the lamp again.
    pub(super) fn hurry(&self, stand: Time, hurries: bool) {
        let mut under_way = self.adversity.hurries.borrow_mut();
        match (hurries, under_way.iter().position(|one| *one == stand)) {
            (true, _) => under_way.push(stand),
            (false, Some(place)) => drop(under_way.remove(place)),
            (false, None) => {}
        }
        self.panel.changed.signal(());
    }

    /// Moves its camera and turns it, radians.
    pub(super) fn bump_camera(&self, by: Vector2<f64>, turn: f64) {
        if let Some(outlook) = &self.outlook {
            let mut world = outlook.world.borrow_mut();
            let camera = world.cameras()[outlook.index];
            let place = camera.place + by;
            world.move_camera(outlook.index, place, camera.heading + turn);
            self.medium.move_to(self.antenna, super::antenna(place));
        }
    }

    /// Gives its camera other faults, or the usual ones.
    pub(super) fn camera_faults(&self, rates: Option<FaultRates>) {
        if let Some(outlook) = &self.outlook {
            outlook.faults.set(rates.unwrap_or(outlook.usual));
        }
    }

    /// Has its camera go on seeing its present view, or frees it again.
    pub(super) fn stick_camera(&self, sticks: bool) {
        let Some(outlook) = &self.outlook else {
            return;
        };
        // A camera that sticks already goes on seeing the same.
        match (sticks, count(&self.adversity.sticks, sticks)) {
            (true, 1) => {
                let view = outlook.world.borrow().look(outlook.index);
                outlook.stuck.replace(Some(view));
            }
            (false, 0) => drop(outlook.stuck.take()),
            _ => {}
        }
    }

    /// Pulls the plug of its line.
    pub(super) fn unplug(&self, with_power: bool) {
        count(&self.adversity.pulls, true);
        self.line.unplug(with_power);
    }

    /// Puts the plug back; the line is connected once all pulls are undone.
    pub(super) fn plug(&self) {
        if count(&self.adversity.pulls, false) == 0 {
            self.line.plug();
        }
    }

    /// Takes the power of it and its camera.
    pub(super) fn lose_power(&self) {
        count(&self.adversity.cuts, true);
        self.stop();
        self.unplug(true);
    }

    /// Ends a power cut.
    pub(super) fn regain_power(self: &Rc<Self>) {
        count(&self.adversity.cuts, false);
        self.plug();
        self.start();
    }

    /// Starts anew, if it is on and has power.
    pub(super) fn restart(self: &Rc<Self>) {
        self.stop();
        self.start();
    }

    /// Switches it on, for good.
    pub(super) fn switch_on(self: &Rc<Self>) {
        self.is_on.set(true);
        self.start();
    }

    /// Starts the firmware, if it does not run and can.
    fn start(self: &Rc<Self>) {
        let has_power = self.adversity.cuts.get() == 0;
        if self.is_on.get() && has_power && self.task.get().is_none() {
            let task = match self.board {
                None => self.spawner.spawn(self.clone().firmware()),
                Some(_) => self.spawner.spawn(self.clone().emulated()),
            };
            self.task.set(task);
        }
    }

    /// Stops the firmware at any point. Flash and connected devices stay.
    fn stop(&self) {
        if let Some(task) = self.task.take() {
            self.spawner.kill(task);
            self.panel.show(Indication::default());
            self.panel.steps.clear();
            self.panel.pressed.reset();
        }
    }

    /// Shows its camera this video instead of the world, from time 0 on.
    pub(super) fn show(&self, video: Video) {
        if let Some(outlook) = &self.outlook {
            outlook.video.replace(Some(video));
        }
    }

    /// Gives it a real camera from its next start on.
    pub(super) fn connect(&self, port: Serial) {
        self.real.replace(Some(port));
    }

    /// Device on its UART.
    fn device(&self) -> Device {
        let line = || Device::Line(self.line.open(Side::Node));
        match &*self.real.borrow() {
            None => line(),
            Some(port) => Device::real(port, &self.clock).unwrap_or_else(|error| {
                self.note(&format!("loses its real camera: {error}"));
                line()
            }),
        }
    }

    /// A random number, another one at each start.
    fn next_seed(&self) -> u64 {
        let start = self.starts.replace(self.starts.get() + 1);
        let id = u64::from(self.config.settings().id);
        self.root.seed("node", id << 32 | start)
    }

    /// Runs it on an emulated board.
    async fn emulated(self: Rc<Self>) {
        let Some(board) = &self.board else {
            return;
        };
        let surroundings = Surroundings {
            clock: &self.clock,
            medium: &self.medium,
            antenna: self.antenna,
            device: self.device(),
            panel: &self.panel,
            seed: self.next_seed(),
        };
        let error = board.run(surroundings).await;
        (self.journal.borrow_mut()).failed(self.config.settings().id, &error.to_string());
        self.trouble.borrow_mut().get_or_insert(error);
    }

    pub(super) fn config(&self) -> &CheckedConfig {
        &self.config
    }

    /// The extended address that it has drawn and keeps in its flash.
    pub(super) fn extended(&self) -> Option<Eui64> {
        match &self.board {
            Some(board) => board.extended(&self.clock),
            None => {
                let (layout, bytes) = (0..LINK, self.flash.programmer().bytes().to_vec());
                super::emulated::memory::extended(layout, &bytes, &self.clock)
            }
        }
    }

    /// Facts that an emulated board has written down.
    pub(super) fn memory(&self) -> Vec<Fact> {
        let board = self.board.as_ref();
        board.map_or_else(Vec::new, |board| board.facts(&self.clock))
    }

    /// Waits until it works on its flash; returns how long that takes.
    pub(super) async fn next_write(&self) -> Time {
        match &self.board {
            Some(board) => board.next_write().await,
            None => self.flash.next_operation().await,
        }
    }

    /// Summary of its emulated chip, once the simulation has ended.
    pub(super) fn end(&self) -> Option<chips::outside::End> {
        Some(self.board.as_ref()?.end())
    }

    /// Puts into the journal the new facts that an emulated board has written down.
    pub(super) fn read_memory(&self) {
        let memory = self.memory();
        let mut journal = self.journal.borrow_mut();
        let seen = journal.node(self.config.settings().id).learns_late(&memory);
        for (target, seen) in seen {
            journal.moment(self.config.settings().id, || Moment::Seen(target, seen));
        }
    }

    /// The watchdog: returns the reason why it restarts the node.
    async fn watch(&self, liveness: &Liveness) -> Restart {
        loop {
            self.clock.sleep(WATCHDOG).await;
            if let Err(why) = liveness.check(self.clock.now()) {
                return why;
            }
        }
    }

    /// Its boot loader. One whose flash fails tries again.
    async fn boot(&self, parts: &Parts) -> Updates {
        loop {
            match parts.boot(&self.flash) {
                Ok(boot) => {
                    self.clock.sleep(boot.takes).await;
                    if boot.changed {
                        let version = boot.image.map_or(0, |stamp| stamp.version);
                        self.note(&format!("starts the image of version {version}"));
                    }
                    return parts.firmware(boot.image);
                }
                Err(error) => self.note(&format!("cannot change images: {error}")),
            }
            self.clock.sleep(RESTART).await;
        }
    }

    async fn firmware(self: Rc<Self>) {
        let mut restart = Restart::Ordinary;
        loop {
            let update = match &self.updates {
                Some(parts) => Some(self.boot(parts).await),
                None => None,
            };
            let liveness = Liveness::new(restart);
            let seed = self.next_seed();
            let radio = self.medium.radio(self.antenna, NRF52840);
            let node = self.clone();
            let peripherals = Peripherals::<Self> {
                uart: self.device(),
                radio: Csma::new(radio, self.clock.clone(), seed),
                clock: self.clock.clone(),
                flash: self.flash.clone(),
                layout: FlashLayout {
                    link: 0..LINK,
                    facts: LINK..MEMORY,
                },
                steps: Steps {
                    node: self.clone(),
                    failed: false,
                },
                indicator: Lamps(self.clone()),
                buttons: PushButtons(self.clone()),
                observer: Witness {
                    id: self.config.settings().id,
                    journal: self.journal.clone(),
                    truth: Box::new(move || node.truth.borrow().as_ref().map(|truth| truth())),
                },
                seed,
                update,
            };
            let running = pin!(run(&self.config, peripherals, &liveness));
            let why = match select(running, pin!(self.watch(&liveness))).await {
                Either::First(Failure::Update) => {
                    restart = Restart::Ordinary;
                    continue;
                }
                Either::First(failure) => {
                    restart = Restart::Program;
                    failure.to_string()
                }
                Either::Second(why) => {
                    restart = why;
                    let health = Health {
                        restart,
                        ..Health::default()
                    };
                    health_words(&health)
                }
            };
            self.journal
                .borrow_mut()
                .failed(self.config.settings().id, &why);
            self.clock.sleep(RESTART).await;
        }
    }
}
