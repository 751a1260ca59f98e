//! Messages between the coordinator and the PC on its serial line.
//!
//! Each message is postcard with its CRC-32 (that of zip, little-endian) behind it, COBS-framed, and ends
//! with a zero byte. A frame that does not decode is skipped. Without the checksum, most flipped bits of a
//! key would give the site another key, which no node has. Numbers of variants are the format: variants are
//! only added, at the end.

use flash_log::Crc32;
use serde::{Deserialize, Serialize};

use crate::{
    config::SiteKey,
    message::{
        CameraCommand, CommandResult, Health, Hello, ListedSighting, MemberAddress, References,
        Report, SitePlace, StopNumber, TargetLocation, Tracked, UpdatePacket,
    },
};

/// Bytes of the longest frame, its end included.
pub const FRAME_MAX: usize = 128;

/// From the coordinator to the PC.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ToPc {
    /// The network runs; or `None`: the coordinator looks for a free one.
    Network(Option<NetworkInfo>),
    /// A member of the network, when it says hello.
    Member {
        /// Its address in this network.
        address: MemberAddress,
        /// Its own description.
        hello: Hello,
    },
    /// Status of a camera.
    Report {
        /// The camera's address.
        address: MemberAddress,
        /// Its report.
        report: Report,
    },
    /// Result of a command.
    Done {
        /// The camera's address.
        address: MemberAddress,
        /// The result; `success` is also false when the camera could not be reached.
        done: CommandResult,
    },
    /// Present look of a camera that tracks.
    Tracked {
        /// The camera's address.
        address: MemberAddress,
        /// The blob, and its direction.
        tracked: Tracked,
    },
    /// A sighting that a camera has.
    Sighting {
        /// The camera's address.
        address: MemberAddress,
        /// With its number, and the number of all.
        sighting: ListedSighting,
    },
    /// A member was sent away.
    Removed {
        /// The one that it had.
        address: MemberAddress,
        /// It was a member.
        success: bool,
    },
    /// Progress of the last change of the site key; `None`: none was begun since the coordinator started, or
    /// the asked one is impossible. Told when one is asked for, and with all else.
    KeyChange(Option<KeyChangeReport>),
    /// About the identifier of the PAN. Told when a change is asked for, and, once another network with
    /// the same one was heard, with all else.
    Pan {
        /// Seconds since a beacon of another network had the same one. Beacons can be forged.
        conflict_s: Option<u32>,
        /// It changes now.
        changes: bool,
    },
    /// Health of a member, or of the coordinator itself: told when it changes, and with all else.
    Health {
        /// Its address; the coordinator's is 0.
        address: MemberAddress,
        /// Its health as it told it.
        health: Health,
    },
    /// A reference camera is not there, or is there again. Without it no camera gets a pose. Told of the
    /// references before the first pose.
    Reference {
        /// Its address.
        address: MemberAddress,
        /// It answers.
        present: bool,
    },
    /// A target stands, or knows its place better. Told again when a stop of another target was told in
    /// between.
    Stopped {
        /// Its address.
        address: MemberAddress,
        /// Number of the stop.
        stop: StopNumber,
        /// Its own estimate of its place; `None`: it does not know.
        place: Option<SitePlace>,
    },
    /// Place of an object that cameras that track see. Told ten times a second in all.
    Object {
        /// Its number, which the next object does not get.
        id: u16,
        /// `None`: no camera sees it any more.
        object: Option<TrackedObject>,
    },
    /// A node's answer in an update by radio.
    Update {
        /// Its address; the coordinator's is 0.
        address: MemberAddress,
        /// Its answer.
        packet: UpdatePacket,
    },
    /// A packet of an update was sent, or could not be. Told once of each.
    UpdateSent,
    /// The cameras that were elected as references; `None`: there are none any more. Told when they change, and with all else
    /// where there are some.
    References(Option<References>),
}

/// Place of an object.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TrackedObject {
    /// Now.
    pub place: SitePlace,
    /// Its velocity, units per second.
    pub velocity: [f32; 2],
    /// Time since a camera saw it, milliseconds.
    pub unseen_ms: u16,
}

