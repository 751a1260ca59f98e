//! Description of one node as people write it, and the configuration made of it.
//!
//! A node is a table of TOML: `role` and `id`, then what all nodes have, then what its role has.
//! Names are those of [`Config`] and its roles, in kebab case. A value that is left out has its usual value,
//! also within `lens` and `good-enough`, except those that cannot be guessed: a camera's field of view, and
//! how wrong a target's step sensor may be. Channels are a list of numbers. [`text()`] writes the same form.
//!
//! ```toml
//! role = "camera"
//! id = 3
//! channels = [15, 20, 25, 26]              # default: all, 11 to 26
//! tx-power = 0                             # dBm
//! protection = 6                           # security level of IEEE 802.15.4, 5 or 6
//! stops = 4
//! lens = { field-of-view-deg = 47.0 }
//! reference = { duty = "first", position = [0.0, 0.0] }
//! subjects = { colours = [{ red = [185, 240], green = [60, 150], blue = [16, 80] }] }
//! ```

mod text;

use std::{fmt, str::FromStr};

use node_firmware::{
    config::{
        CameraConfig, CheckedConfig, Config, ConfigError, CoordinatorConfig, RoleConfig, SiteKey,
        Subjects, TargetConfig,
    },
    limits::MEMBERS,
    vision::{CameraKind, Lens},
};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use thiserror::Error;
use toml::{Table, Value};
use zigbee_link::security::Protection;

use crate::{FIRST_COORDINATOR, configs::usual_window};

pub use self::text::text;

/// Why a table is no node.
#[derive(Debug, Error)]
pub enum NodeError {
    /// A name that does not belong there.
    #[error("`{name}` does not belong into a file that is shown around: use {instead}")]
    Secret {
        /// Its name.
        name: &'static str,
        /// Where it belongs.
        instead: &'static str,
    },
    /// A value that only people can know.
    #[error("a {of} needs `{name}`: use {option}, or write it into the file{why}")]
    Missing {
        /// A node, or which one.
        of: &'static str,
        /// Name of the missing value.
        name: &'static str,
        /// The option of `host-sim provision`.
        option: &'static str,
        /// Advice on what to choose.
        why: &'static str,
    },
    /// A value of another kind.
    #[error(transparent)]
    Toml(#[from] toml::de::Error),
    /// A value that is not among the usual ones.
    #[error(transparent)]
    Usual(#[from] toml::ser::Error),
    /// The number of the node.
    #[error("id must be 1 to 65535, not {0}")]
    Id(i64),
    /// The number is that of another kind of node.
    #[error("the id of a {0} must be 1 to {max}, not {1}: those above are coordinators'", max = FIRST_COORDINATOR - 1)]
    Coordinators(RoleName, u16),
    /// A picture that no CMUcam2 takes.
    #[error("a CMUcam2's lens has 88 columns, or 160 with the OV7620, not {0}")]
    Columns(u16),
    /// Names that would have no effect.
    #[error("a {role} has no parameter {names}")]
    Unknown {
        /// Of what.
        role: RoleName,
        /// The names.
        names: String,
    },
    /// More than there are.
    #[error("a coordinator's network has at most {MEMBERS} other nodes, not {0}")]
    TooMany(usize),
    /// A number that is no channel.
    #[error("there is no channel {0}: the 2.4 GHz channels are 11 to 26")]
    Channel(u8),
    /// A level that is not supported.
    #[error("protection must be 5 or 6")]
    Protection,
    /// A value out of its range.
    #[error(transparent)]
    Config(#[from] ConfigError),
}

/// Names of the values that all nodes have, without the site key, which no file holds.
const COMMON: [&str; 6] = ["role", "id", "channels", "tx-power", "protection", "sleep"];
/// Tables whose parts have usual values of their own.
const PARTS: [&str; 4] = ["lens", "good-enough", "weak", "sensor"];

/// Name of a lens's k1 and k2.
const DISTORTION: &str = "distortion";

/// Lens of a CMUcam2 with the OV6620. The field of view is always given.
const LENS: Lens = Lens::pin_hole(88, 45.0);
/// A CMUcam2's columns with either of its sensors.
const COLUMNS: [u16; 2] = [88, 160];

/// Role of a node, by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RoleName {
    /// `camera`
    Camera,
    /// `coordinator`
    Coordinator,
    /// `target`
    Target,
}

impl RoleName {
    /// All there are.
    pub const ALL: [Self; 3] = [Self::Camera, Self::Coordinator, Self::Target];

    /// As it is written.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Coordinator => "coordinator",
            Self::Target => "target",
        }
    }
}

