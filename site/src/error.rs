//! What is wrong with a scenario.

use node_firmware::config::ConfigError;
use thiserror::Error;

use super::planner::PlanError;

/// Why a scenario cannot be run.
#[derive(Debug, Error)]
pub enum ScenarioError {
    /// There is no built-in scenario of that name.
    #[error(
        "there is no scenario `{name}`: there are {}; a file's name must have a `.toml` at its end",
        known.join(", ")
    )]
    Unknown {
        /// The name.
        name: String,
        /// Those there are.
        known: Vec<&'static str>,
    },
    /// The file cannot be read.
    #[error("cannot read {path}: {source}")]
    File {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// It is not TOML, or has fields that a scenario does not have.
    #[error(transparent)]
    Toml(#[from] toml::de::Error),
    /// A value makes no sense.
    #[error("`{field}` is {found}: it must be {allowed}")]
    Value {
        /// Where it is.
        field: String,
        /// What it is.
        found: String,
        /// What it may be, and what to do.
        allowed: String,
    },
    /// A node cannot be configured to it.
    #[error("node {node} cannot be configured: {reason}")]
    Config {
        /// Its number.
        node: u16,
        /// What of its configuration is wrong.
        reason: ConfigError,
    },
    /// No stops could be planned.
    #[error("no stops can be planned for network {network}: {source}")]
    Plan {
        /// Its number, from 1.
        network: usize,
        /// Why.
        source: PlanError,
    },
    /// A camera has too few places in view.
    #[error(
        "no {stops} stops can be planned in view of camera {camera}: look at its `range`, at \
         `world.low` and `world.high`, at its network's `area` and at obstacles"
    )]
    Unseen {
        /// Number of the camera's node.
        camera: u16,
        /// How many stops were wanted.
        stops: usize,
    },
    /// A target would walk through an obstacle.
    #[error(
        "target {target} would walk through obstacle {obstacle} (or brush it) between its stops {stop} and {}: \
         put a stop beside the obstacle between them, or move one of them",
        stop + 1
    )]
    Blocked {
        /// Number of the target's node.
        target: u16,
        /// Number of the obstacle, from 1.
        obstacle: usize,
        /// Number of the stop before it, from 1.
        stop: usize,
    },
}
