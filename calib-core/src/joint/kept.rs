//! Symmetric equations of the kept unknowns, packed: factored, solved and inverted in place.
//!
//! Half of the matrix is there, row after row up to the diagonal. Cholesky's factor takes its place, then
//! the inverse takes that of the factor, so there is never a second one. Golub and Van Loan, "Matrix
//! Computations", 4.2.
//!
//! An unknown for which the others leave no pivot, or only a rounded one, is dropped: it stays where it is,
//! and the others are solved as if it were known.

use crate::{Real, numerics::real::lit};

/// A pivot is rounding if no more than so many units in the last place are left of its diagonal.
const NOISE: f64 = 128.0;

/// Multiplications after which a slice of work ends: some 35 ms of a Cortex-M4F at 64 MHz.
pub(super) const SLICE: usize = 400_000;

/// Numbers of a symmetric matrix with so many rows.
pub(super) const fn packed(rows: usize) -> usize {
    rows * (rows + 1) / 2
}

/// A symmetric matrix, its factor or its inverse.
pub(super) struct Kept<'a, T> {
    numbers: &'a mut [T],
    rows: usize,
}

impl<'a, T: Real> Kept<'a, T> {
    pub(super) fn new(numbers: &'a mut [T], rows: usize) -> Option<Self> {
        let numbers = numbers.get_mut(..packed(rows))?;
        Some(Self { numbers, rows })
    }

    pub(super) fn clear(&mut self) {
        self.numbers.fill(T::zero());
    }

    /// An entry. Entries that do not exist are zero, and are not asked for.
    #[inline]
    pub(super) fn at(&self, i: usize, j: usize) -> T {
        let (low, high) = if i < j { (i, j) } else { (j, i) };
        let entry = self.numbers.get(packed(high) + low);
        entry.copied().unwrap_or_else(T::zero)
    }

    fn set(&mut self, i: usize, j: usize, value: T) {
        let (low, high) = if i < j { (i, j) } else { (j, i) };
        if let Some(entry) = self.numbers.get_mut(packed(high) + low) {
            *entry = value;
        }
    }

    #[inline]
    pub(super) fn add(&mut self, i: usize, j: usize, value: T) {
        let (low, high) = if i < j { (i, j) } else { (j, i) };
        if let Some(entry) = self.numbers.get_mut(packed(high) + low) {
            *entry += value;
        }
    }

    /// Row `i` up to its diagonal.
    pub(super) fn row(&self, i: usize) -> &[T] {
        let begin = packed(i);
        self.numbers.get(begin..=begin + i).unwrap_or_default()
    }

    /// The two by two block at rows `i` and columns `j`, and the ones after them, by rows.
    #[inline]
    pub(super) fn block(&self, i: usize, j: usize) -> [[T; 2]; 2] {
        [
            [self.at(i, j), self.at(i, j + 1)],
            [self.at(i + 1, j), self.at(i + 1, j + 1)],
        ]
    }

