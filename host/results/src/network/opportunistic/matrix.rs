//! Symmetric matrices of any size.

/// A symmetric matrix, all of it.
#[derive(Clone, Debug)]
pub(super) struct Symmetric {
    size: usize,
    numbers: Vec<f64>,
}

/// A pivot that is a smaller share of its diagonal is rounding.
const ROUNDING: f64 = 1e-12;

impl Symmetric {
    pub(super) fn zeros(size: usize) -> Self {
        Self {
            size,
            numbers: vec![0.0; size * size],
        }
    }

    pub(super) fn at(&self, row: usize, column: usize) -> f64 {
        self.numbers[row * self.size + column]
    }

    /// Adds to one number, not to its mirror image.
    pub(super) fn add(&mut self, row: usize, column: usize, number: f64) {
        self.numbers[row * self.size + column] += number;
    }

    pub(super) fn damp(&mut self, damping: f64) {
        for n in 0..self.size {
            self.numbers[n * (self.size + 1)] *= 1.0 + damping;
        }
    }

    /// The lower triangular factor in the same place; `None` if it is not positive definite.
    pub(super) fn factor(mut self) -> Option<Factor> {
        let n = self.size;
        for j in 0..n {
            for i in j..n {
                let (a, b) = (i * n, j * n);
                let dot: f64 = (0..j)
                    .map(|k| self.numbers[a + k] * self.numbers[b + k])
                    .sum();
                let left = self.numbers[a + j] - dot;
                if i == j {
                    if !(left > ROUNDING * self.numbers[a + j]) {
                        return None;
                    }
                    self.numbers[a + j] = left.sqrt();
                } else {
                    self.numbers[a + j] = left / self.numbers[b + j];
                }
            }
        }
        Some(Factor(self))
    }
}

/// A Cholesky factor.
pub(super) struct Factor(Symmetric);

impl Factor {
    /// Solves in place.
    pub(super) fn solve(&self, x: &mut [f64]) {
        let n = self.0.size;
        for i in 0..n {
            let dot: f64 = (0..i).map(|k| self.0.at(i, k) * x[k]).sum();
            x[i] = (x[i] - dot) / self.0.at(i, i);
        }
        for i in (0..n).rev() {
            let dot: f64 = (i + 1..n).map(|k| self.0.at(k, i) * x[k]).sum();
            x[i] = (x[i] - dot) / self.0.at(i, i);
        }
    }

    pub(super) fn inverse(&self) -> Symmetric {
        let n = self.0.size;
        let mut inverse = Symmetric::zeros(n);
        let mut column = vec![0.0; n];
        for j in 0..n {
            column.fill(0.0);
            column[j] = 1.0;
            self.solve(&mut column);
            for (i, number) in column.iter().enumerate() {
                inverse.numbers[i * n + j] = *number;
            }
        }
        inverse
    }
}
