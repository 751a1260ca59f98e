//! Covariances of cameras and of measurements, from that of the kept unknowns.
//!
//! The step of a camera is `R^-1 (z - Q^T J dx)`: its own part, which its rows give if places are known, and the part
//! by which places move it. Let `D` be the covariance of places. Then the covariance of the camera is `R^-1 N R^-T`
//! with `N = 1 + Q^T J D J^T Q`, and the variance of a predicted row is `q^T N q - 2 q^T Q^T J D J^T + J D J^T`. Sums
//! over pairs of the camera's sights give all of these without a pass.

use nalgebra::{Matrix2, SMatrix, Vector2};

use super::{
    equations::{Line, Parts, by_kept, of_stop, put, short_dot},
    kept::Kept,
    problem::{BLOCK, Problem, Sight, SightRow, Standing},
};
use crate::{Real, numerics::real::lit};

/// Symmetric matrix of the size of a camera's block.
pub(super) type Block<T> = [[T; BLOCK]; BLOCK];

/// Share of a sight beyond the other sights of a test, below which it tells nothing.
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

/// Vectors of this length, one after the other. Without a length there are none.
fn each<T>(numbers: &[T], length: usize) -> core::slice::ChunksExact<'_, T> {
    numbers.chunks_exact(length.max(1))
}

impl<T: Real> Problem<'_, T> {
    /// Writes the leverages of a camera's counting sights into their lines.
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

    /// Returns `Q^T J D J^T` of a camera's sights with a place, as a row sees it.
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

    /// Returns `N` of a camera.
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

    /// Returns the covariance of the unknowns of a camera's block, or their covariance with those of another camera.
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

    /// Returns the covariance of the kept unknown `i` and the one after it.
    pub(super) fn pair_covariance(&mut self, i: usize) -> Option<Matrix2<T>> {
        if self.common.is_whole() {
            return self.whole_pair_covariance(i);
        }
        self.with_parts(|_, parts| {
            let [[a, b], [c, d]] = parts.kept.block(i, i);
            Some(Matrix2::new(a, b, c, d))
        })
    }

    /// Returns the variance of the prediction for a sight, in units of the sight's own variance. `None` for a counting
    /// sight that came after the covariances.
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

    /// Writes the covariance of a camera's block with all kept unknowns, without the block's own part and in units of
    /// its rows: `-Q^T J D`, one vector for each unknown of the block.
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

    /// Calls `tell` for every counting sight and then for each direction of every leg: with the movement of the
    /// camera's unknowns if that measurement errs by one sigma, and with the share of the error that shows.
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

    /// Calls `tell` for each stop from which on the last sights of a camera may be left out: with the number of these
    /// sights, and with the fall of chi squared without them. Looks at as many sights as there is room for, from the
    /// last one on.
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

    /// The same, computed by the caller's solver.
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
                    // Each row of the factor is followed by its part of the residual.
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
                // The room may be used up.
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

/// Returns the corner of a block that belongs to the pose.
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
