//! Files that are read or written in one piece.

use std::{
    fs::{self, File, Metadata},
    io::{self, Read, Write},
    path::Path,
};

use anyhow::{Context, ensure};
use site::durable::{folder_of, persist};
use tracing::debug;

use super::{OfFile, errors::IS_FOLDER, file_name, files, unless_gone};

/// Writes a file in whole or not at all, so that a full disk or a loss of power leaves what was there before.
pub(super) fn write(path: &Path, bytes: impl AsRef<[u8]>) -> anyhow::Result<()> {
    let (file, bytes) = (file_name(path), bytes.as_ref());
    replace(path, bytes).with_context(|| OfFile::unwritten(path))?;
    debug!(file, bytes = bytes.len(), "written");
    Ok(())
}

fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let known = match fs::metadata(path) {
        // Whatever file it is, the text that was printed before stays.
        Ok(known) if is_open_as(&known, io::stdout()) => {
            let mut out = io::stdout().lock();
            return unless_gone(out.write_all(bytes).and_then(|()| out.flush()));
        }
        Ok(known) if is_open_as(&known, io::stderr()) => return io::stderr().write_all(bytes),
        // A device or a pipe is written to, never replaced.
        Ok(known) if !known.is_file() => return fs::write(path, bytes),
        Ok(known) => Some(known),
        Err(_) => None,
    };
    // A link stays, and points to the new file.
    let place = files::place(path);
    let Ok(mut new) = beside(&place, known.as_ref()) else {
        // The user may be allowed to write the file but not to make others in its folder.
        let mut file = File::create(path)?;
        file.write_all(bytes)?;
        return file.sync_all();
    };
    new.write_all(bytes)?;
    persist(new, &place, true)
}

/// Returns true if a file is the one that an output of this program leads to.
#[cfg(unix)]
fn is_open_as(file: &Metadata, output: impl std::os::fd::AsFd) -> bool {
    use std::os::unix::fs::MetadataExt;
    rustix::fs::fstat(output)
        .is_ok_and(|open| (open.st_dev, open.st_ino) == (file.dev(), file.ino()))
}

#[cfg(not(unix))]
fn is_open_as<T>(_: &Metadata, _: T) -> bool {
    false
}

/// A file in the same folder, with the permissions of the file that it will replace.
fn beside(place: &Path, known: Option<&Metadata>) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".host-sim-");
    #[cfg(unix)]
    if known.is_none() {
        use std::os::unix::fs::PermissionsExt;
        // Like other programs: all permissions but those that the user's mask takes away.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let new = builder.tempfile_in(folder_of(place))?;
    if let Some(known) = known {
        new.as_file().set_permissions(known.permissions())?;
    }
    Ok(new)
}

/// Refuses what is no regular file: devices may have no end, pipes may wait for ever.
pub(super) fn check_regular(path: &Path) -> anyhow::Result<()> {
    let check = || {
        let known = fs::metadata(path)?;
        check_kind(&known, known.is_file())
    };
    check().with_context(|| OfFile::unread(path))
}

/// Refuses a folder, and what is of another kind than is read.
fn check_kind(known: &Metadata, is_read: bool) -> anyhow::Result<()> {
    ensure!(!known.is_dir(), IS_FOLDER);
    ensure!(is_read, "it is no regular file");
    Ok(())
}

/// Reads a text of so many bytes at most from a file, or from a pipe as of `<(xz -dc FILE)`.
pub(super) fn read(path: &Path, most: u64) -> anyhow::Result<String> {
    read_text(path, most).with_context(|| OfFile::unread(path))
}

fn read_text(path: &Path, most: u64) -> anyhow::Result<String> {
    let check = |length| {
        ensure!(length <= most, "it has more than {most} bytes");
        Ok(())
    };
    let file: Box<dyn Read> = if path == Path::new("-") {
        Box::new(io::stdin())
    } else {
        let file = File::open(path)?;
        let known = file.metadata()?;
        check_kind(&known, known.is_file() || is_pipe(&known))?;
        check(known.len())?;
        Box::new(file)
    };
    let mut text = String::new();
    // The length of a pipe is not known before it is read.
    check(file.take(most + 1).read_to_string(&mut text)? as u64)?;
    Ok(text)
}

#[cfg(unix)]
fn is_pipe(file: &Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    file.file_type().is_fifo()
}

#[cfg(not(unix))]
fn is_pipe(_: &Metadata) -> bool {
    false
}
