//! Counts over all runs.

use std::{collections::BTreeMap, fmt};

use calib_core::Status;
use comfy_table::{Table, presets::ASCII_MARKDOWN};

use crate::{
    journal::Judged,
    judgement::{Failure, Judgement, Kind},
};

/// So many numbers of failing runs are listed of a kind.
const LISTED: usize = 40;

/// Counts over all runs.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    runs: usize,
    cameras: usize,
    statuses: BTreeMap<&'static str, usize>,
    calibrated: usize,
    checked: usize,
    false_alarms: usize,
    saw_enough: usize,
    /// Runs, and failures in all, of each kind.
    failing: BTreeMap<Kind, (Vec<u64>, usize)>,
    /// Statuses of the cameras that saw enough and are not calibrated.
    late: BTreeMap<String, usize>,
    /// Errors of the poses that are told as good, where the place was not given.
    errors: Vec<f64>,
    worst: BTreeMap<Kind, (u64, f64, Failure)>,
    /// The runs that had something unusual, by its name.
    with: BTreeMap<String, With>,
}

/// Counts over some of the runs.
#[derive(Clone, Copy, Debug, Default)]
struct With {
    runs: usize,
    calibrated: usize,
    deceived: usize,
    cameras: usize,
    false_alarms: usize,
    saw_enough: usize,
    late: usize,
}

impl With {
    fn add(&mut self, judgement: &Judgement) {
        let cameras = || judgement.cameras.iter();
        let failures = |kinds: &[Kind]| {
            let failures = judgement.failures.iter();
            failures
                .filter(|failure| kinds.contains(&failure.kind()))
                .count()
        };
        self.runs += 1;
        self.cameras += cameras().count();
        self.calibrated += cameras().filter(|c| c.status == Status::Calibrated).count();
        self.false_alarms += cameras().filter(|c| c.is_false_alarm).count();
        self.saw_enough += cameras().filter(|c| c.saw_enough).count();
        self.deceived += failures(&[Kind::Deceives, Kind::Turned]);
        self.late += failures(&[Kind::Late]);
    }
}

impl Tally {
    /// Counts a run.
    pub fn add(&mut self, run: &Judged) {
        let Judged {
            number, judgement, ..
        } = run;
        let number = *number;
        for name in &run.ingredients {
            self.with.entry(name.clone()).or_default().add(judgement);
        }
        self.runs += 1;
        for camera in &judgement.cameras {
            self.cameras += 1;
            *self.statuses.entry(camera.status.name()).or_default() += 1;
            self.false_alarms += usize::from(camera.is_false_alarm);
            self.saw_enough += usize::from(camera.saw_enough);
            if camera.status == Status::Calibrated {
                self.calibrated += 1;
                self.checked += usize::from(camera.is_checked);
                self.errors.extend(camera.error);
            }
        }
        for failure in &judgement.failures {
            let (runs, count) = self.failing.entry(failure.kind()).or_default();
            *count += 1;
            if runs.last() != Some(&number) {
                runs.push(number);
            }
            let size = match failure {
                Failure::Unprotected { error, level, .. } => error / level,
                Failure::Deceives { error, .. } => *error,
                Failure::Turned { degrees, .. } => *degrees,
                Failure::Late { status, reason, .. } => {
                    let reason = reason.map(|reason| format!(": {}", reason.name()));
                    let what = format!("{}{}", status.name(), reason.unwrap_or_default());
                    *self.late.entry(what).or_default() += 1;
                    continue;
                }
                _ => 0.0,
            };
            let worst = self.worst.entry(failure.kind());
            let worst = worst.or_insert_with(|| (number, size, failure.clone()));
            if size > worst.1 {
                *worst = (number, size, failure.clone());
            }
        }
    }

    /// Numbers of the runs with a failure of this kind, ascending.
    pub fn failing(&self, kind: Kind) -> Vec<u64> {
        let mut runs = self
            .failing
            .get(&kind)
            .map_or(Vec::new(), |(runs, _)| runs.clone());
        runs.sort_unstable();
        runs
    }

    /// The share of the poses told as good that err by more than five sigmas, and by half a unit or two degrees.
    pub fn deceiving(&self) -> f64 {
        self.deceived() as f64 / self.calibrated.max(1) as f64
    }

    /// The share of the cameras that saw enough after the last fault and are not calibrated.
    pub fn late(&self) -> f64 {
        self.count(Kind::Late) as f64 / self.saw_enough.max(1) as f64
    }

    /// A pose is one of both kinds, never of both.
    fn deceived(&self) -> usize {
        self.count(Kind::Deceives) + self.count(Kind::Turned)
    }

    fn count(&self, kind: Kind) -> usize {
        self.failing.get(&kind).map_or(0, |(_, count)| *count)
    }

