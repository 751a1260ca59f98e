//! A building on many computers: publishers of many networks, one broker, and one `live` that shows all.
//!
//! The publishers are in this process, each with a connection of its own. They tell what real networks tell, at many
//! times real time. Broker and `live` are processes of their own, whose processor time is counted.

use std::{
    collections::{BTreeMap, BTreeSet},
    io::{BufRead, BufReader},
    net::{TcpListener, TcpStream},
    path::Path,
    process::{Child, Command, Stdio},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, ensure};
use host_sim::{
    mqtt::{Broker, Heard, Publisher, Reader, Topic},
    network::{Onlooker, Options, Simulation},
};
use results::record::{
    RunRecord,
    event::{self, Event, Looker, What},
    part::Part,
};
use site::{Overrides, Scenario};

use super::{page, process::Cost, program};
use crate::figure::{Goal, Sheet};

const CAMERAS: usize = 1_000;
const NETWORKS: usize = 40;
/// Times real time.
const SPEED: f64 = 20.0;
/// So much of the run is told, simulated seconds: by then many cameras are calibrated.
const SECONDS: f64 = 600.0;
/// Time between two looks at a network, simulated seconds.
const LOOK: f64 = 0.2;
/// Time after which nothing more is expected.
const HANGS: Duration = Duration::from_secs(300);

pub(crate) fn run(sheet: &mut Sheet) -> anyhow::Result<()> {
    sheet.heading(&format!(
        "Broker: {CAMERAS} cameras in {NETWORKS} networks on {NETWORKS} publishers, {SPEED} times real time"
    ));
    let program = program()?;
    let (events, record) = simulated()?;
    let port = TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
    let folder = tempfile::tempdir()?;
    let mut broker = Process(mosquitto(folder.path(), port)?);
    let url = format!("mqtt://127.0.0.1:{port}/building");
    let mut live = Process(
        Command::new(program)
            .args(["live", "--mqtt", &url])
            .stdout(Stdio::piped())
            .spawn()?,
    );
    let page = page(&mut live.0)?;
    let all = sightings(&record);
    let watched = thread::spawn(move || shown(page, all));

    let mut networks = Network::all(&events, &url)?;
    let begin = Instant::now();
    let last = events.last().context("a run has events")?.seconds;
    let mut pending = events.into_iter().peekable();
    let mut seconds = 0.0;
    while seconds < last + LOOK {
        seconds += LOOK;
        while let Some(event) = pending.next_if(|event| event.seconds <= seconds) {
            Network::take(&mut networks, event);
        }
        for network in networks.values_mut() {
            network.look(seconds);
        }
        let due = Duration::from_secs_f64(seconds / SPEED);
        thread::sleep(due.saturating_sub(begin.elapsed()));
    }
    let told = Instant::now();
    let took = begin.elapsed().as_secs_f64();
    let seen = watched.join().ok().context("the page's reader failed")??;
    let behind = seen.saturating_duration_since(told).as_secs_f64();
    let cost = Cost::so_far(&live.0)?;
    let of_broker = Cost::so_far(&broker.0)?;
    sheet.figure("simulated", seconds, "s", &Goal::None);
    sheet.figure(
        "cameras called calibrated",
        record.summary.calibrated as f64,
        "",
        &Goal::None,
    );
    sheet.figure(
        "all sightings shown after the last message, by",
        behind,
        "s",
        &Goal::AtMost(5.0),
    );
    let share = |cost: Cost| cost.seconds / took * 100.0;
    sheet.figure("`live`, processor", cost.seconds, "s", &Goal::None);
    sheet.figure("`live`, of one core", share(cost), "%", &Goal::AtMost(50.0));
    sheet.figure(
        "`live`, memory at most",
        cost.peak as f64 / 1e6,
        "MB",
        &Goal::None,
    );
    sheet.figure("broker, of one core", share(of_broker), "%", &Goal::None);

    drop(broker);
    let lost = Instant::now();
    broker = Process(mosquitto(folder.path(), port)?);
    let nodes = retained(&url, record.nodes.len())?;
    sheet.figure(
        "a broker that lost everything has all nodes again after",
        lost.elapsed().as_secs_f64(),
        "s",
        &Goal::AtMost(30.0),
    );
    let after = Cost::so_far(&live.0)?.seconds - cost.seconds;
    sheet.figure("`live`, processor for that", after, "s", &Goal::None);
    ensure!(nodes == record.nodes.len(), "{nodes} nodes came");
    drop(broker);
    Ok(())
}

/// A program that ends with the measurement.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn mosquitto(folder: &Path, port: u16) -> anyhow::Result<Child> {
    let settings = folder.join("conf");
    std::fs::write(
        &settings,
        format!("listener {port} 127.0.0.1\nallow_anonymous true\n"),
    )?;
    // Debian keeps it where only root looks for programs.
    let elsewhere = Path::new("/usr/sbin/mosquitto");
    let name = match elsewhere.is_file() {
        true => elsewhere,
        false => Path::new("mosquitto"),
    };
    let child = Command::new(name)
        .arg("-c")
        .arg(settings)
        .stderr(Stdio::null())
        .spawn()
        .context("mosquitto is missing: type `sudo apt-get install mosquitto`")?;
    let begin = Instant::now();
    while TcpStream::connect(("127.0.0.1", port)).is_err() {
        ensure!(begin.elapsed() < HANGS, "mosquitto does not listen");
        thread::sleep(Duration::from_millis(10));
    }
    Ok(child)
}

