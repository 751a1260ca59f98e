//! Files that hold a key: only their owner may read them.

use std::{
    io::{self, Write},
    path::Path,
};

use tempfile::NamedTempFile;

/// Writes a file in whole or not at all. One that exists is replaced or, without `overwrite`, an
/// error.
pub(crate) fn write(path: &Path, contents: &[u8], overwrite: bool) -> io::Result<()> {
    let folder = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    // Temporary files are made for their owner alone.
    let mut file = NamedTempFile::new_in(folder)?;
    file.write_all(contents)?;
    file.as_file().sync_all()?;
    let written = match overwrite {
        true => file.persist(path),
        false => file.persist_noclobber(path),
    };
    written.map(drop).map_err(|failed| failed.error)
}
