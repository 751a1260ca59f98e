//! Content of a secured data frame.
//!
//! | byte 0 | then |
//! |---|---|
//! | `1` unicast message | age, message |
//! | `2` broadcast message | age, message |
//! | `3` control message | age, control |
//! | `4` acknowledgement | counter of the acknowledged frame, u32 |
//! | `5` challenge | |
//! | `6` response | flags, own short address u16, counter of the challenge u32 |
//! | `7` presence | |
//! | `8` unicast message that is not acknowledged | age, message |
//!
//! The high half of byte 0 is the [`VERSION`], the low half the kind. Numbers are little-endian.
//! The *age* of a message is the number of frame counters since it was sent for the first time, so that the
//! frame's counter minus its age numbers the message: no two messages of a node ever have the same number,
//! restarts included.

use crate::{
    security::Key,
    wire::{EmitError, Malformed, Reader, ShortAddress, Writer},
};

/// Version of everything inside a secured data frame.
pub const VERSION: u8 = 1;

/// Way in which a message is delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(super) enum Kind {
    Unicast,
    /// To one member, sent once and not acknowledged.
    Once,
    Broadcast,
    Control,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packet<'a> {
    Message {
        kind: Kind,
        age: u8,
        bytes: &'a [u8],
    },
    Acknowledgement {
        counter: u32,
    },
    Challenge,
    /// To all: the sender is still there.
    Presence,
    Response {
        /// The sender does not know the receiver either: this frame is a challenge too.
        challenges: bool,
        short: ShortAddress,
        counter: u32,
    },
}

const UNICAST: u8 = 1;
const BROADCAST: u8 = 2;
const CONTROL: u8 = 3;
const ACKNOWLEDGEMENT: u8 = 4;
const CHALLENGE: u8 = 5;
const RESPONSE: u8 = 6;
const PRESENCE: u8 = 7;
const ONCE: u8 = 8;

/// Bytes of a [`Packet::Message`] before the message.
pub(super) const MESSAGE_HEADER: usize = 2;

impl<'a> Packet<'a> {
    /// Another version or an unknown kind is [`Malformed::Unsupported`].
    pub(super) fn parse(payload: &'a [u8]) -> Result<Self, Malformed> {
        let mut reader = Reader::new(payload);
        let first = reader.u8()?;
        if first >> 4 != VERSION {
            return Err(Malformed::Unsupported);
        }
        let packet = match first & 0xF {
            UNICAST => return message(Kind::Unicast, reader),
            ONCE => return message(Kind::Once, reader),
            BROADCAST => return message(Kind::Broadcast, reader),
            CONTROL => return message(Kind::Control, reader),
            ACKNOWLEDGEMENT => Self::Acknowledgement {
                counter: reader.u32()?,
            },
            CHALLENGE => Self::Challenge,
            PRESENCE => Self::Presence,
            RESPONSE => Self::Response {
                challenges: match reader.u8()? {
                    0 => false,
                    1 => true,
                    _ => return Err(Malformed::Reserved),
                },
                short: ShortAddress(reader.u16()?),
                counter: reader.u32()?,
            },
            _ => return Err(Malformed::Unsupported),
        };
        reader.end()?;
        Ok(packet)
    }

    pub(super) fn emit(&self, buffer: &mut [u8]) -> Result<usize, EmitError> {
        let mut writer = Writer::new(buffer);
        let mut first = |kind| writer.u8(VERSION << 4 | kind);
        match *self {
            Self::Message { kind, age, bytes } => {
                first(match kind {
                    Kind::Unicast => UNICAST,
                    Kind::Once => ONCE,
                    Kind::Broadcast => BROADCAST,
                    Kind::Control => CONTROL,
                })?;
                writer.u8(age)?;
                writer.bytes(bytes)?;
            }
            Self::Acknowledgement { counter } => {
                first(ACKNOWLEDGEMENT)?;
                writer.u32(counter)?;
            }
            Self::Challenge => first(CHALLENGE)?,
            Self::Presence => first(PRESENCE)?,
            Self::Response {
                challenges,
                short,
                counter,
            } => {
                first(RESPONSE)?;
                writer.u8(u8::from(challenges))?;
                writer.u16(short.0)?;
                writer.u32(counter)?;
            }
        }
        Ok(writer.len())
    }
}

