//! Pairs and triples of observations from which closed forms propose answers.

/// Observations from which subsets are drawn, at most. More would cost time and add nothing:
/// 120 pairs, 560 triples.
const SOURCES: usize = 16;

/// Index of the `k`-th of the sources spread evenly over `len` observations.
fn source(k: usize, len: usize) -> usize {
    let last = len.min(SOURCES).saturating_sub(1).max(1);
    k * len.saturating_sub(1) / last
}

/// Index pairs `i < j` over `len` observations, or over 16 of them spread evenly.
pub(crate) fn pairs(len: usize) -> Subsets<2> {
    Subsets::new(len)
}

/// Index triples `i < j < k`, likewise.
pub(crate) fn triples(len: usize) -> Subsets<3> {
    Subsets::new(len)
}

/// All subsets of `K`, in order.
pub(crate) struct Subsets<const K: usize> {
    len: usize,
    next: Option<[usize; K]>,
}

impl<const K: usize> Subsets<K> {
    fn new(len: usize) -> Self {
        let first = core::array::from_fn(|k| k);
        Self {
            len,
            next: (len >= K).then_some(first),
        }
    }

    /// The subset of sources after one: the last place that has room goes on by one, and those
    /// after it follow.
    fn after(&self, mut subset: [usize; K]) -> Option<[usize; K]> {
        let sources = self.len.min(SOURCES);
        for place in (0..K).rev() {
            let index = *subset.get(place)? + 1;
            if index + (K - place) <= sources {
                for (following, entry) in subset.iter_mut().skip(place).enumerate() {
                    *entry = index + following;
                }
                return Some(subset);
            }
        }
        None
    }
}

impl<const K: usize> Iterator for Subsets<K> {
    type Item = [usize; K];

    #[inline(never)] // for less flash
    fn next(&mut self) -> Option<[usize; K]> {
        let subset = self.next?;
        self.next = self.after(subset);
        Some(subset.map(|k| source(k, self.len)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_subsets_of_a_few() {
        assert_eq!(pairs(1).count(), 0);
        assert!(pairs(3).eq([[0, 1], [0, 2], [1, 2]]));
        assert!(triples(3).eq([[0, 1, 2]]));
        assert_eq!(triples(10).count(), 120);
    }

    #[test]
    fn many_are_thinned_evenly() {
        assert_eq!(triples(1000).count(), 560);
        assert!(triples(1000).all(|[i, j, k]| i < j && j < k && k < 1000));
        assert!(pairs(1000).any(|pair| pair == [0, 999]));
    }
}
