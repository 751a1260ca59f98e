//! The image that is flashed, from `NODE_IMAGE`, with the configuration pages of a site.

mod buttons;
mod debugging;
mod drift;
mod faults;
mod sensors;
mod update;

use std::{
    collections::{BTreeMap, VecDeque},
    env,
    f64::consts::FRAC_PI_2,
    fs,
    ops::Range,
    path::PathBuf,
    sync::Arc,
};

use cmucam2_emulator::{Configuration, Emulator, Scene};
use defmt_decoder::{DecodeError, Table};
use embassy_futures::block_on;
use node_firmware::{
    config::{CheckedConfig, SiteKey, page},
    console::{FRAME_MAX, Frames, FromPc, ToPc, encode},
    facts::{self, Fact, FactStore},
};
use nrf52840_emulator::{
    Deed, Input, MEMORY, Network, Node, Outcome, Soc,
    device::{self, Motion, World},
    energy::Current,
    peripheral::{Arrival, Frame, Held, Peer},
    run,
};
use site::{NetworkConfigs, Overrides, Scenario, Site};
use test_support::walker::{Act, RATE, Walker};
use virtual_hardware::{
    flash::{self, Flash},
    random::Root,
};

pub(crate) const S: u64 = 1_000_000_000;
const MS: u64 = 1_000_000;
/// Address of the configuration page.
const PAGE: u64 = 0xf_f000;
/// 40 dB above the least that is heard.
pub(crate) const LEVEL: u8 = 40;

fn image() -> PathBuf {
    let image = env::var_os("NODE_IMAGE").expect("NODE_IMAGE is not set");
    image.into()
}

/// A site as it is rehearsed, of one network: its world, and the configuration of its nodes.
pub(crate) struct Rehearsal {
    site: Site,
    pub(crate) configs: NetworkConfigs,
}

impl Rehearsal {
    fn of(name: &str) -> Self {
        let scenario = Scenario::load(name, &Overrides::default()).unwrap();
        let (scenario, site) = scenario.rehearsed().unwrap();
        let configs = site::configs(&scenario, SiteKey::new(1, *b"a key of no site")).unwrap();
        let configs = configs.into_iter().next().unwrap();
        Self { site, configs }
    }

    fn coordinator(&self) -> Node {
        node(&self.configs.coordinator)
    }

    /// A CMUcam2 that sees the target at its first stop, if it can.
    pub(crate) fn eye(&self, number: usize) -> Camera {
        let camera = &self.site.networks[0].cameras[number];
        let mut scene = Scene::default();
        let view = self.site.world.look(camera.index);
        view.paint([110; 3], &mut scene.objects);
        self.eye_before(number, scene)
    }

    /// A CMUcam2 that sees this.
    fn eye_before(&self, number: usize, scene: Scene) -> Camera {
        let camera = &self.site.networks[0].cameras[number];
        let configuration = Configuration {
            sensor: camera.sensor,
            baud: camera.baud,
            host_baud: camera.baud,
            seed: camera.id.into(),
            ..Configuration::default()
        };
        Camera(Emulator::new(configuration, scene))
    }

    /// A camera node with its CMUcam2.
    fn camera(&self, number: usize) -> Node {
        Node {
            peer: Some(Box::new(self.eye(number))),
            ..node(&self.configs.cameras[number])
        }
    }

    /// A target with its sensors, in a world.
    fn target_in(&self, world: &Arc<dyn World>) -> Node {
        Node {
            chips: device::step_sensor(world, 1),
            ..node(&self.configs.targets[0])
        }
    }

    /// A target that lies there.
    fn target(&self) -> Node {
        self.target_in(&(Arc::new(Motion::default()) as Arc<dyn World>))
    }

    /// The coordinator, the cameras, and the target.
    fn nodes(&self) -> Vec<Node> {
        let cameras = (0..self.configs.cameras.len()).map(|number| self.camera(number));
        [self.coordinator()]
            .into_iter()
            .chain(cameras)
            .chain([self.target()])
            .collect()
    }
}

pub(crate) fn lab() -> Rehearsal {
    Rehearsal::of("lab")
}

