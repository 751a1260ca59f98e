//! How runs ended, and how results tell it that are of no whole run.

use serde::Deserialize;

/// Whether results are of all that was to be done.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum End {
    /// They are.
    Whole,
    /// They are of what was before this happened.
    CutShort(String),
}

/// What records of runs that were cut short have besides.
#[derive(Deserialize)]
struct Mark {
    cut_short: Option<String>,
}

impl End {
    /// What a record says of itself.
    pub(super) fn of_json(text: &str) -> serde_json::Result<Self> {
        let mark: Mark = serde_json::from_str(text)?;
        Ok(mark.cut_short.map_or(Self::Whole, Self::CutShort))
    }

    /// Why they are not, if so.
    pub(super) fn why(&self) -> Option<&str> {
        match self {
            Self::Whole => None,
            Self::CutShort(why) => Some(why),
        }
    }

    /// A text for people.
    pub(super) fn mark_text(&self, text: String) -> String {
        match self {
            Self::Whole => text,
            Self::CutShort(why) => {
                format!("NOT COMPLETE: {why}. What follows is what was known until then.\n\n{text}")
            }
        }
    }

    /// An object of JSON.
    pub(super) fn mark_json(&self, text: String) -> String {
        match self {
            Self::Whole => text,
            Self::CutShort(why) => {
                let why = serde_json::Value::from(why.as_str());
                text.replacen('{', &format!("{{\n  \"cut_short\": {why},"), 1)
            }
        }
    }

    /// YAML, and CSV, of which many readers refuse the line: better than a table that pretends.
    pub(super) fn mark_lines(&self, text: String) -> String {
        match self {
            Self::Whole => text,
            Self::CutShort(why) => format!("{text}# not complete: {}\n", one_line(why)),
        }
    }

    /// A drawing.
    pub(super) fn mark_svg(&self, text: String) -> String {
        match self {
            Self::Whole => text,
            Self::CutShort(why) => {
                // Two hyphens would end the comment.
                let why = one_line(why).replace("--", "- -");
                format!("{}\n<!-- not complete: {why} -->\n", text.trim_end())
            }
        }
    }
}

fn one_line(text: &str) -> String {
    text.replace(char::is_control, " ")
}
