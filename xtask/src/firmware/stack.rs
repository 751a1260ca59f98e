//! How much stack an image can take, computed from its code.
//!
//! The deepest chain of calls from the reset, plus the deepest of an interrupt on top of it: all
//! have the same priority here, so there is one at a time. A function takes what all its pushes
//! take together, at its deepest or not, so this is an upper bound but for calls through
//! pointers. Of those the executor's polls run the tasks; all others may call any function whose
//! address is kept somewhere, but that function no pointer of its own that would go round again.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Result, bail};

use super::{image::Image, panics::is_panic};

/// How names of functions begin that the executor calls.
const TASKS: &str = "embassy_executor::raw::TaskStorage<F>::poll";
/// Nothing formats text but what the panic handler would, and it does not.
const NEVER: [&str; 2] = ["core::fmt::", "<core::fmt::"];

/// What an interrupt puts on the stack: 26 words with the floating-point registers, and a word to
/// align it (ARM v7-M Architecture Reference Manual, B1.5.7).
const EXCEPTION: u64 = 108;

/// How many pointers deep calls go: the executor to a task, the task to a waker.
const LEVELS: usize = 2;

/// The deepest stack.
pub(super) struct Worst {
    /// All of it.
    pub(super) bytes: u64,
    /// The functions of the thread, and what each takes.
    pub(super) path: Vec<(String, u32)>,
}

/// Computes it.
///
/// # Errors
/// A function calls itself, so there is no bound.
pub(super) fn worst(image: &Image) -> Result<Worst> {
    let mut graph = Graph::new(image);
    let Some((&reset, handlers)) = image.vectors.split_first() else {
        bail!("{} has no table of vectors", image.path.display());
    };
    let thread = graph.depth(reset, LEVELS)?;
    let mut interrupt = 0;
    for &handler in handlers {
        interrupt = interrupt.max(graph.depth(handler, 1)?);
    }
    Ok(Worst {
        bytes: thread + EXCEPTION + interrupt,
        path: graph.path(reset, LEVELS),
    })
}

/// A function, and how many pointers deep calls from there may still go.
type Place = (u32, usize);

struct Graph<'a> {
    image: &'a Image,
    tasks: BTreeSet<u32>,
    kept: BTreeSet<u32>,
    /// Bytes from there on, and where they go next.
    known: BTreeMap<Place, (u64, Option<Place>)>,
    under_way: Vec<u32>,
    /// The outermost of those under way at which the way was cut since this was last looked at: what
    /// was found on the way holds only within that one.
    cut: Option<usize>,
}

impl<'a> Graph<'a> {
    fn new(image: &'a Image) -> Self {
        let name = |address: &u32| image.functions[address].name.as_str();
        let never = |address: &u32| NEVER.iter().any(|start| name(address).starts_with(start));
        let (tasks, kept) = image
            .kept
            .iter()
            .copied()
            .filter(|address| !never(address) && !image.vectors.contains(address))
            .partition(|address| name(address).starts_with(TASKS));
        Self {
            image,
            tasks,
            kept,
            known: BTreeMap::new(),
            under_way: Vec::new(),
            cut: None,
        }
    }

    /// The way ends here, as this function is under way already, as the `first` of them.
    fn cut(&mut self, first: usize) {
        self.cut = Some(self.cut.map_or(first, |other| other.min(first)));
    }

    fn depth(&mut self, address: u32, pointers: usize) -> Result<u64> {
        if let Some((bytes, _)) = self.known.get(&(address, pointers)) {
            return Ok(*bytes);
        }
        // The end of a node that panics does not count.
        let function = self.image.functions.get(&address);
        let function = function.filter(|function| !is_panic(&function.name));
        // Between functions: a jump table's code, or an alias without a size.
        let Some(function) = function else {
            return Ok(0);
        };
        if let Some(first) = self.under_way.iter().position(|&other| other == address) {
            let round = self.under_way[first..].iter();
            let names: Vec<_> = round
                .map(|other| self.image.functions[other].name.as_str())
                .collect();
            bail!(
                "functions that call each other round, so that the stack has no bound:\n  {}",
                names.join("\n  ")
            );
        }
        self.under_way.push(address);
        let mut next: Vec<_> = function
            .calls
            .iter()
            .map(|call| (call.target, pointers))
            .collect();
        if function.calls_pointers && pointers > 0 {
            let called = match pointers {
                LEVELS => self.tasks.union(&self.kept).copied().collect(),
                _ => self.kept.clone(),
            };
            next.extend(called.into_iter().map(|address| (address, pointers - 1)));
        }
        let cut_before = self.cut.take();
        let mut deepest = (0, None);
        for (address, pointers) in next {
            // Already on the way here: it would come round by a pointer.
            if pointers < LEVELS
                && self.is_kept(address)
                && let Some(first) = self.under_way.iter().position(|&other| other == address)
            {
                self.cut(first);
                continue;
            }
            let bytes = self.depth(address, pointers)?;
            if bytes > deepest.0 {
                deepest = (bytes, Some((address, pointers)));
            }
        }
        self.under_way.pop();
        let bytes = deepest.0 + u64::from(function.frame);
        // From elsewhere more of it may be open.
        if self.cut.is_none_or(|first| first >= self.under_way.len()) {
            self.known.insert((address, pointers), (bytes, deepest.1));
            self.cut = None;
        }
        if let Some(first) = cut_before {
            self.cut(first);
        }
        Ok(bytes)
    }

    fn is_kept(&self, address: u32) -> bool {
        self.kept.contains(&address) || self.tasks.contains(&address)
    }

    fn path(&self, address: u32, pointers: usize) -> Vec<(String, u32)> {
        let mut path = Vec::new();
        let mut next = Some((address, pointers));
        while let Some(at) = next {
            if let Some(function) = self.image.functions.get(&at.0) {
                path.push((function.name.clone(), function.frame));
            }
            next = self.known.get(&at).and_then(|(_, next)| *next);
        }
        path
    }
}
