//! The few best of many candidates.

use crate::Real;

/// Up to `N` values with the least costs, best first.
pub(crate) struct Ranking<T, V, const N: usize> {
    places: [Option<(T, V)>; N],
}

impl<T: Real, V: Copy, const N: usize> Ranking<T, V, N> {
    #[inline(never)] // for less stack
    pub(crate) fn new() -> Self {
        Self { places: [None; N] }
    }

    /// The cost that a new one must be below to get a place, once all are taken.
    pub(crate) fn limit(&self) -> Option<T> {
        self.places.last()?.as_ref().map(|(cost, _)| *cost)
    }

    /// Takes the value in if its cost earns it a place; the worst falls out. A cost that is not
    /// finite earns none.
    pub(crate) fn offer(&mut self, cost: T, value: V) {
        let mut carried = cost.is_finite().then_some((cost, value));
        for place in &mut self.places {
            let better = match (&carried, &place) {
                (Some((cost, _)), Some((held, _))) => cost < held,
                (Some(_), None) => true,
                (None, _) => break,
            };
            if better {
                core::mem::swap(place, &mut carried);
            }
        }
    }

    /// The values, best first.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &V> {
        self.places.iter().flatten().map(|(_, value)| value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_three_in_order() {
        let mut ranking = Ranking::<f64, char, 3>::new();
        assert_eq!(ranking.limit(), None);
        for (cost, value) in [
            (4.0, 'd'),
            (f64::NAN, '!'),
            (2.0, 'b'),
            (1.0, 'a'),
            (3.0, 'c'),
        ] {
            ranking.offer(cost, value);
        }
        assert!(ranking.iter().eq(&['a', 'b', 'c']));
        assert_eq!(ranking.limit(), Some(3.0));
    }
}
