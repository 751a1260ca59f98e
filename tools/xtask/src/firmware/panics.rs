//! Places where an image can panic.
//!
//! Every panic ends in a function of `core`. Code that branches to one of these, or keeps its address, is found in
//! the linked image, so branches that the optimiser proved impossible do not count, and none that is left is
//! missed.

use std::{collections::BTreeMap, fmt, path::Path};

use addr2line::Loader;
use anyhow::{Result, anyhow};

use super::{
    image::{Function, Image},
    parts::{Crate, crate_of},
};

/// Beginnings of the names of functions that panic whenever they are called.
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

/// Beginning of the names of functions that the compiler makes of what others have in common.
const OUTLINED: &str = "OUTLINED_FUNCTION_";

/// Calls after which the way to a panic is not followed any more.
const DEEPEST: usize = 8;

/// A branch to a panic.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Panic {
    /// The crate whose code has it: the innermost one but for the language's own library. None if nothing tells.
    pub(super) krate: Option<Crate>,
    /// Kind of panic.
    pub(super) what: String,
    /// The functions that lead there by being inlined or called, outermost last, with their places.
    pub(super) place: Vec<String>,
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

/// Returns true if a function panics whenever it is called.
pub(super) fn is_panic(name: &str) -> bool {
    PANICS.iter().any(|start| name.starts_with(start))
}

/// All of them.
pub(super) fn find(image: &Image) -> Result<Vec<Panic>> {
    let lines = lines_of(image)?;
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
                for mut inlined in origins(&lines, &image.functions[&address], at)? {
                    // It belongs to those that call it.
                    if name.starts_with(OUTLINED) && !inlined.has_line {
                        inlined.krate = None;
                    }
                    let mut place: Vec<String> = below.clone();
                    place.extend(inlined.places);
                    // Code of the language's library that crates share belongs to its caller.
                    let is_shared = way.len() < DEEPEST
                        && inlined.krate.is_none()
                        && !image.kept.contains(&address)
                        && callers.contains_key(&address);
                    if is_shared {
                        let mut way = way.clone();
                        way.push(address);
                        open.push((way, place));
                    } else {
                        found.push(Panic {
                            krate: inlined.krate,
                            what: (*what).to_owned(),
                            place,
                        });
                    }
                }
            }
        }
    }
    // A pointer to a panic can be called from anywhere.
    for (address, what) in &panics {
        if image.kept.contains(address) {
            found.push(Panic {
                krate: None,
                what: (*what).to_owned(),
                place: vec!["a pointer".to_owned()],
            });
        }
    }
    found.sort();
    Ok(found)
}

/// Source lines of the code of an image.
pub(super) fn lines_of(image: &Image) -> Result<Loader> {
    Loader::new(&image.path).map_err(|error| anyhow!("no debug information: {error}"))
}

/// Functions that were inlined at an address.
#[derive(Default)]
pub(super) struct Inlined {
    /// The functions, innermost first, with their places.
    pub(super) places: Vec<String>,
    /// The first crate among them.
    krate: Option<Crate>,
    /// True if it has a line. Code that the compiler made of several branches has none.
    has_line: bool,
}

/// Functions that were inlined where a call of a panic comes from: at the call, or where it was made of several,
/// at the branches that lead to it.
fn origins(lines: &Loader, function: &Function, at: u32) -> Result<Vec<Inlined>> {
    let there = inlined(lines, at, &function.name)?;
    let before = function.jumps.iter().filter(|jump| jump.target <= at);
    let Some(begin) = before.map(|jump| jump.target).max() else {
        return Ok(vec![there]);
    };
    if there.has_line {
        return Ok(vec![there]);
    }
    let jumps = function.jumps.iter().filter(|jump| jump.target == begin);
    jumps
        .map(|jump| inlined(lines, jump.at, &function.name))
        .collect()
}

pub(super) fn inlined(lines: &Loader, at: u32, function: &str) -> Result<Inlined> {
    let mut frames = lines
        .find_frames(at.into())
        .map_err(|error| anyhow!("debug information: {error}"))?;
    let mut found = Inlined::default();
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
        let mut place = name;
        if let Some(location) = frame.location {
            let line = location.line.unwrap_or(0);
            let file = location.file.unwrap_or_default();
            found.has_line |= found.places.is_empty() && line > 0;
            found.krate = found
                .krate
                .or_else(|| dropped(&place))
                .or_else(|| crate_of(file));
            // The end of a path tells enough, and does not depend on the machine.
            let parts: Vec<_> = file.rsplit('/').take(3).collect();
            let parts: Vec<_> = parts.into_iter().rev().collect();
            place = format!("{place} ({}:{line})", parts.join("/"));
        }
        found.places.push(place);
    }
    if found.places.is_empty() {
        found.places.push(function.to_owned());
    }
    Ok(found)
}

/// The crate of a type that is dropped: the function is the language's, its work is the type's.
fn dropped(function: &str) -> Option<Crate> {
    let of = function.strip_prefix("core::ptr::drop_in_place<")?;
    let (name, _) = of.split_once("::")?;
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let is_of_language = ["core", "alloc"].contains(&name);
    (name.chars().all(is_name) && !is_of_language).then(|| {
        let name = name.replace('_', "-");
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let is_ours = ["", "boards", "libraries"]
            .iter()
            .any(|folder| root.join(folder).join(&name).is_dir());
        Crate { name, is_ours }
    })
}
