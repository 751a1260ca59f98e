//! Tests as cargo runs them, and their number: where none ran, nothing has passed.

use std::{
    cmp::Reverse,
    ffi::OsStr,
    fs::{self, File},
    io::{BufRead, BufReader, Write},
    iter, mem,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
};

use anyhow::{Context, Result, bail, ensure};
use board_facts::Board;
use serde_json::Value;
use xshell::{Shell, cmd};

use crate::{
    built, chip, peers,
    publish::{self, Library},
};

/// Members of the workspace that have no test of their own, besides the boards.
const WITHOUT_TESTS: [&str; 4] = ["bench-size", "loader", "memory-functions", "nrf52"];

/// Settings of every build of tests, always the same, so that nothing is built twice. Clippy compiles the workspace,
/// which saves a second pass over it, and refuses what it warns of. Data to build parts of a crate again, many
/// parts of a crate side by side, and lines for debuggers cost processor time, and here everything is built.
const BUILT_WITH: [(&str, &str); 5] = [
    ("RUSTC_WORKSPACE_WRAPPER", "clippy-driver"),
    (
        "CLIPPY_ARGS",
        "--deny__CLIPPY_HACKERY__warnings__CLIPPY_HACKERY__",
    ),
    ("CARGO_INCREMENTAL", "0"),
    ("CARGO_PROFILE_DEV_CODEGEN_UNITS", "2"),
    ("CARGO_PROFILE_DEV_DEBUG", "0"),
];

/// Example programs of libraries that are measurements: stages of their own run them.
const MEASUREMENTS: [&str; 1] = ["soak"];

/// Folder, beside what is built, of what test programs print.
const SAID_IN: &str = "said";

/// Threads of a test program for each processor: many tests wait for another process.
const THREADS: usize = 3;

/// Tests that need programs that a stage of their own builds first, and that are ignored elsewhere: those of one
/// module of a package's integration tests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Suite {
    pub(crate) package: &'static str,
    pub(crate) module: &'static str,
}

impl Suite {
    /// Returns true for a test of this suite.
    fn has(&self, package: &str, test: &str) -> bool {
        self.package == package
            && test
                .strip_prefix(self.module)
                .is_some_and(|name| name.starts_with("::"))
    }
}

/// Name of the one program of integration tests of a package.
const INTEGRATION: &str = "it";

fn ignored_suites() -> impl Iterator<Item = Suite> {
    peers::SUITES
        .into_iter()
        .chain([peers::FIREFOX])
        .chain(chip::SUITES)
        .chain([chip::PLUG, chip::WALK])
}

/// Returns true where nothing of the workspace but the chores has been built yet.
pub(crate) fn is_cold(sh: &Shell) -> bool {
    let built =
        built::folder(sh).and_then(|folder| Ok(sh.read_dir(folder.join("debug/.fingerprint"))?));
    built
        .unwrap_or_default()
        .iter()
        .filter_map(|path| path.file_name()?.to_str())
        .all(|name| !name.starts_with("host-sim-"))
}

/// Counts that test programs print, all together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Counts {
    programs: usize,
    passed: usize,
    failed: usize,
    ignored: usize,
}

/// A test program that cargo built.
struct Program {
    path: PathBuf,
    /// The folder of its package, where cargo runs it too.
    folder: PathBuf,
    tests: Tests,
}

/// Tests that a program would run.
#[derive(Clone, Debug, PartialEq)]
struct Tests {
    package: String,
    /// The name of its target.
    suite: String,
    all: usize,
    /// Names of those that are ignored.
    ignored: Vec<String>,
}

