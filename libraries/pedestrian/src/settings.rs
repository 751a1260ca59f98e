//! Errors of settings.

use core::fmt;

/// A setting is out of the range its documentation gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct InvalidSetting {
    /// The field's name.
    pub name: &'static str,
}

impl fmt::Display for InvalidSetting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the setting {} is out of its range", self.name)
    }
}

impl core::error::Error for InvalidSetting {}

/// `Ok` if every one of the named conditions holds.
pub(crate) fn require(conditions: &[(bool, &'static str)]) -> Result<(), InvalidSetting> {
    match conditions.iter().find(|(holds, _)| !holds) {
        Some(&(_, name)) => Err(InvalidSetting { name }),
        None => Ok(()),
    }
}
