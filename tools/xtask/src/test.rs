//! `cargo xtask test`: all that must hold before a change lands. CI runs this and nothing else.

use std::{
    fs::{self, File},
    path::PathBuf,
    process::{Child, Command, ExitCode, Stdio},
};

use anyhow::{Context, Error, Result, ensure};
use board_facts::{
    BOARDS,
    chip::{Chip, NRF52840},
};
use clap::builder::PossibleValuesParser;
use xshell::{Shell, cmd};

use crate::{
    chip, cortex_m, firmware, fuzz, harness, peers, publish, scale, setup, size,
    usage::{self, Meter, Usage},
    words,
};

/// Everything that must hold, stage by stage
///
/// Installs what is missing where that is allowed, and stops at the first stage that fails. Of each
/// program that is missing and cannot be installed it says what to type; in CI that is an error, and
/// elsewhere the stages that need it are left out and named in the summary. A table tells what each stage
/// took. The last line counts: `12 passed, 0 failed`.
#[derive(clap::Args)]
pub(crate) struct Test {
    /// Only this stage; may be given several times
    #[arg(long = "stage", value_name = "NAME", value_parser = PossibleValuesParser::new(STAGES.map(|stage| stage.name)))]
    stages: Vec<String>,
    /// Also the stages of the night, and the long form of tests that have one
    #[arg(long)]
    all: bool,
}

/// Variable that tells tests to take their long form.
const LONG: &str = "XTASK_ALL";

/// Compilation units of a run that begins with nothing built. CI fails with 5 % more: a dependency, a profile or a
/// set of features that is new costs every developer time.
const UNITS: usize = 1_100;

/// Libraries that run on a node.
pub(crate) const FIRMWARE_CRATES: [&str; 9] = [
    "calib-core",
    "cmucam2-driver",
    "flash-log",
    "node-firmware",
    "pedestrian",
    "pixy-driver",
    "radio-update",
    "spinel-radio",
    "zigbee-link",
];

/// Programs for bare processors, of which little compiles for this computer.
const BARE_CRATES: [&str; 2] = ["bench-cortex-m", "memory-functions"];

#[derive(Clone, Copy)]
struct Stage {
    name: &'static str,
    what: &'static str,
    /// Installs what it needs and not every machine has.
    needs: fn(&Shell) -> Result<()>,
    run: fn(&Shell) -> Result<()>,
    /// Runs only with `--all`, or where it is named.
    nightly: bool,
    /// Runs beside others, in a process of its lane.
    lane: Option<Lane>,
}

/// Stages of a lane run one after the other, beside those of other lanes and of none: some steps of a stage keep only
/// one processor busy. A lane begins where its first stage stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lane {
    /// Builds for boards, from nothing that others build.
    Boards,
    /// Keeps one processor busy, or none: as the emulated chips do, which run meanwhile.
    Short,
}

impl Lane {
    /// Name of its process's files.
    const fn name(self) -> &'static str {
        match self {
            Self::Boards => "boards",
            Self::Short => "short",
        }
    }
}

const fn stage(name: &'static str, what: &'static str, run: fn(&Shell) -> Result<()>) -> Stage {
    Stage {
        name,
        what,
        needs: nothing,
        run,
        nightly: false,
        lane: None,
    }
}

impl Stage {
    const fn needs(self, needs: fn(&Shell) -> Result<()>) -> Self {
        Self { needs, ..self }
    }

    const fn nightly(self) -> Self {
        Self {
            nightly: true,
            ..self
        }
    }

    const fn lane(self, lane: Lane) -> Self {
        Self {
            lane: Some(lane),
            ..self
        }
    }
}

