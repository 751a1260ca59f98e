//! Reasons why a camera gives nothing.

use core::fmt;

use embedded_io::ErrorKind;

use super::BackgroundShare;

/// Reason why a camera cannot carry out a request. The texts say what to do about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum VisionError {
    /// The line to the camera failed.
    Line(ErrorKind),
    /// The line to the camera has come to its end.
    Closed,
    /// The camera does not answer.
    Silent,
    /// The camera's bytes make no sense.
    Garbled,
    /// The camera refuses a command.
    Refused,
    /// The camera restarted: gain and white balance are no longer those of the learnt colour, and
    /// the background is lost.
    Restarted,
    /// The lens has another number of columns than the camera.
    Columns {
        /// Columns of the camera.
        camera: u16,
        /// Columns of the lens.
        lens: u16,
    },
    /// A colour whose lowest level is above its highest one.
    Colour,
    /// Too much of the background has the colour that was to be learnt.
    CommonColour(BackgroundShare),
    /// The colour that was to be learnt does not show the whole object.
    PartOfObject,
    /// The camera was not started up since it was switched on or reset.
    NotStarted,
    /// Nothing was begun.
    NotBegun,
    /// No background was learnt, or it was lost.
    NoBackground,
    /// This kind of camera cannot do that.
    Unable,
    /// The camera runs another program.
    Busy,
}

impl VisionError {
    /// Returns true if bytes of the line were lost, and the next ones are whole again.
    pub const fn is_passing(self) -> bool {
        matches!(self, Self::Line(ErrorKind::Interrupted))
    }

    /// Returns true if [`BlobCamera::start_up`](super::BlobCamera::start_up) may cure it.
    pub const fn wants_start_up(self) -> bool {
        matches!(
            self,
            Self::Silent | Self::Garbled | Self::Restarted | Self::NotStarted
        )
    }
}

impl fmt::Display for VisionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Line(kind) => return write!(f, "the line to the camera failed ({kind}): retry"),
            Self::Closed => "the line to the camera is closed: open it again",
            Self::Silent => "the camera is silent: check its power and wiring, or cycle its power",
            Self::Garbled => "the camera cannot be understood: check the baud rate",
            Self::Refused => "the camera refuses a command each time: start it up again",
            Self::Restarted => "the camera restarted: start it up again, check its power supply",
            Self::Columns { camera, lens } => {
                return write!(
                    f,
                    "the camera has {camera} columns, its configured lens {lens}: correct the lens"
                );
            }
            Self::Colour => "the lowest level of a colour is above its highest one: learn it anew",
            Self::CommonColour(share) => {
                return write!(
                    f,
                    "{share} of the background has the object's colour: take that away, or another object"
                );
            }
            Self::PartOfObject => {
                "the learnt colour does not show the whole object: put it into the middle of the view so that it \
                 fills half of it, in an even light, and nothing of like colour next to it"
            }
            Self::NotStarted => "the camera is not set up: start it up first",
            Self::NotBegun => "nothing is looked for: begin first",
            Self::NoBackground => {
                "no background is known: learn it while the target is out of view"
            }
            Self::Unable => {
                "this kind of camera cannot do that: a Pixy is taught colours by its button or in PixyMon, an \
                 OpenMV by its script, and they find nothing that moves"
            }
            Self::Busy => {
                "the camera is busy all the time: let it run color_connected_components, and let no program \
                 hold its button"
            }
        })
    }
}

impl core::error::Error for VisionError {}
