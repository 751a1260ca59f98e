//! What people write of a node, and the configuration made of it.
//!
//! A node is a table of TOML: `role` and `id`, then what all nodes have, then what its role has.
//! Names are those of [`Config`] and its roles, in kebab case. What is left out has its usual
//! value, also within `lens`, `good-enough` and `weak`. Addresses are texts, channels a list of numbers.
//!
//! ```toml
//! role = "camera"
//! id = 3
//! extended = "F4:CE:36:00:00:00:00:03"     # default: the chip's
//! channels = [15, 20, 25, 26]              # default: all, 11 to 26
//! tx-power = 0                             # dBm
//! protection = 6                           # security level of IEEE 802.15.4, 5 or 6
//! stops = 4
//! lens = { field-of-view-deg = 47.0 }
//! reference = { duty = "first", position = [0.0, 0.0] }
//! subjects = { colours = [{ red = [170, 240], green = [60, 140], blue = [16, 80] }] }
//! ```

use std::{
    fmt,
    time::{SystemTime, UNIX_EPOCH},
};

use anyhow::{Context, Result, bail, ensure};
use node_firmware::{
    config::{
        ALLOWED_MAX, CameraConfig, Config, CoordinatorConfig, Role, SiteKey, Subjects, TargetConfig,
    },
    sight::{ColourWindow, Lens},
};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use toml::{Table, Value};
use zigbee_link::security::Protection;

/// What all nodes have, without the site key and the counter, which no file holds.
const COMMON: [&str; 6] = [
    "role",
    "id",
    "extended",
    "channels",
    "tx-power",
    "protection",
];
/// Tables of which each part has a usual value of its own.
const PARTS: [&str; 4] = ["lens", "good-enough", "weak", "sensor"];

/// Of a CMUcam2 with the OV6620 and the lens it comes with: the manual says 44 to 50 degrees, by
/// lens.
const LENS: Lens = Lens::pin_hole(88, 45.0);
/// An orange target's. Light differs: it is meant to be learnt anew at the site.
const ORANGE: ColourWindow = ColourWindow {
    red: [170, 240],
    green: [60, 140],
    blue: [16, 80],
};

/// 2026-01-01 00:00:00 UTC, seconds of Unix.
const EPOCH: u64 = 1_767_225_600;

#[derive(Clone, Copy, PartialEq, Eq, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum RoleName {
    Camera,
    Coordinator,
    Target,
}

impl From<&Role> for RoleName {
    fn from(role: &Role) -> Self {
        match role {
            Role::Camera(_) => Self::Camera,
            Role::Coordinator(_) => Self::Coordinator,
            Role::Target(_) => Self::Target,
        }
    }
}

impl fmt::Display for RoleName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Camera => "camera",
            Self::Coordinator => "coordinator",
            Self::Target => "target",
        })
    }
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Common {
    role: RoleName,
    id: i64,
    extended: Option<String>,
    channels: Option<Vec<u8>>,
    #[serde(default)]
    tx_power: i8,
    protection: Option<u8>,
}

/// A coordinator's parameters, with addresses as people write them.
#[derive(Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Coordinator {
    allow: Vec<String>,
    join_window_s: u16,
}

/// Makes a configuration, and checks it.
pub(super) fn config(mut table: Table, site_key: SiteKey, first_counter: u32) -> Result<Config> {
    for (name, instead) in [
        ("site-key", "--site-key FILE"),
        ("first-counter", "--first-counter N"),
    ] {
        ensure!(
            !table.contains_key(name),
            "`{name}` does not belong into a file that is shown around: use {instead}"
        );
    }
    for (name, option) in [("role", "--role"), ("id", "--id")] {
        ensure!(
            table.contains_key(name),
            "a node needs `{name}`: use {option}, or write it into the file"
        );
    }
    let common: Table = COMMON
        .iter()
        .filter_map(|&name| Some((name.to_owned(), table.remove(name)?)))
        .collect();
    let common: Common = common.try_into()?;
    let id = u16::try_from(common.id).ok().filter(|&id| id > 0);
    let id = id.with_context(|| format!("id must be 1 to {}, not {}", u16::MAX, common.id))?;
    let role = match common.role {
        RoleName::Camera => {
            let colours = [ORANGE].into_iter().collect();
            let usual = CameraConfig::new(LENS, Subjects::Colours(colours));
            Role::Camera(parameters(common.role, &usual, table)?)
        }
        RoleName::Coordinator => {
            let own = parameters(common.role, &Coordinator::default(), table)?;
            Role::Coordinator(own.try_into()?)
        }
        RoleName::Target => {
            let own: TargetConfig = parameters(common.role, &TargetConfig::default(), table)?;
            Role::Target(own)
        }
    };
    let config = Config {
        id,
        extended: common.extended.as_deref().map(address).transpose()?,
        site_key,
        first_counter,
        channels: channel_mask(common.channels)?,
        tx_power: common.tx_power,
        protection: match common.protection {
            None | Some(6) => Protection::EncMic64,
            Some(5) => Protection::EncMic32,
            Some(_) => bail!("protection must be 5 or 6"),
        },
        role,
    };
    config.check()?;
    Ok(config)
}

