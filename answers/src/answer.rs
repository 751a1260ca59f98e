//! One answer for every recorded case, whatever is wrong with it.

use calib_core::{Limits, Refusal, Sighting, Status, resection};
use indexmap::IndexMap;

use crate::recorded::sightings::Case;

/// How to solve.
#[derive(Clone, Copy, Debug, Default)]
pub struct Settings {
    /// Sightings more than this many sigmas off the pose that most others agree on are dropped.
    pub reject: Option<f64>,
    /// Poses whose predicted [`sigma_position`](calib_core::Pose::sigma_position) is above this
    /// are [`Status::Weak`].
    pub max_sigma: Option<f64>,
}

/// Why a case has no pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Reason {
    /// One of its rows could not be read.
    Unreadable,
    /// The solver refused it.
    Refusal(Refusal),
}

impl Reason {
    /// The reason in `snake_case`, as it stands in files. Stable.
    pub fn name(self) -> &'static str {
        match self {
            Self::Unreadable => "unreadable",
            Self::Refusal(refusal) => refusal.name(),
        }
    }

    /// What it comes to.
    fn status(self) -> Status {
        match self {
            Self::Unreadable => Status::Refused,
            Self::Refusal(refusal) => refusal.into(),
        }
    }
}

/// Whether there is a pose, as certain as was asked for by its own prediction.
pub fn is_kept(status: Status) -> bool {
    matches!(status, Status::Calibrated | Status::Doubtful)
}

/// What is the matter, and what to do about it; nothing for [`Status::Calibrated`].
pub fn advice(status: Status, reason: Option<Reason>) -> Option<String> {
    let advice = match (status, reason) {
        (_, Some(Reason::Refusal(refusal))) => return Some(refusal.to_string()),
        (_, Some(Reason::Unreadable)) => "a row of the case could not be read: correct it",
        (Status::Weak, None) => {
            "the predicted sigma is above the limit: stop the target at better places"
        }
        (Status::Doubtful, None) => {
            "the sightings contradict each other, so neither pose nor sigmas can be relied on: \
             look for wrong sightings (--reject 4 leaves them out of five or more), check the \
             camera and the sigmas given, or stop the target at more places"
        }
        _ => return None,
    };
    Some(advice.to_owned())
}

/// The answer for one case.
#[derive(Clone, Copy, Debug)]
pub struct Answer<'a> {
    /// Whose.
    pub case: &'a str,
    /// What became of it.
    pub status: Status,
    /// Why it has no pose.
    pub reason: Option<Reason>,
    /// The pose, if there is one.
    pub solution: Option<resection::Solution<f64>>,
    /// How many sightings were recorded, whether used, dropped or unreadable.
    pub sightings: usize,
    /// How many of them were dropped as outliers.
    pub dropped: usize,
}

/// Solves cases, keeping its buffers from one to the next.
#[derive(Debug, Default)]
pub struct Solver {
    settings: Settings,
    sightings: Vec<Sighting<f64>>,
    dropped: Vec<bool>,
}

impl Solver {
    /// A solver of these settings.
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            ..Self::default()
        }
    }

    /// Solves one case.
    pub fn answer<'a>(&mut self, case: &Case<'a>) -> Answer<'a> {
        let solved = self.solve(case);
        let solution = solved.ok();
        let reason = solved.err();
        let limits = Limits {
            position: self.settings.max_sigma.unwrap_or(f64::INFINITY),
            heading: f64::INFINITY,
        };
        let status = match &solved {
            Ok(solution) => Status::of(&solution.pose, &solution.fit(), &limits),
            Err(reason) => reason.status(),
        };
        let dropped = solution.map_or(0, |s| self.sightings.len().saturating_sub(s.used));
        Answer {
            case: case.id(),
            status,
            reason,
            solution,
            sightings: case.rows(),
            dropped,
        }
    }

    fn solve(&mut self, case: &Case<'_>) -> Result<resection::Solution<f64>, Reason> {
        if !case.is_readable() {
            return Err(Reason::Unreadable);
        }
        self.sightings.clear();
        self.sightings.extend(case.sightings());
        let solved = match self.settings.reject {
            Some(gate) => {
                self.dropped.resize(self.sightings.len(), false);
                resection::solve_rejecting(&self.sightings, gate, &mut self.dropped)
            }
            None => resection::solve(&self.sightings),
        };
        solved.map_err(Reason::Refusal)
    }
}

/// How many cases came to what.
#[derive(Clone, Debug, Default)]
pub struct Tally(IndexMap<(Status, Option<Reason>), usize>);

impl Tally {
    /// Counts one.
    pub fn add(&mut self, answer: &Answer<'_>) {
        *self.0.entry((answer.status, answer.reason)).or_default() += 1;
    }

    /// How many have this reason.
    pub fn because(&self, reason: Reason) -> usize {
        let all = self.0.iter();
        let of_it = all.filter(|((_, why), _)| *why == Some(reason));
        of_it.map(|(_, n)| n).sum()
    }

    /// How many came to this.
    pub fn count(&self, status: Status) -> usize {
        let all = self.0.iter().filter(|((of, _), _)| *of == status);
        all.map(|(_, n)| n).sum()
    }

    /// How many there were.
    pub fn total(&self) -> usize {
        self.0.values().sum()
    }

    /// All that occurred, with its count: [`Status::Calibrated`] first, then the most frequent.
    pub fn sorted(&self) -> Vec<((Status, Option<Reason>), usize)> {
        let mut all: Vec<_> = self.0.iter().map(|(&s, &n)| (s, n)).collect();
        all.sort_by_key(|&((status, _), n)| (status != Status::Calibrated, std::cmp::Reverse(n)));
        all
    }
}
