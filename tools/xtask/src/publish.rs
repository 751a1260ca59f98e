//! Libraries that others build on: what a package must have, and whether it can be published and used.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, ensure};
use serde_json::Value;
use xshell::{Shell, cmd};

use crate::{built, setup};

/// Lines of a readme: one screen.
const SCREEN: usize = 90;

/// Folder in which packages are made and built.
const BUILT: &str = "target/publish";

/// A member of the workspace that is published.
pub(crate) struct Library {
    name: String,
    version: String,
    id: String,
    features: Vec<String>,
}

impl Library {
    /// Returns true for cargo's name of this package.
    pub(crate) fn has(&self, id: &str) -> bool {
        self.id == id
    }
}

/// All libraries that are published: those whose manifests do not say otherwise.
pub(crate) fn libraries(sh: &Shell) -> Result<Vec<Library>> {
    let libraries: Vec<_> = published(&metadata(sh)?)
        .filter_map(|package| {
            let features = package["features"].as_object()?;
            Some(Library {
                name: package["name"].as_str()?.to_owned(),
                version: package["version"].as_str()?.to_owned(),
                id: package["id"].as_str()?.to_owned(),
                features: features.keys().cloned().collect(),
            })
        })
        .collect();
    ensure!(
        !libraries.is_empty(),
        "no member of the workspace is published"
    );
    Ok(libraries)
}

fn metadata(sh: &Shell) -> Result<Value> {
    let said = cmd!(
        sh,
        "cargo metadata --locked --no-deps --format-version 1 --quiet"
    )
    .quiet()
    .read()?;
    Ok(serde_json::from_str(&said)?)
}

fn published(metadata: &Value) -> impl Iterator<Item = &Value> {
    let packages = metadata["packages"].as_array().into_iter().flatten();
    packages.filter(|package| package["publish"].is_null())
}

/// Publishes all libraries but for the last step, from a clean clone of the present commit; checks each of their
/// features alone; and compares them with the last version.
///
/// # Errors
/// A package is refused or does not build, a feature does not compile alone, or a public item has gone though the
/// version has not changed enough.
pub(crate) fn run(sh: &Shell) -> Result<()> {
    let complaints: Vec<_> = published(&metadata(sh)?).flat_map(complaints).collect();
    ensure!(complaints.is_empty(), "{}", complaints.join("\n"));
    dry_run(sh)?;
    for Library { name, features, .. } in libraries(sh)? {
        for feature in features {
            cmd!(
                sh,
                "cargo check --locked --package {name} --no-default-features --features {feature}"
            )
            .run()?;
        }
    }
    compare(sh)
}

/// A clean clone of the present commit.
fn clone(sh: &Shell) -> Result<PathBuf> {
    let clone = sh.current_dir().join(BUILT).join("clone");
    sh.remove_path(&clone)?;
    sh.create_dir(BUILT)?;
    cmd!(sh, "git clone --quiet . {clone}").run()?;
    Ok(clone)
}

/// Removes the libraries as they were packaged before, and what was built of them: cargo unpacks and builds a version
/// once, and the present one is the same until it is published.
fn forget_former(sh: &Shell) -> Result<()> {
    sh.remove_path(BUILT)?;
    let libraries = libraries(sh)?;
    for registry in built::registries()? {
        // Its local registry has no name.
        let name = registry.file_name().unwrap_or_default();
        if !name.to_string_lossy().starts_with('-') {
            continue;
        }
        for Library { name, version, .. } in &libraries {
            sh.remove_path(registry.join(format!("{name}-{version}")))?;
        }
    }
    Ok(())
}

fn dry_run(sh: &Shell) -> Result<()> {
    forget_former(sh)?;
    let built = sh.current_dir().join(BUILT);
    let _there = sh.push_dir(clone(sh)?);
    cmd!(
        sh,
        "cargo publish --locked --dry-run --workspace --target-dir {built}"
    )
    .run()
    .context("the libraries cannot be published")
}

