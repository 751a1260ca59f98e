//! Who may speak: CCM* (IEEE 802.15.4-2006, 7.6), frame counters, keys and peers.
//!
//! # What it protects against
//! Anybody without the site key: nothing of theirs is accepted, read, replayed or stored. Not
//! against a captured node: the key is one for all, so its owner can speak in every member's name.
//! It cannot make a node forget a key, send more than one answer per frame, or fill more than the
//! fixed tables; [`Keyring`] exists to shut it out again.
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
//! Every frame that repeats a counter serves as such an answer, acknowledgements too.

mod ccm;
mod counter;
mod key;
mod peers;
mod session;
#[cfg(test)]
mod tests;

pub use ccm::Protection;
pub use counter::{BLOCK, Counter, CounterError};
pub use key::{Key, Keyring, RotationError};
pub use peers::{EVICT_AFTER, Peer, Peers, TableFull};
pub use session::{Opened, Refused, SealError, Sealed, Sender, Session};
#[cfg(test)]
pub(crate) use tests::storm;