    /// Changes variables: `change` maps the numbers of a row, or of a column, that belong to the first two unknowns
    /// and to the four that end with `last`, by the same linear map for each of them.
    #[inline(always)]
    pub(super) fn change(&mut self, last: usize, change: impl Fn(&mut [T; 6])) -> Option<()> {
        let first = last.checked_sub(3)?;
        let of = [0, 1, first, first + 1, first + 2, last];
        let mut own = of.map(|i| of.map(|j| self.at(i, j)));
        let (before, rest) = self.numbers.split_at_mut_checked(packed(first))?;
        let (a, rest) = rest.split_at_mut_checked(first + 1)?;
        let (b, rest) = rest.split_at_mut_checked(first + 2)?;
        let (c, rest) = rest.split_at_mut_checked(first + 3)?;
        let (d, mut rest) = rest.split_at_mut_checked(first + 4)?;
        let (_, mut before) = before.split_at_mut_checked(packed(2))?;
        let columns = a.iter_mut().zip(b).zip(c).zip(d);
        for (j, (((a, b), c), d)) in columns.enumerate().take(first).skip(2) {
            let (row, next) = before.split_at_mut_checked(j + 1)?;
            before = next;
            let [x, y, ..] = row else { return None };
            let mut entries = [*x, *y, *a, *b, *c, *d];
            change(&mut entries);
            [*x, *y, *a, *b, *c, *d] = entries;
        }
        for j in last + 1..self.rows {
            let (row, next) = rest.split_at_mut_checked(j + 1)?;
            rest = next;
            let (common, row) = row.split_at_mut_checked(first)?;
            let ([x, y, ..], [a, b, c, d, ..]) = (common, row) else {
                return None;
            };
            let mut entries = [*x, *y, *a, *b, *c, *d];
            change(&mut entries);
            [*x, *y, *a, *b, *c, *d] = entries;
        }
        for row in &mut own {
            change(row);
        }
        let mut turned = [[T::zero(); 6]; 6];
        for (i, row) in own.iter().enumerate() {
            for (column, entry) in turned.iter_mut().zip(row) {
                if let Some(place) = column.get_mut(i) {
                    *place = *entry;
                }
            }
        }
        for (i, mut column) in of.into_iter().zip(turned) {
            change(&mut column);
            for (j, entry) in of.into_iter().zip(column) {
                if j <= i {
                    self.set(i, j, entry);
                }
            }
        }
        Some(())
    }

    /// A slice of the way to Cholesky's factor in place of the matrix, from row `from` on. Returns the row to go on
    /// with: as many as there are at the end; `None` for a matrix that is none. On the diagonal are the reciprocals of
    /// its pivots, and zeros for unknowns that are dropped, which are added to `dropped`. `diagonal`, as long as the
    /// matrix, gets the former diagonal.
    #[inline(never)]
    pub(super) fn factor(
        &mut self,
        diagonal: &mut [T],
        from: usize,
        dropped: &mut usize,
    ) -> Option<usize> {
        let noise = lit::<T>(NOISE) * T::default_epsilon();
        let mut work = 0;
        for (i, own) in (0..self.rows).zip(diagonal).skip(from) {
            if work > SLICE {
                return Some(i);
            }
            let (before, rest) = self.numbers.split_at_mut_checked(packed(i))?;
            let (row, last) = rest.get_mut(..=i)?.split_at_mut_checked(i)?;
            let [pivot] = last else { return None };
            let first = row.iter().position(|entry| *entry != T::zero());
            let first = first.unwrap_or(i);
            work += packed(i - first);
            let mut begin = packed(first);
            for j in first..i {
                let other = before.get(begin + first..=begin + j)?;
                begin += j + 1;
                let (known, [entry, ..]) = row.get_mut(first..)?.split_at_mut_checked(j - first)?
                else {
                    return None;
                };
                let (other, own_pivot) = other.split_at_checked(j - first)?;
                let [reciprocal] = own_pivot else { return None };
                *entry = (*entry - dot(known, other)) * *reciprocal;
            }
            *own = *pivot;
            let known = row.get(first..)?;
            let left = *pivot - dot(known, known);
            if !left.is_finite() {
                return None;
            }
            *pivot = if left > *own * noise {
                left.sqrt().recip()
            } else {
                *dropped += 1;
                T::zero()
            };
        }
        Some(self.rows)
    }

    /// The `u` of `L u = g`, in place, from the factor.
    pub(super) fn forward(&self, g: &mut [T]) {
        for i in 0..self.rows {
            let row = self.row(i);
            let Some((reciprocal, row)) = row.split_last() else {
                return;
            };
            let (known, rest) = g.split_at_mut_checked(i).unwrap_or_default();
            if let Some(value) = rest.first_mut() {
                *value = (*value - dot(known, row)) * *reciprocal;
            }
        }
    }

    /// The `x` of `L^T x = u`, in place, from the factor.
    pub(super) fn backward(&self, x: &mut [T]) {
        for i in (0..self.rows).rev() {
            self.eliminate(i, x, true);
        }
    }

