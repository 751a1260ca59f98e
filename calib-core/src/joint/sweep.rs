//! One pass: the measurements around the present estimates, stop by stop along the walk, into a
//! triangle that holds one or two places and everything that is kept.
//!
//! Only legs tie stops together, so a place can be eliminated as soon as its bearings and the leg
//! to the next one are in: its two equations are dropped, and the triangle does not grow with the
//! walk. Eliminated from both ends towards one stop, that stop's place stays, with its covariance
//! and its correlation with all that is kept.

use nalgebra::Vector2;

use super::problem::{
    COMPASS, HEADINGS, HELD, KEPT, LEAVING, LegRow, NEXT, Problem, REFERENCES, SCALE, Standing,
    Visit,
};
use super::triangle::{Triangle, packed};
use crate::Real;

/// What a pass found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pass<T> {
    /// Chi squared at the present estimates.
    pub cost: T,
    /// By how much the step to the minimum lowers it, as far as the model is linear.
    pub worth: T,
}

/// What a sweep leaves out beside what is excluded anyway.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Without {
    Nothing,
    /// All that a camera saw from a stop on.
    Tail {
        camera: u16,
        from: u16,
    },
}

impl<T: Real> Problem<'_, T> {
    /// Brings all measurements into the triangle, of the places that of stop `held` and, if there is
    /// one, that of the stop after it.
    #[inline(never)] // for less flash
    pub(super) fn sweep(&mut self, held: usize, without: Without) -> Option<Pass<T>> {
        self.lay_out();
        let width = self.width();
        // Taken out, so that rows can be made while the triangle is written.
        let numbers = core::mem::take(&mut self.workspace);
        let swept = numbers
            .split_at_mut_checked(packed(width))
            .and_then(|(triangle, rest)| {
                let triangle = Triangle::new(triangle, width)?;
                let row = rest.get_mut(..width)?;
                row.fill(T::zero());
                let mut sweep = Sweep {
                    problem: self,
                    triangle,
                    row,
                    without,
                    left: T::zero(),
                    eliminated: T::zero(),
                };
                sweep.run(held);
                let worth = sweep.eliminated + sweep.triangle.worth(0..width.saturating_sub(1));
                Some(Pass {
                    cost: worth + sweep.left,
                    worth,
                })
            });
        self.workspace = numbers;
        self.common.held = (without == Without::Nothing).then_some(held);
        swept
    }
}

struct Sweep<'s, 'p, T: Real> {
    problem: &'s Problem<'p, T>,
    triangle: Triangle<'s, T>,
    row: &'s mut [T],
    without: Without,
    /// Sum of the squares that no unknown explains.
    left: T,
    /// Sum of the squared right sides of eliminated equations.
    eliminated: T,
}

impl<T: Real> Sweep<'_, '_, T> {
    fn run(&mut self, held: usize) {
        self.triangle.clear();
        self.priors();
        let next = |stop| if stop == held { HELD } else { NEXT };
        for stop in 0..held {
            self.sights(stop, LEAVING);
            self.leg(stop + 1, LEAVING, next(stop + 1));
            self.eliminate();
        }
        for stop in (held + 1..self.problem.stops.len()).rev() {
            self.sights(stop, LEAVING);
            self.leg(stop, next(stop - 1), LEAVING);
            if stop > held + 1 {
                self.eliminate();
            }
        }
        self.sights(held, HELD);
    }

    fn priors(&mut self) {
        let common = &*self.problem.common;
        let carrier = common.carrier;
        for (column, value, prior) in [
            (SCALE, carrier.x, common.scale_prior),
            (COMPASS, carrier.y, common.compass_prior),
        ] {
            let weight = prior.sigma.recip();
            self.put(column, &[weight]);
            self.insert((value - prior.mean) * weight);
        }
        let Some(sigma) = self.problem.common.lens_prior else {
            return;
        };
        let weight = sigma.recip();
        for (n, camera) in self.problem.cameras.iter().enumerate() {
            if let Some(column) = self.problem.columns(n).and_then(|columns| columns.lens) {
                self.put(column, &[weight]);
                self.insert(camera.value.w * weight);
            }
        }
    }

