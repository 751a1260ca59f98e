//! Configuration pages in files.
//!
//! A page file is a page as it stands in a board's flash, [`PAGE_MAX`] bytes; and behind it, where the node takes updates
//! by radio, the public key of these, 40 bytes. It holds the site's key, so only its owner may read it.

use std::{
    fs::File,
    io::{self, ErrorKind, Read},
    path::Path,
};

use node_firmware::config::{
    CheckedConfig,
    page::{self, PAGE_MAX, PageError},
};
use radio_update::package::{Key, key_record, read_key};
use thiserror::Error;

use crate::durable;

/// Why there is no configuration in a file, or why none was written. No message has the file's
/// name.
#[derive(Debug, Error)]
pub enum PageFileError {
    /// The operating system's answer.
    #[error("it cannot be read")]
    Read(#[source] io::Error),
    /// It is not only its owner's.
    #[error(
        "others may read it, and it holds the site's key: type `chmod 600` and its name if no one did, or change \
         the key"
    )]
    Public,
    /// Its bytes are wrong.
    #[error("it is no page for a node: {0}")]
    Page(PageError),
    /// A longer page would overwrite the flash behind it; a shorter one was cut off.
    #[error("it has {0} bytes, a page has {PAGE_MAX}: make it again with `host-sim provision`")]
    Length(usize),
    /// A page is not written over by accident.
    #[error("it exists: name another file with --out, or use --overwrite")]
    Exists,
    /// The operating system's answer.
    #[error("it was not written")]
    Write(#[source] io::Error),
}

/// Far more than a page has.
const MOST: u64 = 1 << 16;

/// Reads a page that is to be shown or flashed.
///
/// # Errors
/// [`PageFileError`]
pub fn read(path: &Path) -> Result<CheckedConfig, PageFileError> {
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(PageFileError::Read)?;
    let known = file.metadata().map_err(PageFileError::Read)?;
    // A device may have no end.
    let read = file.take(MOST).read_to_end(&mut bytes);
    read.map_err(PageFileError::Read)?;
    let config = page::decode(&bytes).map_err(PageFileError::Page)?;
    let rest = bytes.get(PAGE_MAX..).unwrap_or_default();
    let is_key = || {
        rest.as_array()
            .is_some_and(|record| read_key(record).is_some())
    };
    if bytes.len() != PAGE_MAX && !is_key() {
        return Err(PageFileError::Length(bytes.len()));
    }
    if known.is_file() && !durable::is_private(&known) {
        return Err(PageFileError::Public);
    }
    Ok(config)
}

/// Writes a page, and a key behind it, which replace a file only with `overwrite`. Returns how many of its bytes the
/// configuration takes.
///
/// # Errors
/// [`PageFileError`]
pub fn write(
    path: &Path,
    config: &CheckedConfig,
    key: Option<&Key>,
    overwrite: bool,
) -> Result<usize, PageFileError> {
    let mut bytes = vec![0; PAGE_MAX];
    let length = page::encode(config, &mut bytes).map_err(PageFileError::Page)?;
    bytes.extend(key.map(key_record).iter().flatten());
    durable::write_private(path, &bytes, overwrite).map_err(|error| match error.kind() {
        ErrorKind::AlreadyExists => PageFileError::Exists,
        _ => PageFileError::Write(error),
    })?;
    Ok(length)
}

#[cfg(test)]
mod tests {
    use node_firmware::config::{Config, CoordinatorConfig, RoleConfig, SiteKey};

    use super::*;

    #[test]
    fn a_key_for_updates_stands_behind_the_page() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("node.page.bin");
        let role = RoleConfig::Coordinator(CoordinatorConfig::default());
        let config = Config::new(7, SiteKey::new(1, *b"0123456789abcdef"), role);
        let config = config.check().unwrap();
        write(&path, &config, Some(&[5; 32]), false).unwrap();
        assert_eq!(read(&path).unwrap().settings(), config.settings());
        let bytes = std::fs::read(&path).unwrap();
        let record = bytes[PAGE_MAX..].as_array().unwrap();
        assert_eq!(read_key(record), Some([5; 32]));
        // What is changed or cut off is no key, so the file is too long for a page.
        let mut spoilt = bytes.clone();
        spoilt[PAGE_MAX + 9] ^= 1;
        for wrong in [&spoilt[..], &bytes[..bytes.len() - 1]] {
            std::fs::write(&path, wrong).unwrap();
            assert!(matches!(read(&path), Err(PageFileError::Length(_))));
        }
    }

    /// It holds the site's key, and others could change it.
    #[cfg(unix)]
    #[test]
    fn a_page_that_others_may_read_is_refused() {
        use std::os::unix::fs::PermissionsExt;

        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("node.page.bin");
        let role = RoleConfig::Coordinator(CoordinatorConfig::default());
        let config = Config::new(7, SiteKey::new(1, *b"0123456789abcdef"), role);
        write(&path, &config.check().unwrap(), None, false).unwrap();
        for (mode, is_refused) in [(0o600, false), (0o640, true), (0o602, true)] {
            std::fs::set_permissions(&path, PermissionsExt::from_mode(mode)).unwrap();
            let refused = matches!(read(&path), Err(PageFileError::Public));
            assert_eq!(refused, is_refused, "{mode:o}");
        }
    }
}
