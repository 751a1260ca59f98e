//! Solve of all unknowns at once, by the caller's solver: for walks too long for the kept part.
//!
//! The rows are the same, as sparse equations. A solver that orders and factors them well takes memory in proportion to
//! the measurements, where the kept part takes the square of the stops. The kept unknowns are numbered first, then
//! those of each camera.

use core::fmt;

use nalgebra::{Matrix2, Vector2};

use super::{
    covariance::Block,
    equations::{Parts, by_kept, of_stop, short_dot},
    problem::{BLOCK, COMPASS, Problem, SCALE, STOPS, SightRow, Standing, Told},
};
use crate::{Real, numerics::real::lit};

/// Solver of least squares with many unknowns and few of them in each row.
pub trait Solver<T: Real>: fmt::Debug {
    /// Forgets all rows. Unknowns come in groups of these sizes, whose members occur in the same rows. Unknowns of the
    /// first group occur in most rows.
    fn begin(&mut self, groups: &mut dyn Iterator<Item = usize>);

    /// Adds a row: its derivatives, at most one for each unknown, and its residual.
    fn row(&mut self, entries: &[(usize, T)], residual: T);

    /// Calls `step` with each unknown and its step to the minimum; the step is zero for an unknown without rows.
    /// Returns the fall of the sum of squared residuals. `None` if an unknown has rows that do not determine it.
    fn solve(&mut self, step: &mut dyn FnMut(usize, T)) -> Option<T>;

    /// Prepares [`covariance`](Self::covariance).
    fn invert(&mut self) -> Option<()>;

    /// Returns the covariance of two unknowns of one row.
    fn covariance(&self, i: usize, j: usize) -> Option<T>;

    /// Returns `count` columns of the covariance from unknown `first` on, one after the other.
    fn columns(&mut self, first: usize, count: usize) -> Option<&[T]>;
}

/// Most entries of a row.
const MOST: usize = BLOCK + 6;

/// Row that is being made.
struct Entries<T> {
    entries: [(usize, T); MOST],
    count: usize,
}

impl<T: Real> Entries<T> {
    fn new() -> Self {
        Self {
            entries: [(0, T::zero()); MOST],
            count: 0,
        }
    }

    fn put(&mut self, at: usize, by: T) {
        if let Some(entry) = self.entries.get_mut(self.count) {
            *entry = (at, by);
            self.count += 1;
        }
    }

    fn all(&self) -> &[(usize, T)] {
        self.entries.get(..self.count).unwrap_or_default()
    }

    /// Returns the variance of the prediction for the row.
    fn leverage(&self, solver: &dyn Solver<T>) -> Option<T> {
        self.product(self, solver)
    }

    fn product(&self, other: &Self, solver: &dyn Solver<T>) -> Option<T> {
        let mut sum = T::zero();
        for (i, a) in self.all() {
            for (j, b) in other.all() {
                sum += *a * *b * solver.covariance(*i, *j)?;
            }
        }
        Some(sum)
    }

    /// Returns the product of a column of the covariance and the row.
    fn along(&self, column: &[T]) -> T {
        self.all().iter().fold(T::zero(), |sum, (i, by)| {
            sum + column.get(*i).copied().unwrap_or_else(T::zero) * *by
        })
    }
}