    /// The bearings of a stop, and its visit to a mark.
    fn sights(&mut self, stop: usize, column: usize) {
        let problem = self.problem;
        for sight in &*problem.sights {
            if usize::from(sight.stop) != stop
                || sight.standing != Standing::Counts
                || self.without.leaves_out(sight.camera, sight.stop)
            {
                continue;
            }
            let Some(row) = problem.sight_row(sight) else {
                continue;
            };
            let Some(columns) = problem.columns(usize::from(sight.camera)) else {
                continue;
            };
            self.put(column, row.by_place.as_slice());
            if let Some(place) = columns.place {
                self.put(place, (-row.by_place).as_slice());
            }
            self.put(columns.heading, &[row.by_heading]);
            if let Some(lens) = columns.lens {
                self.put(lens, &[row.by_lens]);
            }
            self.insert(row.residual);
        }
        for visit in problem.visits {
            if usize::from(visit.stop) == stop {
                self.visit(visit, column);
            }
        }
    }

    fn visit(&mut self, visit: &Visit<T>, column: usize) {
        let Some((off, weight, mark)) = self.problem.visit_rows(visit) else {
            return;
        };
        for (axis, off) in off.iter().enumerate() {
            self.put(column + axis, &[weight]);
            self.put(mark + axis, &[-weight]);
            self.insert(*off);
        }
    }

    /// The leg to stop `later`, with the columns of both its ends.
    fn leg(&mut self, later: usize, from: usize, to: usize) {
        for row in self.problem.leg_rows(later).iter().flatten() {
            let LegRow {
                residual,
                by_place,
                by_carrier,
            } = row;
            self.put(from, (-by_place).as_slice());
            self.put(to, by_place.as_slice());
            self.put(SCALE, by_carrier.as_slice());
            self.insert(*residual);
        }
    }

    /// Numbers into the row at hand.
    fn put(&mut self, column: usize, numbers: &[T]) {
        let places = self.row.iter_mut().skip(column);
        for (place, number) in places.zip(numbers) {
            *place = *number;
        }
    }

    /// The row at hand, of a residual that is to vanish.
    fn insert(&mut self, residual: T) {
        if let Some(right) = self.row.last_mut() {
            *right = -residual;
        }
        let left = self.triangle.insert(self.row);
        self.left += left * left;
        self.row.fill(T::zero());
    }

    /// Drops the equations of the place that leaves. The next one takes its columns.
    fn eliminate(&mut self) {
        self.eliminated += self.triangle.worth(LEAVING..NEXT);
        for axis in 0..2 {
            let Some((leaving, next)) = self.triangle.two_rows_mut(LEAVING + axis, NEXT + axis)
            else {
                return;
            };
            // From the diagonal on: the rest of its own two columns, two that become free, and what
            // both have in common.
            leaving.fill(T::zero());
            let Some((own, others)) = next.split_at_mut_checked(2 - axis) else {
                return;
            };
            for (to, from) in leaving.iter_mut().zip(&*own) {
                *to = *from;
            }
            for (to, from) in leaving.iter_mut().skip(4 - axis).zip(&*others) {
                *to = *from;
            }
            next.fill(T::zero());
        }
    }
}

impl Without {
    pub(super) fn leaves_out(self, camera: u16, stop: u16) -> bool {
        match self {
            Self::Nothing => false,
            Self::Tail {
                camera: moved,
                from,
            } => camera == moved && stop >= from,
        }
    }
}

/// Columns and right side of the triangles of the second sweep: one place, and two.
const ONE: usize = 3;
const TWO: usize = 5;

