//! The network that the addresses which a role remembers are of.

use zigbee_link::store::Membership;

use crate::memory::{Fact, Network};

/// The network of a device, as it is written down.
#[derive(Clone, Debug)]
pub(crate) struct Home {
    known: Option<Network>,
    unsaved: bool,
}

impl Home {
    pub(crate) const fn new() -> Self {
        Self {
            known: None,
            unsaved: false,
        }
    }

    pub(crate) const fn remember(&mut self, network: Network) {
        self.known = Some(network);
    }

    /// The node joined, or goes on, as this: whether that is another network than the one it knows.
    /// Addresses are then those of others, and so is what was learnt of them.
    ///
    /// The coordinator alone does not tell: its board may have been provisioned anew, and have given
    /// addresses anew. Nor does the PAN identifier: a coordinator may change it. But then its members
    /// are attached all the time. Who was not, and finds another one, had better begin anew.
    pub(crate) fn enter(&mut self, was_attached: bool, membership: &Membership) -> bool {
        let network = Network {
            pan: membership.pan.0,
            coordinator: membership.coordinator.0,
            own: membership.short.0,
        };
        let known = self.known.replace(network);
        self.unsaved |= known != Some(network);
        known.is_some_and(|known| {
            let is_same = (known.coordinator, known.own) == (network.coordinator, network.own);
            !is_same || known.pan != network.pan && !was_attached
        })
    }

    /// To be asked when all else is written down: where the power fails while a former network is
    /// forgotten, it is forgotten again.
    pub(crate) fn unsaved(&mut self) -> Option<Fact> {
        core::mem::take(&mut self.unsaved).then_some(Fact::Network(self.known?))
    }
}
