//! `host-sim run`

use std::{
    collections::{BTreeMap, BTreeSet},
    io::Write,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::atomic::Ordering,
    time::{Duration, Instant},
};

use anyhow::{Context, ensure};
use calib_core::Status;
use clap::{Args, ValueEnum};
use host_sim::live::{animation, report};
use host_sim::network::{
    CHIP_IMAGE, Chips, FurtherEnd, Onlooker, Options, Progress, Simulation, TrackRow,
};
use indicatif::{ProgressBar, ProgressStyle};
use node_firmware::limits::CONSOLE_BAUD;
use results::record::{Node, RunRecord, event::Event, verdict::status_words};
use site::{Network, Site, coordinator_id};

use super::{
    and,
    end::End,
    files::Files,
    interrupt,
    late::Late,
    pseudo_terminal::PseudoTerminal,
    public_update_key,
    report::finish,
    run_outputs::{FOR_RESULTS, RunOutputs, write},
    scenario_options::{FOR_SCENARIO, ScenarioOptions},
    tell, values,
};

/// Lets a network calibrate itself, and compares what it found with the truth.
///
/// Every node runs its firmware, over emulated cameras and a simulated radio, in virtual time.
#[derive(Args)]
#[command(after_help = EPILOGUE)]
pub(super) struct Arguments {
    #[command(flatten, next_help_heading = FOR_SCENARIO)]
    scenario: ScenarioOptions,
    /// The root of all randomness. Default: the scenario's.
    #[arg(long, value_name = "S", value_parser = values::seed)]
    seed: Option<u64>,
    /// `max`, `real-time`, or so many times real time, such as `10x`. Default: `max`.
    #[arg(long, value_name = "SPEED", value_parser = values::speed, allow_hyphen_values = true)]
    speed: Option<values::Speed>,
    /// Go on as a person would: to the stops that the verdict asks for, until every camera is calibrated
    /// and every pose checked, or no further stop is known to help.
    #[arg(long)]
    until_calibrated: bool,
    /// Stops that this takes at most, after those of the way.
    #[arg(long, value_name = "N", value_parser = values::count, default_value_t = FURTHER_STOPS, requires = "until_calibrated")]
    further_stops: usize,
    /// Program or chip that runs the firmware of the nodes.
    #[arg(long, value_name = "WHAT", default_value = "host")]
    backend: Backend,
    /// A real camera on a serial port for a camera node, at the rate of the scenario's cameras and
    /// in real time, such as `3=/dev/ttyUSB0`. May be repeated.
    #[arg(long, value_name = "NODE=PATH", value_parser = values::port)]
    port: Vec<(u16, String)>,
    /// The line of a coordinator on a pseudo-terminal, at this link, for `host-sim console --port
    /// PTY`; of the first network, or of network N with `N:PTY`. In real time, unless --speed is given.
    /// May be repeated.
    #[arg(long, value_name = "PTY", value_parser = values::console)]
    console: Vec<(usize, PathBuf)>,
    /// Nodes take updates by radio that are signed with this key, of `host-sim keygen --updates`: `host-sim update
    /// --port PTY` gives them an image, over the line of --console.
    #[arg(long, value_name = "FILE", requires = "console")]
    update_key: Option<PathBuf>,
    /// The image for emulated chips. Default: what `cargo xtask firmware` makes.
    #[arg(long, value_name = "FILE.elf")]
    image: Option<PathBuf>,
    /// GDB connects to this node, an emulated nRF52840, with `target remote :3333`, or to another port with
    /// `NODE:PORT`: at each of its starts the network waits for that.
    #[arg(long, value_name = "NODE", value_parser = values::gdb)]
    gdb: Option<(u16, Option<u16>)>,
    /// After the calibration, have all cameras track the scenario's objects for so many seconds, or two that
    /// walk about at random if it has none.
    #[arg(long, value_name = "S", value_parser = values::seconds, conflicts_with = "console")]
    track: Option<Duration>,
    #[command(flatten, next_help_heading = FOR_RESULTS)]
    outputs: RunOutputs,
    /// Places of objects as the coordinators told them, beside the truth, one line each time.
    #[arg(long, value_name = "FILE.csv", value_parser = values::result(), requires = "track")]
    tracks: Option<PathBuf>,
    /// All frames on the air, for Wireshark; and FILE.pcap.sh, which shows them decrypted.
    #[arg(long, value_name = "FILE.pcap", value_parser = values::result())]
    pcap: Option<PathBuf>,
    /// Events as they happen, one line of JSON each (docs/events.md).
    #[arg(long, value_name = "FILE", value_parser = values::result())]
    events: Option<PathBuf>,
    /// The page of `host-sim live` with all that happened, in one file that a browser opens anywhere.
    #[arg(long, value_name = "FILE.html", value_parser = values::result())]
    report: Option<PathBuf>,
    /// The run as a small picture that moves, for a page about it: no script, no page of its own.
    #[arg(long, value_name = "FILE.svg", value_parser = values::result())]
    animation: Option<PathBuf>,
    /// Everything that a node sends or learns, with the time.
    #[arg(long, value_name = "FILE", value_parser = values::result())]
    log: Option<PathBuf>,
}