impl<T: Real> Problem<'_, T> {
    /// Index of a camera's first unknown.
    fn of_camera(&self, camera: usize) -> usize {
        self.of_mark(self.marks.len()) + self.last_axis() * camera
    }

    pub(super) fn unknowns(&self) -> usize {
        self.of_camera(self.cameras.len())
    }

    /// Calls a function with the solver taken out.
    pub(super) fn with_solver<R>(
        &mut self,
        work: impl FnOnce(&mut Self, &mut dyn Solver<T>) -> Option<R>,
    ) -> Option<R> {
        let solver = self.solver.take()?;
        let done = work(self, &mut *solver);
        self.solver = Some(solver);
        done
    }

    fn sight_entries(&self, camera: usize, stop: u16, row: &SightRow<T>) -> Entries<T> {
        let mut entries = Entries::new();
        let i = of_stop(stop);
        entries.put(i, row.by_place.x);
        entries.put(i + 1, row.by_place.y);
        let first = self.of_camera(camera);
        let axes = self.axes(camera);
        for (axis, by) in row.by_camera.iter().enumerate() {
            if axes.contains(&axis) {
                entries.put(first + axis, *by);
            }
        }
        entries
    }

    fn leg_entries(by: [T; 6], later: usize) -> Entries<T> {
        let mut entries = Entries::new();
        let i = STOPS + 2 * later;
        let of = [SCALE, COMPASS, i - 2, i - 1, i, i + 1];
        for (i, by) in of.into_iter().zip(by) {
            entries.put(i, by);
        }
        entries
    }

    /// See [`assemble`](Self::assemble).
    pub(super) fn assemble_whole(&mut self) -> Option<T> {
        self.common.told = Told::Equations;
        self.with_solver(|problem, solver| {
            let places = problem.stops.len() + problem.marks.len();
            let cameras = core::iter::repeat_n(problem.last_axis(), problem.cameras.len());
            solver.begin(&mut core::iter::repeat_n(2, 1 + places).chain(cameras));
            let mut cost = T::zero();
            let mut add = |entries: &Entries<T>, residual: T| {
                solver.row(entries.all(), residual);
                cost += residual * residual;
            };
            for camera in 0..problem.cameras.len() {
                if !problem.is_estimated(camera) {
                    continue;
                }
                for axis in problem.axes(camera) {
                    if let Some((residual, weight)) = problem.prior_of(camera, axis) {
                        let mut entries = Entries::new();
                        entries.put(problem.of_camera(camera) + axis, weight);
                        add(&entries, residual);
                    }
                }
                for (_, sight) in problem.own(camera) {
                    if problem.counts(camera, sight)
                        && let Some(row) = problem.sight_row(sight)
                    {
                        let entries = problem.sight_entries(camera, sight.stop, &row);
                        add(&entries, row.residual);
                    }
                }
            }
            for visit in problem.visits {
                let Some((off, weight)) = problem.visit_rows(visit) else {
                    continue;
                };
                let (i, j) = (of_stop(visit.stop), problem.of_mark(visit.mark.into()));
                for (axis, off) in off.iter().enumerate() {
                    let mut entries = Entries::new();
                    entries.put(i + axis, weight);
                    entries.put(j + axis, -weight);
                    add(&entries, *off);
                }
            }
            for later in 1..problem.stops.len() {
                for row in problem.leg_rows(later).iter().flatten() {
                    add(&Self::leg_entries(by_kept(row), later), row.residual);
                }
            }
            for (i, residual, weight) in problem.carrier_priors() {
                let mut entries = Entries::new();
                entries.put(i, weight);
                add(&entries, residual);
            }
            Some(cost)
        })
    }

    /// See [`find_step`](Self::find_step).
    pub(super) fn find_whole_step(&mut self) -> Option<T> {
        let worth = self.with_solver(|problem, solver| {
            let first = problem.of_mark(0);
            let of_cameras = problem.of_camera(0);
            let block = problem.last_axis();
            solver.solve(&mut |i, step| {
                let at = if i < STOPS {
                    problem.common.carrier_step.get_mut(i)
                } else if i < first {
                    let stop = problem.stops.get_mut((i - STOPS) / 2);
                    stop.and_then(|stop| stop.step.get_mut(i % 2))
                } else if i < of_cameras {
                    let mark = problem.marks.get_mut((i - first) / 2);
                    mark.and_then(|mark| mark.step.get_mut(i % 2))
                } else {
                    let camera = problem.cameras.get_mut((i - of_cameras) / block);
                    camera.and_then(|camera| camera.step.get_mut((i - of_cameras) % block))
                };
                if let Some(at) = at {
                    *at = step;
                }
            })
        })?;
        self.common.told = Told::Factor;
        Some(worth)
    }

    /// See [`find_covariances`](Self::find_covariances).
    pub(super) fn find_whole_covariances(&mut self) -> Option<()> {
        self.common.told = Told::Equations;
        self.with_solver(|problem, solver| {
            solver.invert()?;
            for (n, stop) in problem.stops.iter_mut().enumerate() {
                let i = STOPS + 2 * n;
                stop.is_undetermined = !(solver.covariance(i, i)? > T::zero());
            }
            for later in 1..problem.stops.len() {
                let Some(rows) = problem.leg_rows(later) else {
                    continue;
                };
                let [a, b] = rows.map(|row| Self::leg_entries(by_kept(&row), later));
                let own = [
                    a.leverage(solver)?,
                    a.product(&b, solver)?,
                    b.leverage(solver)?,
                ];
                problem.stops.get_mut(later)?.leverage = own;
            }
            problem.with_parts(|problem, mut parts| {
                for camera in 0..problem.cameras.len() {
                    for (n, sight) in problem.own(camera) {
                        let row = problem.sight_row(sight);
                        if let Some(row) = row.filter(|_| problem.counts(camera, sight)) {
                            let entries = problem.sight_entries(camera, sight.stop, &row);
                            parts.lines.set_number(n, entries.leverage(solver)?);
                        }
                    }
                }
                Some(())
            })
        })?;
        self.common.told = Told::Covariances;
        Some(())
    }

    /// See [`camera_covariance`](Self::camera_covariance).
    pub(super) fn whole_camera_covariance(
        &mut self,
        camera: usize,
        other: usize,
    ) -> Option<Block<T>> {
        self.with_solver(|problem, solver| {
            let of = |camera| {
                let (first, axes) = (problem.of_camera(camera), problem.axes(camera));
                axes.map(move |axis| first + axis)
            };
            let mut block = [[T::zero(); BLOCK]; BLOCK];
            for (row, i) in block.iter_mut().zip(of(camera)) {
                for (entry, j) in row.iter_mut().zip(of(other)) {
                    *entry = if camera == other {
                        solver.covariance(i, j)?
                    } else {
                        *solver.columns(i, 1)?.get(j)?
                    };
                }
            }
            Some(block)
        })
    }

    pub(super) fn whole_pair_covariance(&mut self, i: usize) -> Option<Matrix2<T>> {
        self.with_solver(|_, solver| {
            let across = solver.covariance(i, i + 1)?;
            let [a, b] = [solver.covariance(i, i)?, solver.covariance(i + 1, i + 1)?];
            Some(Matrix2::new(a, across, across, b))
        })
    }

    /// Returns the variance of the prediction for a sight that is left out.
    pub(super) fn whole_leverage(
        &mut self,
        camera: usize,
        stop: u16,
        row: &SightRow<T>,
    ) -> Option<T> {
        self.with_solver(|problem, solver| {
            let entries = problem.sight_entries(camera, stop, row);
            let mut sum = T::zero();
            for (i, by) in entries.all() {
                sum += *by * entries.along(solver.columns(*i, 1)?);
            }
            Some(sum)
        })
    }

    /// See [`influences`](Self::influences).
    pub(super) fn whole_influences(
        &mut self,
        camera: usize,
        tell: &mut dyn FnMut(&[T], T, bool),
    ) -> Option<()> {
        self.with_solver(|problem, solver| {
            let unknowns = problem.unknowns();
            let axes = problem.axes(camera);
            let first = problem.of_camera(camera) + axes.start;
            let columns = solver.columns(first, axes.len())?;
            let columns = || columns.chunks_exact(unknowns);
            problem.with_parts(|problem, parts| {
                let mut moved = [T::zero(); BLOCK];
                let mut tell_row = |entries: &Entries<T>, leverage: T, is_leg: bool| {
                    for (moved, column) in moved.iter_mut().zip(columns()) {
                        *moved = entries.along(column);
                    }
                    let moved = moved.get(..axes.len()).unwrap_or_default();
                    tell(moved, T::one() - leverage, is_leg);
                };
                for other in 0..problem.cameras.len() {
                    for (n, sight) in problem.own(other) {
                        let row = problem.sight_row(sight);
                        if let Some(row) = row.filter(|_| problem.counts(other, sight)) {
                            let entries = problem.sight_entries(other, sight.stop, &row);
                            tell_row(&entries, parts.lines.get(n)?.number, false);
                        }
                    }
                }
                for later in 1..problem.stops.len() {
                    let stop = problem.stops.get(later)?;
                    let rows = problem.leg_rows_of(later);
                    let Some(rows) = rows.filter(|_| stop.standing == Standing::Counts) else {
                        continue;
                    };
                    let [first, _, second] = stop.leverage;
                    for (row, leverage) in rows.iter().zip([first, second]) {
                        tell_row(&Self::leg_entries(by_kept(row), later), leverage, true);
                    }
                }
                Some(())
            })
        })
    }

    /// Computes for a test of a camera's last sights: the covariance of its unknowns, and for each sight's line their
    /// covariance with the place.
    pub(super) fn whole_inner(&mut self, camera: usize) -> Option<Block<T>> {
        self.with_solver(|problem, solver| {
            let unknowns = problem.unknowns();
            let axes = problem.axes(camera);
            let first = problem.of_camera(camera) + axes.start;
            let columns = solver.columns(first, axes.len())?;
            let columns = || columns.chunks_exact(unknowns);
            let mut block = [[T::zero(); BLOCK]; BLOCK];
            for (row, column) in block.iter_mut().zip(columns()) {
                let own = column.get(first..first + axes.len())?;
                row.get_mut(..own.len())?.copy_from_slice(own);
            }
            problem.with_parts(|problem, mut parts: Parts<'_, T>| {
                for (n, sight) in problem.own(camera) {
                    let by = problem
                        .sight_row(sight)
                        .map_or_else(Vector2::zeros, |row| row.by_place);
                    let i = of_stop(sight.stop);
                    let q = parts.lines.q_mut(n)?;
                    for (q, column) in q.iter_mut().zip(columns()) {
                        *q = short_dot(column.get(i..i + 2)?, by.as_slice());
                    }
                }
                Some(())
            })?;
            Some(block)
        })
    }

    /// Priors of the carrier: index of the unknown, residual and weight.
    pub(super) fn carrier_priors(&self) -> [(usize, T, T); 2] {
        let common = &*self.common;
        [
            (SCALE, common.carrier.x, common.scale_prior),
            (COMPASS, common.carrier.y, common.compass_prior),
        ]
        .map(|(i, value, prior)| {
            // Only the prior tells a scale that sets all lengths.
            let pinned = if i == SCALE && !common.is_baseline_known {
                lit(PINNED)
            } else {
                T::one()
            };
            let weight = pinned / prior.sigma;
            (i, (value - prior.mean) * weight, weight)
        })
    }

    /// Returns the strength from which on a bearing makes its camera suspect. It grows with the number of sights: of
    /// many, some are far off by chance.
    pub(super) fn suspicion(&self, least: f64) -> T {
        let count = u32::try_from(self.sights.len()).unwrap_or(u32::MAX);
        (T::whole(count) / lit(BY_CHANCE)).ln().max(lit(least))
    }
}

/// Factor by which the prior of a scale that sets all lengths is tightened.
const PINNED: f64 = 30.0;

/// Number of bearings that may make their cameras suspect by chance.
const BY_CHANCE: f64 = 20.0;