/// Runs the tests of all members of the workspace, as many programs at once as there are processors,
/// and the examples of their documentation.
///
/// # Errors
/// One fails, a member has none, one is ignored that no other stage runs, or fewer ran than there are.
pub(crate) fn workspace(sh: &Shell) -> Result<()> {
    let members = members(sh)?;
    let messages = build(sh, &[])?;
    let mut programs = programs(sh, &members, &messages)?;
    // The longest first, so that none runs alone at the end.
    programs.sort_by_key(|program| Reverse(program.tests.all));
    let threads = threads()?;
    let names: Vec<_> = members.iter().map(|(name, _)| name.as_str()).collect();
    let tests: Vec<_> = programs.iter().map(|program| &program.tests).collect();
    complete(&names, &tests)?;
    let said_in = sh.create_dir(built::folder(sh)?.join(SAID_IN))?;
    side_by_side(&programs, |program| {
        let Tests { package, suite, .. } = &program.tests;
        // Files, not pipes: a process that outlives its test holds a pipe open, and nothing would end. They can also
        // be read meanwhile.
        let [told, complained] =
            ["out", "err"].map(|what| said_in.join(format!("{package}-{suite}.{what}")));
        let status = Command::new(&program.path)
            .current_dir(&program.folder)
            .env("CARGO_MANIFEST_DIR", &program.folder)
            .env("RUST_TEST_THREADS", &threads)
            .stdin(Stdio::null())
            .stdout(File::create(&told)?)
            .stderr(File::create(&complained)?)
            .status()?;
        let said = fs::read(&told)?;
        let said = String::from_utf8_lossy(&said);
        // At once: others run beside it.
        println!("\n{package}, {suite}{said}");
        let errors = fs::read(&complained)?;
        let errors = String::from_utf8_lossy(&errors);
        ensure!(
            status.success(),
            "{errors}`{suite}` of `{package}` failed: {status}"
        );
        all_ran(&program.tests, Counts::of(&said))
    })?;
    let shown = examples(&publish::libraries(sh)?, &messages)?;
    side_by_side(&shown, |path| {
        let output = Command::new(path).output()?;
        let errors = String::from_utf8_lossy(&output.stderr);
        let name = path.display();
        ensure!(output.status.success(), "{errors}the example {name} failed");
        Ok(())
    })?;
    let examples = cmd!(sh, "cargo test --locked --workspace --all-features --doc");
    let (examples, _) = run(&mut examples.envs(BUILT_WITH).into())?;
    ensure!(examples.passed > 0, "no example of the documentation ran");
    let ran: usize = tests
        .iter()
        .map(|tests| tests.all - tests.ignored.len())
        .sum();
    eprintln!(
        "{ran} tests of {} programs, {} example programs and {} examples of the documentation passed",
        tests.len(),
        shown.len(),
        examples.passed
    );
    Ok(())
}

/// Threads of a test program, as the variable for them has it.
fn threads() -> Result<String> {
    let processors = thread::available_parallelism()?.get();
    Ok((THREADS * processors).to_string())
}

/// Order in which suites run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Pace {
    /// One suite after the other, many tests of it at once: most of them wait.
    InTurn,
    /// The suites side by side, and the tests of each one after the other: a process keeps what its tests share.
    SideBySide,
}

/// Runs tests that are ignored elsewhere, and returns their output. They are built as those of the workspace are:
/// with other features, cargo would build everything again.
///
/// # Errors
/// One fails, or a suite has none.
pub(crate) fn ignored(sh: &Shell, suites: &[Suite], pace: Pace) -> Result<String> {
    let messages = build(sh, &["--test", INTEGRATION])?;
    let programs = programs(sh, &members(sh)?, &messages)?;
    let threads = match pace {
        Pace::InTurn => threads()?,
        Pace::SideBySide => "1".to_owned(),
    };
    let ready = suites.iter().map(|suite| {
        let Suite { package, module } = suite;
        let program = programs
            .iter()
            .find(|program| program.tests.package == *package)
            .with_context(|| format!("`{package}` has no integration tests"))?;
        let Program {
            path,
            folder,
            tests,
        } = program;
        let there = tests.ignored.iter();
        let count = there.filter(|test| suite.has(package, test)).count();
        let _there = sh.push_dir(folder);
        let filter = format!("{module}::");
        let tests_run = cmd!(sh, "{path} --ignored --nocapture {filter}")
            .env("CARGO_MANIFEST_DIR", folder)
            .env("RUST_TEST_THREADS", &threads);
        Ok((suite, count, Mutex::new(Command::from(tests_run))))
    });
    let ready = ready.collect::<Result<Vec<_>>>()?;
    let all_said = Mutex::new(String::new());
    let work = |(suite, count, command): &(&Suite, usize, Mutex<Command>)| {
        let Suite { package, module } = suite;
        let (counts, said) = run(&mut locked(command))?;
        ensure!(
            counts.passed > 0 && counts.passed == *count,
            "{} tests of `{module}` in `{package}` passed, there are {count}",
            counts.passed,
        );
        eprintln!("{package}, {module}: {count} tests passed");
        locked(&all_said).push_str(&said);
        Ok(())
    };
    match pace {
        Pace::InTurn => ready.iter().try_for_each(work)?,
        Pace::SideBySide => side_by_side(&ready, work)?,
    }
    Ok(mem::take(&mut locked(&all_said)))
}