impl From<&RoleConfig> for RoleName {
    fn from(role: &RoleConfig) -> Self {
        match role {
            RoleConfig::Camera(_) => Self::Camera,
            RoleConfig::Coordinator(_) => Self::Coordinator,
            RoleConfig::Target(_) => Self::Target,
        }
    }
}

impl fmt::Display for RoleName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for RoleName {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let named = Self::ALL.into_iter().find(|role| role.name() == text);
        named.ok_or(())
    }
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Common {
    role: RoleName,
    id: i64,
    channels: Option<Vec<u8>>,
    #[serde(default)]
    tx_power: i8,
    protection: Option<u8>,
    #[serde(default)]
    sleep: bool,
}

/// A coordinator's parameters, before they are counted.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Coordinator {
    allow: Vec<u16>,
    join_window_s: u16,
    metres_per_unit: f32,
    ball_radius: f32,
}

impl Default for Coordinator {
    fn default() -> Self {
        let usual = CoordinatorConfig::default();
        Self {
            allow: usual.allow.to_vec(),
            join_window_s: usual.join_window_s,
            metres_per_unit: usual.metres_per_unit,
            ball_radius: usual.ball_radius,
        }
    }
}

/// Values that cannot be guessed: role, the table in the node's, the name there, the name as people know it,
/// the option, and what to choose.
const ASKED: [(RoleName, &str, &str, &str, &str, &str); 3] = [
    (
        RoleName::Camera,
        "lens",
        "field-of-view-deg",
        "lens.field-of-view-deg",
        "--field-of-view",
        ". The CMUcam2's manual says 44 to 50 degrees, by lens; docs/deploy.md tells how to measure it",
    ),
    (
        RoleName::Target,
        "",
        "systematic-heading-deg",
        "systematic-heading-deg",
        "--systematic-heading",
        ". It is usually 3: how far its compass may be off all the time, degrees (one sigma)",
    ),
    (
        RoleName::Target,
        "",
        "systematic-scale",
        "systematic-scale",
        "--systematic-scale",
        ". It is usually 0.08, with a measured step length 0.03: by which share its steps may be too \
         long all the time (one sigma)",
    ),
];

