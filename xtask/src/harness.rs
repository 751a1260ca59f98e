//! Tests as cargo runs them, and how many ran: where none did, nothing has passed.

use std::{
    io::{BufRead, BufReader, Write},
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;
use xshell::{Cmd, Shell, cmd};

use crate::{emulate, peers};

/// Members of the workspace that have no test of their own.
const WITHOUT_TESTS: [&str; 3] = ["bench-size", "nrf52840", "nucleo-l476rg"];

/// Tests that need what the stages of their own build first, and that are left out elsewhere.
fn ignored_suites() -> impl Iterator<Item = &'static str> {
    peers::SUITES.into_iter().chain(emulate::SUITES)
}

/// What test programs said of themselves, all together.
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
    /// The folder of its package, where cargo runs it.
    folder: PathBuf,
    tests: Tests,
}

/// What a program would run.
#[derive(Clone, Debug, PartialEq)]
struct Tests {
    package: String,
    /// The name of its target.
    suite: String,
    all: usize,
    ignored: usize,
}

/// Runs the tests of all members of the workspace.
///
/// # Errors
/// One fails, a member has none, one is ignored that no other stage runs, or fewer ran than there are.
pub(crate) fn workspace(sh: &Shell) -> Result<()> {
    let members = members(sh)?;
    let tests = programs(sh, &members)?
        .into_iter()
        .map(|program| count(sh, program))
        .collect::<Result<Vec<_>>>()?;
    let names: Vec<_> = members.iter().map(|(name, _)| name.as_str()).collect();
    complete(&names, &tests)?;
    let counts = run(cmd!(sh, "cargo test --locked --workspace --all-features"))?;
    all_ran(&tests, counts)?;
    eprintln!(
        "{} tests of {} programs passed",
        counts.passed, counts.programs
    );
    Ok(())
}

/// Runs the tests of a suite that are ignored elsewhere. They are built as those of the workspace are:
/// with other features, cargo would build everything again.
///
/// # Errors
/// One fails, or there is none.
pub(crate) fn ignored(sh: &Shell, suite: &str) -> Result<()> {
    let counts = run(cmd!(
        sh,
        "cargo test --locked --workspace --all-features --test {suite} -- --ignored --nocapture"
    ))?;
    ensure!(counts.passed > 0, "no test of `{suite}` ran");
    eprintln!("{suite}: {} tests passed", counts.passed);
    Ok(())
}

/// Runs tests, shows what they say, and counts them.
fn run(command: Cmd<'_>) -> Result<Counts> {
    let shown = command.to_string();
    eprintln!("$ {shown}");
    let mut child = Command::from(command)
        .stdout(Stdio::piped())
        .spawn()
        .with_context(|| shown.clone())?;
    let mut output = BufReader::new(child.stdout.take().context("the output is piped")?);
    let mut counts = Counts::default();
    let mut line = Vec::new();
    while output.read_until(b'\n', &mut line)? > 0 {
        std::io::stdout().write_all(&line)?;
        counts.add(&String::from_utf8_lossy(&line));
        line.clear();
    }
    let status = child.wait()?;
    ensure!(status.success(), "`{shown}`: {status}");
    ensure!(counts.failed == 0, "{} tests failed", counts.failed);
    Ok(counts)
}

impl Counts {
    /// Adds the line that a test program ends with; others say nothing.
    fn add(&mut self, line: &str) {
        let result = line.trim_end().strip_prefix("test result: ");
        let Some((_, numbers)) = result.and_then(|result| result.split_once(". ")) else {
            return;
        };
        self.programs += 1;
        for number in numbers.split("; ") {
            let counter = match number.split_once(' ') {
                Some((_, "passed")) => &mut self.passed,
                Some((_, "failed")) => &mut self.failed,
                Some((_, "ignored")) => &mut self.ignored,
                _ => continue,
            };
            let count = number.split(' ').next();
            *counter += count.and_then(|n| n.parse::<usize>().ok()).unwrap_or(0);
        }
    }
}

