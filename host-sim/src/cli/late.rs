//! Files that grow while a command works.

use std::{
    cell::RefCell,
    fs::File,
    io::{self, ErrorKind, Write},
    mem,
    path::{Path, PathBuf},
    rc::Rc,
};

use anyhow::Context;
use site::durable::{folder_of, sync_folder};
use tracing::{debug, error};

use super::{OfFile, file_name};

/// A file that is made at the first write: a run that cannot begin makes none. Each write goes to
/// the file at once, so that whole lines and packets are there however the program ends. After an
/// error it takes nothing more.
#[derive(Clone)]
pub(super) struct Late {
    path: PathBuf,
    /// Of all clones.
    state: Rc<RefCell<State>>,
}

enum State {
    NotMade,
    Open(File),
    Failed(io::Error),
}

impl Late {
    pub(super) fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            state: Rc::new(RefCell::new(State::NotMade)),
        }
    }

    /// Waits until all is on the disk. Returns the first error.
    pub(super) fn finish(self) -> anyhow::Result<()> {
        let done = match &mut *self.state.borrow_mut() {
            State::NotMade => Ok(()),
            State::Open(file) => self.keep(file),
            State::Failed(error) => {
                let kind = error.kind();
                Err(mem::replace(error, kind.into()))
            }
        };
        done.with_context(|| OfFile::unwritten(&self.path))
    }

    /// State after an error. It is told at once, for the end of the command may be months away.
    fn failed(&self, error: io::Error) -> State {
        let file = file_name(&self.path);
        error!(file, "cannot be written, and gets nothing more: {error}");
        State::Failed(error)
    }

    fn keep(&self, file: &File) -> io::Result<()> {
        // Pipes and devices keep nothing.
        if !file.metadata()?.is_file() {
            return Ok(());
        }
        file.sync_all()?;
        sync_folder(folder_of(&self.path))
    }
}

impl Write for Late {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut state = self.state.borrow_mut();
        if let State::NotMade = *state {
            *state = match File::create(&self.path) {
                Ok(file) => {
                    debug!(file = file_name(&self.path), "begins to be written");
                    State::Open(file)
                }
                Err(error) => self.failed(error),
            };
        }
        let done = match &mut *state {
            State::Open(file) => file.write(bytes),
            State::Failed(error) => return Err(error.kind().into()),
            State::NotMade => return Err(ErrorKind::NotFound.into()),
        };
        done.map_err(|error| {
            let kind = error.kind();
            if kind != ErrorKind::Interrupted {
                *state = self.failed(error);
            }
            kind.into()
        })
    }

    /// There is nothing left to do.
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