fn message(kind: Kind, mut reader: Reader<'_>) -> Result<Packet<'_>, Malformed> {
    let age = reader.u8()?;
    let bytes = reader.rest();
    Ok(Packet::Message { kind, age, bytes })
}

/// A control message: `0`, index, 16 bytes hand on the next key.
pub(super) const NEXT_KEY_LEN: usize = 18;

pub(super) fn emit_next_key(key: &Key) -> [u8; NEXT_KEY_LEN] {
    let mut bytes = [0; NEXT_KEY_LEN];
    let content = [0, key.index()].into_iter().chain(*key.secret());
    for (place, byte) in bytes.iter_mut().zip(content) {
        *place = byte;
    }
    bytes
}

pub(super) fn parse_next_key(control: &[u8]) -> Result<Key, Malformed> {
    let mut reader = Reader::new(control);
    if reader.u8()? != 0 {
        return Err(Malformed::Unsupported);
    }
    let key = Key::new(reader.u8()?, reader.array()?).ok_or(Malformed::Reserved)?;
    reader.end()?;
    Ok(key)
}

#[cfg(test)]
mod tests {
    use proptest::{collection::vec, prelude::*};

    use super::*;

    #[test]
    fn golden() {
        let golden: [(&[u8], Packet<'_>); 8] = [
            (
                &[0x18, 0, 0xAA],
                Packet::Message {
                    kind: Kind::Once,
                    age: 0,
                    bytes: &[0xAA],
                },
            ),
            (
                &[0x11, 2, 0xAA, 0xBB],
                Packet::Message {
                    kind: Kind::Unicast,
                    age: 2,
                    bytes: &[0xAA, 0xBB],
                },
            ),
            (
                &[0x12, 0],
                Packet::Message {
                    kind: Kind::Broadcast,
                    age: 0,
                    bytes: &[],
                },
            ),
            (
                &[0x13, 1, 0],
                Packet::Message {
                    kind: Kind::Control,
                    age: 1,
                    bytes: &[0],
                },
            ),
            (
                &[0x14, 4, 3, 2, 1],
                Packet::Acknowledgement {
                    counter: 0x0102_0304,
                },
            ),
            (&[0x15], Packet::Challenge),
            (&[0x17], Packet::Presence),
            (
                &[0x16, 1, 0x42, 0, 4, 3, 2, 1],
                Packet::Response {
                    challenges: true,
                    short: ShortAddress(0x42),
                    counter: 0x0102_0304,
                },
            ),
        ];
        for (bytes, packet) in golden {
            assert_eq!(Packet::parse(bytes), Ok(packet));
            let mut buffer = [0; 16];
            let len = packet.emit(&mut buffer).unwrap();
            assert_eq!(&buffer[..len], bytes);
        }
        for unknown in [0x10, 0x19, 0x1F, 0x01, 0x21, 0x25] {
            assert_eq!(Packet::parse(&[unknown, 0]), Err(Malformed::Unsupported));
        }
        assert_eq!(Packet::parse(&[0x15, 0]), Err(Malformed::TrailingBytes));
        assert_eq!(Packet::parse(&[]), Err(Malformed::Truncated));
    }

    #[test]
    fn next_key() {
        let key = Key::new(3, core::array::from_fn(|i| i as u8)).unwrap();
        let bytes = emit_next_key(&key);
        assert_eq!(bytes[..4], [0, 3, 0, 1]);
        assert_eq!(parse_next_key(&bytes), Ok(key));
        assert_eq!(parse_next_key(&bytes[..17]), Err(Malformed::Truncated));
        assert_eq!(parse_next_key(&[0; 18]), Err(Malformed::Reserved));
    }

    proptest! {
        #[test]
        fn parse_then_emit_is_the_identity(bytes in vec(any::<u8>(), 0..20), first in 0x10..0x1A_u8) {
            let bytes = [&[first][..], &bytes].concat();
            if let Ok(packet) = Packet::parse(&bytes) {
                let mut buffer = [0; 32];
                let len = packet.emit(&mut buffer).unwrap();
                prop_assert_eq!(&buffer[..len], &bytes);
            }
        }
    }
}