/// Whether each member has tests, and each test a stage that runs it.
fn complete(members: &[&str], tests: &[Tests]) -> Result<()> {
    for &member in members {
        let own = tests.iter().filter(|tests| tests.package == member);
        let count: usize = own.map(|tests| tests.all).sum();
        let without = WITHOUT_TESTS.contains(&member);
        ensure!(count > 0 || without, "`{member}` has no test");
        ensure!(
            count == 0 || !without,
            "`{member}` has tests now: take it out of WITHOUT_TESTS"
        );
    }
    for tests in tests {
        ensure!(
            tests.ignored == 0 || ignored_suites().any(|suite| suite == tests.suite),
            "`{}` of `{}` has {} ignored tests, which no stage runs",
            tests.suite,
            tests.package,
            tests.ignored
        );
    }
    Ok(())
}

/// Whether all that were there have run. Examples in the documentation come on top.
fn all_ran(tests: &[Tests], counts: Counts) -> Result<()> {
    let expected: usize = tests.iter().map(|tests| tests.all - tests.ignored).sum();
    ensure!(expected > 0, "there is no test");
    ensure!(
        counts.programs >= tests.len() && counts.passed >= expected,
        "{} tests of {} programs passed, there are {expected} of {}",
        counts.passed,
        counts.programs,
        tests.len()
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

/// Builds the test programs.
fn programs(sh: &Shell, members: &[(String, String)]) -> Result<Vec<Program>> {
    let messages = cmd!(
        sh,
        "cargo test --locked --workspace --all-features --no-run --message-format json-render-diagnostics"
    )
    .read()?;
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
        programs.push(Program {
            path: path.into(),
            folder: Path::new(manifest).with_file_name(""),
            tests: Tests {
                package: package.clone(),
                suite: message["target"]["name"]
                    .as_str()
                    .unwrap_or_default()
                    .into(),
                all: 0,
                ignored: 0,
            },
        });
    }
    Ok(programs)
}

/// Asks a program for its tests.
fn count(sh: &Shell, program: Program) -> Result<Tests> {
    let _there = sh.push_dir(&program.folder);
    let path = &program.path;
    let tests = |options: &[&str]| -> Result<usize> {
        let list = cmd!(sh, "{path} --list --format terse {options...}")
            .quiet()
            .read()?;
        Ok(list.lines().filter(|line| line.ends_with(": test")).count())
    };
    Ok(Tests {
        all: tests(&[])?,
        ignored: tests(&["--ignored"])?,
        ..program.tests
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

    fn counted(said: &str) -> Counts {
        let mut counts = Counts::default();
        for line in said.lines() {
            counts.add(line);
        }
        counts
    }

    fn tests(package: &str, suite: &str, all: usize, ignored: usize) -> Tests {
        Tests {
            package: package.into(),
            suite: suite.into(),
            all,
            ignored,
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
        assert_eq!(counted(SAID), counts);
        for nothing in ["", "running 0 tests", "test result: ok", "test result: "] {
            assert_eq!(counted(nothing), Counts::default(), "{nothing}");
        }
    }

    #[test]
    fn fewer_than_there_are_is_an_error() {
        let there = [tests("a", "a", 3, 1), tests("a", "b", 2, 0)];
        let ran = |programs, passed| Counts {
            programs,
            passed,
            ..Counts::default()
        };
        assert!(all_ran(&there, ran(2, 4)).is_ok());
        // With examples in the documentation.
        assert!(all_ran(&there, ran(3, 7)).is_ok());
        assert!(all_ran(&there, ran(2, 3)).is_err());
        assert!(all_ran(&there, ran(1, 4)).is_err());
        assert!(all_ran(&[], ran(0, 0)).is_err());
        assert!(all_ran(&[tests("a", "a", 1, 1)], ran(1, 0)).is_err());
    }

    #[test]
    fn a_member_without_tests_is_noticed() {
        let there = [tests("a", "a", 0, 0), tests("a", "b", 2, 0)];
        assert!(complete(&["a"], &there).is_ok());
        assert!(complete(&["a", WITHOUT_TESTS[0]], &there).is_ok());
        assert!(complete(&["a", "c"], &there).is_err());
        assert!(complete(&["a"], &there[..1]).is_err());
        assert!(complete(&[WITHOUT_TESTS[0]], &[tests(WITHOUT_TESTS[0], "a", 1, 0)]).is_err());
    }

    #[test]
    fn an_ignored_test_that_no_stage_runs_is_noticed() {
        for suite in ignored_suites() {
            assert!(complete(&["a"], &[tests("a", suite, 2, 2)]).is_ok());
        }
        assert!(complete(&["a"], &[tests("a", "a", 2, 1)]).is_err());
    }
}