/// Compares the libraries with those of the last tag, if there is one.
fn compare(sh: &Shell) -> Result<()> {
    let tag = cmd!(sh, "git describe --tags --abbrev=0 --match v*")
        .quiet()
        .ignore_stderr()
        .read();
    let Ok(tag) = tag else {
        eprintln!("no version has a tag yet: there is nothing to compare the libraries with");
        return Ok(());
    };
    setup::semver_checks(sh)?;
    // It takes no `--locked`: it builds documentation outside of the workspace.
    cmd!(
        sh,
        "cargo-semver-checks semver-checks --workspace --baseline-rev {tag}"
    )
    .run()
    .with_context(|| format!("a public item differs from {tag}: raise the version"))
}

/// A crate outside of the workspace that uses all libraries.
const OUTSIDE: &str = "tests/outside";

/// Begins the part of its manifest that names the folders of the libraries.
const PATHS: &str = "[patch.crates-io]";

/// Processors that it is built for beside [`setup::TARGETS`]: with other instructions, and of another family.
pub(crate) const OTHER_TARGETS: [&str; 3] = [
    "thumbv7m-none-eabi",
    "thumbv8m.main-none-eabihf",
    "riscv32imac-unknown-none-elf",
];

/// Builds the crate outside for the processors that every machine has: with the sources of the libraries, and with their
/// packages.
///
/// # Errors
/// It does not compile, or its program does not link.
pub(crate) fn outside(sh: &Shell) -> Result<()> {
    use_for(sh, &setup::TARGETS)
}

/// The same for [`OTHER_TARGETS`].
///
/// # Errors
/// It does not compile.
pub(crate) fn outside_others(sh: &Shell) -> Result<()> {
    use_for(sh, &OTHER_TARGETS)
}

fn use_for(sh: &Shell, targets: &[&str]) -> Result<()> {
    let built = sh.current_dir().join("target/outside");
    for folder in [sh.current_dir().join(OUTSIDE), unpacked(sh)?] {
        let _there = sh.push_dir(folder);
        for target in targets {
            // Libraries alone need no linker.
            let what: &[&str] = match *target == setup::TARGETS[0] {
                true => &["build"],
                false => &["check", "--lib"],
            };
            cmd!(
                sh,
                "cargo --locked {what...} --target {target} --target-dir {built}"
            )
            .run()
            .with_context(|| format!("the crate outside does not build for {target}"))?;
        }
    }
    Ok(())
}

/// The crate outside, with the packages of the libraries in the place of their folders.
fn unpacked(sh: &Shell) -> Result<PathBuf> {
    let built = sh.current_dir().join(BUILT);
    let libraries = libraries(sh)?;
    let chosen: Vec<_> = libraries
        .iter()
        .flat_map(|library| ["--package", &library.name])
        .collect();
    let _there = sh.push_dir(clone(sh)?);
    cmd!(
        sh,
        "cargo package --locked --no-verify --quiet {chosen...} --target-dir {built}"
    )
    .run()?;
    let packages = built.join("packages");
    sh.remove_path(&packages)?;
    sh.create_dir(&packages)?;
    let manifest = sh.read_file(format!("{OUTSIDE}/Cargo.toml"))?;
    let (mut manifest, paths) = manifest
        .split_once(PATHS)
        .map(|(own, paths)| (format!("{own}{PATHS}\n"), paths))
        .with_context(|| format!("{OUTSIDE} does not tell the folders of the libraries"))?;
    for Library { name, version, .. } in &libraries {
        let (package, folder) = (format!("{name}-{version}"), packages.display());
        let file = built.join("package").join(format!("{package}.crate"));
        cmd!(sh, "tar --extract --file {file} --directory {packages}").run()?;
        if paths.contains(&format!("\n{name} = ")) {
            manifest += &format!("{name} = {{ path = \"{folder}/{package}\" }}\n");
        }
    }
    let outside = packages.join("outside");
    sh.create_dir(&outside)?;
    for part in ["Cargo.lock", "src"] {
        cmd!(sh, "cp -r {OUTSIDE}/{part} {outside}").run()?;
    }
    sh.write_file(outside.join("Cargo.toml"), manifest)?;
    Ok(outside)
}