    /// The error that this share of the poses that are told as good stays within.
    fn quantile(&self, share: f64) -> f64 {
        let mut errors = self.errors.clone();
        errors.sort_by(f64::total_cmp);
        let place = (errors.len() as f64 * share) as usize;
        errors
            .get(place.min(errors.len().saturating_sub(1)))
            .copied()
            .unwrap_or(0.0)
    }
}

impl Tally {
    /// A run has several causes, and counts with each.
    fn write_causes(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = Table::new();
        table.load_style(ASCII_MARKDOWN);
        table.set_header([
            "runs with",
            "runs",
            "calibrated",
            "deceived",
            "false alarms",
            "late",
        ]);
        for (name, with) in &self.with {
            table.add_row([
                name.clone(),
                with.runs.to_string(),
                with.calibrated.to_string(),
                share(with.deceived, with.calibrated),
                share(with.false_alarms, with.cameras),
                share(with.late, with.saw_enough),
            ]);
        }
        writeln!(f, "{table}")
    }
}

/// Percentage points of a standard normal distribution that 95 % are within.
const Z: f64 = 1.96;

/// Bounds of the share that 95 % of such counts are consistent with (Wilson 1927).
fn interval(part: usize, of: usize) -> [f64; 2] {
    if of == 0 {
        return [0.0, 1.0];
    }
    let (count, share) = (of as f64, part as f64 / of as f64);
    let middle = share + Z * Z / (2.0 * count);
    let width = Z * (share * (1.0 - share) / count + Z * Z / (4.0 * count * count)).sqrt();
    let scale = 1.0 + Z * Z / count;
    [middle - width, middle + width].map(|bound| (bound / scale).clamp(0.0, 1.0))
}

fn share(part: usize, of: usize) -> String {
    format!("{part}, {:.1} %", 100.0 * part as f64 / of.max(1) as f64)
}

fn percent(part: usize, of: usize) -> String {
    let [low, high] = interval(part, of).map(|share| 100.0 * share);
    let share = 100.0 * part as f64 / of.max(1) as f64;
    format!("{share:.2} % ({low:.2} to {high:.2})")
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = Table::new();
        table.load_style(ASCII_MARKDOWN);
        table.set_header(["of", "what", "count", "share (95 %)"]);
        let mut row = |of: &str, what: String, count: usize, all: usize| {
            table.add_row([of.to_owned(), what, count.to_string(), percent(count, all)]);
        };
        for (status, count) in &self.statuses {
            row("cameras", (*status).into(), *count, self.cameras);
        }
        row(
            "cameras",
            "false alarms".into(),
            self.false_alarms,
            self.cameras,
        );
        row(
            "calibrated",
            "with a protection level".into(),
            self.checked,
            self.calibrated,
        );
        row(
            "calibrated",
            "deceived, by place or heading".into(),
            self.deceived(),
            self.calibrated,
        );
        row(
            "with a protection level",
            Kind::Unprotected.name().into(),
            self.count(Kind::Unprotected),
            self.checked,
        );
        row(
            "saw enough",
            Kind::Late.name().into(),
            self.count(Kind::Late),
            self.saw_enough,
        );
        for (what, count) in &self.late {
            row("saw enough", format!("  {what}"), *count, self.saw_enough);
        }
        for kind in Kind::ALL {
            row(
                "runs",
                kind.name().into(),
                self.failing(kind).len(),
                self.runs,
            );
        }
        writeln!(f, "{} runs, {} cameras\n{table}", self.runs, self.cameras)?;
        writeln!(
            f,
            "errors of poses told as calibrated: half within {:.3} units, 99 % within {:.3}, all within {:.2}",
            self.quantile(0.5),
            self.quantile(0.99),
            self.quantile(1.0)
        )?;
        self.write_causes(f)?;
        for kind in Kind::ALL {
            let runs = self.failing(kind);
            if runs.is_empty() {
                continue;
            }
            let numbers: Vec<_> = runs.iter().take(LISTED).map(u64::to_string).collect();
            let more = if runs.len() > LISTED { " ..." } else { "" };
            writeln!(f, "{}: runs {}{more}", kind.name(), numbers.join(" "))?;
            if let Some((run, _, worst)) = self.worst.get(&kind) {
                writeln!(f, "  the worst, run {run}: {worst}")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Figures of the literature: Newcombe, Statistics in Medicine 17 (1998), table I.
    #[test]
    fn intervals_are_those_of_the_literature() {
        for (part, of, low, high) in [
            (81, 263, 0.2553, 0.3662),
            (15, 148, 0.0624, 0.1605),
            (0, 20, 0.0, 0.1611),
            (1, 29, 0.0061, 0.1718),
        ] {
            let [a, b] = interval(part, of);
            assert!(
                (a - low).abs() < 1e-4 && (b - high).abs() < 1e-4,
                "{part} of {of}: {a} {b}"
            );
        }
    }
}
