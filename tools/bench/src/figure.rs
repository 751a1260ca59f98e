//! One line a figure, with its goal where it has one.

use std::path::{Path, PathBuf};

use results::accuracy;
use serde::Serialize;

/// Prints figures as they come, and remembers them and their goals.
#[derive(Default)]
pub(crate) struct Sheet {
    topic: String,
    figures: Vec<Figure>,
}

/// A figure, as the machine-readable list has it.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Figure {
    topic: String,
    name: String,
    value: f64,
    /// Standard error of a figure that is the mean of random runs.
    standard_error: Option<f64>,
    unit: String,
    at_least: Option<f64>,
    at_most: Option<f64>,
    /// `reached` or `missed`; `open` if it is known to miss its aim; empty without any.
    state: &'static str,
    /// Reason why it is known to miss its aim.
    reason: &'static str,
}

/// Goal of a figure.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Goal {
    AtMost(f64),
    AtLeast(f64),
    /// No less than the first, no more than the second.
    Within(f64, f64),
    /// For information.
    None,
    /// At most this is aimed at, but known not to be reached, for this reason: no goal.
    Open(f64, &'static str),
}

/// A mean of random runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Estimate {
    pub(crate) value: f64,
    pub(crate) standard_error: f64,
}

/// Standard errors by which a goal is missed where few runs decide.
const STANDARD_ERRORS: f64 = 4.0;

impl Goal {
    fn limits(&self) -> [Option<f64>; 2] {
        match *self {
            Self::AtMost(most) | Self::Open(most, _) => [None, Some(most)],
            Self::AtLeast(least) => [Some(least), None],
            Self::Within(least, most) => [Some(least), Some(most)],
            Self::None => [None, None],
        }
    }

    /// Returns true if a value reaches the goal, within a slack. NaN never does.
    fn is_reached(&self, value: f64, slack: f64) -> bool {
        let [least, most] = self.limits();
        least.is_none_or(|least| value + slack >= least)
            && most.is_none_or(|most| value - slack <= most)
    }
}

impl Sheet {
    pub(crate) fn heading(&mut self, text: &str) {
        text.clone_into(&mut self.topic);
        println!("\n{text}");
    }

    pub(crate) fn note(&self, text: &str) {
        println!("  ({text})");
    }

    /// Prints a figure; a missed goal is marked and remembered.
    pub(crate) fn figure(&mut self, name: &str, value: f64, unit: &str, goal: &Goal) {
        self.add(name, value, None, unit, goal, 0.0);
    }

    /// The same of a mean. With `lenient`, chance alone misses no goal.
    pub(crate) fn estimate(
        &mut self,
        name: &str,
        estimate: Estimate,
        unit: &str,
        goal: &Goal,
        lenient: bool,
    ) {
        let Estimate {
            value,
            standard_error,
        } = estimate;
        let slack = if lenient && standard_error.is_finite() {
            STANDARD_ERRORS * standard_error
        } else {
            0.0
        };
        self.add(name, value, Some(standard_error), unit, goal, slack);
    }

    fn add(
        &mut self,
        name: &str,
        value: f64,
        standard_error: Option<f64>,
        unit: &str,
        goal: &Goal,
        slack: f64,
    ) {
        let reached = goal.is_reached(value, slack);
        let (state, reason) = match goal {
            Goal::None => ("", ""),
            Goal::Open(_, reason) => ("open", *reason),
            _ if reached => ("reached", ""),
            _ => ("missed", ""),
        };
        let [at_least, at_most] = goal.limits();
        let text = match (at_least, at_most) {
            (Some(least), Some(most)) => format!("{least:.2} to {most:.2}"),
            (Some(least), None) => format!(">= {least:.4}"),
            (None, Some(most)) => format!("<= {most:.4}"),
            (None, None) => String::new(),
        };
        let mark = match (state, reached) {
            ("missed", _) => "  MISSED".to_owned(),
            ("open", true) => "  reached: make it a goal".to_owned(),
            ("open", false) => format!("  aim, not reached: {reason}"),
            _ => String::new(),
        };
        println!("  {name:<62} {value:>10.4} {unit:<6} {text:<12}{mark}");
        self.figures.push(Figure {
            topic: self.topic.clone(),
            name: name.to_owned(),
            value,
            standard_error,
            unit: unit.to_owned(),
            at_least,
            at_most,
            state,
            reason,
        });
    }

    /// All figures and goals as CSV.
    pub(crate) fn write(&self, path: &Path) -> anyhow::Result<()> {
        let mut writer = csv::Writer::from_path(path)?;
        for figure in &self.figures {
            writer.serialize(figure)?;
        }
        Ok(writer.flush()?)
    }

    /// Number of goals that were missed.
    pub(crate) fn missed(&self) -> usize {
        { self.figures.iter() }
            .filter(|figure| figure.state == "missed")
            .count()
    }
}

/// A file of the full data sets beside the repository, if it is there. In brief, the subsets that are everywhere
/// have to do.
pub(crate) fn full_data(name: &str, is_brief: bool) -> Option<PathBuf> {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let path: PathBuf = [root, name].iter().collect();
    (path.is_file() && !is_brief).then_some(path)
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
            let nothing = Estimate {
                value: nothing,
                standard_error: f64::NAN,
            };
            sheet.estimate("nothing", nothing, "", &Goal::Within(0.0, 1.0), true);
            assert_eq!(sheet.missed(), 3);
        }
        assert_eq!(worst([0.25, 0.75, 0.5]), 0.75);
    }

    /// A band has two sides, and few runs are given the benefit of chance.
    #[test]
    fn goals_have_their_sides() {
        let missed = |value, lenient, goal: &Goal| {
            let mut sheet = Sheet::default();
            let estimate = Estimate {
                value,
                standard_error: 0.1,
            };
            sheet.estimate("a", estimate, "", goal, lenient);
            sheet.missed() == 1
        };
        let band = Goal::Within(2.5, 3.5);
        assert!(missed(2.4, false, &band) && missed(3.6, false, &band));
        assert!(!missed(2.4, true, &band) && !missed(3.6, true, &band));
        assert!(missed(2.0, true, &band) && missed(4.0, true, &band));
        assert!(!missed(3.0, false, &band));
        assert!(!missed(9.0, false, &Goal::Open(1.0, "no data")));
        assert!(missed(1.05, false, &Goal::AtMost(1.0)) && !missed(1.05, true, &Goal::AtMost(1.0)));
    }
}
