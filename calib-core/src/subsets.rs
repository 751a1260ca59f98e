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
pub(crate) fn pairs(len: usize) -> impl Iterator<Item = [usize; 2]> {
    let sources = len.min(SOURCES);
    (0..sources)
        .flat_map(move |i| (i + 1..sources).map(move |j| [i, j]))
        .map(move |pair| pair.map(|k| source(k, len)))
}

/// Index triples `i < j < k`, likewise.
pub(crate) fn triples(len: usize) -> impl Iterator<Item = [usize; 3]> {
    let sources = len.min(SOURCES);
    (0..sources)
        .flat_map(move |i| {
            (i + 1..sources).flat_map(move |j| (j + 1..sources).map(move |k| [i, j, k]))
        })
        .map(move |triple| triple.map(|k| source(k, len)))
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
