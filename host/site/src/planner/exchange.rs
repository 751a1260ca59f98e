//! Choice among many candidates: an exchange algorithm for optimal designs (Fedorov 1972).

use nalgebra::{Point2, SMatrix};
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

/// A place, and what a stop there would tell.
pub(super) type Candidate<const N: usize> = (Point2<f64>, SMatrix<f64, N, N>);

/// A choice of candidates.
#[derive(Clone, Debug)]
pub(super) struct Design<const N: usize> {
    /// Their indices.
    pub(super) chosen: Vec<usize>,
    /// Their information, with what was known before.
    pub(super) information: SMatrix<f64, N, N>,
    /// Less is better.
    pub(super) score: f64,
}

/// Candidates and aim of a design.
pub(super) struct Choice<'a, const N: usize, F> {
    pub(super) candidates: &'a [Candidate<N>],
    /// Information without them.
    pub(super) before: SMatrix<f64, N, N>,
    /// Places that are stops already.
    pub(super) taken: &'a [Point2<f64>],
    /// No two stops are nearer to one another.
    pub(super) separation: f64,
    /// Less is better; infinite if something remains undetermined.
    pub(super) score: F,
}

impl<const N: usize, F: Fn(&SMatrix<f64, N, N>) -> f64> Choice<'_, N, F> {
    /// The best `count` candidates found from some random starts, each improved by exchanging one
    /// after the other for the best one left, until none is better. `None` if there are too few.
    pub(super) fn best(
        &self,
        count: usize,
        starts: usize,
        random: &mut ChaCha8Rng,
    ) -> Option<Design<N>> {
        (0..starts)
            .filter_map(|_| self.improve(self.any(count, random)?))
            .min_by(|a, b| a.score.total_cmp(&b.score))
    }

    fn may_join(&self, chosen: &[usize], candidate: usize) -> bool {
        let place = self.candidates[candidate].0;
        let others = chosen.iter().map(|&other| &self.candidates[other].0);
        others
            .chain(self.taken)
            .all(|other| (place - other).norm() >= self.separation)
    }

    /// Any `count` candidates. `None` if there are too few.
    pub(super) fn any(&self, count: usize, random: &mut ChaCha8Rng) -> Option<Vec<usize>> {
        let mut order: Vec<_> = (0..self.candidates.len()).collect();
        order.shuffle(random);
        let mut chosen = Vec::new();
        for candidate in order {
            if chosen.len() == count {
                break;
            }
            if self.may_join(&chosen, candidate) {
                chosen.push(candidate);
            }
        }
        (chosen.len() == count).then_some(chosen)
    }

    fn improve(&self, mut chosen: Vec<usize>) -> Option<Design<N>> {
        const SWEEPS: usize = 20;
        let sum = |chosen: &[usize]| {
            chosen
                .iter()
                .fold(self.before, |sum, &index| sum + self.candidates[index].1)
        };
        let mut score = (self.score)(&sum(&chosen));
        for _ in 0..SWEEPS {
            let before_sweep = score;
            for place in 0..chosen.len() {
                let old = chosen.swap_remove(place);
                let rest = sum(&chosen);
                let mut best = (score, old);
                for (candidate, (_, information)) in self.candidates.iter().enumerate() {
                    let trial = (self.score)(&(rest + information));
                    if trial < best.0 && self.may_join(&chosen, candidate) {
                        best = (trial, candidate);
                    }
                }
                score = best.0;
                chosen.push(best.1);
                let last = chosen.len() - 1;
                chosen.swap(place, last);
            }
            if !(score < before_sweep) {
                break;
            }
        }
        let information = sum(&chosen);
        score.is_finite().then_some(Design {
            chosen,
            information,
            score,
        })
    }
}