/// Port to which GDB connects.
const GDB_PORT: u16 = 3333;

/// Enough for four pages of advice.
const FURTHER_STOPS: usize = 24;

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Backend {
    /// This program, in virtual time.
    Host,
    /// An emulated nRF52840 for each node, in virtual time: the image that is flashed. Only where host-sim was
    /// built with `--features chip`.
    Nrf52840,
}

const EPILOGUE: &str = "\
Exit codes:
  0    every camera that should be calibrated is, and true errors are what the sigmas foretell
  1    one is not, or a pose is more than five predicted sigmas off, or all together are too far off,
       or --check found a difference
  2    wrong options, an impossible scenario, a file could not be read or written, or the emulated
       chips failed
  130  ended by Ctrl-C or SIGTERM; a second one ends it at once

Results of a run that was ended, or whose chips failed, are of what was before, and say so: the
report and the record at their beginning (`cut_short`), other files in their last line.";

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let scenario = arguments.scenario.load(arguments.seed, None, None)?;
    arguments.scenario.tell_assumptions(&scenario);
    let script = arguments.pcap.as_deref().and_then(script_of);
    let usual = Path::new(CHIP_IMAGE);
    let image = arguments.image.as_deref().unwrap_or(usual);
    let files = Files::default()
        .reads(arguments.scenario.file())
        .reads(arguments.port.iter().map(|(_, path)| path))
        .reads(arguments.console.iter().map(|(_, link)| link))
        .reads([image])
        .reads(&arguments.update_key)
        .writes(
            [
                &arguments.pcap,
                &script,
                &arguments.log,
                &arguments.events,
                &arguments.report,
                &arguments.tracks,
                &arguments.animation,
            ]
            .into_iter()
            .flatten(),
        );
    let which = (scenario.name.as_str(), scenario.recorded_path());
    let outputs = arguments.outputs.prepare(which, files)?;
    let speed = arguments.speed.as_ref().and_then(|speed| speed.0);
    ensure!(
        arguments.speed.is_none() || speed == Some(1.0) || arguments.port.is_empty(),
        "real cameras have a time of their own: leave out --speed, or say `--speed real-time`"
    );
    ensure!(
        arguments.image.is_none() || arguments.backend != Backend::Host,
        "--image is for emulated chips: leave it out, or say `--backend nrf52840`"
    );
    ensure!(
        arguments.port.is_empty() || arguments.backend != Backend::Nrf52840,
        "emulated chips have a time of their own, and a real camera another: leave out --port, or say \
         `--backend host`"
    );
    ensure!(
        arguments.gdb.is_none() || arguments.backend == Backend::Nrf52840,
        "--gdb looks into an emulated chip: leave it out, or say `--backend nrf52840`"
    );
    ensure!(
        arguments.track.is_none() || arguments.backend == Backend::Host,
        "--track needs cameras that see what moves, in virtual time: leave it out, or say `--backend host`"
    );
    ensure!(
        arguments.update_key.is_none() || arguments.backend == Backend::Host,
        "--update-key is for nodes that this program runs: leave it out, or say `--backend host`"
    );
    let update_key = arguments.update_key.as_deref();
    let update_key = update_key.map(public_update_key).transpose()?;
    let mut networks = BTreeSet::new();
    for (network, _) in &arguments.console {
        ensure!(
            networks.insert(network),
            "the console of network {network} is on two links: leave one out, or say of which network \
             the other is, as `2:PTY`"
        );
    }
    let mut nodes = BTreeSet::new();
    for (node, _) in &arguments.port {
        ensure!(
            nodes.insert(node),
            "node {node} has two ports: leave one out"
        );
    }
    if let Some((node, _)) = arguments.gdb {
        let site = scenario.rehearsed();
        let (_, site) = site.map_err(|error| arguments.scenario.named(error))?;
        let nodes = ids(&site);
        ensure!(
            nodes.contains(&node),
            "there is no node {node}; there are {}",
            nodes
                .iter()
                .map(u16::to_string)
                .collect::<Vec<_>>()
                .join(", ")
        );
    }
    let mut chips = match arguments.backend {
        Backend::Nrf52840 => Some(Chips::of(image)?),
        Backend::Host => None,
    };
    let [pcap, log] = [&arguments.pcap, &arguments.log].map(|path| path.as_deref().map(Late::new));
    let stop = interrupt::watch()?;
    if let (Some(chips), Some((node, port))) = (&mut chips, arguments.gdb) {
        let port = port.unwrap_or(GDB_PORT);
        chips.debug(node, port, stop.clone())?;
        tell(format_args!("node {node}: target remote :{port}"));
    }
    let options = Options {
        speed,
        chips,
        further_stops: if arguments.until_calibrated {
            arguments.further_stops
        } else {
            0
        },
        update_key,
        stop: stop.clone(),
        pcap: pcap.clone().map(writer),
        log: log.clone().map(writer),
    };
    let happening: Vec<f64> = scenario.events.iter().map(|event| event.at_s).collect();
    let mut simulation =
        Simulation::new(scenario, options).map_err(|error| arguments.scenario.named(error))?;
    for (node, path) in &arguments.port {
        simulation.connect_camera(*node, path)?;
    }
    for (network, link) in &arguments.console {
        let terminal = PseudoTerminal::open(link, CONSOLE_BAUD)?;
        simulation.connect_console(*network, terminal)?;
    }
    for (network, link) in &arguments.console {
        tell(format_args!(
            "network {network}: host-sim console --port {}",
            link.display()
        ));
    }
    if arguments.track.is_some() {
        simulation.take_orders();
    }
    let bar = bar();
    let mut onlooker = arguments.onlooker(&simulation);
    let mut lines = CameraLines::default();
    let mut record = simulation.run_watched(
        LOOKS,
        |progress| show(&bar, &progress),
        |simulation| {
            if let Some(onlooker) = &mut onlooker {
                onlooker.look(simulation);
            }
            lines.show(&bar, simulation);
        },
    );
    bar.finish_and_clear();
    if arguments.until_calibrated {
        let made = simulation.further_stops();
        let stops = if made == 1 { "stop" } else { "stops" };
        tell(format_args!(
            "{made} further {stops}, as the verdict asked{}",
            match simulation.further_end() {
                Some(FurtherEnd::Spent) => ": no more are allowed (--further-stops)",
                Some(FurtherEnd::InVain) => ": the last ones improved nothing",
                Some(FurtherEnd::Unasked) | None => "",
            }
        ));
    }
    tell_of_chips(&simulation);
    let mut tracks = None;
    if let Some(time) = arguments.track
        && !stop.load(Ordering::Relaxed)
    {
        let wall_seconds = record.wall_seconds;
        let tracked = simulation.track(time.as_secs_f64(), LOOKS, |simulation| {
            if let Some(onlooker) = &mut onlooker {
                onlooker.look(simulation);
            }
        });
        let tracked = tracked.context(
            "no object has a place to be at: give the scenario one with a `path`, or cameras that see the same",
        )?;
        record = RunRecord {
            wall_seconds,
            ..tracked.record
        };
        tracks = Some(tracked.rows);
    }
    let trouble = simulation.trouble();
    let is_stopped = stop.load(Ordering::Relaxed);
    let end = match &trouble {
        _ if is_stopped => {
            End::CutShort(format!("interrupted after {:.1} s", simulation.seconds()))
        }
        Some(trouble) => End::CutShort(trouble.to_string()),
        None => End::Whole,
    };
    let seconds = simulation.seconds();
    let missed = happening.iter().filter(|at| **at > seconds).count();
    if missed > 0 && end == End::Whole {
        tell(format_args!(
            "{missed} of {} events did not happen: the run ended before, after {seconds:.0} s",
            happening.len()
        ));
    }
    // Each failure is told, and none keeps the other files from being written.
    let mut ended = finish(&record, &outputs, &end);
    if let Some(onlooker) = onlooker {
        ended = and(ended, onlooker.finish(&simulation, &record, &end));
    }
    for file in [pcap, log].into_iter().flatten() {
        ended = and(ended, file.finish());
    }
    if let (Some(path), Some(rows)) = (&arguments.tracks, &tracks) {
        ended = and(ended, write(path, Ok(end.mark_lines(track_lines(rows)))));
    }
    if let Some(script) = &script {
        ended = and(ended, write(script, Ok(simulation.decryption_script())));
    }
    match trouble {
        _ if is_stopped => ended.map(|_| interrupt::told()),
        Some(trouble) => and(ended, Err(trouble.into())),
        None => ended,
    }
}

