//! Programs on processors that QEMU emulates, which print over semihosting.

use std::{
    io::{ErrorKind, Read},
    path::Path,
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, anyhow, bail, ensure};

const PROGRAM: &str = "qemu-system-arm";

/// A run takes seconds; one that takes this long hangs.
const TIMEOUT: Duration = Duration::from_secs(600);
/// Interval at which it is looked at.
const PERIOD: Duration = Duration::from_millis(5);

/// Emulated machine, by its arguments to QEMU.
pub(crate) struct Machine(&'static [&'static str]);

/// An MPS2 with image AN386: a Cortex-M4F.
pub(crate) const CORTEX_M4F: Machine = Machine(&["-M", "mps2-an386", "-cpu", "cortex-m4"]);
/// A BBC micro:bit: a Cortex-M0.
pub(crate) const CORTEX_M0: Machine = Machine(&["-M", "microbit"]);

/// Ends with its owner.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Runs a program to its end, an instruction a nanosecond of its time. Returns its output.
///
/// # Errors
/// It does not end, or not well.
pub(crate) fn run(machine: &Machine, image: &Path) -> Result<String> {
    let child = Command::new(PROGRAM)
        .args(machine.0)
        .args(["-display", "none", "-monitor", "none", "-serial", "none"])
        .args(["-icount", "shift=0"])
        .args(["-semihosting-config", "enable=on,target=native"])
        .arg("-kernel")
        .arg(image)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn();
    let mut running = match child {
        Ok(child) => Running(child),
        Err(error) if error.kind() == ErrorKind::NotFound => bail!(
            "{PROGRAM} was not found: install it, on Debian or Ubuntu with `sudo apt-get install qemu-system-arm`"
        ),
        Err(error) => return Err(error).context(PROGRAM),
    };
    let mut stdout = running.0.stdout.take().context("the output is piped")?;
    let reader = thread::spawn(move || {
        let mut output = String::new();
        stdout.read_to_string(&mut output).map(|_| output)
    });
    let begin = Instant::now();
    let status = loop {
        if let Some(status) = running.0.try_wait()? {
            break status;
        }
        let seconds = TIMEOUT.as_secs();
        ensure!(
            begin.elapsed() < TIMEOUT,
            "{PROGRAM} was stopped after {seconds} s"
        );
        thread::sleep(PERIOD);
    };
    let output = reader
        .join()
        .map_err(|_| anyhow!("reading the output of {PROGRAM} panicked"))??;
    ensure!(
        status.success(),
        "{PROGRAM} ended with {status} after printing:\n{output}"
    );
    Ok(output)
}
