//! Cost of a process, as Linux counts it.

use std::{
    fs,
    io::Read,
    process::{Child, Command, Stdio},
    thread,
    time::Duration,
};

use anyhow::{Context, ensure};

/// Interval at which memory is looked at. The kernel keeps the peak, so only growth in the last moments is missed.
const LOOKS: Duration = Duration::from_millis(2);

/// Linux counts processor time in these, seconds.
const TICK: f64 = 0.01;

/// Cost of a process.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cost {
    /// Time of the processor, of all its threads.
    pub(super) seconds: f64,
    /// Bytes of memory, at most.
    pub(super) peak: u64,
}

impl Cost {
    /// One after the other.
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            seconds: self.seconds + other.seconds,
            peak: self.peak.max(other.peak),
        }
    }

    /// Cost of a process that runs, so far.
    pub(super) fn so_far(child: &Child) -> anyhow::Result<Self> {
        let id = child.id();
        Ok(Self {
            seconds: ticks(&format!("/proc/{id}/stat"), 13)? * TICK,
            peak: peak(id).context("its memory is not told")?,
        })
    }
}

/// Runs a program to its end, which is one of these codes. Returns its output, and its cost.
pub(super) fn measured(command: &mut Command, codes: &[i32]) -> anyhow::Result<(String, Cost)> {
    let before = of_children()?;
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()?;
    let mut output = child.stdout.take().context("the output is piped")?;
    let reader = thread::spawn(move || {
        let mut said = String::new();
        output.read_to_string(&mut said).map(|_| said)
    });
    let mut most = 0;
    let status = loop {
        most = most.max(peak(child.id()).unwrap_or_default());
        if let Some(status) = child.try_wait()? {
            break status;
        }
        thread::sleep(LOOKS);
    };
    let said = reader.join().ok().context("its output is no text")??;
    ensure!(
        status.code().is_some_and(|code| codes.contains(&code)),
        "{command:?}: {status}"
    );
    let cost = Cost {
        seconds: of_children()? - before,
        peak: most,
    };
    Ok((said, cost))
}

/// Processor time of all processes that this one has waited for, seconds.
fn of_children() -> anyhow::Result<f64> {
    Ok(ticks("/proc/self/stat", 15)? * TICK)
}

/// The sum of two neighbouring counts in a file of the kernel's: of the program, and of the kernel for it.
fn ticks(file: &str, first: usize) -> anyhow::Result<f64> {
    let text = fs::read_to_string(file).with_context(|| format!("{file}: Linux alone has it"))?;
    // The name of the program, in parentheses, may have blanks.
    let (_, rest) = text.rsplit_once(')').context("no name")?;
    let counts = rest.split_whitespace().skip(first - 2).take(2);
    let counts: Result<Vec<f64>, _> = counts.map(str::parse).collect();
    Ok(counts?.iter().sum())
}

/// Bytes, at most, of a process that has not ended.
fn peak(id: u32) -> Option<u64> {
    let text = fs::read_to_string(format!("/proc/{id}/status")).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix(" kB")?.parse().ok()?;
    Some(kib << 10)
}
