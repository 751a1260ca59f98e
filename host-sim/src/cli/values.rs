//! Values of options, with messages that tell which values are allowed.

use std::{fmt, net::IpAddr, num::NonZeroUsize, path::PathBuf, str::FromStr, time::Duration};

use clap::builder::{PathBufValueParser, TypedValueParser};
use site::{PATH_MAX, ScatterTable};

/// All scenarios of a sweep are in memory.
const MOST_SEEDS: u64 = 100_000;

/// File for a result. `-` would become a file of that name, which the user does not expect.
pub(super) fn result() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| {
        if path.as_os_str() == "-" {
            Err("name a file; /dev/stdout is the screen")
        } else {
            Ok(path)
        }
    })
}

/// A whole number in this range.
pub(super) fn whole<T>(least: T, most: T) -> impl Fn(&str) -> Result<T, String> + Clone
where
    T: FromStr + PartialOrd + fmt::Display + Copy,
{
    move |text| match text.parse() {
        Ok(number) if (least..=most).contains(&number) => Ok(number),
        _ => Err(format!("a whole number from {least} to {most} is needed")),
    }
}

/// An address of this computer.
pub(super) fn address(text: &str) -> Result<IpAddr, String> {
    let needed = |_| {
        "an address of this computer is needed, such as 127.0.0.1 for itself alone, or 0.0.0.0 for all that it has"
            .to_owned()
    };
    text.parse().map_err(needed)
}

/// A count.
pub(super) fn count(text: &str) -> Result<usize, String> {
    let needed = |_| "a whole number is needed, such as 3".to_owned();
    text.parse().map_err(needed)
}

/// Number of jobs at a time.
pub(super) fn jobs(text: &str) -> Result<NonZeroUsize, String> {
    let needed = |_| "a whole number from 1 is needed".to_owned();
    text.parse().map_err(needed)
}

/// The root of randomness.
pub(super) fn seed(text: &str) -> Result<u64, String> {
    let needed = |_| format!("a whole number from 0 to {} is needed", u64::MAX);
    text.parse().map_err(needed)
}

/// A finite number.
pub(super) fn finite(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err("a number is needed, such as 0.5".to_owned()),
    }
}

/// A finite number above zero.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    match finite(text) {
        Ok(value) if value > 0.0 => Ok(value),
        _ => Err("a number above 0 is needed, such as 0.5".to_owned()),
    }
}

/// A finite number, zero or above.
pub(super) fn not_negative(text: &str) -> Result<f64, String> {
    match finite(text) {
        Ok(value) if value >= 0.0 => Ok(value),
        _ => Err("0 or a number above it is needed, such as 0.5".to_owned()),
    }
}

/// Scatter of cameras around their places in a file, in the unit and in degrees.
pub(super) fn scatter(text: &str) -> Result<ScatterTable, String> {
    let none = (text == "0").then_some(("0", "0"));
    let (position, heading) = text.split_once(',').or(none).unwrap_or((text, ""));
    match [position, heading].map(not_negative) {
        [Ok(position), Ok(heading_deg)] => Ok(ScatterTable {
            position,
            heading_deg,
        }),
        _ => Err("a length and degrees are needed, such as 0.3,3; or 0".to_owned()),
    }
}

/// A node's number and the path of a serial port.
pub(super) fn port(text: &str) -> Result<(u16, String), String> {
    text.split_once('=')
        .and_then(|(node, path)| Some((node.parse().ok()?, path.to_owned())))
        .filter(|(_, path)| !path.is_empty())
        .ok_or_else(|| "a node and its port are needed, such as 3=/dev/ttyUSB0".to_owned())
}

/// A node, and a port for GDB: `NODE`, or `NODE:PORT`.
pub(super) fn gdb(text: &str) -> Result<(u16, Option<u16>), String> {
    let (node, port) = match text.split_once(':') {
        Some((node, port)) => (node, Some(port)),
        None => (text, None),
    };
    let port = port.map(|port| port.parse().ok().filter(|port| *port > 0));
    match (node.parse(), port) {
        (Ok(node), None) => Ok((node, None)),
        (Ok(node), Some(Some(port))) => Ok((node, Some(port))),
        _ => Err(
            "a node is needed, such as 3, or with a port from 1 to 65535, such as 3:3334"
                .to_owned(),
        ),
    }
}

