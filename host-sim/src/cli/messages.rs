//! Messages about rows, and progress, on the standard error output.

use std::{
    io::{self, IsTerminal, Read},
    path::Path,
};

use indicatif::{ProgressBar, ProgressStyle};
use results::recorded::{Complaint, USUAL_BEARING_SIGMA};

use super::{file_name, tell};

/// Messages of one kind that are printed in full; the rest are counted.
const IN_FULL: usize = 20;
/// Smaller files are read before anyone looks for a bar.
const LONG_FILE: u64 = 16 << 20;
/// Fewer cases are solved before anyone looks for a bar.
const MANY_CASES: usize = 200_000;

/// Complaints about the rows of one file.
pub(super) struct Messages {
    file: String,
    count: usize,
    bar: ProgressBar,
}

impl Messages {
    pub(super) fn new(file: String) -> Self {
        Self {
            file,
            count: 0,
            bar: ProgressBar::hidden(),
        }
    }

    /// The input with a bar that follows it, if it is long and the output is a terminal.
    pub(super) fn watch(
        &mut self,
        input: Box<dyn Read>,
        length: Option<u64>,
    ) -> indicatif::ProgressBarIter<Box<dyn Read>> {
        if let Some(length) = length.filter(|&length| length >= LONG_FILE) {
            self.bar = bar(length, "reading {wide_bar} {bytes} of {total_bytes}");
        }
        self.bar.wrap_read(input)
    }

    pub(super) fn complain(&mut self, complaint: &Complaint) {
        self.count += 1;
        if self.count <= IN_FULL {
            let Complaint { line, text } = complaint;
            self.bar
                .suspend(|| tell(format_args!("{}:{line}: {text}", self.file)));
        }
    }

    /// Ends the bar, and counts the messages that were not printed.
    pub(super) fn finish(self) {
        self.bar.finish_and_clear();
        if let Some(more @ 1..) = self.count.checked_sub(IN_FULL) {
            tell(format_args!("{}: {more} more rows like these", self.file));
        }
    }
}

/// Tells which bearing sigma is used where none is given.
pub(super) fn tell_assumed_sigma(path: &Path) {
    tell(format_args!(
        "{}: no column `sigma_rad` and no --bearing-sigma: {USUAL_BEARING_SIGMA} rad (half a \
         degree) is assumed",
        file_name(path)
    ));
}

/// Names a column of measurements that is not used, because the file has two kinds of them.
pub(super) fn tell_passed_over(path: &Path, column: Option<&str>) {
    if let Some(column) = column {
        tell(format_args!(
            "{}: `{column}` is not used: pixel columns are read with --fov-deg, bearings without",
            file_name(path)
        ));
    }
}

/// A bar for solving, if it takes a while, the error output is a terminal, and answers are not on
/// the same screen.
pub(super) fn solving_bar(cases: usize) -> ProgressBar {
    if cases < MANY_CASES || io::stdout().is_terminal() {
        return ProgressBar::hidden();
    }
    bar(
        cases as u64,
        "solving {wide_bar} {human_pos} of {human_len} cases, {eta} left",
    )
}

/// Draws on the standard error output, and only if that is a terminal.
pub(super) fn bar(length: u64, template: &str) -> ProgressBar {
    let style = ProgressStyle::with_template(template);
    ProgressBar::new(length).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
