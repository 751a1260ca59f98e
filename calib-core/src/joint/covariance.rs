//! Covariances of cameras and of measurements, from that of the kept unknowns.
//!
//! The step of a camera is `R^-1 (z - Q^T J dx)`: its own part, which the rows give for known places, and the
//! part by which places move it. So with the covariance `D` of places its own is `R^-1 N R^-T`,
//! `N = 1 + Q^T J D J^T Q`, and that of a predicted row `q^T N q - 2 q^T Q^T J D J^T + J D J^T`. Sums over
//! pairs of its sights give all of these; no pass is needed.

use nalgebra::{Matrix2, SMatrix, Vector2};

use super::{
    equations::{Line, Parts, by_kept, of_stop, put, short_dot},
    kept::Kept,
    problem::{BLOCK, Problem, Sight, SightRow, Standing},
};
use crate::{Real, numerics::real::lit};

/// A symmetric matrix of a camera's block.
pub(super) type Block<T> = [[T; BLOCK]; BLOCK];

/// Where the other sights of a test explain a sight up to less than this share, it tells nothing.
const EXPLAINED: f64 = 1e-3;

/// `J D J'^T` of two sights.
#[inline]
fn between<T: Real>(
    kept: &Kept<'_, T>,
    (stop, a): (u16, Vector2<T>),
    (other, b): (u16, Vector2<T>),
) -> T {
    let [[xx, xy], [yx, yy]] = kept.block(of_stop(stop), of_stop(other));
    a.x * (xx * b.x + xy * b.y) + a.y * (yx * b.x + yy * b.y)
}

fn at_place<T: Real>(sight: &Sight<T>, line: &Line<'_, T>) -> (u16, Vector2<T>) {
    (sight.stop, line.by_place)
}

/// Vectors of this length, one behind the other. Those of length zero do not count: there are none.
fn each<T>(numbers: &[T], length: usize) -> core::slice::ChunksExact<'_, T> {
    numbers.chunks_exact(length.max(1))
}