/// All nodes of a site.
fn ids(site: &Site) -> BTreeSet<u16> {
    let networks = (0..).zip(&site.networks);
    let of_network = |(number, network): (u16, &Network)| {
        let cameras = network.cameras.iter().map(|camera| camera.id);
        let targets = network.targets.iter().map(|target| target.id);
        let all = cameras.chain(targets).chain([coordinator_id(number)]);
        all.collect::<Vec<_>>()
    };
    networks.flat_map(of_network).collect()
}

/// Tells what emulated chips did that the specification forbids, and how deep their stacks were.
fn tell_of_chips(simulation: &Simulation) {
    let chips = simulation.chips();
    for (id, chip) in &chips {
        for what in &chip.forbidden {
            tell(format_args!("the chip of node {id}: {what}"));
        }
    }
    let deepest = chips.values().map(|chip| chip.stack).max();
    if let Some([used, all]) = deepest.filter(|[_, all]| *all > 0) {
        tell(format_args!("{used} bytes of stack were used, of {all}"));
    }
}

/// `tracks.csv`: the tracks as they were told, and the truth beside them.
fn track_lines(rows: &[TrackRow]) -> String {
    let mut text = "seconds,network,track,x,y,xx,xy,yy,vx,vy,object,true_x,true_y\n".to_owned();
    for row in rows {
        let told = row.told.map_or_else(
            || ",,,,,,".to_owned(),
            |told| {
                let ([x, y], [xx, xy, yy]) = told.place;
                let [vx, vy] = told.velocity;
                format!("{x},{y},{xx},{xy},{yy},{vx},{vy}")
            },
        );
        let truth = row.truth.map_or_else(
            || ",,".to_owned(),
            |(object, place)| format!("{object},{:.4},{:.4}", place.x, place.y),
        );
        let (seconds, network, track) = (row.seconds, row.network, row.track);
        text += &format!("{seconds:.3},{network},{track},{told},{truth}\n");
    }
    text
}

