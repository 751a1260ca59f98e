//! Runs a scenario: the firmware of every node, over emulated cameras and simulated radios, in
//! virtual time; or as machine code, on emulated chips.
//!
//! A [`Simulation`] puts up what a [`Scenario`] says and provisions every node as a person would.
//! Then it only lets time pass: nodes find each other, cameras look, the target walks when its lamp
//! says so. Poses come in where people get them too, on the coordinator's serial line. The record
//! of a run compares them with the truth.
//!
//! | module | job |
//! |---|---|
//! | `node` | One node's hardware, and its firmware running on it |
//! | `camera` | An emulated camera at the far end of a line |
//! | `device` | A simulated line, or a real camera in its place |
//! | `emulated` | The same firmware as machine code on an emulated board |
//! | `walk` | A target's carrier, and its step sensor |
//! | `further` | The way on, as the verdict asks, when the planned way is at an end |
//! | `console` | The PC on a coordinator's line |
//! | `objects` | Objects without a radio that walk there, for calibrated cameras to track |
//! | `journal` | Messages and knowledge of nodes, with times: the log, and the source of records |
//! | `looking` | An onlooker's view, and commands |
//! | `attack` | An attacker that sends frames without the key |
//! | `events` | Faults and disturbances by order of the scenario |
//! | `outcome` | The record |
//! | `measured` | Its part that a joint solution needs |
//! | `many` | Many runs on many threads |

mod attack;
mod console;
mod decryption;
mod device;
mod emulated;
mod events;
mod further;
mod journal;
mod looking;
mod many;
mod measured;
mod node;
mod objects;
mod outcome;
mod updated;
mod walk;

use std::{
    cell::{Cell, Ref, RefCell},
    collections::{BTreeMap, HashMap},
    io::Write,
    rc::Rc,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use node_firmware::{
    config::{CheckedConfig, RoleConfig, SiteKey},
    facts::Fact,
    message::Report,
};

pub use self::{
    console::Terminal,
    emulated::{
        EmulatorError,
        chips::{CHIP_IMAGE, Chips, outside},
    },
    further::FurtherEnd,
    looking::Onlooker,
    many::{run_all, run_all_until},
    objects::{TrackRow, TrackingRun},
};

use self::{
    console::Console,
    emulated::chips::{Lockstep, Pool},
    journal::{Journal, NodeEntry, SharedJournal},
    node::Node,
};
use crate::{
    probe::port::{OpenError, open},
    video::Video,
};
use nalgebra::Point2;
use radio_update::package::Key;
use rand::Rng;
use results::record::{RunRecord, Tracking};
use site::world::World;
use site::{Action, NetworkTable, RadioTable, Scenario, ScenarioError, Site};
use virtual_hardware::{
    executor::{Ended, Executor, Time, times_real_time},
    medium::{Capture, LogDistance, Medium, Propagation},
    random::Root,
};

const SECOND: Time = 1_000_000_000;

/// Time for reports to come in after the last target has ended its walk.
const GRACE: Time = 5 * SECOND;
/// Longest silence of an update that goes on: a boot loader changes images meanwhile, and the node joins again. The PC
/// asks a node that is silent again within 90 s.
const UPDATE: Time = 150 * SECOND;
/// Period with which the flash of chips is read, so that facts that they overwrite later are known too.
const CHIPS_READ: Time = SECOND / 5;

/// The world and where its radios are, for all that move in it.
type SharedWorld = Rc<RefCell<World>>;

/// Options of a run.
#[derive(Default)]
pub struct Options {
    /// So many times real time; as fast as possible if `None`.
    pub speed: Option<f64>,
    /// Run the nodes on emulated nRF52840s.
    pub chips: Option<Chips>,
    /// Stops, at most, to which targets are led after those of their way, as the verdict asks, until
    /// every camera is calibrated and every pose checked.
    pub further_stops: usize,
    /// Nodes take updates by radio that are signed with this key, unless they are emulated chips.
    pub update_key: Option<Key>,
    /// Ends the run early once it is set.
    pub stop: Arc<AtomicBool>,
    /// All frames on the air, for Wireshark. Frames that cannot be written are left out.
    pub pcap: Option<Box<dyn Write>>,
    /// Messages and knowledge of nodes, as text. Lines that cannot be written are left out.
    pub log: Option<Box<dyn Write>>,
}

/// Reason why a real camera cannot be connected.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// There is no camera with this number.
    #[error("the scenario has no camera {0}")]
    NoCamera(u16),
    /// There are fewer networks.
    #[error("the scenario has no network {0}: look at --console, where they are counted from 1")]
    NoNetwork(usize),
    /// The port cannot be opened.
    #[error(transparent)]
    Port(#[from] OpenError),
}

/// Progress of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Simulated seconds.
    pub seconds: f64,
    /// Stops that targets have ended.
    pub stops: usize,
    /// All stops.
    pub of: usize,
    /// Number of calibrated cameras.
    pub calibrated: usize,
    /// All cameras.
    pub cameras: usize,
    /// Nodes that say that they belong to a network.
    pub joined: usize,
    /// All nodes.
    pub nodes: usize,
}