/// Returns what a lock holds, which no panic can leave half done.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Builds a program of the workspace with the features and the profile of its tests, so that little of it is built
/// for this alone, and returns its path.
///
/// # Errors
/// It does not compile, or there is none.
pub(crate) fn program(sh: &Shell, name: &str) -> Result<PathBuf> {
    // Any test: with one, cargo takes the features that only tests ask for, and so what tests have built.
    let messages = cmd!(
        sh,
        "cargo build --locked --workspace --all-features --bin {name} --test {INTEGRATION} --message-format json-render-diagnostics"
    )
    .envs(BUILT_WITH)
    .read()?;
    built::program(&messages, name)
}

/// Runs tests, shows their output while they run, and counts them.
fn run(command: &mut Command) -> Result<(Counts, String)> {
    let words = iter::once(command.get_program()).chain(command.get_args());
    let words: Vec<_> = words.map(OsStr::to_string_lossy).collect();
    let shown = words.join(" ");
    eprintln!("$ {shown}");
    let mut child = command
        .stdout(Stdio::piped())
        .spawn()
        .with_context(|| shown.clone())?;
    let mut output = BufReader::new(child.stdout.take().context("the output is piped")?);
    let mut said = Vec::new();
    let mut from = 0;
    while output.read_until(b'\n', &mut said)? > 0 {
        std::io::stdout().write_all(&said[from..])?;
        from = said.len();
    }
    let status = child.wait()?;
    ensure!(status.success(), "`{shown}`: {status}");
    let said = String::from_utf8_lossy(&said).into_owned();
    let counts = Counts::of(&said);
    ensure!(counts.failed == 0, "{} tests failed", counts.failed);
    Ok((counts, said))
}

impl Counts {
    /// Reads the output of test programs: the line that each ends with.
    fn of(said: &str) -> Self {
        let mut counts = Self::default();
        for line in said.lines() {
            let result = line.strip_prefix("test result: ");
            let Some((_, numbers)) = result.and_then(|result| result.split_once(". ")) else {
                continue;
            };
            counts.programs += 1;
            for number in numbers.split("; ") {
                let (number, what) = number.split_once(' ').unwrap_or_default();
                let counter = match what {
                    "passed" => &mut counts.passed,
                    "failed" => &mut counts.failed,
                    "ignored" => &mut counts.ignored,
                    _ => continue,
                };
                *counter += number.parse().unwrap_or(0);
            }
        }
        counts
    }
}

/// Checks that each member has tests, and that each ignored test has a stage that runs it.
fn complete(members: &[&str], tests: &[&Tests]) -> Result<()> {
    for &member in members {
        let own = tests.iter().filter(|tests| tests.package == member);
        let count: usize = own.map(|tests| tests.all).sum();
        let without = WITHOUT_TESTS.contains(&member) || Board::named(member).is_some();
        ensure!(count > 0 || without, "`{member}` has no test");
        ensure!(
            count == 0 || !without,
            "`{member}` has tests now: take it out of WITHOUT_TESTS"
        );
    }
    for tests in tests {
        let package = &tests.package;
        for test in &tests.ignored {
            ensure!(
                ignored_suites().any(|suite| suite.has(package, test)),
                "no stage runs the ignored test `{test}` of `{package}`"
            );
        }
    }
    Ok(())
}

