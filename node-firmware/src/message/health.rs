//! What is the matter with a node itself.

use serde::{Deserialize, Serialize};

/// How a node is: told to the coordinator, and by it to the PC. The default is a node that is well, of
/// which nothing is told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Health {
    /// Where it remembers things.
    pub memory: Memory,
    /// Whether its camera serves.
    pub camera: Eye,
    /// Why it started last.
    pub restart: Restart,
}

/// Where a node remembers things.
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

/// Whether a camera serves.
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
}

/// Why a node started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Restart {
    /// It was switched on or reset by somebody, or nobody knows.
    #[default]
    Ordinary,
    /// It had heard others, and heard nothing any more though it sent.
    RadioDeaf,
    /// A transmission did not end.
    RadioStuck,
    /// The driver of its camera waited for ever.
    CameraStuck,
    /// Its program stopped, stood still or broke.
    Program,
}
