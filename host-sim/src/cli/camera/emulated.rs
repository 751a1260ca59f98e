//! The emulated camera in virtual time, in the place of a serial port.

use std::{
    collections::VecDeque,
    io,
    sync::{Arc, Mutex},
    time::Duration,
};

use anyhow::{bail, ensure};
use clap::{Parser, ValueEnum, builder::PossibleValue};
use cmucam2_emulator::{Emulator, Time};
use host_sim::probe::port::Wire;

use super::{
    Arguments, KindOption,
    carried::{Carried, OnLine, Pixy},
};

/// Options of `host-sim camera` that an emulated camera can have.
const OPTIONS: [&str; 7] = [
    "baud", "fault", "scene", "seed", "sensor", "switch", "taught",
];
/// In the place of an option: bytes that another program has sent before, with escapes as in Rust.
const HEARD: &str = "heard";

/// A blind read waits at most so long, as on a port.
const PATIENCE: Duration = Duration::from_secs(5);

#[derive(Parser)]
#[command(no_binary_name = true)]
struct Options {
    #[command(flatten)]
    camera: Arguments,
}

/// A camera on a line of which this is the only clock: it goes on while the host waits.
struct Virtual<C> {
    line: Carried<C>,
    now: Time,
    /// Bytes that have come and are not read yet.
    come: VecDeque<u8>,
}

/// Makes a camera as `host-sim camera` makes it of the same options, each `NAME=VALUE` here.
///
/// # Errors
/// The first option that does not exist, or that this camera does not have.
pub(in crate::cli) fn wire(
    kind: KindOption,
    options: &[String],
    host_baud: u32,
) -> anyhow::Result<Arc<Mutex<dyn Wire>>> {
    let kind = kind.to_possible_value();
    let kind = kind.as_ref().map_or("cmucam2", PossibleValue::get_name);
    let mut words = vec!["--pty=none".to_owned(), format!("--kind={kind}")];
    let mut heard = Vec::new();
    for option in options.iter().filter(|option| !option.is_empty()) {
        let name = option.split('=').next().unwrap_or_default();
        if let Some(text) = option.strip_prefix("heard=") {
            heard.extend(unescaped(text)?);
            continue;
        }
        ensure!(
            OPTIONS.contains(&name) && option.contains('='),
            "--emulate {option}: NAME=VALUE is needed, NAME is {HEARD} or one of {}",
            OPTIONS.join(", ")
        );
        words.push(format!("--{option}"));
    }
    let camera = match Options::try_parse_from(words) {
        Ok(options) => options.camera,
        Err(error) => {
            let text = error.to_string();
            let first = text.lines().next().unwrap_or_default();
            bail!("--emulate: {}", first.trim_start_matches("error: "));
        }
    };
    let configuration = camera.configuration()?;
    let scene = camera.scene(configuration.sensor)?;
    let baud = camera.baud();
    Ok(match camera.kind.model() {
        None => Virtual::begin(
            Emulator::new(configuration, scene),
            (baud, host_baud),
            &heard,
        ),
        Some(model) => {
            let emulator = pixy_emulator::Emulator::new(camera.pixy(model), scene);
            Virtual::begin(Pixy::new(emulator, baud), (baud, host_baud), &heard)
        }
    })
}

/// `\r`, `\n`, `\\` and `\x0a` are one byte each.
fn unescaped(text: &str) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(match (byte, &mut rest) {
            (b'\\', rest) => match rest.next() {
                Some(b'r') => b'\r',
                Some(b'n') => b'\n',
                Some(b'\\') => b'\\',
                Some(b'x') => {
                    let digits: Vec<u8> = rest.take(2).collect();
                    let digits = std::str::from_utf8(&digits).unwrap_or_default();
                    match u8::from_str_radix(digits, 16) {
                        Ok(byte) if digits.len() == 2 => byte,
                        _ => bail!("--emulate {HEARD}: two hexadecimal digits follow \\x"),
                    }
                }
                _ => bail!("--emulate {HEARD}: r, n, x or another \\ follows \\"),
            },
            (byte, _) => byte,
        });
    }
    Ok(bytes)
}

