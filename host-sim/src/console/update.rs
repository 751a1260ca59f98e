//! An update by radio on a coordinator's line.

use std::time::Duration;

use node_firmware::{
    console::{FromPc, ToPc},
    message::UpdatePacket,
};
use radio_update::sender::{Sender, Transmit};
use zigbee_link::wire::ShortAddress;

/// Takes what the coordinator says of it.
pub fn hear(sender: &mut Sender, now: Duration, message: &ToPc) {
    match message {
        ToPc::Update { address, packet } => sender.on_packet(now, *address, packet.bytes()),
        ToPc::UpdateSent => sender.on_sent(now),
        _ => {}
    }
}

/// The next message to the coordinator, if one is due.
pub fn say(sender: &mut Sender, now: Duration) -> Option<FromPc> {
    let Transmit { to, packet } = sender.poll(now)?;
    let to = to.unwrap_or(ShortAddress::BROADCAST.0);
    let packet = UpdatePacket::new(&packet)?;
    Some(FromPc::Update { to, packet })
}
