//! An `ot-rcp` process on a pseudo-terminal, and the means to drive async code beside it.

use std::{
    env,
    ffi::OsString,
    fs::File,
    future::Future,
    io::{self, Read as _, Write as _},
    net::{Ipv4Addr, UdpSocket},
    os::{fd::AsFd, unix::ffi::OsStringExt},
    pin::pin,
    process::{Child, Command, Stdio},
    task::{Context, Poll, Waker},
    thread,
    time::{Duration, Instant},
};

use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use rustix::{
    io::ioctl_fionbio,
    pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt},
    termios::{OptionalActions, tcgetattr, tcsetattr},
};
use spinel_radio::SpinelRadio;
use tempfile::TempDir;
use zigbee_link::runner::Clock;

/// Nothing here takes a second; what takes this long hangs.
const HANGS: Duration = Duration::from_secs(600);

pub(crate) type Rcp = SpinelRadio<Uart, StdClock>;

/// Ports of a medium that no other process hears: the one of the medium, and one for each node.
pub(crate) struct Air {
    base: u16,
    /// `ot-rcp` keeps a file where it runs.
    directory: TempDir,
}

impl Air {
    pub(crate) fn new() -> Self {
        let free = |port| UdpSocket::bind((Ipv4Addr::LOCALHOST, port));
        let base = loop {
            let socket = free(0).unwrap();
            let base = socket.local_addr().unwrap().port();
            if base < u16::MAX - 2 && free(base + 1).is_ok() && free(base + 2).is_ok() {
                break base;
            }
        };
        Self {
            base,
            directory: tempfile::tempdir().unwrap(),
        }
    }

    /// A co-processor and its radio. `node` is 1 or 2, and the end of its EUI-64.
    pub(crate) fn node(&self, node: u8) -> (Process, Rcp) {
        let (process, uart) = Process::start(self, node);
        (process, SpinelRadio::new(uart, StdClock::new()))
    }
}

/// A running `ot-rcp`. Ends with its owner.
pub(crate) struct Process {
    child: Child,
    command: Command,
    slave: File,
}

impl Process {
    pub(crate) fn start(air: &Air, node: u8) -> (Self, Uart) {
        let program = env::var_os("OT_RCP").expect("OT_RCP names no ot-rcp: `cargo xtask peers`");
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let path = OsString::from_vec(ptsname(&master, Vec::new()).unwrap().into_bytes());
        let slave = File::options().read(true).write(true).open(path).unwrap();
        let mut settings = tcgetattr(&slave).unwrap();
        settings.make_raw();
        tcsetattr(&slave, OptionalActions::Now, &settings).unwrap();
        ioctl_fionbio(master.as_fd(), true).unwrap();

        let mut command = Command::new(program);
        command
            .args(["--local-interface", "127.0.0.1"])
            .arg(node.to_string())
            .env("PORT_BASE", air.base.to_string())
            .current_dir(air.directory.path())
            .stderr(Stdio::null());
        let child = spawn(&mut command, &slave);
        let process = Self {
            child,
            command,
            slave,
        };
        (process, Uart(master.into()))
    }

    /// Kills it, as a loss of power would.
    pub(crate) fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Starts it again on the same line.
    pub(crate) fn restart(&mut self) {
        self.child = spawn(&mut self.command, &self.slave);
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have been killed already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn spawn(command: &mut Command, slave: &File) -> Child {
    command
        .stdin(slave.try_clone().unwrap())
        .stdout(slave.try_clone().unwrap())
        .spawn()
        .unwrap()
}

/// The host's end of the pseudo-terminal.
pub(crate) struct Uart(File);

impl ErrorType for Uart {
    type Error = ErrorKind;
}

impl Read for Uart {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, ErrorKind> {
        ready(|| self.0.read(buffer)).await
    }
}

impl Write for Uart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        ready(|| self.0.write(bytes)).await
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}

async fn ready(mut attempt: impl FnMut() -> io::Result<usize>) -> Result<usize, ErrorKind> {
    std::future::poll_fn(|_| match attempt() {
        Err(error) if error.kind() == io::ErrorKind::WouldBlock => Poll::Pending,
        result => Poll::Ready(result.map_err(|_| ErrorKind::Other)),
    })
    .await
}

/// The time since a moment.
pub(crate) struct StdClock(Instant);

impl StdClock {
    pub(crate) fn new() -> Self {
        Self(Instant::now())
    }
}

impl Clock for StdClock {
    fn now(&self) -> zigbee_link::Instant {
        zigbee_link::Instant(self.0.elapsed().as_micros() as u64)
    }

    async fn sleep_until(&self, time: zigbee_link::Instant) {
        std::future::poll_fn(|_| {
            if self.now() < time {
                Poll::Pending
            } else {
                Poll::Ready(())
            }
        })
        .await;
    }
}

/// Asks again and again, gently.
#[track_caller]
pub(crate) fn block_on<T>(future: impl Future<Output = T>) -> T {
    poll_for(HANGS, future).expect("it hangs")
}

/// The result, if there is one within a time.
pub(crate) fn poll_for<T>(time: Duration, future: impl Future<Output = T>) -> Option<T> {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    let end = Instant::now() + time;
    while Instant::now() < end {
        if let Poll::Ready(result) = future.as_mut().poll(&mut context) {
            return Some(result);
        }
        thread::sleep(Duration::from_micros(200));
    }
    None
}
