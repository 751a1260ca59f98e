//! The few best of many candidates.

use crate::Real;

/// Up to `N` values with the least costs, best first.
#[derive(Clone, Copy, Debug)]
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

    /// The same, where at most so many values that are alike have a place: many of one kind leave room for others.
    pub(crate) fn offer_among(
        &mut self,
        cost: T,
        value: V,
        most: usize,
        is_alike: impl Fn(&V) -> bool,
    ) {
        let is_alike =
            |place: &Option<(T, V)>| place.as_ref().is_some_and(|(_, held)| is_alike(held));
        if self.places.iter().filter(|place| is_alike(place)).count() >= most
            && let Some(worst) = self.places.iter_mut().rfind(|place| is_alike(place))
        {
            if worst.as_ref().is_some_and(|(held, _)| !(cost < *held)) {
                return;
            }
            // What is taken in moves the others into the gap, in order.
            *worst = None;
        }
        self.offer(cost, value);
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

    /// At most two capital letters.
    #[test]
    fn many_of_one_kind_leave_room_for_others() {
        let mut ranking = Ranking::<f64, char, 4>::new();
        for (cost, value) in [
            (3.0, 'C'),
            (2.0, 'B'),
            (4.0, 'D'),
            (1.0, 'A'),
            (2.5, 'E'),
            (f64::NAN, 'F'),
        ] {
            ranking.offer_among(cost, value, 2, |held| held.is_uppercase());
        }
        for (cost, value) in [(9.0, 'z'), (1.5, 'b'), (8.0, 'y')] {
            ranking.offer_among(cost, value, 2, |held| held.is_lowercase());
        }
        assert!(ranking.iter().eq(&['A', 'b', 'B', 'y']));
    }
}