impl<T: Real> Problem<'_, T> {
    /// Leverages of a camera's sights that count, into their lines.
    pub(super) fn find_leverages(&self, camera: usize, parts: &mut Parts<'_, T>) -> Option<()> {
        let unknowns = self.axes(camera).len();
        let mut inner = identity(unknowns);
        for (n, sight) in self.own(camera) {
            let Some(line) = parts.lines.get(n) else {
                continue;
            };
            let with_others = self.with_others(camera, parts, at_place(sight, &line));
            let q = line.q.get(..unknowns)?;
            add_product(&mut inner, q, &with_others);
            let place = at_place(sight, &line);
            let leverage =
                between(&parts.kept, place, place) - lit::<T>(2.0) * short_dot(q, &with_others);
            parts.lines.set_number(n, leverage);
        }
        for (n, _) in self.own(camera) {
            let line = parts.lines.get(n)?;
            let leverage = line.number + quadratic(&inner, line.q.get(..unknowns)?);
            parts.lines.set_number(n, leverage);
        }
        Some(())
    }

    /// `Q^T J D J^T` of a camera's sights and of a place as a row sees it.
    fn with_others(
        &self,
        camera: usize,
        parts: &Parts<'_, T>,
        place: (u16, Vector2<T>),
    ) -> [T; BLOCK] {
        let mut sum = [T::zero(); BLOCK];
        for (n, sight) in self.own(camera) {
            let Some(line) = parts.lines.get(n) else {
                continue;
            };
            let share = between(&parts.kept, at_place(sight, &line), place);
            for (sum, q) in sum.iter_mut().zip(line.q) {
                *sum += *q * share;
            }
        }
        sum
    }

    /// `N` of a camera.
    fn inner(&self, camera: usize, parts: &Parts<'_, T>) -> Block<T> {
        let unknowns = self.axes(camera).len();
        let mut inner = identity(unknowns);
        for (n, sight) in self.own(camera) {
            if let Some(line) = parts.lines.get(n) {
                let with_others = self.with_others(camera, parts, at_place(sight, &line));
                add_product(
                    &mut inner,
                    line.q.get(..unknowns).unwrap_or_default(),
                    &with_others,
                );
            }
        }
        inner
    }

    /// The covariance of a camera's unknowns, those of its block, or that with another one's.
    #[inline(never)] // for less flash
    pub(super) fn camera_covariance(&mut self, camera: usize, other: usize) -> Option<Block<T>> {
        if self.common.is_whole() {
            return self.whole_camera_covariance(camera, other);
        }
        self.with_parts(|problem, mut parts| {
            let [unknowns, others] = [camera, other].map(|camera| problem.axes(camera).len());
            let mut block = if camera == other {
                problem.inner(camera, &parts)
            } else {
                let mut block = [[T::zero(); BLOCK]; BLOCK];
                for (n, sight) in problem.own(other) {
                    let line = parts.lines.get(n)?;
                    let place = at_place(sight, &line);
                    let with_others = problem.with_others(camera, &parts, place);
                    for (row, left) in block.iter_mut().zip(with_others) {
                        for (entry, q) in row.iter_mut().zip(line.q.iter().take(others)) {
                            *entry += left * *q;
                        }
                    }
                }
                block
            };
            let triangle = parts.blocks.get(other, others)?;
            for row in block.iter_mut().take(unknowns) {
                triangle.back_substitute(row.get_mut(..others)?);
            }
            let triangle = parts.blocks.get(camera, unknowns)?;
            for j in 0..others {
                let mut column = [T::zero(); BLOCK];
                for (to, row) in column.iter_mut().zip(&block) {
                    *to = *row.get(j)?;
                }
                triangle.back_substitute(column.get_mut(..unknowns)?);
                for (row, from) in block.iter_mut().zip(column) {
                    *row.get_mut(j)? = from;
                }
            }
            Some(block)
        })
    }

    /// The covariance of two kept unknowns, this one and the one after it.
    pub(super) fn pair_covariance(&mut self, i: usize) -> Option<Matrix2<T>> {
        if self.common.is_whole() {
            return self.whole_pair_covariance(i);
        }
        self.with_parts(|_, parts| {
            let [[a, b], [c, d]] = parts.kept.block(i, i);
            Some(Matrix2::new(a, b, c, d))
        })
    }

    /// The variance that the estimates predict for a sight, in units of its own. `None` for one that counts
    /// but was not there when covariances were found.
    pub(super) fn leverage(&mut self, n: usize, row: &SightRow<T>) -> Option<T> {
        let sight = *self.sights.get(n)?;
        let camera = usize::from(sight.camera);
        if sight.standing != Standing::Counts && self.common.is_whole() {
            return self.whole_leverage(camera, sight.stop, row);
        }
        self.with_parts(|problem, mut parts| {
            if sight.standing == Standing::Counts {
                return Some(parts.lines.get(n)?.number);
            }
            let axes = problem.axes(camera);
            let unknowns = axes.len();
            let mut q = [T::zero(); BLOCK];
            let q = q.get_mut(..unknowns)?;
            put(q, row.by_camera.get(axes)?);
            parts.blocks.get(camera, unknowns)?.reduce(q);
            let place = (sight.stop, row.by_place);
            let with_others = problem.with_others(camera, &parts, place);
            let inner = problem.inner(camera, &parts);
            let own = between(&parts.kept, place, place);
            Some(own + quadratic(&inner, q) - lit::<T>(2.0) * short_dot(q, &with_others))
        })
    }

    /// The covariance of a camera's block, less its own part, with everything that is kept, in units of its rows:
    /// `-Q^T J D`, into as many vectors.
    fn find_gain(&self, camera: usize, parts: &mut Parts<'_, T>) -> Option<()> {
        let (kept, unknowns) = (self.layout().kept, self.axes(camera).len());
        parts.vectors.fill(T::zero());
        for (n, sight) in self.own(camera) {
            let line = parts.lines.get(n)?;
            if line.by_place == Vector2::zeros() {
                continue;
            }
            let i = of_stop(sight.stop);
            let by = line.by_place;
            for j in 0..kept {
                let moved = -(by.x * parts.kept.at(i, j) + by.y * parts.kept.at(i + 1, j));
                let column = parts.vectors.iter_mut().skip(j).step_by(kept);
                for (entry, q) in column.zip(line.q.iter().take(unknowns)) {
                    *entry += *q * moved;
                }
            }
        }
        Some(())
    }

    /// Movement of a camera by each measurement that is wrong by its sigma. Calls `tell` with the movement of
    /// its unknowns, for every sight that counts, then for every leg, each of its two directions, with the
    /// share of the error that shows.
    #[inline(never)] // for less flash
    pub(super) fn influences(
        &mut self,
        camera: usize,
        mut tell: impl FnMut(&[T], T, bool),
    ) -> Option<()> {
        if self.common.is_whole() {
            return self.whole_influences(camera, &mut tell);
        }
        self.with_parts(|problem, mut parts| {
            let (kept, unknowns) = (problem.layout().kept, problem.axes(camera).len());
            problem.find_gain(camera, &mut parts)?;
            let triangle = parts.blocks.get(camera, unknowns)?;
            let mut moved = [T::zero(); BLOCK];
            let moved = moved.get_mut(..unknowns)?;
            for j in 0..kept {
                for (to, from) in moved
                    .iter_mut()
                    .zip(parts.vectors.iter().skip(j).step_by(kept))
                {
                    *to = *from;
                }
                triangle.back_substitute(moved);
                for (to, from) in parts.vectors.iter_mut().skip(j).step_by(kept).zip(&*moved) {
                    *to = *from;
                }
            }
            let vectors = &*parts.vectors;
            // By a place.
            let by = |stop: u16, by: Vector2<T>, moved: &mut [T]| {
                let i = of_stop(stop);
                for (moved, gain) in moved.iter_mut().zip(each(vectors, kept)) {
                    let (x, y) = (gain.get(i).copied(), gain.get(i + 1).copied());
                    let zero = T::zero();
                    *moved = x.unwrap_or(zero) * by.x + y.unwrap_or(zero) * by.y;
                }
            };
            for other in 0..problem.cameras.len() {
                if !problem.is_estimated(other) {
                    continue;
                }
                let others = problem.axes(other).len();
                let mut through = [[T::zero(); BLOCK]; BLOCK];
                for (n, sight) in problem.own(other) {
                    let line = parts.lines.get(n)?;
                    by(sight.stop, line.by_place, moved);
                    for (row, moved) in through.iter_mut().zip(&*moved) {
                        for (entry, q) in row.iter_mut().zip(line.q) {
                            *entry += *moved * *q;
                        }
                    }
                }
                for (n, sight) in problem.own(other) {
                    if sight.standing != Standing::Counts {
                        continue;
                    }
                    let line = parts.lines.get(n)?;
                    by(sight.stop, line.by_place, moved);
                    let q = line.q.get(..others)?;
                    for (moved, row) in moved.iter_mut().zip(&through) {
                        *moved -= short_dot(row, q);
                    }
                    if other == camera {
                        let mut own = [T::zero(); BLOCK];
                        let own = own.get_mut(..unknowns)?;
                        for (own, q) in own.iter_mut().zip(q) {
                            *own = *q;
                        }
                        parts.blocks.get(camera, unknowns)?.back_substitute(own);
                        for (moved, own) in moved.iter_mut().zip(own) {
                            *moved += *own;
                        }
                    }
                    tell(moved, T::one() - line.number, false);
                }
            }
            for later in 1..problem.stops.len() {
                let Some(rows) = problem.leg_rows_of(later) else {
                    continue;
                };
                let stop = problem.stops.get(later)?;
                if stop.standing != Standing::Counts || stop.is_leg_undetermined {
                    continue;
                }
                let [first, _, second] = stop.leverage;
                let i = of_stop(u16::try_from(later).ok()?);
                for (row, leverage) in rows.iter().zip([first, second]) {
                    let by = by_kept(row);
                    for (moved, gain) in moved.iter_mut().zip(each(vectors, kept)) {
                        let [scale, compass, own @ ..] = by;
                        let carrier = short_dot(gain, &[scale, compass]);
                        *moved = carrier + short_dot(gain.get(i - 2..i + 2)?, &own);
                    }
                    tell(moved, T::one() - leverage, true);
                }
            }
            Some(())
        })
    }

    /// Fall of chi squared if the last sights of a camera are left out, for each stop that they may begin at.
    /// Calls `tell` with the number of sights so far, by descending stop, and that fall. As far as there is
    /// room.
    #[inline(never)] // for less flash
    pub(super) fn tails(
        &mut self,
        camera: usize,
        mut tell: impl FnMut(&Self, usize, T),
    ) -> Option<()> {
        if self.common.is_whole() {
            return self.whole_tails(camera, &mut tell);
        }
        self.with_parts(|problem, mut parts| {
            let (kept, unknowns) = (problem.layout().kept, problem.axes(camera).len());
            let inner = problem.inner(camera, &parts);
            problem.find_gain(camera, &mut parts)?;
            let (gain, rest) = parts.vectors.split_at_mut_checked(unknowns * kept)?;
            let seen = |q: &[T], stop: u16, by: Vector2<T>| {
                let i = of_stop(stop);
                let vectors = each(gain, kept).zip(q);
                vectors.fold(T::zero(), |sum, (gain, q)| {
                    let x = gain.get(i).map_or_else(T::zero, |gain| *gain * by.x);
                    let y = gain.get(i + 1).map_or_else(T::zero, |gain| *gain * by.y);
                    sum + *q * (x + y)
                })
            };
            let mut fallen = T::zero();
            let mut begin = 0;
            let counting = || {
                let own = problem.own(camera);
                own.filter(|(_, sight)| sight.standing == Standing::Counts)
            };
            for (row, (n, sight)) in counting().enumerate() {
                let line = parts.lines.get(n)?;
                let own_q = line.q.get(..unknowns)?;
                let place = at_place(sight, &line);
                let (before, rest_of_room) = parts.rest.split_at_mut_checked(begin)?;
                let (Some(own), Some(mut residual)) = (
                    rest_of_room.get_mut(..=row),
                    problem.sight_row(sight).map(|row| row.residual),
                ) else {
                    break;
                };
                begin += row + 1;
                let mut factors = before;
                for (column, (m, other)) in counting().enumerate().take(row + 1) {
                    let second = parts.lines.get(m)?;
                    let q = second.q.get(..unknowns)?;
                    let leverage = bilinear(&inner, own_q, q)
                        + seen(own_q, other.stop, second.by_place)
                        + seen(q, sight.stop, line.by_place)
                        + between(&parts.kept, place, at_place(other, &second));
                    let (known, entry) = own.split_at_mut_checked(column)?;
                    let entry = entry.first_mut()?;
                    if column == row {
                        let left = T::one() - leverage - short_dot(known, known);
                        *entry = if left > lit(EXPLAINED) {
                            left.sqrt().recip()
                        } else {
                            T::zero()
                        };
                    } else {
                        let (factor, later) = factors.split_at_mut_checked(column + 1)?;
                        factors = later;
                        let (reciprocal, factor) = factor.split_last_mut()?;
                        *entry = (-leverage - short_dot(known, factor)) * *reciprocal;
                        residual -= *entry * *rest.get(column)?;
                    }
                }
                let reciprocal = *own.last()?;
                residual *= reciprocal;
                *rest.get_mut(row)? = residual;
                fallen += residual * residual;
                tell(problem, row + 1, fallen);
            }
            Some(())
        })
    }

    /// The same with the caller's solver.
    fn whole_tails(&mut self, camera: usize, tell: &mut dyn FnMut(&Self, usize, T)) -> Option<()> {
        let inner = self.whole_inner(camera)?;
        let axes = self.axes(camera);
        self.with_solver(|problem, solver| {
            let unknowns = problem.unknowns();
            let (mut fallen, mut row) = (T::zero(), 0);
            let mut next = problem.cameras.get(camera)?.last;
            while let Some((n, sight)) = problem.next_own(&mut next) {
                if sight.standing != Standing::Counts {
                    continue;
                }
                let Some(found) = problem.sight_row(&sight) else {
                    break;
                };
                let columns = solver.columns(of_stop(sight.stop), 2)?;
                let (x, y) = columns.split_at_checked(unknowns)?;
                let by_camera = found.by_camera.get(axes.clone())?;
                let residual = problem.with_parts(|problem, parts| {
                    // Each row of the factor has its part of the residual behind it.
                    let begin = row * (row + 3) / 2;
                    let (mut factors, own) = parts.rest.split_at_mut_checked(begin)?;
                    let own = own.get_mut(..row + 2)?;
                    let mut residual = found.residual;
                    let counting = problem.own(camera);
                    let counting = counting.filter(|(_, sight)| sight.standing == Standing::Counts);
                    let gain = parts.lines.get(n)?.q;
                    for (column, (m, other)) in counting.enumerate().take(row + 1) {
                        let second = problem.sight_row(other)?;
                        let i = of_stop(other.stop);
                        let [x, y] = [x, y].map(|column| {
                            let own = column.get(i..i + 2).unwrap_or_default();
                            short_dot(own, second.by_place.as_slice())
                        });
                        let other_camera = second.by_camera.get(axes.clone())?;
                        let leverage = bilinear(&inner, by_camera, other_camera)
                            + short_dot(by_camera, parts.lines.get(m)?.q)
                            + short_dot(other_camera, gain)
                            + found.by_place.x * x
                            + found.by_place.y * y;
                        let (known, entry) = own.split_at_mut_checked(column)?;
                        let entry = entry.first_mut()?;
                        if column == row {
                            let left = T::one() - leverage - short_dot(known, known);
                            *entry = if left > lit(EXPLAINED) {
                                left.sqrt().recip()
                            } else {
                                T::zero()
                            };
                            residual *= *entry;
                        } else {
                            let (factor, later) = factors.split_at_mut_checked(column + 2)?;
                            factors = later;
                            let [factor @ .., reciprocal, other_residual] = factor else {
                                return None;
                            };
                            *entry = (-leverage - short_dot(known, factor)) * *reciprocal;
                            residual -= *entry * *other_residual;
                        }
                    }
                    *own.last_mut()? = residual;
                    Some(residual)
                });
                // There may be no more room.
                let Some(residual) = residual else { break };
                row += 1;
                fallen += residual * residual;
                tell(problem, row, fallen);
            }
            Some(())
        })
    }
}