/// Time between two looks for events, nanoseconds.
const LOOKS: u64 = 200_000_000;

/// Files for events.
struct Onlookers {
    onlooker: Onlooker,
    file: Option<Late>,
    report: Option<PathBuf>,
    animation: Option<PathBuf>,
    kept: Vec<Event>,
}

impl Arguments {
    fn onlooker(&self, simulation: &Simulation) -> Option<Onlookers> {
        let is_wanted = [&self.events, &self.report, &self.animation];
        { is_wanted.into_iter().any(Option::is_some) }.then(|| {
            simulation.watch();
            Onlookers {
                onlooker: Onlooker::default(),
                file: self.events.as_deref().map(Late::new),
                report: self.report.clone(),
                animation: self.animation.clone(),
                kept: Vec::new(),
            }
        })
    }
}

impl Onlookers {
    fn look(&mut self, simulation: &Simulation) {
        let events = self.onlooker.look(simulation);
        self.take(events);
    }

    fn take(&mut self, events: Vec<Event>) {
        if let Some(file) = &mut self.file {
            // Errors are told at the end.
            for line in events.iter().filter_map(|event| event.to_line().ok()) {
                let _ = file.write_all(line.as_bytes());
            }
        }
        if self.report.is_some() || self.animation.is_some() {
            self.kept.extend(events);
        }
    }

