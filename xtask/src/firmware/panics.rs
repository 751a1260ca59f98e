//! Where an image can panic.
//!
//! Every panic ends in a function of `core`. Whoever branches to one of these, or keeps its address,
//! is found in the linked image, so what the optimiser proved impossible does not count, and
//! nothing that is left is missed.

use std::{collections::BTreeMap, fmt};

use addr2line::Loader;
use anyhow::{Result, anyhow};

use super::{
    allowed::{Grant, grant},
    image::Image,
};

/// How names of functions begin that panic whenever they are called.
const PANICS: [&str; 9] = [
    "core::panicking::",
    "core::cell::panic_",
    "core::option::expect_failed",
    "core::option::unwrap_failed",
    "core::result::unwrap_failed",
    "core::slice::copy_from_slice_impl::len_mismatch_fail",
    "core::slice::index::slice_",
    "core::str::slice_error_fail",
    "__rustc::rust_begin_unwind",
];

/// Crates of this project.
const OURS: [&str; 9] = [
    "board_support",
    "calib_core",
    "cmucam2_driver",
    "mps2_an386",
    "node_firmware",
    "nrf52840::",
    "nucleo_l476rg::",
    "pedestrian",
    "zigbee_link",
];

/// Calls after which the way to a panic is not followed any more.
const DEEPEST: usize = 8;

/// A branch to a panic.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Panic {
    /// Which panic.
    pub(super) what: String,
    /// The functions that lead there by being inlined or called, outermost last, with where.
    pub(super) place: Vec<String>,
    /// Why it is never taken, if that is known.
    pub(super) grant: Option<Grant>,
}

impl fmt::Display for Panic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.what)?;
        for place in &self.place {
            write!(f, "\n      in {place}")?;
        }
        Ok(())
    }
}

/// Whether a function panics whenever it is called.
pub(super) fn is_panic(name: &str) -> bool {
    PANICS.iter().any(|start| name.starts_with(start))
}

/// Whether a function is one of this project.
pub(super) fn is_ours(frame: &str) -> bool {
    let frame = frame.trim_start_matches(['<', '&']);
    OURS.iter().any(|name| frame.starts_with(name))
}

/// All of them, once each.
pub(super) fn find(image: &Image) -> Result<Vec<Panic>> {
    let lines =
        Loader::new(&image.path).map_err(|error| anyhow!("no debug information: {error}"))?;
    let panics: BTreeMap<u32, &str> = image
        .functions
        .iter()
        .filter(|(_, function)| is_panic(&function.name))
        .map(|(&address, function)| (address, function.name.as_str()))
        .collect();
    let mut callers = BTreeMap::<u32, Vec<(u32, u32)>>::new();
    for (&address, function) in &image.functions {
        for call in &function.calls {
            callers
                .entry(call.target)
                .or_default()
                .push((address, call.at));
        }
    }
    let mut found = Vec::new();
    for (&panic, what) in &panics {
        // Functions on the way, the panic first, and the places in them.
        let mut open = vec![(vec![panic], Vec::new())];
        while let Some((way, below)) = open.pop() {
            let callers_of = |callee| callers.get(&callee).into_iter().flatten();
            for &(address, at) in way.last().copied().into_iter().flat_map(callers_of) {
                let name = &image.functions[&address].name;
                if is_panic(name) || way.contains(&address) {
                    continue;
                }
                let mut place: Vec<String> = below.clone();
                place.extend(frames(&lines, at, name)?);
                let grant = grant(what, &place);
                // What several functions of ours share of a library is judged where ours call it.
                let is_shared = way.len() < DEEPEST
                    && !place.iter().any(|frame| is_ours(frame))
                    && !image.kept.contains(&address)
                    && callers.contains_key(&address);
                if grant.is_none() && is_shared {
                    let mut way = way.clone();
                    way.push(address);
                    open.push((way, place));
                } else {
                    found.push(Panic {
                        what: (*what).to_owned(),
                        place,
                        grant,
                    });
                }
            }
        }
    }
    // A pointer to a panic can be called from anywhere.
    for (address, what) in &panics {
        if image.kept.contains(address) {
            found.push(Panic {
                what: (*what).to_owned(),
                place: vec!["a pointer".to_owned()],
                grant: None,
            });
        }
    }
    found.sort();
    found.dedup();
    Ok(found)
}

/// What was inlined at an address, innermost first.
fn frames(lines: &Loader, at: u32, function: &str) -> Result<Vec<String>> {
    let mut frames = lines
        .find_frames(at.into())
        .map_err(|error| anyhow!("debug information: {error}"))?;
    let mut places = Vec::new();
    while let Some(frame) = frames
        .next()
        .map_err(|error| anyhow!("debug information: {error}"))?
    {
        let name = match frame
            .function
            .as_ref()
            .and_then(|name| name.raw_name().ok())
        {
            Some(name) => format!("{:#}", rustc_demangle::demangle(&name)),
            None => function.to_owned(),
        };
        let location = frame.location.and_then(|location| {
            // The end of a path tells enough, and does not depend on the machine.
            let parts: Vec<_> = location.file?.rsplit('/').take(3).collect();
            let file: Vec<_> = parts.into_iter().rev().collect();
            Some(format!("{}:{}", file.join("/"), location.line.unwrap_or(0)))
        });
        places.push(match location {
            Some(location) => format!("{name} ({location})"),
            None => name,
        });
    }
    if places.is_empty() {
        places.push(function.to_owned());
    }
    Ok(places)
}
