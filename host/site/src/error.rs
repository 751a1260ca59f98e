//! Errors of a scenario.

use node_firmware::config::ConfigError;
use thiserror::Error;

use super::{
    assume::Assumption,
    meant::{nearest, question},
    planner::PlanError,
};

/// Place of an error, before its description.
fn on(line: Option<usize>) -> String {
    line.map_or(String::new(), |line| format!("line {line}: "))
}

/// Words of the parser about text without quotes, which mean nothing to most people.
const UNQUOTED: [&str; 2] = ["invalid boolean", "string values must be quoted"];

/// An error of the parser, with what to do about text without quotes, about a key that is needed beside others, and about a
/// table of one key.
fn in_plain_words(error: &toml::de::Error) -> String {
    let (whole, message) = (error.to_string(), error.message());
    if UNQUOTED.iter().any(|words| message.starts_with(words)) {
        let words = "only a number, `true` and `false` stand without quotes: put text into quotes";
        return whole.replace(message, words);
    }
    if message.starts_with("wanted exactly 1 element") {
        let words = "exactly one key is needed in this table, docs/site.md names them: give each a table of its own";
        return whole.replace(message, words);
    }
    match message.strip_prefix("missing field ") {
        Some(key) => whole.replace(message, &format!("the key {key} is missing here: add it")),
        None => whole,
    }
}

fn list(open: &[Assumption]) -> String {
    let lines: Vec<_> = open.iter().map(|one| format!("  {one}")).collect();
    lines.join("\n")
}

/// Why a scenario cannot be run.
#[derive(Debug, Error)]
pub enum ScenarioError {
    /// There is no built-in scenario of that name.
    #[error(
        "there is no scenario `{name}`{} There are {}; a file's name must have a `.toml` at its end",
        match nearest(name, known.iter().map(String::as_str)) {
            Some(near) => format!(": did you mean `{near}`?"),
            None => ".".to_owned(),
        },
        known.join(", ")
    )]
    Unknown {
        /// The name.
        name: String,
        /// Those there are, and the file that has the name but for its end.
        known: Vec<String>,
    },
    /// A folder in place of a file.
    #[error("{0} is a folder: give the file of a site in it, whose name ends in `.toml`")]
    Folder(String),
    /// A file of another kind, to judge by its name.
    #[error("{0} is there, but is no file of a site: the name of one ends in `.toml`")]
    OtherFile(String),
    /// The file cannot be read.
    #[error("{path} cannot be read")]
    File {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// It is not TOML, or something that it needs is not there.
    #[error("{}", in_plain_words(.0))]
    Toml(#[from] toml::de::Error),
    /// It has a key that there is not.
    #[error(
        "{}there is no key `{key}` {place}{}",
        on(*line),
        question(nearest.as_ref())
    )]
    Key {
        /// The key.
        key: String,
        /// Where it is.
        place: String,
        /// The key that was probably meant.
        nearest: Option<String>,
        /// Its line in the file, from 1.
        line: Option<usize>,
    },
    /// A key is missing.
    #[error("{}the key `{key}` is missing {place}: add `{example}`. {what}", on(*line))]
    Missing {
        /// The key.
        key: String,
        /// Where it should be.
        place: String,
        /// Text that may be written.
        example: String,
        /// Meaning of the key.
        what: &'static str,
        /// The line of its table in the file, from 1.
        line: Option<usize>,
    },
    /// A value makes no sense.
    #[error("{}`{field}` is {found}: it must be {allowed}", on(*line))]
    Value {
        /// Its line in the file, from 1, or that of the table where it should be.
        line: Option<usize>,
        /// Where it is.
        field: String,
        /// Value that is there.
        found: String,
        /// Values that are allowed, and what to do.
        allowed: String,
    },
    /// A node cannot be configured to it.
    #[error("{}node {node} cannot be configured: {reason}", on(*line))]
    Config {
        /// The line in the file where the node is, from 1.
        line: Option<usize>,
        /// Its number.
        node: u16,
        /// Error of its configuration.
        reason: ConfigError,
    },
    /// Something that matters is not said.
    #[error("the file leaves open what nodes must know:\n{}", list(.0))]
    Open(Vec<Assumption>),
    /// No stops could be planned, and all headings are as small as radians are.
    #[error(
        "no stops can be planned, and every `heading_deg` lies between -6.3 and 6.3: are they radians? They must \
         be degrees (a quarter of a turn is 90)"
    )]
    Radians,
    /// No stops could be planned, and cameras see far less than the way to the next one.
    #[error(
        "no stops can be planned: `range` is {range}, and camera {camera} is {gap:.0} from the next: are places in \
         centimetres? All lengths of a file are in one unit, its `unit`"
    )]
    Centimetres {
        /// Number of a camera's node.
        camera: u16,
        /// Its range.
        range: f64,
        /// Distance of the camera that is nearest to it.
        gap: f64,
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
        "no {stops} stops can be planned in view of camera {camera}: look at its `heading_deg` and `pitch_deg`, at its \
         `range`, at `world.low` and `world.high`, at its network's `area` and at obstacles"
    )]
    Unseen {
        /// Number of the camera's node.
        camera: u16,
        /// Number of stops that were wanted.
        stops: usize,
    },
    /// A target or an object would go through an obstacle.
    #[error(
        "{who} would go through obstacle {obstacle} (or brush it) between its stops {stop} and {}: \
         put a stop beside the obstacle between them, or move one of them",
        stop + 1
    )]
    Blocked {
        /// Name of the target, or of the object.
        who: String,
        /// Number of the obstacle, from 1.
        obstacle: usize,
        /// Number of the stop before it, from 1.
        stop: usize,
    },
}

impl ScenarioError {
    /// Returns true if the message has the name of the file in it.
    #[must_use]
    pub const fn names_file(&self) -> bool {
        matches!(
            self,
            Self::Unknown { .. } | Self::Folder(_) | Self::OtherFile(_) | Self::File { .. }
        )
    }

    /// With the line of the file that it is about, if it has none yet.
    pub(crate) fn at_line(mut self, number: usize) -> Self {
        if let Self::Key { line, .. }
        | Self::Missing { line, .. }
        | Self::Value { line, .. }
        | Self::Config { line, .. } = &mut self
        {
            *line = line.or(Some(number));
        }
        self
    }
}
