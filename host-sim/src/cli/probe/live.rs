//! Packets of the camera, printed as they come.

use std::{
    io::{self, IsTerminal, Write},
    time::Duration,
};

use cmucam2_driver::session::Fault;
use host_sim::probe::{
    View,
    display::{Counters, Garbled, PacketLine, Screen, Tally},
};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::{Bench, Look, is_interruption, tell};

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

/// Prints packets until there are enough, time is up, or Ctrl-C.
pub(super) fn run(bench: &mut Bench<'_>) -> anyhow::Result<()> {
    let arguments = bench.arguments;
    let time = arguments
        .seconds
        .map(|s| Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX));
    let output = Output::new(arguments.json);
    let clock = bench.clock.clone();
    let begin = clock.now();
    let elapsed = || clock.now().saturating_sub(begin);
    let before = Counters::of(bench.camera.session());
    let mut tally = Tally::default();
    let ended = loop {
        if arguments
            .count
            .is_some_and(|count| tally.packets() >= count)
            || time.is_some_and(|time| elapsed() >= time)
        {
            break Ok(());
        }
        let tracking = match bench.look() {
            Ok(Look::Packet(tracking)) => tracking,
            Ok(Look::Quiet) => continue,
            Ok(Look::Restarted) => {
                output.tell(&Fault::Restarted.to_string());
                continue;
            }
            Err(error) if is_interruption(&error) => break Ok(()),
            Err(error) => break Err(error),
        };
        let after = elapsed();
        if let Some(remark) = bench.remark(&tracking) {
            output.tell(&remark);
        }
        tally.add(after, &tracking);
        output.packet(
            &PacketLine::new(after, &tracking, &bench.view),
            &bench.view,
            &tally,
        )?;
    };
    output.finish()?;
    let after = Counters::of(bench.camera.session());
    let garbled = Garbled { before, after };
    tell(format_args!("{tally}; {garbled}"));
    ended
}
