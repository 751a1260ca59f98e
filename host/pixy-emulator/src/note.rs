//! Requests and their answers, for who watches.

use std::fmt;

use super::{ERROR, wire::Request};

/// A request that has come, and what was answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// It.
    pub request: Request,
    /// Type and payload; `None` while the camera starts.
    pub answer: Option<(u8, Vec<u8>)>,
}

/// As the maker's library calls it.
fn name(kind: u8) -> &'static str {
    match kind {
        0x02 => "changeProg",
        0x0C => "getResolution",
        0x0E => "getVersion",
        0x10 => "setCameraBrightness",
        0x12 => "setServos",
        0x14 => "setLED",
        0x16 => "setLamp",
        0x18 => "getFPS",
        0x20 => "getBlocks",
        0x30 => "getFeatures",
        0x70 => "getRGB",
        _ => "unknown",
    }
}

/// An error as the maker's firmware calls it.
fn error(why: i8) -> &'static str {
    match why {
        -2 => "busy",
        -3 => "invalid request",
        -4 => "type unsupported",
        _ => "error",
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Request { kind, payload } = &self.request;
        write!(f, "{} ({kind:#04x})", name(*kind))?;
        payload.iter().try_for_each(|byte| write!(f, " {byte}"))?;
        match &self.answer {
            None => f.write_str(": not heard, for it starts"),
            Some((ERROR, payload)) => {
                let why = payload.first().copied().unwrap_or_default().cast_signed();
                write!(f, ": refused, {why} ({})", error(why))
            }
            Some((0x21, payload)) => write!(f, ": {} blocks", payload.len() / 14),
            Some((_, payload)) => {
                f.write_str(": answered")?;
                payload.iter().try_for_each(|byte| write!(f, " {byte}"))
            }
        }
    }
}
