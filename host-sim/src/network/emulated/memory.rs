//! Contents of a board's flash.

use std::ops::Range;

use embassy_futures::block_on;
use node_firmware::facts::{self, Fact, FactStore};

use zigbee_link::{store::Store, wire::Eui64};

use virtual_hardware::{
    executor::Clock,
    flash::{Flash, PAGE},
    random::Root,
};

/// Part of the flash in which the board keeps the memory of its role.
const MEMORY: Range<u32> = 0..facts::BYTES;

/// Part in which it keeps the memory of its link.
pub(super) const LINK: Range<u32> = facts::BYTES..facts::BYTES + 4 * PAGE as u32;

/// A flash with these contents: reading may tidy up.
fn copy(bytes: &[u8], clock: &Clock) -> Flash {
    let pages = bytes.len() / PAGE;
    let flash = Flash::new(clock, pages, Root(0).stream("copy", 0)).programmer();
    flash.bytes_mut().copy_from_slice(&bytes[..pages * PAGE]);
    flash
}

/// The extended address in the link's part of a flash; `None` if it has none yet, or cannot be read.
pub(in crate::network) fn extended(link: Range<u32>, bytes: &[u8], clock: &Clock) -> Option<Eui64> {
    let mut store = Store::new(copy(bytes, clock), link).ok()?;
    block_on(store.load()).ok()?.extended
}

/// The facts of this owner in the contents of a board's flash.
///
/// The board may go on writing: its memory is a log, of which a part is a memory too.
pub(super) fn facts(bytes: &[u8], owner: u32, clock: &Clock) -> Vec<Fact> {
    let flash = copy(bytes, clock);
    let mut facts = Vec::new();
    block_on(async {
        if let Ok(mut memory) = FactStore::open(flash, MEMORY, owner).await {
            // Facts that cannot be read are missing from the record, as from the node's own memory.
            let _ = memory.recall(|fact| facts.push(*fact)).await;
        }
    });
    facts
}
