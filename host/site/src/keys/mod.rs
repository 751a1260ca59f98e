//! Every key of a file: its kind, its range, its default and who uses it, in one place. Files are
//! checked by it, and `docs/site.md` is made of it.

mod document;
pub(crate) mod limits;
mod table;

use std::fmt;

use node_firmware::{
    config::{CameraConfig, CoordinatorConfig, Subjects, TargetConfig},
    vision::Lens,
};

use super::error::ScenarioError;
pub(crate) use document::{check, line_of};
pub use table::KEYS;

/// One key of a file.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// The tables it is in and its name, with dots between them, and `[]` behind what may be there
    /// several times.
    pub path: &'static str,
    /// Values that may be written.
    pub kind: Kind,
    /// Value that holds without it.
    pub default: Without,
    /// User of the key.
    pub used: Used,
    /// Meaning of the key.
    pub what: &'static str,
}

/// Values that may be written for a key.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// A number in this range, and its unit or what to do.
    Number(f64, f64, &'static str),
    /// A whole number.
    Whole(f64, f64, &'static str),
    /// Whole numbers, at least one.
    Wholes(f64, f64, &'static str),
    /// So many numbers.
    Numbers(usize, f64, f64, &'static str),
    /// So many whole numbers.
    Levels(usize, f64, f64, &'static str),
    /// At least so many places, `[x, y]`, and why.
    Places(usize, usize, &'static str),
    /// `true` or `false`.
    Flag,
    /// One line of text.
    Text,
    /// Lines of text.
    Texts,
    /// One of these.
    Choice(&'static [&'static str]),
    /// One of these numbers.
    OneOf(&'static [u32]),
    /// A table, with keys of its own.
    Table,
    /// Tables, with keys of their own.
    Tables,
    /// Names and their rates.
    Rates,
    /// The same as this other key.
    Same(&'static str),
}

/// Value that holds without a key.
#[derive(Clone, Copy, Debug)]
pub enum Without {
    /// It must be there.
    Needed,
    /// This.
    Is(&'static str),
    /// The firmware's default for a camera's parameter.
    Camera(&'static str),
    /// The firmware's default for a target's parameter.
    Target(&'static str),
    /// The firmware's default for a coordinator's parameter.
    Coordinator(&'static str),
}

/// User of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Used {
    /// Nodes are configured by it, in a rehearsal and on boards.
    Nodes,
    /// Only a rehearsal.
    Rehearsal,
    /// Both, for different things.
    Both,
}

impl fmt::Display for Used {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Nodes => "nodes",
            Self::Rehearsal => "rehearsal",
            Self::Both => "both",
        })
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Number(low, high, advice) => write!(f, "{low} to {high}{advice}"),
            Self::Whole(low, high, advice) => write!(f, "a whole number, {low} to {high}{advice}"),
            Self::Wholes(low, high, advice) => {
                write!(f, "a list of whole numbers, each {low} to {high}{advice}")
            }
            Self::Numbers(count, low, high, advice) => {
                write!(f, "{count} numbers, each {low} to {high}{advice}")
            }
            Self::Levels(count, low, high, advice) => {
                write!(f, "{count} whole numbers, each {low} to {high}{advice}")
            }
            Self::Places(least, _, advice) => {
                write!(f, "a list of {least} places `[x, y]` or more{advice}")
            }
            Self::Flag => f.write_str("`true` or `false`"),
            Self::Text => f.write_str("text of one line, without control characters"),
            Self::Texts => f.write_str("text"),
            Self::Choice(names) => {
                let names: Vec<_> = names.iter().map(|name| format!("`\"{name}\"`")).collect();
                f.write_str(&names.join(" or "))
            }
            Self::OneOf(numbers) => {
                let numbers: Vec<_> = numbers.iter().map(u32::to_string).collect();
                write!(f, "one of {}", numbers.join(", "))
            }
            Self::Table => f.write_str("a table"),
            Self::Tables => f.write_str("a list of tables"),
            Self::Rates => f.write_str("a table of names and numbers"),
            Self::Same(path) => write!(f, "as `{path}`"),
        }
    }
}

impl Without {
    /// As text, with the firmware's values.
    pub fn text(&self) -> String {
        let usual = |table: Result<toml::Table, _>, path: &str| {
            let table: Result<_, toml::ser::Error> = table;
            let mut value = table.ok().map(toml::Value::Table);
            for name in path.split('.') {
                value = value.and_then(|value| value.get(name).cloned());
            }
            value.map_or_else(String::new, |value| round(&value))
        };
        match self {
            Self::Needed => "needed".into(),
            Self::Is(text) => (*text).into(),
            Self::Camera(path) => {
                let subjects = Subjects::Motion { threshold: 1 };
                let camera = CameraConfig::new(Lens::pin_hole(88, 45.0), subjects);
                usual(toml::Table::try_from(camera), path)
            }
            Self::Target(path) => usual(toml::Table::try_from(TargetConfig::default()), path),
            Self::Coordinator(path) => {
                usual(toml::Table::try_from(CoordinatorConfig::default()), path)
            }
        }
    }
}

/// A node's number has seven digits.
fn round(value: &toml::Value) -> String {
    match value {
        toml::Value::Float(value) => (*value as f32).to_string(),
        toml::Value::Array(all) => {
            let all: Vec<_> = all.iter().map(round).collect();
            format!("[{}]", all.join(", "))
        }
        value => value.to_string(),
    }
}

/// Refuses a number that this key may not have.
pub(crate) fn check_number(path: &str, value: f64) -> Result<(), ScenarioError> {
    let key = KEYS.iter().find(|key| key.path == path);
    match key.map(|key| key.kind) {
        Some(Kind::Number(low, high, advice) | Kind::Whole(low, high, advice))
            if !(low..=high).contains(&value) =>
        {
            let allowed = format!("{low} to {high}{advice}");
            Err(super::check::refuse(path, document::short(value), allowed))
        }
        _ => Ok(()),
    }
}

/// The tables of `docs/site.md`: those keys that are in this table, as rows of Markdown.
pub fn markdown(table: &str) -> String {
    let mut rows = String::from(
        "| key | what may be written | without it | used by | what it is |\n|---|---|---|---|---|\n",
    );
    for key in KEYS {
        let (parent, name) = key.path.rsplit_once('.').unwrap_or(("", key.path));
        if parent == table {
            rows += &format!(
                "| `{}` | {} | {} | {} | {} |\n",
                name.trim_end_matches("[]"),
                key.kind,
                key.default.text(),
                key.used,
                key.what
            );
        }
    }
    rows
}
