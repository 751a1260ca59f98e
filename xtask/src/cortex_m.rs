//! Instruction counts of the node's routines on emulated processors.

use std::{
    io::Read,
    path::{Path, PathBuf},
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, anyhow, bail, ensure};
use bench_cortex_m::pose;
use board_emulator::{Emulator, Machine, PROGRAM};
use comfy_table::{CellAlignment, Table, presets::ASCII_MARKDOWN};
use xshell::{Shell, cmd};

const PACKAGE: &str = "bench-cortex-m";
/// Its other image, for the processor of the boards: it tests functions in assembly.
const FUNCTIONS: &str = "memory-functions";

/// A run takes seconds; one that takes this long hangs.
const TIMEOUT: Duration = Duration::from_secs(120);
/// How often it is looked at.
const PERIOD: Duration = Duration::from_millis(5);

struct Processor {
    name: &'static str,
    target: &'static str,
    machine: Machine,
}

const PROCESSORS: [Processor; 2] = [
    Processor {
        name: "Cortex-M4F",
        target: "thumbv7em-none-eabihf",
        machine: Machine::Mps2An386,
    },
    Processor {
        name: "Cortex-M0",
        target: "thumbv6m-none-eabi",
        machine: Machine::Microbit,
    },
];

/// The most instructions that routines may take on the Cortex-M4F.
const BUDGETS: [(&str, u64); 5] = [
    ("resection_three_heading", 220),
    ("resection_three_covariance", 600),
    ("cmucam2_parse_26_bytes", 26 * 40),
    // Twenty cameras tell a hundred looks a second: less than a tenth of 64 MHz; and 5 ms at worst.
    ("tracker_look_of_4_objects", 50_000),
    ("tracker_look_while_4_are_found", 300_000),
];

/// Instructions of one call of a routine, over many inputs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Measurement {
    /// The processor's name.
    pub(crate) processor: &'static str,
    /// The routine's name.
    pub(crate) routine: String,
    /// The fewest.
    pub(crate) min: u64,
    /// The middle one.
    pub(crate) median: u64,
    /// The most.
    pub(crate) max: u64,
}

/// Builds the bench for each processor, runs it there, and returns all counts in its order.
pub(crate) fn run(sh: &Shell) -> Result<Vec<Measurement>> {
    let mut measurements = Vec::new();
    for processor in &PROCESSORS {
        let image = build(sh, processor, PACKAGE)?;
        let output = emulate(processor, &image)
            .with_context(|| format!("counting instructions on a {}", processor.name))?;
        measurements.extend(parse(processor.name, &output)?);
        let count = compare_poses(&output)
            .with_context(|| format!("poses solved by a {}", processor.name))?;
        println!(
            "{count} poses solved by a {} have the same bits as this computer's",
            processor.name
        );
    }
    let [processor, ..] = &PROCESSORS;
    let image = build(sh, processor, FUNCTIONS)?;
    emulate(processor, &image).with_context(|| format!("{FUNCTIONS} on a {}", processor.name))?;
    Ok(measurements)
}

/// Fails if a routine is over its budget, or missing.
pub(crate) fn within_budget(measurements: &[Measurement]) -> Result<()> {
    for (routine, budget) in BUDGETS {
        let max = measurements
            .iter()
            .find(|m| m.routine == routine && m.processor == PROCESSORS[0].name)
            .with_context(|| format!("{routine} was not measured"))?
            .max;
        ensure!(
            max <= budget,
            "{routine} takes {max} instructions, its budget is {budget}"
        );
    }
    Ok(())
}

