//! Right to speak: CCM* (IEEE 802.15.4-2006, 7.6), frame counters, keys and peers.
//!
//! # What it protects against
//! Anybody without the site key: nothing of theirs is accepted, read, replayed or stored. Not
//! against a captured node: the key is one for all, so its owner can speak in every member's name.
//! It cannot make a node forget a key, send more than one answer per frame, or fill more than the
//! fixed tables; [`Keyring`] exists to shut it out again. That helps against a node that is out of
//! range while the key changes: the next key travels under the present one, and an attacker that has that
//! and listens learns it. Against such a one, all nodes have to be provisioned anew.
//!
//! # Nonces
//! A nonce is the sender's EUI-64, its frame counter and the level; for one key it must never
//! occur twice. [`Counter`] hands out counters only below a limit that a
//! [`Store`](crate::store::Store) has already written down, and a restart continues at that limit.
//! No counter restarts with a new key.
//!
//! # Replays
//! A receiver accepts from each sender only counters above the last one, kept in [`Peers`] in RAM.
//! It is *not* persisted. A receiver that does not know a sender (after its restart, or because the
//! entry was evicted) sends a challenge: a secured frame whose own counter, never used before, is
//! what the answer must repeat. Only a frame that does enters its sender into the table; older
//! frames then have smaller counters. So neither side's restart opens a door, flash is not worn by
//! reception, and evicting an entry is harmless. The price is one exchange per pair and restart.
//!
//! A frame that was jammed where it should have been received stays new there until its receiver hears a newer
//! one. So broadcasts, which are neither asked for nor repeated later, are taken only from peers that were heard
//! within [`FRESH_FOR`], and a node that broadcasts says more often that it is there. An attacker that can jam one
//! sender's frames for one receiver, and deliver each of them a little later than the one before, can make them
//! older than that.
//!
//! A frame that is refused for its counter or its code, under a short address, leads to a challenge too: the
//! address may have been given to another node. Acknowledgements repeat a counter, but answer no challenge: those
//! of strangers are ignored.
//!
//! # Changes of key
//! A member that has the next key uses it from the first frame under it on that is no challenge. If it missed all
//! of them, and its coordinator no longer hears it, it asks under the next key, and the answer tells which one is
//! in use. No node follows challenges under the next key, and the coordinator follows no other node: it is the
//! first to know.

mod ccm;
mod counter;
mod frame;
mod key;
mod peers;
#[cfg(test)]
mod tests;

pub use ccm::Protection;
pub use counter::{BLOCK, Counter, CounterError};
pub(crate) use frame::Envelope;
pub use frame::{FrameSecurity, Opened, Refused, SealError, Sealed, Sender};
pub use key::{Key, Keyring, RotationError};
pub use peers::{EVICT_AFTER, FRESH_FOR, Peer, Peers, TableFull};
#[cfg(test)]
pub(crate) use tests::storm;
