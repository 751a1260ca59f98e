//! Sparse normal equations of all unknowns of a network, for walks too long to keep all stops densely.
//!
//! Groups of unknowns (a stop, a camera) are the nodes of a graph, and rows its cliques. Nodes are eliminated in the
//! order of least degree, the carrier, which all legs share, at last; of a network in the plane the factor is then
//! little larger than the measurements. Covariances of what rows tie to each other come from the factor in the
//! opposite order. George and Liu, "The evolution of the minimum degree ordering algorithm", SIAM Review 31(1),
//! 1989; Takahashi, Fagan and Chin, "Formation of a sparse bus impedance matrix", 1973.

use std::{
    cmp::Reverse,
    collections::{BTreeSet, BinaryHeap},
};

use calib_core::joint::Solver;

/// A pivot is rounding if no more than this share of its diagonal is left.
const NOISE: f64 = 1e-14;

/// One equation: where its entries begin among all, and its residual.
#[derive(Clone, Copy, Debug)]
struct Row {
    begin: usize,
    residual: f64,
}

/// Result of a node's elimination: a panel of its own unknowns' columns.
#[derive(Clone, Debug, Default)]
struct Panel {
    /// The nodes after it that it is tied to, in the order of elimination.
    ties: Vec<usize>,
    /// First row of each tie in the panel, and all rows.
    rows: Vec<usize>,
    height: usize,
    /// By rows: own unknowns first, then those of the ties.
    numbers: Vec<f64>,
}

/// Equations, their factor, and the covariance.
#[derive(Debug, Default)]
pub(super) struct Sparse {
    /// First unknown of each node, and the end.
    first: Vec<usize>,
    /// Node of each unknown.
    node: Vec<usize>,
    entries: Vec<(usize, f64)>,
    rows: Vec<Row>,
    /// Ties of the structure that was ordered.
    ordered: Vec<(usize, usize)>,
    order: Vec<usize>,
    /// Place of each node in the order.
    place: Vec<usize>,
    factor: Vec<Panel>,
    covariance: Vec<Panel>,
    /// Unknowns that no row has.
    is_free: Vec<bool>,
    columns: Vec<f64>,
}

impl Sparse {
    fn size(&self, node: usize) -> usize {
        self.first[node + 1] - self.first[node]
    }

    fn entries_of(&self, row: usize) -> &[(usize, f64)] {
        let end = { self.rows.get(row + 1) }.map_or(self.entries.len(), |next| next.begin);
        &self.entries[self.rows[row].begin..end]
    }

    /// Pairs of nodes that a row has both of.
    fn ties(&self) -> Vec<(usize, usize)> {
        let mut ties = Vec::new();
        let mut nodes = Vec::new();
        for row in 0..self.rows.len() {
            nodes.clear();
            nodes.extend(self.entries_of(row).iter().map(|(i, _)| self.node[*i]));
            nodes.sort_unstable();
            nodes.dedup();
            for (n, a) in nodes.iter().enumerate() {
                ties.extend(nodes[n + 1..].iter().map(|b| (*a, *b)));
            }
        }
        ties.sort_unstable();
        ties.dedup();
        ties
    }

    /// The order of least degree, with the first node last, and what each elimination ties.
    fn order(&mut self) {
        let ties = self.ties();
        let nodes = self.first.len() - 1;
        if self.ordered == ties && self.order.len() == nodes {
            for panel in &mut self.factor {
                panel.numbers.fill(0.0);
            }
            return;
        }
        let mut near = vec![BTreeSet::new(); nodes];
        for (a, b) in &ties {
            near[*a].insert(*b);
            near[*b].insert(*a);
        }
        let mut waiting: BinaryHeap<_> = (1..nodes).map(|n| Reverse((near[n].len(), n))).collect();
        let mut is_done = vec![false; nodes];
        let mut found: Vec<Vec<usize>> = vec![Vec::new(); nodes];
        self.order.clear();
        while let Some(Reverse((degree, node))) = waiting.pop() {
            if is_done[node] || near[node].len() != degree {
                continue;
            }
            is_done[node] = true;
            self.order.push(node);
            let own: Vec<usize> = std::mem::take(&mut near[node]).into_iter().collect();
            for &a in &own {
                near[a].remove(&node);
                near[a].extend(own.iter().copied().filter(|b| *b != a));
                if a > 0 {
                    waiting.push(Reverse((near[a].len(), a)));
                }
            }
            found[node] = own;
        }
        self.order.push(0);
        self.place = vec![0; nodes];
        for (place, node) in self.order.iter().enumerate() {
            self.place[*node] = place;
        }
        self.factor = (0..nodes).map(|_| Panel::default()).collect();
        for (node, mut ties) in found.into_iter().enumerate() {
            ties.sort_unstable_by_key(|tie| self.place[*tie]);
            let mut height = self.size(node);
            let rows = ties.iter().map(|tie| {
                let row = height;
                height += self.size(*tie);
                row
            });
            let rows = rows.collect();
            self.factor[node] = Panel {
                ties,
                rows,
                height,
                numbers: vec![0.0; height * self.size(node)],
            };
        }
        self.ordered = ties;
    }

