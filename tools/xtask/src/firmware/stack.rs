//! Most stack that an image can take, computed from its code.
//!
//! The deepest chain of calls from the reset, plus the deepest of an interrupt on top of it: all have the same
//! priority here, so there is one at a time. A function takes what all its pushes take together, at its deepest or
//! not, so this is an upper bound. Calls through pointers reach what [`POINTERS`] says, and one that is not listed
//! there is an error. A register that was given the address of a function in the same function is known (see
//! [`super::thumb`]).

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, Result, bail, ensure};

use super::{
    image::{Function, Image},
    panics::{inlined, is_panic, lines_of},
};

/// Functions that a call through a pointer can reach.
enum Reach {
    /// Functions whose names begin like this, and whose address is kept somewhere.
    Functions(&'static [&'static str]),
    /// The functions in a table of this name.
    Table(&'static str),
}

/// Wakers are made by the executor of the board only.
const WAKER: Reach = Reach::Table("embassy_executor::raw::waker::VTABLE");

/// Beginnings of the names of functions that call through a pointer, inlined or not, and the functions that they
/// reach.
const POINTERS: &[(&[&str], Reach)] = &[
    (
        &[
            "<core::task::wake::Waker>::",
            "<core::task::wake::Waker as ",
        ],
        WAKER,
    ),
    // Only the panic handler would format text, and it does not. But the compiler makes one function of such and
    // of those of wakers, where they are the same code.
    (&["core::fmt::", "<core::fmt::"], WAKER),
    (&["embassy_sync::signal::Signal<M,T>::poll_wait"], WAKER),
    // `yield_now`, and a channel, of whose lines none is left.
    (
        &[
            "flash_log::banks::Banks<F>::access",
            "node_firmware::run::camera::CameraDevice<K,C>::wake",
            "core::ptr::drop_in_place<node_firmware::run::run_over<",
        ],
        WAKER,
    ),
    (
        &["embassy_executor::raw::SyncExecutor::poll"],
        Reach::Functions(&[
            "embassy_executor::raw::TaskStorage<F>::poll",
            "embassy_executor::raw::poll_exited",
        ]),
    ),
    (
        &["calib_core::reference::candidates::Best<T>::offer_resections"],
        Reach::Functions(&["core::ops::function::Fn"]),
    ),
    (
        &["cmucam2_driver::device::Call<"],
        Reach::Functions(&["cmucam2_driver::", "core::ops::function::FnOnce::call_once"]),
    ),
    (
        &["defmt_rtt::channel::Channel::write_all"],
        Reach::Functions(&["defmt_rtt::channel::Channel::"]),
    ),
    (
        &["flash_log::banks::Banks<F>::begin"],
        Reach::Functions(&[
            "flash_log::Log<F,_>::begin",
            "core::ops::function::FnOnce::call_once{{vtable",
        ]),
    ),
    (
        &["flash_log::banks::Banks<F>::compact"],
        Reach::Functions(&["flash_log::banks::Banks<F>::open", "zigbee_link::store::"]),
    ),
    (
        &["node_firmware::vision::steady::Steadiness<_>::"],
        Reach::Functions(&["node_firmware::vision::", "core::ops::function::Fn"]),
    ),
    (
        &["zigbee_link::wire::beacon::Beacon::emit"],
        Reach::Functions(&["zigbee_link::wire::beacon::"]),
    ),
];

/// Bytes that an interrupt puts on the stack: 26 words with the floating-point registers, and a word to align it
/// (ARM v7-M Architecture Reference Manual, B1.5.7).
const EXCEPTION: u64 = 108;

/// The deepest stack.
pub(super) struct Worst {
    /// All of it.
    pub(super) bytes: u64,
    /// The functions of the thread, and the bytes that each takes.
    pub(super) path: Vec<(String, u32)>,
}

