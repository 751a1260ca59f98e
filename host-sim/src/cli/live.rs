//! `host-sim live`

use std::{
    collections::VecDeque,
    fs::File,
    io::{BufRead, BufReader},
    net::{IpAddr, Ipv4Addr, SocketAddr},
    path::Path,
    process::{Command as Process, ExitCode, Stdio},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::Receiver,
    },
    thread,
    time::{Duration, Instant},
};

use answers::record::event::{self, CommandState, Event, Looker, ObjectPlace, What};
use anyhow::{Context, bail, ensure};
use clap::Args;
use host_sim::{
    console::{
        command::{command_name, parse_command},
        session::{Session, Wish},
    },
    live::{About, Command, Server, serve},
    network::{Onlooker, Options, Simulation},
    probe::port::{OpenError, Port, PortError},
};
use node_firmware::limits::CONSOLE_BAUD;
use site::{Action, BUILT_IN, Overrides, Purpose, Scenario};
use virtual_bench::executor::times_real_time;

use super::{
    console::read_site,
    interrupt,
    lines::{exchange, record},
    print, tell, values,
};

/// Shows a network as it calibrates itself, in a browser: a simulation, a real network, or one that was
/// recorded.
///
/// Prints where to look; everything stays on this computer. Goes on until Ctrl-C.
#[derive(Args)]
#[command(after_help = EPILOGUE)]
pub(super) struct Arguments {
    /// `thesis-13`, `lab`, `grid`, `office`, the file of a site, or the events that `--events` wrote.
    #[arg(
        value_name = "SCENARIO|FILE.toml|EVENTS",
        required_unless_present = "port"
    )]
    source: Option<String>,
    /// The serial port of a coordinator, such as /dev/ttyACM0, instead.
    #[arg(long, value_name = "DEV", conflicts_with = "source")]
    port: Option<String>,
    /// Bits per second on --port.
    #[arg(long, value_name = "RATE", default_value_t = CONSOLE_BAUD, value_parser = clap::value_parser!(u32).range(1..))]
    baud: u32,
    /// The file of which the nodes on --port were provisioned: it tells who is expected, lenses and
    /// walls.
    #[arg(long, value_name = "FILE.toml", requires = "port")]
    site: Option<String>,
    /// The root of all randomness of a simulation. Default: the scenario's.
    #[arg(long, value_name = "S", value_parser = values::seed)]
    seed: Option<u64>,
    /// Which of the planned ways the target takes, from 1.
    #[arg(long, value_name = "K", value_parser = values::path)]
    path: Option<u64>,
    /// Cameras of a grid.
    #[arg(long, value_name = "N", value_parser = values::count)]
    nodes: Option<usize>,
    /// How fast a simulation begins: `max`, `real-time`, or so many times real time.
    #[arg(long, value_name = "SPEED", value_parser = values::speed, default_value = "10x")]
    speed: values::Speed,
    /// A simulated target goes on as the verdict asks, with at most so many further stops.
    #[arg(long, value_name = "N", value_parser = values::count, default_value_t = 0)]
    further_stops: usize,
    #[command(flatten)]
    serve: ServeOptions,
}

/// Where a page is served.
#[derive(Args)]
pub(super) struct ServeOptions {
    /// The address to serve on. Whoever can reach another one than this computer's own needs the token
    /// of the URL too, but what they send can be read on the way.
    #[arg(long, value_name = "IP", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    listen: IpAddr,
    /// The port to serve on; 0 takes a free one.
    #[arg(long, value_name = "N", default_value_t = 0)]
    http_port: u16,
    /// Open it in the browser.
    #[arg(long)]
    pub(super) open: bool,
}

impl ServeOptions {
    pub(super) fn address(&self) -> SocketAddr {
        SocketAddr::new(self.listen, self.http_port)
    }
}

