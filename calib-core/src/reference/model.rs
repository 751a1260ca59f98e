//! The least-squares problem behind the reference solve.
//!
//! Unknowns `x = (heading 0, heading 1, first x, first y, frame heading, baseline)`, always six; a known one
//! keeps its value because its derivatives are left out.

use nalgebra::{Matrix2, Matrix6, Point2, Vector2, Vector6};

use super::{Known, ReferenceSolution, Stop, displacements_from_first, turned};
use crate::{
    Ray, Real,
    numerics::{
        minimize::{Problem, Quadratic},
        plane::{cross, dot, mul, quarter_turn, unit},
        real::{at_least_zero, lit},
    },
};

pub(super) struct Bearings<'a, T: Real> {
    pub stops: &'a [Stop<T>],
    pub known: &'a Known<T>,
    /// One for an unknown that is solved for, zero for a known one.
    free: Vector6<T>,
}

/// Both cameras' view of one stop, whitened: residuals of unit variance, independent.
struct Pair<T: Real> {
    residuals: [T; 2],
    slopes: [Vector6<T>; 2],
}

/// The variances of a stop's two residuals, as the factor `L` of `L L^T`.
struct Whitening<T> {
    l00: T,
    l10: T,
    l11: T,
}

/// One stop as an answer predicts it.
struct Sight<'a, T: Real> {
    stop: &'a Stop<T>,
    views: [View<T>; 2],
    /// Displacement since the first stop, in the reference frame, and its covariance.
    moved: Vector2<T>,
    spread: Matrix2<T>,
}

/// One camera's view of one stop.
struct View<T: Real> {
    /// Bearing of the place minus that of the ray, wrapped by construction.
    residual: T,
    /// Derivative of the bearing by the target's place: across the line of sight, over the range.
    across: Vector2<T>,
}

impl<'a, T: Real> Bearings<'a, T> {
    pub(super) fn new(stops: &'a [Stop<T>], known: &'a Known<T>) -> Self {
        let one = T::one();
        let free_if = |unknown: bool| if unknown { one } else { T::zero() };
        Self {
            stops,
            known,
            free: Vector6::new(
                one,
                one,
                one,
                one,
                free_if(known.frame_heading.is_none()),
                free_if(known.baseline.is_none()),
            ),
        }
    }

    /// A stop, and its displacement from the first one in the displacements' own frame.
    pub(super) fn stop(&self, n: usize) -> Option<(&Stop<T>, Vector2<T>)> {
        let (sum, _) = displacements_from_first(self.stops).nth(n)?;
        Some((self.stops.get(n)?, sum))
    }

    pub(super) fn degrees_of_freedom(&self) -> usize {
        let unknowns = 4
            + usize::from(self.known.frame_heading.is_none())
            + usize::from(self.known.baseline.is_none());
        (2 * self.stops.len()).saturating_sub(unknowns)
    }

    /// Clears the rows and columns of the known ones.
    pub(super) fn keep_free(&self, covariance: &mut Matrix6<T>) {
        let columns = covariance.as_mut_slice().as_chunks_mut::<6>().0.iter_mut();
        for (column, is_free) in columns.zip(self.free.iter()) {
            for (entry, other) in column.iter_mut().zip(self.free.iter()) {
                *entry *= *is_free * *other;
            }
        }
    }

    /// Returns true if every ray of both cameras points towards its stop, not away from it.
    pub(super) fn all_in_front(&self, x: &Vector6<T>) -> bool {
        self.sights(x).all(|sight| {
            sight
                .views
                .iter()
                .all(|view| view.residual.abs() < T::frac_pi_2())
        })
    }

    /// The cost at `x`, with the weights there. `None` if it is above a limit.
    pub(super) fn chi_squared(&self, x: &Vector6<T>, limit: Option<T>) -> Option<T> {
        self.sights(x).try_fold(T::zero(), |sum, sight| {
            let sum = sum + sight.cost(&sight.whitening());
            limit.is_none_or(|limit| sum <= limit).then_some(sum)
        })
    }