/// Checks that all tests of a program have run.
fn all_ran(tests: &Tests, counts: Counts) -> Result<()> {
    let (all, ignored) = (tests.all, tests.ignored.len());
    let expected = Counts {
        programs: 1,
        passed: all - ignored,
        failed: 0,
        ignored,
    };
    ensure!(
        counts == expected,
        "`{}` of `{}` ended with {counts:?}, where its list tells {expected:?}",
        tests.suite,
        tests.package
    );
    Ok(())
}

/// The packages of the workspace, with their manifests.
fn members(sh: &Shell) -> Result<Vec<(String, String)>> {
    let metadata = cmd!(
        sh,
        "cargo metadata --locked --no-deps --format-version 1 --quiet"
    )
    .quiet()
    .read()?;
    let metadata: Value = serde_json::from_str(&metadata)?;
    let packages = metadata["packages"].as_array().into_iter().flatten();
    let members: Vec<_> = packages
        .filter_map(|package| {
            let text = |key: &str| Some(package[key].as_str()?.to_owned());
            Some((text("name")?, text("manifest_path")?))
        })
        .collect();
    ensure!(!members.is_empty(), "cargo names no package");
    Ok(members)
}

/// Builds test programs and examples, all or those that the options choose, and returns cargo's messages. Always with
/// the same features, so that their common parts are built once.
fn build(sh: &Shell, options: &[&str]) -> Result<String> {
    let build = cmd!(
        sh,
        "cargo test --locked --workspace --all-features --no-run --message-format json-render-diagnostics {options...}"
    );
    Ok(build.envs(BUILT_WITH).read()?)
}

/// The example programs of libraries that cargo has built, but for measurements.
///
/// # Errors
/// There is none, or a message cannot be read.
fn examples(libraries: &[Library], messages: &str) -> Result<Vec<PathBuf>> {
    let mut examples = Vec::new();
    for message in messages.lines() {
        let message: Value = serde_json::from_str(message)?;
        let (target, id) = (&message["target"], message["package_id"].as_str());
        let Some(path) = message["executable"].as_str() else {
            continue;
        };
        let is_of = |library: &Library| id.is_some_and(|id| library.has(id));
        let is_measurement = MEASUREMENTS.iter().any(|name| target["name"] == *name);
        let is_example = target["kind"][0] == "example" && !is_measurement;
        if is_example && libraries.iter().any(is_of) {
            examples.push(path.into());
        }
    }
    ensure!(!examples.is_empty(), "no library has an example program");
    Ok(examples)
}

/// Asks test programs that cargo has built for their tests.
fn programs(sh: &Shell, members: &[(String, String)], messages: &str) -> Result<Vec<Program>> {
    let mut programs = Vec::new();
    for message in messages.lines() {
        let message: Value = serde_json::from_str(message)?;
        let (Some(path), Some(true)) = (
            message["executable"].as_str(),
            message["profile"]["test"].as_bool(),
        ) else {
            continue;
        };
        let manifest = message["manifest_path"].as_str().unwrap_or_default();
        let Some((package, _)) = members.iter().find(|(_, path)| path == manifest) else {
            bail!("{path} is of no member of the workspace: {manifest}");
        };
        let folder = Path::new(manifest).with_file_name("");
        let suite = message["target"]["name"].as_str().unwrap_or_default();
        let names = |options: &[&str]| -> Result<Vec<String>> {
            let _there = sh.push_dir(&folder);
            let list = cmd!(sh, "{path} --list --format terse {options...}");
            let list = list.quiet().read()?;
            let names = list.lines().filter_map(|line| line.strip_suffix(": test"));
            Ok(names.map(str::to_owned).collect())
        };
        programs.push(Program {
            path: path.into(),
            tests: Tests {
                package: package.clone(),
                suite: suite.to_owned(),
                all: names(&[])?.len(),
                ignored: names(&["--ignored"])?,
            },
            folder,
        });
    }
    Ok(programs)
}

