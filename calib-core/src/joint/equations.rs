//! One pass: the measurements around the present estimates, as normal equations of the kept unknowns.
//!
//! No measurement ties two cameras to each other, so each camera's block of unknowns is eliminated by itself.
//! Its rows `[j | J]`, of its own unknowns and of places, are rotated into a small triangle `R`. With
//! `q = R^-T j` the rows' part that the camera does not explain is `(1 - Q Q^T) J`; its square is what the
//! camera tells about places. In these products nothing large cancels: the camera's own square is never
//! formed. The kept part is as large as the walk, not as the network.
//!
//! Legs are not rows of these equations: they are their unknowns. The unknown is not the place of a stop but
//! the error of the leg to it, in its sigmas:
//! `y = P (step of the place - step of the one before) + B (step of the carrier)`. The
//! information of a leg is then the identity, however much more it knows than the cameras do, and single
//! precision loses nothing of what these add to it. Places come back by adding up.

use core::task::Poll;

use nalgebra::Vector2;

use super::{
    Undetermined,
    kept::{Kept, SLICE, dot, packed},
    problem::{BLOCK, COMPASS, LegRow, Problem, SCALE, STOPS, Told, Unknown},
    triangle::{self, Triangle},
};
use crate::{Real, numerics::real::lit};

/// Numbers in the line of a sight, besides its part of the camera's block.
const LINE: usize = 3;
/// An unknown is undetermined if an undetermined direction moves it by more than this share of its largest movement.
const MOVES: f64 = 1e-3;
/// Share of a sight that its camera explains, beyond which the camera's rows are rotated one by one.
const DOMINANT: f64 = 0.99;
/// Last sights of a camera that one test can look at, in the default workspace.
const TAIL: usize = 32;

/// Cost of a change of variables for each entry of a row, in multiplications.
const OF_ENTRIES: usize = 64;
/// Cost of each pair of a camera's sights, in multiplications.
const OF_PAIR: usize = 16;
/// Cost of each sight, in multiplications.
const OF_ROW: usize = 200;

/// Returns the largest magnitude, or zero if there are no numbers.
fn largest<T: Real>(numbers: impl Iterator<Item = T>) -> T {
    numbers.fold(T::zero(), |most, number| most.max(number.abs()))
}

/// Sizes of all parts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    pub cameras: usize,
    pub sights: usize,
    /// Unknowns that are kept.
    pub kept: usize,
    /// Unknowns of a camera.
    pub block: usize,
}

impl Layout {
    pub(super) const fn new(
        cameras: usize,
        stops: usize,
        sights: usize,
        marks: usize,
        block: usize,
    ) -> Self {
        Self {
            cameras,
            sights,
            kept: STOPS + 2 * (stops + marks),
            block,
        }
    }

    /// The same layout without a kept part.
    pub(super) const fn without_kept(self) -> Self {
        Self { kept: 0, ..self }
    }

    /// Length of the workspace, in numbers.
    pub(super) const fn workspace(&self) -> usize {
        let tail = if self.sights < TAIL {
            self.sights
        } else {
            TAIL
        };
        packed(self.kept)
            + self.vectors() * self.kept
            + self.sights * (LINE + self.block)
            + self.cameras * triangle::packed(self.block + 1)
            + packed(tail)
    }

    const fn vectors(&self) -> usize {
        self.block + 2
    }
}

/// The workspace.
pub(super) struct Parts<'a, T> {
    /// The equations of the kept unknowns, their factor or its covariance.
    pub kept: Kept<'a, T>,
    /// Vectors as long as that.
    pub vectors: &'a mut [T],
    pub lines: Lines<'a, T>,
    pub blocks: Blocks<'a, T>,
    /// The rest.
    pub rest: &'a mut [T],
}

/// A line for each sight: derivatives by the place; then the residual or, once covariances are known, the leverage;
/// then `q`.
pub(super) struct Lines<'a, T> {
    numbers: &'a mut [T],
    length: usize,
}

/// The triangle of each camera.
pub(super) struct Blocks<'a, T> {
    numbers: &'a mut [T],
    length: usize,
}

