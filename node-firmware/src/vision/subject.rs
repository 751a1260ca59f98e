//! Subjects that a camera looks for.

use pixy_driver::Model;
use serde::{Deserialize, Serialize};

use super::BackgroundShare;

/// The levels of red, green and blue within which a pixel belongs to the target: each the lowest
/// and the highest, both inside, the lowest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ColourWindow {
    /// Lowest and highest level of red.
    pub red: [u8; 2],
    /// Lowest and highest level of green.
    pub green: [u8; 2],
    /// Lowest and highest level of blue.
    pub blue: [u8; 2],
}

impl ColourWindow {
    /// Returns true if each lowest level is not above its highest one.
    pub fn is_ordered(&self) -> bool {
        [self.red, self.green, self.blue]
            .iter()
            .all(|[lowest, highest]| lowest <= highest)
    }
}

/// A colour that was learnt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LearntColour {
    /// Its levels.
    pub window: ColourWindow,
    /// Share of the background that has it.
    pub background: BackgroundShare,
}

/// Subject that a camera looks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Subject {
    /// Pixels of a colour.
    Colour(ColourWindow),
    /// Blocks that differ from the background (frame differencing, thesis 2.5). Coarser than a colour:
    /// the CMUcam2 compares blocks of a sixteenth of the frame's width.
    Motion {
        /// Levels by which it must differ; 5 to 20 is usual.
        threshold: u8,
    },
    /// A signature that a camera was taught itself, as a Pixy2 is, of this number, 1 to 7.
    Signature(u8),
    /// The tag of this number.
    Tag(u8),
}

/// Kind of a node's camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CameraKind {
    /// Learns colours when it is told to, and finds motion.
    #[default]
    Cmucam2,
    /// Was taught its colours, by its button or in `PixyMon`.
    Pixy2,
    /// The original Pixy: the same, but it streams.
    Pixy,
    /// An OpenMV Cam with its script `pixy_uart_emulation.py`: the colours are in the script.
    #[serde(rename = "openmv")]
    OpenMv,
    /// An OpenMV Cam with its script `apriltags_pixy_uart_emulation.py`: targets wear tags, each that of its
    /// colour's number.
    #[serde(rename = "openmv-tags")]
    OpenMvTags,
}

impl From<Model> for CameraKind {
    fn from(model: Model) -> Self {
        match model {
            Model::Pixy2 => Self::Pixy2,
            Model::Pixy => Self::Pixy,
            Model::OpenMv => Self::OpenMv,
            Model::OpenMvTags => Self::OpenMvTags,
        }
    }
}

impl CameraKind {
    /// The model, of a camera of the Pixy family.
    pub const fn model(self) -> Option<Model> {
        match self {
            Self::Cmucam2 => None,
            Self::Pixy2 => Some(Model::Pixy2),
            Self::Pixy => Some(Model::Pixy),
            Self::OpenMv => Some(Model::OpenMv),
            Self::OpenMvTags => Some(Model::OpenMvTags),
        }
    }

    /// Number of rows that are as much as a column.
    pub const fn rows_per_column(self) -> f32 {
        match self {
            Self::Cmucam2 => super::cmucam2::ROWS_PER_COLUMN,
            Self::Pixy2 | Self::Pixy | Self::OpenMv | Self::OpenMvTags => 1.0,
        }
    }
}
