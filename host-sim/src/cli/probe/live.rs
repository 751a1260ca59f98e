//! Packets of the camera, printed as they come.

use std::{
    io::{self, IsTerminal, Write},
    time::Duration,
};

use cmucam2_driver::session::Fault;
use host_sim::probe::{
    View,
    display::{Counters, Garbled, PacketLine, Screen, Tally},
    port::Clock,
};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::{Arguments, Bench, Look, is_interruption, tell};

/// Output of packets.
enum Output {
    /// One line that changes.
    Screen(ProgressBar),
    /// A line each.
    Lines,
    Json,
}

impl Output {
    fn new(json: bool) -> Self {
        if json {
            return Self::Json;
        }
        if !io::stdout().is_terminal() {
            return Self::Lines;
        }
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stdout());
        let style = ProgressStyle::with_template("{wide_msg}");
        Self::Screen(bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner())))
    }

    fn packet(&self, line: &PacketLine, view: &View, tally: &Tally) -> io::Result<()> {
        match self {
            Self::Screen(bar) => {
                bar.set_message(Screen { line, view, tally }.to_string());
                Ok(())
            }
            Self::Lines => {
                let mut out = io::stdout().lock();
                writeln!(out, "{line}")?;
                out.flush()
            }
            Self::Json => {
                let mut out = io::stdout().lock();
                serde_json::to_writer(&mut out, line)?;
                out.write_all(b"\n")?;
                out.flush()
            }
        }
    }

    fn tell(&self, text: &str) {
        match self {
            Self::Screen(bar) => bar.suspend(|| tell(text)),
            Self::Lines | Self::Json => tell(text),
        }
    }

    fn finish(self) -> io::Result<()> {
        if let Self::Screen(bar) = self {
            bar.abandon();
            // The bar leaves the cursor at its end.
            writeln!(io::stdout())?;
        }
        Ok(())
    }
}

/// Calls `next` with the time so far until it has printed enough packets, time is up, or Ctrl-C: it tells whether it
/// has printed one.
pub(super) fn until_enough(
    arguments: &Arguments,
    clock: &Clock,
    mut next: impl FnMut(&dyn Fn() -> Duration) -> anyhow::Result<bool>,
) -> anyhow::Result<()> {
    let time = arguments
        .seconds
        .map(|s| Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX));
    let begin = clock.now();
    let elapsed = || clock.now().saturating_sub(begin);
    let mut printed = 0;
    while arguments.count.is_none_or(|count| printed < count)
        && time.is_none_or(|time| elapsed() < time)
    {
        match next(&elapsed) {
            Ok(is_printed) => printed += u64::from(is_printed),
            Err(error) if is_interruption(&error) => break,
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Prints packets.
pub(super) fn run(bench: &mut Bench<'_>) -> anyhow::Result<()> {
    let arguments = bench.arguments;
    let output = Output::new(arguments.json);
    let clock = bench.clock.clone();
    let before = Counters::of(bench.camera.session());
    let mut tally = Tally::default();
    let ended = until_enough(arguments, &clock, |elapsed| {
        let tracking = match bench.look()? {
            Look::Packet(tracking) => tracking,
            Look::Quiet => return Ok(false),
            Look::Restarted => {
                output.tell(&Fault::Restarted.to_string());
                return Ok(false);
            }
        };
        let after = elapsed();
        if let Some(remark) = bench.remark(&tracking) {
            output.tell(&remark);
        }
        tally.add(after, &tracking);
        let line = PacketLine::new(after, &tracking, &bench.view);
        output.packet(&line, &bench.view, &tally)?;
        Ok(true)
    });
    output.finish()?;
    let after = Counters::of(bench.camera.session());
    let garbled = Garbled { before, after };
    tell(format_args!("{tally}; {garbled}"));
    ended
}
