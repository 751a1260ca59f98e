//! Processor time and compilation units of the programs that a chore starts.

use std::{
    env, fs,
    io::Write,
    path::{Path, PathBuf},
    process::{Command, ExitCode},
    time::{Duration, Instant},
};

use anyhow::{Context, Result};
use nix::sys::{
    resource::{UsageWho, getrusage},
    time::TimeVal,
};
use xshell::{PushEnv, Shell};

/// Variable that names the file in which compilation units are counted.
pub(crate) const COUNT_IN: &str = "XTASK_COUNT_IN";

/// File in which the units of this run are counted: a byte each.
const COUNTER: &str = "target/tools/units";
/// Name under which this program wraps the compiler: a copy, so that a build can replace the original.
pub(crate) const WRAPPER: &str = "count-units";

/// Consumption of a stage, or of a whole run.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Usage {
    /// Time that passed.
    pub(crate) wall: Duration,
    /// Time of the processors, of all programs that have ended.
    pub(crate) processor: Duration,
    /// Calls of the compiler that compiled something.
    pub(crate) units: usize,
}

/// A point from which consumption is measured.
pub(crate) struct Meter {
    begin: Instant,
    before: Usage,
    counter: PathBuf,
}

impl Meter {
    /// Begins to measure.
    ///
    /// # Errors
    /// The operating system does not tell times of programs.
    pub(crate) fn start(sh: &Shell) -> Result<Self> {
        let counter = counter(sh);
        Ok(Self {
            begin: Instant::now(),
            before: used(&counter)?,
            counter,
        })
    }

    /// Consumption since the start.
    ///
    /// # Errors
    /// As of [`start`](Self::start).
    pub(crate) fn read(&self) -> Result<Usage> {
        let now = used(&self.counter)?;
        Ok(Usage {
            wall: self.begin.elapsed(),
            processor: now.processor.saturating_sub(self.before.processor),
            units: now.units.saturating_sub(self.before.units),
        })
    }
}

/// File in which the units of this process are counted.
fn counter(sh: &Shell) -> PathBuf {
    match sh.var_os(COUNT_IN) {
        Some(path) => path.into(),
        None => sh.current_dir().join(COUNTER),
    }
}

/// Adds the units that another process counted in a file.
pub(crate) fn add(sh: &Shell, counted: &Path) {
    let Ok(units) = fs::read(counted) else { return };
    // A count that fails is no reason to fail.
    let file = fs::File::options().append(true).open(counter(sh));
    let _ = file.and_then(|mut file| file.write_all(&units));
}

fn used(counter: &Path) -> Result<Usage> {
    let usage = getrusage(UsageWho::RUSAGE_CHILDREN).context("times of programs")?;
    let time = |value: TimeVal| {
        let seconds = u64::try_from(value.tv_sec()).unwrap_or(0);
        let micros = u64::try_from(value.tv_usec()).unwrap_or(0);
        Duration::from_secs(seconds) + Duration::from_micros(micros)
    };
    Ok(Usage {
        wall: Duration::ZERO,
        processor: time(usage.user_time()) + time(usage.system_time()),
        // None yet if there is no file.
        units: fs::metadata(counter).map_or(0, |file| file.len() as usize),
    })
}

/// Counts compilation units until it is dropped.
pub(crate) struct Counting<'s> {
    _count_in: PushEnv<'s>,
    _wrapper: PushEnv<'s>,
}

/// Makes every cargo that is started from now on count its units. A compiler that is wrapped already keeps its
/// wrapper, and nothing is counted.
///
/// # Errors
/// A file under `target` cannot be written.
pub(crate) fn count_units(sh: &Shell) -> Result<Option<Counting<'_>>> {
    let is_wrapped = ["RUSTC_WRAPPER", "CARGO_BUILD_RUSTC_WRAPPER"]
        .iter()
        .any(|name| env::var_os(name).is_some_and(|value| !value.is_empty()));
    if is_wrapped {
        return Ok(None);
    }
    let counter = sh.current_dir().join(COUNTER);
    let wrapper = crate::tool(sh, WRAPPER);
    crate::copy_of_this(&wrapper)?;
    fs::write(&counter, []).with_context(|| counter.display().to_string())?;
    Ok(Some(Counting {
        _count_in: sh.push_env(COUNT_IN, counter),
        _wrapper: sh.push_env("RUSTC_WRAPPER", wrapper),
    }))
}

/// Calls the compiler in the place of cargo, and counts that if it compiles something.
///
/// # Errors
/// The compiler cannot be started.
pub(crate) fn compile(counter: &Path) -> Result<ExitCode> {
    let mut words = env::args_os().skip(1);
    let compiler = words.next().context("cargo names the compiler")?;
    let words: Vec<_> = words.collect();
    let names_crate = words
        .windows(2)
        .any(|pair| pair[0] == "--crate-name" && pair[1] != "___");
    if names_crate {
        // A count that fails is no reason not to compile.
        let file = fs::File::options().append(true).create(true).open(counter);
        let _ = file.and_then(|mut file| file.write_all(b"."));
    }
    let status = Command::new(&compiler)
        .args(words)
        .status()
        .with_context(|| compiler.display().to_string())?;
    Ok(status
        .code()
        .and_then(|code| u8::try_from(code).ok())
        .map_or(ExitCode::FAILURE, ExitCode::from))
}
