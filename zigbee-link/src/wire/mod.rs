//! Bytes of IEEE 802.15.4 and their meaning, both ways.
//!
//! [`Frame::parse`] checks every length and every reserved bit once and splits a frame into [`Header`], header
//! bytes and payload; [`Header::emit`] writes the same bytes again. A frame that a [`Header`] cannot express is
//! refused, so that parsing then emitting is the identity on every frame that parses. [`MacCommand`] and
//! [`Beacon`] do the same for the payloads of these types.
//!
//! Frames are without their FCS here; [`fcs`] is that of a frame.
//!
//! Supported: data, beacon and MAC command frames of versions 0 (2003) and 1 (2006), secured ones
//! of version 1 under a key with an index. Refused: acknowledgements, multipurpose, fragment and
//! extended frames, version 2 (2015) with its information elements, and other key identifier modes.

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
pub use aux_header::{AuxHeader, Level};
pub use beacon::{Beacon, Superframe};
pub use command::{Association, AssociationStatus, DeviceCapabilities, MacCommand};
pub(crate) use control::is_secured;
pub use control::{FrameType, FrameVersion};
pub(crate) use cursor::copy;
pub use cursor::{Reader, Writer};
pub use error::{EmitError, Malformed};
pub use fcs::{crc_16, fcs, has_good_fcs};
pub use header::{Frame, Header, Panned};
