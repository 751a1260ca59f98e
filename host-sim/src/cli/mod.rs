//! Command line: what people type, and what they are told.

use std::{
    env,
    ffi::OsString,
    fmt,
    io::{self, Write},
    path::Path,
    process::ExitCode,
};

use anyhow::Context;
use clap::{
    CommandFactory, FromArgMatches, Parser, Subcommand,
    error::{ContextKind, ContextValue},
};
use radio_update::package::{Key, public_key};
use site::{key_file, nearest};

use errors::{OfFile, complain, of_file, of_site, with_causes};

mod camera;
mod camera_options;
mod console;
mod edit;
mod end;
mod errors;
mod files;
mod flash;
mod happenings;
mod interrupt;
mod keygen;
mod late;
mod lines;
mod live;
mod log_options;
mod messages;
mod probe;
mod provision;
mod pseudo_terminal;
mod publish;
mod report;
mod run;
mod run_outputs;
mod scenario_options;
mod solve;
mod solve_network;
mod solve_reference;
mod solve_space;
mod sweep;
mod sweep_outputs;
mod update;
mod values;
mod whole_file;

/// Networks of cameras that calibrate themselves: rehearsed, deployed, and poses from recorded
/// sightings.
#[derive(Parser)]
#[command(version, propagate_version = true, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Camera(camera::Arguments),
    Console(console::Arguments),
    Edit(edit::Arguments),
    Flash(flash::Arguments),
    Keygen(keygen::Arguments),
    Live(live::Arguments),
    Probe(probe::Arguments),
    Provision(Box<provision::Arguments>),
    Publish(publish::Arguments),
    Report(report::Arguments),
    Run(Box<run::Arguments>),
    Solve(solve::Arguments),
    SolveNetwork(Box<solve_network::Arguments>),
    SolveReference(solve_reference::Arguments),
    Sweep(sweep::Arguments),
    Update(update::Arguments),
}

/// The command line. A number below zero is a value everywhere, so that its option tells what it may be.
fn command() -> clap::Command {
    fn with_numbers(command: clap::Command) -> clap::Command {
        command
            .allow_negative_numbers(true)
            .mut_subcommands(with_numbers)
    }
    with_numbers(Cli::command())
}

/// Takes the words of the command line, or ends the program with what is wrong with them.
fn parse() -> Cli {
    let parsed = command().try_get_matches();
    let parsed = parsed.and_then(|matches| Cli::from_arg_matches(&matches));
    parsed.unwrap_or_else(|error| suggest(error, env::args_os()).exit())
}

/// Adds the command that was probably meant: the parser knows fewer slips.
fn suggest(mut error: clap::Error, words: impl Iterator<Item = OsString>) -> clap::Error {
    if let Some(ContextValue::String(wrong)) = error.get(ContextKind::InvalidSubcommand) {
        let mut here = command();
        for word in words.skip(1).take_while(|word| *word != **wrong) {
            here = here.find_subcommand(word).cloned().unwrap_or(here);
        }
        let known = here.get_subcommands().map(clap::Command::get_name);
        if let Some(near) = nearest(wrong, known) {
            let near = ContextValue::Strings(vec![near.to_owned()]);
            error.insert(ContextKind::SuggestedSubcommand, near);
        }
    }
    error
}

/// Runs the command line; errors are printed, and become the exit code 2.
pub(crate) fn main() -> ExitCode {
    let done = match parse().command {
        Command::Camera(arguments) => camera::run(&arguments),
        Command::Console(arguments) => console::run(&arguments),
        Command::Edit(arguments) => edit::run(&arguments),
        Command::Flash(arguments) => flash::run(&arguments),
        Command::Keygen(arguments) => keygen::run(&arguments),
        Command::Live(arguments) => live::run(&arguments),
        Command::Probe(arguments) => probe::run(&arguments),
        Command::Provision(arguments) => provision::run(&arguments),
        Command::Publish(arguments) => publish::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Run(arguments) => run::run(&arguments),
        Command::Solve(arguments) => solve::run(&arguments),
        Command::SolveNetwork(arguments) => solve_network::run(&arguments),
        Command::SolveReference(arguments) => solve_reference::run(&arguments),
        Command::Sweep(arguments) => sweep::run(&arguments),
        Command::Update(arguments) => update::run(&arguments),
    };
    match done {
        Ok(code) => code,
        // The reader of our output has seen enough.
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            complain(&error);
            ExitCode::from(2)
        }
    }
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error
        .downcast_ref::<io::Error>()
        .is_some_and(|e| e.kind() == io::ErrorKind::BrokenPipe)
}

/// Prints a result. A reader that has seen enough and has gone changes nothing about the result, nor
/// the exit code. Names in it come from files; no terminal is to obey them.
fn print(text: &str) -> io::Result<()> {
    let plain = |c: char| if c.is_control() && c != '\n' { ' ' } else { c };
    let text: String = text.chars().map(plain).collect();
    let mut out = io::stdout().lock();
    unless_gone(out.write_all(text.as_bytes()).and_then(|()| out.flush()))
}

