//! `live` with very many cameras: its speed against real time, and the data that it sends.

use std::{
    io::BufRead,
    path::Path,
    process::{Command, Stdio},
};

use super::{page, process::Cost};
use crate::figure::{Goal, Sheet};

const NODES: usize = 1_000;

/// So much of the run is looked at: by then most cameras are calibrated.
const SECONDS: f64 = 600.0;

pub(super) fn run(sheet: &mut Sheet, program: &Path) -> anyhow::Result<()> {
    sheet.heading(&format!(
        "Scale: `host-sim live grid --nodes {NODES}`, as fast as possible"
    ));
    let mut server = Command::new(program)
        .args([
            "live",
            "grid",
            "--nodes",
            &NODES.to_string(),
            "--speed",
            "max",
        ])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()?;
    let watched = watch(&mut server);
    server.kill()?;
    server.wait()?;
    let Watched {
        cost,
        seconds,
        bytes,
        of_verdicts,
    } = watched?;
    let speed = seconds / cost.seconds;
    sheet.figure(
        "simulated seconds for one of processor",
        speed,
        "x",
        &Goal::AtLeast(1.0),
    );
    sheet.figure(
        "sent, for a simulated second",
        bytes / seconds / 1e3,
        "kB",
        &Goal::None,
    );
    let share = of_verdicts / bytes * 100.0;
    sheet.figure("of that, verdicts", share, "%", &Goal::AtMost(10.0));
    sheet.figure("memory at most", cost.peak as f64 / 1e6, "MB", &Goal::None);
    Ok(())
}

struct Watched {
    cost: Cost,
    seconds: f64,
    bytes: f64,
    of_verdicts: f64,
}

/// Reads the messages that a page gets.
fn watch(server: &mut std::process::Child) -> anyhow::Result<Watched> {
    let (mut seconds, mut bytes, mut of_verdicts) = (0.0, 0, 0);
    for line in page(server)?.lines() {
        let line = line?;
        bytes += line.len();
        if line.contains("\"event\":\"verdict") {
            of_verdicts += line.len();
        }
        let told = line.strip_prefix("data:").and_then(|line| {
            let rest = line.trim_start().strip_prefix("{\"seconds\":")?;
            rest.split_once(',')?.0.parse::<f64>().ok()
        });
        seconds = told.unwrap_or(seconds);
        if seconds >= SECONDS || line.contains("\"event\":\"end\"") {
            break;
        }
    }
    Ok(Watched {
        cost: Cost::so_far(server)?,
        seconds,
        bytes: bytes as f64,
        of_verdicts: of_verdicts as f64,
    })
}