    fn eliminate(&self, i: usize, x: &mut [T], divides: bool) {
        let row = self.row(i);
        let Some((reciprocal, row)) = row.split_last() else {
            return;
        };
        let (others, rest) = x.split_at_mut_checked(i).unwrap_or_default();
        let Some(value) = rest.first_mut() else {
            return;
        };
        if divides {
            *value *= *reciprocal;
        }
        let value = *value;
        if value != T::zero() {
            for (other, entry) in others.iter_mut().zip(row) {
                *other -= *entry * value;
            }
        }
    }

    /// Returns true if an unknown was dropped, from the factor.
    pub(super) fn is_dropped(&self, i: usize) -> bool {
        self.row(i).last() == Some(&T::zero())
    }

    /// The direction along which an unknown that was dropped moves, and the others with it, from the
    /// factor.
    pub(super) fn null_direction(&self, dropped: usize, x: &mut [T]) {
        x.fill(T::zero());
        if let Some(value) = x.get_mut(dropped) {
            *value = T::one();
        }
        self.eliminate(dropped, x, false);
        for i in (0..dropped).rev() {
            self.eliminate(i, x, true);
        }
    }

    /// A slice of the way to the inverse in place of the factor: row after row that of the factor itself, then the
    /// product of this with its transpose. Unknowns that were dropped have zeros. Two rows go in at a time, so that
    /// their target is read and written half as often. Begins at 0, and returns where to go on: at twice the number of
    /// rows all is done.
    #[inline(never)]
    pub(super) fn invert(&mut self, from: usize) -> Option<usize> {
        let mut work = 0;
        for i in from..self.rows {
            if work > SLICE {
                return Some(i);
            }
            work += packed(i);
            let (before, rest) = self.numbers.split_at_mut_checked(packed(i))?;
            let (row, last) = rest.get_mut(..=i)?.split_at_mut_checked(i)?;
            let [pivot] = last else { return None };
            let mut others = before;
            let mut j = 0;
            while j < i {
                let (first, rest) = others.split_at_mut_checked(j + 1)?;
                let (known, entries) = row.split_at_mut_checked(j)?;
                let (first, own) = first.split_at_checked(j)?;
                match (entries, own) {
                    ([a, b, ..], [own]) => {
                        let (second, rest) = rest.split_at_mut_checked(j + 2)?;
                        others = rest;
                        let (second, [across, other]) = second.split_at_checked(j)? else {
                            return None;
                        };
                        add_two(known, first, *a, second, *b);
                        *a = *a * *own + *b * *across;
                        *b *= *other;
                    }
                    ([a], [own]) => {
                        others = rest;
                        add_multiple(known, first, *a);
                        *a *= *own;
                    }
                    _ => return None,
                }
                j += 2;
            }
            let factor = -*pivot;
            for entry in row {
                *entry *= factor;
            }
        }
        let mut i = from.saturating_sub(self.rows);
        while i < self.rows {
            if work > SLICE {
                return Some(self.rows + i);
            }
            work += 2 * packed(i);
            let (before, rest) = self.numbers.split_at_mut_checked(packed(i))?;
            let (row, rest) = rest.split_at_mut_checked(i + 1)?;
            let second = rest.get_mut(..i + 2).unwrap_or_default();
            let mut others = before;
            for j in 0..i {
                let (other, rest) = others.split_at_mut_checked(j + 1)?;
                others = rest;
                let (first, factor) = (row.get(..=j)?, *row.get(j)?);
                match second.get(..=j) {
                    Some(second) => {
                        let by = *second.last()?;
                        add_two(other, first, factor, second, by);
                    }
                    None => add_multiple(other, first, factor),
                }
            }
            let pivot = *row.last()?;
            for entry in row.iter_mut() {
                *entry *= pivot;
            }
            if let [own @ .., pivot] = second {
                let across = *own.last()?;
                add_multiple(row, own, across);
                let pivot = *pivot;
                for entry in second {
                    *entry *= pivot;
                }
            }
            i += 2;
        }
        Some(2 * self.rows)
    }
}

