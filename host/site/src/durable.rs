//! Files that are whole and stay, even if the power goes at once.

use std::{
    fs::{File, Metadata},
    io::{self, ErrorKind, Write},
    path::Path,
};

use tempfile::NamedTempFile;

/// Folder that holds a file.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Gives a written file of the same folder its name, once its bytes are on the disk. A file of that name is
/// replaced or, without `overwrite`, an error.
///
/// # Errors
/// Those of the operating system. The file of that name is then as it was, unless only the folder could not be
/// written to the disk.
pub fn persist(file: NamedTempFile, path: &Path, overwrite: bool) -> io::Result<()> {
    file.as_file().sync_all()?;
    let written = match overwrite {
        true => file.persist(path),
        false => file.persist_noclobber(path),
    };
    written.map_err(|failed| failed.error)?;
    sync_folder(folder_of(path))
}

/// Waits until the names in a folder are on the disk.
///
/// # Errors
/// Those of the operating system.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    // Other systems do not open folders, and keep names by themselves.
    if !cfg!(unix) {
        return Ok(());
    }
    match File::open(folder).and_then(|folder| folder.sync_all()) {
        // Some file systems have nothing to wait for, and some folders can be written but not read.
        Err(error)
            if matches!(
                error.kind(),
                ErrorKind::InvalidInput | ErrorKind::Unsupported | ErrorKind::PermissionDenied
            ) =>
        {
            Ok(())
        }
        done => done,
    }
}

/// Returns true if only its owner may read or write a file, as far as the system tells.
#[cfg_attr(
    not(unix),
    expect(unused_variables, reason = "other systems do not tell")
)]
pub(crate) fn is_private(known: &Metadata) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        known.permissions().mode() & 0o077 == 0
    }
    #[cfg(not(unix))]
    true
}

/// Writes a file that only its owner may read, in whole or not at all. One that exists is replaced or, without
/// `overwrite`, an error.
pub fn write_private(path: &Path, contents: &[u8], overwrite: bool) -> io::Result<()> {
    // Temporary files are made for their owner alone.
    let mut file = NamedTempFile::new_in(folder_of(path))?;
    file.write_all(contents)?;
    persist(file, path, overwrite)
}