/// Result of writing; it is not an error if the reader has gone.
fn unless_gone(written: io::Result<()>) -> io::Result<()> {
    written.or_else(|error| match error.kind() {
        io::ErrorKind::BrokenPipe => Ok(()),
        _ => Err(error),
    })
}

/// The last error of two; the one before it is printed.
fn and<T>(before: anyhow::Result<T>, next: anyhow::Result<()>) -> anyhow::Result<T> {
    if let (Err(error), Err(_)) = (&before, &next)
        && !is_broken_pipe(error)
    {
        complain(error);
    }
    next.and(before)
}

/// Prints a line for people on the standard error output.
fn tell(line: impl fmt::Display) {
    // A failure here cannot be told anywhere.
    let _ = writeln!(io::stderr(), "{line}");
}

/// Name of a file in messages.
fn file_name(path: &Path) -> String {
    if path == Path::new("-") {
        "standard input".to_owned()
    } else {
        path.display().to_string()
    }
}

/// The public key of a file of `host-sim keygen --updates`.
fn public_update_key(path: &Path) -> anyhow::Result<Key> {
    let secret = key_file::read_update_key(path).with_context(|| OfFile::named(path))?;
    Ok(public_key(&secret))
}

#[cfg(test)]
mod tests {
    use std::{fs, path::Path};

    use super::*;

    /// Lines of code blocks; a line that ends with a backslash is joined with the next one.
    fn code(text: &str) -> Vec<String> {
        let mut lines = Vec::new();
        let (mut is_fenced, mut begun) = (false, String::new());
        for line in text.lines() {
            if line.trim_start().starts_with("```") {
                is_fenced = !is_fenced;
            } else if is_fenced || line.starts_with("    ") {
                begun += line.trim();
                match begun.strip_suffix('\\') {
                    Some(start) => begun = start.to_owned(),
                    None => lines.push(std::mem::take(&mut begun)),
                }
            }
        }
        lines
    }

    /// The words of a command of this program, as a shell takes them.
    fn words(line: &str) -> Option<Vec<String>> {
        let line = line.strip_prefix("$ ").unwrap_or(line);
        let of_cargo = "cargo run --release -p host-sim -- ";
        let line = line.replacen(of_cargo, "host-sim ", 1);
        line.starts_with("host-sim ").then(|| {
            let mut words = Vec::new();
            for word in line.split_whitespace() {
                match word {
                    word if word.starts_with('#') => break,
                    "|" | ">" | "&&" | "&" | ";" => break,
                    word => words.push(word.trim_matches(['\'', '"']).to_owned()),
                }
            }
            words
        })
    }

    #[test]
    fn every_command_in_the_documentation_can_be_typed() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let pages = fs::read_dir(root.join("docs")).unwrap();
        let pages = pages.map(|page| page.unwrap().path());
        let pages = pages.filter(|page| page.extension().is_some_and(|end| end == "md"));
        let mut count = 0;
        for page in pages.chain([root.join("README.md")]) {
            let text = fs::read_to_string(&page).unwrap();
            for words in code(&text).iter().filter_map(|line| words(line)) {
                let parsed = command().try_get_matches_from(&words);
                let is_help = |error: &clap::Error| !error.use_stderr();
                if let Err(error) = parsed.map(drop)
                    && !is_help(&error)
                {
                    panic!("{}: {}\n{error}", page.display(), words.join(" "));
                }
                count += 1;
            }
        }
        assert!(count > 20, "{count} commands");
    }

    /// A value's parser and its field have one type: otherwise the program panics.
    #[test]
    fn every_default_has_the_type_of_its_field() {
        for words in [
            &["probe", "--port", "x", "--first-column", "0"][..],
            &["probe", "--port", "x", "--tag", "3", "--count", "2"],
            &["camera", "--pty", "x", "--baud", "19200"],
            &[
                "console",
                "--port",
                "x",
                "--join-window",
                "3",
                "--remove",
                "4",
            ],
            &["keygen"],
            &["live", "lab", "--http-port", "8080", "--listen", "::1"],
            &[
                "provision",
                "--id=3",
                "--channels=11,12",
                "--tx-power=-4",
                "--columns=88",
                "--motion=9",
            ],
            &[
                "update", "--port", "x", "--image", "y", "--key", "z", "--node", "3",
            ],
            &["solve", "x.csv", "--fov-deg", "60", "--columns", "88"],
        ] {
            let matches = command().try_get_matches_from([&["host-sim"], words].concat());
            assert!(
                Cli::from_arg_matches(&matches.unwrap()).is_ok(),
                "{words:?}"
            );
        }
    }

    #[test]
    fn commands_are_found_in_code() {
        let text =
            "host-sim run\n\n    host-sim a \\\n      b   # c\n```sh\n$ host-sim d | less\n```\n";
        let found: Vec<_> = code(text).iter().filter_map(|line| words(line)).collect();
        assert_eq!(found, [vec!["host-sim", "a", "b"], vec!["host-sim", "d"]]);
    }
}
