//! `host-sim update`

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::Arc,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail, ensure};
use board_facts::BOARDS;
use clap::Args;
use embedded_io::{Read, ReadReady, Write};
use host_sim::{
    console::{
        session::{Failure, frame},
        update as exchange,
    },
    logging,
    probe::port::{Port, PortError},
};
use indicatif::{ProgressBar, ProgressStyle};
use node_firmware::{
    console::{Frames, FromPc, ToPc},
    limits::CONSOLE_BAUD,
};
use radio_update::{
    package::Package,
    packet::Phase,
    sender::{Node, Sender},
    stamp::{Stamp, board_number},
};
use site::key_file;
use tracing::{info, warn};

use super::{
    OfFile, file_name, files::Files, interrupt, log_options::LogOptions, print, tell, values,
};

/// Gives all nodes of a network a new image, by radio.
///
/// The coordinator on the line hands the image on, in blocks that all nodes hear at once; what a node misses is sent
/// again. When all have it they change to it, the coordinator last. A node whose new image does not find the network
/// within ten minutes goes back to the former one.
///
/// An update that was interrupted goes on with the same command. Exit code 1: some nodes do not run the new image.
#[derive(Args)]
#[command(after_long_help = EPILOGUE)]
pub(super) struct Arguments {
    /// The serial port of the coordinator.
    #[arg(long, value_name = "DEV")]
    port: String,
    /// The image, of `cargo xtask firmware --update VERSION`: the file that ends in `-update-node.elf` or `.bin`.
    #[arg(long, value_name = "FILE")]
    image: PathBuf,
    /// The key of `host-sim keygen --updates` that the nodes were provisioned with.
    #[arg(long, value_name = "FILE")]
    key: PathBuf,
    /// Only these nodes, by their numbers; 0 is the coordinator. Can be given several times.
    #[arg(long, value_name = "ID", value_parser = values::whole(0, u16::MAX))]
    node: Vec<u16>,
    /// Bits per second.
    #[arg(long, value_name = "RATE", default_value_t = CONSOLE_BAUD, value_parser = values::whole(1, u32::MAX))]
    baud: u32,
    #[command(flatten)]
    log: LogOptions,
}

const EPILOGUE: &str = "\
Examples:
  cargo xtask firmware --update 7
  host-sim update --port /dev/ttyACM0 --key office.updatekey --image target/firmware/nrf52840-update-node.elf";

/// Time without a further member after which all are listed.
const QUIET: Duration = Duration::from_secs(2);
/// Time in which a coordinator answers, and time after which it is asked again.
const ANSWERS: Duration = Duration::from_secs(12);
const AGAIN: Duration = Duration::from_secs(3);
/// Time between two looks at the line.
const LOOK: Duration = Duration::from_millis(2);

/// Records without --log: the standard error output has words for people instead.
const LOG: &str = "host_sim=error";

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    arguments.log.start(LOG)?;
    Files::default()
        .reads([&arguments.image, &arguments.key])
        .check()?;
    let secret = key_file::read_update_key(&arguments.key);
    let secret = secret.with_context(|| OfFile::named(&arguments.key))?;
    let image = read_image(&arguments.image)?;
    let package = Package::sign(&image, &secret);
    let package =
        package.map_err(|why| anyhow::anyhow!("{}: {why}", file_name(&arguments.image)))?;
    let interrupted = interrupt::watch()?;
    let mut line = Line {
        port: Port::open(&arguments.port, arguments.baud, Arc::clone(&interrupted))?,
        frames: Frames::default(),
        begun: Instant::now(),
    };
    let done = list(&mut line, arguments).and_then(|nodes| spread(&mut line, package, &nodes));
    match done {
        Err(error) if is_interruption(&error) => {
            tell("The nodes keep what they have: the same command goes on.");
            Ok(interrupt::told())
        }
        Err(error) if matches!(error.downcast_ref(), Some(PortError::Io(_))) => {
            let port = &arguments.port;
            warn!(port, "the line is gone");
            Err(error.context(format!(
                "{port} went away; the nodes keep what they have, and the same command goes on"
            )))
        }
        done => done,
    }
}

fn is_interruption(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref(), Some(PortError::Interrupted))
}

/// The bytes of an image, of an ELF file or as they are.
fn read_image(path: &Path) -> Result<Vec<u8>> {
    let name = file_name(path);
    let bytes = fs::read(path).with_context(|| OfFile::unread(path))?;
    let Some((_, stamp)) = Stamp::find(&bytes) else {
        bail!(
            "{name} is no image for updates by radio: make one with `cargo xtask firmware --update VERSION`, and name \
             the file that ends in `-update-node.elf` or `-update-node.bin`"
        );
    };
    if !bytes.starts_with(b"\x7fELF") {
        return Ok(bytes);
    }
    let board = BOARDS
        .into_iter()
        .find(|board| board_number(board.name) == stamp.board);
    let board = board.with_context(|| format!("{name} is for a board that is not known here"))?;
    flash_file::updated(board, &bytes).with_context(|| name)
}

