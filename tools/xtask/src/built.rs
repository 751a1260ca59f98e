//! Places where cargo puts programs, and sources of packages. Where a program is, only cargo knows: `CARGO_TARGET_DIR`
//! and `build.target-dir` move it.

use std::{env, fs, path::PathBuf};

use anyhow::{Context, Result};
use serde_json::Value;
use xshell::{Shell, cmd};

/// Finds a program in the messages of a `cargo build --message-format json-render-diagnostics`.
///
/// # Errors
/// There is none of this name.
pub(crate) fn program(messages: &str, name: &str) -> Result<PathBuf> {
    for message in messages.lines() {
        let message: Value = serde_json::from_str(message)?;
        if let (Some(path), true) = (
            message["executable"].as_str(),
            message["target"]["name"] == name,
        ) {
            return Ok(path.into());
        }
    }
    anyhow::bail!("cargo built no program `{name}`")
}

/// The folder in which cargo builds.
///
/// # Errors
/// Cargo does not tell.
pub(crate) fn folder(sh: &Shell) -> Result<PathBuf> {
    let metadata = cmd!(sh, "cargo metadata --locked --no-deps --format-version 1")
        .quiet()
        .read()?;
    let metadata: Value = serde_json::from_str(&metadata)?;
    let folder = metadata["target_directory"].as_str();
    Ok(folder
        .context("cargo does not tell where it builds")?
        .into())
}

/// Folders in which cargo keeps the sources of packages, one for each registry.
pub(crate) fn registries() -> Result<Vec<PathBuf>> {
    let home = env::var_os("CARGO_HOME").map(PathBuf::from);
    let usual = || env::home_dir().map(|home| home.join(".cargo"));
    let sources = home.or_else(usual).map(|home| home.join("registry/src"));
    let Some(sources) = sources.filter(|sources| sources.is_dir()) else {
        return Ok(Vec::new());
    };
    let folders = fs::read_dir(sources)?.map(|folder| Ok(folder?.path()));
    folders.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A library, a program of another name, and the one that was asked for.
    const MESSAGES: &str = r#"{"reason":"compiler-artifact","target":{"name":"node"},"executable":null}
{"reason":"compiler-artifact","target":{"name":"other"},"executable":"/elsewhere/thumb/firmware/other"}
{"reason":"compiler-artifact","target":{"name":"node"},"executable":"/elsewhere/thumb/firmware/node"}
{"reason":"build-finished","success":true}"#;

    #[test]
    fn a_program_is_where_cargo_says() {
        let found = |name| program(MESSAGES, name).map_err(|error| error.to_string());
        assert_eq!(found("node"), Ok("/elsewhere/thumb/firmware/node".into()));
        let none = "cargo built no program `nodes`".to_owned();
        assert_eq!(found("nodes"), Err(none));
    }

    #[test]
    fn a_folder_may_be_elsewhere() {
        let sh = Shell::new().unwrap();
        sh.change_dir(env!("CARGO_MANIFEST_DIR"));
        let elsewhere = std::env::temp_dir().join("elsewhere");
        sh.set_var("CARGO_TARGET_DIR", &elsewhere);
        assert_eq!(folder(&sh).unwrap(), elsewhere);
    }
}