fn nanoseconds(time: Duration) -> Time {
    // 584 years.
    time.as_nanos() as Time
}

impl<C: OnLine + 'static> Virtual<C> {
    /// Starts with a camera that was switched on a while ago and has already understood the other program.
    fn begin(camera: C, (baud, host_baud): (u32, u32), heard: &[u8]) -> Arc<Mutex<dyn Wire>> {
        let mut this = Self {
            line: Carried::new(camera, baud),
            now: 0,
            come: VecDeque::new(),
        };
        this.sleep(Duration::from_secs(2));
        this.line.hear(heard, this.now);
        this.go_to(this.line.busy_until(this.now));
        this.come.clear();
        this.line.set_host_baud(host_baud);
        Arc::new(Mutex::new(this))
    }

    fn go_to(&mut self, now: Time) {
        self.now = now;
        let come = self.line.advance(now);
        self.come.extend(come);
    }
}

impl<C: OnLine + 'static> Wire for Virtual<C> {
    fn now(&self) -> Duration {
        Duration::from_nanos(self.now)
    }

    fn sleep(&mut self, time: Duration) {
        self.go_to(self.now.saturating_add(nanoseconds(time)));
    }

    fn set_baud_rate(&mut self, rate: u32) -> io::Result<()> {
        if rate != self.line.host_baud() {
            self.line.set_host_baud(rate);
        }
        Ok(())
    }

    fn is_ready(&mut self) -> io::Result<bool> {
        Ok(!self.come.is_empty())
    }

    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let limit = self.now.saturating_add(nanoseconds(PATIENCE));
        while self.come.is_empty() {
            let next = self.line.next().unwrap_or(limit).min(limit).max(self.now);
            self.go_to(next);
            if self.come.is_empty() && next >= limit {
                return Err(io::ErrorKind::TimedOut.into());
            }
        }
        io::Read::read(&mut self.come, buffer)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.line.hear(bytes, self.now);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.go_to(self.line.busy_until(self.now));
        Ok(())
    }

    fn clear(&mut self) -> io::Result<()> {
        self.come.clear();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_banner_comes_when_a_line_would_have_carried_it() {
        let wire = wire(KindOption::Cmucam2, &["baud=1200".to_owned()], 1200).unwrap();
        let mut wire = wire.lock().unwrap();
        let begin = wire.now();
        wire.write(b"\rGV\r").unwrap();
        let mut said = Vec::new();
        while !said.ends_with(b"c6\r:") {
            let mut byte = [0];
            assert_eq!(wire.read(&mut byte).unwrap(), 1);
            said.push(byte[0]);
        }
        assert!(said.ends_with(b"ACK\rCMUcam2 v1.00 c6\r:"));
        // 4 bytes to it and at least 22 back, 8.3 ms each.
        let took = wire.now().saturating_sub(begin).as_secs_f64();
        assert!((0.2..0.5).contains(&took), "{took}");
        let mut byte = [0];
        let silent = wire.read(&mut byte).unwrap_err();
        assert_eq!(silent.kind(), io::ErrorKind::TimedOut);
    }

    #[test]
    fn options_are_those_of_the_camera() {
        for (option, word) in [
            ("pty=x", "one of baud, fault"),
            ("baud", "NAME=VALUE"),
            ("baud=14400", "115200"),
            ("switch=orgin=1", "there is no `orgin`"),
            ("scene=/nowhere.toml", "cannot be read"),
            ("heard=\\q", "follows"),
            ("heard=\\x4", "hexadecimal"),
        ] {
            let Err(error) = wire(KindOption::Cmucam2, &[option.to_owned()], 9600) else {
                panic!("{option} was taken")
            };
            let error = format!("{error:#}");
            assert!(error.contains(word), "{option}: {error}");
        }
        assert_eq!(unescaped("a\\r\\x01\\\\").unwrap(), b"a\r\x01\\");
    }
}
