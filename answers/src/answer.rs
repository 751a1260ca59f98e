//! One answer for every recorded case, whatever is wrong with it.

use calib_core::{Refusal, resection};
use indexmap::IndexMap;

use crate::record::summary::Fit;
use crate::recorded::sightings::Case;

/// Chi squared of one degree of freedom that only one in a thousand exceeds by chance.
const ONE_IN_A_THOUSAND: f64 = 10.83;

/// Whether measurements contradict each other by more than their sigmas explain: only one in a
/// thousand answers would fit as badly by chance. What always fits must fit well too.
pub fn is_contradictory(chi_squared: f64, degrees_of_freedom: usize) -> bool {
    let fit = Fit {
        chi_squared,
        degrees_of_freedom,
    };
    fit.is_bad() || (degrees_of_freedom == 0 && chi_squared > ONE_IN_A_THOUSAND)
}

/// How to solve.
#[derive(Clone, Copy, Debug, Default)]
pub struct Settings {
    /// Sightings more than this many sigmas off the pose that most others agree on are dropped.
    pub reject: Option<f64>,
    /// Poses whose predicted [`sigma_position`](calib_core::Pose::sigma_position) is above this
    /// are [`Status::Uncertain`].
    pub max_sigma: Option<f64>,
}

/// What became of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Status {
    /// It has a pose.
    Ok,
    /// It has a pose, but a less certain one than was asked for.
    Uncertain,
    /// It has a pose that is certain enough if its sigmas are right, which they hardly are: see
    /// [`is_contradictory`].
    Contradictory,
    /// One of its rows could not be read.
    Unreadable,
    /// The solver refused it.
    Refused(Refusal),
}

impl Status {
    /// The status in `snake_case`, as it stands in files. Stable.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Uncertain => "uncertain",
            Self::Contradictory => "contradictory",
            Self::Unreadable => "unreadable",
            Self::Refused(refusal) => refusal.name(),
        }
    }

    /// Whether there is a pose, as certain as was asked for by its own prediction.
    pub fn is_kept(self) -> bool {
        matches!(self, Self::Ok | Self::Contradictory)
    }

    /// What is the matter, and what to do about it; nothing for [`Status::Ok`].
    pub fn advice(self) -> Option<String> {
        match self {
            Self::Ok => None,
            Self::Uncertain => Some(
                "the predicted sigma is above the limit: stop the target at better places"
                    .to_owned(),
            ),
            Self::Contradictory => Some(
                "the sightings contradict each other, so neither pose nor sigmas can be relied on: \
                 look for wrong sightings (--reject 4 leaves them out of five or more), check the \
                 camera and the sigmas given, or stop the target at more places"
                    .to_owned(),
            ),
            Self::Unreadable => Some("a row of the case could not be read: correct it".to_owned()),
            Self::Refused(refusal) => Some(refusal.to_string()),
        }
    }
}

/// The answer for one case.
#[derive(Clone, Copy, Debug)]
pub struct Answer<'a> {
    /// Whose.
    pub case: &'a str,
    /// What became of it.
    pub status: Status,
    /// The pose, if there is one.
    pub solution: Option<resection::Solution<f64>>,
    /// How many sightings were recorded, whether used, dropped or unreadable.
    pub sightings: usize,
    /// How many of them were dropped as outliers.
    pub dropped: usize,
}

/// Solves cases, keeping its buffer from one to the next.
#[derive(Debug, Default)]
pub struct Solver {
    settings: Settings,
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

    /// Solves the case of this name.
    pub fn answer<'a>(&mut self, id: &'a str, case: &Case) -> Answer<'a> {
        let (status, solution) = self.solve(case);
        let dropped = solution.map_or(0, |s| case.sightings.len().saturating_sub(s.used));
        Answer {
            case: id,
            status,
            solution,
            sightings: case.sightings.len() + case.unreadable,
            dropped,
        }
    }

    fn solve(&mut self, case: &Case) -> (Status, Option<resection::Solution<f64>>) {
        if case.unreadable > 0 {
            return (Status::Unreadable, None);
        }
        let solved = match self.settings.reject {
            Some(gate) => {
                self.dropped.resize(case.sightings.len(), false);
                resection::solve_rejecting(&case.sightings, gate, &mut self.dropped)
            }
            None => resection::solve(&case.sightings),
        };
        let within = |sigma: f64| self.settings.max_sigma.is_none_or(|limit| sigma <= limit);
        match solved {
            Ok(solution) => {
                let status = if !within(solution.pose.sigma_position()) {
                    Status::Uncertain
                } else if is_contradictory(solution.chi_squared, solution.degrees_of_freedom()) {
                    Status::Contradictory
                } else {
                    Status::Ok
                };
                (status, Some(solution))
            }
            Err(refusal) => (Status::Refused(refusal), None),
        }
    }
}

/// How many cases came to what.
#[derive(Clone, Debug, Default)]
pub struct Tally(IndexMap<Status, usize>);

impl Tally {
    /// Counts one.
    pub fn add(&mut self, status: Status) {
        *self.0.entry(status).or_default() += 1;
    }

    /// How many came to this.
    pub fn count(&self, status: Status) -> usize {
        self.0.get(&status).copied().unwrap_or_default()
    }

    /// How many there were.
    pub fn total(&self) -> usize {
        self.0.values().sum()
    }

    /// Every status that occurred with its count: [`Status::Ok`] first, then the most frequent.
    pub fn sorted(&self) -> Vec<(Status, usize)> {
        let mut all: Vec<_> = self.0.iter().map(|(&s, &n)| (s, n)).collect();
        all.sort_by_key(|&(status, n)| (status != Status::Ok, std::cmp::Reverse(n)));
        all
    }
}
