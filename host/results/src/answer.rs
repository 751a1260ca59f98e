//! One answer for every recorded case, whatever is wrong with it.

use calib_core::{Limits, Pose, Refusal, Status, resection};
use indexmap::IndexMap;
use nalgebra::Point2;

use crate::recorded::sightings::Case;

/// Options of the solve.
#[derive(Clone, Copy, Debug, Default)]
pub struct Settings {
    /// Sightings more than this many sigmas off the pose that most others agree on are dropped.
    pub reject: Option<f64>,
    /// Poses whose predicted [`sigma_position`](calib_core::Pose::sigma_position) is above this
    /// are [`Status::Weak`].
    pub max_sigma: Option<f64>,
}

/// Why a case has no pose, or none to rely on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Reason {
    /// One of its rows could not be read.
    Unreadable,
    /// The solver refused it.
    Refusal(Refusal),
    /// The sightings do not fit the pose.
    Contradictory,
    /// They allow another place, far beyond the sigmas.
    Ambiguous,
}

impl Reason {
    /// The reason in `snake_case`, as it stands in files. Stable.
    pub fn name(self) -> &'static str {
        match self {
            Self::Unreadable => "unreadable",
            Self::Refusal(refusal) => refusal.name(),
            Self::Contradictory => "contradictory",
            Self::Ambiguous => "ambiguous",
        }
    }

    /// Status that it leads to.
    fn status(self) -> Status {
        match self {
            Self::Unreadable => Status::Refused,
            Self::Refusal(refusal) => refusal.into(),
            Self::Contradictory | Self::Ambiguous => Status::Doubtful,
        }
    }
}

/// Returns true if there is a pose, as certain as was asked for by its own prediction. That of an ambiguous
/// one does not count, since the sightings themselves refute it.
pub fn is_kept(status: Status, reason: Option<Reason>) -> bool {
    status == Status::Calibrated || reason == Some(Reason::Contradictory)
}

/// Description of the problem, with advice; nothing for [`Status::Calibrated`].
pub fn advice(status: Status, reason: Option<Reason>) -> Option<String> {
    let advice = match (status, reason) {
        (_, Some(Reason::Refusal(refusal))) => return Some(refusal.to_string()),
        (_, Some(Reason::Unreadable)) => "a row of the case could not be read: correct it",
        (Status::Weak, None) => {
            "the predicted sigma is above the limit: stop the target at better places"
        }
        (_, Some(Reason::Ambiguous)) => {
            "the sightings fit another place, more than five sigmas off, nearly as well (the danger \
             circle, or targets close to each other or to the camera): stop the target once more, \
             nearer or farther than so far"
        }
        (_, Some(Reason::Contradictory)) => {
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
    /// Name of the case.
    pub case: &'a str,
    /// Status of its answer.
    pub status: Status,
    /// Why it has no pose, or none to rely on.
    pub reason: Option<Reason>,
    /// The pose, if there is one.
    pub solution: Option<resection::Solution<f64>>,
    /// Another place that the sightings allow, if the pose is ambiguous.
    pub alternative: Option<Point2<f64>>,
    /// Number of sightings that were recorded, whether used, dropped or unreadable.
    pub sightings: usize,
    /// Number of sightings that were dropped as outliers.
    pub dropped: usize,
    /// Number of rows that repeat another one, and count neither as sightings nor as dropped.
    pub repeated: usize,
}

/// Solves cases, keeping its buffer from one to the next.
#[derive(Debug, Default)]
pub struct Solver {
    settings: Settings,
    dropped: Vec<bool>,
}

impl Answer<'_> {
    /// Returns true if it [is kept](is_kept).
    pub fn is_kept(&self) -> bool {
        is_kept(self.status, self.reason)
    }
}

impl Solver {
    /// A solver of these settings.
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            ..Self::default()
        }
    }

    /// Solves the case of this name.
    pub fn answer<'a>(&mut self, id: &'a str, case: &Case) -> Answer<'a> {
        let solved = self.solve(case);
        let solution = solved.ok();
        let limits = Limits {
            position: self.settings.max_sigma.unwrap_or(f64::INFINITY),
            heading: f64::INFINITY,
        };
        let mut alternative = None;
        let (status, reason) = match &solved {
            Ok(solution) => match Status::of(&solution.pose, &solution.fit(), &limits) {
                Status::Doubtful => (Status::Doubtful, Some(Reason::Contradictory)),
                Status::Calibrated => {
                    alternative = self.alternative(case, &solution.pose);
                    let reason = alternative.map(|_| Reason::Ambiguous);
                    (reason.map_or(Status::Calibrated, Reason::status), reason)
                }
                status => (status, None),
            },
            Err(reason) => (reason.status(), Some(*reason)),
        };
        let dropped = solution.map_or(0, |s| case.sightings.len().saturating_sub(s.used));
        Answer {
            case: id,
            status,
            reason,
            solution,
            alternative,
            sightings: case.sightings.len() + case.unreadable,
            dropped,
            repeated: case.repeated,
        }
    }

    /// Beside the pose that was solved last.
    fn alternative(&self, case: &Case, pose: &Pose<f64>) -> Option<Point2<f64>> {
        let dropped = match self.settings.reject {
            Some(_) => &self.dropped[..],
            None => &[],
        };
        resection::alternative(&case.sightings, dropped, pose, pose.sigma_position())
    }

    fn solve(&mut self, case: &Case) -> Result<resection::Solution<f64>, Reason> {
        if case.unreadable > 0 {
            return Err(Reason::Unreadable);
        }
        let solved = match self.settings.reject {
            Some(gate) => {
                self.dropped.resize(case.sightings.len(), false);
                resection::solve_rejecting(&case.sightings, gate, &mut self.dropped)
            }
            None => resection::solve(&case.sightings),
        };
        solved.map_err(Reason::Refusal)
    }
}

/// Number of cases by status and reason.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    cases: IndexMap<(Status, Option<Reason>), usize>,
    /// Rows that repeat another one of their case.
    pub repeated: usize,
}

impl Tally {
    /// Counts one.
    pub fn add(&mut self, answer: &Answer<'_>) {
        let case = self.cases.entry((answer.status, answer.reason));
        *case.or_default() += 1;
        self.repeated += answer.repeated;
    }

    /// Number of cases that have this reason.
    pub fn because(&self, reason: Reason) -> usize {
        let all = self.cases.iter();
        let of_it = all.filter(|((_, why), _)| *why == Some(reason));
        of_it.map(|(_, n)| n).sum()
    }

    /// Number of cases with this status.
    pub fn count(&self, status: Status) -> usize {
        let all = self.cases.iter().filter(|((of, _), _)| *of == status);
        all.map(|(_, n)| n).sum()
    }

    /// Number of cases.
    pub fn total(&self) -> usize {
        self.cases.values().sum()
    }

    /// All that occurred, with its count: [`Status::Calibrated`] first, then the most frequent.
    pub fn sorted(&self) -> Vec<((Status, Option<Reason>), usize)> {
        let mut all: Vec<_> = self.cases.iter().map(|(&s, &n)| (s, n)).collect();
        all.sort_by_key(|&((status, _), n)| (status != Status::Calibrated, std::cmp::Reverse(n)));
        all
    }
}
