//! Least squares over a few unknowns: Gauss-Newton, steepest descent, Levenberg-Marquardt.

use nalgebra::{ComplexField, SMatrix, SVector};

use crate::{Real, Refusal, cholesky::Cholesky, real::lit};

/// How a least-squares solve walks from its closed-form start to the minimum.
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
pub(crate) struct Quadratic<T: Real, const P: usize> {
    /// `J^T W J`
    pub hessian: SMatrix<T, P, P>,
    /// `J^T W r`
    pub gradient: SVector<T, P>,
    /// `r^T W r`
    pub cost: T,
}

impl<T: Real, const P: usize> Quadratic<T, P> {
    pub(crate) fn zero() -> Self {
        Self {
            hessian: SMatrix::zeros(),
            gradient: SVector::zeros(),
            cost: T::zero(),
        }
    }

    /// Adds one residual with its derivatives and its weight.
    #[inline]
    pub(crate) fn add(&mut self, residual: T, slope: &SVector<T, P>, weight: T) {
        add_outer(&mut self.hessian, slope, weight);
        self.gradient += slope * (weight * residual);
        self.cost += residual * residual * weight;
    }

    /// The covariance of the unknowns where the weights are one over variances.
    // Not inlined, for the sake of the stack.
    #[inline(never)]
    pub(crate) fn covariance(&self) -> Option<SMatrix<T, P, P>> {
        Some(Cholesky::new(self.hessian)?.inverse())
    }

    /// The step to the minimum of the model with its diagonal stretched by `1 + damping`.
    // Not inlined, for the sake of the stack.
    #[inline(never)]
    pub(crate) fn step(&self, damping: T) -> Option<SVector<T, P>> {
        let mut hessian = self.hessian;
        hessian.set_partial_diagonal(self.hessian.diagonal().iter().map(|h| *h + *h * damping));
        let step = -Cholesky::new(hessian)?.solve(&self.gradient);
        step.iter().all(ComplexField::is_finite).then_some(step)
    }
}

/// Adds `weight v v^T`: in place, for the sake of the stack.
#[inline]
pub(crate) fn add_outer<T: Real, const P: usize>(
    matrix: &mut SMatrix<T, P, P>,
    vector: &SVector<T, P>,
    weight: T,
) {
    let columns = matrix.as_mut_slice().chunks_exact_mut(P);
    for (column, factor) in columns.zip(vector.iter()) {
        for (entry, other) in column.iter_mut().zip(vector.iter()) {
            *entry += *other * (*factor * weight);
        }
    }
}

/// A weighted sum of squares of `P` unknowns, whose weights may depend on the unknowns.
pub(crate) trait Problem<T: Real, const P: usize> {
    /// Adds up the model at `x`, with the weights at `x`.
    fn model(&self, x: &SVector<T, P>, model: &mut Quadratic<T, P>);

    /// The cost at `x` with the weights at `weights_at`. Weights are compared only with
    /// themselves: otherwise a solve would run to where it may be most uncertain.
    fn cost(&self, x: &SVector<T, P>, weights_at: &SVector<T, P>) -> T;
}

/// A walk downhill: where it is, and the cost around there.
// Walked in place, for the sake of the stack.
pub(crate) struct Descent<T: Real, const P: usize> {
    pub x: SVector<T, P>,
    /// Of where it last looked around: at the end within the last, tiny step of `x`.
    pub model: Quadratic<T, P>,
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

impl<T: Real, const P: usize> Descent<T, P> {
    pub(crate) fn new(start: SVector<T, P>) -> Self {
        Self {
            x: start,
            model: Quadratic::zero(),
        }
    }

    /// Walks to the minimum and tells in how many steps.
    ///
    /// # Errors
    /// [`Refusal::DidNotConverge`] after `limit` steps, or when the cost is not a finite number.
    // Not inlined: large, and its callers have large frames of their own.
    #[inline(never)]
    pub(crate) fn run(
        &mut self,
        problem: &impl Problem<T, P>,
        method: Method,
        limit: usize,
    ) -> Result<usize, Refusal> {
        let mut damping = T::zero();
        let mut previous = None;
        let mut flat_steps = 0;
        for iterations in 1..=limit {
            self.model = Quadratic::zero();
            problem.model(&self.x, &mut self.model);
            let model = &self.model;
            if !model.cost.is_finite() {
                return Err(Refusal::DidNotConverge);
            }
            let fell = previous.map(|cost: T| cost - model.cost);
            flat_steps = match fell {
                // Steepest descent creeps; that its cost hardly falls says nothing.
                Some(fell) if fell.abs() < lit(FLAT) && method != Method::SteepestDescent => {
                    flat_steps + 1
                }
                _ => 0,
            };
            if flat_steps == FLAT_STEPS {
                return Ok(iterations);
            }
            previous = Some(model.cost);
            let newton = model.step(T::zero());
            // What the full step is worth, in squared sigmas.
            let within = |sigmas: f64| {
                newton.is_some_and(|step| -step.dot(&model.gradient) <= lit(sigmas * sigmas))
            };
            if let (Some(step), true) = (newton, within(CONVERGED_SIGMAS)) {
                self.x += step;
                return Ok(iterations);
            }
            let next = match method {
                Method::GaussNewton => newton.map(|step| self.x + step),
                Method::SteepestDescent => downhill(problem, &self.x, model),
                Method::Levenberg => damped(problem, &self.x, model, &mut damping),
            };
            match next {
                Some(next) => self.x = next,
                None if within(STALLED_SIGMAS) => return Ok(iterations),
                None => return Err(Refusal::DidNotConverge),
            }
        }
        Err(Refusal::DidNotConverge)
    }
}

/// The least damping from `damping` on with which the cost falls.
fn damped<T: Real, const P: usize>(
    problem: &impl Problem<T, P>,
    x: &SVector<T, P>,
    model: &Quadratic<T, P>,
    damping: &mut T,
) -> Option<SVector<T, P>> {
    let (first, ten) = (lit::<T>(1e-3), lit::<T>(10.0));
    while *damping < lit(DAMPING_LIMIT) {
        if let Some(step) = model.step(*damping) {
            let next = x + step;
            if problem.cost(&next, x) < model.cost {
                *damping = if *damping > first {
                    *damping / ten
                } else {
                    T::zero()
                };
                return Some(next);
            }
        }
        *damping = (*damping * ten).max(first);
    }
    None
}

/// One step against the gradient, by the rule documented at [`Method::SteepestDescent`].
fn downhill<T: Real, const P: usize>(
    problem: &impl Problem<T, P>,
    x: &SVector<T, P>,
    model: &Quadratic<T, P>,
) -> Option<SVector<T, P>> {
    let direction = -model.gradient.component_div(&model.hessian.diagonal());
    let slope = direction.dot(&model.gradient);
    let curvature = direction.dot(&(model.hessian * direction));
    let mut length = -slope / curvature;
    for _ in 0..32 {
        let next = x + direction * length;
        // Twice the slope is the cost's derivative; a tenth of the promise is enough.
        if problem.cost(&next, x) <= model.cost + slope * length * lit(0.1) {
            return Some(next);
        }
        length *= lit(0.5);
    }
    None
}
