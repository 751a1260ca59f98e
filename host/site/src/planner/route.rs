//! In which order to visit places: a short open path from a given start.

use std::ops::RangeInclusive;

use nalgebra::Point2;

/// Longer than any detour.
const BLOCKED: f64 = 1e6;
/// Sweeps over all changes of an order; a few are usual.
const SWEEPS: usize = 20;

/// A walk that begins at one place and visits others.
pub(super) struct Route {
    /// From the start, then from each place, to each place.
    ways: Vec<Vec<f64>>,
}

impl Route {
    /// Blocked ways are avoided if any order can.
    pub(super) fn new(
        start: Point2<f64>,
        places: &[Point2<f64>],
        blocked: impl Fn(Point2<f64>, Point2<f64>) -> bool,
    ) -> Self {
        let way = |from: Point2<f64>, to: Point2<f64>| {
            let penalty = if blocked(from, to) { BLOCKED } else { 0.0 };
            (to - from).norm() + penalty
        };
        let from = std::iter::once(&start).chain(places);
        let ways = from.map(|&from| places.iter().map(|&to| way(from, to)).collect());
        Self {
            ways: ways.collect(),
        }
    }

    fn length(&self, order: &[usize]) -> f64 {
        let from = std::iter::once(0).chain(order.iter().map(|index| index + 1));
        from.zip(order).map(|(from, &to)| self.ways[from][to]).sum()
    }

    /// A short order: always on to the nearest, then turned around piece by piece (2-opt) while that
    /// shortens it.
    pub(super) fn shortest(&self) -> Vec<usize> {
        let mut left: Vec<_> = (0..self.ways.len() - 1).collect();
        let mut order = Vec::with_capacity(left.len());
        let mut here = 0;
        while let Some(nearest) = (0..left.len()).min_by(|&a, &b| {
            let way = |n: usize| self.ways[here][left[n]];
            way(a).total_cmp(&way(b))
        }) {
            let next = left.remove(nearest);
            here = next + 1;
            order.push(next);
        }
        self.improve(&mut order, &mut Free);
        order
    }

    /// Turns pieces around and moves single places while that lowers the length and the other
    /// `price` of an order together.
    pub(super) fn improve(&self, order: &mut Vec<usize>, price: &mut impl Price) {
        let mut length = self.length(order);
        let mut paid = price.settle(order);
        let mut trial = Vec::with_capacity(order.len());
        for _ in 0..SWEEPS {
            let before = length + paid;
            for change in changes(order.len()) {
                // An order that is dearer by its length alone needs no price.
                if self.longer(order, &change) > paid + ROUNDING {
                    continue;
                }
                trial.clone_from(order);
                change.make(&mut trial);
                let trial_length = self.length(&trial);
                if trial_length >= length + paid - 1e-9 {
                    continue;
                }
                let trial_paid = price.of(&trial, change.span());
                if trial_length + trial_paid < length + paid - 1e-9 {
                    order.clone_from(&trial);
                    length = trial_length;
                    paid = price.settle(order);
                }
            }
            if !(length + paid < before) {
                break;
            }
        }
    }

    /// By how much a change makes an order longer: only the ways at its ends are other ones. Ways are as long
    /// back as there.
    fn longer(&self, order: &[usize], change: &Change) -> f64 {
        // The place at an index, with the start before the first.
        let at = |index: usize| match index.checked_sub(1) {
            Some(index) => order.get(index).copied().map(Some),
            None => Some(None),
        };
        let way = |from: Option<Option<usize>>, to: Option<Option<usize>>| match (from, to) {
            (Some(from), Some(Some(to))) => self.ways[from.map_or(0, |from| from + 1)][to],
            _ => 0.0,
        };
        match *change {
            Change::Turn(first, last) => {
                let (before, first, last, after) =
                    (at(first), at(first + 1), at(last + 1), at(last + 2));
                way(before, last) + way(first, after) - way(before, first) - way(last, after)
            }
            Change::Move(from, to) => {
                let (before, moved, after) = (at(from), at(from + 1), at(from + 2));
                let (left, right) = if to > from {
                    (at(to + 1), at(to + 2))
                } else {
                    (at(to), at(to + 1))
                };
                way(before, after) + way(left, moved) + way(moved, right)
                    - way(before, moved)
                    - way(moved, after)
                    - way(left, right)
            }
        }
    }
}

/// Lengths that differ by no more are the same.
const ROUNDING: f64 = 1e-6;

