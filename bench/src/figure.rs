//! One line a figure, with its goal where it has one.

use std::path::PathBuf;

use answers::accuracy;

/// Prints figures as they come and remembers whether any missed its goal.
#[derive(Default)]
pub(crate) struct Sheet {
    missed: usize,
}

/// What a figure is to be.
pub(crate) enum Goal {
    AtMost(f64),
    AtLeast(f64),
    /// For information.
    None,
}

impl Sheet {
    pub(crate) fn heading(&self, text: &str) {
        println!("\n{text}");
    }

    pub(crate) fn note(&self, text: &str) {
        println!("  ({text})");
    }

    /// Prints a figure; a missed goal is marked and remembered.
    pub(crate) fn figure(&mut self, name: &str, value: f64, unit: &str, goal: &Goal) {
        let (text, reached) = match *goal {
            Goal::AtMost(limit) => (format!("<= {limit:.4}"), value <= limit),
            Goal::AtLeast(limit) => (format!(">= {limit:.4}"), value >= limit),
            Goal::None => (String::new(), true),
        };
        let mark = if reached { "" } else { "  MISSED" };
        self.missed += usize::from(!reached);
        println!("  {name:<58} {value:>10.4} {unit:<6} {text:<10}{mark}");
    }

    pub(crate) fn close(&self) {
        println!("\n{} figures missed their goal", self.missed);
    }
}

/// A file of the full data sets beside the repository, if it is there.
pub(crate) fn full_data(name: &str) -> Option<PathBuf> {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");
    let path: PathBuf = [root, name].iter().collect();
    path.is_file().then_some(path)
}

/// A quantile of values in any order; NaN of none.
pub(crate) fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    accuracy::quantile(values, q).unwrap_or(f64::NAN)
}

/// Root of the mean square.
pub(crate) fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for value in values {
        sum += value * value;
        n += 1.0;
    }
    (sum / n).sqrt()
}

/// The largest of values; NaN of none, which reaches no goal.
pub(crate) fn worst(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(f64::NAN, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_data_no_goal_is_reached() {
        for nothing in [worst([]), rms([]), quantile(&mut [], 0.5)] {
            let mut sheet = Sheet::default();
            sheet.figure("nothing", nothing, "", &Goal::AtMost(1.0));
            sheet.figure("nothing", nothing, "", &Goal::AtLeast(0.0));
            assert_eq!(sheet.missed, 2);
        }
        assert_eq!(worst([0.25, 0.75, 0.5]), 0.75);
    }
}
