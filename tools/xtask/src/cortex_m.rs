//! Instruction counts of the node's routines on emulated processors.

use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use comfy_table::{CellAlignment, Table, presets::ASCII_MARKDOWN};
use xshell::{Shell, cmd};

use crate::{
    built,
    qemu::{self, CORTEX_M0, CORTEX_M4F, Machine},
};

const PACKAGE: &str = "bench-cortex-m";
/// Its other image, for the processor of the boards: it tests functions in assembly.
const FUNCTIONS: &str = "memory-functions";
/// And one that prints results to compare between machines.
const RESULTS: &str = "results";

/// A processor that an emulator has.
pub(crate) struct Processor {
    name: &'static str,
    target: &'static str,
    machine: Machine,
    /// Options with which [`RESULTS`] prints on this computer what it prints there.
    results: &'static [&'static str],
}

/// The boards' own, and the least that libraries are for.
pub(crate) const PROCESSORS: [Processor; 2] = [
    Processor {
        name: "Cortex-M4F",
        target: "thumbv7em-none-eabihf",
        machine: CORTEX_M4F,
        results: &[],
    },
    Processor {
        name: "Cortex-M0",
        target: "thumbv6m-none-eabi",
        machine: CORTEX_M0,
        results: &["small"],
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

/// Builds the bench for each of these processors, runs it there, and returns all counts in its order.
pub(crate) fn run(sh: &Shell, processors: &[Processor]) -> Result<Vec<Measurement>> {
    let mut measurements = Vec::new();
    for processor in processors {
        let image = build(sh, processor, PACKAGE)?;
        let output = qemu::run(&processor.machine, &image)
            .with_context(|| format!("counting instructions on a {}", processor.name))?;
        measurements.extend(parse(processor.name, &output)?);
        let options = processor.results;
        // With the features of this package alone: others of the workspace change the arithmetic of this computer.
        let own = cmd!(
            sh,
            "cargo run --quiet --locked --package {PACKAGE} --bin {RESULTS} -- {options...}"
        )
        .read()?;
        let (_, printed) = results(sh, processor)?;
        let count = same_bits(&printed, &own)
            .with_context(|| format!("results of a {} and of this computer", processor.name))?;
        println!(
            "{count} results of a {} have the same bits as this computer's",
            processor.name
        );
    }
    let [processor, ..] = &PROCESSORS;
    let image = build(sh, processor, FUNCTIONS)?;
    qemu::run(&processor.machine, &image)
        .with_context(|| format!("{FUNCTIONS} on a {}", processor.name))?;
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

/// A Markdown table: a row per routine, a column per processor that was measured.
pub(crate) fn table(measurements: &[Measurement]) -> Table {
    let mut table = Table::new();
    table.load_style(ASCII_MARKDOWN);
    let mut processors = PROCESSORS.map(|processor| processor.name).to_vec();
    processors.retain(|name| measurements.iter().any(|m| m.processor == *name));
    let heads = processors
        .iter()
        .map(|name| format!("{name}: min / median / max"));
    table.set_header(["instructions of".to_owned()].into_iter().chain(heads));

    let mut routines: Vec<&str> = Vec::new();
    for measurement in measurements {
        if !routines.contains(&measurement.routine.as_str()) {
            routines.push(&measurement.routine);
        }
    }
    for routine in routines {
        let cells = processors.iter().map(|processor| {
            measurements
                .iter()
                .find(|m| m.processor == *processor && m.routine == routine)
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
    built::program(&messages, image).with_context(|| format!("{PACKAGE} for {target}"))
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
            _ => bail!("{PACKAGE} printed a line that is none of its own: {line}"),
        }
    }
    ensure!(!measurements.is_empty(), "{PACKAGE} counted nothing");
    Ok(measurements)
}

/// [`RESULTS`] for a processor, and its output there.
fn results(sh: &Shell, processor: &Processor) -> Result<(PathBuf, String)> {
    let image = build(sh, processor, RESULTS)?;
    let printed = qemu::run(&processor.machine, &image)
        .with_context(|| format!("{RESULTS} on a {}", processor.name))?;
    Ok((image, printed))
}

/// The image that prints results on a Cortex-M4F, and its output in QEMU.
///
/// # Errors
/// It cannot be built or run.
pub(crate) fn results_of_cortex_m4f(sh: &Shell) -> Result<(PathBuf, String)> {
    let [processor, ..] = &PROCESSORS;
    results(sh, processor)
}

/// Checks that two machines have printed the same results, to the last bit; returns their number.
///
/// # Errors
/// One is another one, or missing, or there is none.
pub(crate) fn same_bits(one: &str, other: &str) -> Result<usize> {
    for (one, other) in one.lines().zip(other.lines()) {
        ensure!(
            one == other,
            "`{one}` and `{other}` should be the same: the arithmetic differs"
        );
    }
    let [count, others] = [one, other].map(|output| output.lines().count());
    ensure!(
        count > 0 && count == others,
        "{count} and {others} results were printed"
    );
    Ok(count)
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
    fn another_bit_is_noticed() {
        let own = "pose 0 3f800000 40000000\njoint 1 bf800001\n";
        assert_eq!(same_bits(own, own).unwrap(), 2);
        // The lowest bit of the last number of each line in turn.
        let lines: Vec<_> = own.lines().map(str::to_owned).collect();
        for number in 0..lines.len() {
            let mut other = lines.clone();
            let digit = other[number].pop().and_then(|digit| digit.to_digit(16));
            other[number] += &format!("{:x}", digit.unwrap() ^ 1);
            let told = same_bits(own, &other.join("\n")).unwrap_err();
            assert!(told.to_string().contains("arithmetic"), "{told}");
        }
        let cut = own.trim_end().rsplit_once('\n').unwrap().0;
        assert!(same_bits(own, cut).is_err() && same_bits(cut, own).is_err());
        assert!(same_bits("", "").is_err());
    }

    #[test]
    fn one_row_per_routine() {
        let table = table(&[told("Cortex-M4F"), told("Cortex-M0")]).to_string();
        let rows: Vec<&str> = table.lines().collect();
        assert_eq!(rows.len(), 3);
        assert_eq!(rows[2].matches("700 / 924 / 1148").count(), 2);
    }
}
