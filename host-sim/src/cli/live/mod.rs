//! `host-sim live`

use std::{
    env,
    fs::File,
    io::{BufRead, BufReader},
    net::{IpAddr, Ipv4Addr, SocketAddr},
    path::{Path, PathBuf},
    process::{Command as Process, ExitCode, Stdio},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::Receiver,
    },
    thread,
    time::Duration,
};

use anyhow::{Context, bail, ensure};
use clap::Args;
use host_sim::{
    live::{About, Command, Server, serve},
    mqtt::{Broker, Publisher, Reader},
};
use node_firmware::limits::CONSOLE_BAUD;
use results::record::event::{self, CommandState, Event, What};
use site::BUILT_IN;

use super::{
    OfFile, file_name, interrupt, log_options::LogOptions, print, run_outputs::read_record, tell,
    values, whole_file,
};

mod broker;
mod network;
mod simulation;

/// Shows a network as it calibrates itself, in a browser: a simulation, a real network, or one that was
/// recorded.
///
/// Prints where to look; everything stays on this computer. Goes on until Ctrl-C.
#[derive(Args)]
#[command(after_help = EPILOGUE)]
pub(super) struct Arguments {
    #[command(flatten)]
    source: SourceOptions,
    /// A broker and the topic of a site there, such as `mqtt://user@host:1883/building`, instead: the networks that
    /// `host-sim publish` tells there are shown as one. `mqtts://` is with TLS.
    #[arg(long, value_name = "URL", conflicts_with_all = ["source", "port"])]
    mqtt: Option<String>,
    #[command(flatten)]
    credentials: Credentials,
    #[command(flatten)]
    serve: ServeOptions,
    #[command(flatten)]
    log: LogOptions,
}

/// Credentials for a broker.
#[derive(Args)]
pub(super) struct Credentials {
    /// A file whose first line is the password for --mqtt. Default: what `MQTT_PASSWORD` says in the environment.
    #[arg(long, value_name = "FILE", requires = "mqtt")]
    password_file: Option<PathBuf>,
    /// The certificates of the authorities that are trusted, PEM, with mqtts://. Default: those of the system.
    #[arg(long, value_name = "FILE", requires = "mqtt")]
    ca: Option<PathBuf>,
}

/// Longest password or certificate file, bytes.
const CREDENTIALS_MAX: u64 = 1 << 20;

impl Credentials {
    /// The broker of a URL, with these credentials.
    pub(super) fn broker(&self, url: &str) -> anyhow::Result<Broker> {
        let mut broker = Broker::parse(url)?;
        if let Some(path) = &self.password_file {
            let text = whole_file::read(path, CREDENTIALS_MAX)?;
            let password = text.lines().next().unwrap_or_default();
            ensure!(
                !password.is_empty(),
                "{} has no password in its first line",
                file_name(path)
            );
            ensure!(
                broker.has_user(),
                "--password-file is the password of a user, and {url} names none: write mqtt://USER@HOST/TOPIC"
            );
            broker = broker.with_password(password.to_owned());
        } else if let Ok(password) = env::var("MQTT_PASSWORD")
            && broker.has_user()
        {
            broker = broker.with_password(password);
        }
        if let Some(path) = &self.ca {
            ensure!(
                broker.is_secure(),
                "--ca is for secure connections, and {url} is none: write mqtts://"
            );
            let text = whole_file::read(path, CREDENTIALS_MAX)?;
            broker = broker.with_authorities(text.into_bytes());
        }
        Ok(broker)
    }
}

/// Source of the events.
#[derive(Args)]
pub(super) struct SourceOptions {
    /// `thesis-13`, `lab`, `grid`, `office`, the file of a site, or the events that `--events` wrote.
    #[arg(value_name = "SCENARIO|FILE.toml|EVENTS")]
    source: Option<String>,
    /// The serial port of a coordinator, such as /dev/ttyACM0, instead. Of a site with several networks, those of
    /// all coordinators: they are shown as one.
    #[arg(long, value_name = "DEV")]
    port: Vec<String>,
    /// Bits per second on --port.
    #[arg(long, value_name = "RATE", default_value_t = CONSOLE_BAUD, value_parser = values::whole(1, u32::MAX))]
    baud: u32,
    /// The file of which the nodes on --port were provisioned: it tells who is expected, lenses and
    /// walls.
    #[arg(long, value_name = "FILE.toml", requires = "port")]
    site: Option<String>,
    /// The root of all randomness of a simulation. Default: the scenario's.
    #[arg(long, value_name = "S", value_parser = values::seed)]
    seed: Option<u64>,
    /// Number of the planned way that the target takes, from 1.
    #[arg(long, value_name = "K", value_parser = values::path)]
    path: Option<u64>,
    /// Cameras of a grid.
    #[arg(long, value_name = "N", value_parser = values::count)]
    nodes: Option<usize>,
    /// Speed at which a simulation begins: `max`, `real-time`, or so many times real time.
    #[arg(long, value_name = "SPEED", value_parser = values::speed, default_value = "10x", allow_hyphen_values = true)]
    speed: values::Speed,
    /// A simulated target goes on as the verdict asks, with at most so many further stops.
    #[arg(long, value_name = "N", value_parser = values::count, default_value_t = 0)]
    further_stops: usize,
}

