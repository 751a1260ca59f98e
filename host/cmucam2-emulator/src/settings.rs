//! Structs of named numbers that can be listed and set by name.

use std::fmt;

/// One number of such a struct.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting<T> {
    /// Its name, for options.
    pub name: &'static str,
    /// Its meaning.
    pub meaning: &'static str,
    /// Its value unless set.
    pub default: T,
    /// The greatest value; the least is 0.
    pub greatest: T,
}

/// Reason why a setting was not set.
#[derive(Clone, Debug, PartialEq)]
pub enum SettingError {
    /// There is none of that name.
    Unknown {
        /// The name.
        name: String,
        /// Those there are.
        names: Vec<&'static str>,
    },
    /// The value is not one of those it can have.
    Value {
        /// The setting.
        name: &'static str,
        /// Its greatest value, as text.
        greatest: String,
    },
    /// Not of the form `NAME=VALUE`.
    Form,
}

impl fmt::Display for SettingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown { name, names } => {
                write!(f, "there is no `{name}`; there are {}", names.join(", "))
            }
            Self::Value { name, greatest } => write!(f, "`{name}` must be 0 to {greatest}"),
            Self::Form => f.write_str("the form is NAME=VALUE"),
        }
    }
}

impl std::error::Error for SettingError {}

/// Splits `NAME=VALUE`.
///
/// # Errors
/// [`SettingError::Form`].
pub(super) fn split(text: &str) -> Result<(&str, &str), SettingError> {
    text.split_once('=').ok_or(SettingError::Form)
}

/// Declares a struct of numbers with defaults, and a table of them.
macro_rules! settings {
    (
        $(#[$outer:meta])*
        pub struct $name:ident of $number:ty {
            $(
                $(#[doc = $meaning:literal])+
                $field:ident = $default:literal, up to $greatest:literal;
            )+
        }
    ) => {
        $(#[$outer])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name {
            $(
                $(#[doc = $meaning])+
                pub $field: $number,
            )+
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $default,)+ }
            }
        }

        impl $name {
            /// All of them, in their order here.
            pub const TABLE: &[$crate::Setting<$number>] = &[
                $($crate::Setting {
                    name: stringify!($field),
                    meaning: concat!($($meaning,)+),
                    default: $default,
                    greatest: $greatest,
                },)+
            ];

            /// Sets one by its name.
            ///
            /// # Errors
            /// An unknown name, or a value that it cannot have.
            pub fn set(
                &mut self,
                name: &str,
                value: $number,
            ) -> Result<(), $crate::SettingError> {
                match name {
                    $(stringify!($field) => {
                        if !(0 as $number..=$greatest).contains(&value) {
                            return Err($crate::SettingError::Value {
                                name: stringify!($field),
                                greatest: $greatest.to_string(),
                            });
                        }
                        self.$field = value;
                        Ok(())
                    })+
                    _ => Err($crate::SettingError::Unknown {
                        name: name.to_owned(),
                        names: Self::TABLE.iter().map(|setting| setting.name).collect(),
                    }),
                }
            }

            /// Sets one from `NAME=VALUE`.
            ///
            /// # Errors
            /// As [`Self::set`], or another form.
            pub fn set_from(&mut self, text: &str) -> Result<(), $crate::SettingError> {
                let (name, value) = $crate::settings::split(text)?;
                // A value that cannot be read lies outside of every range.
                self.set(name, value.parse().unwrap_or(<$number>::MAX))
            }
        }
    };
}
pub(super) use settings;
