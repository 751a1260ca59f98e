//! A few of many, evenly chosen, without knowing beforehand how many there will be.

/// Keeps at most a given number of the values that pass by, spread evenly over them.
#[derive(Clone, Debug)]
pub struct EvenSample<T> {
    most: usize,
    stride: usize,
    seen: usize,
    kept: Vec<T>,
}

impl<T> EvenSample<T> {
    /// A sample of at most `most` values.
    pub fn new(most: usize) -> Self {
        Self {
            most,
            stride: 1,
            seen: 0,
            kept: Vec::new(),
        }
    }

    /// Lets a value pass by. It is only made if it is kept, for the time being.
    pub fn offer(&mut self, value: impl FnOnce() -> T) {
        if self.seen.is_multiple_of(self.stride) {
            self.kept.push(value());
        }
        self.seen += 1;
        // Twice the number wanted, so that no less than that number is left.
        if self.kept.len() >= 2 * self.most.max(1) {
            self.stride *= 2;
            let mut odd = false;
            self.kept.retain(|_| {
                odd = !odd;
                odd
            });
        }
    }

    /// How many values passed by.
    pub fn seen(&self) -> usize {
        self.seen
    }

    /// The sample, in order.
    pub fn finish(self) -> Vec<T> {
        let (have, want) = (self.kept.len(), self.most);
        if have <= want {
            return self.kept;
        }
        // Place k of the sample is at k have / want, rounded down: `want` different places.
        let is_chosen = |place: usize| (place + 1) * want / have > place * want / have;
        let all = self.kept.into_iter().enumerate();
        all.filter_map(|(place, value)| is_chosen(place).then_some(value))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sample_is_full_ordered_and_even() {
        for (passing, most) in [(0, 5), (3, 5), (5, 5), (9, 5), (10, 5), (1234, 100), (7, 1)] {
            let mut sample = EvenSample::new(most);
            for value in 0..passing {
                sample.offer(|| value);
            }
            assert_eq!(sample.seen(), passing);
            let kept = sample.finish();
            assert_eq!(kept.len(), passing.min(most));
            let widest = 3 * passing.div_ceil(most);
            assert!(kept.is_sorted_by(|a, b| a < b && b - a <= widest));
        }
    }
}
