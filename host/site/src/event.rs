//! Faults and other events by order of a script.

use std::collections::BTreeMap;

use node_firmware::hardware::Button;
use serde::{Deserialize, Serialize};

/// Something that happens at a time: `[[event]]`, `at_s = 60.0`,
/// `action = { restart = { node = 5 } }`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScriptedEvent {
    /// When, seconds since the start.
    pub at_s: f64,
    /// Kind of event.
    pub action: Action,
}

/// Kind of event, with its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Action {
    /// A node restarts; the content of its flash stays.
    Restart {
        /// Its number.
        node: u16,
    },
    /// A node and its camera lose their power.
    PowerCut {
        /// Its number.
        node: u16,
        /// For how long, seconds.
        for_s: f64,
        /// Not before the node next writes its flash, in the middle of that. Default false.
        #[serde(default)]
        in_flash_write: bool,
    },
    /// A carrier covers a channel.
    Jam {
        /// For how long, seconds.
        for_s: f64,
        /// Its channel, 11 to 26. Default: all.
        #[serde(default)]
        channel: Option<u8>,
        /// Where it is. Default: everywhere.
        #[serde(default)]
        at: Option<[f64; 2]>,
        /// Distance that it reaches from there.
        #[serde(default)]
        reach: Option<f64>,
    },
    /// These nodes and all others do not hear one another.
    Partition {
        /// Their numbers.
        nodes: Vec<u16>,
        /// For how long, seconds.
        for_s: f64,
    },
    /// All links lose more frames.
    Loss {
        /// Share of the frames, 0 to 1.
        share: f64,
        /// For how long, seconds.
        for_s: f64,
    },
    /// A user pulls the plug between a node and its camera.
    UnplugCamera {
        /// The node's number.
        node: u16,
        /// For how long, seconds.
        for_s: f64,
        /// The camera's power goes with it. Default true.
        #[serde(default = "yes")]
        with_power: bool,
    },
    /// A camera goes on reporting what it saw at that time.
    StickCamera {
        /// The node's number.
        node: u16,
        /// For how long, seconds.
        for_s: f64,
    },
    /// The light is another one from then on, before all cameras.
    Daylight {
        /// Brightness, against that at the start.
        level: f64,
        /// Its colour temperature, kelvin.
        kelvin: f64,
    },
    /// A camera or its line has other faults for a while, in place of those that it always has.
    CameraFaults {
        /// The node's number.
        node: u16,
        /// For how long, seconds.
        for_s: f64,
        /// Rate of each fault, by name.
        faults: BTreeMap<String, f64>,
    },
    /// A user moves a camera, turns it, or both. It stays so.
    BumpCamera {
        /// The node's number.
        node: u16,
        /// Displacement. Default: none.
        #[serde(default)]
        by: [f64; 2],
        /// Angle by which it is turned, degrees counter-clockwise. Default 0.
        #[serde(default)]
        turn_deg: f64,
    },
    /// A target slips: its steps are longer or shorter than its sensor says, and lead elsewhere.
    Slip {
        /// The node's number.
        node: u16,
        /// For how long, seconds.
        for_s: f64,
        /// Excess of each distance that the sensor reads, as a share of it. Default 0.
        #[serde(default)]
        distance: f64,
        /// Excess of each heading that it reads, degrees. Default 0.
        #[serde(default)]
        heading_deg: f64,
    },
    /// A target's carrier rests: it stays at the stop where it stands, or where it comes to stand next,
    /// whatever the lamp shows. Its patience begins anew after that.
    Rest {
        /// The node's number.
        node: u16,
        /// For how long, seconds.
        for_s: f64,
    },
    /// A target's carrier does not heed the lamp, and walks on from each stop after a while.
    IgnoreLamp {
        /// The node's number.
        node: u16,
        /// For how long, seconds.
        for_s: f64,
        /// Time that it stands at a stop, seconds. Default 1.
        #[serde(default = "one_second")]
        stand_s: f64,
    },
    /// A user presses a button of a node for a moment. One without power does not notice.
    PressButton {
        /// The node's number.
        node: u16,
        /// Button that is pressed.
        button: Button,
    },
    /// Bits of a node's flash flip, each as likely as another.
    Rot {
        /// The node's number.
        node: u16,
        /// Number of bits.
        bits: u32,
    },
    /// A node's flash is worn: whatever is written to it or erased fails from now on.
    WearOut {
        /// The node's number.
        node: u16,
    },
    /// Frames that a node sent are heard again.
    Replay {
        /// The node's number.
        node: u16,
        /// Those of this time before, seconds.
        last_s: f64,
    },
    /// An attacker without the key, who stands beside the first network's coordinator and hears all of that
    /// network, sends frames.
    Forge {
        /// Content of the frames.
        frames: Forgery,
        /// One in so many seconds.
        every_s: f64,
        /// For how long, seconds.
        for_s: f64,
    },
}

/// Frames that an attacker without the key can send, each with a right check sequence. Those that are made
/// from heard frames are not sent before one was heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Forgery {
    /// Random bytes.
    Random,
    /// The last frame that was heard, with one to three bits of it wrong.
    Flipped,
    /// The last secured broadcast, with a later counter and random contents.
    Broadcast,
    /// The last beacon, from another coordinator of the same network identifier.
    Beacon,
}

fn yes() -> bool {
    true
}

fn one_second() -> f64 {
    1.0
}

impl Action {
    /// The nodes that it names.
    pub fn nodes(&self) -> &[u16] {
        match self {
            Self::Restart { node }
            | Self::PowerCut { node, .. }
            | Self::UnplugCamera { node, .. }
            | Self::StickCamera { node, .. }
            | Self::CameraFaults { node, .. }
            | Self::BumpCamera { node, .. }
            | Self::Slip { node, .. }
            | Self::Rest { node, .. }
            | Self::IgnoreLamp { node, .. }
            | Self::PressButton { node, .. }
            | Self::Rot { node, .. }
            | Self::WearOut { node }
            | Self::Replay { node, .. } => std::slice::from_ref(node),
            Self::Partition { nodes, .. } => nodes,
            Self::Jam { .. } | Self::Loss { .. } | Self::Daylight { .. } | Self::Forge { .. } => {
                &[]
            }
        }
    }

    /// Duration, seconds.
    pub fn duration_s(&self) -> Option<f64> {
        match self {
            Self::Restart { .. }
            | Self::Daylight { .. }
            | Self::BumpCamera { .. }
            | Self::PressButton { .. }
            | Self::Rot { .. }
            | Self::WearOut { .. }
            | Self::Replay { .. } => None,
            Self::PowerCut { for_s, .. }
            | Self::Jam { for_s, .. }
            | Self::Partition { for_s, .. }
            | Self::Loss { for_s, .. }
            | Self::Forge { for_s, .. }
            | Self::UnplugCamera { for_s, .. }
            | Self::StickCamera { for_s, .. }
            | Self::CameraFaults { for_s, .. }
            | Self::Rest { for_s, .. }
            | Self::IgnoreLamp { for_s, .. }
            | Self::Slip { for_s, .. } => Some(*for_s),
        }
    }
}