/// `a . b`, four sums side by side.
#[inline(always)]
pub(super) fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    let mut sums = [T::zero(); 4];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    let rest = a_rest.iter().zip(b_rest);
    let rest = rest.fold(T::zero(), |sum, (a, b)| sum + *a * *b);
    for (a, b) in a.iter().zip(b) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += *a * *b;
        }
    }
    let [first, second, third, fourth] = sums;
    (first + second) + (third + fourth) + rest
}

/// Adds multiples of two rows.
#[inline(always)]
fn add_two<T: Real>(to: &mut [T], first: &[T], by_first: T, second: &[T], by_second: T) {
    for ((to, a), b) in to.iter_mut().zip(first).zip(second) {
        *to += *a * by_first + *b * by_second;
    }
}

#[inline(always)]
fn add_multiple<T: Real>(to: &mut [T], from: &[T], factor: T) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += *from * factor;
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use nalgebra::{SMatrix, SVector};
    use proptest::prelude::*;

    use super::*;

    fn filled(store: &mut [f64], matrix: &SMatrix<f64, 5, 5>) {
        let mut kept = Kept::new(store, 5).unwrap();
        kept.clear();
        for i in 0..5 {
            for j in 0..=i {
                kept.add(i, j, matrix[(i, j)]);
            }
        }
    }

    proptest! {
        /// The linear algebra library is the oracle: solution, inverse, change of variables.
        #[test]
        fn same_as_the_library(numbers in prop::collection::vec(-1.0_f64..1.0, 30)) {
            let root = SMatrix::<f64, 5, 5>::from_row_slice(&numbers[..25]);
            let matrix = root * root.transpose() + SMatrix::identity() * 1e-2;
            let right = SVector::<f64, 5>::from_row_slice(&numbers[25..]);
            let inverse = matrix.try_inverse().unwrap();
            let mut store = [0.0; packed(5)];
            filled(&mut store, &matrix);
            let mut kept = Kept::new(&mut store, 5).unwrap();
            let mut diagonal = [0.0; 5];
            let mut dropped = 0;
            prop_assert_eq!(kept.factor(&mut diagonal, 0, &mut dropped), Some(5));
            prop_assert_eq!(dropped, 0);
            prop_assert_eq!(SVector::from(diagonal), matrix.diagonal());
            let mut x: Vec<f64> = right.iter().copied().collect();
            kept.forward(&mut x);
            let worth = dot(&x, &x);
            prop_assert!((worth - right.dot(&(inverse * right))).abs() < 1e-8 * (1.0 + worth));
            kept.backward(&mut x);
            prop_assert!((SVector::<f64, 5>::from_row_slice(&x) - inverse * right).norm() < 1e-8);
            prop_assert_eq!(kept.invert(0), Some(10));
            for i in 0..5 {
                for j in 0..5 {
                    prop_assert!((kept.at(i, j) - inverse[(i, j)]).abs() < 1e-8);
                }
            }
        }

        /// The same of a change of variables, by any map.
        #[test]
        fn changes_as_the_library_says(numbers in prop::collection::vec(-1.0_f64..1.0, 117)) {
            let root = SMatrix::<f64, 9, 9>::from_row_slice(&numbers[..81]);
            let matrix = root * root.transpose();
            let own = SMatrix::<f64, 6, 6>::from_row_slice(&numbers[81..]);
            let of = [0, 1, 3, 4, 5, 6];
            let mut map = SMatrix::<f64, 9, 9>::identity();
            for (a, i) in of.into_iter().enumerate() {
                for (b, j) in of.into_iter().enumerate() {
                    map[(i, j)] = own[(a, b)];
                }
            }
            let mut store = [0.0; packed(9)];
            let mut kept = Kept::new(&mut store, 9).unwrap();
            for i in 0..9 {
                for j in 0..=i {
                    kept.add(i, j, matrix[(i, j)]);
                }
            }
            kept.change(6, |entries| {
                let changed = own * SVector::<f64, 6>::from_row_slice(entries);
                entries.copy_from_slice(changed.as_slice());
            }).unwrap();
            let changed = map * matrix * map.transpose();
            for i in 0..9 {
                for j in 0..9 {
                    prop_assert!((kept.at(i, j) - changed[(i, j)]).abs() < 1e-9);
                }
            }
        }
    }

    /// Only the sum of two unknowns is measured, and nothing of another one.
    #[test]
    fn what_is_not_determined_is_dropped() {
        let mut store = [0.0_f32; packed(4)];
        let mut kept = Kept::new(&mut store, 4).unwrap();
        for (i, j, value) in [(0, 0, 4.0), (1, 0, 4.0), (1, 1, 4.0), (3, 3, 1.0)] {
            kept.add(i, j, value);
        }
        let mut diagonal = [0.0; 4];
        let mut dropped = 0;
        assert_eq!(kept.factor(&mut diagonal, 0, &mut dropped), Some(4));
        assert_eq!(dropped, 2);
        assert_eq!(
            [0, 1, 2, 3].map(|i| kept.is_dropped(i)),
            [false, true, true, false]
        );
        let mut direction = [0.0; 4];
        kept.null_direction(1, &mut direction);
        assert_eq!(direction, [-1.0, 1.0, 0.0, 0.0]);
        kept.null_direction(2, &mut direction);
        assert_eq!(direction, [0.0, 0.0, 1.0, 0.0]);
        let mut x = [2.0, 2.0, 0.0, 3.0];
        kept.forward(&mut x);
        kept.backward(&mut x);
        assert_eq!(x, [0.5, 0.0, 0.0, 3.0]);
        kept.invert(0).unwrap();
        assert_eq!([0, 1, 2, 3].map(|i| kept.at(i, i)), [0.25, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn what_is_no_number_has_no_factor() {
        for wrong in [f32::NAN, f32::INFINITY] {
            let mut store = [0.0; packed(2)];
            let mut kept = Kept::new(&mut store, 2).unwrap();
            kept.add(0, 0, wrong);
            assert_eq!(kept.factor(&mut [0.0; 2], 0, &mut 0), None);
        }
    }

    /// A large matrix of which the inverse is known, in slices: each is at most one row more than its share of the work.
    #[test]
    fn slices_end_in_time_and_leave_nothing_out() {
        const ROWS: usize = 301;
        let mut store = std::vec![0.0_f64; packed(ROWS)];
        let mut kept = Kept::new(&mut store, ROWS).unwrap();
        for i in 0..ROWS {
            kept.add(i, i, 2.0);
            for j in 0..i {
                kept.add(i, j, 1.0);
            }
        }
        let (mut diagonal, mut dropped) = ([0.0; ROWS], 0);
        let mut at = std::vec![0];
        while let [.., last] = at[..]
            && last < ROWS
        {
            at.push(kept.factor(&mut diagonal, last, &mut dropped).unwrap());
        }
        let work = |rows: &[usize]| (rows[0]..rows[1] - 1).map(packed).sum::<usize>();
        assert!(at.len() > 8, "{at:?}");
        assert!(at.windows(2).all(|rows| work(rows) <= SLICE), "{at:?}");
        let mut at = std::vec![0];
        while let [.., last] = at[..]
            && last < 2 * ROWS
        {
            at.push(kept.invert(last).unwrap());
        }
        assert!(at.len() > 16, "{at:?}");
        // The inverse of 1 + e e^T is 1 - e e^T / (1 + n).
        let share = 1.0 / (1.0 + ROWS as f64);
        for i in 0..ROWS {
            for j in 0..=i {
                let expected = if i == j { 1.0 - share } else { -share };
                assert!((kept.at(i, j) - expected).abs() < 1e-9, "{i} {j}");
            }
        }
    }
}
