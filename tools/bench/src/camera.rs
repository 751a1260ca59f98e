//! The line between the CMUcam2 driver and the emulated camera, in virtual time.

use std::time::Instant;

use anyhow::Context;
use cmucam2_pair::measure::{PacketForm, corruption, highest_rate, track_for};

use crate::figure::{Goal, Sheet};

const BAUD: u32 = 38_400;
const PACKETS: u32 = 100_000;

pub(crate) fn run(sheet: &mut Sheet) -> anyhow::Result<()> {
    sheet.heading("CMUcam2 line, emulated, 38 400 baud");
    for (name, form) in [
        ("highest rate without loss, all fields", PacketForm::Text),
        ("highest rate without loss, mx my", PacketForm::Middle),
        ("highest rate without loss, raw", PacketForm::Raw),
    ] {
        let rate = highest_rate(BAUD, form).context("the emulated camera failed")?;
        let name = format!("{name} ({} rows)", rate.rows);
        sheet.figure(&name, rate.packets_per_second, "1/s", &Goal::AtLeast(50.0));
    }
    for (name, strict) in [("", false), (", strict", true)] {
        let counts = corruption(0.2, strict, PACKETS, 1);
        let share = |count: u32| f64::from(count) / f64::from(counts.sent);
        sheet.figure(
            &format!("20 % corrupted lines{name}: delivered"),
            100.0 * share(counts.delivered),
            "%",
            &Goal::AtLeast(79.0),
        );
        sheet.figure(
            &format!("20 % corrupted lines{name}: wrong, undetectable"),
            100.0 * share(counts.wrong),
            "%",
            &Goal::None,
        );
        sheet.figure(
            &format!("20 % corrupted lines{name}: wrong in more than a number"),
            f64::from(counts.wrong_in_several),
            "",
            &Goal::AtMost(0.0),
        );
    }
    let (cameras, seconds) = (20, 20);
    let begin = Instant::now();
    for seed in 0..cameras {
        track_for(seconds, seed);
    }
    let frames = (cameras * seconds * 50) as f64;
    sheet.figure(
        "computing one frame and its T packet",
        begin.elapsed().as_secs_f64() * 1e6 / frames,
        "us",
        &Goal::None,
    );
    Ok(())
}
