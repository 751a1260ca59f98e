//! Least squares over a few unknowns: Gauss-Newton, steepest descent, Levenberg-Marquardt.
//!
//! Like [`cholesky`], on the numbers of vectors and matrices of any size.

use nalgebra::{ComplexField, SMatrix, SVector};

use crate::{
    Real, Refusal,
    numerics::{
        cholesky::{self, Cholesky},
        matrix::{add_outer, dot},
        real::{at_least_zero, lit},
    },
};

/// Unknowns of the largest problem.
const MOST: usize = 6;

/// Way of a least-squares solve from its closed-form start to the minimum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Method {
    /// Equation (5) of the thesis: full steps `-(J^T J)^-1 J^T r`.
    GaussNewton,
    /// Equation (6): steps against the gradient. The thesis leaves the step size open; here
    /// unknowns are scaled to equal curvature (so that metres and radians may be mixed), the
    /// first trial is the exact minimum of the quadratic model along that direction (Cauchy's
    /// step), and it is halved until the cost falls by at least a tenth of what the model promised
    /// (Armijo's rule).
    SteepestDescent,
    /// Gauss-Newton with Marquardt's damping, which is off while full steps succeed: as fast, and
    /// never uphill. Marquardt, J. SIAM 11(2), 1963.
    #[default]
    Levenberg,
}

/// The cost around a point, to second order: `cost + 2 gradient . d + d . hessian d`.
pub(crate) struct Quadratic<'a, T> {
    /// `J^T W J`, by columns.
    pub hessian: &'a mut [T],
    /// `J^T W r`
    pub gradient: &'a mut [T],
    /// `r^T W r`
    pub cost: T,
    /// The last unknown is one that [`Problem::settled`] moves.
    pub last_settles: bool,
}

impl<T: Real> Quadratic<'_, T> {
    fn clear(&mut self) {
        self.hessian.fill(T::zero());
        self.gradient.fill(T::zero());
        self.cost = T::zero();
    }

    /// Adds one residual with its derivatives and its weight.
    #[inline]
    pub(crate) fn add(&mut self, residual: T, slope: &[T], weight: T) {
        add_outer(self.hessian, slope, weight);
        let factor = weight * residual;
        for (sum, slope) in self.gradient.iter_mut().zip(slope) {
            *sum += *slope * factor;
        }
        self.cost += residual * residual * weight;
    }

    pub(crate) fn diagonal_mut(&mut self) -> impl Iterator<Item = &mut T> {
        let next = next_diagonal(self.gradient.len());
        self.hessian.iter_mut().step_by(next)
    }

    fn diagonal(&self) -> impl Iterator<Item = &T> {
        let next = next_diagonal(self.gradient.len());
        self.hessian.iter().step_by(next)
    }

    pub(crate) fn trace(&self) -> T {
        self.diagonal().fold(T::zero(), |sum, h| sum + *h)
    }

    /// The step to the minimum of the model with its diagonal stretched by `1 + damping`. As many
    /// of its numbers count as there are unknowns.
    ///
    /// Of a model whose last unknown settles, what is left of the diagonal when that unknown follows
    /// the others is stretched: far less, where the valley is narrow.
    #[inline(never)] // for less stack
    pub(crate) fn step(&self, damping: T) -> Option<[T; MOST]> {
        let n = self.gradient.len();
        let mut factor = [T::zero(); MOST * MOST];
        let factor = factor.get_mut(..self.hessian.len())?;
        for (entry, h) in factor.iter_mut().zip(self.hessian.iter()) {
            *entry = *h;
        }
        let last = self.hessian.rchunks_exact(n.max(1)).next()?;
        let last_entry = *last.last()?;
        for (entry, with_last) in factor.iter_mut().step_by(next_diagonal(n)).zip(last) {
            let follows = if self.last_settles {
                *with_last * *with_last / last_entry
            } else {
                T::zero()
            };
            *entry += at_least_zero(*entry - follows) * damping;
        }
        cholesky::factor(factor, n)?;
        let mut step = [T::zero(); MOST];
        let unknowns = step.get_mut(..n)?;
        for (entry, g) in unknowns.iter_mut().zip(self.gradient.iter()) {
            *entry = -*g;
        }
        cholesky::solve(factor, unknowns);
        unknowns.iter().all(ComplexField::is_finite).then_some(step)
    }
}

/// Distance from one number of the diagonal to the next.
#[inline(always)]
fn next_diagonal(n: usize) -> usize {
    // Never zero, so that no caller needs to ask.
    n.saturating_add(1)
}