const EPILOGUE: &str = "\
Examples:
  host-sim live thesis-13 --open
  host-sim live --port /dev/ttyACM0 --site office.toml
  host-sim live --listen 192.168.1.7 --port /dev/ttyACM0      for the phone in the carrier's hand

Exit codes:
  0  Ctrl-C
  2  wrong options, or a file, the port or the address is not to be had";

/// How often a simulation is looked at, nanoseconds.
const LOOKS: u64 = 100_000_000;
/// How often a real network is.
const LOOKS_REAL: Duration = Duration::from_millis(200);
/// How long a quiet line, or a paused simulation, is left alone.
const POLL: Duration = Duration::from_millis(10);
/// How soon a line that failed is tried again.
const AGAIN: Duration = Duration::from_secs(2);

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let interrupted = interrupt::watch()?;
    if let Some(port) = &arguments.port {
        let site = arguments.site.as_deref().map(read_site).transpose()?;
        let name = site.as_ref().map_or(port.as_str(), |site| &site.name);
        // A line that fails later is tried again; one that never was is a wrong name.
        let line = Port::open(port, arguments.baud, interrupted.clone())?;
        let (server, commands) = start(arguments, name, "network")?;
        Network {
            arguments,
            path: port,
            site: site.as_ref(),
            server,
            commands,
            interrupted,
        }
        .run(line);
        return Ok(ExitCode::SUCCESS);
    }
    let Some(source) = &arguments.source else {
        bail!("a scenario, a file of events, or --port is needed");
    };
    if is_events(source) {
        let file = File::open(source).with_context(|| format!("{source} cannot be read"))?;
        let events = event::read(BufReader::new(file));
        let events = events.with_context(|| format!("{source} cannot be used"))?;
        let (server, commands) = start(arguments, source, "recorded")?;
        server.tell(events);
        wait(&server, &commands, &interrupted);
        return Ok(ExitCode::SUCCESS);
    }
    simulate(arguments, source, &interrupted)
}

/// Whether it is a file of lines of JSON rather than a scenario.
fn is_events(source: &str) -> bool {
    let is_built_in = BUILT_IN.iter().any(|(name, _)| *name == source);
    let first = || {
        let mut line = Vec::new();
        let file = File::open(Path::new(source)).ok()?;
        BufReader::new(file).read_until(b'{', &mut line).ok()?;
        Some(line)
    };
    !is_built_in && first().is_some_and(|line| line.trim_ascii() == b"{")
}

fn start(
    arguments: &Arguments,
    name: &str,
    kind: &'static str,
) -> anyhow::Result<(Server, Receiver<Command>)> {
    let address = arguments.serve.address();
    let name = name.to_owned();
    let (server, commands) = serve(address, About { name, kind })?;
    print(&format!("{}\n", server.url()))?;
    if arguments.serve.open {
        open_browser(&server.url());
    }
    Ok((server, commands))
}

/// Opens a page, if there is a browser.
pub(super) fn open_browser(url: &str) {
    let opened = Process::new("xdg-open")
        .arg(url)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    if opened.is_err() {
        tell("no browser could be opened: open the URL yourself");
    }
}

/// Nothing more happens; the page stays.
fn wait(server: &Server, commands: &Receiver<Command>, interrupted: &AtomicBool) {
    while !interrupted.load(Ordering::Relaxed) {
        for command in commands.try_iter() {
            // Of these the page takes care itself.
            if !matches!(
                command,
                Command::Pause | Command::Resume | Command::Speed { .. }
            ) {
                let words = "it is over: nothing can be done any more";
                server.tell([told(0.0, &command, CommandState::Failed, words)]);
            }
        }
        thread::sleep(POLL * 10);
    }
}

