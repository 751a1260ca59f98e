//! Crates from which an image is made, byte by byte.

use std::collections::BTreeMap;

use addr2line::Loader;
use anyhow::{Context, Result, anyhow, ensure};

use super::image::Image;

/// Beginnings of the paths of the language's sources.
const LANGUAGE: [(&str, &str); 2] = [
    ("/library/compiler-builtins/", "compiler_builtins"),
    ("/library/core/", "core"),
];

/// Groups of crates that the documentation tells together; a star stands for any rest. Crates that are in none are
/// the last.
const GROUPS: [(&str, &[&str]); 12] = [
    (
        "roles and what surrounds them: `node-firmware`",
        &["node-firmware"],
    ),
    (
        "link: `zigbee-link`, on the NUCLEO `spinel-radio`",
        &["zigbee-link", "spinel-radio"],
    ),
    (
        "mathematics: `calib-core`, `pedestrian`; `nalgebra`, `simba`, `num-traits`, `libm`",
        &[
            "calib-core",
            "pedestrian",
            "nalgebra",
            "simba",
            "num-traits",
            "libm",
        ],
    ),
    ("camera's protocol: `cmucam2-driver`", &["cmucam2-driver"]),
    (
        "messages' encoding: `postcard`, `serde_core`, `cobs`",
        &["postcard", "serde_core", "cobs"],
    ),
    ("flash: `flash-log`", &["flash-log"]),
    ("cipher: `aes`, `hybrid-array`", &["aes", "hybrid-array"]),
    ("lists: `heapless`", &["heapless"]),
    (
        "board: own code, the chip's crates, logs, memory functions",
        &[
            "nrf52",
            "nrf52840",
            "nucleo-l476rg",
            "support",
            "embassy-nrf",
            "embassy-stm32",
            "embassy-hal-internal",
            "nrf-pac",
            "stm32-metapac",
            "cortex-m*",
            "vcell",
            "static_cell",
            "portable-atomic",
            "defmt*",
            "memory-functions",
        ],
    ),
    ("tasks and time: the other `embassy` crates", &["embassy-*"]),
    (
        "the language's library: `core`, `compiler_builtins`",
        &["core", "compiler_builtins"],
    ),
    (
        "constants of all crates, first values of variables, table of vectors",
        &[
            "constants of all crates",
            "first values of variables",
            "table of vectors",
        ],
    ),
];
const REST: &str = "everything else, with what fills gaps";

/// The groups, in the order of [`by_group`].
pub(super) fn groups() -> impl Iterator<Item = &'static str> {
    GROUPS.iter().map(|(group, _)| *group).chain([REST])
}

/// Bytes of each group, of which a crate is in the first that has its name.
pub(super) fn by_group(parts: &[(String, u64)]) -> Vec<u64> {
    let mut bytes = vec![0; GROUPS.len() + 1];
    for (part, size) in parts {
        let is_in = |&(_, names): &(&str, &[&str])| {
            names.iter().any(|name| match name.strip_suffix('*') {
                Some(start) => part.starts_with(start),
                None => part == name,
            })
        };
        bytes[GROUPS.iter().position(is_in).unwrap_or(GROUPS.len())] += size;
    }
    bytes
}

/// Bytes of the flash by crate, most first, and then those of none; together they are all. Code belongs to the
/// innermost crate that is inlined there, the language's own library left out: a list's `push` to the list, not to
/// its caller.
///
/// # Errors
/// They are not all.
pub(super) fn by_crate(image: &Image) -> Result<Vec<(String, u64)>> {
    let lines =
        Loader::new(&image.path).map_err(|error| anyhow!("no debug information: {error}"))?;
    let mut bytes = BTreeMap::<String, u64>::new();
    // Functions may have several names, and share an end.
    let mut end = 0;
    for (&address, function) in &image.functions {
        // Instructions are two or four bytes long, and a place is one for both halves.
        for at in (address.max(end)..address + function.size).step_by(2) {
            *bytes.entry(part(&lines, at, &function.name)?).or_default() += 2;
        }
        end = end.max(address + function.size);
    }
    let mut parts: Vec<_> = bytes.into_iter().collect();
    parts.sort_by_key(|(name, bytes)| (std::cmp::Reverse(*bytes), name.clone()));
    let functions: u64 = parts.iter().map(|(_, bytes)| bytes).sum();
    for (name, bytes) in &image.sections {
        match name.as_str() {
            ".text" => {
                let between = bytes.checked_sub(functions);
                let between = between.context("there is code of functions elsewhere")?;
                parts.push(("between functions".to_owned(), between));
            }
            ".vector_table" => parts.push(("table of vectors".to_owned(), *bytes)),
            ".rodata" => parts.push(("constants of all crates".to_owned(), *bytes)),
            ".data" => parts.push(("first values of variables".to_owned(), *bytes)),
            _ => parts.push((format!("section {name}"), *bytes)),
        }
    }
    let all: u64 = parts.iter().map(|(_, bytes)| bytes).sum();
    ensure!(
        all == image.size.flash,
        "{all} bytes are accounted for, of {}",
        image.size.flash
    );
    Ok(parts)
}

