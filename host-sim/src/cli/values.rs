//! Values of options, with messages that say what is allowed.

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