/// What became of a command.
fn told(seconds: f64, command: &Command, state: CommandState, words: &str) -> Event {
    let (node, name) = match command {
        Command::Pause => (None, "pause".to_owned()),
        Command::Resume => (None, "resume".to_owned()),
        Command::Speed { times } => (None, format!("speed {times}")),
        Command::Restart { node } => (Some(*node), "restart".to_owned()),
        Command::Unplug { node, seconds } => (Some(*node), format!("unplug for {seconds} s")),
        Command::Jam { seconds } => (None, format!("jam for {seconds} s")),
        Command::Drift { node, seconds, .. } => (Some(*node), format!("drift for {seconds} s")),
        Command::Move { node, .. } => (Some(*node), "move".to_owned()),
        Command::JoinWindow { seconds } => (None, format!("join window {seconds} s")),
        Command::Remove { node } => (Some(*node), "remove".to_owned()),
        Command::Camera { node, command } => (*node, command.clone()),
    };
    let what = What::Command {
        node,
        command: name,
        state,
        words: words.to_owned(),
    };
    Event::new(seconds, what)
}

fn simulate(
    arguments: &Arguments,
    source: &str,
    interrupted: &Arc<AtomicBool>,
) -> anyhow::Result<ExitCode> {
    let overrides = Overrides {
        seed: arguments.seed,
        path: arguments.path,
        nodes: arguments.nodes,
        ..Overrides::default()
    };
    let scenario = Scenario::load(source, &overrides)?;
    for assumption in scenario.assumptions(Purpose::Rehearsal) {
        tell(format_args!("{source}: {assumption}"));
    }
    let name = scenario.name.clone();
    let options = Options {
        speed: arguments.speed.0,
        further_stops: arguments.further_stops,
        stop: interrupted.clone(),
        ..Options::default()
    };
    let mut simulation = Simulation::new(scenario, options)?;
    simulation.watch();
    simulation.take_orders();
    if arguments.speed.0.is_none() {
        simulation.set_pace(|_| ());
    }
    let (server, commands) = start(arguments, &name, "simulation")?;
    let mut controls = Controls {
        server: &server,
        commands: &commands,
        interrupted,
        times: arguments.speed.0,
    };
    let mut onlooker = Onlooker::default();
    let record = simulation.run_watched(
        LOOKS,
        |_| (),
        |simulation| {
            server.tell(onlooker.look(simulation));
            controls.take(simulation);
        },
    );
    let why = interrupted.load(Ordering::Relaxed).then_some("interrupted");
    server.tell(onlooker.end(&simulation, &record, why));
    wait(&server, &commands, interrupted);
    Ok(ExitCode::SUCCESS)
}

/// What people at the page do to a simulation.
struct Controls<'a> {
    server: &'a Server,
    commands: &'a Receiver<Command>,
    interrupted: &'a AtomicBool,
    times: Option<f64>,
}

