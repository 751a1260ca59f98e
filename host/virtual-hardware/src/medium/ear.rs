//! The end of the medium where a radio is elsewhere.

use zigbee_link::radio::Channel;

use super::{NodeId, Reason};

/// A frame that begins to arrive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival<'a> {
    /// Its sender.
    pub from: NodeId,
    /// Its channel.
    pub channel: Channel,
    /// With its FCS.
    pub psdu: &'a [u8],
    /// Strength with which it is received, dBm.
    pub strength: f32,
    /// Reason why it is not received, even if nothing else is on the air: it is only a carrier then.
    pub lost: Option<Reason>,
    /// It stands out from all that is on the air at this radio when it begins.
    pub stands_out: bool,
    /// Senders whose frames do not stand out there any more, now that it begins.
    pub spoils: &'a [NodeId],
}

/// Is told of each frame that begins to arrive at a node. It must not use the medium.
pub trait Ear {
    /// A frame begins now.
    fn hear(&mut self, arrival: Arrival<'_>);
}

impl<F: FnMut(Arrival<'_>)> Ear for F {
    fn hear(&mut self, arrival: Arrival<'_>) {
        self(arrival);
    }
}
