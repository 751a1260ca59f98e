//! Bytes of IEEE 802.15.4 and their meaning, both ways.
//!
//! [`Frame::parse`] checks every length and every reserved bit once and splits a frame into
//! [`Header`], header bytes and payload; [`Header::emit`] writes the same bytes again. What a
//! [`Header`] cannot express is refused, so that parsing then emitting is the identity on every
//! frame that parses. [`Command`] and [`Beacon`] do the same for the payloads of these types.
//!
//! Frames are without their FCS here; [`fcs`] is that of a frame.
//!
//! Supported: data, beacon, acknowledgement and MAC command frames of versions 0 (2003), 1 (2006)
//! and 2 (2015), with header information elements as opaque bytes. Not supported: multipurpose,
//! fragment and extended frames, and the 2003 form of security.

mod address;
mod aux_header;
mod beacon;
mod command;
mod control;
mod cursor;
mod error;
mod fcs;
mod header;

pub use address::{Address, Eui64, PanId, ShortAddress};
pub use aux_header::{AuxHeader, KeyId, Level};
pub use beacon::{Beacon, Superframe};
pub use command::{Association, AssociationStatus, Command, DeviceCapabilities};
pub(crate) use control::is_secured;
pub use control::{FrameType, Version};
pub(crate) use cursor::copy;
pub use cursor::{Reader, Writer};
pub use error::{EmitError, Malformed};
pub use fcs::{crc_16, fcs, has_good_fcs};
pub use header::{Frame, Header, Panned};