impl Controls<'_> {
    fn take(&mut self, simulation: &mut Simulation) {
        let mut is_paused = false;
        loop {
            for command in self.commands.try_iter() {
                match command {
                    Command::Pause => is_paused = true,
                    Command::Resume => is_paused = false,
                    _ => {}
                }
                let seconds = simulation.seconds();
                let event = match self.act(simulation, &command) {
                    Ok(true) => told(seconds, &command, CommandState::Done, ""),
                    Ok(false) => told(seconds, &command, CommandState::Asked, ""),
                    Err(why) => told(seconds, &command, CommandState::Failed, &why.to_string()),
                };
                self.server.tell([event]);
            }
            if !is_paused || self.interrupted.load(Ordering::Relaxed) {
                return;
            }
            thread::sleep(POLL);
        }
    }

    /// Whether it is done already; a node's command is when the node says so.
    fn act(&mut self, simulation: &mut Simulation, command: &Command) -> anyhow::Result<bool> {
        let duration = |seconds: f64| -> anyhow::Result<f64> {
            ensure!(
                (0.0..=86_400.0).contains(&seconds),
                "a time from 0 to 86400 s is needed"
            );
            Ok(seconds)
        };
        let known = |node: u16| -> anyhow::Result<u16> {
            ensure!(simulation.config(node).is_some(), "there is no node {node}");
            Ok(node)
        };
        let action = match *command {
            Command::Pause => return Ok(true),
            Command::Resume => {
                self.pace(simulation);
                return Ok(true);
            }
            Command::Speed { times } => {
                ensure!(
                    (0.0..=1e6).contains(&times),
                    "a speed from 0 to 1000000 is needed"
                );
                self.times = (times > 0.0).then_some(times);
                self.pace(simulation);
                return Ok(true);
            }
            Command::Restart { node } => Action::Restart { node: known(node)? },
            Command::Unplug { node, seconds } => Action::UnplugCamera {
                node: known(node)?,
                for_s: duration(seconds)?,
                with_power: true,
            },
            Command::Jam { seconds } => Action::Jam {
                for_s: duration(seconds)?,
                channel: None,
                at: None,
                reach: None,
            },
            Command::Drift {
                node,
                seconds,
                share,
            } => {
                ensure!(share.abs() <= 1.0, "a share from -1 to 1 is needed");
                Action::Slip {
                    node: known(node)?,
                    for_s: duration(seconds)?,
                    distance: share,
                    heading_deg: 0.0,
                }
            }
            Command::Move { node, by, turn_deg } => {
                let is_finite = by.iter().all(|by| by.is_finite()) && turn_deg.is_finite();
                ensure!(is_finite, "numbers are needed");
                Action::BumpCamera {
                    node: known(node)?,
                    by,
                    turn_deg,
                }
            }
            Command::JoinWindow { seconds } => {
                simulation.let_join(seconds);
                return Ok(false);
            }
            Command::Remove { node } => {
                ensure!(simulation.remove(node), "node {node} is no member");
                return Ok(false);
            }
            Command::Camera { node, ref command } => {
                let order = parse_command(command).context("cameras know no such command")?;
                let record = simulation.record();
                let all = record.cameras().map(|camera| camera.id);
                let meant: Vec<u16> = all
                    .filter(|id| node.is_none_or(|node| node == *id))
                    .collect();
                ensure!(!meant.is_empty(), "there is no such camera");
                let sent = meant.iter().filter(|id| simulation.order(**id, order));
                ensure!(sent.count() > 0, "no such camera is a member");
                return Ok(false);
            }
        };
        simulation.act(action);
        Ok(true)
    }

    fn pace(&self, simulation: &mut Simulation) {
        match self.times {
            Some(times) => simulation.set_pace(times_real_time(times)),
            None => simulation.set_pace(|_| ()),
        }
    }
}

/// A real network.
struct Network<'a> {
    arguments: &'a Arguments,
    path: &'a str,
    site: Option<&'a Scenario>,
    server: Server,
    commands: Receiver<Command>,
    interrupted: Arc<AtomicBool>,
}