const STAGES: [Stage; 23] = [
    stage(
        "set-up",
        "tools that the others need, and a lock file that fits",
        set_up,
    ),
    stage(
        "format",
        "code as rustfmt writes it, and plain words in comments and pages",
        format,
    ),
    stage(
        "firmware",
        "images of the boards, their sizes, and where they may panic",
        firmware::audit,
    )
    .needs(setup::linker)
    .lane(Lane::Boards),
    stage("size", "flash and RAM of the link", measure)
        .needs(setup::linker)
        .lane(Lane::Boards),
    // They build where the stage `test` does, and wait for it.
    stage("count", "instructions on an emulated Cortex-M4F", count)
        .needs(setup::packages)
        .lane(Lane::Boards),
    stage("lint", "clippy on code that only boards run", lint).lane(Lane::Boards),
    stage(
        "document",
        "documentation of the libraries without a warning",
        document,
    )
    .lane(Lane::Boards),
    stage(
        "test",
        "clippy on all code for this computer, and all tests that need nothing else",
        harness::workspace,
    ),
    stage(
        "peers",
        "tests against programs of other projects",
        peers::run,
    )
    .needs(setup::packages)
    .lane(Lane::Short),
    stage(
        "chip",
        "the image that is flashed, on an emulated nRF52840",
        chip::run,
    )
    .needs(packages_and_linker),
    stage(
        "scale",
        "instructions of short runs of host-sim",
        scale::run,
    )
    .needs(setup::packages)
    .lane(Lane::Short),
    stage(
        "bench",
        "figures of the README that are quickly computed",
        bench,
    )
    .lane(Lane::Short),
    stage(
        "campaign",
        "random sites with faults of all kinds",
        campaign,
    )
    .lane(Lane::Short),
    stage(
        "bare",
        "each library with and without its features, on two processors",
        bare,
    )
    .nightly(),
    stage(
        "document-all",
        "documentation of all crates without a warning",
        document_all,
    )
    .nightly(),
    stage(
        "publish",
        "libraries as packages, each of their features alone, and changes since the last version",
        publish::run,
    )
    .nightly(),
    stage(
        "outside",
        "a crate of its own that uses all libraries, by path and by package",
        publish::outside,
    )
    .nightly(),
    stage(
        "outside-others",
        "the same for other processors",
        publish::outside_others,
    )
    .needs(setup::other_targets)
    .nightly(),
    stage(
        "count-all",
        "instructions on all emulated processors",
        count_all,
    )
    .needs(setup::packages)
    .nightly(),
    stage(
        "boards",
        "images of all other boards, and a dongle and a kit with a PC at the plug of the chip",
        other_boards,
    )
    .needs(setup::linker)
    .nightly(),
    stage("browsers", "the page in Firefox", peers::firefox)
        .needs(setup::firefox)
        .nightly(),
    stage("fuzz", "fuzz targets, guided by coverage", fuzz::briefly).nightly(),
    stage(
        "soak",
        "long runs: parsers, power cuts, a walk on emulated chips, campaign",
        soak,
    )
    .needs(packages_and_linker)
    .nightly(),
];

impl Test {
    pub(crate) fn run(&self, sh: &Shell) -> ExitCode {
        let is_chosen = |stage: &Stage| {
            if self.stages.is_empty() {
                self.all || !stage.nightly
            } else {
                self.stages.iter().any(|name| name == stage.name)
            }
        };
        let chosen: Vec<_> = STAGES.into_iter().filter(is_chosen).collect();
        let _long = self.all.then(|| sh.push_env(LONG, "1"));
        let is_cold = harness::is_cold(sh);
        let counting = usage::count_units(sh).unwrap_or_else(|error| {
            crate::complain(&error.context("compilation units are not counted"));
            None
        });
        let (mut count, units) = run(sh, &chosen, setup::is_ci());
        // The figure is that of all stages of every day.
        let is_whole = count.passed == chosen.len() && self.stages.is_empty() && !self.all;
        if is_whole
            && is_cold
            && counting.is_some()
            && let Err(error) = compare_units(units)
        {
            crate::complain(&error);
            count.failed += usize::from(setup::is_ci());
        }
        if count.passed == chosen.len() && count.failed == 0 && self.stages.is_empty() {
            eprintln!("all {} stages passed", chosen.len());
        }
        eprintln!("{}", count.line());
        if count.failed == 0 {
            ExitCode::SUCCESS
        } else {
            ExitCode::FAILURE
        }
    }
}

