//! Which crates the code of an image is from.

use std::collections::BTreeMap;

use addr2line::Loader;
use anyhow::{Result, anyhow};

use super::image::Image;

/// Where nothing else claims it: the language's own library, and code without a place.
const REST: &str = "core, and without a place";

/// Bytes of code by crate, most first. Code belongs to the innermost crate of what is inlined
/// there, the language's own library left out: a list's `push` to the list, not to who pushes.
pub(super) fn by_crate(image: &Image) -> Result<Vec<(String, u64)>> {
    let lines =
        Loader::new(&image.path).map_err(|error| anyhow!("no debug information: {error}"))?;
    let mut bytes = BTreeMap::<String, u64>::new();
    for (&address, function) in &image.functions {
        // Instructions are two or four bytes long, and a place is one for both halves.
        for at in (address..address + function.size).step_by(2) {
            let part = part(&lines, at)?.unwrap_or_else(|| REST.to_owned());
            *bytes.entry(part).or_default() += 2;
        }
    }
    let mut parts: Vec<_> = bytes.into_iter().collect();
    parts.sort_by_key(|(name, bytes)| (std::cmp::Reverse(*bytes), name.clone()));
    Ok(parts)
}

fn part(lines: &Loader, at: u32) -> Result<Option<String>> {
    let mut frames = lines
        .find_frames(at.into())
        .map_err(|error| anyhow!("debug information: {error}"))?;
    while let Some(frame) = frames.next()? {
        let file = frame.location.and_then(|location| location.file);
        if let Some(name) = file.and_then(crate_of) {
            return Ok(Some(name));
        }
    }
    Ok(None)
}

/// The folder in which `src` is, without its version; none for the language's own library.
fn crate_of(file: &str) -> Option<String> {
    if file.starts_with("/rustc/") || file.contains("/library/core/") {
        return None;
    }
    let (before, _) = file.split_once("/src/").map(|(before, after)| {
        // Of a registry the folder of sources is called so, too.
        match after.split_once("/src/") {
            Some((folder, rest)) if before.ends_with("registry") => (folder, rest),
            _ => (before, after),
        }
    })?;
    let folder = before.rsplit('/').next()?;
    let is_version = |rest: &str| rest.starts_with(|c: char| c.is_ascii_digit());
    let name = match folder.rfind('-') {
        Some(dash) if is_version(&folder[dash + 1..]) => &folder[..dash],
        _ => folder,
    };
    Some(name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crates_by_their_folders() {
        for (file, name) in [
            ("zigbee-link/src/link/mod.rs", Some("zigbee-link")),
            ("/home/x/node/boards/nrf52840/src/main.rs", Some("nrf52840")),
            (
                "/home/x/.cargo/registry/src/index.crates.io-1949cf8c6b5b557f/embassy-sync-0.8.0/src/pipe.rs",
                Some("embassy-sync"),
            ),
            ("/rustc/0123/library/core/src/option.rs", None),
            ("main.rs", None),
        ] {
            assert_eq!(crate_of(file).as_deref(), name, "{file}");
        }
    }
}
