//! Ends of runs, and marks in results that are not of a whole run.

use serde::Deserialize;

/// Completeness of results.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum End {
    /// The results are of all that was to be done.
    Whole,
    /// The results are of the time before this happened.
    CutShort(String),
}

/// Extra field in the record of a run that was cut short.
#[derive(Deserialize)]
struct Mark {
    cut_short: Option<String>,
}

impl End {
    /// Reads from a record how its run ended.
    pub(super) fn of_json(text: &str) -> serde_json::Result<Self> {
        let mark: Mark = serde_json::from_str(text)?;
        Ok(mark.cut_short.map_or(Self::Whole, Self::CutShort))
    }

    /// Reason why the results are not complete, if they are not.
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

    /// YAML and CSV. Many readers of CSV refuse the line: better than a table that seems to be complete.
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
