//! Programs that run alone on a chip and print over semihosting, to their debugger.

use std::{collections::BTreeMap, fmt, path::Path};

use rigless::{
    emulator::{self, Driver, Host, Start, Stop},
    image::Image,
    session::Session,
    time::VirtualNanos,
};

use crate::{
    node::MEMORY,
    processor::{Lease, Program},
    soc::{Board, Soc},
};

/// Output so far.
#[derive(Debug, Default)]
struct Printed(Vec<u8>);

impl Driver<Board> for Printed {
    fn on_stop(
        &mut self,
        _: &mut Session<Board>,
        _: Stop,
        _: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        None
    }

    fn on_console(&mut self, _: VirtualNanos, _: u64, bytes: &[u8]) {
        self.0.extend(bytes);
    }
}

/// Runs a program, an ELF file, until it says that it has ended. Returns its output.
///
/// # Errors
/// It cannot be run, says that it failed, or has not ended after so many nanoseconds.
pub fn print(image: &Path, until: u64) -> Result<String, String> {
    let text = |error: &dyn fmt::Display| error.to_string();
    let soc = Soc::new(0, None, None, BTreeMap::new()).map_err(|error| text(&error))?;
    let program = Image::read(image, None).map_err(|error| text(&error))?;
    let board = Board {
        soc,
        program: Program::new([program.bytes()], 0..MEMORY.start),
        processor: Lease::default(),
    };
    let session = Session::new(Box::new(board), 0, VirtualNanos(until));
    let session = session.map_err(|error| text(&error))?;
    let images = [program];
    let mut start = Start::new(&images);
    start.semihosting = true;
    let finished = emulator::run(session, &start, Printed::default());
    let finished = finished.map_err(|error| text(&error))?;
    let printed = String::from_utf8_lossy(&finished.driver.0).into_owned();
    match finished.exit_status {
        Some(0) => Ok(printed),
        Some(status) => Err(format!("it ended with {status} after printing:\n{printed}")),
        None => Err(format!("it has not ended, and printed:\n{printed}")),
    }
}