/// Part to which an instruction belongs, or data among code.
fn part(lines: &Loader, at: u32, function: &str) -> Result<String> {
    let mut frames = lines
        .find_frames(at.into())
        .map_err(|error| anyhow!("debug information: {error}"))?;
    let mut language = None;
    while let Some(frame) = frames.next()? {
        let Some(file) = frame.location.and_then(|location| location.file) else {
            continue;
        };
        if let Some(krate) = crate_of(file) {
            return Ok(krate.name);
        }
        let library = LANGUAGE.iter().find(|(path, _)| file.contains(path));
        language = language.or(library.map(|(_, name)| (*name).to_owned()));
    }
    // The name tells the origin of assembly.
    let is_memory = ["mem", "__aeabi_mem"]
        .iter()
        .any(|start| function.starts_with(start));
    let nameless = || match function {
        _ if is_memory => "memory-functions",
        _ if function.starts_with("OUTLINED_FUNCTION_") => {
            "shared by several, made by the compiler"
        }
        _ => "without a place",
    };
    Ok(language.unwrap_or_else(|| nameless().to_owned()))
}

/// Origin of a source file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Crate {
    pub(super) name: String,
    /// It is of this project.
    pub(super) is_ours: bool,
}

/// The folder in which `src` is, without its version; none for the language's own library.
pub(super) fn crate_of(file: &str) -> Option<Crate> {
    if file.starts_with("/rustc/") || file.contains("/library/core/") {
        return None;
    }
    let (before, after) = file.split_once("/src/")?;
    // The folder of sources of a registry is called so, too.
    let is_ours = !before.ends_with("registry");
    let (before, _) = if is_ours {
        (before, after)
    } else {
        after.split_once("/src/")?
    };
    let folder = before.rsplit('/').next()?;
    let is_version = |rest: &str| rest.starts_with(|c: char| c.is_ascii_digit());
    let name = match folder.rfind('-') {
        Some(dash) if is_version(&folder[dash + 1..]) => &folder[..dash],
        _ => folder,
    };
    Some(Crate {
        name: name.to_owned(),
        is_ours,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crates_by_their_group() {
        let parts = ["embassy-nrf", "embassy-time", "heapless", "cordyceps"];
        let parts = parts.map(|part| (part.to_owned(), 1));
        let bytes = by_group(&parts);
        assert_eq!(bytes, [0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 0, 0, 1]);
        assert_eq!(groups().count(), bytes.len());
    }

    #[test]
    fn crates_by_their_folders() {
        for (file, name) in [
            ("zigbee-link/src/link/mod.rs", Some(("zigbee-link", true))),
            (
                "/home/x/node/boards/nrf52840/src/main.rs",
                Some(("nrf52840", true)),
            ),
            (
                "/home/x/.cargo/registry/src/index.crates.io-1949cf8c6b5b557f/embassy-sync-0.8.0/src/pipe.rs",
                Some(("embassy-sync", false)),
            ),
            ("/rustc/0123/library/core/src/option.rs", None),
            ("main.rs", None),
        ] {
            let found = crate_of(file);
            let found = found.as_ref().map(|found| (&*found.name, found.is_ours));
            assert_eq!(found, name, "{file}");
        }
    }
}
