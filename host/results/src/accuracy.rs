//! Answers against the truth: how large the errors are, and whether the sigmas foretold them.
//!
//! Errors of position are distances between answer and truth, errors of heading are absolute and
//! at most half a turn. Mean signed errors are not reported: they hide what users meet.

use std::fmt;

use calib_core::{Pose, angle};

use crate::recorded::truth::Truth;

/// The share of Gaussian errors within 1, 2 and 3 sigmas.
pub const GAUSSIAN: [f64; 3] = [0.682_689_492, 0.954_499_736, 0.997_300_204];

/// The `q`-quantile, `q` in `[0, 1]`, of values in ascending order; `None` of no values.
///
/// The value at place `q (n - 1)`, counted from 0, with linear interpolation between neighbours:
/// type 7 of Hyndman and Fan, "Sample quantiles in statistical packages", The American
/// Statistician 50(4), 1996, and what numpy does when nothing else is asked for.
pub fn quantile(ascending: &[f64], q: f64) -> Option<f64> {
    let last = ascending.len().checked_sub(1)?;
    let place = q.clamp(0.0, 1.0) * last as f64;
    // Not negative and at most `last`: the conversion is exact.
    let below = place.floor() as usize;
    let low = *ascending.get(below)?;
    let high = *ascending.get(below + 1).unwrap_or(&low);
    Some(low + (high - low) * (place - below as f64))
}

/// Statistics of a set of errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Half of the errors are below.
    pub median: f64,
    /// Nine of ten are below.
    pub p90: f64,
    /// 99 of a hundred are below.
    pub p99: f64,
    /// Root of the mean square.
    pub rms: f64,
}

impl Spread {
    /// Statistics of errors in any order; `None` if there are none. Sorts them.
    pub fn of(errors: &mut [f64]) -> Option<Self> {
        errors.sort_unstable_by(f64::total_cmp);
        let squares: f64 = errors.iter().map(|e| e * e).sum();
        Some(Self {
            median: quantile(errors, 0.5)?,
            p90: quantile(errors, 0.9)?,
            p99: quantile(errors, 0.99)?,
            rms: (squares / errors.len() as f64).sqrt(),
        })
    }
}

/// Counts errors within 1, 2 and 3 predicted sigmas.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WithinSigmas {
    counts: [usize; 3],
    total: usize,
}

impl WithinSigmas {
    /// Counts an error of so many sigmas.
    pub fn add(&mut self, sigmas: f64) {
        self.total += 1;
        for (count, limit) in self.counts.iter_mut().zip([1.0, 2.0, 3.0]) {
            *count += usize::from(sigmas <= limit);
        }
    }

    /// The shares within 1, 2 and 3; `None` if nothing was counted.
    pub fn shares(&self) -> Option<[f64; 3]> {
        (self.total > 0).then(|| self.counts.map(|n| n as f64 / self.total as f64))
    }
}

/// Collects comparisons.
#[derive(Clone, Debug, Default)]
pub struct Comparisons {
    position: Vec<f64>,
    heading: Vec<f64>,
    within: [WithinSigmas; 3],
    without_truth: usize,
}

impl Comparisons {
    /// Compares a pose with its truth, or counts it as one that has none.
    pub fn add(&mut self, pose: &Pose<f64>, truth: Option<&Truth>) {
        let Some(truth) = truth else {
            self.without_truth += 1;
            return;
        };
        let off = pose.position - truth.position;
        let turned = angle::wrap_signed(pose.heading - truth.heading).abs();
        self.position.push(off.norm());
        self.heading.push(turned.to_degrees());
        let sigmas = [
            off.x.abs() / pose.sigma_x(),
            off.y.abs() / pose.sigma_y(),
            turned / pose.sigma_heading(),
        ];
        for (within, sigmas) in self.within.iter_mut().zip(sigmas) {
            within.add(sigmas);
        }
    }

    /// The result; `None` if no pose had a truth.
    pub fn finish(mut self) -> Option<Accuracy> {
        let compared = self.position.len();
        Some(Accuracy {
            position: Spread::of(&mut self.position)?,
            heading_degrees: Spread::of(&mut self.heading)?,
            within: self
                .within
                .map(|within| within.shares().unwrap_or_default()),
            compared,
            without_truth: self.without_truth,
        })
    }
}