/// A node as it comes from `host-sim provision`, with blank flash.
fn node(config: &CheckedConfig) -> Node {
    let mut page = vec![0; page::PAGE_MAX];
    page::encode(config, &mut page).unwrap();
    Node {
        image: image(),
        flash: vec![(PAGE, page)],
        ..Node::default()
    }
}

/// The coordinator after its power has gone.
fn again(lab: &Rehearsal, before: &Outcome) -> Node {
    Node {
        flash: before.flash.clone(),
        ..lab.coordinator()
    }
}

/// A CMUcam2 that was switched on with its node.
#[derive(Debug)]
pub(crate) struct Camera(Emulator);

impl Peer for Camera {
    fn receive(&mut self, byte: u8, at: u64) {
        self.0.receive(byte, at);
    }

    fn transmit(&mut self, now: u64) -> Option<u8> {
        self.0.transmit(now).map(|(_, byte)| byte)
    }

    fn next(&self) -> Option<u64> {
        self.0.next_deadline()
    }
}

fn alone(node: Node, time: u64) -> Outcome {
    let (mut outcomes, _) = run(vec![node], time, |_, _| None).unwrap();
    outcomes.pop().unwrap()
}

fn everybody(_: &Frame, _: usize) -> Option<u8> {
    Some(LEVEL)
}

/// Checks the conditions that hold of every run.
fn in_order(outcome: &Outcome) {
    assert_eq!(log(outcome), [""; 0]);
    assert_eq!(outcome.forbidden, []);
    assert_eq!(outcome.unmapped, [""; 0]);
}

/// Lines that the image logged.
fn log(outcome: &Outcome) -> Vec<String> {
    let image = fs::read(image()).unwrap();
    let table = Table::parse(&image).unwrap().unwrap();
    let mut decoder = table.new_stream_decoder();
    decoder.received(&outcome.log);
    let mut lines = Vec::new();
    loop {
        match decoder.decode() {
            Ok(frame) => lines.push(frame.display(false).to_string()),
            // A restart tears a message that is being sent.
            Err(DecodeError::Malformed) => {}
            Err(DecodeError::UnexpectedEof) => return lines,
        }
    }
}

fn says(outcome: &Outcome, words: &str) -> bool {
    log(outcome).iter().any(|line| line.contains(words))
}

/// Messages of a coordinator to its PC.
fn told(outcome: &Outcome) -> Vec<ToPc> {
    let mut frames = Frames::default();
    let bytes = outcome.line.iter().map(|&(_, byte)| byte);
    bytes.filter_map(|byte| frames.push(byte)).collect()
}

/// Facts that a node has written down.
fn facts(outcome: &Outcome, owner: u32) -> Vec<Fact> {
    let (_, bytes) = outcome
        .flash
        .iter()
        .find(|(at, _)| *at == MEMORY.start)
        .unwrap();
    let pages = facts::BYTES as usize / flash::PAGE;
    let flash: Flash = Flash::without_time(pages, Root(0).stream("copy", 0));
    flash
        .bytes_mut()
        .copy_from_slice(&bytes[..pages * flash::PAGE]);
    let mut all = Vec::new();
    block_on(async {
        let mut memory = FactStore::open(flash, 0..facts::BYTES, owner)
            .await
            .unwrap();
        memory.recall(|fact| all.push(*fact)).await.unwrap();
    });
    all
}

/// The same chips do the same.
fn are_equal(ones: &[Outcome], others: &[Outcome]) {
    for (one, other) in ones.iter().zip(others) {
        assert_eq!(
            (one.instructions, &one.line, &one.log, &one.flash),
            (other.instructions, &other.line, &other.log, &other.flash)
        );
    }
}

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_blank_board_starts() {
    let lab = lab();
    let first = alone(lab.coordinator(), 20 * S);
    in_order(&first);
    // UICR is written once, and takes a restart (Product Specification, "UICR").
    assert!(first.resets.len() <= 1, "{:?}", first.resets);
    // Of the pages in use, only those that something was written to.
    assert!(first.erased.len() <= 4, "{:x?}", first.erased);
    assert!(first.written > 0 && first.fed > 5);
    // With its memory it starts at once, and erases nothing.
    let second = alone(again(&lab, &first), 20 * S);
    in_order(&second);
    assert_eq!(
        (second.resets.as_slice(), second.erased.as_slice()),
        ([].as_slice(), [].as_slice())
    );
}

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_small_network_does_the_same_each_time() {
    let lab = lab();
    let nodes = || vec![lab.coordinator(), lab.camera(0), lab.target()];
    let (outcomes, frames) = run(nodes(), 10 * S, everybody).unwrap();
    let (repeated, same) = run(nodes(), 10 * S, everybody).unwrap();
    assert!(frames.len() > 20, "{}", frames.len());
    assert_eq!(frames, same);
    are_equal(&outcomes, &repeated);
}