    /// Place of the entry of two unknowns: the node whose panel has it, and its place there.
    fn at(&self, panels: &[Panel], i: usize, j: usize) -> Option<(usize, usize)> {
        let (a, b) = (self.node[i], self.node[j]);
        let (node, column, row) = if self.place[a] <= self.place[b] {
            (a, i, j)
        } else {
            (b, j, i)
        };
        let panel = &panels[node];
        let other = self.node[row];
        let begin = if other == node {
            0
        } else {
            let place = self.place[other];
            let tie = panel
                .ties
                .binary_search_by_key(&place, |tie| self.place[*tie]);
            panel.rows[tie.ok()?]
        };
        let row = begin + row - self.first[other];
        Some((node, row * self.size(node) + column - self.first[node]))
    }

    /// Fills the panels with the normal equations; the gradient.
    fn assemble(&mut self) -> Vec<f64> {
        let mut gradient = vec![0.0; self.node.len()];
        let mut factor = std::mem::take(&mut self.factor);
        for row in 0..self.rows.len() {
            let entries = self.entries_of(row);
            for (n, (i, a)) in entries.iter().enumerate() {
                gradient[*i] += a * self.rows[row].residual;
                for (j, b) in &entries[..=n] {
                    if let Some((node, at)) = self.at(&factor, *i, *j) {
                        factor[node].numbers[at] += a * b;
                        // A node's own entries have both halves.
                        if i != j && self.node[*i] == self.node[*j] {
                            let width = self.size(node);
                            let (row, column) = (at / width, at % width);
                            factor[node].numbers[column * width + row] += a * b;
                        }
                    }
                }
            }
        }
        self.factor = factor;
        gradient
    }

    /// Cholesky's factor in place of the equations, reciprocals of pivots on the diagonals.
    fn factorise(&mut self) -> Option<()> {
        let mut offset = vec![usize::MAX; self.first.len() - 1];
        for n in 0..self.order.len() {
            let node = self.order[n];
            let width = self.size(node);
            let mut panel = std::mem::take(&mut self.factor[node]);
            let diagonal: Vec<f64> = (0..width).map(|i| panel.numbers[i * width + i]).collect();
            #[expect(
                clippy::needless_range_loop,
                reason = "rows below the diagonal have none"
            )]
            for i in 0..panel.height {
                for j in 0..width.min(i + 1) {
                    let (own, other) = (i * width, j * width);
                    let known: f64 = (0..j)
                        .map(|l| panel.numbers[own + l] * panel.numbers[other + l])
                        .sum();
                    let left = panel.numbers[own + j] - known;
                    panel.numbers[own + j] = if i != j {
                        left * panel.numbers[other + j]
                    } else if diagonal[i] == 0.0 {
                        // There was no measurement of it.
                        self.is_free[self.first[node] + i] = true;
                        0.0
                    } else if left > diagonal[i] * NOISE {
                        left.sqrt().recip()
                    } else {
                        return None;
                    };
                }
            }
            for (a, tie) in panel.ties.iter().enumerate() {
                let to_width = self.size(*tie);
                let mut to = std::mem::take(&mut self.factor[*tie]);
                offset[*tie] = 0;
                for (other, row) in to.ties.iter().zip(&to.rows) {
                    offset[*other] = *row;
                }
                for (b, other) in panel.ties.iter().enumerate().skip(a) {
                    for i in 0..self.size(*other) {
                        let left = &panel.numbers[(panel.rows[b] + i) * width..][..width];
                        let begin = (offset[*other] + i) * to_width;
                        for (j, entry) in to.numbers[begin..begin + to_width].iter_mut().enumerate()
                        {
                            let right = &panel.numbers[(panel.rows[a] + j) * width..][..width];
                            let product: f64 = left.iter().zip(right).map(|(l, r)| l * r).sum();
                            *entry -= product;
                        }
                    }
                }
                self.factor[*tie] = to;
            }
            self.factor[node] = panel;
        }
        Some(())
    }

    fn forward(&self, x: &mut [f64]) {
        for &node in &self.order {
            let (panel, width, first) = (&self.factor[node], self.size(node), self.first[node]);
            for i in 0..width {
                let row = &panel.numbers[i * width..];
                let known: f64 = (0..i).map(|l| row[l] * x[first + l]).sum();
                x[first + i] = (x[first + i] - known) * row[i];
            }
            if x[first..first + width].iter().all(|x| *x == 0.0) {
                continue;
            }
            for (tie, begin) in panel.ties.iter().zip(&panel.rows) {
                for i in 0..self.size(*tie) {
                    let row = &panel.numbers[(begin + i) * width..][..width];
                    let known: f64 = (0..width).map(|l| row[l] * x[first + l]).sum();
                    x[self.first[*tie] + i] -= known;
                }
            }
        }
    }

    fn backward(&self, x: &mut [f64]) {
        for &node in self.order.iter().rev() {
            let (panel, width, first) = (&self.factor[node], self.size(node), self.first[node]);
            for (tie, begin) in panel.ties.iter().zip(&panel.rows) {
                for i in 0..self.size(*tie) {
                    let row = &panel.numbers[(begin + i) * width..][..width];
                    let value = x[self.first[*tie] + i];
                    for (l, by) in row.iter().enumerate() {
                        x[first + l] -= by * value;
                    }
                }
            }
            for i in (0..width).rev() {
                x[first + i] *= panel.numbers[i * width + i];
                let value = x[first + i];
                for l in 0..i {
                    x[first + l] -= panel.numbers[i * width + l] * value;
                }
            }
        }
    }
}

