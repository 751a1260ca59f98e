//! The network that the addresses which a role remembers are of.

use super::Unsaved;
use crate::{
    facts::{Fact, FactKey},
    network::Attachment,
};

/// The network of a device, as it is written down. `None`: it was in none.
#[derive(Clone, Debug, Default)]
pub(crate) struct LastNetwork(Option<Attachment>);

impl LastNetwork {
    pub(crate) const fn new() -> Self {
        Self(None)
    }

    pub(crate) const fn restore(&mut self, network: Attachment) {
        self.0 = Some(network);
    }

    /// The node joined, or goes on, as this: returns true if that is another network than the last one.
    /// Addresses are then those of others, and so are the facts about them.
    ///
    /// The founder alone does not tell: its board may have been provisioned anew, and have given addresses
    /// anew. Nor does the number: a founder may change it. But then its members are attached all the time. A
    /// node that was not, and finds another number, had better begin anew.
    pub(crate) fn on_attached(
        &mut self,
        was_attached: bool,
        network: Attachment,
        unsaved: &mut Unsaved,
    ) -> bool {
        let last = self.0.replace(network);
        if last != Some(network) {
            unsaved.insert(FactKey::Network);
        }
        last.is_some_and(|last| {
            let of = |joined: Attachment| (joined.network.founder, joined.own);
            of(last) != of(network)
                || last.network.number != network.network.number && !was_attached
        })
    }

    pub(crate) fn fact(&self) -> Option<Fact> {
        self.0.map(Fact::Network)
    }
}