/// Address at which a page is served.
#[derive(Args)]
pub(super) struct ServeOptions {
    /// The address to serve on. A person who can reach another one than this computer's own needs the token
    /// of the URL too, but what is sent can be read on the way.
    #[arg(long, value_name = "IP", value_parser = values::address, default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    listen: IpAddr,
    /// The port to serve on; 0 takes a free one.
    #[arg(long, value_name = "N", value_parser = values::whole(0, u16::MAX), default_value_t = 0)]
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
  host-sim live --port /dev/ttyACM0 --port /dev/ttyACM1 --site building.toml
  host-sim live --mqtt mqtt://me@192.168.1.5/building        what `host-sim publish` tells elsewhere
  host-sim live --listen 192.168.1.7 --port /dev/ttyACM0      for the phone in the carrier's hand

Exit codes:
  0  Ctrl-C
  2  wrong options, or a file, the port, the broker or the address is not to be had";

/// Time for which a quiet line, or a paused simulation, is left alone.
const POLL: Duration = Duration::from_millis(10);

/// Records without --log: the page shows what networks tell.
pub(super) const LOG: &str = "host_sim=info,host_sim::news=warn";

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    arguments.log.start(LOG)?;
    let interrupted = interrupt::watch()?;
    let begins = |about| start(&arguments.serve, about);
    match &arguments.mqtt {
        Some(url) => {
            let reader = Reader::start(arguments.credentials.broker(url)?)?;
            broker::run(&reader, begins, &interrupted)?;
        }
        None => arguments.source.watch(&interrupted, begins)?,
    }
    Ok(ExitCode::SUCCESS)
}

/// Receiver of what happens.
pub(super) enum Audience {
    Page(Server),
    Broker(Publisher),
}

impl Audience {
    fn tell(&self, events: impl IntoIterator<Item = Event>) {
        match self {
            Self::Page(server) => server.tell(events),
            Self::Broker(publisher) => publisher.tell(events),
        }
    }
}

/// The audience, and what it wants.
pub(super) type Begun = anyhow::Result<(Audience, Receiver<Command>)>;

impl SourceOptions {
    /// Tells what happens until Ctrl-C. The audience is called once it is known what there is to see.
    pub(super) fn watch(
        &self,
        interrupted: &Arc<AtomicBool>,
        begins: impl FnOnce(About) -> Begun,
    ) -> anyhow::Result<()> {
        match &self.source {
            Some(source) if !self.port.is_empty() => bail!(
                "--port is the line of a real network: leave {source} out, or say `--site {source}` if the nodes have \
                 their pages of it"
            ),
            None if !self.port.is_empty() => network::run(self, begins, interrupted),
            None => bail!("a scenario, a file of events, or --port is needed"),
            Some(source) if is_events(source) => {
                let path = Path::new(source);
                let file = File::open(path).with_context(|| OfFile::unread(path))?;
                let events = event::read(BufReader::new(file));
                ensure!(
                    events.is_ok() || read_record(path).is_err(),
                    "{source} is the record of a run: `host-sim report run {source}` shows it"
                );
                let events = events.with_context(|| format!("{source} cannot be used"))?;
                let is_whole = |event: &Event| matches!(event.what, What::End { .. });
                if !events.iter().any(is_whole) {
                    tell(format_args!(
                        "{source} has no end: what wrote it was stopped, or the file is cut off"
                    ));
                }
                let (audience, commands) = begins(About {
                    name: source.clone(),
                    kind: "recorded",
                    speed: 0.0,
                })?;
                audience.tell(events);
                wait(&audience, &commands, interrupted);
                Ok(())
            }
            Some(source) if is_lost(source) => bail!(
                "there is no file {source}: `host-sim run SITE --events FILE` and `host-sim console --events FILE` \
                 write files of events"
            ),
            Some(source) if is_other(source) => bail!(
                "{source} is neither the file of a site, whose name ends in `.toml`, nor one of events, as \
                 `--events FILE` of `host-sim run` and `host-sim console` writes"
            ),
            Some(source) => simulation::run(self, source, begins, interrupted),
        }
    }
}

/// Returns true if it is a file of lines of JSON rather than a scenario.
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

/// Returns true if it is a file, but not that of a site.
fn is_other(source: &str) -> bool {
    let path = Path::new(source);
    let is_built_in = BUILT_IN.iter().any(|(name, _)| *name == source);
    !is_built_in && path.is_file() && path.extension().is_none_or(|end| end != "toml")
}

/// Returns true if it can only be meant as a file of events, and is not there.
fn is_lost(source: &str) -> bool {
    let path = Path::new(source);
    let is_site = path.extension().is_some_and(|end| end == "toml");
    let is_path = path.extension().is_some() || path.components().count() > 1;
    is_path && !is_site && !path.exists()
}

/// Serves the page.
fn start(options: &ServeOptions, about: About) -> Begun {
    let (server, commands) = serve(options.address(), about)?;
    print(&format!("{}\n", server.url()))?;
    if options.open {
        open_browser(&server.url());
    }
    Ok((Audience::Page(server), commands))
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
fn wait(audience: &Audience, commands: &Receiver<Command>, interrupted: &AtomicBool) {
    while !interrupted.load(Ordering::Relaxed) {
        for command in commands.try_iter() {
            // The page takes care of these itself.
            if !matches!(
                command,
                Command::Pause | Command::Resume | Command::Speed { .. }
            ) {
                let words = "it is over: nothing can be done any more";
                audience.tell([told(0.0, &command, CommandState::Failed, words)]);
            }
        }
        thread::sleep(POLL * 10);
    }
}

/// Event of words on no single node.
fn said(seconds: f64, words: String) -> Event {
    Event::new(seconds, What::Said { node: None, words })
}

/// Event that tells what became of a command.
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