/// Accuracy of answers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accuracy {
    /// Distances between answers and truth, in the unit of the targets' places.
    pub position: Spread,
    /// Absolute heading errors, degrees.
    pub heading_degrees: Spread,
    /// The shares of errors in x, y and heading within 1, 2 and 3 predicted sigmas.
    pub within: [[f64; 3]; 3],
    /// Answers compared.
    pub compared: usize,
    /// Answers whose truth is not known.
    pub without_truth: usize,
}

impl Accuracy {
    /// As text for people, lengths in this unit.
    pub fn display<'a>(&'a self, unit: &'a str) -> impl fmt::Display + 'a {
        fmt::from_fn(move |f| {
            let Self {
                position: p,
                heading_degrees: h,
                ..
            } = self;
            let per_cent = |share: f64| format!("{:.1} %", 100.0 * share);
            write!(f, "Errors of {} answers", self.compared)?;
            if self.without_truth > 0 {
                write!(f, " ({} more have no truth to compare)", self.without_truth)?;
            }
            writeln!(f)?;
            let position = format!("position [{unit}]");
            let head = ["median", "p90", "p99", "rms"];
            writeln!(
                f,
                "{:20}{:>10}{:>10}{:>10}{:>10}",
                "", head[0], head[1], head[2], head[3]
            )?;
            for (name, digits, s) in [(position.as_str(), 3, p), ("heading [deg]", 2, h)] {
                writeln!(
                    f,
                    "{name:20}{:10.digits$}{:10.digits$}{:10.digits$}{:10.digits$}",
                    s.median, s.p90, s.p99, s.rms
                )?;
            }
            writeln!(
                f,
                "{:20}{:>10}{:>10}{:>10}",
                "within", "1 sigma", "2 sigma", "3 sigma"
            )?;
            let [x, y, heading] = self.within;
            let rows = [
                ("x", x),
                ("y", y),
                ("heading", heading),
                ("Gaussian errors", GAUSSIAN),
            ];
            for (name, shares) in rows {
                let [one, two, three] = shares.map(per_cent);
                writeln!(f, "{name:20}{one:>10}{two:>10}{three:>10}")?;
            }
            Ok(())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Point2, Vector3};

    /// numpy.quantile([1, 2, 4, 8], ...)
    #[test]
    fn quantiles_are_those_of_numpy() {
        let values = [1.0, 2.0, 4.0, 8.0];
        for (q, expected) in [
            (0.0, 1.0),
            (0.25, 1.75),
            (0.5, 3.0),
            (0.9, 6.8),
            (0.99, 7.88),
            (1.0, 8.0),
        ] {
            assert!((quantile(&values, q).unwrap() - expected).abs() < 1e-12);
        }
        assert_eq!(quantile(&[5.0], 0.99), Some(5.0));
        assert_eq!(quantile(&[], 0.5), None);
    }

    #[test]
    fn headings_are_compared_across_north() {
        let pose = Pose {
            position: Point2::new(1.0, 1.0),
            heading: 0.01,
            covariance: Matrix3::from_diagonal(&Vector3::new(4.0, 0.04, 0.0001)),
        };
        let truth = Truth {
            position: Point2::new(4.0, 1.5),
            heading: -0.015,
        };
        let mut comparisons = Comparisons::default();
        comparisons.add(&pose, Some(&truth));
        comparisons.add(&pose, None);
        let accuracy = comparisons.finish().unwrap();
        assert_eq!((accuracy.compared, accuracy.without_truth), (1, 1));
        assert!((accuracy.position.median - 9.25_f64.sqrt()).abs() < 1e-12);
        assert!((accuracy.heading_degrees.rms - 0.025_f64.to_degrees()).abs() < 1e-12);
        // 1.5, 2.5 and 2.5 sigmas.
        assert_eq!(
            accuracy.within,
            [[0.0, 1.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]
        );
    }
}
