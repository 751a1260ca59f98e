//! Health of a node.

use serde::{Deserialize, Serialize};

use crate::steps::SensorError;

/// Health of a node: told to the coordinator, and by it to the PC. The default is a healthy node, of which
/// nothing is told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Health {
    /// Memory of its facts.
    pub memory: Memory,
    /// State of its camera.
    pub camera: Eye,
    /// Reason of its last start.
    pub restart: Restart,
    /// A target: fault of its step sensor. As long as there is one, people tell it the places where it stands.
    pub steps: Option<SensorError>,
}

/// Memory of a node's facts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Memory {
    /// In its flash.
    #[default]
    Flash,
    /// In its RAM alone: the flash is worn out or damaged. A restart makes it forget, and join anew.
    Ram,
}

/// State of a node's camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Eye {
    /// As far as is known, it does.
    #[default]
    Sees,
    /// It adapted to the light, and does not see the target where its pose says that it is in view.
    Blind,
    /// It does not start, or its picture does not change.
    Failed,
    /// The target was hidden in part when it was seen last, twice.
    Hidden,
    /// The target was not alone when it was seen last, twice: something else has its colour, or only a part of it has.
    Several,
}

impl Eye {
    /// Returns true if the camera does its work, whatever is before it.
    pub const fn works(self) -> bool {
        !matches!(self, Self::Blind | Self::Failed)
    }
}

/// Reason why a node started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Restart {
    /// It was switched on or reset, or the reason is not known.
    #[default]
    Ordinary,
    /// It had heard others, and then heard nothing any more though it sent.
    RadioDeaf,
    /// A transmission did not end.
    RadioStuck,
    /// The driver of its camera waited for ever.
    CameraStuck,
    /// Its program stopped, stood still or broke.
    Program,
}
