//! Outcome of a command.

use core::fmt;

use serde::{Deserialize, Serialize};

use crate::vision::BackgroundShare;

/// Outcome of a command: carried out, or the reason why not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CommandOutcome {
    /// It was not, or the camera could not be reached.
    Failed,
    /// It was.
    Done,
    /// A colour was learnt, and so much of the background has it.
    Learnt(BackgroundShare),
    /// A colour was not learnt, because so much of the background has it.
    CommonColour(BackgroundShare),
    /// A colour was not learnt, because it does not show the whole object.
    PartOfObject,
}

impl CommandOutcome {
    /// An outcome without details.
    pub const fn of(success: bool) -> Self {
        if success { Self::Done } else { Self::Failed }
    }

    /// Returns true if it was carried out.
    pub const fn is_success(self) -> bool {
        matches!(self, Self::Done | Self::Learnt(_))
    }
}

impl fmt::Display for CommandOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Failed => f.write_str("failed"),
            Self::Done => f.write_str("done"),
            Self::Learnt(BackgroundShare::NONE) => {
                f.write_str("done: nothing in the background has this colour")
            }
            Self::Learnt(share) => write!(
                f,
                "done, but {share} of the background has this colour, and will be taken for the target \
                 where it is in view: better another light, another ball, or what has it away"
            ),
            Self::CommonColour(share) => write!(
                f,
                "refused: {share} of the background has this colour, so the target could not be told \
                 from it: another light, another ball, or what has it away; what was learnt before \
                 stays"
            ),
            Self::PartOfObject => f.write_str(
                "refused: this colour does not show the whole target: put it into the middle of the view so that \
                 it fills half of it, in an even light, and nothing of like colour next to it; what was learnt \
                 before stays",
            ),
        }
    }
}
