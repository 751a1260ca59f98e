//! The features as constants: code that they exclude is checked, but not linked.

/// True if all that a camera can send is understood, false if only the part that tracking needs is.
pub(crate) const FULL: bool = cfg!(feature = "full");