/// A weighted sum of squares of some unknowns, whose weights may depend on the unknowns.
pub(crate) trait Problem<T> {
    /// Adds up the model at `x`, with the weights at `x`.
    fn model(&self, x: &[T], model: &mut Quadratic<'_, T>);

    /// The cost at `x` with the weights at `weights_at`. Weights are compared only with
    /// themselves: otherwise a solve would run to where it may be most uncertain.
    fn cost(&self, x: &[T], weights_at: &[T]) -> T;

    /// The last unknown has one best value wherever the others are. A walk then follows a curved valley
    /// along which it changes with the others.
    fn last_settles(&self) -> bool {
        false
    }

    /// The cost, after the last unknown moved to its best value if it [settles](Self::last_settles).
    fn settled(&self, x: &mut [T], weights_at: &[T]) -> T {
        self.cost(x, weights_at)
    }
}

/// A walk downhill over `P` unknowns, at most six: where it is, and the cost around there.
// Walked in place: its frame is one of the largest.
pub(crate) struct Descent<T: Real, const P: usize> {
    pub x: SVector<T, P>,
    /// Model of the place where it last looked around, as the two below: at the end within the last, tiny
    /// step of `x`.
    pub hessian: SMatrix<T, P, P>,
    gradient: SVector<T, P>,
    pub cost: T,
}

impl<T: Real, const P: usize> Descent<T, P> {
    pub(crate) fn new(start: SVector<T, P>) -> Self {
        Self {
            x: start,
            hessian: SMatrix::zeros(),
            gradient: SVector::zeros(),
            cost: T::zero(),
        }
    }

    /// Walks to the minimum and tells in how many steps.
    ///
    /// # Errors
    /// [`Refusal::DidNotConverge`] after `limit` steps, or when the cost is not a finite number.
    #[inline]
    pub(crate) fn run(
        &mut self,
        problem: &impl Problem<T>,
        method: Method,
        limit: usize,
    ) -> Result<usize, Refusal> {
        let mut model = Quadratic {
            hessian: self.hessian.as_mut_slice(),
            gradient: self.gradient.as_mut_slice(),
            cost: T::zero(),
            last_settles: problem.last_settles(),
        };
        let iterations = walk(problem, self.x.as_mut_slice(), &mut model, method, limit);
        self.cost = model.cost;
        iterations
    }

    /// The model where it starts.
    #[inline]
    pub(crate) fn look(&mut self, problem: &impl Problem<T>) -> Quadratic<'_, T> {
        let mut model = Quadratic {
            hessian: self.hessian.as_mut_slice(),
            gradient: self.gradient.as_mut_slice(),
            cost: T::zero(),
            last_settles: problem.last_settles(),
        };
        problem.model(self.x.as_slice(), &mut model);
        model
    }

    /// The covariance of the unknowns where the weights are one over variances.
    #[inline(never)] // for less stack
    pub(crate) fn covariance(&self) -> Option<SMatrix<T, P, P>> {
        Some(Cholesky::new(self.hessian)?.inverse())
    }
}

/// Steps shorter than this many sigmas end the iteration.
const CONVERGED_SIGMAS: f64 = 1e-3;
/// Where rounding lets no step lower the cost any more, being this close counts as being there.
pub(crate) const STALLED_SIGMAS: f64 = 0.1;
/// The cost falling by less than this, so many times in a row, ends it too: where two solutions are
/// about to merge, the minimum has no curvature, and steps in sigmas mean nothing.
const FLAT: f64 = 1e-4;
const FLAT_STEPS: usize = 3;
/// Damping beyond which a step is lost in rounding.
const DAMPING_LIMIT: f64 = 1e9;

fn walk<T: Real>(
    problem: &impl Problem<T>,
    x: &mut [T],
    model: &mut Quadratic<'_, T>,
    method: Method,
    limit: usize,
) -> Result<usize, Refusal> {
    let mut pace = Pace::new();
    for iterations in 1..=limit {
        model.clear();
        problem.model(x, model);
        let Some(newton) = pace.look(x, model, method)? else {
            return Ok(iterations);
        };
        let next = match method {
            Method::GaussNewton => newton.step.map(|step| moved(x, &step, T::one())),
            Method::SteepestDescent => downhill(problem, x, model),
            Method::Levenberg => damped(problem, x, model, &mut pace.damping),
        };
        match next {
            Some(next) => x.iter_mut().zip(next).for_each(|(x, next)| *x = next),
            None if newton.is_within(lit(STALLED_SIGMAS)) => return Ok(iterations),
            None => return Err(Refusal::DidNotConverge),
        }
    }
    Err(Refusal::DidNotConverge)
}

/// Memory of a walk from step to step. It knows no problem, so that a node has its code once.
struct Pace<T> {
    damping: T,
    /// The cost before the last step.
    previous: Option<T>,
    flat_steps: usize,
}

/// The full step, which may not exist, and its worth.
struct Newton<T> {
    step: Option<[T; MOST]>,
    /// By how much the cost would fall, in squared sigmas.
    worth: Option<T>,
}