    fn sights(&self, x: &Vector6<T>) -> impl Iterator<Item = Sight<'_, T>> {
        let [axis0, axis1] = [unit(x.x), unit(x.y)];
        let first = Vector2::new(x.z, x.w);
        let turn = unit(x.a);
        let camera1 = Vector2::new(x.b, T::zero());
        self.stops
            .iter()
            .zip(displacements_from_first(self.stops))
            .map(move |(stop, (sum, spread))| {
                let moved = mul(turn, sum);
                let place = first + moved;
                let [ray0, ray1] = stop.rays;
                Sight {
                    stop,
                    views: [view(axis0, ray0, place), view(axis1, ray1, place - camera1)],
                    moved,
                    spread: turned(&spread, turn),
                }
            })
    }

    fn pairs(&self, x: &Vector6<T>) -> impl Iterator<Item = Pair<T>> {
        self.sights(x).map(|sight| {
            let whitening = sight.whitening();
            let one = T::one();
            let zero = T::zero();
            let by_frame = quarter_turn(sight.moved);
            let [v0, v1] = sight.views;
            let slope = |v: &View<T>, heading0, heading1, by_baseline| {
                Vector6::new(
                    heading0,
                    heading1,
                    v.across.x,
                    v.across.y,
                    dot(v.across, by_frame),
                    by_baseline,
                )
                .component_mul(&self.free)
            };
            let slope0 = slope(&v0, -one, zero, zero);
            let slope1 = slope(&v1, zero, -one, -v1.across.x);
            let residual0 = v0.residual / whitening.l00;
            let slope0 = slope0 / whitening.l00;
            Pair {
                residuals: [
                    residual0,
                    (v1.residual - residual0 * whitening.l10) / whitening.l11,
                ],
                slopes: [slope0, (slope1 - slope0 * whitening.l10) / whitening.l11],
            }
        })
    }
}

fn view<T: Real>(axis: Vector2<T>, ray: Ray<T>, to_target: Vector2<T>) -> View<T> {
    let ray = mul(axis, ray.vector());
    View {
        residual: cross(ray, to_target).atan2(dot(ray, to_target)),
        across: quarter_turn(to_target) / dot(to_target, to_target),
    }
}

impl<T: Real> Sight<'_, T> {
    /// The displacement's error moves both residuals of a stop: they are correlated.
    fn whitening(&self) -> Whitening<T> {
        let [v0, v1] = &self.views;
        let [s0, s1] = self.stop.bearing_sigmas;
        // Arithmetic has a noise of its own: it bounds the weight of a claim to be exact.
        let arithmetic = lit::<T>(256.0) * T::default_epsilon() * T::default_epsilon();
        let spread0 = self.spread * v0.across;
        let variance0 = s0 * s0 + arithmetic + at_least_zero(dot(v0.across, spread0));
        let l00 = variance0.sqrt();
        let l10 = dot(v1.across, spread0) / l00;
        let variance1 = s1 * s1 + arithmetic + dot(v1.across, self.spread * v1.across);
        // Never less than the camera's own variance, whatever rounding does.
        let l11 = (variance1 - l10 * l10).max(s1 * s1).sqrt();
        Whitening { l00, l10, l11 }
    }

    fn cost(&self, by: &Whitening<T>) -> T {
        let [v0, v1] = &self.views;
        let r0 = v0.residual / by.l00;
        let r1 = (v1.residual - r0 * by.l10) / by.l11;
        r0 * r0 + r1 * r1
    }
}

/// The unknowns by name.
fn unknowns<T: Real>(x: &[T]) -> Vector6<T> {
    match *x {
        [heading0, heading1, x, y, frame, baseline] => {
            Vector6::new(heading0, heading1, x, y, frame, baseline)
        }
        _ => {
            debug_assert!(false, "the unknowns of another problem");
            Vector6::zeros()
        }
    }
}

impl<T: Real> Problem<T> for Bearings<'_, T> {
    fn model(&self, x: &[T], model: &mut Quadratic<'_, T>) {
        for pair in self.pairs(&unknowns(x)) {
            for (residual, slope) in pair.residuals.into_iter().zip(&pair.slopes) {
                model.add(residual, slope.as_slice(), T::one());
            }
        }
        // A known one has no derivative; a unit diagonal keeps the matrix invertible.
        for (entry, free) in model.diagonal_mut().zip(self.free.iter()) {
            *entry += T::one() - *free;
        }
    }

    fn cost(&self, x: &[T], weights_at: &[T]) -> T {
        self.sights(&unknowns(x))
            .zip(self.sights(&unknowns(weights_at)))
            .fold(T::zero(), |sum, (sight, at)| {
                sum + sight.cost(&at.whitening())
            })
    }
}

/// A stop's place and covariance from a solution: the first stop and the frame heading carry their
/// covariance over, the displacement adds its own.
pub(super) fn place<T: Real>(
    solution: &ReferenceSolution<T>,
    turn: Vector2<T>,
    sum: Vector2<T>,
    spread: Matrix2<T>,
) -> (Point2<T>, Matrix2<T>) {
    let moved = mul(turn, sum);
    let by_frame = quarter_turn(moved);
    let c = &solution.covariance;
    let first = Matrix2::new(c.m33, c.m34, c.m43, c.m44);
    let with_frame = Vector2::new(c.m35, c.m45);
    let covariance = first
        + with_frame * by_frame.transpose()
        + by_frame * with_frame.transpose()
        + by_frame * by_frame.transpose() * c.m55
        + turned(&spread, turn);
    (solution.first_stop + moved, covariance)
}
