//! Readings that never change.

/// Number of times in a row that the same bytes came.
#[derive(Debug)]
pub(super) struct Stuck<const N: usize> {
    last: [u8; N],
    times: u8,
}

impl<const N: usize> Default for Stuck<N> {
    fn default() -> Self {
        Self {
            last: [0; N],
            times: 0,
        }
    }
}

impl<const N: usize> Stuck<N> {
    /// Number of times that these came before, without others in between.
    pub(super) fn same(&mut self, data: &[u8; N]) -> u8 {
        self.times = if *data == self.last {
            self.times.saturating_add(1)
        } else {
            0
        };
        self.last = *data;
        self.times
    }
}