impl<T: Real> Newton<T> {
    #[inline(never)] // for less stack
    fn new(model: &Quadratic<'_, T>) -> Self {
        let step = model.step(T::zero());
        let worth = step.map(|step| -dot(&step, model.gradient));
        Self { step, worth }
    }

    fn is_within(&self, sigmas: T) -> bool {
        self.worth.is_some_and(|worth| worth <= sigmas * sigmas)
    }
}

impl<T: Real> Pace<T> {
    fn new() -> Self {
        Self {
            damping: T::zero(),
            previous: None,
            flat_steps: 0,
        }
    }

    /// The full step from `x`, about which the model is. None at the minimum, to which `x` has
    /// gone if that was a tiny step away.
    ///
    /// # Errors
    /// [`Refusal::DidNotConverge`] when the cost is not a finite number.
    #[inline(never)] // for less flash
    fn look(
        &mut self,
        x: &mut [T],
        model: &Quadratic<'_, T>,
        method: Method,
    ) -> Result<Option<Newton<T>>, Refusal> {
        if !model.cost.is_finite() {
            return Err(Refusal::DidNotConverge);
        }
        let fell = self.previous.map(|cost| cost - model.cost);
        self.flat_steps = match fell {
            // Steepest descent creeps; that its cost hardly falls says nothing.
            Some(fell) if fell.abs() < lit(FLAT) && method != Method::SteepestDescent => {
                self.flat_steps + 1
            }
            _ => 0,
        };
        if self.flat_steps == FLAT_STEPS {
            return Ok(None);
        }
        self.previous = Some(model.cost);
        let newton = Newton::new(model);
        if let (Some(step), true) = (&newton.step, newton.is_within(lit(CONVERGED_SIGMAS))) {
            go(x, step, T::one());
            return Ok(None);
        }
        Ok(Some(newton))
    }
}

/// Moves `x` along a direction, so many times its length.
fn go<T: Real>(x: &mut [T], direction: &[T], length: T) {
    for (x, direction) in x.iter_mut().zip(direction) {
        *x += *direction * length;
    }
}

/// The place that this leads to.
fn moved<T: Real>(x: &[T], direction: &[T; MOST], length: T) -> [T; MOST] {
    let mut next = [T::zero(); MOST];
    for (next, x) in next.iter_mut().zip(x) {
        *next = *x;
    }
    go(&mut next, direction, length);
    next
}

/// The cost of one of the places that [`moved`] leads to, which settles there.
fn cost_at<T: Real>(problem: &impl Problem<T>, next: &mut [T; MOST], x: &[T]) -> Option<T> {
    Some(problem.settled(next.get_mut(..x.len())?, x))
}

/// The least damping from `damping` on with which the cost falls.
fn damped<T: Real>(
    problem: &impl Problem<T>,
    x: &[T],
    model: &Quadratic<'_, T>,
    damping: &mut T,
) -> Option<[T; MOST]> {
    let (first, ten) = (lit::<T>(1e-3), lit::<T>(10.0));
    while *damping < lit(DAMPING_LIMIT) {
        if let Some(mut next) = trial(x, model, *damping)
            && cost_at(problem, &mut next, x)? < model.cost
        {
            *damping = if *damping > first {
                *damping / ten
            } else {
                T::zero()
            };
            return Some(next);
        }
        *damping = (*damping * ten).max(first);
    }
    None
}

/// The place that the step with this damping leads to.
#[inline(never)] // for less flash
fn trial<T: Real>(x: &[T], model: &Quadratic<'_, T>, damping: T) -> Option<[T; MOST]> {
    Some(moved(x, &model.step(damping)?, T::one()))
}

/// One step against the gradient, by the rule documented at [`Method::SteepestDescent`].
fn downhill<T: Real>(
    problem: &impl Problem<T>,
    x: &[T],
    model: &Quadratic<'_, T>,
) -> Option<[T; MOST]> {
    let mut direction = [T::zero(); MOST];
    let scaled = model.gradient.iter().zip(model.diagonal());
    for (entry, (g, h)) in direction.iter_mut().zip(scaled) {
        *entry = -*g / *h;
    }
    let slope = dot(&direction, model.gradient);
    let columns = model.hessian.chunks_exact(x.len().max(1));
    let curvature = direction
        .iter()
        .zip(columns)
        .fold(T::zero(), |sum, (part, column)| {
            sum + *part * dot(&direction, column)
        });
    let mut length = -slope / curvature;
    for _ in 0..32 {
        let mut next = moved(x, &direction, length);
        // Twice the slope is the cost's derivative; a tenth of the promise is enough.
        if cost_at(problem, &mut next, x)? <= model.cost + slope * length * lit(0.1) {
            return Some(next);
        }
        length *= lit(0.5);
    }
    None
}

#[cfg(test)]
mod tests;