/// The line of a sight.
pub(super) struct Line<'a, T: Real> {
    pub by_place: Vector2<T>,
    /// Residual or, once covariances are known, leverage.
    pub number: T,
    /// Part of its row that belongs to the camera's unknowns, in units of the information of all rows together.
    pub q: &'a [T],
}

impl<'a, T: Real> Parts<'a, T> {
    fn new(numbers: &'a mut [T], layout: &Layout) -> Option<Self> {
        let (kept, rest) = numbers.split_at_mut_checked(packed(layout.kept))?;
        let (vectors, rest) = rest.split_at_mut_checked(layout.vectors() * layout.kept)?;
        let length = LINE + layout.block;
        let (lines, rest) = rest.split_at_mut_checked(layout.sights * length)?;
        let triangle = triangle::packed(layout.block + 1);
        let (blocks, rest) = rest.split_at_mut_checked(layout.cameras * triangle)?;
        Some(Self {
            kept: Kept::new(kept, layout.kept)?,
            vectors,
            lines: Lines {
                numbers: lines,
                length,
            },
            blocks: Blocks {
                numbers: blocks,
                length: triangle,
            },
            rest,
        })
    }
}

impl<T: Real> Lines<'_, T> {
    #[inline]
    pub(super) fn get(&self, n: usize) -> Option<Line<'_, T>> {
        let line = self.numbers.get(n * self.length..(n + 1) * self.length)?;
        let ([x, y, number], q) = line.split_first_chunk()?;
        Some(Line {
            by_place: Vector2::new(*x, *y),
            number: *number,
            q,
        })
    }

    fn get_mut(&mut self, n: usize) -> Option<(&mut [T; LINE], &mut [T])> {
        let line = n * self.length..(n + 1) * self.length;
        self.numbers.get_mut(line)?.split_first_chunk_mut()
    }

    pub(super) fn q_mut(&mut self, n: usize) -> Option<&mut [T]> {
        self.get_mut(n).map(|(_, q)| q)
    }

    pub(super) fn set_number(&mut self, n: usize, to: T) {
        if let Some(([_, _, number], _)) = self.get_mut(n) {
            *number = to;
        }
    }
}

impl<T: Real> Blocks<'_, T> {
    /// Returns the triangle of a camera that has this number of unknowns.
    pub(super) fn get(&mut self, camera: usize, unknowns: usize) -> Option<Triangle<'_, T>> {
        let begin = camera * self.length;
        let numbers = self.numbers.get_mut(begin..begin + self.length)?;
        Triangle::new(numbers, unknowns + 1)
    }
}

/// First of the two unknowns of a stop.
pub(super) const fn of_stop(stop: u16) -> usize {
    STOPS + 2 * stop as usize
}

/// Conversion between a step of a stop's place and a step of the error of the leg to it.
#[derive(Clone, Copy)]
struct Way<T> {
    /// Inverse of the derivatives by the place, by rows.
    inverse: [[T; 2]; 2],
    /// That times the derivatives by the carrier.
    by_carrier: [[T; 2]; 2],
}

impl<T: Real> Way<T> {
    /// Changes the variables of a row. It has entries for the carrier, for the place before and for the place.
    /// Afterwards it has entries for the carrier, for the place before (with which all later places move) and for the
    /// error of the leg.
    fn leave_places(&self, [c1, c2, x, y, u1, u2]: &mut [T; 6]) {
        let ([[a, b], [c, d]], [[e, f], [g, h]]) = (self.inverse, self.by_carrier);
        let (v1, v2) = (*u1, *u2);
        *c1 -= e * v1 + g * v2;
        *c2 -= f * v1 + h * v2;
        *x += v1;
        *y += v2;
        *u1 = a * v1 + c * v2;
        *u2 = b * v1 + d * v2;
    }

    /// Returns the step of the place from the steps of the leg's error, of the carrier and of the place before.
    fn find_place(&self, [c1, c2, x, y, u1, u2]: &mut [T; 6]) {
        let ([[a, b], [c, d]], [[e, f], [g, h]]) = (self.inverse, self.by_carrier);
        let (v1, v2) = (*u1, *u2);
        *u1 = *x + a * v1 + b * v2 - e * *c1 - f * *c2;
        *u2 = *y + c * v1 + d * v2 - g * *c1 - h * *c2;
    }
}

