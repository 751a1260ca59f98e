//! What the features name, as constants: code that they exclude is checked, but not linked.

/// Whether all that a camera can send is understood, or only what tracking needs.
pub(crate) const FULL: bool = cfg!(feature = "full");
