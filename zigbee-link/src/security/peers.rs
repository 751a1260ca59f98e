//! Senders that were heard, and the counter up to which.

use core::{fmt, time::Duration};

use crate::{
    Instant,
    wire::{Eui64, ShortAddress},
};

/// A peer that was silent for this long may lose its place to another. Longer than any message is
/// retried, so that no retry is taken for a new message.
pub const EVICT_AFTER: Duration = Duration::from_secs(60);

/// A peer that was silent for this long has to prove that its next broadcast is fresh. A frame that was not heard
/// is new by its counter, however late it is sent again.
pub const FRESH_FOR: Duration = Duration::from_secs(60);

/// A counter that is behind by more than this may be the true one of a peer, if the peer proves it: so many frames
/// of a node never overtake another frame of that node.
pub(crate) const STALE_AFTER: u32 = 1000;

/// A sender whose frames are known to be fresh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Peer {
    /// Its extended address.
    pub extended: Eui64,
    /// Its short address, as it said itself; [`ShortAddress::UNASSIGNED`] for none.
    pub short: ShortAddress,
    /// The counter of the last frame accepted from it.
    pub counter: u32,
    /// Time when that frame came.
    pub heard: Instant,
    /// Number of the last unicast message delivered from it: the counter of its first frame.
    pub(crate) last_unicast: Option<u32>,
    /// The same for broadcasts.
    pub(crate) last_broadcast: Option<u32>,
}

/// Every place is taken by a peer that spoke less than [`EVICT_AFTER`] ago.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TableFull;

impl fmt::Display for TableFull {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the peer table is full: build the node with more places")
    }
}

impl core::error::Error for TableFull {}

/// Up to `N` peers. 40 bytes each on a 32-bit processor.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Peers<const N: usize>(heapless::Vec<Peer, N>);

impl<const N: usize> Default for Peers<N> {
    fn default() -> Self {
        Self(heapless::Vec::new())
    }
}

impl<const N: usize> Peers<N> {
    /// The peer with this extended address.
    pub fn by_extended(&self, extended: Eui64) -> Option<&Peer> {
        self.0.iter().find(|peer| peer.extended == extended)
    }

    /// The peer with this short address.
    pub fn by_short(&self, short: ShortAddress) -> Option<&Peer> {
        self.0
            .iter()
            .find(|peer| peer.short == short && short.is_unicast())
    }

    /// All peers, in no particular order.
    pub fn iter(&self) -> impl Iterator<Item = &Peer> {
        self.0.iter()
    }

    pub(crate) fn by_extended_mut(&mut self, extended: Eui64) -> Option<&mut Peer> {
        self.0.iter_mut().find(|peer| peer.extended == extended)
    }

    /// Enters a peer whose frame with `counter` has just been proven fresh.
    pub(crate) fn enter(
        &mut self,
        extended: Eui64,
        short: ShortAddress,
        counter: u32,
        now: Instant,
    ) -> Result<(), TableFull> {
        let peer = Peer {
            extended,
            short,
            counter,
            heard: now,
            last_unicast: None,
            last_broadcast: None,
        };
        let is_full = self.0.is_full();
        if let Some(known) = self.by_extended_mut(extended) {
            // A counter far behind: another node with the key spoke in this peer's name, with a high one. A
            // counter behind by less may be that of an answer that was overtaken.
            if known.counter.saturating_sub(counter) > STALE_AFTER {
                *known = peer;
            }
            known.counter = known.counter.max(counter);
            known.heard = now;
        } else if is_full {
            let oldest = self.0.iter_mut().min_by_key(|peer| peer.heard);
            match oldest.filter(|oldest| oldest.heard + EVICT_AFTER <= now) {
                Some(oldest) => *oldest = peer,
                None => return Err(TableFull),
            }
        } else {
            self.0.push(peer).map_err(|_| TableFull)?;
        }
        // An address given to another node is no longer its former owner's.
        self.rename(extended, short);
        Ok(())
    }

    /// A node that leaves a network knows no short address in the next one.
    pub(crate) fn forget_addresses(&mut self) {
        for peer in &mut self.0 {
            peer.short = ShortAddress::UNASSIGNED;
        }
    }

    /// Makes a peer a stranger.
    pub(crate) fn forget(&mut self, extended: Eui64) {
        if let Some(place) = self.0.iter().position(|peer| peer.extended == extended) {
            self.0.swap_remove(place);
        }
    }

    /// Gives a peer another short address.
    pub(crate) fn rename(&mut self, extended: Eui64, short: ShortAddress) {
        for peer in &mut self.0 {
            if peer.extended == extended {
                peer.short = short;
            } else if peer.short == short {
                peer.short = ShortAddress::UNASSIGNED;
            }
        }
    }
}
