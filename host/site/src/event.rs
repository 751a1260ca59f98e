//! Faults and other events by order of a script.

use std::{collections::BTreeMap, slice};

use node_firmware::hardware::Button;
use serde::{Deserialize, Serialize};

use crate::{
    FIRST_COORDINATOR,
    keys::{
        Key,
        Kind::{Choice, Flag, Number, Numbers, Rates, Table, Whole, Wholes},
        Used::Rehearsal,
        Without::{Is, Needed},
        limits::{ANY_NODE, CHANNEL, DURATION, LARGE, LENGTH, NODE, SHARE},
    },
};

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

/// Nodes that an event may name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Subject {
    /// All of them.
    Any,
    /// Cameras.
    Camera,
    /// Targets.
    Target,
    /// The first network's coordinator.
    Coordinator,
}

/// Numbers of one node or of several.
trait Numbered {
    fn numbers(&self) -> &[u16];
}

impl Numbered for u16 {
    fn numbers(&self) -> &[u16] {
        slice::from_ref(self)
    }
}

impl Numbered for Vec<u16> {
    fn numbers(&self) -> &[u16] {
        self
    }
}

/// Declares each event once: its name, its meaning, the nodes that it may name and the field that names them, the
/// field of its duration; and each of its fields with type, values, default and meaning. Lengths are in the unit of
/// the site. `host-sim` has what each does to a simulation, and its words.
macro_rules! events {
    ($(
        $variant:ident $name:literal, $what:literal
        $(, of $subject:ident: $nodes:ident)? $(, for $duration:ident)? {$(
            $field:ident: $type:ty $(= $or:literal)?, $kind:expr, $default:expr, $means:literal;
        )+}
    )+) => {
        /// Kind of event, with its parameters.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub enum Action {$(
            #[doc = $what]
            #[serde(rename = $name)]
            $variant {$(
                #[doc = $means]
                $(#[serde(default = $or)])?
                $field: $type,
            )+},
        )+}

        impl Action {
            /// The nodes that it names.
            pub fn nodes(&self) -> &[u16] {
                match self {
                    $($(Self::$variant { $nodes, .. } => $nodes.numbers(),)?)+
                    _ => &[],
                }
            }

            /// Duration, seconds.
            pub fn duration_s(&self) -> Option<f64> {
                match self {
                    $($(Self::$variant { $duration, .. } => Some(*$duration),)?)+
                    _ => None,
                }
            }

            /// The nodes that events of this kind may name.
            fn subject_of_kind(&self) -> Subject {
                match self {
                    $($(Self::$variant { .. } => Subject::$subject,)?)+
                    _ => Subject::Any,
                }
            }
        }

        /// The keys of `[[event]]`'s actions.
        pub(crate) const KEYS: &[Key] = &[$(
            Key {
                path: concat!("event[].action.", $name),
                kind: Table,
                default: Is(""),
                used: Rehearsal,
                what: $what,
            },
            $(Key {
                path: concat!("event[].action.", $name, ".", stringify!($field)),
                kind: $kind,
                default: $default,
                used: Rehearsal,
                what: $means,
            },)+
        )+];
    };
}