/// Blank flash to a network whose cameras look for the target; `NODE_SITE` is another site.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn the_nodes_of_a_site_join() {
    let name = env::var("NODE_SITE").unwrap_or_else(|_| "lab".into());
    let seconds = env::var("NODE_SECONDS").map_or(20, |seconds| seconds.parse().unwrap());
    let site = Rehearsal::of(&name);
    let begun = std::time::Instant::now();
    let (outcomes, frames) = run(site.nodes(), seconds * S, everybody).unwrap();
    println!(
        "{} nodes of {name}, {seconds} s in {:.1} s, {} frames",
        outcomes.len(),
        begun.elapsed().as_secs_f64(),
        frames.len()
    );
    println!("radio received and sent, ms; instructions; RAM untouched; restarts");
    for outcome in &outcomes {
        println!(
            "{:?} {} {} {:?}",
            outcome.radio_on.map(|on| on / MS),
            outcome.instructions,
            outcome.untouched,
            outcome.resets,
        );
        in_order(outcome);
        assert_eq!(outcome.overruns, 0);
    }
    // Every node but the coordinator is a member.
    let members: BTreeMap<_, _> = { told(&outcomes[0]).into_iter() }
        .filter_map(|message| match message {
            ToPc::Member { address, hello } => Some((address, hello)),
            _ => None,
        })
        .collect();
    assert_eq!(members.len(), outcomes.len() - 1, "{members:?}");
    // After their set-up cameras are asked for the ball again and again: they answer.
    for camera in &outcomes[1..outcomes.len() - 1] {
        let line: Vec<u8> = camera.line.iter().map(|&(_, byte)| byte).collect();
        let line = String::from_utf8(line).unwrap();
        assert!(line.matches("\rTC").count() > 2, "{line:?}");
    }
}