impl Solver<f64> for Sparse {
    fn begin(&mut self, groups: &mut dyn Iterator<Item = usize>) {
        self.first.clear();
        self.node.clear();
        for (node, size) in groups.enumerate() {
            self.first.push(self.node.len());
            self.node.extend(std::iter::repeat_n(node, size));
        }
        self.first.push(self.node.len());
        self.is_free = vec![false; self.node.len()];
        self.entries.clear();
        self.rows.clear();
        self.covariance.clear();
    }

    fn row(&mut self, entries: &[(usize, f64)], residual: f64) {
        let begin = self.entries.len();
        self.entries.extend_from_slice(entries);
        self.rows.push(Row { begin, residual });
    }

    fn solve(&mut self, step: &mut dyn FnMut(usize, f64)) -> Option<f64> {
        self.order();
        let mut x = self.assemble();
        self.factorise()?;
        self.forward(&mut x);
        let worth = x.iter().map(|x| x * x).sum();
        self.backward(&mut x);
        for (i, x) in x.iter().enumerate() {
            step(i, -x);
        }
        Some(worth)
    }

    fn invert(&mut self) -> Option<()> {
        let nodes = self.first.len() - 1;
        let mut covariance: Vec<Panel> = self.factor.clone();
        for &node in self.order.iter().rev() {
            let width = self.size(node);
            let panel = &self.factor[node];
            // The inverse of the node's own triangle, by rows.
            let mut own = vec![0.0; width * width];
            for i in 0..width {
                let reciprocal = panel.numbers[i * width + i];
                own[i * width + i] = reciprocal;
                for j in 0..i {
                    let known: f64 = (j..i)
                        .map(|l| panel.numbers[i * width + l] * own[l * width + j])
                        .sum();
                    own[i * width + j] = -known * reciprocal;
                }
            }
            // Unknowns that are tied to it move with it: rows times that inverse.
            let below = panel.height - width;
            let mut moved = vec![0.0; below * width];
            for (i, to) in moved.chunks_exact_mut(width).enumerate() {
                let row = &panel.numbers[(width + i) * width..][..width];
                for (j, to) in to.iter_mut().enumerate() {
                    *to = (j..width).map(|l| row[l] * own[l * width + j]).sum();
                }
            }
            let mut found = vec![0.0; panel.height * width];
            for (a, tie) in panel.ties.iter().enumerate() {
                let z = &covariance[*tie];
                let tie_width = self.size(*tie);
                for (b, other) in panel.ties.iter().enumerate().skip(a) {
                    let begin = if a == b {
                        0
                    } else {
                        let place = self.place[*other];
                        let at = z.ties.binary_search_by_key(&place, |tie| self.place[*tie]);
                        z.rows[at.ok()?]
                    };
                    for i in 0..self.size(*other) {
                        for j in 0..tie_width {
                            let number = z.numbers[(begin + i) * tie_width + j];
                            let (row, column) = (panel.rows[b] + i, panel.rows[a] + j);
                            for l in 0..width {
                                found[row * width + l] -=
                                    number * moved[(column - width) * width + l];
                                if a != b {
                                    found[column * width + l] -=
                                        number * moved[(row - width) * width + l];
                                }
                            }
                        }
                    }
                }
            }
            for i in 0..width {
                for j in 0..width {
                    let alone: f64 = (i.max(j)..width)
                        .map(|l| own[l * width + i] * own[l * width + j])
                        .sum();
                    let through: f64 = (0..below)
                        .map(|r| moved[r * width + i] * found[(width + r) * width + j])
                        .sum();
                    found[i * width + j] = alone - through;
                }
            }
            covariance[node].numbers = found;
        }
        debug_assert_eq!(covariance.len(), nodes);
        self.covariance = covariance;
        Some(())
    }

