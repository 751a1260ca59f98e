//! Symmetric matrices as large as a walk.

use std::ops::{Index, IndexMut};

/// A symmetric matrix, all of it.
#[derive(Clone, Debug)]
pub(super) struct Symmetric {
    width: usize,
    numbers: Vec<f64>,
}

impl Symmetric {
    pub(super) fn zeros(width: usize) -> Self {
        Self {
            width,
            numbers: vec![0.0; width * width],
        }
    }

    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// One of its rows.
    pub(super) fn row(&self, row: usize) -> &[f64] {
        &self.numbers[row * self.width..][..self.width]
    }

    /// The same with so many more rows and columns of zeros, and room for more.
    pub(super) fn widened(&self, by: usize) -> Self {
        let width = self.width + by;
        let mut numbers = Vec::with_capacity(width * width);
        for row in self.numbers.chunks(self.width) {
            numbers.extend_from_slice(row);
            numbers.resize(numbers.len() + by, 0.0);
        }
        numbers.resize(width * width, 0.0);
        Self { width, numbers }
    }

    /// Less a multiple of the square of a vector.
    pub(super) fn subtract(&mut self, vector: &[f64], times: f64) {
        for (row, a) in self.numbers.chunks_mut(self.width).zip(vector) {
            let a = a * times;
            if a != 0.0 {
                for (number, b) in row.iter_mut().zip(vector) {
                    *number -= a * b;
                }
            }
        }
    }

    /// Its inverse, by Cholesky's decomposition; `None` if it is not positive definite.
    pub(super) fn inverse(mut self) -> Option<Self> {
        let width = self.width;
        for column in 0..width {
            let (done, rest) = self.numbers.split_at_mut((column + 1) * width);
            let own = &mut done[column * width..];
            let sum: f64 = own[..column].iter().map(|l| l * l).sum();
            let pivot = own[column] - sum;
            if !(pivot > 0.0 && pivot.is_finite()) {
                return None;
            }
            let pivot = pivot.sqrt();
            own[column] = pivot;
            for row in rest.chunks_mut(width) {
                let sum: f64 = row[..column].iter().zip(&*own).map(|(a, b)| a * b).sum();
                row[column] = (row[column] - sum) / pivot;
            }
        }
        // The inverse of the triangle, row by row of its transpose.
        let mut inverse = Self::zeros(width);
        for column in 0..width {
            for row in column..width {
                let known = &inverse.numbers[column * width..column * width + row];
                let by = &self.numbers[row * width..row * width + row];
                let sum: f64 = (by[column..].iter().zip(&known[column..]))
                    .map(|(a, b)| a * b)
                    .sum();
                let unit = f64::from(u8::from(row == column));
                inverse.numbers[column * width + row] = (unit - sum) / self[(row, row)];
            }
        }
        let mut product = Self::zeros(width);
        for i in 0..width {
            for j in i..width {
                let [a, b] = [i, j].map(|n| &inverse.numbers[n * width + j..(n + 1) * width]);
                let sum: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                product[(i, j)] = sum;
                product[(j, i)] = sum;
            }
        }
        Some(product)
    }
}

impl Index<(usize, usize)> for Symmetric {
    type Output = f64;

    fn index(&self, (row, column): (usize, usize)) -> &f64 {
        &self.numbers[row * self.width + column]
    }
}

impl IndexMut<(usize, usize)> for Symmetric {
    fn index_mut(&mut self, (row, column): (usize, usize)) -> &mut f64 {
        &mut self.numbers[row * self.width + column]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_times_its_inverse_is_one() {
        let width = 7;
        let mut matrix = Symmetric::zeros(width);
        for i in 0..width {
            for j in 0..width {
                matrix[(i, j)] = 1.0 / (1.0 + i.abs_diff(j) as f64);
            }
        }
        let inverse = matrix.clone().inverse().unwrap();
        for i in 0..width {
            for j in 0..width {
                let sum: f64 = (0..width).map(|k| matrix[(i, k)] * inverse[(k, j)]).sum();
                assert!((sum - f64::from(u8::from(i == j))).abs() < 1e-12);
            }
        }
        matrix[(3, 3)] = -1.0;
        assert!(matrix.inverse().is_none());
    }
}