/// Events of all networks, and the record that they come to.
fn simulated() -> anyhow::Result<(Vec<Event>, RunRecord)> {
    let overrides = Overrides {
        nodes: Some(CAMERAS),
        ..Overrides::default()
    };
    let text = format!(
        "name = \"building\"\n[camera]\nfield_of_view_deg = 60.0\nrange = 8.0\n[grid]\nnodes = {CAMERAS}\n\
         cell_nodes = {}\n",
        CAMERAS / NETWORKS
    );
    let scenario = Scenario::from_toml(&text, &overrides)?;
    let stop = Arc::new(AtomicBool::new(false));
    let options = Options {
        stop: stop.clone(),
        ..Options::default()
    };
    let mut simulation = Simulation::new(scenario, options)?;
    simulation.watch();
    let mut onlooker = Onlooker::default();
    let mut events = Vec::new();
    let every = (LOOK * 1e9) as u64;
    simulation.run_watched(
        every,
        |_| (),
        |now| {
            events.extend(onlooker.look(now));
            stop.store(now.seconds() >= SECONDS, Ordering::Relaxed);
        },
    );
    let record = event::fold(&events).context("a run has a record")?;
    Ok((events, record))
}

/// One network, as its coordinator's publisher knows it.
struct Network {
    record: RunRecord,
    looker: Looker,
    publisher: Publisher,
}

impl Network {
    fn all(events: &[Event], url: &str) -> anyhow::Result<BTreeMap<u16, Self>> {
        let Some(What::Begin { record, .. }) = events.first().map(|event| &event.what) else {
            anyhow::bail!("a stream begins with a record");
        };
        let broker = Broker::parse(url)?;
        let numbers = record.networks.iter().map(|own| own.network);
        numbers
            .map(|number| {
                let mut part = RunRecord::clone(record);
                part.networks.retain(|own| own.network == number);
                part.nodes.retain(|node| node.network == number);
                part.targets.retain(|own| own.network == number);
                part.radio = None;
                let name = format!("n{number}");
                let publisher = Publisher::start(broker.clone(), &name, false);
                let network = Self {
                    record: part,
                    looker: Looker::default(),
                    publisher: publisher?.0,
                };
                Ok((number, network))
            })
            .collect()
    }

    /// Takes in an event of the network that it concerns.
    fn take(all: &mut BTreeMap<u16, Self>, event: Event) {
        let of_node = |id: u16| {
            let has = |own: &Self| own.record.nodes.iter().any(|node| node.id == id);
            let mut networks = all.iter();
            networks
                .find(|(_, own)| has(own))
                .map(|(number, _)| *number)
        };
        let number = match &event.what {
            What::Node { is, .. } => Some(is.network),
            What::Target { is } => Some(is.network),
            What::Network { is } => Some(is.network),
            What::Stop { target, .. } => of_node(*target),
            What::Seen { node, .. } => of_node(*node),
            // A real network does not tell these, and each publisher finds its own verdict.
            _ => None,
        };
        let Some(own) = number.and_then(|number| all.get_mut(&number)) else {
            return;
        };
        match event.what {
            What::Seen { .. } => own.publisher.tell([event]),
            _ => own.record.apply(&event),
        }
    }

    fn look(&mut self, seconds: f64) {
        self.record.sim_seconds = seconds;
        self.publisher.tell(self.looker.look(&self.record));
    }
}

/// Sightings of all cameras. The number grows until the last one.
fn sightings(record: &RunRecord) -> usize {
    record.cameras().map(|camera| camera.sightings).sum()
}

/// Reads a page's messages until it shows so many sightings, and tells when that was.
fn shown(page: BufReader<TcpStream>, all: usize) -> anyhow::Result<Instant> {
    page.get_ref().set_read_timeout(Some(HANGS))?;
    let mut record: Option<RunRecord> = None;
    for line in page.lines() {
        let line = line?;
        let Some(line) = line.strip_prefix("data:") else {
            continue;
        };
        let event = Event::from_line(line.trim_start())?;
        match (event.what, &mut record) {
            (What::Begin { record: begun, .. }, _) => record = Some(*begun),
            (what @ What::Node { .. }, Some(record)) => {
                record.apply(&Event::new(event.seconds, what));
                if sightings(record) >= all {
                    return Ok(Instant::now());
                }
            }
            _ => {}
        }
    }
    anyhow::bail!("the page's stream ended")
}

/// Waits until a broker has so many nodes again.
fn retained(url: &str, count: usize) -> anyhow::Result<usize> {
    let reader = Reader::start(Broker::parse(url)?)?;
    let mut nodes = BTreeSet::new();
    let begin = Instant::now();
    while nodes.len() < count && begin.elapsed() < HANGS {
        for heard in reader.heard() {
            if let Heard::Message { levels, .. } = heard
                && let Some(Topic::Part(Part::Node(id))) = Topic::parse(&levels)
            {
                nodes.insert(id);
            }
        }
        thread::sleep(Duration::from_millis(10));
    }
    Ok(nodes.len())
}