/// Two strangers send one frame after the other, so that there is always one in its middle. They are too weak
/// for their energy to be found: it takes the correlator, which the driver leaves off.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn nobody_sends_into_a_weak_carrier() {
    // The coordinator has begun, the camera is about to join.
    const BUSY: Range<u64> = 900 * MS..4 * S;
    let lab = lab();
    let mut network = Network::default();
    let nodes = [lab.coordinator(), lab.camera(0)];
    for (number, node) in nodes.into_iter().enumerate() {
        network.switch_on(number, node, 0);
    }
    let stranger = |node, start, frequency| Frame {
        start,
        node,
        frequency,
        power: 0,
        psdu: vec![0; 127],
    };
    let mut next = [BUSY.start, BUSY.start + 2 * MS].map(|start| stranger(90, start, 0));
    next[1].node = 91;
    let mut starts = Vec::new();
    while network.reached() < BUSY.end + 10 * S {
        let until = (network.reached() + MS).min(BUSY.end + 10 * S);
        for (_, number, deed) in network.run(until) {
            if let Deed::Sends(frame) = deed {
                next.iter_mut()
                    .for_each(|next| next.frequency = frame.frequency);
                starts.push(frame.start);
                network.input(1 - number, Input::Frame(frame, LEVEL.into()));
            }
        }
        for next in &mut next {
            if next.start < network.reached() + 2 * MS && next.start < BUSY.end {
                for to in 0..2 {
                    let arrival = Arrival {
                        stands_out: false,
                        ..5.into()
                    };
                    network.input(to, Input::Frame(next.clone(), arrival));
                }
                next.start = next.end();
            }
        }
    }
    let sent = |range: Range<u64>| starts.iter().filter(|at| range.contains(at)).count();
    assert!(sent(0..BUSY.start) > 0);
    // Not while the second stranger has not begun.
    assert_eq!(sent(BUSY.start + 5 * MS..BUSY.end), 0);
    assert!(sent(BUSY.end..BUSY.end + 10 * S) > 0);
    for number in 0..2 {
        in_order(&network.switch_off(number).unwrap().unwrap());
    }
}

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_stuck_radio_restarts_the_node_at_once() {
    const AT: u64 = S;
    let faults: fn(&mut Soc) = |soc| soc.radio.model.sticks_at = Some(AT);
    let lab = lab();
    let camera = Node {
        faults: Some(faults),
        ..lab.camera(0)
    };
    let nodes = vec![lab.coordinator(), camera];
    let (outcomes, frames) = run(nodes, 10 * S, everybody).unwrap();
    println!("{:?}", outcomes[1].resets);
    let stuck = frames
        .iter()
        .filter(|frame| frame.node == 1)
        .find(|frame| frame.end() >= AT);
    let stuck = stuck.unwrap().end();
    let restart = outcomes[1]
        .resets
        .iter()
        .find(|reset| reset.at > AT)
        .unwrap();
    assert_eq!(restart.by, "Core");
    let dead = restart.at - stuck;
    println!("restarted after {} ms", dead / MS);
    assert!(dead < 600 * MS, "{dead}");
    assert!(says(&outcomes[1], "the radio is stuck"));
    // And goes on.
    assert!(
        frames
            .iter()
            .any(|frame| frame.node == 1 && frame.start > restart.at)
    );
}

/// The data line of the sensors' bus is low, until the clock has fallen so often if that ends it.
fn hold(soc: &mut Soc, during: Range<u64>, clocks: Option<u8>) {
    soc.hold_bus(Held {
        during,
        data: 26,
        clock: 27,
        clocks,
    });
}

/// For some time, from power-on until it is clocked free, or for ever.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_bus_that_is_held_low_stops_nothing_else() {
    type Fault = fn(&mut Soc);
    let faults: [(Fault, Range<u64>); 4] = [
        (|soc| hold(soc, 5 * S..8 * S, None), 300..u64::MAX),
        (|soc| hold(soc, 5 * S..u64::MAX, Some(9)), 300..u64::MAX),
        (|soc| hold(soc, 0..u64::MAX, Some(9)), 300..u64::MAX),
        (|soc| hold(soc, 0..u64::MAX, None), 0..1),
    ];
    let lab = lab();
    for (number, (faults, transfers)) in faults.into_iter().enumerate() {
        let target = Node {
            faults: Some(faults),
            ..lab.target()
        };
        let (outcomes, frames) = run(vec![lab.coordinator(), target], 60 * S, everybody).unwrap();
        let target = &outcomes[1];
        // The start after UICR was written, and no other.
        assert_eq!(target.resets.len(), 1, "{number}: {:?}", target.resets);
        assert!(
            frames
                .iter()
                .any(|frame| frame.node == 1 && frame.start > 8 * S)
        );
        // Some 40 a second, before and after.
        assert!(
            transfers.contains(&target.transfers),
            "{number}: {}",
            target.transfers
        );
    }
}

/// It waits until one is flashed, and does not restart again and again.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_board_without_a_configuration_stands_by() {
    let node = Node {
        flash: Vec::new(),
        ..lab().coordinator()
    };
    let outcome = alone(node, 60 * S);
    // The one restart is for the pins' voltage.
    assert_eq!(outcome.resets.len(), 1, "{:?}", outcome.resets);
    assert!(outcome.fed > 20, "{}", outcome.fed);
}