/// Demands of a published package that it does not meet.
fn complaints(package: &Value) -> Vec<String> {
    let name = package["name"].as_str().unwrap_or_default();
    let manifest = Path::new(package["manifest_path"].as_str().unwrap_or_default());
    let read = |file: &str| fs::read_to_string(manifest.with_file_name(file)).unwrap_or_default();
    let count = |key: &str| package[key].as_array().map_or(0, Vec::len);
    let mut complaints = Vec::new();
    let mut demand = |is_met: bool, what: &str| {
        if !is_met {
            complaints.push(format!("`{name}`: {what}"));
        }
    };
    for key in ["description", "license", "rust_version"] {
        demand(package[key].is_string(), &format!("has no {key}"));
    }
    demand(
        (1..=5).contains(&count("keywords")),
        "has one to five keywords",
    );
    demand(
        (1..=5).contains(&count("categories")),
        "has one to five categories",
    );
    let docs = &package["metadata"]["docs"]["rs"]["all-features"];
    demand(*docs == true, "shows all features on docs.rs");
    for file in ["LICENSE-APACHE", "LICENSE-MIT"] {
        demand(!read(file).is_empty(), &format!("has a {file}"));
    }
    let named = format!("`{name}`");
    demand(
        read("CHANGELOG.md").contains(&named),
        "is in the list of changes",
    );

    let readme = read("README.md");
    demand(
        readme.starts_with(&format!("# {name}\n")) && readme.lines().count() <= SCREEN,
        "has a readme of one screen with its name",
    );
    for part in [
        "## For whom\n",
        "## Example\n",
        "\n```rust\n",
        "## Limits\n",
    ] {
        demand(
            readme.contains(part),
            &format!("has in its readme {part:?}"),
        );
    }
    demand(
        read("src/lib.rs").starts_with("#![doc = include_str!(\"../README.md\")]\n"),
        "has its readme as documentation, so that its example is compiled",
    );
    for dependency in package["dependencies"].as_array().into_iter().flatten() {
        let is_of_tests = dependency["kind"] == "dev";
        let has_version = dependency["req"] != "*";
        demand(
            is_of_tests || has_version,
            &format!("tells a version of {}", dependency["name"]),
        );
    }
    complaints
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn workspace() -> Value {
        let sh = Shell::new().unwrap();
        sh.change_dir(env!("CARGO_MANIFEST_DIR"));
        metadata(&sh).unwrap()
    }

    #[test]
    fn every_published_library_is_complete() {
        let metadata = workspace();
        let complaints: Vec<_> = published(&metadata).flat_map(complaints).collect();
        assert!(complaints.is_empty(), "{complaints:#?}");
        let names: Vec<_> = published(&metadata).map(|it| it["name"].as_str()).collect();
        for firmware in crate::test::FIRMWARE_CRATES {
            assert!(
                names.contains(&Some(firmware)),
                "{firmware} is not published"
            );
        }
    }

    #[test]
    fn what_a_package_lacks_is_told() {
        let metadata = workspace();
        let good = published(&metadata).next().unwrap();
        for (key, value, complaint) in [
            ("license", Value::Null, "has no license"),
            ("keywords", json!([]), "one to five keywords"),
            ("metadata", Value::Null, "docs.rs"),
            (
                "manifest_path",
                json!("/nowhere/Cargo.toml"),
                "has a LICENSE-MIT",
            ),
            (
                "manifest_path",
                json!("/nowhere/Cargo.toml"),
                "readme of one screen",
            ),
            (
                "dependencies",
                json!([{"name": "other", "kind": null, "req": "*"}]),
                "tells a version of \"other\"",
            ),
        ] {
            let mut package = good.clone();
            package[key] = value;
            let told = complaints(&package);
            assert!(told.iter().any(|told| told.contains(complaint)), "{told:?}");
        }
        let mut package = good.clone();
        package["dependencies"] = json!([{"name": "other", "kind": "dev", "req": "*"}]);
        assert!(complaints(&package).is_empty());
    }
}