/// A scenario that is put up and can run.
pub struct Simulation {
    scenario: Scenario,
    /// The networks as the file has them, where cameras stand as they are meant to.
    written: Vec<NetworkTable>,
    /// The speed that was given.
    speed: Option<f64>,
    site: Site,
    executor: Executor,
    medium: Medium,
    world: SharedWorld,
    /// The light before all cameras.
    light: Rc<Cell<[f64; 3]>>,
    journal: SharedJournal,
    nodes: Vec<Rc<Node>>,
    /// Index of each node among them, by its number.
    index: HashMap<u16, usize>,
    consoles: Vec<Console>,
    /// Index of each coordinator's console among them, by its number.
    console_index: HashMap<u16, usize>,
    further: further::Further,
    /// Walks that targets have begun.
    walks: u32,
    attacker: attack::Attacker,
    chips: Option<Rc<Pool>>,
    update_key: Option<Key>,
    stop: Arc<AtomicBool>,
    /// Set until the run begins.
    pcap: Option<Box<dyn Write>>,
    trouble: Trouble,
    /// Tracking of objects by each network.
    tracking: Vec<Tracking>,
}

/// Reason why emulated boards cannot go on, once they cannot.
type Trouble = Rc<RefCell<Option<EmulatorError>>>;

impl Simulation {
    /// Puts a scenario up. Nothing has run yet, and nothing been written.
    ///
    /// # Errors
    /// The scenario is not possible.
    pub fn new(scenario: Scenario, options: Options) -> Result<Self, ScenarioError> {
        let (rehearsed, site) = scenario.rehearsed()?;
        let (written, scenario) = (scenario.networks, rehearsed);
        let root = Root(scenario.seed);
        let mut executor = Executor::new();
        if let Some(speed) = options.speed {
            executor.set_pace(times_real_time(speed));
        }
        let clock = executor.clock();
        let medium = Medium::new(&clock, propagation(&scenario), root.seed("medium", 0));
        let world = Rc::new(RefCell::new(site.world.clone()));
        let journal = Rc::new(RefCell::new(Journal::new(clock.clone(), options.log)));
        let trouble = Trouble::default();
        let chips = options.chips.map(|chips| {
            let (medium, journal) = (medium.clone(), journal.clone());
            Pool::new(chips, clock, medium, journal, trouble.clone())
        });
        if let Some(chips) = &chips {
            executor.set_outside(Lockstep(chips.clone()));
        }
        let mut simulation = Self {
            scenario,
            written,
            speed: options.speed,
            site,
            executor,
            medium,
            world,
            light: Rc::new(Cell::new([1.0; 3])),
            journal,
            nodes: Vec::new(),
            index: HashMap::new(),
            consoles: Vec::new(),
            console_index: HashMap::new(),
            further: further::Further::new(options.further_stops),
            walks: 1,
            attacker: attack::Attacker::default(),
            chips,
            update_key: options.update_key,
            stop: options.stop,
            pcap: options.pcap,
            trouble,
            tracking: Vec::new(),
        };
        simulation.put_up(root)?;
        events::schedule(&mut simulation);
        Ok(simulation)
    }

