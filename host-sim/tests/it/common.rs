//! Runs the command and keeps its files.

use std::{
    io::Write,
    process::{Command, Stdio},
};

/// What a run left.
pub(crate) struct Done {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

pub(crate) fn run(arguments: &[&str]) -> Done {
    run_with_input(arguments, "")
}

pub(crate) fn run_with_input(arguments: &[&str], input: &str) -> Done {
    let mut child = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // A run that ends before it reads its input is none of our business here.
    let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
    let output = child.wait_with_output().unwrap();
    Done {
        code: output.status.code().unwrap(),
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: without_progress(&String::from_utf8(output.stderr).unwrap()),
    }
}

/// What was said besides how far cameras are, `12.3 s  camera 4: calibrated, 3 sightings`.
fn without_progress(stderr: &str) -> String {
    let is_progress = |line: &&str| {
        let parts = line.trim_start().split_once(" s  camera ");
        parts.is_some_and(|(seconds, _)| seconds.parse::<f64>().is_ok())
    };
    let said = stderr.split_inclusive('\n');
    said.filter(|line| !is_progress(line)).collect()
}

/// A folder that goes away with the test.
pub(crate) struct Files(tempfile::TempDir);

impl Files {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    pub(crate) fn write(&self, name: &str, content: &str) -> String {
        let path = self.path(name);
        std::fs::write(&path, content).unwrap();
        path
    }
}

/// A file of the repository's recorded data.
pub(crate) fn data(name: &str) -> String {
    format!("{}/../tests/data/{name}", env!("CARGO_MANIFEST_DIR"))
}
