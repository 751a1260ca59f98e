//! The topics below that of a publisher.

use std::fmt;

use results::record::{
    event::{Event, What},
    part::Part,
};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Level of a publisher's presence: [`ONLINE`] or [`OFFLINE`].
pub const STATUS: &str = "status";
/// The publisher tells.
pub const ONLINE: &str = "online";
/// The publisher has ended, or is lost.
pub const OFFLINE: &str = "offline";
/// Level of the begin of its stream.
pub const BEGIN: &str = "begin";
/// First level of its other events.
pub const EVENTS: &str = "events";
/// Level of commands for it.
pub const COMMAND: &str = "command";

/// Topic of a message that is retained.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Topic {
    /// Event that tells a part of the record.
    Part(Part),
    /// Document on a camera.
    Camera(u16),
    /// The last verdict.
    Verdict,
    /// The end of the stream.
    End,
}

impl Topic {
    /// Topic of an event that has lasting state.
    pub fn of(what: &What) -> Option<Self> {
        match what {
            What::Verdict { .. } => Some(Self::Verdict),
            What::End { .. } => Some(Self::End),
            what => Part::changed_by(what).map(Self::Part),
        }
    }

    /// Reads the levels below a publisher's.
    pub fn parse(levels: &str) -> Option<Self> {
        let (kind, number) = match levels.rsplit_once('/') {
            Some((kind, number)) if number.bytes().all(|byte| byte.is_ascii_digit()) => {
                (kind, Some(number.parse().ok()?))
            }
            _ => (levels, None),
        };
        Some(match (kind, number) {
            ("begin", None) => Self::Part(Part::Begin),
            ("events/network", Some(number)) => Self::Part(Part::Network(number)),
            ("events/obstacles", None) => Self::Part(Part::Obstacles),
            ("events/node", Some(id)) => Self::Part(Part::Node(id)),
            ("events/target", Some(id)) => Self::Part(Part::Target(id)),
            ("events/measured", Some(number)) => Self::Part(Part::Measured(number)),
            ("events/tracking", Some(number)) => Self::Part(Part::Tracking(number)),
            ("events/traffic", None) => Self::Part(Part::Traffic),
            ("events/verdict", None) => Self::Verdict,
            ("events/end", None) => Self::End,
            ("camera", Some(id)) => Self::Camera(id),
            _ => return None,
        })
    }
}

impl fmt::Display for Topic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Part(Part::Begin) => f.write_str(BEGIN),
            Self::Part(Part::Network(number)) => write!(f, "{EVENTS}/network/{number}"),
            Self::Part(Part::Obstacles) => write!(f, "{EVENTS}/obstacles"),
            Self::Part(Part::Node(id)) => write!(f, "{EVENTS}/node/{id}"),
            Self::Part(Part::Target(id)) => write!(f, "{EVENTS}/target/{id}"),
            Self::Part(Part::Measured(number)) => write!(f, "{EVENTS}/measured/{number}"),
            Self::Part(Part::Tracking(number)) => write!(f, "{EVENTS}/tracking/{number}"),
            Self::Part(Part::Traffic) => write!(f, "{EVENTS}/traffic"),
            Self::Camera(id) => write!(f, "camera/{id}"),
            Self::Verdict => write!(f, "{EVENTS}/verdict"),
            Self::End => write!(f, "{EVENTS}/end"),
        }
    }
}

/// The begin of a publisher's stream: the event, and what other computers need to know of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Begun {
    /// [`What::Begin`], of a record without the parts that events of their own tell.
    pub event: Event,
    /// Facts besides.
    pub besides: Besides,
}

/// Facts about a publisher.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Besides {
    /// Time of the stream's second 0, seconds since 1970.
    pub zero_unix: f64,
    /// It obeys commands.
    pub obeys: bool,
}

impl Begun {
    /// The message.
    pub(super) fn to_json(&self) -> Result<String, serde_json::Error> {
        let mut all = serde_json::to_value(&self.event)?;
        if let (Value::Object(all), Value::Object(besides)) =
            (&mut all, serde_json::to_value(self.besides)?)
        {
            all.extend(besides);
        }
        serde_json::to_string(&all)
    }

    /// Reads the message.
    ///
    /// # Errors
    /// It is none.
    pub fn from_json(text: &str) -> Result<Self, serde_json::Error> {
        Ok(Self {
            event: Event::from_line(text)?,
            besides: serde_json::from_str(text)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_are_read_as_they_are_written() {
        let parts = [
            Part::Begin,
            Part::Network(2),
            Part::Obstacles,
            Part::Node(7),
            Part::Target(65_535),
            Part::Measured(3),
            Part::Tracking(1),
            Part::Traffic,
        ];
        let topics = parts.into_iter().map(Topic::Part);
        let others = [Topic::Camera(7), Topic::Verdict, Topic::End];
        for topic in topics.chain(others) {
            assert_eq!(Topic::parse(&topic.to_string()), Some(topic));
        }
        for none in [
            "status",
            "command",
            "events/seen",
            "events/node/",
            "events/node/70000",
            "events/node/x",
        ] {
            assert_eq!(Topic::parse(none), None, "{none}");
        }
    }
}