    fn covariance(&self, i: usize, j: usize) -> Option<f64> {
        let (node, at) = self.at(&self.covariance, i, j)?;
        self.covariance[node].numbers.get(at).copied()
    }

    fn columns(&mut self, first: usize, count: usize) -> Option<&[f64]> {
        let unknowns = self.node.len();
        let mut columns = std::mem::take(&mut self.columns);
        columns.clear();
        columns.resize(unknowns * count, 0.0);
        for (n, column) in columns.chunks_exact_mut(unknowns).enumerate() {
            *column.get_mut(first + n)? = 1.0;
            self.forward(column);
            self.backward(column);
        }
        self.columns = columns;
        Some(&self.columns)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{SMatrix, SVector};

    use super::*;

    /// Nodes on a ring, tied to their neighbours and to the first one, against a dense solution.
    #[test]
    fn equals_a_dense_solution() {
        let sizes = [2, 2, 3, 2, 3, 2, 2, 3, 1];
        let mut sparse = Sparse::default();
        sparse.begin(&mut sizes.into_iter());
        let unknowns: usize = sizes.iter().sum();
        let first: Vec<usize> = { sizes.iter() }
            .scan(0, |at, size| {
                *at += size;
                Some(*at - size)
            })
            .collect();
        let mut number = 1.0_f64;
        let mut next = || {
            number = (number * 7.31 + 0.77) % 3.1;
            number - 1.5
        };
        let mut dense: Vec<(Vec<f64>, f64)> = Vec::new();
        for node in 1..sizes.len() {
            let other = node % (sizes.len() - 1) + 1;
            for n in 0..6 {
                let mut nodes = vec![node, other];
                if n % 2 == 0 {
                    nodes.push(0);
                }
                let mut entries = Vec::new();
                for node in nodes {
                    for i in 0..sizes[node] {
                        entries.push((first[node] + i, next()));
                    }
                }
                let residual = next();
                sparse.row(&entries, residual);
                let mut row = vec![0.0; unknowns];
                entries.iter().for_each(|(i, by)| row[*i] = *by);
                dense.push((row, residual));
            }
        }
        let jacobian = SMatrix::<f64, 48, 20>::from_fn(|i, j| dense[i].0[j]);
        let residuals = SVector::<f64, 48>::from_fn(|i, _| dense[i].1);
        let inverse = (jacobian.transpose() * jacobian).try_inverse().unwrap();
        let gradient = jacobian.transpose() * residuals;
        let expected = -inverse * gradient;
        let mut step = vec![0.0; unknowns];
        let worth = sparse.solve(&mut |i, x| step[i] = x).unwrap();
        assert!(
            (SVector::<f64, 20>::from_column_slice(&step) - expected).norm()
                < 1e-9 * (1.0 + expected.norm())
        );
        assert!((worth + expected.dot(&gradient)).abs() < 1e-9 * (1.0 + worth));
        sparse.invert().unwrap();
        let scale = inverse.norm();
        for row in &dense {
            let own = (0..unknowns).filter(|i| row.0[*i] != 0.0);
            for i in own.clone() {
                for j in own.clone() {
                    let found = sparse.covariance(i, j).unwrap();
                    assert!((found - inverse[(i, j)]).abs() < 1e-9 * scale, "{i} {j}");
                }
            }
        }
        let columns = sparse.columns(3, 2).unwrap();
        for (i, number) in columns.iter().enumerate() {
            let expected = inverse[(i % unknowns, 3 + i / unknowns)];
            assert!((number - expected).abs() < 1e-9 * scale);
        }
    }

    /// An unknown that no row has stays where it is; unknowns that rows leave open have no solution.
    #[test]
    fn what_is_not_determined_has_no_solution() {
        let mut sparse = Sparse::default();
        sparse.begin(&mut [1, 2].into_iter());
        sparse.row(&[(0, 2.0)], 1.0);
        sparse.row(&[(1, 1.0), (0, 1.0)], 1.0);
        let mut step = [1.0; 3];
        sparse.solve(&mut |i, x| step[i] = x).unwrap();
        assert_eq!(step, [-0.5, -0.5, 0.0]);
        sparse.begin(&mut [1, 2].into_iter());
        sparse.row(&[(0, 2.0)], 1.0);
        sparse.row(&[(1, 1.0), (2, 1.0)], 1.0);
        assert_eq!(sparse.solve(&mut |_, _| ()), None);
    }
}