impl TrackedObject {
    /// Returns true if all numbers are finite. A line may bring anything.
    pub fn is_usable(&self) -> bool {
        let (place, covariance) = (&self.place.0, &self.place.1);
        let all = place.iter().chain(covariance).chain(&self.velocity);
        all.copied().all(f32::is_finite)
    }
}

/// A change of the site key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct KeyChangeReport {
    /// The index of the new key.
    pub index: u8,
    /// Its [check value](zigbee_link::security::Key::check_value).
    pub check: [u8; 3],
    /// It was offered to every member, and is in use.
    pub done: bool,
    /// Members that have not confirmed yet that they have it. They get it when they are heard again, unless a
    /// member is sent away or the key changes once more before.
    pub unreached: u8,
}

/// The network of a coordinator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NetworkInfo {
    /// Its PAN identifier.
    pub pan: u16,
    /// Its channel, 11 to 26.
    pub channel: u8,
}

/// From the PC to the coordinator.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum FromPc {
    /// Tell network, members and reports again.
    Refresh,
    /// Let new devices join for so many seconds.
    JoinWindow(u16),
    /// Have a camera do something.
    Command {
        /// The camera's address.
        address: MemberAddress,
        /// The command.
        command: CameraCommand,
    },
    /// Ask a camera for its sightings.
    Sightings(MemberAddress),
    /// Send a member away, for good if it is gone: its place is free then. If it is on the
    /// allow-list, or while a join window is open, it may come back.
    Remove(MemberAddress),
    /// Give all members another site key, with another index. A node that has only the present one is shut
    /// out then. The PC draws the key, at random, and keeps it: new members are provisioned with it.
    ChangeKey(SiteKey),
    /// Take another PAN identifier, and tell all members.
    ChangePan,
    /// A target whose step sensor fails stands here. It tells that as a stop, whatever the number here.
    Located {
        /// The target's address.
        address: MemberAddress,
        /// Its place.
        located: TargetLocation,
    },
    /// Hand on a packet of an update by radio: to a member, to all, or to the coordinator itself, whose address is 0.
    Update {
        /// Address of the receiver.
        to: MemberAddress,
        /// The packet.
        packet: UpdatePacket,
    },
}

/// Writes a message as a frame; `None` never happens: every message fits.
pub fn encode<'a>(message: &impl Serialize, buffer: &'a mut [u8; FRAME_MAX]) -> Option<&'a [u8]> {
    // In two steps: so the code that encodes messages for the radio serves here too.
    let mut bytes = [0; FRAME_MAX - 2];
    let message = postcard::to_slice(message, &mut bytes);
    debug_assert!(message.is_ok(), "a message is longer than a frame");
    let length = message.ok()?.len();
    let checksum = Crc32::of(bytes.get(..length)?).to_le_bytes();
    let rest = bytes.get_mut(length..)?.first_chunk_mut()?;
    *rest = checksum;
    let bytes = bytes.get(..length + checksum.len())?;
    let length = cobs::try_encode(bytes, buffer).ok()?;
    *buffer.get_mut(length)? = 0;
    buffer.get(..=length)
}

fn decode<T: for<'de> Deserialize<'de>>(frame: &mut [u8]) -> Option<T> {
    let length = cobs::decode_in_place(frame).ok()?;
    let (bytes, checksum) = frame.get(..length)?.split_last_chunk()?;
    let is_whole = Crc32::of(bytes) == u32::from_le_bytes(*checksum);
    match postcard::take_from_bytes(bytes) {
        Ok((message, [])) if is_whole => Some(message),
        _ => None,
    }
}

/// Collects bytes of a line to frames.
#[derive(Clone, Debug, Default)]
pub struct Frames {
    bytes: heapless::Vec<u8, FRAME_MAX>,
    too_long: bool,
}

impl Frames {
    /// Takes a byte. Returns a message when it was its last one.
    pub fn push<T: for<'de> Deserialize<'de>>(&mut self, byte: u8) -> Option<T> {
        if self.bytes.push(byte).is_err() {
            self.too_long = true;
            self.bytes.clear();
        }
        if byte != 0 {
            return None;
        }
        let frame = &mut self.bytes;
        let message = if self.too_long { None } else { decode(frame) };
        self.bytes.clear();
        self.too_long = false;
        message
    }
}