/// Compares the compilation units of a whole run with the figure that is known.
fn compare_units(units: usize) -> Result<()> {
    ensure!(
        units <= UNITS + UNITS / 20,
        "{units} compilation units, where {UNITS} are known: `cargo tree --duplicates` and the profiles tell \
         what is new. If it is worth its time, change UNITS in tools/xtask/src/test.rs"
    );
    if units < UNITS - UNITS / 20 {
        eprintln!(
            "{units} compilation units, where {UNITS} are known: lower UNITS in tools/xtask/src/test.rs"
        );
    }
    Ok(())
}

/// Runs stages until one fails, and prints the time that each took. Returns the compilation units of all. Of several
/// stages, one that [waits](Stage::waits) runs beside those that follow.
fn run(sh: &Shell, stages: &[Stage], is_ci: bool) -> (Count, usize) {
    let whole = Meter::start(sh);
    let mut summary = format!("{:>7} {:>9} {:>6}\n", "wall", "processor", "units");
    let mut count = Count::default();
    let mut failure = None;
    let mut lanes: Vec<Beside<'_>> = Vec::new();
    // A lane of its own has no others beside it.
    let lane_of = |stage: &Stage| {
        let has_others = stages.iter().any(|other| other.lane != stage.lane);
        stage.lane.filter(|_| has_others)
    };
    // Before a stage builds this program anew in its place.
    if stages.iter().any(|stage| lane_of(stage).is_some())
        && let Err(error) = crate::copy_of_this(&crate::tool(sh, BESIDE))
    {
        crate::complain(&error);
    }
    for stage in stages {
        if lanes.iter_mut().any(Beside::has_failed) {
            break;
        }
        if let Some(lane) = lane_of(stage) {
            if lanes.iter().any(|beside| beside.lane == lane) {
                continue;
            }
            let of_lane = stages.iter().filter(|other| other.lane == Some(lane));
            match Beside::start(sh, lane, of_lane.collect()) {
                Ok(beside) => {
                    let names: Vec<_> = beside.stages.iter().map(|stage| stage.name).collect();
                    let names = names.join(", ");
                    eprintln!("\n==> {names}: beside what follows; the output comes at the end");
                    lanes.push(beside);
                    continue;
                }
                Err(error) => {
                    failure = Some(error);
                    count.failed += 1;
                    break;
                }
            }
        }
        eprintln!("\n==> {}: {}", stage.name, stage.what);
        let meter = Meter::start(sh);
        let outcome = match left_out(stage, sh, is_ci) {
            Ok(None) => (stage.run)(sh).map(|()| None),
            missing => missing,
        };
        failure = count.add(stage, outcome, &meter, &mut summary);
        if failure.is_some() {
            break;
        }
    }
    for beside in lanes {
        let failed = beside.end(sh, &mut count, &mut summary).err();
        failure = failure.or(failed);
    }
    count.not_run = stages.len() - count.passed - count.failed - count.left_out;
    let (row, units) = row(&whole, "in all");
    eprintln!("\n{summary}{row}");
    if let Some(error) = failure {
        crate::complain(&error);
    }
    (count, units)
}

/// Name of the copy of this program that runs stages beside others.
const BESIDE: &str = "beside";

/// A lane that runs beside others, as a process of its own.
struct Beside<'s> {
    lane: Lane,
    stages: Vec<&'s Stage>,
    process: Child,
    /// File of what it prints.
    said: PathBuf,
    /// File in which its compilation units are counted.
    units: PathBuf,
}

impl<'s> Beside<'s> {
    fn start(sh: &Shell, lane: Lane, stages: Vec<&'s Stage>) -> Result<Self> {
        let this = crate::tool(sh, BESIDE);
        let tools = sh.create_dir("target/tools")?;
        let [said, units] =
            ["out", "units"].map(|kind| tools.join(lane.name()).with_extension(kind));
        let output = File::create(&said).with_context(|| said.display().to_string())?;
        let chosen = stages.iter().flat_map(|stage| ["--stage", stage.name]);
        let mut command = Command::from(cmd!(sh, "{this} test {chosen...}"));
        command.stdin(Stdio::null());
        command.stdout(output.try_clone()?).stderr(output);
        if sh.var_os(usage::COUNT_IN).is_some() {
            File::create(&units).with_context(|| units.display().to_string())?;
            command.env(usage::COUNT_IN, &units);
        }
        let process = command
            .spawn()
            .with_context(|| this.display().to_string())?;
        Ok(Self {
            lane,
            stages,
            process,
            said,
            units,
        })
    }