    fn finish(
        mut self,
        simulation: &Simulation,
        record: &RunRecord,
        end: &End,
    ) -> anyhow::Result<()> {
        let events = self.onlooker.end(simulation, record, end.why());
        self.take(events);
        let mut ended = self.file.map_or(Ok(()), Late::finish);
        if let Some(path) = &self.report {
            let page = report(&self.kept).map_err(anyhow::Error::from);
            ended = and(ended, write(path, page));
        }
        if let Some(path) = &self.animation {
            let picture = animation(&self.kept).map(|svg| end.mark_svg(svg));
            let picture = picture.context("it is not known where the cameras are");
            ended = and(ended, write(path, picture));
        }
        ended
    }
}

/// The script that shows a capture decrypted stands beside the capture, if that is a file.
fn script_of(pcap: &Path) -> Option<PathBuf> {
    let is_other = pcap.metadata().is_ok_and(|pcap| !pcap.is_file());
    let mut script = pcap.as_os_str().to_owned();
    script.push(".sh");
    (!is_other).then(|| script.into())
}

fn writer(file: Late) -> Box<dyn Write> {
    Box::new(file)
}

/// Only on a terminal: `indicatif` hides it otherwise.
fn bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{prefix}{bar:30} stop {pos} of {len}, {msg}");
    let bar = ProgressBar::new(0);
    match style {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// A line for each camera above the bar on a terminal; otherwise one for each change.
#[derive(Default)]
struct CameraLines {
    shown: Option<Instant>,
    told: BTreeMap<u16, Status>,
}

/// Time between two drawings of the lines: a person reads no faster.
const LINES_EVERY: Duration = Duration::from_millis(250);

/// More than these do not fit on a screen.
const LINES_MAX: usize = 40;

impl CameraLines {
    fn show(&mut self, bar: &ProgressBar, simulation: &Simulation) {
        if bar.is_hidden() {
            return self.tell(simulation);
        }
        let is_due = |at: Instant| at.elapsed() >= LINES_EVERY;
        if !self.shown.is_none_or(is_due) {
            return;
        }
        self.shown = Some(Instant::now());
        let record = simulation.record();
        let lines = record
            .cameras()
            .take(LINES_MAX)
            .map(|camera| camera_line(camera) + "\n");
        bar.set_prefix(lines.collect::<String>());
    }

    /// Without a terminal: a line for each camera whose status has changed.
    fn tell(&mut self, simulation: &Simulation) {
        for (id, report) in simulation.new_reports() {
            let status = report.status();
            if self.told.insert(id, status) != Some(status) {
                tell(format_args!(
                    "{:8.1} s  camera {id}: {}, {} sightings",
                    simulation.seconds(),
                    status_words(status, None),
                    report.sightings
                ));
            }
        }
    }
}

/// Progress of a camera, and what it waits for.
fn camera_line(camera: &Node) -> String {
    let status = camera.status.unwrap_or(Status::Waiting);
    let sigma = camera.estimate.map_or_else(
        || "-".to_owned(),
        |estimate| format!("+/- {:.3}", estimate.sigma_position()),
    );
    let words = match camera.address {
        None => "no member yet".to_owned(),
        Some(_) => status_words(status, camera.reason),
    };
    format!(
        "camera {:>4}  {:>2} sightings  {sigma:>11}  {words}",
        camera.id, camera.sightings
    )
}

fn show(bar: &ProgressBar, progress: &Progress) {
    bar.set_length(progress.of as u64);
    bar.set_position(progress.stops as u64);
    bar.set_message(format!(
        "{} of {} cameras calibrated, {:.0} s",
        progress.calibrated, progress.cameras, progress.seconds
    ));
}
