//! Counts over all runs.

use std::{collections::BTreeMap, fmt};

use calib_core::Status;
use comfy_table::{Table, presets::ASCII_MARKDOWN};

use crate::judgement::{Failure, Judgement, Kind};

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
}

impl Tally {
    /// Counts a run.
    pub fn add(&mut self, number: u64, judgement: &Judgement) {
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

    /// The share of the poses told as good that err by more than five sigmas and half a unit.
    pub fn deceiving(&self) -> f64 {
        self.count(Kind::Deceives) as f64 / self.calibrated.max(1) as f64
    }

    /// The share of the cameras that saw enough after the last fault and are not calibrated.
    pub fn late(&self) -> f64 {
        self.count(Kind::Late) as f64 / self.saw_enough.max(1) as f64
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

fn percent(part: usize, of: usize) -> String {
    format!("{:.2} %", 100.0 * part as f64 / of.max(1) as f64)
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = Table::new();
        table.load_style(ASCII_MARKDOWN);
        table.set_header(["of", "what", "count", "share"]);
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
        let deceived = self.count(Kind::Deceives);
        row(
            "calibrated",
            Kind::Deceives.name().into(),
            deceived,
            self.calibrated,
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