/// Does the same with each of them, as many at once as there are processors. After an error, none is
/// begun.
pub(crate) fn side_by_side<T: Sync>(
    items: &[T],
    work: impl Fn(&T) -> Result<()> + Sync,
) -> Result<()> {
    let next = AtomicUsize::new(0);
    let in_turn = || -> Result<()> {
        while let Some(item) = items.get(next.fetch_add(1, Ordering::Relaxed)) {
            work(item).inspect_err(|_| next.store(items.len(), Ordering::Relaxed))?;
        }
        Ok(())
    };
    let threads = thread::available_parallelism()?.get().min(items.len());
    thread::scope(|scope| {
        let threads: Vec<_> = (0..threads).map(|_| scope.spawn(in_turn)).collect();
        threads.into_iter().try_for_each(|thread| {
            thread
                .join()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAID: &str = "
running 3 tests
test a ... ok
test b ... ignored, needs an ot-rcp: cargo xtask peers
a test says: test result: ok. 9 passed

test result: ok. 2 passed; 0 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.01s

test result: ok. 0 passed; 0 failed; 0 ignored; 0 measured; 15 filtered out; finished in 0.00s
test result: FAILED. 4 passed; 1 failed; 0 ignored; 0 measured; 0 filtered out; finished in 1.00s
";

    fn tests(package: &str, suite: &str, all: usize, ignored: usize) -> Tests {
        let [first, ..] = peers::SUITES;
        let name = |number| format!("{}::test_{number}", first.module);
        Tests {
            package: package.into(),
            suite: suite.into(),
            all,
            ignored: (0..ignored).map(name).collect(),
        }
    }

    #[test]
    fn only_the_last_line_of_a_program_counts() {
        let counts = Counts {
            programs: 3,
            passed: 6,
            failed: 1,
            ignored: 1,
        };
        assert_eq!(Counts::of(SAID), counts);
        for nothing in ["", "running 0 tests", "test result: ok", "test result: "] {
            assert_eq!(Counts::of(nothing), Counts::default(), "{nothing}");
        }
    }

    #[test]
    fn other_than_there_are_is_an_error() {
        let there = tests("a", "a", 3, 1);
        let ran = |programs, passed, ignored| {
            let counts = Counts {
                programs,
                passed,
                ignored,
                ..Counts::default()
            };
            all_ran(&there, counts).is_ok()
        };
        assert!(ran(1, 2, 1));
        assert!(!ran(0, 0, 0));
        assert!(!ran(1, 1, 1));
        assert!(!ran(1, 3, 0));
        assert!(!ran(2, 2, 1));
    }

    #[test]
    fn a_member_without_tests_is_noticed() {
        let (none, two) = (&tests("a", "a", 0, 0), &tests("a", "b", 2, 0));
        let without = WITHOUT_TESTS[0];
        assert!(complete(&["a"], &[none, two]).is_ok());
        assert!(complete(&["a", without], &[none, two]).is_ok());
        assert!(complete(&["a", "c"], &[none, two]).is_err());
        assert!(complete(&["a"], &[none]).is_err());
        assert!(complete(&[without], &[&tests(without, "a", 1, 0)]).is_err());
    }

    #[test]
    fn an_ignored_test_that_no_stage_runs_is_noticed() {
        for Suite { package, module } in ignored_suites() {
            let mut ignored = tests(package, INTEGRATION, 2, 0);
            ignored.ignored = vec![format!("{module}::one")];
            assert!(complete(&[package], &[&ignored]).is_ok());
            ignored.ignored = vec![format!("{module}_more::one")];
            assert!(complete(&[package], &[&ignored]).is_err());
        }
        assert!(complete(&["a"], &[&tests("a", INTEGRATION, 2, 1)]).is_err());
    }

    #[test]
    fn one_that_fails_is_noticed() {
        let numbers: Vec<_> = (0..20).collect();
        let done = AtomicUsize::new(0);
        side_by_side(&numbers, |_| {
            done.fetch_add(1, Ordering::Relaxed);
            Ok(())
        })
        .unwrap();
        assert_eq!(done.into_inner(), numbers.len());
        let failed = side_by_side(&numbers, |&number| {
            ensure!(number != 7, "seven");
            Ok(())
        });
        assert_eq!(failed.unwrap_err().to_string(), "seven");
        assert!(side_by_side::<u8>(&[], |_| Ok(())).is_ok());
    }
}