impl Network<'_> {
    fn run(&self, line: Port) {
        let begin = Instant::now();
        let mut session = Session::new([]);
        session.want_sightings();
        let mut looker = Looker::default();
        let mut pending = VecDeque::new();
        let mut line: Result<_, OpenError> = Ok(line);
        loop {
            let why = match &mut line {
                Ok(port) => self.talk(port, begin, &mut session, &mut looker, &mut pending),
                Err(error) => error.to_string(),
            };
            if self.interrupted.load(Ordering::Relaxed) {
                break;
            }
            self.look(begin.elapsed(), &session, &mut looker);
            self.say(begin.elapsed(), format!("{}: {why}", self.path));
            thread::sleep(AGAIN);
            // One at a time has the port.
            drop(line);
            line = Port::open(self.path, self.arguments.baud, self.interrupted.clone());
        }
    }

    /// Until the line fails, and why it did.
    fn talk(
        &self,
        port: &mut Port,
        begin: Instant,
        session: &mut Session,
        looker: &mut Looker,
        pending: &mut VecDeque<(Command, Wish)>,
    ) -> String {
        let mut looked = None;
        loop {
            let now = begin.elapsed();
            // What was asked for, and is confirmed now or fails.
            let is_wished = !session.is_done();
            match exchange(port, session, now) {
                Ok(Ok(())) => {
                    if session.is_done()
                        && is_wished
                        && let Some((command, _)) = pending.front()
                    {
                        let done = told(now.as_secs_f64(), command, CommandState::Done, "");
                        self.server.tell([done]);
                        pending.pop_front();
                    }
                }
                Ok(Err(failure)) => {
                    let words = failure.to_string();
                    match is_wished.then(|| pending.pop_front()).flatten() {
                        Some((command, _)) => {
                            let seconds = now.as_secs_f64();
                            let failed = told(seconds, &command, CommandState::Failed, &words);
                            self.server.tell([failed]);
                        }
                        None => self.say(now, words),
                    }
                    session.go_on(now);
                }
                Err(PortError::Interrupted) => return "interrupted".to_owned(),
                Err(error) => return format!("the line failed: {error}"),
            }
            while let Some(words) = session.news() {
                self.say(now, words);
            }
            while let Some((node, tracked)) = session.tracked() {
                let what = What::tracked(node, &tracked);
                self.server.tell([Event::new(now.as_secs_f64(), what)]);
            }
            while let Some((object, is)) = session.object() {
                let what = What::Object {
                    network: 1,
                    object,
                    is: is.as_ref().map(ObjectPlace::from),
                };
                self.server.tell([Event::new(now.as_secs_f64(), what)]);
            }
            self.take(now, session, pending);
            if looked.is_none_or(|at| now.saturating_sub(at) >= LOOKS_REAL) {
                looked = Some(now);
                self.look(now, session, looker);
            }
            thread::sleep(POLL);
        }
    }

    fn look(&self, now: Duration, session: &Session, looker: &mut Looker) {
        if let Ok((_, record)) = record(session, now, self.site) {
            self.server.tell(looker.look(&record));
        }
    }

    fn say(&self, now: Duration, words: String) {
        let said = What::Said { node: None, words };
        self.server.tell([Event::new(now.as_secs_f64(), said)]);
    }

    /// One thing after the other is wished for.
    fn take(&self, now: Duration, session: &mut Session, pending: &mut VecDeque<(Command, Wish)>) {
        let seconds = now.as_secs_f64();
        for command in self.commands.try_iter() {
            match wishes(&command, session) {
                Ok(wishes) => {
                    let asked = told(seconds, &command, CommandState::Asked, "");
                    self.server.tell([asked]);
                    pending.extend(wishes);
                }
                Err(why) => {
                    let why = why.to_string();
                    let failed = told(seconds, &command, CommandState::Failed, &why);
                    self.server.tell([failed]);
                }
            }
        }
        if session.is_done()
            && let Some((_, wish)) = pending.front()
        {
            session.wish(*wish);
        }
    }
}

/// What the network is asked for, one camera after the other.
fn wishes(command: &Command, session: &Session) -> anyhow::Result<Vec<(Command, Wish)>> {
    let one = |wish| Ok(vec![(command.clone(), wish)]);
    match *command {
        Command::JoinWindow { seconds } => one(Wish::JoinWindow(seconds)),
        Command::Remove { node } => one(Wish::Remove(node)),
        Command::Camera { node, ref command } => {
            let order = parse_command(command).context("cameras know no such command")?;
            let all = session
                .known()
                .cameras()
                .into_iter()
                .map(|camera| camera.id);
            let meant: Vec<u16> = all
                .filter(|id| node.is_none_or(|node| node == *id))
                .collect();
            ensure!(!meant.is_empty(), "no such camera is a member");
            let wishes = meant.into_iter().map(|id| {
                let command = Command::Camera {
                    node: Some(id),
                    command: command_name(order),
                };
                (command, Wish::Command(id, order))
            });
            Ok(wishes.collect())
        }
        _ => bail!("only a simulation can do that"),
    }
}