/// Makes a configuration, and checks it.
///
/// # Errors
/// [`NodeError`]
pub fn config(mut table: Table, site_key: SiteKey) -> Result<CheckedConfig, NodeError> {
    if table.contains_key("site-key") {
        let (name, instead) = ("site-key", "--site-key FILE");
        return Err(NodeError::Secret { name, instead });
    }
    for (name, option) in [("role", "--role"), ("id", "--id")] {
        if !table.contains_key(name) {
            return Err(NodeError::Missing {
                of: "node",
                name,
                option,
                why: "",
            });
        }
    }
    let common: Table = COMMON
        .iter()
        .filter_map(|&name| Some((name.to_owned(), table.remove(name)?)))
        .collect();
    let common: Common = common.try_into()?;
    let id = u16::try_from(common.id).ok().filter(|&id| id > 0);
    let id = id.ok_or(NodeError::Id(common.id))?;
    if id >= FIRST_COORDINATOR && common.role != RoleName::Coordinator {
        return Err(NodeError::Coordinators(common.role, id));
    }
    for (role, part, key, name, option, why) in ASKED {
        let given = match part {
            "" => table.contains_key(key),
            part => table.get(part).is_some_and(|part| part.get(key).is_some()),
        };
        if role == common.role && !given {
            return Err(NodeError::Missing {
                of: role.name(),
                name,
                option,
                why,
            });
        }
    }
    let role = match common.role {
        RoleName::Camera => {
            let kind = table.get("kind").cloned();
            let kind: Option<CameraKind> = kind.and_then(|kind| kind.try_into().ok());
            let usual = match kind.unwrap_or_default().model() {
                Some(model) => CameraConfig::pixy(model, 1),
                None => {
                    // Light differs: it is meant to be learnt anew at the site.
                    let colours = [usual_window()].into_iter().collect();
                    CameraConfig::new(LENS, Subjects::Colours(colours))
                }
            };
            // No field of the body of a page.
            let lens = table.get_mut("lens").and_then(Value::as_table_mut);
            let distortion = lens.and_then(|lens| lens.remove(DISTORTION));
            let mut own: CameraConfig = parameters(common.role, &usual, table)?;
            own.lens.distortion = distortion
                .map(Value::try_into)
                .transpose()?
                .unwrap_or_default();
            let columns = own.lens.columns;
            if own.kind == CameraKind::Cmucam2 && !COLUMNS.contains(&columns) {
                return Err(NodeError::Columns(columns));
            }
            RoleConfig::Camera(own)
        }
        RoleName::Coordinator => {
            let own = parameters(common.role, &Coordinator::default(), table)?;
            RoleConfig::Coordinator(own.try_into()?)
        }
        RoleName::Target => {
            let own: TargetConfig = parameters(common.role, &TargetConfig::default(), table)?;
            RoleConfig::Target(own)
        }
    };
    let mut config = Config::new(id, site_key, role);
    config.channels = channel_mask(common.channels)?;
    config.tx_power = common.tx_power;
    config.protection = match common.protection {
        None | Some(6) => Protection::EncMic64,
        Some(5) => Protection::EncMic32,
        Some(_) => return Err(NodeError::Protection),
    };
    config.sleeps = common.sleep;
    Ok(config.check()?)
}

/// The usual parameters, and over them those that are given. An unknown name is refused: it would be a
/// parameter that has no effect.
fn parameters<T: Serialize + DeserializeOwned>(
    role: RoleName,
    usual: &T,
    given: Table,
) -> Result<T, NodeError> {
    let mut table = Table::try_from(usual)?;
    merge(&mut table, given);
    let mut unknown = Vec::new();
    let parameters = serde_ignored::deserialize(Value::Table(table), |path| {
        unknown.push(format!("`{path}`"));
    })?;
    if !unknown.is_empty() {
        let names = unknown.join(", ");
        return Err(NodeError::Unknown { role, names });
    }
    Ok(parameters)
}

/// Puts one table over another, part by part where each has a usual value.
pub fn merge(table: &mut Table, over: Table) {
    for (name, value) in over {
        let value = match (table.remove(&name), value) {
            (Some(Value::Table(mut parts)), Value::Table(over))
                if PARTS.contains(&name.as_str()) =>
            {
                parts.extend(over);
                Value::Table(parts)
            }
            (_, value) => value,
        };
        table.insert(name, value);
    }
}

impl TryFrom<Coordinator> for CoordinatorConfig {
    type Error = NodeError;

    fn try_from(own: Coordinator) -> Result<Self, NodeError> {
        let count = own.allow.len();
        let allow = heapless::Vec::from_slice(&own.allow);
        let mut config = Self::default();
        config.allow = allow.map_err(|_| NodeError::TooMany(count))?;
        config.join_window_s = own.join_window_s;
        config.metres_per_unit = own.metres_per_unit;
        config.ball_radius = own.ball_radius;
        Ok(config)
    }
}

fn channel_mask(channels: Option<Vec<u8>>) -> Result<u32, NodeError> {
    let channels = channels.unwrap_or_else(|| (11..=26).collect());
    channels.into_iter().try_fold(0, |mask, channel| {
        if !(11..=26).contains(&channel) {
            return Err(NodeError::Channel(channel));
        }
        Ok(mask | 1 << channel)
    })
}
