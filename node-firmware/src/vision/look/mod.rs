//! One look at a standing target.

use core::fmt;

use calib_core::camera::Camera;

use super::{
    Blob, BlobCamera, Subject, VisionError,
    steady::{Glance, Shape, Steadiness, Unsteady},
};
use crate::message::Seen;

/// The most frames that are judged together.
pub const FRAMES_MAX: usize = 16;

/// Length of a look, and the floor of its sigma.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Patience {
    /// Frames in a row that must agree, 2 to [`FRAMES_MAX`].
    pub frames: u8,
    /// Frames after which the look is over in any case.
    pub frames_most: u8,
    /// Standard deviation of errors that no frame shows, columns, from 0.
    pub sigma_floor: f32,
}

impl Default for Patience {
    /// 5 frames agree, out of 20, and a twentieth of a column.
    fn default() -> Self {
        Self {
            frames: 5,
            frames_most: 20,
            sigma_floor: 0.05,
        }
    }
}

/// Result of a look.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Look {
    /// The target stands there.
    Steady(Seen),
    /// Nothing of the subject is in view.
    Nothing,
    /// It is cut off by the border.
    Clipped,
    /// It is partly hidden, or joined by something else.
    Lopsided,
    /// It may be several, or something else has its colour.
    Several,
    /// It moves, or comes and goes.
    Unsteady,
}

impl fmt::Display for Look {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Steady(seen) => write!(
                f,
                "seen at {:.2} +/- {:.2} deg",
                seen.bearing.to_degrees(),
                seen.sigma.to_degrees()
            ),
            Self::Nothing => f.write_str("the target is not in view"),
            Self::Clipped => f.write_str("the target is cut off by the border of the view"),
            Self::Lopsided => f.write_str("the target is partly hidden"),
            Self::Several => {
                f.write_str("the target is not alone, or only a part of it has its colour")
            }
            Self::Unsteady => f.write_str("the target moves or flickers"),
        }
    }
}

/// Judges the frames of one look.
#[derive(Clone, Debug)]
pub struct Judge {
    camera: Camera<f32>,
    patience: Patience,
    steadiness: Steadiness<FRAMES_MAX>,
    taken: u8,
}

impl Judge {
    /// A judge of the frames of this camera, for a target of this shape.
    pub fn new(camera: Camera<f32>, patience: Patience, shape: Shape) -> Self {
        // At most 65536 columns by construction, and the conversion saturates.
        let columns = (camera.last_column() + 1.0) as u16;
        Self {
            camera,
            patience,
            steadiness: Steadiness::new(usize::from(patience.frames), columns, shape),
            taken: 0,
        }
    }

    /// Begins a new look.
    pub fn clear(&mut self) {
        self.steadiness.clear();
        self.taken = 0;
    }

    /// The direction of an object in one frame, which may move, and true if its blob is wider than one
    /// object. `None` if it is cut off or partly hidden.
    pub fn glance(&self, blob: &Blob) -> Option<(Seen, bool)> {
        let Glance { steady, is_wide } = self.steadiness.glance(blob)?;
        let seen = steady.seen(&self.camera, self.patience.sigma_floor);
        Some((seen, is_wide))
    }

    /// Takes the blob of a frame. `Some` when the look is over: at the latest after
    /// [`Patience::frames_most`], or as many as must agree if those are more.
    ///
    /// A target that is not in view or cut off in every one of [`Patience::frames`] frames is
    /// given up at once: it stands, and that will not change.
    pub fn push(&mut self, blob: Option<Blob>) -> Option<Look> {
        self.taken = self.taken.saturating_add(1);
        let judged = self.steadiness.push(blob);
        let over = self.taken >= self.patience.frames_most || self.steadiness.is_unanimous();
        match judged {
            Ok(steady) => {
                let seen = steady.seen(&self.camera, self.patience.sigma_floor);
                Some(Look::Steady(seen))
            }
            Err(Unsteady::Few) => None,
            Err(_) if !over => None,
            Err(Unsteady::Lost { lost, frames }) if lost == frames => Some(Look::Nothing),
            Err(Unsteady::Clipped) => Some(Look::Clipped),
            Err(Unsteady::Lopsided { .. }) => Some(Look::Lopsided),
            Err(Unsteady::Wide { .. } | Unsteady::Sparse { .. }) => Some(Look::Several),
            Err(Unsteady::Lost { .. } | Unsteady::Moving { .. }) => Some(Look::Unsteady),
        }
    }
}

/// Looks once for a subject: begins, takes frames until `judge` is sure, ends.
///
/// # Errors
/// [`VisionError`] of the camera. One that [wants a start-up](VisionError::wants_start_up) takes 10 s or more
/// for that: a target that waits for the look is to hear of it before.
pub async fn look<C: BlobCamera>(
    camera: &mut C,
    subject: Subject,
    judge: &mut Judge,
) -> Result<Look, VisionError> {
    judge.clear();
    camera.begin(subject).await?;
    loop {
        if let Some(look) = judge.push(camera.next().await?) {
            camera.end().await?;
            return Ok(look);
        }
    }
}

#[cfg(test)]
mod tests;
