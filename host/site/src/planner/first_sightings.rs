//! First sightings of cameras along a way.

use std::ops::RangeInclusive;

use nalgebra::Matrix3;

use super::route::Price;

/// Worth of an e-fold of a camera's score, in ranges of way.
const WORTH: f64 = 2.0;
/// The worst that can come of it, e-folds.
const WORST: f64 = 10.0;

/// Possible sightings of one camera, and how well it should do from the first stops that it sees.
pub(super) struct FirstSightings {
    /// Information from each place; `None` where it sees nothing that it would count.
    pub(super) tells: Vec<Option<Matrix3<f64>>>,
    /// The score that is good enough.
    pub(super) enough: f64,
    /// Its range.
    pub(super) range: f64,
}

impl FirstSightings {
    /// Price, as a length of way, of the first `count` sightings along an order of places being worse than they
    /// should be.
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

/// The prices of all cameras, of orders of the places behind the first ones.
pub(super) struct Prices<'a, S> {
    cameras: &'a [FirstSightings],
    /// Places that come before these in any case, in their order.
    before: &'a [usize],
    count: usize,
    score: S,
    /// Each camera's price for the settled order, and the last index of an order that it looks at.
    settled: Vec<(f64, usize)>,
}

impl<'a, S: Fn(&Matrix3<f64>, f64) -> f64> Prices<'a, S> {
    pub(super) fn new(
        cameras: &'a [FirstSightings],
        before: &'a [usize],
        count: usize,
        score: S,
    ) -> Self {
        Self {
            cameras,
            before,
            count,
            score,
            settled: Vec::new(),
        }
    }

    fn places<'b>(&'b self, order: &'b [usize]) -> impl Iterator<Item = usize> + 'b {
        let first = self.before.len();
        { self.before.iter().copied() }.chain(order.iter().map(move |index| index + first))
    }
}

impl<S: Fn(&Matrix3<f64>, f64) -> f64> Price for Prices<'_, S> {
    fn settle(&mut self, order: &[usize]) -> f64 {
        let settled = self.cameras.iter().map(|camera| {
            let price = camera.price(self.places(order), self.count, &self.score);
            let seen = { self.places(order).enumerate() }
                .filter(|(_, place)| camera.tells[*place].is_some());
            let last = seen.map(|(n, _)| n).nth(self.count - 1);
            let last = last.map_or(usize::MAX, |last| last.saturating_sub(self.before.len()));
            (price, last)
        });
        self.settled = settled.collect();
        self.settled.iter().map(|(price, _)| price).sum()
    }

    fn of(&mut self, order: &[usize], changed: RangeInclusive<usize>) -> f64 {
        let prices = self
            .cameras
            .iter()
            .zip(&self.settled)
            .map(|(camera, (price, last))| {
                // Its first ones are the same, in whatever order, unless one comes in from behind the last of them.
                if last < changed.start() || last >= changed.end() {
                    *price
                } else {
                    camera.price(self.places(order), self.count, &self.score)
                }
            });
        prices.sum()
    }
}