impl<T: Real> Problem<'_, T> {
    /// From the triangle of a sweep that held the last stop: the steps of everything that is kept,
    /// then, by a second sweep with these known, those of all stops. Steps are kept, not taken.
    #[inline(never)] // for less flash
    pub(super) fn find_step(&mut self) -> Option<()> {
        let (triangle, [x, ..]) = self.triangle()?;
        triangle.solve(x);
        // By position from here on: the vector is the workspace's.
        let offset = packed(self.width());
        let at = |numbers: &[T], column: usize| {
            let number = numbers.get(offset + column).copied();
            number.unwrap_or_else(T::zero)
        };
        let numbers = &*self.workspace;
        let last = Vector2::new(at(numbers, HELD), at(numbers, HELD + 1));
        self.common.carrier_step = Vector2::new(at(numbers, SCALE), at(numbers, COMPASS));
        let has_lens = self.common.lens_prior.is_some();
        for (n, camera) in self.cameras.iter_mut().enumerate() {
            camera.step.fill(T::zero());
            if n < REFERENCES {
                camera.step.z = at(numbers, HEADINGS + n);
                if has_lens {
                    camera.step.w = at(numbers, KEPT + n);
                }
            } else if let Some(column) = camera.column.map(usize::from) {
                let axes = if has_lens { 4 } else { 3 };
                for (axis, step) in camera.step.iter_mut().enumerate().take(axes) {
                    *step = at(numbers, column + axis);
                }
            }
        }
        for mark in self.marks.iter_mut() {
            mark.step.fill(T::zero());
            if let Some(column) = mark.column.map(usize::from) {
                for (axis, step) in mark.step.iter_mut().enumerate().take(2) {
                    *step = at(numbers, column + axis);
                }
            }
        }
        self.step_stops(last)
    }

    /// Forward: the two equations that each place gets from its own bearings and the stops before
    /// it. Backward: with the leg to the next place, of which the step is known by then.
    fn step_stops(&mut self, last: Vector2<T>) -> Option<()> {
        let mut chain = [T::zero(); packed(ONE) - 1];
        for stop in 0..self.stops.len() {
            self.sights_alone(stop, &mut chain);
            self.stops.get_mut(stop)?.chain = chain;
            if stop + 1 < self.stops.len() {
                chain = self.predicted(stop + 1, &chain);
            }
        }
        let mut after = last;
        for stop in (0..self.stops.len()).rev() {
            if stop + 1 < self.stops.len() {
                let mut chain = self.stops.get(stop)?.chain;
                let rows = self.leg_rows(stop + 1);
                for row in rows.iter().flatten() {
                    let known = row.by_place.dot(&after)
                        + row.by_carrier.dot(&self.common.carrier_step)
                        + row.residual;
                    add(&mut chain, &[-row.by_place.x, -row.by_place.y, -known]);
                }
                after = solved(&chain);
            }
            let [x, y, ..] = &mut self.stops.get_mut(stop)?.chain;
            (*x, *y) = (after.x, after.y);
        }
        Some(())
    }

    fn sights_alone(&self, stop: usize, chain: &mut [T; 5]) {
        for sight in &*self.sights {
            if usize::from(sight.stop) != stop || sight.standing != Standing::Counts {
                continue;
            }
            let (Some(row), Some(camera)) = (
                self.sight_row(sight),
                self.cameras.get(usize::from(sight.camera)),
            ) else {
                continue;
            };
            let step = camera.step;
            let known = row.residual - row.by_place.dot(&step.xy())
                + row.by_heading * step.z
                + row.by_lens * step.w;
            add(chain, &[row.by_place.x, row.by_place.y, -known]);
        }
        for visit in self.visits {
            let (Some((off, weight, _)), Some(mark)) = (
                self.visit_rows(visit),
                self.marks.get(usize::from(visit.mark)),
            ) else {
                continue;
            };
            if usize::from(visit.stop) == stop {
                let known = off - mark.step.xy() * weight;
                add(chain, &[weight, T::zero(), -known.x]);
                add(chain, &[T::zero(), weight, -known.y]);
            }
        }
    }

    /// The equations that a place leaves for the next one.
    fn predicted(&self, later: usize, chain: &[T; 5]) -> [T; 5] {
        let zero = T::zero();
        let [r11, r12, z1, r22, z2] = *chain;
        let mut numbers = [
            r11, r12, zero, zero, z1, r22, zero, zero, z2, zero, zero, zero, zero, zero, zero,
        ];
        if let Some(mut both) = Triangle::new(&mut numbers, TWO) {
            for row in self.leg_rows(later).iter().flatten() {
                let known = row.residual + row.by_carrier.dot(&self.common.carrier_step);
                let by = row.by_place;
                both.insert(&mut [-by.x, -by.y, by.x, by.y, -known]);
            }
        }
        let [.., r11, r12, z1, r22, z2, _] = numbers;
        [r11, r12, z1, r22, z2]
    }
}

/// One more equation for a place.
fn add<T: Real>(chain: &mut [T; 5], row: &[T; 3]) {
    let mut numbers = [T::zero(); packed(ONE)];
    for (to, from) in numbers.iter_mut().zip(&*chain) {
        *to = *from;
    }
    let mut row = *row;
    if let Some(mut triangle) = Triangle::new(&mut numbers, ONE) {
        triangle.insert(&mut row);
    }
    for (to, from) in chain.iter_mut().zip(&numbers) {
        *to = *from;
    }
}

fn solved<T: Real>(chain: &[T; 5]) -> Vector2<T> {
    let [r11, r12, z1, r22, z2] = *chain;
    let y = if r22 == T::zero() { r22 } else { z2 / r22 };
    let x = if r11 == T::zero() {
        r11
    } else {
        (z1 - r12 * y) / r11
    };
    Vector2::new(x, y)
}