/// The usual parameters, and over them those that are given. A name that nobody knows is refused:
/// it would be a parameter that has no effect.
fn parameters<T: Serialize + DeserializeOwned>(
    role: RoleName,
    usual: &T,
    given: Table,
) -> Result<T> {
    let mut table = Table::try_from(usual)?;
    merge(&mut table, given);
    let mut unknown = Vec::new();
    let parameters = serde_ignored::deserialize(Value::Table(table), |path| {
        unknown.push(format!("`{path}`"));
    })?;
    ensure!(
        unknown.is_empty(),
        "a {role} has no parameter {}",
        unknown.join(", ")
    );
    Ok(parameters)
}

/// Puts one table over another.
pub(super) fn merge(table: &mut Table, over: Table) {
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
    type Error = anyhow::Error;

    fn try_from(own: Coordinator) -> Result<Self> {
        let allow = own.allow.iter().map(|text| address(text));
        Ok(Self {
            allow: allow_list(allow.collect::<Result<Vec<_>>>()?.as_slice())?,
            join_window_s: own.join_window_s,
        })
    }
}

/// As many as a network has.
pub(super) fn allow_list(devices: &[[u8; 8]]) -> Result<heapless::Vec<[u8; 8], ALLOWED_MAX>> {
    heapless::Vec::from_slice(devices).ok().with_context(|| {
        let count = devices.len();
        format!("a coordinator's network has at most {ALLOWED_MAX} other nodes, not {count}")
    })
}

/// Eight bytes in hexadecimal, most significant first, with or without colons or hyphens between
/// them.
fn address(text: &str) -> Result<[u8; 8]> {
    let digits: String = text.chars().filter(|c| !matches!(c, ':' | '-')).collect();
    let well_formed = digits.len() == 16 && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    ensure!(
        well_formed,
        "`{text}` is no EUI-64: it has 8 bytes, for example F4:CE:36:00:00:00:00:03"
    );
    Ok(u64::from_str_radix(&digits, 16)?.to_be_bytes())
}

/// As it is printed on devices.
pub(super) fn address_text(address: [u8; 8]) -> String {
    address.map(|byte| format!("{byte:02X}")).join(":")
}

fn channel_mask(channels: Option<Vec<u8>>) -> Result<u32> {
    let channels = channels.unwrap_or_else(|| (11..=26).collect());
    channels.into_iter().try_fold(0, |mask, channel| {
        ensure!(
            (11..=26).contains(&channel),
            "there is no channel {channel}: the 2.4 GHz channels are 11 to 26"
        );
        Ok(mask | 1 << channel)
    })
}

/// The frame counter that a node provisioned now begins with: seconds since 2026-01-01 UTC.
///
/// A node takes a new key and counter only if the counter is above all it may have used, and no
/// counter may be used twice under one key. Time rises with every provisioning, without a record
/// of all nodes, as long as a node sends less than one frame a second on average.
pub(super) fn counter_now() -> Result<u32> {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .ok()
        .and_then(|since| since.as_secs().checked_sub(EPOCH))
        .and_then(|seconds| u32::try_from(seconds).ok())
        .context("this computer's clock is not right: set it, or use --first-counter N")
}
