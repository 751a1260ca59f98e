//! The line to the program that talks to the camera.

use std::{
    fmt,
    io::{self, ErrorKind, Read, Write},
    time::Duration,
};

use anyhow::Context;
use serialport::SerialPort;

use super::super::pseudo_terminal::PseudoTerminal;

/// For a real port that takes nothing.
const WRITE_TIMEOUT: Duration = Duration::from_secs(5);

/// The camera's end of a line.
pub(super) enum Line {
    /// A pseudo-terminal; a program on this computer opens its other end.
    Terminal(PseudoTerminal),
    /// A real port; its path.
    Port(Box<dyn SerialPort>, String),
}

impl Line {
    /// A real serial port: 8 data bits, no parity, one stop bit, no flow control.
    pub(super) fn port(path: &str, baud: u32) -> anyhow::Result<Self> {
        let port = serialport::new(path, baud).open();
        let port = port.with_context(|| format!("{path} cannot be opened as a serial port"))?;
        Ok(Self::Port(port, path.to_owned()))
    }

    /// The rate that the other program has set, if it can be known.
    pub(super) fn baud(&self) -> io::Result<Option<u32>> {
        match self {
            Self::Terminal(terminal) => terminal.baud().map(Some),
            Self::Port(..) => Ok(None),
        }
    }

    /// Waits for bytes at most so long.
    pub(super) fn receive(&mut self, wait: Duration) -> io::Result<Vec<u8>> {
        match self {
            Self::Terminal(terminal) => terminal.receive(wait),
            Self::Port(port, _) => {
                // A wait of less than a millisecond counts as none.
                port.set_timeout(wait.max(Duration::from_millis(1)))?;
                let mut buffer = [0; 256];
                match port.read(&mut buffer) {
                    Ok(count) => Ok(buffer[..count].to_vec()),
                    Err(error)
                        if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) =>
                    {
                        Ok(Vec::new())
                    }
                    Err(error) => Err(error),
                }
            }
        }
    }

    /// Sends as many bytes as there is room for; returns how many are lost.
    pub(super) fn send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Terminal(terminal) => terminal.send(bytes),
            // The emulator says nothing earlier than a line can carry it: there is room.
            Self::Port(port, _) => {
                port.set_timeout(WRITE_TIMEOUT)?;
                port.write_all(bytes).map(|()| 0)
            }
        }
    }
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Terminal(terminal) => terminal.device().fmt(f),
            Self::Port(_, path) => path.fmt(f),
        }
    }
}