/// A Markdown table: a row per routine, a column per processor.
pub(crate) fn table(measurements: &[Measurement]) -> Table {
    let mut table = Table::new();
    table.load_style(ASCII_MARKDOWN);
    let processors = PROCESSORS.map(|processor| processor.name);
    let heads = processors.map(|name| format!("{name}: min / median / max"));
    table.set_header(["instructions of".to_owned()].into_iter().chain(heads));

    let mut routines: Vec<&str> = Vec::new();
    for measurement in measurements {
        if !routines.contains(&measurement.routine.as_str()) {
            routines.push(&measurement.routine);
        }
    }
    for routine in routines {
        let cells = processors.map(|processor| {
            measurements
                .iter()
                .find(|m| m.processor == processor && m.routine == routine)
                .map_or_else(String::new, |m| {
                    format!("{} / {} / {}", m.min, m.median, m.max)
                })
        });
        table.add_row([routine.to_owned()].into_iter().chain(cells));
    }
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// An image for a processor.
fn build(sh: &Shell, processor: &Processor, image: &str) -> Result<PathBuf> {
    let target = processor.target;
    let messages = cmd!(
        sh,
        "cargo build --locked --release --package {PACKAGE} --bin {image} --target {target} --message-format json-render-diagnostics"
    )
    .read()?;
    for message in messages.lines() {
        let message: serde_json::Value = serde_json::from_str(message)?;
        if message["target"]["name"] == image
            && let Some(image) = message["executable"].as_str()
        {
            return Ok(image.into());
        }
    }
    bail!("cargo built no image `{image}` of {PACKAGE} for {target}")
}

/// What the image prints.
fn emulate(processor: &Processor, image: &Path) -> Result<String> {
    board_emulator::check()?;
    let mut running = Emulator::new(processor.machine, image, Path::new("."))
        .counting()
        .print_to_owner()
        .start()?;
    let mut stdout = running.printed().context("the output is piped")?;
    let reader = thread::spawn(move || {
        let mut output = String::new();
        stdout.read_to_string(&mut output).map(|_| output)
    });
    let begin = Instant::now();
    let status = loop {
        if let Some(status) = running.status() {
            break status;
        }
        let seconds = TIMEOUT.as_secs();
        ensure!(
            begin.elapsed() < TIMEOUT,
            "{PROGRAM} was stopped after {seconds} s"
        );
        thread::sleep(PERIOD);
    };
    let output = reader
        .join()
        .map_err(|_| anyhow!("reading the output of {PROGRAM} panicked"))??;
    ensure!(
        status.success(),
        "{PROGRAM} ended with {status} after printing:\n{output}"
    );
    Ok(output)
}

fn parse(processor: &'static str, output: &str) -> Result<Vec<Measurement>> {
    let mut measurements = Vec::new();
    for line in output.lines() {
        match line.split(' ').collect::<Vec<_>>()[..] {
            ["instructions", routine, min, median, max] => measurements.push(Measurement {
                processor,
                routine: routine.to_owned(),
                min: min.parse()?,
                median: median.parse()?,
                max: max.parse()?,
            }),
            // The image has checked these itself.
            ["calibration", _, _] => {}
            // Compared elsewhere.
            ["pose", ..] => {}
            _ => bail!("{PACKAGE} printed a line that is none of its own: {line}"),
        }
    }
    ensure!(!measurements.is_empty(), "{PACKAGE} counted nothing");
    Ok(measurements)
}

/// Whether the poses of an image are this computer's, to the last bit; how many there are.
fn compare_poses(output: &str) -> Result<usize> {
    let poses: Vec<Vec<u32>> = output
        .lines()
        .filter_map(|line| line.strip_prefix("pose "))
        .map(|line| {
            line.split(' ')
                .map(|bits| Ok(u32::from_str_radix(bits, 16)?))
                .collect()
        })
        .collect::<Result<_>>()?;
    let expected: Vec<_> = pose::scenes().map(|scene| pose::solve(&scene)).collect();
    ensure!(
        poses.len() == expected.len(),
        "{} poses of {} were printed",
        poses.len(),
        expected.len()
    );
    for (pose, expected) in poses.iter().zip(&expected) {
        ensure!(
            pose == expected,
            "{pose:x?} should be {expected:x?}: the arithmetic differs"
        );
    }
    Ok(poses.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    const OUTPUT: &str = "calibration 100 100\ninstructions told 700 924 1148\n";

    fn told(processor: &'static str) -> Measurement {
        Measurement {
            processor,
            routine: "told".to_owned(),
            min: 700,
            median: 924,
            max: 1148,
        }
    }

    #[test]
    fn lines_of_the_image() {
        assert_eq!(parse("M4", OUTPUT).unwrap(), [told("M4")]);
        for bad in [
            "",
            "error x",
            "instructions told 1 2",
            "instructions told 1 2 x",
        ] {
            assert!(parse("M4", bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_pose_with_another_bit_is_noticed() {
        let line = |bits: [u32; 9]| {
            let words = bits.map(|word| format!(" {word:08x}"));
            format!("pose{}\n", words.concat())
        };
        let own: Vec<_> = pose::scenes().map(|scene| pose::solve(&scene)).collect();
        let output: String = own.iter().copied().map(line).collect();
        assert_eq!(compare_poses(&output).unwrap(), own.len());
        let mut other = own;
        other[7][8] ^= 1;
        let output: String = other.iter().copied().map(line).collect();
        assert!(compare_poses(&output).is_err());
        assert!(compare_poses(OUTPUT).is_err());
    }

    #[test]
    fn one_row_per_routine() {
        let table = table(&[told("Cortex-M4F"), told("Cortex-M0")]).to_string();
        let rows: Vec<&str> = table.lines().collect();
        assert_eq!(rows.len(), 3);
        assert_eq!(rows[2].matches("700 / 924 / 1148").count(), 2);
    }
}