/// Computes it.
///
/// # Errors
/// A function calls itself, so there is no bound; or a call goes to an unknown function.
pub(super) fn worst(image: &Image) -> Result<Worst> {
    let mut graph = Graph::new(image)?;
    let Some((&reset, handlers)) = image.vectors.split_first() else {
        bail!("{} has no table of vectors", image.path.display());
    };
    let thread = graph.depth(reset)?;
    let mut interrupt = 0;
    for &handler in handlers {
        interrupt = interrupt.max(graph.depth(handler)?);
    }
    Ok(Worst {
        bytes: thread + EXCEPTION + interrupt,
        path: graph.path(reset),
    })
}

struct Graph<'a> {
    image: &'a Image,
    /// Functions that a function calls through pointers.
    pointed: BTreeMap<u32, BTreeSet<u32>>,
    /// Bytes from there on, and where they go next.
    known: BTreeMap<u32, (u64, Option<u32>)>,
    under_way: Vec<u32>,
}

impl<'a> Graph<'a> {
    fn new(image: &'a Image) -> Result<Self> {
        let mut pointed = BTreeMap::<u32, BTreeSet<u32>>::new();
        let lines = lines_of(image)?;
        let mut unknown = String::new();
        for (&address, function) in &image.functions {
            for &at in &function.pointer_calls {
                let frames = inlined(&lines, at, &function.name)?.places;
                // The function itself too: code that the compiler adds to it has no line.
                let names = || frames.iter().chain([&function.name]);
                let rule = POINTERS.iter().find(|(callers, _)| {
                    let is_one =
                        |name: &String| callers.iter().any(|start| name.starts_with(start));
                    names().any(is_one)
                });
                match rule {
                    Some((_, reach)) => {
                        pointed
                            .entry(address)
                            .or_default()
                            .extend(reached(image, reach, address)?);
                    }
                    None => unknown += &format!("\n  {}", frames.join("\n    in ")),
                }
            }
        }
        ensure!(
            unknown.is_empty(),
            "add to POINTERS of tools/xtask/src/firmware/stack.rs what calls through a pointer there reach, \
             in {}:{unknown}",
            image.path.display()
        );
        Ok(Self {
            image,
            pointed,
            known: BTreeMap::new(),
            under_way: Vec::new(),
        })
    }

    fn depth(&mut self, address: u32) -> Result<u64> {
        if let Some((bytes, _)) = self.known.get(&address) {
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
        let direct = function.calls.iter().map(|call| call.target);
        let pointed = self.pointed.get(&address).into_iter().flatten().copied();
        let mut deepest = (0, None);
        for next in direct.chain(pointed).collect::<BTreeSet<_>>() {
            let bytes = self.depth(next)?;
            if bytes > deepest.0 {
                deepest = (bytes, Some(next));
            }
        }
        self.under_way.pop();
        let bytes = deepest.0 + u64::from(function.frame);
        self.known.insert(address, (bytes, deepest.1));
        Ok(bytes)
    }

    fn path(&self, address: u32) -> Vec<(String, u32)> {
        let mut path = Vec::new();
        let mut next = Some(address);
        while let Some(at) = next {
            if let Some(function) = self.image.functions.get(&at) {
                path.push((function.name.clone(), function.frame));
            }
            next = self.known.get(&at).and_then(|(_, next)| *next);
        }
        path
    }
}

/// The functions that a call can reach: not the one that calls, whose address may be kept, too.
///
/// # Errors
/// There is none in this image.
fn reached(image: &Image, reach: &Reach, caller: u32) -> Result<Vec<u32>> {
    let found: Vec<u32> = match reach {
        Reach::Functions(starts) => {
            let is_one =
                |function: &Function| starts.iter().any(|start| function.name.starts_with(start));
            let kept = image.kept.iter().copied().filter(|&other| other != caller);
            kept.filter(|address| is_one(&image.functions[address]))
                .collect()
        }
        Reach::Table(name) => {
            let table = image.tables.get(*name);
            let table = table.with_context(|| format!("there is no table `{name}`"))?;
            table.clone()
        }
    };
    ensure!(
        !found.is_empty(),
        "no function is reached by a pointer that should"
    );
    Ok(found)
}
