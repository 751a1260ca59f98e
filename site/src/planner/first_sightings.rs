//! What cameras see first.

use nalgebra::Matrix3;

/// What an e-fold of a camera's score is worth, in ranges of way.
const WORTH: f64 = 2.0;
/// The worst that can come of it, e-folds.
const WORST: f64 = 10.0;

/// What one camera may see, and how well it should do from the first stops that it sees.
pub(super) struct FirstSightings {
    /// What each place tells it; `None` where it sees nothing that it would count.
    pub(super) tells: Vec<Option<Matrix3<f64>>>,
    /// The score that is good enough.
    pub(super) enough: f64,
    /// Its range.
    pub(super) range: f64,
}

impl FirstSightings {
    /// What it costs, as a length of way, that the first `count` sightings along an order of places
    /// are worse than they should be.
    pub(super) fn price(
        &self,
        order: impl Iterator<Item = usize>,
        count: usize,
        score: impl Fn(&Matrix3<f64>, f64) -> f64,
    ) -> f64 {
        let first = order
            .filter_map(|place| self.tells[place])
            .take(count)
            .sum();
        let excess = (score(&first, self.range) / self.enough).ln();
        WORTH * self.range * excess.clamp(0.0, WORST)
    }
}