impl<T: Real> Problem<'_, T> {
    pub(super) fn layout(&self) -> Layout {
        let layout = Layout::new(
            self.cameras.len(),
            self.stops.len(),
            self.sights.len(),
            self.marks.len(),
            self.last_axis(),
        );
        if self.common.is_whole() {
            layout.without_kept()
        } else {
            layout
        }
    }

    /// Calls a function with the workspace taken out, so that rows can be computed while it is written.
    pub(super) fn with_parts<R>(
        &mut self,
        work: impl FnOnce(&mut Self, Parts<'_, T>) -> Option<R>,
    ) -> Option<R> {
        let layout = self.layout();
        let numbers = core::mem::take(&mut self.workspace);
        let done = Parts::new(numbers, &layout).and_then(|parts| work(self, parts));
        self.workspace = numbers;
        done
    }

    /// Does a slice of the assembly of the equations around the present estimates. Returns chi squared once they are
    /// ready to be factored.
    #[inline(never)] // for less flash
    pub(super) fn assemble(&mut self) -> Poll<Option<T>> {
        let from = match self.common.told {
            Told::Assembling(step) => step,
            _ => 0,
        };
        let next = if self.common.is_whole() {
            self.assemble_whole().map(|cost| {
                self.common.cost = [cost, T::zero()];
                Told::Factoring { row: 0, dropped: 0 }
            })
        } else {
            self.assemble_from(from)
        };
        self.common.told = next.unwrap_or(Told::Equations);
        match next {
            Some(Told::Assembling(_)) => Poll::Pending,
            found => {
                let [cost, of_carrier] = self.common.cost;
                Poll::Ready(found.map(|_| cost + of_carrier))
            }
        }
    }

    /// Does slices of [`assemble`](Self::assemble) from a step on: first the cameras, then the legs, beginning with the
    /// last.
    fn assemble_from(&mut self, from: usize) -> Option<Told> {
        let (cameras, stops) = (self.cameras.len(), self.stops.len());
        self.with_parts(|problem, mut parts| {
            let kept = problem.layout().kept;
            if from == 0 {
                parts.kept.clear();
                parts.vectors.get_mut(..kept)?.fill(T::zero());
                problem.common.cost = [T::zero(); 2];
            }
            let mut work = 0;
            for step in from..cameras + stops {
                if work > SLICE {
                    return Some(Told::Assembling(step));
                }
                let [mut cost, mut of_carrier] = problem.common.cost;
                match step.checked_sub(cameras) {
                    None if problem.is_estimated(step) => {
                        cost += problem.eliminate(step, &mut parts, &mut work)?;
                    }
                    None => {}
                    Some(0) => cost += problem.add_visits(&mut parts)?,
                    Some(n) => {
                        work += OF_ENTRIES * kept;
                        problem.change_to_leg(stops - n, &mut parts, &mut of_carrier)?;
                    }
                }
                problem.common.cost = [cost, of_carrier];
            }
            for (i, residual, weight) in problem.carrier_priors() {
                parts.kept.add(i, i, weight * weight);
                *parts.vectors.get_mut(i)? += residual * weight;
                let [_, of_carrier] = &mut problem.common.cost;
                *of_carrier += residual * residual;
            }
            Some(Told::Factoring { row: 0, dropped: 0 })
        })
    }

    /// Eliminates a camera and adds its information about places. Returns chi squared of its sights. Adds the number of
    /// multiplications to `work`.
    fn eliminate(&self, camera: usize, parts: &mut Parts<'_, T>, work: &mut usize) -> Option<T> {
        let unknowns = self.axes(camera).len();
        let mut triangle = parts.blocks.get(camera, unknowns)?;
        let cost = self.enter(camera, &mut triangle, &mut parts.lines)?;
        let mut right = [T::zero(); BLOCK];
        let right = right.get_mut(..unknowns)?;
        triangle.right_side(right);
        let (mut is_dominated, mut sights) = (false, 0);
        for (n, _) in self.own(camera) {
            sights += 1;
            let ([_, _, residual], q) = parts.lines.get_mut(n)?;
            triangle.reduce(q.get_mut(..unknowns)?);
            *residual += short_dot(q, right);
            is_dominated |= short_dot(q, q) > lit(DOMINANT);
        }
        *work += OF_ROW * sights;
        if is_dominated {
            *work += 4 * sights * unknowns * self.layout().kept;
            self.add_rows(camera, parts)?;
        } else {
            *work += OF_PAIR * sights * sights;
            self.add_pairs(camera, parts)?;
        }
        Some(cost)
    }

    /// Adds the information of a camera that explains some sight nearly alone, as one right before the target. The
    /// square less the explained part would have no digits left. So each row is rotated with its entries for places,
    /// and what remains of it is information about places alone.
    fn add_rows(&self, camera: usize, parts: &mut Parts<'_, T>) -> Option<()> {
        let (kept, axes) = (self.layout().kept, self.axes(camera));
        let unknowns = axes.len();
        let (g, vectors) = parts.vectors.split_at_mut_checked(kept)?;
        let (row, vectors) = vectors.split_at_mut_checked(kept)?;
        vectors.fill(T::zero());
        // Each rotated row has the camera's part first and the right side last.
        let mut rotated = [[T::zero(); BLOCK + 1]; BLOCK];
        for (place, axis) in axes.clone().enumerate() {
            if let Some((residual, weight)) = self.prior_of(camera, axis) {
                let own = rotated.get_mut(place)?;
                *own.get_mut(place)? = weight;
                *own.last_mut()? = -residual;
            }
        }
        for (n, sight) in self.own(camera) {
            let line = parts.lines.get(n)?;
            if line.by_place == Vector2::zeros() {
                continue;
            }
            let found = self.sight_row(sight)?;
            let mut own = [T::zero(); BLOCK + 1];
            put(&mut own, found.by_camera.get(axes.clone())?);
            *own.last_mut()? = -found.residual;
            row.fill(T::zero());
            let i = of_stop(sight.stop);
            row.get_mut(i..i + 2)?
                .copy_from_slice(line.by_place.as_slice());
            let others = rotated.iter_mut().zip(vectors.chunks_exact_mut(kept));
            for (place, (other, vector)) in others.enumerate().take(unknowns) {
                let pivot = [*other.get(place)?, *own.get(place)?];
                triangle::rotate(pivot, other, &mut own);
                triangle::rotate(pivot, vector, row);
            }
            let right = *own.last()?;
            for (i, by) in row.iter().enumerate() {
                if *by == T::zero() {
                    continue;
                }
                *g.get_mut(i)? -= *by * right;
                for (j, other) in row.iter().enumerate().take(i + 1) {
                    if *other != T::zero() {
                        parts.kept.add(i, j, *by * *other);
                    }
                }
            }
        }
        Some(())
    }

    /// Enters the rows of a camera into a triangle and into their lines. Returns their chi squared.
    fn enter(
        &self,
        camera: usize,
        triangle: &mut Triangle<'_, T>,
        lines: &mut Lines<'_, T>,
    ) -> Option<T> {
        let axes = self.axes(camera);
        let unknowns = axes.len();
        triangle.clear();
        let mut cost = T::zero();
        let mut row = [T::zero(); BLOCK + 1];
        let row = row.get_mut(..=unknowns)?;
        for (place, axis) in axes.clone().enumerate() {
            if let Some((residual, weight)) = self.prior_of(camera, axis) {
                cost += residual * residual;
                row.fill(T::zero());
                *row.get_mut(place)? = weight;
                *row.last_mut()? = -residual;
                triangle.insert(row);
            }
        }
        for (n, sight) in self.own(camera) {
            let (line, q) = lines.get_mut(n)?;
            q.fill(T::zero());
            let counts = self.counts(camera, sight);
            let Some(found) = self.sight_row(sight).filter(|_| counts) else {
                line.fill(T::zero());
                continue;
            };
            cost += found.residual * found.residual;
            *line = [found.by_place.x, found.by_place.y, found.residual];
            let by_camera = found.by_camera.get(axes.clone())?;
            put(q, by_camera);
            put(row, by_camera);
            *row.last_mut()? = -found.residual;
            triangle.insert(row);
        }
        triangle.drop_undetermined(row);
        Some(cost)
    }

    /// Adds the information about places from pairs of a camera's sights.
    fn add_pairs(&self, camera: usize, parts: &mut Parts<'_, T>) -> Option<()> {
        for (n, sight) in self.own(camera) {
            let line = parts.lines.get(n)?;
            if line.by_place == Vector2::zeros() {
                continue;
            }
            let i = of_stop(sight.stop);
            let g = parts.vectors.get_mut(i..i + 2)?;
            for (g, by) in g.iter_mut().zip(&line.by_place) {
                *g += *by * line.number;
            }
            let a = line.by_place;
            for (m, other) in self.own(camera) {
                let j = of_stop(other.stop);
                if j > i {
                    continue;
                }
                let second = parts.lines.get(m)?;
                let explained = short_dot(line.q, second.q);
                let share = if m == n {
                    T::one() - explained
                } else {
                    -explained
                };
                let b = second.by_place * share;
                parts.kept.add(i, j, a.x * b.x);
                if i != j {
                    parts.kept.add(i, j + 1, a.x * b.y);
                }
                parts.kept.add(i + 1, j, a.y * b.x);
                parts.kept.add(i + 1, j + 1, a.y * b.y);
            }
        }
        Some(())
    }

    fn add_visits(&self, parts: &mut Parts<'_, T>) -> Option<T> {
        let mut cost = T::zero();
        for visit in self.visits {
            let Some((off, weight)) = self.visit_rows(visit) else {
                continue;
            };
            let (i, j) = (of_stop(visit.stop), self.of_mark(visit.mark.into()));
            for (axis, off) in off.iter().enumerate() {
                let (i, j) = (i + axis, j + axis);
                parts.kept.add(i, i, weight * weight);
                parts.kept.add(j, j, weight * weight);
                parts.kept.add(j, i, -weight * weight);
                *parts.vectors.get_mut(i)? += weight * *off;
                *parts.vectors.get_mut(j)? -= weight * *off;
                cost += *off * *off;
            }
        }
        Some(cost)
    }

    /// First of the two unknowns of a mark.
    pub(super) fn of_mark(&self, mark: usize) -> usize {
        STOPS + 2 * (self.stops.len() + mark)
    }

    /// Changes the variables from the step of a place to the error of the leg to it. Adds the leg's information and chi
    /// squared.
    fn change_to_leg(&self, later: usize, parts: &mut Parts<'_, T>, cost: &mut T) -> Option<()> {
        let way = self.way(later)?;
        let of = with_before(later);
        let [.., first, last] = of;
        parts
            .kept
            .change(last, |entries| way.leave_places(entries))?;
        let mut entries = [T::zero(); 6];
        for (entry, i) in entries.iter_mut().zip(of) {
            *entry = *parts.vectors.get(i)?;
        }
        way.leave_places(&mut entries);
        for (entry, i) in entries.iter().zip(of) {
            *parts.vectors.get_mut(i)? = *entry;
        }
        let rows = self.leg_rows(later);
        for (row, i) in rows.iter().flatten().zip(first..) {
            parts.kept.add(i, i, T::one());
            *parts.vectors.get_mut(i)? += row.residual;
            *cost += row.residual * row.residual;
        }
        Some(())
    }

    /// Returns the conversion for the leg to a stop. If the leg was not measured, it is the step itself.
    fn way(&self, later: usize) -> Option<Way<T>> {
        let (zero, one) = (T::zero(), T::one());
        let Some([first, second]) = self.leg_rows(later) else {
            return Some(Way {
                inverse: [[one, zero], [zero, one]],
                by_carrier: [[zero; 2]; 2],
            });
        };
        let (p, q) = (first.by_place, second.by_place);
        let determinant = p.x * q.y - p.y * q.x;
        if !(determinant.abs() > zero && determinant.is_finite()) {
            return None;
        }
        let inverse = [
            [q.y / determinant, -p.y / determinant],
            [-q.x / determinant, p.x / determinant],
        ];
        let (c, d) = (first.by_carrier, second.by_carrier);
        let by_carrier = inverse.map(|[a, b]| [a * c.x + b * d.x, a * c.y + b * d.y]);
        Some(Way {
            inverse,
            by_carrier,
        })
    }

    /// Does a slice of the search for the step to the minimum of the assembled equations. The step is stored, not
    /// taken. Returns the predicted fall of chi squared, to first order.
    #[inline(never)] // for less flash
    pub(super) fn find_step(&mut self) -> Poll<Option<T>> {
        if self.common.is_whole() {
            return Poll::Ready(self.find_whole_step());
        }
        let (row, mut dropped) = match self.common.told {
            Told::Factoring { row, dropped } => (row, dropped),
            _ => (0, 0),
        };
        self.common.told = Told::Equations;
        let worth = self.with_parts(|problem, mut parts| {
            let kept = problem.layout().kept;
            let (g, rest) = parts.vectors.split_at_mut_checked(kept)?;
            let (diagonal, _) = rest.split_at_mut_checked(kept)?;
            let row = parts.kept.factor(diagonal, row, &mut dropped)?;
            if row < kept {
                problem.common.told = Told::Factoring { row, dropped };
                return None;
            }
            parts.kept.forward(g);
            let mut worth = dot(g, g);
            parts.kept.backward(g);
            problem.find_undetermined(dropped, &mut parts)?;
            for number in parts.vectors.get_mut(..kept)? {
                *number = -*number;
            }
            problem.spread(&mut parts, 0, T::one())?;
            for camera in 0..problem.cameras.len() {
                if problem.is_estimated(camera) {
                    let unknowns = problem.axes(camera).len();
                    let mut right = [T::zero(); BLOCK];
                    let right = right.get_mut(..unknowns)?;
                    parts.blocks.get(camera, unknowns)?.right_side(right);
                    worth += short_dot(right, right);
                }
            }
            Some(worth)
        });
        if matches!(self.common.told, Told::Factoring { .. }) {
            return Poll::Pending;
        }
        if worth.is_some() {
            self.common.told = Told::Factor;
        }
        Poll::Ready(worth)
    }

    /// Returns true if a pass is one slice, and covariances too: the problem is so small that a pause would only delay
    /// the answer.
    pub(super) fn is_small(&self) -> bool {
        let kept = self.layout().kept;
        2 * kept * packed(kept) <= SLICE
    }

    /// Computes and stores the steps of all unknowns from the kept ones in vector `vector`. There, steps of legs'
    /// errors are replaced by steps of places. `own` is one with the cameras' own part of the step, and zero without
    /// it.
    fn spread(&mut self, parts: &mut Parts<'_, T>, vector: usize, own: T) -> Option<()> {
        let kept = self.layout().kept;
        let x = parts.vectors.get_mut(vector * kept..(vector + 1) * kept)?;
        self.common.carrier_step = Vector2::new(*x.get(SCALE)?, *x.get(COMPASS)?);
        for stop in 0..self.stops.len() {
            if stop > 0 {
                let way = self.way(stop)?;
                let of = with_before(stop);
                let mut entries = [T::zero(); 6];
                for (entry, i) in entries.iter_mut().zip(of) {
                    *entry = *x.get(i)?;
                }
                way.find_place(&mut entries);
                for (entry, i) in entries.iter().zip(of) {
                    *x.get_mut(i)? = *entry;
                }
            }
            let i = STOPS + 2 * stop;
            self.stops.get_mut(stop)?.step = Vector2::new(*x.get(i)?, *x.get(i + 1)?);
        }
        let first = self.of_mark(0);
        for (mark, step) in self
            .marks
            .iter_mut()
            .zip(x.get(first..)?.as_chunks::<2>().0)
        {
            mark.step.fill(T::zero());
            for (to, from) in mark.step.iter_mut().zip(step) {
                *to = *from;
            }
        }
        for camera in 0..self.cameras.len() {
            let mut step = [T::zero(); BLOCK];
            if self.is_estimated(camera) {
                let axes = self.axes(camera);
                let unknowns = axes.len();
                let step = step.get_mut(axes)?;
                let triangle = parts.blocks.get(camera, unknowns)?;
                triangle.right_side(step);
                for entry in step.iter_mut() {
                    *entry *= own;
                }
                for (n, sight) in self.own(camera) {
                    let line = parts.lines.get(n)?;
                    let i = of_stop(sight.stop);
                    let moved = line.by_place.x * *x.get(i)? + line.by_place.y * *x.get(i + 1)?;
                    for (entry, q) in step.iter_mut().zip(line.q) {
                        *entry -= *q * moved;
                    }
                }
                triangle.back_substitute(step);
            }
            self.cameras.get_mut(camera)?.step = step;
        }
        Some(())
    }

    /// Finds the unknowns that move along an undetermined direction, and names the first of them.
    fn find_undetermined(&mut self, dropped: usize, parts: &mut Parts<'_, T>) -> Option<()> {
        let kept = self.layout().kept;
        self.common.undetermined = None;
        self.common.is_carrier_undetermined = false;
        for stop in self.stops.iter_mut() {
            stop.is_undetermined = false;
            stop.is_leg_undetermined = false;
        }
        for camera in 0..self.cameras.len() {
            let is_estimated = self.is_estimated(camera);
            let unknowns = self.axes(camera).len();
            let triangle = parts.blocks.get(camera, unknowns)?;
            let is_undetermined = is_estimated && triangle.has_dropped();
            if is_undetermined {
                self.common.undetermined = { self.common.undetermined }
                    .or(u16::try_from(camera).ok().map(Undetermined::Camera));
            }
            if let Some(camera) = self.cameras.get_mut(camera) {
                camera.is_undetermined = is_undetermined;
            }
        }
        if dropped == 0 {
            return Some(());
        }
        for i in 0..kept {
            if !parts.kept.is_dropped(i) {
                continue;
            }
            let numbers = parts.vectors.get_mut(2 * kept..3 * kept)?;
            parts.kept.null_direction(i, numbers);
            self.name(i);
            let of_legs = numbers.get(STOPS + 2..self.of_mark(0)).unwrap_or_default();
            let most = largest(numbers.iter().copied()) * lit(MOVES);
            for (stop, error) in self
                .stops
                .iter_mut()
                .skip(1)
                .zip(of_legs.as_chunks::<2>().0)
            {
                stop.is_leg_undetermined |= largest(error.iter().copied()) > most;
            }
            self.spread(parts, 2, T::zero())?;
            let steps = self.stops.iter().map(|stop| stop.step.amax());
            let most = largest(steps.chain(self.marks.iter().map(Unknown::moved))) * lit(MOVES);
            for stop in self.stops.iter_mut() {
                stop.is_undetermined |= stop.step.amax() > most;
            }
            for camera in self.cameras.iter_mut() {
                camera.is_undetermined |= camera.moved() > most;
            }
            let carrier = self.common.carrier_step.amax();
            self.common.is_carrier_undetermined |= carrier > most;
        }
        Some(())
    }

    /// Names an unknown that was dropped, by its index among the kept ones.
    fn name(&mut self, dropped: usize) {
        let place = dropped.saturating_sub(STOPS) / 2;
        let name = match dropped {
            SCALE => Some(Undetermined::Scale),
            COMPASS => Some(Undetermined::Compass),
            _ => match u16::try_from(place).ok() {
                Some(stop) if place < self.stops.len() => Some(Undetermined::Stop(stop)),
                _ => {
                    let mark = u16::try_from(place - self.stops.len()).ok();
                    let is_visited = |mark| self.visits.iter().any(|visit| visit.mark == mark);
                    mark.filter(|mark| is_visited(*mark))
                        .map(Undetermined::Mark)
                }
            },
        };
        self.common.undetermined = self.common.undetermined.or(name);
    }

    /// Does a slice of the computation of all covariances, which replace the factor, and of the share of each
    /// measurement that others check.
    #[inline(never)] // for less flash
    pub(super) fn find_covariances(&mut self) -> Poll<Option<()>> {
        let from = match self.common.told {
            Told::Nothing | Told::Equations | Told::Assembling(_) => {
                return match self.assemble() {
                    Poll::Ready(None) => Poll::Ready(None),
                    _ => Poll::Pending,
                };
            }
            Told::Factoring { .. } => {
                return match self.find_step() {
                    Poll::Ready(None) => Poll::Ready(None),
                    _ => Poll::Pending,
                };
            }
            Told::Factor if self.common.is_whole() => {
                return Poll::Ready(self.find_whole_covariances());
            }
            Told::Factor => 0,
            Told::Inverting(from) => from,
            Told::Covariances => return Poll::Ready(Some(())),
        };
        self.common.told = Told::Equations;
        let Some(next) = self.invert(from) else {
            return Poll::Ready(None);
        };
        self.common.told = next;
        match next {
            Told::Covariances => Poll::Ready(Some(())),
            _ => Poll::Pending,
        }
    }

    /// Does slices of [`find_covariances`](Self::find_covariances), beginning with the factor: first the rows of the
    /// inverse, then the change from legs' errors to places, stop by stop, then leverages, camera by camera.
    fn invert(&mut self, from: usize) -> Option<Told> {
        self.with_parts(|problem, mut parts| {
            let kept = problem.layout().kept;
            let Some(first) = from.checked_sub(2 * kept) else {
                return parts.kept.invert(from).map(Told::Inverting);
            };
            let (stops, mut work) = (problem.stops.len(), 0);
            for step in first..stops + problem.cameras.len() {
                if work > SLICE {
                    return Some(Told::Inverting(2 * kept + step));
                }
                if let Some(camera) = step.checked_sub(stops) {
                    if problem.is_estimated(camera) {
                        let sights = problem.own(camera).count();
                        work += OF_PAIR * sights * sights;
                        problem.find_leverages(camera, &mut parts)?;
                    }
                } else if step > 0 {
                    work += OF_ENTRIES * kept;
                    let of = with_before(step);
                    let [.., first, second] = of;
                    let own = [(first, first), (first, second), (second, second)];
                    problem.stops.get_mut(step)?.leverage = own.map(|(i, j)| parts.kept.at(i, j));
                    let way = problem.way(step)?;
                    parts
                        .kept
                        .change(second, |entries| way.find_place(entries))?;
                }
            }
            Some(Told::Covariances)
        })
    }
}