/// The link of a network's console: `PTY`, or `N:PTY`.
pub(super) fn console(text: &str) -> Result<(usize, PathBuf), String> {
    let numbered = text.split_once(':');
    let numbered = numbered.and_then(|(network, link)| Some((network.parse().ok()?, link)));
    let (network, link) = numbered.unwrap_or((1, text));
    match (network, link.is_empty()) {
        (1.., false) => Ok((network, link.into())),
        _ => Err("the name of a link is needed, such as `site.pty`, or 2:site.pty".to_owned()),
    }
}

/// Something that is either known or to be found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known(pub(super) Option<f64>);

impl Known {
    const UNKNOWN: &str = "unknown";

    /// A length above zero, or `unknown`.
    pub(super) fn length(text: &str) -> Result<Self, String> {
        Self::parse(text, positive)
    }

    /// An angle, or `unknown`.
    pub(super) fn angle(text: &str) -> Result<Self, String> {
        Self::parse(text, finite)
    }

    fn parse(text: &str, value: fn(&str) -> Result<f64, String>) -> Result<Self, String> {
        if text == Self::UNKNOWN {
            return Ok(Self(None));
        }
        match value(text) {
            Ok(value) => Ok(Self(Some(value))),
            Err(why) => Err(format!("{why}, or `{}`", Self::UNKNOWN)),
        }
    }
}

/// The numbers of two cameras.
pub(super) fn two_cameras(text: &str) -> Result<[u16; 2], String> {
    let two = text.split_once(',').and_then(|(first, second)| {
        let number = |text: &str| text.trim().parse().ok();
        Some([number(first)?, number(second)?])
    });
    two.filter(|[first, second]| first != second)
        .ok_or_else(|| "the numbers of two cameras are needed, such as 1,2".to_owned())
}

/// Speed of a simulation: so many times real time, or as fast as it can.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Speed(pub(super) Option<f64>);

/// `max`, `real-time`, `10x`.
pub(super) fn speed(text: &str) -> Result<Speed, String> {
    let times = match text {
        "max" => return Ok(Speed(None)),
        "real-time" => Some(1.0),
        other => other
            .strip_suffix('x')
            .and_then(|times| times.parse::<f64>().ok()),
    };
    match times {
        Some(times) if times > 0.0 && times.is_finite() => Ok(Speed(Some(times))),
        _ => Err("give max, real-time, or a number above 0 with an x, such as 10x".to_owned()),
    }
}

/// A share, 0 to 1.
pub(super) fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("give a number from 0 to 1".to_owned()),
    }
}

/// Number of a planned way.
pub(super) fn path(text: &str) -> Result<u64, String> {
    match text.parse() {
        Ok(path @ 1..=PATH_MAX) => Ok(path),
        _ => Err(format!("give a number from 1 to {PATH_MAX}")),
    }
}

/// A time in seconds, above zero.
pub(super) fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = positive(text)?;
    Duration::try_from_secs_f64(seconds).map_err(|_| "give fewer seconds, such as 60".to_owned())
}

/// Seeds of a sweep, both ends included.
pub(super) type Seeds = std::ops::RangeInclusive<u64>;

/// `1..50`
pub(super) fn seeds(text: &str) -> Result<Seeds, String> {
    let ends = text.split_once("..").and_then(|(first, last)| {
        let ends: (u64, u64) = (first.parse().ok()?, last.parse().ok()?);
        (ends.0 <= ends.1).then_some(ends)
    });
    match ends {
        Some((first, last)) if last - first >= MOST_SEEDS => {
            Err(format!("give at most {MOST_SEEDS} seeds at once"))
        }
        Some((first, last)) => Ok(first..=last),
        None => Err("give the first and the last seed, such as 1..50".to_owned()),
    }
}
