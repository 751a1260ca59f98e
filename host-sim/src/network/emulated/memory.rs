//! What a board's flash holds.

use std::{fs, ops::Range, path::Path};

use embassy_futures::block_on;
use node_firmware::facts::{self, Fact, FactStore};

use virtual_bench::{
    executor::Clock,
    flash::{Flash, PAGE},
    random::Root,
};

/// Where the board keeps the memory of its role.
const MEMORY: Range<u32> = 0..facts::BYTES;

/// The facts of this owner in a file that is a board's flash; none if there is no such file yet.
///
/// The board may go on writing: its memory is a log, of which a part is a memory too.
pub(super) fn facts(file: &Path, owner: u32, clock: &Clock) -> Vec<Fact> {
    let bytes = fs::read(file).unwrap_or_default();
    let pages = bytes.len() / PAGE;
    let mut facts = Vec::new();
    // A copy: reading may tidy up.
    let flash = Flash::new(clock, pages, Root(0).stream("copy", 0)).programmer();
    flash.bytes_mut().copy_from_slice(&bytes[..pages * PAGE]);
    block_on(async {
        if let Ok(mut memory) = FactStore::open(flash, MEMORY, owner).await {
            // What cannot be read is missing from the record, as from the node's own memory.
            let _ = memory.recall(|fact| facts.push(*fact)).await;
        }
    });
    facts
}
