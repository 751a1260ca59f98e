//! Runs a campaign of random scenarios on which everything goes wrong: `cargo xtask campaign --help`.

use std::{
    collections::{BTreeMap, BTreeSet},
    num::NonZeroUsize,
    panic,
    path::{Path, PathBuf},
    process::ExitCode,
    thread,
};

use anyhow::Context;
use campaign::{
    journal::{self, Judged},
    judgement::{Kind, judge},
    minimal::minimal,
    runs::{self, Outcome},
    scenario::{self, Draw},
    tally::Tally,
};
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};

/// Files of more minimal scenarios than this are not shown.
const MANY: usize = 11;

/// Random scenarios on which everything goes wrong, and what must hold all the same
///
/// Ends with an error if a node panics, hangs or gives up; if a pose that is told as checked errs by more
/// than its protection level; if more of the poses that are told as good than `--deceiving` allows err by
/// more than 5 sigma and 0.5 units, or 2 degrees; or if more cameras than `--late` allows saw enough after the last
/// fault and are not calibrated. Neither allows any by default.
#[derive(Parser)]
#[command(bin_name = "cargo xtask campaign")]
struct Arguments {
    /// Number of runs
    #[arg(long, default_value_t = 10_000)]
    runs: u64,
    /// The number of the first one
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// The seed of them all
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Runs at a time; as many as there are processors by default
    #[arg(long)]
    jobs: Option<NonZeroUsize>,
    /// Runs this one alone, and writes its scenario: `host-sim run` repeats it from the file
    #[arg(long, value_name = "K", conflicts_with_all = ["runs", "first"])]
    only: Option<u64>,
    /// Number of failing runs of each kind that are made as small as they can be; the files of more than ten are
    /// not shown
    #[arg(long, default_value_t = 1)]
    minimise: usize,
    /// Share of the poses told as good that may err by more than 5 sigma, and 0.5 units or 2 degrees
    #[arg(long, default_value_t = 0.0)]
    deceiving: f64,
    /// Share of the cameras that saw enough which need not be calibrated
    #[arg(long, default_value_t = 0.0)]
    late: f64,
    /// Only runs with one of these, rows of the second table, such as `unknown baseline`
    #[arg(long, value_name = "WHAT")]
    having: Vec<String>,
    /// Faults that are drawn
    #[arg(long, value_enum, default_value_t)]
    draw: Draw,
    /// Writes the record of each run to this folder: `host-sim solve-network` reads it
    #[arg(long, value_name = "FOLDER")]
    records: Option<PathBuf>,
    /// Writes the judgement of each run to this file, a line each; runs that it has already are not run again
    #[arg(long, value_name = "FILE")]
    journal: Option<PathBuf>,
    /// Counts the runs of this file of another part too; may be given several times, with `--runs 0` to do nothing else
    #[arg(long, value_name = "FILE")]
    add: Vec<PathBuf>,
    /// Where scenarios are written
    #[arg(long, default_value = "target/campaign")]
    folder: PathBuf,
}

impl Arguments {
    fn scenario(&self, number: u64) -> site::Scenario {
        scenario::draw(self.seed, number, self.draw)
    }

    /// Returns true if a run is asked for.
    fn takes(&self, number: u64) -> bool {
        let of = || scenario::ingredients(&self.scenario(number));
        self.having.is_empty()
            || of()
                .iter()
                .any(|own| self.having.iter().any(|name| name == own))
    }
}

fn main() -> anyhow::Result<ExitCode> {
    let arguments = Arguments::parse();
    // Panics are told with the run that they are of.
    panic::set_hook(Box::new(|_| ()));
    match arguments.only {
        Some(number) => only(&arguments, number),
        None => all(&arguments),
    }
}