#[rustfmt::skip]
events! {
    Restart "restart", "A node restarts; what is in its flash stays.", of Any: node {
        node: u16, ANY_NODE, Needed, "Number of the node.";
    }
    PowerCut "power-cut", "A node and its camera lose their power.", of Any: node, for for_s {
        node: u16, ANY_NODE, Needed, "Number of the node.";
        for_s: f64, DURATION, Needed, "Duration.";
        in_flash_write: bool = "Default::default", Flag, Is("false"), "Not before it next writes its flash, in the middle of that.";
    }
    Jam "jam", "A carrier covers a channel.", for for_s {
        for_s: f64, DURATION, Needed, "Duration.";
        channel: Option<u8> = "Default::default", CHANNEL, Is("all"), "The channel.";
        at: Option<[f64; 2]> = "Default::default", Numbers(2, -LARGE, LARGE, ": x and y"), Is("everywhere"), "Where it is; `reach` belongs to it.";
        reach: Option<f64> = "Default::default", LENGTH, Is("everywhere"), "Distance that it reaches from `at`.";
    }
    Partition "partition", "Some nodes and all others do not hear one another.", of Any: nodes, for for_s {
        nodes: Vec<u16>, Wholes(0.0, FIRST_COORDINATOR as f64 - 1.0, ": some nodes, 0 for the first network's coordinator"), Needed, "Numbers of the nodes.";
        for_s: f64, DURATION, Needed, "Duration.";
    }
    Loss "loss", "All links lose more frames.", for for_s {
        share: f64, SHARE, Needed, "Share of the frames.";
        for_s: f64, DURATION, Needed, "Duration.";
    }
    UnplugCamera "unplug-camera", "The plug between a node and its camera is pulled.", of Camera: node, for for_s {
        node: u16, NODE, Needed, "Number of the camera.";
        for_s: f64, DURATION, Needed, "Duration.";
        with_power: bool = "yes", Flag, Is("true"), "The camera's power goes with it.";
    }
    UnplugSensor "unplug-sensor", "The step sensor of a target is unplugged. Its carrier then tells each planned stop where it stands.", of Target: node, for for_s {
        node: u16, NODE, Needed, "Number of the target.";
        for_s: f64, DURATION, Needed, "Duration.";
    }
    StickCamera "stick-camera", "A camera goes on reporting what it saw at that time.", of Camera: node, for for_s {
        node: u16, NODE, Needed, "Number of the camera.";
        for_s: f64, DURATION, Needed, "Duration.";
    }
    Daylight "daylight", "The light before all cameras is another one. It stays so." {
        level: f64, Number(0.0, 4.0, ""), Needed, "Brightness, against 1 at the start.";
        kelvin: f64, Number(1_667.0, 25_000.0, " kelvin: 2700 is a lamp, 6504 white daylight as at the start, 10000 the blue sky"), Needed, "Its colour temperature.";
    }
    CameraFaults "camera-faults", "A camera or its line has other faults for a while, in place of those of `camera.faults`.", of Camera: node, for for_s {
        node: u16, NODE, Needed, "Number of the camera.";
        for_s: f64, DURATION, Needed, "Duration.";
        faults: BTreeMap<String, f64>, Rates, Needed, "Rate of each, by name: as in `camera.faults`.";
    }
    BumpCamera "bump-camera", "A camera is moved, turned, or both. It stays so.", of Camera: node {
        node: u16, NODE, Needed, "Number of the camera.";
        by: [f64; 2] = "Default::default", Numbers(2, -LARGE, LARGE, ": x and y"), Is("[0, 0]"), "Displacement.";
        turn_deg: f64 = "Default::default", Number(-180.0, 180.0, " degrees"), Is("0"), "Angle by which it is turned, counter-clockwise.";
    }
    Slip "slip", "A target slips: its steps are not what its sensor says.", of Target: node, for for_s {
        node: u16, NODE, Needed, "Number of the target.";
        for_s: f64, DURATION, Needed, "Duration.";
        distance: f64 = "Default::default", Number(-0.9, 9.0, " of the distance"), Is("0"), "Excess of each distance that the sensor reads.";
        heading_deg: f64 = "Default::default", Number(-180.0, 180.0, " degrees"), Is("0"), "Excess of each heading that it reads.";
    }
    Rest "rest", "A target's carrier rests at the stop where it stands, or comes to stand next, whatever the lamp shows.", of Target: node, for for_s {
        node: u16, NODE, Needed, "Number of the target.";
        for_s: f64, DURATION, Needed, "Duration.";
    }
    IgnoreLamp "ignore-lamp", "A target's carrier does not heed the lamp, and walks on from each stop after a while.", of Target: node, for for_s {
        node: u16, NODE, Needed, "Number of the target.";
        for_s: f64, DURATION, Needed, "Duration.";
        stand_s: f64 = "one_second", DURATION, Is("1"), "Time that it stands at a stop.";
    }
    PressButton "press-button", "A button of a node is pressed for a moment. A node without power does not notice.", of Any: node {
        node: u16, ANY_NODE, Needed, "Number of the node: a coordinator for `join-window`, a camera for `learn-colour`.";
        button: Button, Choice(&["join-window", "learn-colour"]), Needed, "The one that lets devices join for a minute, or the one that has a camera learn the colour of what is in the middle of its view.";
    }
    Rot "rot", "Bits of a node's flash flip.", of Any: node {
        node: u16, ANY_NODE, Needed, "Number of the node.";
        bits: u32, Whole(1.0, 1e6, ""), Needed, "Number of bits, each as likely as another.";
    }
    WearOut "wear-out", "A node's flash is worn: whatever is written to it or erased fails from now on.", of Any: node {
        node: u16, ANY_NODE, Needed, "Number of the node.";
    }
    Replay "replay", "Frames that a node sent are heard again.", of Any: node {
        node: u16, ANY_NODE, Needed, "Number of the node.";
        last_s: f64, DURATION, Needed, "Those of this time before.";
    }
    Forge "forge", "An attacker without the key, beside the first network's coordinator, sends frames.", for for_s {
        frames: Forgery, Choice(&["random", "flipped", "broadcast", "beacon"]), Needed, "Their content: random bytes; the last frame heard with one to three wrong bits; the last secured broadcast with a later counter and random contents; the last beacon from another coordinator.";
        every_s: f64, Number(0.005, 1e7, " seconds"), Needed, "One in this time.";
        for_s: f64, DURATION, Needed, "Duration.";
    }
}

impl Action {
    /// The nodes that it may name.
    pub(crate) fn subject(&self) -> Subject {
        match self {
            Self::PressButton { button, .. } => match button {
                Button::LearnColour => Subject::Camera,
                Button::JoinWindow => Subject::Coordinator,
            },
            other => other.subject_of_kind(),
        }
    }
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
