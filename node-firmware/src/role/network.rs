//! The network that the addresses which a role remembers are of.

use zigbee_link::store::Membership;

use super::Unsaved;
use crate::facts::{Fact, FactKey, FormerNetwork};

/// The network of a device, as it is written down. `None`: it was in none.
#[derive(Clone, Debug, Default)]
pub(crate) struct LastNetwork(Option<FormerNetwork>);

impl LastNetwork {
    pub(crate) const fn new() -> Self {
        Self(None)
    }

    pub(crate) const fn restore(&mut self, network: FormerNetwork) {
        self.0 = Some(network);
    }

    /// The node joined, or goes on, as this: whether that is another network than the last one.
    /// Addresses are then those of others, and so is what was learnt of them.
    ///
    /// The coordinator alone does not tell: its board may have been provisioned anew, and have given
    /// addresses anew. Nor does the PAN identifier: a coordinator may change it. But then its members
    /// are attached all the time. Who was not, and finds another one, had better begin anew.
    pub(crate) fn on_attached(
        &mut self,
        was_attached: bool,
        membership: &Membership,
        unsaved: &mut Unsaved,
    ) -> bool {
        let network = FormerNetwork {
            pan: membership.pan.0,
            coordinator: membership.coordinator.0,
            own: membership.short.0,
        };
        let last = self.0.replace(network);
        if last != Some(network) {
            unsaved.insert(FactKey::Network);
        }
        last.is_some_and(|last| {
            let is_same = (last.coordinator, last.own) == (network.coordinator, network.own);
            !is_same || last.pan != network.pan && !was_attached
        })
    }

    pub(crate) fn fact(&self) -> Option<Fact> {
        self.0.map(Fact::Network)
    }
}
