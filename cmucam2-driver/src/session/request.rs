//! Requests to the camera, its answers, and faults.

use core::fmt;

use super::{Learn, StartUp};
use crate::{
    colour::ColourBounds,
    command::Order,
    packet::{FirmwareVersion, Packet},
    parser::ImageHeader,
};

/// Request to the camera. Not exhaustive, because a feature adds one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Request {
    /// Exchange one command. For a command that answers with packets, one is taken and the camera is stopped
    /// if it goes on.
    Do(Order),
    /// Begin a stream of packets or a frame, to be read with [`Request::Next`]. In poll mode
    /// nothing streams: each `Next` asks for a packet.
    Start(Order),
    /// The next packet of the stream; images between packets are skipped.
    Next,
    /// The next part of a frame or of the rows between packets, or the next packet. Rows go into
    /// the buffer given to [`Session::receive`](super::Session::receive), whose length is told here.
    NextPart {
        /// Bytes that the caller has room for.
        row: usize,
    },
    /// End the stream.
    Stop,
    /// Stop, reset, set all modes again. With the feature `full`.
    #[cfg(feature = "full")]
    Recover,
    /// See [`StartUp`].
    StartUp(StartUp),
    /// Learn a colour, and perhaps start to track it.
    Learn {
        /// Method of learning.
        how: Learn,
        /// True if a stream begins afterwards.
        track: bool,
    },
}

/// Answer of the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Answer {
    /// It carried the command out.
    Done,
    /// The numbers asked for; the rest is zero.
    Values([u8; 6]),
    /// Contents of the banner.
    Version(FirmwareVersion),
    /// The packet that was asked for: [`Session::packet_at`](super::Session::packet_at) tells its time.
    Packet(Packet),
    /// Nothing, and that is right: packet filter is on and nothing was tracked last.
    Quiet,
    /// The bounds that were learned.
    Bounds(ColourBounds),
    /// An image begins.
    Header(ImageHeader),
    /// A row is in the caller's buffer.
    Row {
        /// Number of its bytes.
        bytes: u16,
        /// True if it is complete and every byte is possible.
        intact: bool,
    },
    /// The image is over.
    End {
        /// Number of rows that came.
        rows: u16,
        /// True if all of it was as announced.
        intact: bool,
    },
}

/// Reason why there is no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Fault {
    /// Not one byte within the time: not powered, wrong pins, stuck after power-up.
    Silence,
    /// The camera said `NCK` each time.
    Refused {
        /// The letters of the command.
        command: [u8; 2],
    },
    /// Bytes came, but not one word of a camera: wrong baud rate, overrun, noise.
    Garbage,
    /// The camera restarted. Its modes are set again and its stream, if that is possible, runs again; its
    /// adaptation, and a reference frame, are lost.
    Restarted,
    /// There is no stream to read from.
    NotStreaming,
    /// The row buffer is too small.
    RowBuffer {
        /// Bytes of a row of this image.
        needed: u16,
    },
    /// More than [`REGISTERS_MAX`](super::REGISTERS_MAX) different registers: they could not be set again.
    TooManyRegisters,
    /// The camera can be understood, but it sent something else than was asked for, or not all of it:
    /// other numbers, or a packet of another kind than the running stream was begun for.
    Unexpected {
        /// The letters of the command.
        command: [u8; 2],
    },
    /// A field that is needed is masked (`OM`).
    Masked,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Silence => "the camera is silent: check power and wiring, or cycle its power",
            Self::Refused { command } => {
                let [first, second] = command.map(char::from);
                return write!(f, "the camera refused {first}{second} each time");
            }
            Self::Garbage => "the camera cannot be understood: check the baud rate",
            Self::Restarted => {
                "the camera restarted: its modes are restored, but it must adapt to the light again"
            }
            Self::NotStreaming => "no stream was started",
            Self::RowBuffer { needed } => {
                return write!(f, "the row buffer must hold {needed} bytes");
            }
            Self::TooManyRegisters => "too many different registers to set them again",
            Self::Unexpected { command } => {
                let [first, second] = command.map(char::from);
                return write!(
                    f,
                    "the camera does not answer {first}{second} with what was asked for"
                );
            }
            Self::Masked => "a field that is needed is masked",
        })
    }
}

impl core::error::Error for Fault {}