/// The coordinator's line.
struct Line {
    port: Port,
    frames: Frames,
    begun: Instant,
}

impl Line {
    fn now(&self) -> Duration {
        self.begun.elapsed()
    }

    /// Messages that have come.
    fn read(&mut self) -> Result<Vec<ToPc>, PortError> {
        let mut told = Vec::new();
        let mut bytes = [0; 512];
        while self.port.read_ready()? {
            let count = self.port.read(&mut bytes)?;
            told.extend(
                bytes[..count]
                    .iter()
                    .filter_map(|byte| self.frames.push::<ToPc>(*byte)),
            );
        }
        Ok(told)
    }

    fn send(&mut self, message: &FromPc) -> Result<(), PortError> {
        self.port.write_all(&frame(message))
    }
}

/// Numbers of nodes by their addresses; the coordinator has the address and the number 0.
type Nodes = BTreeMap<u16, u16>;

/// Asks the coordinator for its members.
fn list(line: &mut Line, arguments: &Arguments) -> Result<Nodes> {
    let mut nodes = Nodes::from([(0, 0)]);
    let (mut heard, mut asked) = (None, None);
    loop {
        let now = line.now();
        if asked.is_none_or(|at| now > at + AGAIN) && heard.is_none() {
            line.send(&FromPc::Refresh)?;
            asked = Some(now);
        }
        for message in line.read()? {
            heard = heard.or(Some(now));
            if let ToPc::Member { address, hello } = message
                && nodes.insert(address, hello.id).is_none()
            {
                heard = Some(now);
            }
        }
        match heard {
            None => ensure!(now < ANSWERS, Failure::Silence),
            Some(at) if now > at + QUIET => break,
            Some(_) => {}
        }
        std::thread::sleep(LOOK);
    }
    let missing = arguments
        .node
        .iter()
        .find(|id| !nodes.values().any(|known| known == *id));
    if let Some(id) = missing {
        let members: Vec<_> = nodes.values().map(u16::to_string).collect();
        bail!(
            "node {id} is no member of this network: there are {}",
            members.join(", ")
        );
    }
    if !arguments.node.is_empty() {
        nodes.retain(|_, id| arguments.node.contains(id));
    }
    Ok(nodes)
}

/// Spreads a package, and tells how it went.
fn spread(line: &mut Line, package: Package, nodes: &Nodes) -> Result<ExitCode> {
    let stamp = package.stamp().context("a package has a header")?;
    let blocks = package.blocks();
    tell(format_args!(
        "Version {} for {} nodes, {blocks} blocks.",
        stamp.version,
        nodes.len()
    ));
    let bar = ProgressBar::new(blocks as u64);
    logging::keep_clear_of(&bar);
    bar.set_style(ProgressStyle::with_template(
        "{wide_bar} {pos}/{len} {msg}",
    )?);
    let mut sender = Sender::new(package, nodes.keys().copied(), 0);
    let mut told: BTreeMap<u16, Option<Phase>> = BTreeMap::new();
    while !sender.is_done() {
        let now = line.now();
        for message in line.read()? {
            exchange::hear(&mut sender, now, &message);
        }
        while let Some(message) = exchange::say(&mut sender, now) {
            line.send(&message)?;
        }
        bar.set_position((blocks.saturating_sub(sender.waiting())) as u64);
        for (address, node) in sender.nodes() {
            let is_news = told.insert(*address, node.phase) != Some(node.phase);
            if let Some(phase) = node.phase.filter(|_| is_news) {
                info!(address, node = nodes.get(address), "{phase}");
            }
            if let Some(phase) = node.phase.filter(|_| is_news)
                && (phase.is_refusal() || matches!(phase, Phase::Installed | Phase::Reverted))
            {
                bar.suspend(|| tell(words(nodes, *address, node)));
            }
        }
        std::thread::sleep(LOOK);
    }
    bar.finish_and_clear();
    let is_new = |node: &&Node| node.phase == Some(Phase::Installed);
    let count = sender.nodes().values().filter(is_new).count();
    let others = sender.nodes().iter().filter(|(_, node)| !is_new(node));
    let mut text: String = others
        .map(|(address, node)| words(nodes, *address, node) + "\n")
        .collect();
    text += &format!(
        "{count} of {} nodes run version {}. {} blocks were sent for {blocks}.\n",
        nodes.len(),
        stamp.version,
        sender.sent().blocks
    );
    print(&text)?;
    Ok(match sender.has_succeeded() {
        true => ExitCode::SUCCESS,
        false => ExitCode::from(1),
    })
}

/// State of a node for people.
fn words(nodes: &Nodes, address: u16, node: &Node) -> String {
    let name = match nodes.get(&address) {
        Some(0) | None => "The coordinator".to_owned(),
        Some(id) => format!("Node {id}"),
    };
    match node.phase {
        None => format!("{name} does not answer, or its image does not take updates by radio."),
        Some(phase) => format!("{name} {phase}."),
    }
}