    /// Returns true once it has ended with a failure.
    fn has_failed(&mut self) -> bool {
        matches!(self.process.try_wait(), Ok(Some(status)) if !status.success())
    }

    /// Waits for its end, prints its output, and adds what it took and how its stages ended.
    fn end(mut self, sh: &Shell, count: &mut Count, summary: &mut String) -> Result<()> {
        let status = self.process.wait();
        let said = fs::read(&self.said).unwrap_or_default();
        let said = String::from_utf8_lossy(&said);
        eprint!("{said}");
        usage::add(sh, &self.units);
        for stage in &self.stages {
            // Where there is no row, the stage did not run.
            let Some((row, end)) = ended(&said, stage.name) else {
                continue;
            };
            *match end {
                "" => &mut count.passed,
                LEFT_OUT => &mut count.left_out,
                _ => &mut count.failed,
            } += 1;
            *summary += row;
            *summary += "\n";
        }
        let name = self.lane.name();
        let status = status.with_context(|| format!("the lane `{name}`"))?;
        ensure!(
            status.success(),
            "the lane `{name}` ended with {status}: see its output"
        );
        Ok(())
    }
}

/// Looks up a stage's row in the output of a lane, and returns it with the word that tells how it ended, if the stage
/// did not just pass.
fn ended<'s>(said: &'s str, stage: &str) -> Option<(&'s str, &'s str)> {
    let rows = said.lines().filter_map(|line| line.strip_prefix(ROW));
    let mut of_stage = rows.filter_map(|row| {
        let mut words = row.split_ascii_whitespace();
        // Wall, unit, processor, unit, units. A line that begins a stage has words there.
        let has_times = words.nth(1) == Some("s") && words.nth(1) == Some("s");
        let name = words.nth(1).filter(|_| has_times)?;
        let is_this = name.trim_end_matches(':') == stage;
        is_this.then(|| (row, words.next().unwrap_or_default()))
    });
    of_stage.next_back()
}

/// Begin of a line that tells what a stage took.
const ROW: &str = "==>";
/// First words of how stages end.
const LEFT_OUT: &str = "LEFT";

/// A row of the table of stages, and its compilation units.
fn row(meter: &Result<Meter>, what: &str) -> (String, usize) {
    let usage = match meter {
        Ok(meter) => meter.read().unwrap_or_default(),
        Err(_) => Usage::default(),
    };
    let Usage {
        wall,
        processor,
        units,
    } = usage;
    let (wall, processor) = (wall.as_secs_f64(), processor.as_secs_f64());
    let row = format!("{wall:5.0} s {processor:7.0} s {units:6}  {what}\n");
    (row, units)
}

/// Number of stages that came to each end.
#[derive(Debug, Default, PartialEq)]
struct Count {
    passed: usize,
    failed: usize,
    left_out: usize,
    not_run: usize,
}

impl Count {
    /// Counts how a stage ended, and adds its row. Returns the reason of a failure.
    fn add(
        &mut self,
        stage: &Stage,
        outcome: Result<Option<String>>,
        meter: &Result<Meter>,
        summary: &mut String,
    ) -> Option<Error> {
        let mut failure = None;
        let said = match outcome {
            Ok(None) => {
                self.passed += 1;
                String::new()
            }
            Ok(Some(why)) => {
                self.left_out += 1;
                format!(": {LEFT_OUT} OUT: {why}")
            }
            Err(error) => {
                self.failed += 1;
                failure = Some(error.context(format!("stage `{}`", stage.name)));
                ": FAILED".to_owned()
            }
        };
        let row = row(meter, &format!("{}{said}", stage.name)).0;
        eprint!("{ROW}{row}");
        *summary += &row;
        failure
    }