    fn put_up(&mut self, root: Root) -> Result<(), ScenarioError> {
        let key = SiteKey::new(KEY_INDEX, secret(root));
        let configs = site::configs(&self.scenario, key)?;
        let file = Rc::new(self.scenario.clone());
        for (number, (network, configs)) in self.site.networks.iter().zip(configs).enumerate() {
            let coordinator = Node::coordinator(self, network, configs.coordinator, root);
            let cameras = network.cameras.len();
            let clock = self.executor.clock();
            let console = Console::new(&coordinator, cameras, clock, self.journal.clone());
            console.tell_in(&self.scenario.unit);
            for (camera, config) in network.cameras.iter().zip(configs.cameras) {
                let node = Node::camera(self, camera, config, root);
                self.nodes.push(node);
            }
            for (target, config) in network.targets.iter().zip(configs.targets) {
                let node = Node::target(self, target, config, root);
                let orders = self.further.orders_of(target.id);
                let (told, table) = (file.clone(), number);
                let told_as = move |place| told.told_place(told.networks.get(table)?, place);
                let pc = (console.clone(), Box::new(told_as) as walk::ToldAs);
                let walk = walk::Walk::new(self, target, &node, pc, orders, root);
                self.executor.spawn(walk.run());
                self.nodes.push(node);
            }
            self.executor.spawn(console.clone().listen());
            self.nodes.push(coordinator);
            self.consoles.push(console);
        }
        for (place, node) in self.nodes.iter().enumerate() {
            self.index.entry(node.id()).or_insert(place);
        }
        let consoles = self.consoles.iter().enumerate();
        self.console_index = consoles.map(|(place, it)| (it.id(), place)).collect();
        // Targets are switched on by their carriers.
        for node in self.nodes.iter().filter(|node| !node.is_target()) {
            node.switch_on();
        }
        Ok(())
    }

    /// Puts a real camera on a serial port in the place of a node's simulated one, before anything
    /// has run. From then on time passes in real time.
    ///
    /// # Errors
    /// There is no such camera, or the port cannot be opened.
    pub fn connect_camera(&mut self, node: u16, path: &str) -> Result<(), ConnectError> {
        let baud = match self.config(node).map(|config| &config.settings().role) {
            Some(RoleConfig::Camera(config)) => config.baud,
            _ => return Err(ConnectError::NoCamera(node)),
        };
        let port = open(path, baud, Duration::ZERO)?;
        if let Some(node) = self.node(node) {
            node.connect(port);
        }
        self.executor.set_pace(times_real_time(1.0));
        Ok(())
    }

    /// Has a node's camera see a video in the place of the simulated world, from time 0 of the run on.
    /// Nothing has run yet.
    ///
    /// # Errors
    /// There is no such camera.
    pub fn show_video(&mut self, node: u16, video: Video) -> Result<(), ConnectError> {
        let has_camera = self.config(node).map(|config| &config.settings().role);
        match (has_camera, self.node(node)) {
            (Some(RoleConfig::Camera(_)), Some(camera)) => {
                camera.show(video);
                Ok(())
            }
            _ => Err(ConnectError::NoCamera(node)),
        }
    }

    /// Connects a terminal to the line of a network's coordinator, before anything has run; networks
    /// are counted from 1. It shows the coordinator's messages to its PC, and typed bytes go to the
    /// coordinator. Unless a speed was given, time passes in real time from then on.
    ///
    /// # Errors
    /// There is no such network.
    pub fn connect_console(
        &mut self,
        network: usize,
        terminal: impl Terminal + 'static,
    ) -> Result<(), ConnectError> {
        let number = network.checked_sub(1);
        let console = number.and_then(|number| self.consoles.get(number));
        console
            .ok_or(ConnectError::NoNetwork(network))?
            .connect(Box::new(terminal));
        if self.speed.is_none() {
            self.executor.set_pace(times_real_time(1.0));
        }
        Ok(())
    }

    /// Runs to the end: until every target has walked its way and all is said, emulated boards
    /// are in [trouble](Self::trouble), or it is [stopped](Options::stop).
    ///
    /// `progress` is called about ten times in a simulated minute.
    ///
    /// # Panics
    /// A node's firmware loops without time passing.
    pub fn run(&mut self, progress: impl FnMut(Progress)) -> RunRecord {
        self.run_watched(6 * SECOND, progress, |_| ())
    }

