//! Files that are written after a long run: whether they can be, before it.

use std::{
    cell::RefCell,
    fs::{self, File, OpenOptions},
    io::{self, BufWriter, ErrorKind, Write},
    mem,
    path::{self, Component, Path, PathBuf},
    rc::Rc,
};

use anyhow::{Context, bail, ensure};

use super::file_name;

/// Links that are followed from one to the next.
const LINKS_MAX: usize = 40;

/// Refuses files that cannot be written, and those of which one would replace or block another.
/// Besides, there are files of these names in a folder, which may have to be made. Changes nothing.
pub(super) fn check(files: &[&Path], folder: Option<(&Path, &[&str])>) -> anyhow::Result<()> {
    let mut seen = Vec::new();
    for file in files {
        check_apart(file, &mut seen)?;
        check_file(file).with_context(|| format!("{} cannot be written", file_name(file)))?;
    }
    let Some((folder, names)) = folder else {
        return Ok(());
    };
    for name in names {
        check_apart(&folder.join(name), &mut seen)?;
    }
    check_folder(folder)?;
    for file in names.iter().map(|name| folder.join(name)) {
        if folder.is_dir() {
            check_file(&file).with_context(|| format!("{} cannot be written", file_name(&file)))?;
        }
    }
    Ok(())
}

/// Adds a file to those that were seen, if it can be written beside them.
fn check_apart(file: &Path, seen: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    let place = place(file);
    for other in &*seen {
        ensure!(
            *other != place,
            "{} is named for two results: give each its own file",
            file_name(file)
        );
        ensure!(
            !other.starts_with(&place) && !place.starts_with(other),
            "{} cannot be written beside {}: one of them would have to be a file and a folder",
            file_name(file),
            file_name(other)
        );
    }
    seen.push(place);
    Ok(())
}

/// Where a file is or will be: the same for all of its names.
pub(super) fn place(file: &Path) -> PathBuf {
    let mut place = resolved(file);
    // Left are links to what is not there yet.
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
    match fs::metadata(file) {
        Ok(found) if found.is_dir() => bail!("it is a folder"),
        Ok(found) if found.is_file() => {
            OpenOptions::new().append(true).open(file)?;
            Ok(())
        }
        // A device or a pipe, which trying would disturb.
        Ok(_) => Ok(()),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let folder = folder_of(file);
            ensure!(
                folder.is_dir(),
                "there is no folder {}: make it first",
                file_name(folder)
            );
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
    let checked = if existing.is_dir() {
        try_folder(existing)
    } else {
        Err(anyhow::anyhow!("{} is no folder", file_name(existing)))
    };
    checked.with_context(|| format!("nothing can be written into {}", file_name(folder)))
}

/// Makes a file there that has no name and goes away at once.
fn try_folder(folder: &Path) -> anyhow::Result<()> {
    tempfile::tempfile_in(folder)?;
    Ok(())
}

pub(super) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// A file that is made when something is written to it: not for a run that cannot begin. After an
/// error it takes nothing more.
#[derive(Clone)]
pub(super) struct Late {
    path: PathBuf,
    /// Of all clones.
    state: Rc<RefCell<State>>,
}

enum State {
    NotMade,
    Open(BufWriter<File>),
    Failed(io::Error),
}

impl Late {
    pub(super) fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            state: Rc::new(RefCell::new(State::NotMade)),
        }
    }

    /// Writes what is left, and tells what went wrong first.
    pub(super) fn finish(mut self) -> anyhow::Result<()> {
        // It is in the state.
        let _ = self.flush();
        if let State::Failed(error) = &mut *self.state.borrow_mut() {
            let kind = error.kind();
            return Err(mem::replace(error, kind.into()))
                .with_context(|| format!("{} cannot be written", file_name(&self.path)));
        }
        Ok(())
    }

    fn attempt<T>(
        &self,
        what: impl FnOnce(&mut BufWriter<File>) -> io::Result<T>,
    ) -> io::Result<T> {
        let mut state = self.state.borrow_mut();
        if let State::NotMade = *state {
            *state = match File::create(&self.path) {
                Ok(file) => State::Open(BufWriter::new(file)),
                Err(error) => State::Failed(error),
            };
        }
        let done = match &mut *state {
            State::Open(file) => what(file),
            State::Failed(error) => return Err(error.kind().into()),
            State::NotMade => return Err(ErrorKind::NotFound.into()),
        };
        done.map_err(|error| {
            let kind = error.kind();
            if kind != ErrorKind::Interrupted {
                *state = State::Failed(error);
            }
            kind.into()
        })
    }
}

impl Write for Late {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.attempt(|file| file.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        if let State::NotMade = *self.state.borrow() {
            return Ok(());
        }
        self.attempt(BufWriter::flush)
    }
}
