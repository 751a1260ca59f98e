//! A folder in which commands are run.

use std::{
    fs,
    os::unix::fs::PermissionsExt,
    path::PathBuf,
    process::{Command, Stdio},
};

use node_firmware::config::SiteKey;
use tempfile::TempDir;

/// Options for the errors of a target's step sensor: they have to be given.
pub(crate) const CARRIER: [&str; 2] = ["--systematic-heading=3", "--systematic-scale=0.08"];

/// A folder of its own, in which programs are found only in `bin`.
pub(crate) struct Place(TempDir);

/// Output of a command.
pub(crate) struct Run {
    status: Option<i32>,
    stdout: String,
    /// Its messages.
    pub(crate) stderr: String,
}

impl Place {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// A folder with a key in `site.sitekey`.
    pub(crate) fn with_key() -> Self {
        let place = Self::new();
        place.run(&["keygen"]).ok();
        place
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    /// Installs a shell script as a program that commands find.
    pub(crate) fn install(&self, program: &str, script: &str) {
        fs::create_dir_all(self.path("bin")).unwrap();
        let path = self.path("bin").join(program);
        fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    }

    /// The key, as its documented file format has it.
    pub(crate) fn key(&self) -> SiteKey {
        let text = fs::read_to_string(self.path("site.sitekey")).unwrap();
        let fields: Vec<_> = text.split(' ').collect();
        let bytes = u128::from_str_radix(fields[3], 16).unwrap().to_be_bytes();
        SiteKey::new(fields[2].parse().unwrap(), bytes)
    }

    pub(crate) fn run(&self, words: &[&str]) -> Run {
        self.run_with(words, &[])
    }

    /// Runs a command. No command shows the key.
    pub(crate) fn run_with(&self, words: &[&str], environment: &[(&str, &str)]) -> Run {
        let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .args(words)
            .current_dir(self.0.path())
            .env("PATH", self.path("bin"))
            .env("RUST_BACKTRACE", "1")
            .envs(environment.iter().copied())
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let run = Run {
            status: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        };
        let key = fs::read_to_string(self.path("site.sitekey")).unwrap_or_default();
        if let Some(digits) = key.split(' ').nth(3).filter(|digits| digits.len() == 32) {
            for said in [&run.stdout, &run.stderr] {
                let said = said.to_lowercase();
                // Also a part of it, as numbers or in hexadecimal.
                let bytes: Vec<_> = (0..4)
                    .map(|n| u8::from_str_radix(&digits[2 * n..][..2], 16).unwrap())
                    .collect();
                let decimal = format!("{bytes:?}");
                assert!(!said.contains(&digits[..8]), "{words:?}");
                assert!(
                    !said.contains(decimal.trim_matches(['[', ']'])),
                    "{words:?}"
                );
            }
        }
        run
    }
}

impl Run {
    /// Checks that it succeeded; returns its output.
    #[track_caller]
    pub(crate) fn ok(self) -> String {
        assert_eq!(self.status, Some(0), "{}", self.stderr);
        self.stdout
    }

    /// Checks that it failed, and told this, without a backtrace.
    #[track_caller]
    pub(crate) fn fails(self, error: &str) {
        assert_eq!(self.status, Some(2), "{}", self.stderr);
        let is_of_clap = self.stderr.contains("--help");
        let is_ours = self
            .stderr
            .lines()
            .any(|line| line.starts_with("host-sim: "));
        assert!(is_of_clap || is_ours, "{}", self.stderr);
        assert!(!self.stderr.contains("backtrace"), "{}", self.stderr);
        assert!(
            self.stderr.contains(error),
            "`{error}` is not in: {}",
            self.stderr
        );
    }
}