fn identity<T: Real>(unknowns: usize) -> Block<T> {
    let mut identity = [[T::zero(); BLOCK]; BLOCK];
    for (i, row) in identity.iter_mut().enumerate().take(unknowns) {
        if let Some(entry) = row.get_mut(i) {
            *entry = T::one();
        }
    }
    identity
}

/// Adds `a b^T`.
fn add_product<T: Real>(to: &mut Block<T>, a: &[T], b: &[T; BLOCK]) {
    for (row, a) in to.iter_mut().zip(a) {
        for (entry, b) in row.iter_mut().zip(b) {
            *entry += *a * *b;
        }
    }
}

fn bilinear<T: Real>(matrix: &Block<T>, a: &[T], b: &[T]) -> T {
    let rows = matrix.iter().zip(a);
    rows.fold(T::zero(), |sum, (row, a)| sum + *a * short_dot(row, b))
}

fn quadratic<T: Real>(matrix: &Block<T>, a: &[T]) -> T {
    bilinear(matrix, a, a)
}

/// The corner of a block that is a pose's.
pub(super) fn pose_of<T: Real>(block: &Block<T>) -> SMatrix<T, 3, 3> {
    let mut pose = SMatrix::<T, 3, 3>::zeros();
    for (i, row) in block.iter().enumerate().take(3) {
        for (j, entry) in row.iter().enumerate().take(3) {
            if let Some(to) = pose.get_mut((i, j)) {
                *to = *entry;
            }
        }
    }
    pose
}
