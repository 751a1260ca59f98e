//! `solve` of very many cases, as a stream.

use std::{
    io::{BufWriter, Write},
    path::Path,
    process::Command,
};

use super::process;
use crate::figure::{Goal, Sheet};

const CASES: u32 = 1_000_000;

/// Sightings of each.
const ROWS: u32 = 4;

/// Megabytes, at most, for any number of cases.
const MEMORY: f64 = 50.0;

pub(super) fn run(sheet: &mut Sheet, program: &Path) -> anyhow::Result<()> {
    sheet.heading(&format!(
        "Scale: `host-sim solve`, {CASES} cases of {ROWS} sightings"
    ));
    let mut file = tempfile::NamedTempFile::new()?;
    write(BufWriter::new(file.as_file_mut()))?;
    let mut solve = Command::new(program);
    solve.arg("solve").arg(file.path());
    solve.args(["--json", "--bearing-sigma", "0.01"]);
    let (said, cost) = process::measured(&mut solve, &[0])?;
    let answers = said.lines().count() as f64;
    let all = f64::from(CASES);
    sheet.figure("answers", answers, "", &Goal::Within(all, all));
    sheet.figure(
        "memory at most",
        cost.peak as f64 / 1e6,
        "MB",
        &Goal::AtMost(MEMORY),
    );
    sheet.figure(
        "cases for a second of processor",
        answers / cost.seconds,
        "",
        &Goal::None,
    );
    Ok(())
}

/// Cameras about the middle of a room that see targets about its walls.
fn write(mut file: impl Write) -> std::io::Result<()> {
    writeln!(file, "case,target_x,target_y,bearing_rad")?;
    for case in 0..CASES {
        let [x, y, heading] = [7, 11, 13].map(|prime| f64::from(case * prime % 1009) / 1009.0);
        for row in 0..ROWS {
            let around = f64::from(row) * 0.7 + x;
            let (target_x, target_y) = (8.0 * around.cos(), 8.0 * around.sin());
            let bearing = f64::atan2(target_y - y, target_x - x) - heading;
            writeln!(
                file,
                "camera-{case},{target_x:.4},{target_y:.4},{bearing:.5}"
            )?;
        }
    }
    file.flush()
}
