//! Counts of sent frames, and of reasons why frames were not received.

use std::ops::AddAssign;

use crate::executor::Time;

/// Reason why a frame did not arrive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Reason {
    /// The radio was on, on the right channel, and too far away. Counted for the sender.
    OutOfRange,
    /// The link loses a share of its frames.
    Loss,
    /// Another frame overlapped, or the receiver was occupied with one.
    Collision,
    /// The receiver was sending.
    HalfDuplex,
    /// The channel was busy, so that it was not sent. Counted for the sender.
    Busy,
    /// The address filter of the receiver.
    Filtered,
    /// No task received, and the radio has no queue; or the radio samples, and did not listen.
    NotListening,
    /// The queue of the receiver was full.
    QueueFull,
    /// It was sent with a wrong FCS.
    Corrupted,
    /// A jammer.
    Jammed,
    /// A partition of the network.
    Partitioned,
    /// The sender lost its power within the frame.
    CutOff,
}

impl Reason {
    /// All of them.
    pub const ALL: [Self; 12] = [
        Self::OutOfRange,
        Self::Loss,
        Self::Collision,
        Self::HalfDuplex,
        Self::Busy,
        Self::Filtered,
        Self::NotListening,
        Self::QueueFull,
        Self::Corrupted,
        Self::Jammed,
        Self::Partitioned,
        Self::CutOff,
    ];

    /// In words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::OutOfRange => "out of range",
            Self::Loss => "loss",
            Self::Collision => "collision",
            Self::HalfDuplex => "half duplex",
            Self::Busy => "channel busy",
            Self::Filtered => "filtered",
            Self::NotListening => "not listening",
            Self::QueueFull => "queue full",
            Self::Corrupted => "corrupted",
            Self::Jammed => "jammed",
            Self::Partitioned => "partitioned",
            Self::CutOff => "cut off",
        }
    }
}

/// Counts of a radio, or of all together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames sent.
    pub frames: u64,
    /// Their bytes, FCS included, without the PHY header.
    pub bytes: u64,
    /// Time for which it sent, with the PHY header.
    pub airtime: Time,
    /// Frames that arrived.
    pub received: u64,
    dropped: [u64; Reason::ALL.len()],
}

impl Counters {
    /// Frames that did not arrive for this reason.
    pub fn dropped(&self, reason: Reason) -> u64 {
        self.dropped[reason as usize]
    }

    pub(super) fn drop(&mut self, reason: Reason, frames: u64) {
        self.dropped[reason as usize] += frames;
    }
}

impl AddAssign for Counters {
    fn add_assign(&mut self, other: Self) {
        self.frames += other.frames;
        self.bytes += other.bytes;
        self.airtime += other.airtime;
        self.received += other.received;
        for (sum, count) in self.dropped.iter_mut().zip(other.dropped) {
            *sum += count;
        }
    }
}