/// The judgement of a run.
fn judged(arguments: &Arguments, number: u64) -> anyhow::Result<Judged> {
    let drawn = arguments.scenario(number);
    let outcome = runs::run(&drawn).with_context(|| format!("run {number} is not possible"))?;
    if let (Some(folder), Outcome::Ended { record, .. }) = (&arguments.records, &outcome) {
        std::fs::create_dir_all(folder).with_context(|| format!("{}", folder.display()))?;
        let path = folder.join(format!("{number}.json"));
        std::fs::write(&path, record.to_json(false)?)
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    let ingredients = scenario::ingredients(&drawn).into_iter();
    Ok(Judged {
        seed: arguments.seed,
        draw: arguments.draw,
        number,
        judgement: judge(&drawn, &outcome),
        ingredients: ingredients.map(str::to_owned).collect(),
    })
}

fn write(folder: &Path, name: &str, scenario: &site::Scenario) -> anyhow::Result<PathBuf> {
    std::fs::create_dir_all(folder).with_context(|| format!("{}", folder.display()))?;
    let path = folder.join(name);
    std::fs::write(&path, scenario::text(scenario))
        .with_context(|| format!("cannot write {}", path.display()))?;
    Ok(path)
}

fn only(arguments: &Arguments, number: u64) -> anyhow::Result<ExitCode> {
    let drawn = arguments.scenario(number);
    let path = write(&arguments.folder, &format!("{number}.toml"), &drawn)?;
    println!("host-sim run {} --seed {}", path.display(), drawn.seed);
    let judgement = judged(arguments, number)?.judgement;
    for failure in &judgement.failures {
        println!("{failure}");
    }
    for kind in Kind::ALL.into_iter().filter(|kind| judgement.has(*kind)) {
        minimise(arguments, number, kind)?;
    }
    Ok(ExitCode::from(u8::from(!judgement.failures.is_empty())))
}

/// With what it still fails.
fn minimise(
    arguments: &Arguments,
    number: u64,
    kind: Kind,
) -> anyhow::Result<BTreeSet<&'static str>> {
    let (least, judgement) = minimal(&arguments.scenario(number), kind);
    let name = format!("{number}-{kind:?}.toml").to_lowercase();
    let path = write(&arguments.folder, &name, &least)?;
    println!(
        "\nrun {number} as small as it fails so, {}:",
        path.display()
    );
    for failure in &judgement.failures {
        println!("# {failure}");
    }
    if arguments.minimise < MANY {
        println!("{}", scenario::text(&least));
    }
    Ok(scenario::ingredients(&least))
}

/// Counts the runs of all files, and tells the numbers that are still to be run.
fn begun(
    arguments: &Arguments,
    tally: &mut Tally,
    numbers: impl Iterator<Item = u64>,
) -> anyhow::Result<Vec<u64>> {
    let mut counted = BTreeSet::new();
    // A campaign begins without a journal; a part that is to be counted is there.
    let own = arguments.journal.iter().filter(|path| path.exists());
    for path in own.chain(&arguments.add) {
        for run in journal::read(path, arguments.seed, arguments.draw)? {
            if counted.insert(run.number) {
                tally.add(&run);
            }
        }
    }
    Ok(numbers.filter(|number| !counted.contains(number)).collect())
}

fn all(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let jobs = arguments
        .jobs
        .or_else(|| thread::available_parallelism().ok());
    let numbers = arguments.first..arguments.first + arguments.runs;
    // Only on a terminal: `indicatif` hides it otherwise.
    let style = ProgressStyle::with_template("{bar:30} {pos} of {len} runs, {eta} left, {msg}")?;
    let numbers: Vec<_> = numbers.filter(|number| arguments.takes(*number)).collect();
    anyhow::ensure!(
        arguments.having.is_empty() || !numbers.is_empty(),
        "none of these runs has {}: the second table of a whole campaign names what runs have",
        arguments.having.join(" or ")
    );
    let (mut tally, mut failed) = (Tally::default(), None);
    let numbers = begun(arguments, &mut tally, numbers.into_iter())?;
    let mut file = arguments
        .journal
        .as_deref()
        .map(journal::append)
        .transpose()?;
    let bar = ProgressBar::new(numbers.len() as u64).with_style(style);
    runs::side_by_side(
        numbers,
        jobs.unwrap_or(NonZeroUsize::MIN),
        |number| judged(arguments, number),
        |run| {
            let counted = run.and_then(|run| {
                if let Some(file) = &mut file {
                    journal::write(file, &run)?;
                }
                tally.add(&run);
                Ok(())
            });
            if let Err(error) = counted {
                failed = Some(error);
            }
            let deceived = tally.failing(Kind::Deceives).len();
            bar.set_message(format!("{deceived} deceive"));
            bar.inc(1);
        },
    );
    bar.finish_and_clear();
    if let Some(error) = failed {
        return Err(error);
    }
    println!("seed {}, {tally}", arguments.seed);
    let mut fails = false;
    for kind in Kind::ALL {
        let failing = tally.failing(kind);
        fails |= match kind {
            Kind::Deceives | Kind::Turned => tally.deceiving() > arguments.deceiving,
            Kind::Late => tally.late() > arguments.late,
            _ => !failing.is_empty(),
        };
        let mut classes = BTreeMap::<_, Vec<_>>::new();
        for number in failing.into_iter().take(arguments.minimise) {
            let left = minimise(arguments, number, kind)?;
            classes.entry(left).or_default().push(number);
        }
        for (class, numbers) in classes {
            let class = class.into_iter().collect::<Vec<_>>().join(" + ");
            println!("{}, with {class}: {numbers:?}", kind.name());
        }
    }
    Ok(ExitCode::from(u8::from(fails)))
}