/// Currents of nodes after they have joined: for `NODE_SECONDS`, of `NODE_SITE`.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn what_nodes_draw() {
    /// Two alkaline cells of size AA, mAh.
    const BATTERY: f64 = 2_500.0;
    let site = Rehearsal::of(&env::var("NODE_SITE").unwrap_or_else(|_| "lab".into()));
    let seconds = env::var("NODE_SECONDS").map_or(60, |seconds| seconds.parse().unwrap());
    let (outcomes, frames) = run(site.nodes(), seconds * S, everybody).unwrap();
    println!(
        "| node | receives | sends | runs | UART waits | mean, mA | a battery lasts | listening 10 % | 1 % | and no UART waits |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for (number, outcome) in outcomes.iter().enumerate() {
        let role = match number {
            0 => "coordinator",
            last if last == outcomes.len() - 1 => "target",
            _ => "camera",
        };
        let own = frames.iter().filter(|frame| frame.node == number);
        let power = own.map(|frame| frame.power).max().unwrap();
        let current = Current::of(outcome, power);
        let share = |time: u64| 100.0 * time as f64 / outcome.powered as f64;
        let days = |current: Current| current.hours(BATTERY) / 24.0;
        println!(
            "| {role} | {:.2} % | {:.3} % | {:.2} % | {:.2} % | {:.2} | {:.0} days | {:.0} days | {:.0} days | {:.0} days |",
            share(outcome.radio_on[0]),
            share(outcome.radio_on[1]),
            share(outcome.instructions * 1_000 / 64),
            share(outcome.uart_on[0]),
            current.total(),
            days(current),
            days(current.listening(0.1)),
            days(current.listening(0.01)),
            days(current.listening(0.01).without_waiting_line(outcome)),
        );
        // The radio is on all the time, but while the chip starts.
        let on: u64 = outcome.radio_on.iter().sum();
        assert!(
            on <= outcome.powered && on + 3 * S > outcome.powered,
            "{role}"
        );
        assert!((6.0..9.0).contains(&current.total()), "{role}: {current:?}");
    }
}

/// The same node in a network that sleeps while it is quiet.
fn sleeping(config: &CheckedConfig) -> Node {
    let mut config = config.settings().clone();
    config.sleeps = true;
    node(&config.check().unwrap())
}

/// Bytes that a PC sends from a time on, one after the other.
#[derive(Debug)]
struct Line {
    next: u64,
    bytes: VecDeque<u8>,
}

impl Peer for Line {
    fn receive(&mut self, _: u8, _: u64) {}

    fn transmit(&mut self, now: u64) -> Option<u8> {
        if now < self.next {
            return None;
        }
        // Of 115,200 baud.
        self.next = now + 86_806;
        self.bytes.pop_front()
    }

    fn next(&self) -> Option<u64> {
        (!self.bytes.is_empty()).then_some(self.next)
    }
}

/// A camera of a quiet network listens for half a percent of the time, and its camera sleeps; a command of the PC wakes
/// both.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_node_of_a_quiet_network_sleeps_until_it_is_woken() {
    const ASKED: u64 = 290 * S;
    const END: u64 = 300 * S;
    let lab = lab();
    let mut buffer = [0; FRAME_MAX];
    let asks = encode(&FromPc::Sightings(1), &mut buffer).unwrap();
    let nodes = |begins| {
        let coordinator = Node {
            peer: Some(Box::new(Line {
                next: begins,
                bytes: asks.iter().copied().collect(),
            })),
            ..sleeping(&lab.configs.coordinator)
        };
        let eye = Node {
            peer: Some(Box::new(lab.eye(0))),
            ..sleeping(&lab.configs.cameras[0])
        };
        vec![coordinator, eye]
    };
    let camera = |until: u64, begins: u64| {
        let (mut outcomes, frames) = run(nodes(begins), until, everybody).unwrap();
        for outcome in &outcomes {
            in_order(outcome);
        }
        (outcomes.pop().unwrap(), frames)
    };
    // Asleep from the hundred and fortieth second on.
    let (before, _) = camera(150 * S, END);
    let (asleep, _) = camera(ASKED, END);
    let night = Outcome {
        powered: asleep.powered - before.powered,
        radio_on: [0, 1].map(|way| asleep.radio_on[way] - before.radio_on[way]),
        uart_on: [0, 1].map(|way| asleep.uart_on[way] - before.uart_on[way]),
        clock_on: [0, 1].map(|clock| asleep.clock_on[clock] - before.clock_on[clock]),
        instructions: asleep.instructions - before.instructions,
        ..Outcome::default()
    };
    let share = night.radio_on[0] as f64 / night.powered as f64;
    let current = Current::of(&night, 0);
    println!(
        "{:.2} mA are drawn by a camera that sleeps; it listens for {:.2} %: {current:?}",
        current.total(),
        100.0 * share,
    );
    assert!((0.004..0.01).contains(&share), "{share}");
    // Its UART is off, with all that needs the clock for it: what is left is that of a sleepy device.
    assert_eq!(night.uart_on, [0, 0]);
    assert_eq!(night.clock_on[0], 0);
    assert!((0.03..0.05).contains(&current.total()), "{current:?}");
    // A CMUcam2 would take noise for bytes, which wake it.
    assert!(!asleep.floats);
    let line: Vec<u8> = asleep.line.iter().map(|&(_, byte)| byte).collect();
    assert!(String::from_utf8_lossy(&line).contains("\rSD"));
    let (woken, frames) = camera(END, ASKED);
    assert!(woken.radio_on[0] > asleep.radio_on[0] + 5 * S);
    let answers = frames
        .iter()
        .filter(|frame| frame.node == 1 && frame.start > ASKED);
    let first = answers.map(|frame| frame.start).min().unwrap();
    println!("it answers after {} ms", (first - ASKED) / MS);
    assert!(first < ASKED + 2_500 * MS, "{first}");
    // The camera starts anew.
    let times = woken.line.iter();
    assert!(times.filter(|(at, _)| *at > ASKED).count() > 10);
}

