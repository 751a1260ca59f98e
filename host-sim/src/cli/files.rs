//! All files of a command, known before any is written: the files that it reads stay, and no result
//! takes another one's place.

use std::{
    fs::{self, File, Metadata, OpenOptions},
    io::ErrorKind,
    path::{self, Component, Path, PathBuf},
};

use anyhow::{Context, bail, ensure};
use site::durable::folder_of;

use super::{
    OfFile,
    errors::{IS_FOLDER, file_in_the_way},
    file_name,
};

/// Links that are followed from one to the next.
const LINKS_MAX: usize = 40;

/// Files that a command reads and that it writes.
#[derive(Default)]
pub(super) struct Files<'a> {
    read: Vec<&'a Path>,
    written: Vec<&'a Path>,
    /// Folders, which may have to be made, with the names of files in them.
    folders: Vec<(&'a Path, &'a [&'a str])>,
}

impl<'a> Files<'a> {
    /// Files that are read, or devices that are used; `-` is the standard input.
    pub(super) fn reads<P: AsRef<Path> + ?Sized + 'a>(
        mut self,
        files: impl IntoIterator<Item = &'a P>,
    ) -> Self {
        self.read.extend(files.into_iter().map(AsRef::as_ref));
        self
    }

    /// Results.
    pub(super) fn writes(mut self, files: impl IntoIterator<Item = &'a PathBuf>) -> Self {
        self.written.extend(files.into_iter().map(PathBuf::as_path));
        self
    }

    /// Results of these names in a folder.
    pub(super) fn writes_into(
        mut self,
        folder: impl IntoIterator<Item = &'a PathBuf>,
        names: &'a [&'a str],
    ) -> Self {
        let folder = folder.into_iter().map(|folder| (folder.as_path(), names));
        self.folders.extend(folder);
        self
    }

    /// Refuses results that cannot be written, and those that would replace or block one another
    /// or a file that is read. Changes nothing.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        let read: Vec<_> = self.read.iter().map(|file| Known::of(file)).collect();
        let mut seen = Vec::new();
        for file in &self.written {
            check_file(file)?;
            check_apart(file, &read, &mut seen)?;
        }
        for &(folder, names) in &self.folders {
            let files: Vec<_> = names.iter().map(|name| folder.join(name)).collect();
            for file in &files {
                check_apart(file, &read, &mut seen)?;
            }
            check_folder(folder)?;
            if folder.is_dir() {
                files.iter().try_for_each(|file| check_file(file))?;
            }
        }
        Ok(())
    }
}

/// Refuses a file that is named twice among those that are read, whatever it is called.
pub(super) fn check_different(files: &[PathBuf]) -> anyhow::Result<()> {
    let known: Vec<_> = files.iter().map(|file| Known::of(file)).collect();
    for (number, (file, it)) in files.iter().zip(&known).enumerate() {
        let is_new = !known.iter().take(number).any(|other| other.is(it));
        let name = file_name(file);
        ensure!(is_new, "{name} is named twice: leave one out");
    }
    Ok(())
}

/// A file, whatever it is called.
struct Known {
    place: PathBuf,
    /// Device and number there, if it is there: the same for all of its names.
    number: Option<(u64, u64)>,
    /// Devices and pipes can be read and written at once: a terminal is.
    is_terminal: bool,
}

impl Known {
    fn of(file: &Path) -> Self {
        let found = match file == Path::new("-") {
            true => standard_input(),
            false => fs::metadata(file).ok(),
        };
        Self {
            place: place(file),
            number: found.as_ref().and_then(number),
            is_terminal: file == Path::new("-") && found.is_none_or(|found| !found.is_file()),
        }
    }

    fn is(&self, other: &Self) -> bool {
        self.place == other.place || self.number.is_some() && self.number == other.number
    }
}

#[cfg(unix)]
fn number(found: &Metadata) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    Some((found.dev(), found.ino()))
}

#[cfg(not(unix))]
fn number(_: &Metadata) -> Option<(u64, u64)> {
    None
}

/// The file that the standard input comes from.
fn standard_input() -> Option<Metadata> {
    fs::metadata("/dev/stdin").ok()
}

/// Adds a result to those seen, if it can be written beside them and beside the files that are read.
fn check_apart(file: &Path, read: &[Known], seen: &mut Vec<Known>) -> anyhow::Result<()> {
    let it = Known::of(file);
    let name = file_name(file);
    ensure!(
        !read.iter().any(|input| !input.is_terminal && input.is(&it)),
        "{name} is read, and would be replaced by a result: name another file for that"
    );
    for other in &*seen {
        ensure!(
            !other.is(&it),
            "{name} is named for two results: give each its own file"
        );
        ensure!(
            !other.place.starts_with(&it.place) && !it.place.starts_with(&other.place),
            "{name} cannot be written beside {}: one of them would have to be a file and a folder",
            file_name(&other.place)
        );
    }
    seen.push(it);
    Ok(())
}

/// Place where a file is or will be: the same for all of its names.
pub(super) fn place(file: &Path) -> PathBuf {
    let mut place = resolved(file);
    // The rest are links to files that do not exist yet.
    for _ in 0..LINKS_MAX {
        let Ok(target) = fs::read_link(&place) else {
            break;
        };
        place = resolved(&folder_of(&place).join(target));
    }
    place
}

/// The part that exists by its only name, and the rest.
fn resolved(file: &Path) -> PathBuf {
    let file = path::absolute(file).unwrap_or_else(|_| file.to_owned());
    let existing = file
        .ancestors()
        .find_map(|part| Some((part, part.canonicalize().ok()?)));
    let Some((part, mut place)) = existing else {
        return file;
    };
    for component in file
        .strip_prefix(part)
        .into_iter()
        .flat_map(Path::components)
    {
        match component {
            Component::ParentDir => {
                place.pop();
            }
            component => place.push(component),
        }
    }
    place
}

fn check_file(file: &Path) -> anyhow::Result<()> {
    try_file(file).with_context(|| OfFile::unwritten(file))
}

fn try_file(file: &Path) -> anyhow::Result<()> {
    match fs::metadata(file) {
        Ok(found) if found.is_dir() => bail!(IS_FOLDER),
        Ok(found) if found.is_file() => {
            OpenOptions::new().append(true).open(file)?;
            Ok(())
        }
        // A device or a pipe: an attempt to open it would disturb it.
        Ok(_) => Ok(()),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let folder = folder_of(file);
            ensure!(folder.is_dir(), error);
            try_folder(folder)
        }
        Err(error) => Err(error.into()),
    }
}

/// Refuses a folder that can neither be written into nor be made.
fn check_folder(folder: &Path) -> anyhow::Result<()> {
    let mut existing = folder;
    while !existing.exists() {
        existing = folder_of(existing);
    }
    let checked = match file_in_the_way(existing) {
        Some(why) => Err(anyhow::anyhow!(why)),
        None => try_folder(existing),
    };
    checked.with_context(|| format!("nothing can be written into {}", file_name(folder)))
}

/// Makes a file there that has no name and goes away at once.
fn try_folder(folder: &Path) -> anyhow::Result<()> {
    let _: File = tempfile::tempfile_in(folder)?;
    Ok(())
}