    fn line(&self) -> String {
        let mut line = format!("{} passed, {} failed", self.passed, self.failed);
        for (count, what) in [(self.left_out, "left out"), (self.not_run, "not run")] {
            if count > 0 {
                line += &format!(", {count} {what}");
            }
        }
        line
    }
}

/// Program that a stage lacks: the one rule for leaving stages out.
fn left_out(stage: &Stage, sh: &Shell, is_ci: bool) -> Result<Option<String>> {
    match (stage.needs)(sh) {
        Ok(()) => Ok(None),
        Err(error) if is_ci => Err(error),
        Err(error) => Ok(Some(format!("{error:#}"))),
    }
}

fn nothing(_: &Shell) -> Result<()> {
    Ok(())
}

fn packages_and_linker(sh: &Shell) -> Result<()> {
    setup::packages(sh)?;
    setup::linker(sh)
}

/// Installs the tools of later stages, so that it is told at once if one cannot be installed. Sources and tools
/// that are built are fetched where they are needed, and so are those of stages of the night that do not run.
fn set_up(sh: &Shell) -> Result<()> {
    setup::locked(sh)?;
    setup::targets(sh)?;
    let is_all = sh.var_os(LONG).is_some();
    for stage in STAGES.iter().filter(|stage| is_all || !stage.nightly) {
        if let Some(why) = left_out(stage, sh, setup::is_ci())? {
            eprintln!("{} will be left out: {why}", stage.name);
        }
    }
    Ok(())
}

fn format(sh: &Shell) -> Result<()> {
    cmd!(sh, "cargo fmt --all --check")
        .run()
        .context("type `cargo fmt --all`")?;
    words::check(sh)
}

fn lint(sh: &Shell) -> Result<()> {
    let others = [BARE_CRATES.as_slice(), &["loader"]].concat();
    clippy_boards(sh, &others, |chip| chip == NRF52840)
}

/// The libraries of the other chips are for the night.
fn other_boards(sh: &Shell) -> Result<()> {
    clippy_boards(sh, &[], |chip| chip != NRF52840)?;
    firmware::others(sh)?;
    chip::plug(sh)
}

/// Checks the boards with some chips, and other packages with the first of them. Boards of several chips do not compile
/// together: each chip has features of its own.
fn clippy_boards(sh: &Shell, others: &[&str], is_chosen: fn(Chip) -> bool) -> Result<()> {
    let mut boards: Vec<_> = BOARDS
        .into_iter()
        .filter(|board| is_chosen(*board.chip))
        .collect();
    let mut packages = others.to_vec();
    while let Some(first) = boards.first().copied() {
        let together = boards.extract_if(.., |board| board.chip == first.chip);
        packages.extend(together.map(|board| board.name));
        let packages = packages.drain(..).flat_map(|name| ["--package", name]);
        cmd!(
            sh,
            "cargo clippy --locked {packages...} --bins --target thumbv7em-none-eabihf -- --deny warnings"
        )
        .run()?;
    }
    Ok(())
}

/// Nothing is linked here, so that checking is enough.
fn bare(sh: &Shell) -> Result<()> {
    for target in setup::TARGETS {
        for package in FIRMWARE_CRATES {
            for features in ["--no-default-features", "--all-features"] {
                cmd!(
                    sh,
                    "cargo clippy --locked --package {package} --target {target} {features} -- --deny warnings"
                )
                .run()?;
            }
        }
        cmd!(
            sh,
            "cargo clippy --locked --package bench-cortex-m --package bench-size --target {target} -- --deny warnings"
        )
        .run()?;
    }
    Ok(())
}

/// Runs that take minutes and find what short ones cannot.
fn soak(sh: &Shell) -> Result<()> {
    cmd!(
        sh,
        "cargo run --locked --release --package cmucam2-driver --example soak"
    )
    .run()?;
    cmd!(
        sh,
        "cargo run --locked --release --package campaign -- --runs 1000 --minimise 0 --deceiving 0.02 --late 0.15"
    )
    .run()?;
    chip::bench(sh)
}