    /// As [`run`](Self::run), and calls `look` this often, in nanoseconds; it may also
    /// [do](Self::act) something.
    ///
    /// # Panics
    /// A node's firmware loops without time passing.
    pub fn run_watched(
        &mut self,
        every: Time,
        mut progress: impl FnMut(Progress),
        mut look: impl FnMut(&mut Self),
    ) -> RunRecord {
        let begun = std::time::Instant::now();
        if let Some(file) = self.pcap.take()
            && let Ok(capture) = Capture::new(file)
        {
            self.medium.watch(capture);
        }
        let targets: usize = { self.site.networks.iter() }
            .map(|network| network.targets.len())
            .sum();
        let (journal, trouble) = (self.journal.clone(), self.trouble.clone());
        let stop = self.stop.clone();
        let is_over = move || trouble.borrow().is_some() || stop.load(Ordering::Relaxed);
        let ended = || journal.borrow().walked == targets || is_over();
        let mut limit = self.limit();
        loop {
            let next = self.executor.clock().time() + 6 * SECOND;
            self.run_looking(next, every, &ended, &mut look);
            progress(self.progress());
            if !ended() && self.executor.clock().time() < limit {
                continue;
            }
            let mut end = self.executor.clock().time() + GRACE;
            while self.executor.clock().time() < end && !is_over() {
                self.run_looking(end, every, &is_over, &mut look);
                end = end.max(self.update_ends());
            }
            progress(self.progress());
            self.look_into_chips();
            let mut takes = further::lead_on(self);
            if takes.is_none() && self.walks < self.scenario.walk.walks && !is_over() {
                let period = events::nanoseconds(self.scenario.walk.every_s);
                let begin = period.saturating_mul(self.walks.into());
                self.run_looking(begin, every, &is_over, &mut look);
                takes = Some(further::walk_again(self));
            }
            match takes {
                Some(takes) if !is_over() => limit = self.executor.clock().time() + takes,
                _ => break,
            }
        }
        if let Some(chips) = &self.chips {
            chips.end();
        }
        for node in &self.nodes {
            node.read_memory();
        }
        outcome::record(self, begun.elapsed().as_secs_f64(), true)
    }

    /// Time until which an update by radio is under way, as far as consoles know.
    fn update_ends(&self) -> Time {
        let last = self.consoles.iter().filter_map(Console::updated).max();
        // The PC waits in real time.
        let silence = UPDATE as f64 * self.speed.unwrap_or(1.0).max(1.0);
        last.map_or(0, |last| last + silence as Time)
    }

    /// Runs until a time or a condition; calls `look` now and then, and at the end.
    fn run_looking(
        &mut self,
        end: Time,
        every: Time,
        condition: &dyn Fn() -> bool,
        look: &mut dyn FnMut(&mut Self),
    ) {
        loop {
            let next = end.min(self.executor.clock().time() + every.max(1));
            self.run_until(next, condition);
            look(self);
            if condition() || next >= end {
                break;
            }
        }
    }

    /// Runs until a time or a condition. The flash of chips is read at instants that depend on neither, so that
    /// an onlooker's looks change nothing.
    fn run_until(&mut self, end: Time, condition: &dyn Fn() -> bool) {
        loop {
            let now = self.executor.clock().time();
            let next = match self.chips {
                Some(_) => end.min((now / CHIPS_READ + 1) * CHIPS_READ),
                None => end,
            };
            let how = self.executor.run_until_time_or(next, condition);
            assert!(
                !matches!(how, Ended::Stuck(_)),
                "tasks wake one another for ever"
            );
            let is_over = condition();
            if is_over || next.is_multiple_of(CHIPS_READ) {
                self.look_into_chips();
            }
            if is_over || next >= end {
                break;
            }
        }
    }

    /// Reads the flash of all chips.
    fn look_into_chips(&self) {
        if let Some(chips) = &self.chips
            && chips.look()
        {
            self.nodes.iter().for_each(|node| node.read_memory());
        }
    }

    /// Simulated time, seconds.
    pub fn seconds(&self) -> f64 {
        self.executor.clock().time() as f64 * 1e-9
    }

    /// Reason why emulated boards could not go on, if so: the record ends before that.
    pub fn trouble(&self) -> Option<EmulatorError> {
        self.trouble.take()
    }

    /// Configuration of a node.
    pub fn config(&self, id: u16) -> Option<&CheckedConfig> {
        self.node(id).map(|node| node.config())
    }

    /// Facts that an emulated board's role has written down, in the order of its records. Empty for
    /// other nodes.
    pub fn memory(&self, id: u16) -> Vec<Fact> {
        self.node(id).map(|node| node.memory()).unwrap_or_default()
    }

    /// Summary of emulated chips since they last had power, by their nodes' numbers, once the simulation
    /// has run.
    pub fn chips(&self) -> BTreeMap<u16, outside::End> {
        let nodes = self.nodes.iter();
        nodes
            .filter_map(|node| Some((node.id(), node.end()?)))
            .collect()
    }