/// Price of an order beside its length.
pub(super) trait Price {
    /// Price of this order; others are changes of it from now on.
    fn settle(&mut self, order: &[usize]) -> f64;

    /// Price of the settled order, changed between these indices.
    fn of(&mut self, order: &[usize], changed: RangeInclusive<usize>) -> f64;
}

/// Only the length counts.
struct Free;

impl Price for Free {
    fn settle(&mut self, _order: &[usize]) -> f64 {
        0.0
    }

    fn of(&mut self, _order: &[usize], _changed: RangeInclusive<usize>) -> f64 {
        0.0
    }
}

/// A change of an order.
enum Change {
    /// This piece backwards, both ends inside.
    Turn(usize, usize),
    /// The one at the first index to the second.
    Move(usize, usize),
}

impl Change {
    fn make(&self, order: &mut Vec<usize>) {
        match *self {
            Self::Turn(first, last) => order[first..=last].reverse(),
            Self::Move(from, to) => {
                let index = order.remove(from);
                order.insert(to, index);
            }
        }
    }
}

impl Change {
    /// The indices between which an order changes.
    fn span(&self) -> RangeInclusive<usize> {
        match *self {
            Self::Turn(first, last) => first..=last,
            Self::Move(from, to) => from.min(to)..=from.max(to),
        }
    }
}

fn changes(count: usize) -> impl Iterator<Item = Change> {
    let turns = (0..count)
        .flat_map(move |first| (first + 1..count).map(move |last| Change::Turn(first, last)));
    let moves = (0..count).flat_map(move |from| {
        (0..count)
            .filter(move |to| from.abs_diff(*to) > 1)
            .map(move |to| Change::Move(from, to))
    });
    turns.chain(moves)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn route(places: &[Point2<f64>], blocked: impl Fn(Point2<f64>, Point2<f64>) -> bool) -> Route {
        Route::new(Point2::origin(), places, blocked)
    }

    /// The price of not beginning with the last one.
    struct Late(f64);

    impl Price for Late {
        fn settle(&mut self, order: &[usize]) -> f64 {
            if order[0] == 4 { 0.0 } else { self.0 }
        }

        fn of(&mut self, order: &[usize], _changed: RangeInclusive<usize>) -> f64 {
            self.settle(order)
        }
    }

    /// A change's length is told from its ends alone.
    #[test]
    fn a_change_is_as_long_as_its_ends_say() {
        let places: Vec<_> = (0..7)
            .map(|n| Point2::new(f64::from(n * n % 7), f64::from(3 * n % 5)))
            .collect();
        let route = route(&places, |a, b| (a.x - b.x).abs() > 5.0);
        let order = vec![3, 0, 6, 2, 5, 1, 4];
        let length = route.length(&order);
        for change in changes(order.len()) {
            let mut changed = order.clone();
            change.make(&mut changed);
            let longer = route.length(&changed) - length;
            assert!((route.longer(&order, &change) - longer).abs() < 1e-6);
            let span = change.span();
            for (n, (a, b)) in order.iter().zip(&changed).enumerate() {
                assert!(a == b || span.contains(&n));
            }
        }
    }

    #[test]
    fn a_square_is_walked_around() {
        let places: Vec<_> = [(1.0, 1.0), (0.0, 1.0), (1.0, 0.0), (2.0, 0.0), (2.0, 1.0)]
            .map(|(x, y)| Point2::new(x, y))
            .into();
        let route = route(&places, |_, _| false);
        let order = route.shortest();
        assert!((route.length(&order) - 5.0).abs() < 1e-9, "{order:?}");
    }

    #[test]
    fn a_wall_is_walked_around() {
        let places = [Point2::new(0.0, 1.0), Point2::new(3.0, 0.0)];
        // Between the start and (0, 1).
        let wall = |a: Point2<f64>, b: Point2<f64>| a.x.max(b.x) < 1.0;
        assert_eq!(route(&places, wall).shortest(), [1, 0]);
        assert_eq!(route(&places, |_, _| false).shortest(), [0, 1]);
    }

    /// A detour is worth what it saves.
    #[test]
    fn the_price_decides() {
        let places: Vec<_> = (1..=5).map(|x| Point2::new(f64::from(x), 0.0)).collect();
        let route = route(&places, |_, _| false);
        let mut order = route.shortest();
        route.improve(&mut order, &mut Late(3.0));
        assert_eq!(order, [0, 1, 2, 3, 4]);
        route.improve(&mut order, &mut Late(5.0));
        assert_eq!(order, [4, 3, 2, 1, 0]);
    }
}