/// Sensors of the target as its carrier wears them: a reading lasts until the next one.
#[derive(Debug)]
struct Worn(Vec<Motion>);

impl Worn {
    fn by(walker: &Walker) -> Self {
        let readings = walker.readings.iter();
        let motion = readings.map(|reading| Motion {
            acceleration: reading.acceleration.into(),
            angular_rate: reading.angular_rate.into(),
            field: reading.magnetic_field.unwrap().into(),
        });
        Self(motion.collect())
    }

    fn ends(&self) -> u64 {
        self.0.len() as u64 * S / RATE as u64
    }
}

impl World for Worn {
    fn at(&self, now: u64) -> Motion {
        let place = (now as f64 / S as f64 * RATE) as usize;
        self.0[place.min(self.0.len() - 1)]
    }
}

/// Each step is felt through I2C, FIFO and filter: of twice as many the way is twice as long.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_target_counts_its_carriers_steps() {
    let lab = lab();
    let walked = |steps| -> ([f64; 2], f64) {
        let mut walker = Walker::new(100);
        walker.act(&[Act::Stand(12.0), Act::Walk(steps, 0.0), Act::Stand(12.0)]);
        let world = Worn::by(&walker);
        let ends = world.ends();
        let target = lab.target_in(&(Arc::new(world) as Arc<dyn World>));
        let (outcomes, _) = run(vec![lab.coordinator(), target], ends, everybody).unwrap();
        outcomes.iter().for_each(in_order);
        let facts = facts(&outcomes[1], lab.configs.targets[0].settings().owner());
        let walk = facts.iter().find_map(|fact| match fact {
            Fact::Walk(walk) => Some(*walk),
            _ => None,
        });
        let place = walk.unwrap().place.position();
        // Headings are counted from magnetic east.
        let facing = walker.facing - (walker.north - FRAC_PI_2);
        let (x, y) = (f64::from(place.x), f64::from(place.y));
        let (sin, cos) = facing.sin_cos();
        (
            [x * cos + y * sin, y * cos - x * sin],
            walker.position.norm(),
        )
    };
    assert_eq!(walked(0).0, [0.0, 0.0]);
    let ([once, across], way) = walked(24);
    let (twice, _) = walked(48);
    println!("{once} m of {way} m, {across} m beside; twice: {twice:?}");
    // It has not been told how long the steps of this person are.
    assert!((0.75..1.25).contains(&(once / way)), "{once} m of {way} m");
    assert!(across.abs() < 0.1 * way, "{across} m beside");
    assert!(
        (twice[0] / once - 2.0).abs() < 0.08,
        "{twice:?} m after {once} m"
    );
}
