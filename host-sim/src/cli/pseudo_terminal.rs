//! The end of a pseudo-terminal that plays the device.

use std::{
    collections::VecDeque,
    fs, io,
    os::{
        fd::OwnedFd,
        unix::{ffi::OsStrExt, fs::symlink},
    },
    path::{Path, PathBuf},
    time::Duration,
};

use anyhow::{Context, bail};
use rustix::{
    event::{PollFd, PollFlags, poll},
    fs::{Mode, OFlags, fcntl_setfl},
    io::Errno,
    pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt},
    termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr},
};

use super::OfFile;

/// Time between two looks whether a program has opened the device.
const LOOK: Duration = Duration::from_millis(5);

/// A pseudo-terminal, and a link to the device that other programs open. The link is removed when
/// this is dropped.
pub(super) struct PseudoTerminal {
    master: OwnedFd,
    device: PathBuf,
    link: PathBuf,
    /// A program has it open.
    connected: bool,
    /// Bytes that came and were not read yet.
    received: VecDeque<u8>,
}

impl PseudoTerminal {
    /// A pair whose device is raw (nothing is echoed or translated) and at this rate.
    pub(super) fn open(link: &Path, baud: u32) -> anyhow::Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)
            .context("no pseudo-terminal")?;
        grantpt(&master).context("no pseudo-terminal")?;
        unlockpt(&master).context("no pseudo-terminal")?;
        let name = ptsname(&master, Vec::new()).context("no pseudo-terminal")?;
        let device = PathBuf::from(std::ffi::OsStr::from_bytes(name.as_bytes()));
        // Until the device was opened once, a closed one cannot be told from one never opened.
        let slave = rustix::fs::open(&device, OFlags::RDWR | OFlags::NOCTTY, Mode::empty())
            .with_context(|| format!("{} cannot be opened", device.display()))?;
        let mut modes = tcgetattr(&slave)?;
        modes.make_raw();
        modes.set_speed(baud)?;
        tcsetattr(&slave, OptionalActions::Now, &modes)?;
        drop(slave);
        fcntl_setfl(&master, OFlags::RDWR | OFlags::NONBLOCK)?;
        replace_link(&device, link)?;
        Ok(Self {
            master,
            device,
            link: link.to_owned(),
            connected: false,
            received: VecDeque::new(),
        })
    }

    /// The name of the device itself.
    pub(super) fn device(&self) -> std::path::Display<'_> {
        self.device.display()
    }

    /// The rate that the other program has set.
    pub(super) fn baud(&self) -> io::Result<u32> {
        // On Linux the modes of both ends are those of the device.
        Ok(tcgetattr(&self.master)?.output_speed())
    }

    /// Waits for bytes at most so long.
    pub(super) fn receive(&mut self, wait: Duration) -> io::Result<Vec<u8>> {
        let wait = if self.connected { wait } else { wait.min(LOOK) };
        if !self.connected {
            // An end without a partner is always ready to say that it has none.
            std::thread::sleep(wait);
        }
        let mut ready = [PollFd::new(&self.master, PollFlags::IN)];
        let limit = if self.connected { wait } else { Duration::ZERO };
        let limit = rustix::event::Timespec {
            tv_sec: limit.as_secs() as i64,
            tv_nsec: i64::from(limit.subsec_nanos()),
        };
        match poll(&mut ready, Some(&limit)) {
            Ok(_) => {}
            // A signal: the caller looks at it.
            Err(Errno::INTR) => return Ok(Vec::new()),
            Err(error) => return Err(error.into()),
        }
        let state = ready[0].revents();
        if state.contains(PollFlags::IN) {
            self.connected = true;
            let mut buffer = [0; 256];
            return match rustix::io::read(&self.master, &mut buffer) {
                Ok(bytes) => Ok(buffer[..bytes].to_vec()),
                Err(Errno::AGAIN | Errno::INTR | Errno::IO) => Ok(Vec::new()),
                Err(error) => Err(error.into()),
            };
        }
        let hung_up = state.contains(PollFlags::HUP);
        if hung_up && self.connected {
            // The next program must not read bytes that were meant for this one.
            tcflush(&self.master, QueueSelector::OFlush)?;
        }
        self.connected = !hung_up;
        Ok(Vec::new())
    }

    /// Sends as many bytes as there is room for, as a line does not wait either; returns how many are lost.
    /// Bytes count as lost only if a program has the device open.
    pub(super) fn send(&self, bytes: &[u8]) -> io::Result<usize> {
        if !self.connected || bytes.is_empty() {
            return Ok(0);
        }
        match rustix::io::write(&self.master, bytes) {
            Ok(written) => Ok(bytes.len() - written),
            Err(Errno::AGAIN | Errno::INTR) => Ok(bytes.len()),
            Err(Errno::IO) => Ok(0),
            Err(error) => Err(error.into()),
        }
    }
}

/// Fails with [`io::ErrorKind::WouldBlock`] if there is nothing to read.
impl io::Read for PseudoTerminal {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.received.is_empty() {
            self.received = self.receive(Duration::ZERO)?.into();
        }
        let count = self.received.len().min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(self.received.drain(..count)) {
            *place = byte;
        }
        match count {
            0 => Err(io::ErrorKind::WouldBlock.into()),
            count => Ok(count),
        }
    }
}

/// Bytes for which there is no room are lost.
impl io::Write for PseudoTerminal {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.send(bytes)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for PseudoTerminal {
    fn drop(&mut self) {
        // The link may belong to another program by now.
        if fs::read_link(&self.link).is_ok_and(|target| target == self.device) {
            let _ = fs::remove_file(&self.link);
        }
    }
}

/// Puts the link in place of a stale one, but of nothing else.
fn replace_link(device: &Path, link: &Path) -> anyhow::Result<()> {
    if let Ok(target) = fs::read_link(link) {
        if target == device {
            // The program that left it was killed, and the number of its device was given out again.
            return Ok(());
        }
        if target.exists() {
            bail!(
                "{} points to {}, which is in use: remove it first if it is not another device",
                link.display(),
                target.display()
            );
        }
        fs::remove_file(link).with_context(|| format!("{} cannot be replaced", link.display()))?;
    } else if link.exists() {
        bail!(
            "{} exists and is no link: name a link that is not there yet",
            link.display()
        );
    }
    symlink(device, link).with_context(|| OfFile::unmade(link))
}
