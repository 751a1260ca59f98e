//! Where the files of boards are.
//!
//! A run has one folder for all of its boards, which vanishes with it. Two kinds stay behind: that
//! of a run that was killed, and that of a run whose emulator failed, for people to look at. The
//! next run removes both. It knows them by the lock that nobody holds any more.

use std::{
    env,
    fs::{self, File},
    io,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
};

use tempfile::TempDir;

/// What the names of these folders begin with.
const PREFIX: &str = "host-sim-boards-";
/// A file in each of them, locked as long as somebody uses it.
const LOCK: &str = "lock";
/// Its name until it is locked.
const NEW_LOCK: &str = "lock.new";

/// A folder for the files of boards.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    is_kept: AtomicBool,
    /// Held by being open.
    _lock: File,
}

impl Folder {
    /// A new one, among the temporary files. Those that nobody uses any more are removed.
    pub(super) fn new() -> io::Result<Self> {
        Self::within(&env::temp_dir())
    }

    fn within(parent: &Path) -> io::Result<Self> {
        remove_abandoned(parent)?;
        let folder = TempDir::with_prefix_in(PREFIX, parent)?;
        let new = folder.path().join(NEW_LOCK);
        let lock = File::create_new(&new)?;
        lock.lock()?;
        // Nobody ever sees it unlocked.
        fs::rename(new, folder.path().join(LOCK))?;
        Ok(Self {
            path: folder.keep(),
            is_kept: AtomicBool::new(false),
            _lock: lock,
        })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Leaves it for people to look at.
    pub(super) fn keep(&self) {
        self.is_kept.store(true, Ordering::Relaxed);
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if !*self.is_kept.get_mut() {
            // What cannot be removed now is for the next run.
            let _ = remove(&self.path);
        }
    }
}

fn remove_abandoned(parent: &Path) -> io::Result<()> {
    for entry in fs::read_dir(parent)? {
        let Ok(entry) = entry else { continue };
        let is_ours = entry.file_name().to_string_lossy().starts_with(PREFIX);
        if is_ours && is_abandoned(&entry.path()) {
            // Another run may be at it too.
            let _ = remove(&entry.path());
        }
    }
    Ok(())
}

/// The lock goes last: a folder that is left half empty can still be told for one that nobody uses.
fn remove(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_name() == LOCK {
            continue;
        }
        if entry.file_type()?.is_dir() {
            fs::remove_dir_all(entry.path())?;
        } else {
            fs::remove_file(entry.path())?;
        }
    }
    fs::remove_file(folder.join(LOCK))?;
    fs::remove_dir(folder)
}

/// Whether it is certain that nobody uses it. Another user's is not ours to judge.
fn is_abandoned(folder: &Path) -> bool {
    let lock = folder.join(LOCK);
    // Opening a pipe would wait for its other end.
    fs::symlink_metadata(&lock).is_ok_and(|found| found.is_file())
        && File::open(lock).is_ok_and(|lock| lock.try_lock().is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(parent: &Path) -> Vec<String> {
        let entries = fs::read_dir(parent).unwrap();
        entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    #[test]
    fn what_nobody_uses_any_more_is_removed_by_the_next() {
        let parent = tempfile::tempdir().unwrap();
        let parent = parent.path();
        fs::create_dir(parent.join("other")).unwrap();
        fs::create_dir(parent.join(format!("{PREFIX}without-lock"))).unwrap();
        // As a killed run leaves it: its lock is released by the operating system.
        let killed = parent.join(format!("{PREFIX}killed"));
        fs::create_dir(&killed).unwrap();
        fs::write(killed.join(LOCK), "").unwrap();
        fs::create_dir(killed.join("3")).unwrap();
        fs::write(killed.join("3/flash.bin"), "").unwrap();

        let first = Folder::within(parent).unwrap();
        assert!(!killed.exists());
        let second = Folder::within(parent).unwrap();
        assert!(first.path().exists(), "it is in use");
        first.keep();
        let kept = first.path().to_owned();
        drop(first);
        assert!(kept.exists());
        let third = Folder::within(parent).unwrap();
        assert!(!kept.exists());
        drop((second, third));
        assert_eq!(names(parent).len(), 2, "{:?}", names(parent));
    }

    #[test]
    fn a_lock_that_is_no_file_is_nobodys() {
        let folder = tempfile::tempdir().unwrap();
        let lock = folder.path().join(LOCK);
        let made = std::process::Command::new("mkfifo").arg(&lock).status();
        assert!(made.unwrap().success());
        assert!(!is_abandoned(folder.path()));
        fs::remove_file(&lock).unwrap();
        fs::write(&lock, "").unwrap();
        assert!(is_abandoned(folder.path()));
    }
}