impl<T: Real> Unknown<T> {
    fn moved(&self) -> T {
        self.step
            .iter()
            .fold(T::zero(), |most, step| most.max(step.abs()))
    }
}

/// Indices of the unknowns of the carrier, of the stop before and of a stop.
fn with_before(later: usize) -> [usize; 6] {
    let i = STOPS + 2 * later;
    [
        SCALE,
        COMPASS,
        i.saturating_sub(2),
        i.saturating_sub(1),
        i,
        i + 1,
    ]
}

/// Copies numbers to the front of others. [`copy_from_slice`](slice::copy_from_slice) would need a proof that there are
/// as many.
pub(super) fn put<T: Copy>(to: &mut [T], from: &[T]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
}

/// Returns `a . b` of short vectors.
#[inline(always)]
pub(super) fn short_dot<T: Real>(a: &[T], b: &[T]) -> T {
    a.iter().zip(b).fold(T::zero(), |sum, (a, b)| sum + *a * *b)
}

/// Derivatives of a leg's error in each direction by the unknowns of the carrier, of the stop before and of the stop.
pub(super) fn by_kept<T: Real>(row: &LegRow<T>) -> [T; 6] {
    let (by_place, by_carrier) = (row.by_place, row.by_carrier);
    [
        by_carrier.x,
        by_carrier.y,
        -by_place.x,
        -by_place.y,
        by_place.x,
        by_place.y,
    ]
}
