//! Observers of the air: events, captures, and a hash over all that happened.

use std::io::{self, Write};

use zigbee_link::{
    Instant,
    radio::{Channel, pcap_header, pcap_record},
};

use super::{NodeId, Reason};
use crate::{executor::Time, random::mix};

/// Something that happened on the air.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event<'a> {
    /// A frame begins.
    Sent {
        /// Its sender.
        from: NodeId,
        /// Its channel.
        channel: Channel,
        /// Its bytes, without FCS.
        frame: &'a [u8],
    },
    /// A frame has arrived.
    Received {
        /// Its sender.
        from: NodeId,
        /// Its receiver.
        by: NodeId,
    },
    /// A frame has not arrived. [`Reason::OutOfRange`] is only counted.
    Dropped {
        /// Its sender.
        from: NodeId,
        /// The receiver; the sender itself if it was not sent.
        by: NodeId,
        /// Reason.
        reason: Reason,
    },
}

/// Is told of each event. It must not use the medium.
pub trait Watcher {
    /// Something happens now.
    fn event(&mut self, at: Time, event: Event<'_>);
}

impl<F: FnMut(Time, Event<'_>)> Watcher for F {
    fn event(&mut self, at: Time, event: Event<'_>) {
        self(at, event);
    }
}

/// Writes all frames to a pcap file (link type 283, IEEE 802.15.4 TAP).
pub struct Capture<W>(W);

impl<W: Write> Capture<W> {
    /// Writes the header.
    ///
    /// # Errors
    /// The writer's.
    pub fn new(mut file: W) -> io::Result<Self> {
        file.write_all(&pcap_header())?;
        Ok(Self(file))
    }
}

impl<W: Write> Watcher for Capture<W> {
    fn event(&mut self, at: Time, event: Event<'_>) {
        if let Event::Sent { channel, frame, .. } = event
            && let Some(record) = pcap_record(Instant(at / 1000), channel, None, frame)
        {
            // A full disk spoils the capture, not the run. The owner of the file learns of it.
            let _ = self.0.write_all(&record);
        }
    }
}

/// A hash over all events: two runs with the same one went the same way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Digest(u64);

impl Digest {
    /// So far.
    pub fn value(self) -> u64 {
        self.0
    }

    fn add(&mut self, value: u64) {
        self.0 = mix(self.0 ^ value);
    }
}

impl Watcher for Digest {
    fn event(&mut self, at: Time, event: Event<'_>) {
        self.add(at);
        match event {
            Event::Sent {
                from,
                channel,
                frame,
            } => {
                self.add(u64::from(from.0) << 8 | u64::from(channel.number()));
                frame.iter().for_each(|&byte| self.add(byte.into()));
            }
            Event::Received { from, by } => {
                self.add(1 << 63 | u64::from(from.0) << 31 | u64::from(by.0));
            }
            Event::Dropped { from, by, reason } => {
                self.add(1 << 62 | u64::from(from.0) << 31 | u64::from(by.0));
                self.add(reason as u64);
            }
        }
    }
}
