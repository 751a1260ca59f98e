//! Speed and memory with many nodes, of `host-sim` as people run it.
//!
//! | module | rows |
//! |---|---|
//! | this one | `run grid` of 13 to 10,000 nodes |
//! | `broker` | `live --mqtt` of 1,000 cameras on 40 publishers, a topic of its own |
//! | `live` | `live grid` of 1,000 nodes: the data that its page is sent, and their cost |
//! | `solve` | `solve` of a million cases |
//! | `solve_network` | `solve-network` of up to 1,000 cameras |
//!
//! Processor time is counted, which other work on the machine changes little; each run is a process of its own, so
//! that peaks of memory are its own too.

use std::{
    io::{BufRead, BufReader, Write},
    net::TcpStream,
    path::PathBuf,
    process::{Child, Command},
};

use anyhow::{Context, ensure};

pub(crate) mod broker;
mod live;
mod process;
mod solve;
mod solve_network;

use self::process::Cost;
use crate::figure::{Goal, Sheet};

/// Nodes, number of runs, and the least multiple of real time.
const GRIDS: [(usize, u32, f64); 4] = [
    (13, 20, 30_000.0),
    (100, 4, 4_000.0),
    (1_000, 1, 300.0),
    (10_000, 1, 30.0),
];

/// Processor time may grow with the number of nodes to this power.
const GROWTH: f64 = 1.1;

pub(crate) fn run(sheet: &mut Sheet) -> anyhow::Result<()> {
    let program = program()?;
    sheet.heading("Scale: `host-sim run grid`, simulated seconds for a second of processor");
    let mut times = Vec::new();
    for (nodes, runs, goal) in GRIDS {
        let mut seconds = 0.0;
        let mut cost = Cost::default();
        for _ in 0..runs {
            let mut grid = Command::new(&program);
            grid.args(["run", "grid", "--details", "--nodes", &nodes.to_string()]);
            let (said, own) = process::measured(&mut grid, &[0, 1])?;
            seconds += simulated(&said)?;
            cost = cost.and(own);
        }
        let speed = seconds / cost.seconds;
        sheet.figure(&format!("{nodes} nodes"), speed, "x", &Goal::AtLeast(goal));
        let memory = cost.peak as f64 / 1e6;
        let name = format!("{nodes} nodes, memory at most");
        sheet.figure(&name, memory, "MB", &Goal::None);
        times.push((nodes as f64, speed.recip()));
    }
    for pair in times.windows(2) {
        let [(fewer, less), (more, longer)] = [pair[0], pair[1]];
        let power = f64::ln(longer / less) / f64::ln(more / fewer);
        let name = format!("growth from {fewer} to {more} nodes: power");
        // The smallest one takes most of its time to start a program.
        let goal = match fewer < 100.0 {
            true => Goal::None,
            false => Goal::AtMost(GROWTH),
        };
        sheet.figure(&name, power, "", &goal);
    }
    live::run(sheet, &program)?;
    solve::run(sheet, &program)?;
    solve_network::run(sheet)
}

/// `host-sim`, built as people build it.
fn program() -> anyhow::Result<PathBuf> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let built = Command::new(cargo)
        .args(["build", "--locked", "--release", "--package", "host-sim"])
        .status()?;
    ensure!(built.success(), "host-sim does not compile");
    // This program is in the same folder.
    let folder = std::env::current_exe()?;
    let folder = folder.parent().context("a program is in a folder")?;
    Ok(folder.join("host-sim"))
}

/// The simulated seconds that a report tells.
fn simulated(report: &str) -> anyhow::Result<f64> {
    let told = report.lines().find_map(|line| {
        let rest = line.strip_prefix("Simulated ")?;
        rest.split_once(" s ")?.0.parse().ok()
    });
    told.context("the report tells no simulated time")
}

/// The messages that the page of a `live` gets.
fn page(live: &mut Child) -> anyhow::Result<BufReader<TcpStream>> {
    let output = live.stdout.take().context("the output is piped")?;
    let mut url = String::new();
    BufReader::new(output).read_line(&mut url)?;
    let told = url.trim().strip_prefix("http://");
    let (address, token) = told
        .and_then(|told| told.split_once("/#"))
        .context("no address")?;
    let mut stream = TcpStream::connect(address)?;
    write!(
        stream,
        "GET /events?token={token} HTTP/1.0\r\nHost: {address}\r\n\r\n"
    )?;
    Ok(BufReader::new(stream))
}