    /// Last reports of cameras to their coordinators, by the cameras' numbers.
    pub fn reports(&self) -> BTreeMap<u16, Report> {
        let cameras = self.nodes.iter().map(|node| node.id());
        cameras.filter_map(|id| self.report(id)).collect()
    }

    /// The same, but only of cameras of which something was told since the last call.
    pub fn new_reports(&self) -> BTreeMap<u16, Report> {
        let told = self.journal.borrow_mut().take_told();
        told.into_iter().filter_map(|id| self.report(id)).collect()
    }

    /// The first coordinator's report, if several tell of the same camera.
    fn report(&self, id: u16) -> Option<(u16, Report)> {
        let journal = self.journal.borrow();
        let consoles = { journal.tellers(id) }.filter_map(|id| self.console_index.get(&id));
        let mut consoles: Vec<usize> = consoles.copied().collect();
        consoles.sort_unstable();
        let mut consoles = consoles.into_iter().map(|place| &self.consoles[place]);
        let report = consoles.find_map(|console| console.view().member(id)?.report)?;
        Some((id, report))
    }

    /// Limit of the run: no walk takes longer than all its patience, and all rests.
    fn limit(&self) -> Time {
        let rests = self.scenario.events.iter().map(|event| match event.action {
            Action::Rest { for_s, .. } => events::nanoseconds(for_s),
            _ => 0,
        });
        let rests: Time = rests.sum();
        let longest = self
            .site
            .networks
            .iter()
            .flat_map(|network| &network.targets)
            .map(|target| self.patience(&target.stops));
        longest.max().unwrap_or_default() + rests
    }

    /// Longest time that a walk may take.
    fn patience(&self, stops: &[Point2<f64>]) -> Time {
        let walk = &self.scenario.walk;
        let way: f64 = { stops.windows(2) }
            .map(|leg| (leg[1] - leg[0]).norm())
            .sum();
        let seconds = way / walk.speed + (stops.len() + 1) as f64 * (walk.patience_s + 10.0);
        (seconds * 1e9) as Time + 120 * SECOND
    }

    /// Number of stops to which targets were led after those of their way.
    pub fn further_stops(&self) -> usize {
        self.further.made()
    }

    /// Reason why targets were led to no more stops, if they were to be led on.
    pub fn further_end(&self) -> Option<FurtherEnd> {
        self.further.end()
    }

    fn progress(&self) -> Progress {
        let journal = self.journal.borrow();
        Progress {
            seconds: self.seconds(),
            stops: journal.stops_ended,
            of: self
                .site
                .networks
                .iter()
                .flat_map(|network| &network.targets)
                .map(|target| target.stops.len())
                .sum::<usize>()
                + self.further.made(),
            calibrated: self
                .consoles
                .iter()
                .map(|console| console.view().calibrated())
                .sum(),
            cameras: self.world.borrow().cameras().len(),
            joined: { self.nodes.iter() }
                .filter(|node| node.panel.shown.get().joined)
                .count(),
            nodes: self.nodes.len(),
        }
    }

    fn node(&self, id: u16) -> Option<&Rc<Node>> {
        self.nodes.get(*self.index.get(&id)?)
    }

    /// Knowledge about a node.
    fn entry(&self, id: u16) -> Ref<'_, NodeEntry> {
        Ref::map(self.journal.borrow(), |journal| journal.entry(id))
    }
}

/// The index of the simulation's key.
const KEY_INDEX: u8 = 1;

/// The simulation's own site key, drawn from its seed: it is no real site's key.
fn secret(root: Root) -> [u8; 16] {
    let mut secret = [0; 16];
    root.stream("site key", 0).fill_bytes(&mut secret);
    secret
}

fn propagation(scenario: &Scenario) -> Propagation {
    match scenario.radio {
        RadioTable::UnitDisk { range, loss } => Propagation::UnitDisk { range, loss },
        RadioTable::LogDistance {
            exponent,
            shadowing_db,
            loss,
        } => {
            let (metres, unit_metres) = (LogDistance::default(), scenario.metres_per_unit());
            Propagation::LogDistance(LogDistance {
                // The loss at one metre, converted to one unit.
                loss_at_one: metres.loss_at_one + 10.0 * exponent * unit_metres.log10(),
                exponent,
                shadowing: shadowing_db,
                loss,
                ..metres
            })
        }
    }
}

/// Position of a radio.
fn antenna(place: Point2<f64>) -> [f64; 2] {
    place.into()
}
