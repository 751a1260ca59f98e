#![doc = include_str!("../README.md")]
//!
//! [`Emulator`] is the camera at the level of bytes: what the host sends goes in with its time,
//! what the camera sends comes out with the time at which its stop bit is over. It has no clock
//! and no thread; `host-sim camera` runs it in real time on a pseudo-terminal, tests and
//! simulated networks run it in virtual time. The same configuration, scene and input give the
//! same bytes.
//!
//! It reads commands and writes packets by itself, after the manual and the public programs, and shares no code
//! with a driver. The camera sees a [`Scene`], of which only those pixels are computed that a command needs. Each
//! point that public sources leave open is one of [`Switches`], and each fault one of [`FaultRates`].
//!
//! # Video
//! [`Background::Picture`] puts what another camera saw in the place of a drawn scene: set it before
//! each frame is due. The whole [`Picture`] fills the frame, so the field of view is the other
//! camera's; automatic gain and white balance, window and registers work on it as on a scene.
//!
//! # Light
//! [`Scene::light`] may be set at any time, to a [`daylight`] of some brightness and colour
//! temperature. A sensor that adapts follows it within seconds; with gain and white balance frozen it
//! sees other colours from then on, until it is told to adapt again.
//!
//! # Decided here, because no source tells
//! - Registers after a reset: 18 is 40 (no automatic white balance), 19 is 33 (automatic gain).
//!   Registers 5, 6 and 16 are 128, which leaves the picture as it is.
//! - `SP` after a reset is 16 8 5 16 8 5.
//! - A histogram bin is its share of the pixels in 1/256, doubled `scale` times.
//! - `HR` and `DS` set the virtual window back to the whole frame.
//! - A new `MD` replaces the mask of the one before; `LF` keeps it. A change of `HD` loses reference
//!   and mask.
//! - Bytes that come while the camera wakes or fills an upload are not commands. A line feed and a
//!   zero byte are ignored.
//! - A window makes the sensor at most eight times as fast.
//! - Raw input (`RM 4`): two letters, a count and so many bytes, as programs for it send it; a
//!   carriage return where a command could begin is one. A count above ten is refused at once.
//! - `LM 2 3` is accepted and changes nothing.
//! - `LM 2 2` sends a byte for each block, as a difference of levels does not fit a bit, which one program expects.
//! - `MD` sends no packet, which the same program awaits: its table says that it sets a mask.
//! - The bytes of `UD` may be in its line, as in that program, or come after it.
//! - A high-resolution frame shows the upper 255 of 286 rows.

mod blob;
mod colour;
mod command;
mod differencing;
mod emulator;
mod faults;
mod frame_dump;
mod framing;
mod lens;
mod light;
mod modes;
mod noise;
mod packet;
mod picture;
mod scene;
mod scene_file;
mod sensor;
mod settings;
mod statistics;
mod switches;
mod tracked;
mod view;
mod wire;

pub use colour::Colour;
pub use command::Command;
pub use emulator::{Configuration, Emulator, Note, Time};
pub use faults::FaultRates;
pub use lens::{Lens, Pose};
pub use light::{Light, daylight};
pub use packet::Packet;
pub use picture::{Picture, Plane};
pub use scene::{Background, Extent, Form, Object, Patch, Place, Rgb, Scene, Shape, Way};
pub use scene_file::SceneError;
pub use sensor::{Sensor, Size};
pub use settings::{Setting, SettingError};
pub use switches::Switches;
pub use view::Region;
pub use wire::BAUD_RATES;
