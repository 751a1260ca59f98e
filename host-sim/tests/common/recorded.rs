//! Files of the repository's recorded data.

/// A file of the repository's recorded data.
pub(crate) fn data(name: &str) -> String {
    format!("{}/../tests/data/{name}", env!("CARGO_MANIFEST_DIR"))
}