fn document(sh: &Shell) -> Result<()> {
    let libraries = FIRMWARE_CRATES.map(|name| ["--package", name]).concat();
    rustdoc(sh, &libraries)
}

fn document_all(sh: &Shell) -> Result<()> {
    rustdoc(sh, &["--workspace"])
}

fn rustdoc(sh: &Shell, packages: &[&str]) -> Result<()> {
    let _strict = sh.push_env("RUSTDOCFLAGS", "--deny warnings");
    cmd!(
        sh,
        "cargo doc --locked {packages...} --no-deps --all-features"
    )
    .run()?;
    Ok(())
}

fn count(sh: &Shell) -> Result<()> {
    count_on(sh, &cortex_m::PROCESSORS[..1])
}

/// The Cortex-M0, for which all is built once more, is for the night.
fn count_all(sh: &Shell) -> Result<()> {
    count_on(sh, &cortex_m::PROCESSORS)
}

fn count_on(sh: &Shell, processors: &[cortex_m::Processor]) -> Result<()> {
    let measurements = cortex_m::run(sh, processors)?;
    println!("{}", cortex_m::table(&measurements));
    cortex_m::within_budget(&measurements)
}

fn measure(sh: &Shell) -> Result<()> {
    let measurements = size::run(sh)?;
    println!("{}", size::table(&measurements));
    size::within_budget(&measurements)
}

/// Built as tests are, from parts that are built by then: to build all again for a release takes far longer than
/// the time that it saves.
fn bench(sh: &Shell) -> Result<()> {
    let program = harness::program(sh, "bench")?;
    cmd!(sh, "{program} brief").run()?;
    Ok(())
}

/// About a minute. The goal is none of both shares; these are the values reached, so that no change makes it worse
/// unseen.
fn campaign(sh: &Shell) -> Result<()> {
    let program = harness::program(sh, "campaign")?;
    let reached = ["--deceiving", "0.005", "--late", "0.12"];
    cmd!(sh, "{program} --runs 100 --minimise 0 {reached...}").run()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use anyhow::bail;

    use super::*;

    fn one(needs: fn(&Shell) -> Result<()>, run: fn(&Shell) -> Result<()>) -> Stage {
        stage("one", "for a test", run).needs(needs)
    }

    fn fails(_: &Shell) -> Result<()> {
        bail!("no")
    }

    fn never(_: &Shell) -> Result<()> {
        panic!("this is not to run");
    }

    #[test]
    fn stages_are_counted() {
        let sh = Shell::new().unwrap();
        let good = one(nothing, nothing);
        for (stages, is_ci, line) in [
            (vec![good, good], true, "2 passed, 0 failed"),
            (
                vec![good, one(nothing, fails), one(never, never)],
                false,
                "1 passed, 1 failed, 1 not run",
            ),
            (
                vec![one(fails, never), good],
                false,
                "1 passed, 0 failed, 1 left out",
            ),
            // In CI nothing is left out.
            (
                vec![one(fails, never), good],
                true,
                "0 passed, 1 failed, 1 not run",
            ),
        ] {
            assert_eq!(run(&sh, &stages, is_ci).0.line(), line);
        }
    }

    #[test]
    fn the_rows_of_a_lane_are_found() {
        let said = "==> one: for a test\n==>   12 s       3 s      0  one\n\
                    ==>    1 s       0 s     17  two: FAILED\n==>    1 s       0 s      0  three: LEFT OUT: why";
        let ends = ["one", "two", "three", "four"].map(|stage| ended(said, stage));
        assert_eq!(
            ends.map(|found| found.map(|(_, end)| end)),
            [Some(""), Some("FAILED"), Some(LEFT_OUT), None]
        );
        assert_eq!(ends[0].unwrap().0, "   12 s       3 s      0  one");
    }

    #[test]
    fn every_stage_has_a_name_of_its_own() {
        for stage in &STAGES {
            let same = STAGES.iter().filter(|other| other.name == stage.name);
            assert_eq!(same.count(), 1, "{}", stage.name);
        }
    }
}
