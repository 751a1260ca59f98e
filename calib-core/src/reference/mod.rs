//! The reference solve: two cameras that see the target together find their own headings and the
//! target's place (thesis 2.6.1).
//!
//! Camera 0 is the origin, camera 1 at `(baseline, 0)`. At every stop both see the target; between
//! stops the target's step sensor measures its displacement. Unknown are the two headings and the
//! first stop and, as [`Known`] says, the baseline's length and how the frame of the displacements
//! is turned against it.
//!
//! # Why not the thesis's equations
//! The six residuals in print (kept in this crate's tests) determine four of their six unknowns only: the
//! measured displacement has cancelled from them, so every pair of headings solves them perfectly.
//! Here the displacement serves its purpose. Bearings of `n` stops are `2 n` equations;
//!
//! | known | unknown | stops |
//! |---|---|---|
//! | baseline and frame heading | 4 | 2, with up to two answers; 3 decide |
//! | baseline, or frame heading | 5 | 3 |
//! | neither (the displacements give the scale) | 6 | 3 |
//!
//! # How
//! Closed forms propose candidates, so no guess is needed: two circles for each pair of stops, or two
//! resections for each triple. Those with the least residuals are refined by least squares ([`Method`]) over
//! all stops.
//!
//! # Uncertainty
//! The covariance follows from the bearings' sigmas and the displacements' covariances. A stop's place
//! relative to the first counts as uncertain by the *sum* of the displacements' covariances up to it. The
//! result takes into account that both cameras see the same displaced target. It does not take into account
//! that the next stops carry the same error on. With long chains of poor displacements the result is
//! miss each other, the prediction is bounded by the profile of the cost instead of its slope.

use nalgebra::{Matrix2, Matrix3, Matrix6, Point2, Vector2, Vector3, Vector6};

use crate::{
    Method, Pose, Ray, Real, Refusal,
    fit::{Fit, one_in_a_thousand},
    numerics::{
        angle,
        minimize::{Descent, STALLED_SIGMAS},
        plane::unit,
        ranking::Ranking,
        real::{lit, root},
    },
};
use candidates::Proposals;
use model::Bearings;

mod candidates;
mod model;
mod profile;

/// One stop of the target, seen by both reference cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Stop<T: Real> {
    /// The directions in which camera 0 and camera 1 saw the target.
    pub rays: [Ray<T>; 2],
    /// Standard deviations of these directions, radians, above zero.
    pub bearing_sigmas: [T; 2],
    /// Displacement of the target from the previous stop. Ignored for the first stop.
    pub displacement: Vector2<T>,
    /// Covariance of that displacement.
    pub displacement_covariance: Matrix2<T>,
}

impl<T: Real> Stop<T> {
    fn is_usable(&self) -> bool {
        let rays = self
            .rays
            .iter()
            .zip(self.bearing_sigmas)
            .all(|(ray, sigma)| ray.is_usable() && sigma.is_finite() && sigma > T::zero());
        let moved = self.displacement.sum() + self.displacement_covariance.sum();
        rays && moved.is_finite()
    }
}

/// Known parts of the frame; see the [table](crate::reference#why-not-the-thesiss-equations).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Known<T> {
    /// Distance between the two cameras, above zero.
    pub baseline: Option<T>,
    /// Direction of the displacements' x axis in the frame whose x axis is the baseline, radians;
    /// zero where the step sensor was aligned with it.
    pub frame_heading: Option<T>,
}

/// Extent of the refinement of a candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct ReferenceSettings {
    /// From the closed-form candidate to the minimum.
    pub method: Method,
    /// Steps after which a candidate is given up.
    pub iteration_limit: usize,
}

impl Default for ReferenceSettings {
    /// Levenberg damping, 50 iterations (4 to 6 are usual). Steepest descent wants thousands.
    fn default() -> Self {
        Self {
            method: Method::default(),
            iteration_limit: 50,
        }
    }
}

/// Headings of both cameras, and the first place of the target.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ReferenceSolution<T: Real> {
    /// Headings of camera 0 and camera 1 against the baseline, radians in `[0, 2 pi)`.
    pub headings: [T; 2],
    /// Place of the target at the first stop.
    pub first_stop: Point2<T>,
    /// Direction of the displacements' x axis against the baseline, radians in `[0, 2 pi)`.
    pub frame_heading: T,
    /// Distance between the cameras.
    pub baseline: T,
    /// Covariance of `(heading 0, heading 1, first x, first y, frame heading, baseline)`. Rows and
    /// columns of known values are zero.
    pub covariance: Matrix6<T>,
    /// Sum of the squared residuals, each over its variance.
    pub chi_squared: T,
    /// Equations beyond the unknowns.
    pub degrees_of_freedom: usize,
    /// Steps of the refinement.
    pub iterations: usize,
    /// Condition number (1-norm) of the normal matrix scaled to unit diagonal. 1 is best; the
    /// square root of one over the scalar's epsilon is about where digits run out.
    pub condition: T,
}

impl<T: Real> ReferenceSolution<T> {
    /// Standard deviations of the two headings, radians.
    pub fn heading_sigmas(&self) -> [T; 2] {
        [self.covariance.m11, self.covariance.m22].map(root)
    }

    /// Chi squared and the equations beyond the unknowns, for [`Fit::is_bad`].
    pub fn fit(&self) -> Fit<T> {
        Fit {
            chi_squared: self.chi_squared,
            degrees_of_freedom: self.degrees_of_freedom,
        }
    }

    /// Standard deviation of the baseline; zero where it was known.
    pub fn baseline_sigma(&self) -> T {
        root(self.covariance.m66)
    }

    /// Standard deviation of the frame heading, radians; zero where it was known.
    pub fn frame_heading_sigma(&self) -> T {
        root(self.covariance.m55)
    }

    /// Every stop's place with its covariance, in order: the solved first one, displaced. The
    /// displacements' own covariance is included.
    pub fn places(&self, stops: &[Stop<T>]) -> impl Iterator<Item = (Point2<T>, Matrix2<T>)> {
        let turn = unit(self.frame_heading);
        displacements_from_first(stops)
            .map(move |(sum, spread)| model::place(self, turn, sum, spread))
    }

    /// Both cameras' poses in a frame in which the first one stands at `origin` and the second one
    /// in `direction` of it, radians, both known exactly.
    ///
    /// The first camera is where the frame begins, so only its heading errs; the second one is on
    /// the baseline, the length of which errs if it was not known.
    pub fn poses(&self, origin: Point2<T>, direction: T) -> [Pose<T>; 2] {
        let along = unit(direction);
        let c = &self.covariance;
        let zero = T::zero();
        let [xx, xy, yy] = [
            along.x * along.x * c.m66,
            along.x * along.y * c.m66,
            along.y * along.y * c.m66,
        ];
        let [x_heading, y_heading] = [along.x * c.m26, along.y * c.m26];
        let second = Matrix3::new(
            xx, xy, x_heading, //
            xy, yy, y_heading, //
            x_heading, y_heading, c.m22,
        );
        let first = Matrix3::from_diagonal(&Vector3::new(zero, zero, c.m11));
        let [heading0, heading1] = self
            .headings
            .map(|heading| angle::wrap_positive(direction + heading));
        [
            Pose {
                position: origin,
                heading: heading0,
                covariance: first,
            },
            Pose {
                position: origin + along * self.baseline,
                heading: heading1,
                covariance: second,
            },
        ]
    }

    fn unknowns(&self) -> Vector6<T> {
        let [h0, h1] = self.headings;
        let p = self.first_stop;
        Vector6::new(h0, h1, p.x, p.y, self.frame_heading, self.baseline)
    }
}

#[cfg(feature = "defmt")]
impl<T: Real + defmt::Format> defmt::Format for ReferenceSolution<T> {
    fn format(&self, f: defmt::Formatter<'_>) {
        let ([h0, h1], [s0, s1]) = (self.headings, self.heading_sigmas());
        defmt::write!(
            f,
            "headings {} +/- {}, {} +/- {} rad, chi squared {}, {} steps",
            h0,
            s0,
            h1,
            s1,
            self.chi_squared,
            self.iterations
        );
    }
}

/// The best answer, and another one if the data cannot tell them apart.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ReferenceOutcome<T: Real> {
    /// The answer with the least residuals.
    pub best: ReferenceSolution<T>,
    /// A different one that is not ruled out: its chi squared is above the best one's by less than
    /// the [limit](one_in_a_thousand) of one degree of freedom. One more stop, or a glance at the scene, decides.
    pub alternative: Option<ReferenceSolution<T>>,
    /// Number of different, physically possible answers that the candidates led to.
    pub candidates: usize,
}

/// Finds the headings of both cameras and the places of the target.
///
/// # Errors
/// [`Refusal::TooFew`] stops for the unknowns; [`Refusal::NotFinite`] for an unusable number;
/// [`Refusal::CoincidentTargets`] when the target did not move; [`Refusal::TargetBehind`] when no
/// candidate has the target in front of both cameras; [`Refusal::DidNotConverge`];
/// [`Refusal::Undetermined`].
// Inlined, and the settings passed on by value: parts that no caller names are then not linked.
#[inline]
pub fn solve<T: Real>(
    stops: &[Stop<T>],
    known: &Known<T>,
    settings: &ReferenceSettings,
) -> Result<ReferenceOutcome<T>, Refusal> {
    solve_checked(stops, known, *settings)
}

#[inline(never)] // for less stack
fn solve_checked<T: Real>(
    stops: &[Stop<T>],
    known: &Known<T>,
    settings: ReferenceSettings,
) -> Result<ReferenceOutcome<T>, Refusal> {
    let mut search = Search::new();
    let searched = loop {
        if let Some(searched) = search.step(stops, known, settings) {
            break searched;
        }
    };
    searched?;
    outcome(&Bearings::new(stops, known), settings, &search)
}

fn check<T: Real>(stops: &[Stop<T>], known: &Known<T>) -> Result<(), Refusal> {
    let lengths_usable = known
        .baseline
        .is_none_or(|b| b.is_finite() && b > T::zero());
    let angle_usable = known.frame_heading.is_none_or(|h| h.is_finite());
    if !(lengths_usable && angle_usable && stops.iter().all(Stop::is_usable)) {
        return Err(Refusal::NotFinite);
    }
    let all_known = known.baseline.is_some() && known.frame_heading.is_some();
    if stops.len() < if all_known { 2 } else { 3 } {
        return Err(Refusal::TooFew);
    }
    if displacements_from_first(stops).all(|(sum, _)| sum == Vector2::zeros()) {
        return Err(Refusal::CoincidentTargets);
    }
    Ok(())
}

/// The answers of a [`Search`].
type Answers<T> = Ranking<T, Found<T>, 6>;

/// Search for the different answers, in slices: a slow processor can do something else in between. It keeps no
/// measurement, so each slice takes the same ones.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Search<T: Real> {
    next: Slice,
    proposals: Proposals<T>,
    found: Answers<T>,
    /// Reason why a candidate was not an answer.
    failure: Refusal,
}

#[derive(Clone, Copy, Debug)]
enum Slice {
    /// This one of the closed forms.
    Propose(u32),
    /// The candidate of this rank.
    Refine(usize),
}

impl<T: Real> Search<T> {
    #[inline(never)] // for less stack
    pub(crate) fn new() -> Self {
        Self {
            next: Slice::Propose(0),
            proposals: Ranking::new(),
            found: Ranking::new(),
            failure: Refusal::TargetBehind,
        }
    }

    /// Does a slice. `None` if there are more.
    ///
    /// # Errors
    /// As [`solve`].
    #[inline(never)] // for less stack
    pub(crate) fn step(
        &mut self,
        stops: &[Stop<T>],
        known: &Known<T>,
        settings: ReferenceSettings,
    ) -> Option<Result<(), Refusal>> {
        let problem = Bearings::new(stops, known);
        match self.next {
            Slice::Propose(part) => {
                if part == 0
                    && let Err(why) = check(stops, known)
                {
                    return Some(Err(why));
                }
                if let Err(why) = candidates::propose(&problem, part, &mut self.proposals) {
                    self.failure = why;
                }
                self.next = if part + 1 < candidates::parts(known) {
                    Slice::Propose(part + 1)
                } else {
                    Slice::Refine(0)
                };
            }
            Slice::Refine(rank) => {
                let Some(&start) = self.proposals.iter().nth(rank) else {
                    let found = self.found.iter().next();
                    return Some(found.map(|_| ()).ok_or(self.failure));
                };
                if rank == 0 {
                    // That closed forms refused some stops matters only if they propose nothing.
                    self.failure = Refusal::TargetBehind;
                }
                self.try_candidate(&problem, rank, start, settings);
                self.next = Slice::Refine(rank + 1);
            }
        }
        None
    }

    fn try_candidate(
        &mut self,
        problem: &Bearings<'_, T>,
        rank: usize,
        start: Vector6<T>,
        settings: ReferenceSettings,
    ) {
        // By reference: large, and moved it would be on the stack twice.
        match &refine(problem, start, settings) {
            Ok(solution) => {
                let new = Found {
                    rank,
                    unknowns: solution.unknowns(),
                    variances: solution.covariance.diagonal(),
                    chi_squared: solution.chi_squared,
                };
                if !self.found.iter().any(|held| is_same(held, &new)) {
                    self.found.offer(new.chi_squared, new);
                }
            }
            Err(why) => self.failure = *why,
        }
    }

    /// The best answer, and the next best one unless it is ruled out.
    pub(crate) fn best(&self) -> Option<(&Found<T>, Option<&Found<T>>)> {
        let mut ranked = self.found.iter();
        let best = ranked.next()?;
        let limit = best.chi_squared + one_in_a_thousand(1);
        let other = ranked.next().filter(|other| other.chi_squared < limit);
        Some((best, other))
    }

    fn start_of(&self, found: &Found<T>) -> Result<Vector6<T>, Refusal> {
        let start = self.proposals.iter().nth(found.rank);
        start.copied().ok_or(Refusal::TargetBehind)
    }
}

#[inline(never)] // for less stack
fn outcome<T: Real>(
    problem: &Bearings<'_, T>,
    settings: ReferenceSettings,
    search: &Search<T>,
) -> Result<ReferenceOutcome<T>, Refusal> {
    let (best, other) = search.best().ok_or(Refusal::TargetBehind)?;
    let alternative = match other {
        Some(other) => Some(refine(problem, search.start_of(other)?, settings)?),
        None => None,
    };
    Ok(ReferenceOutcome {
        best: refine(problem, search.start_of(best)?, settings)?,
        alternative,
        candidates: search.found.iter().count(),
    })
}

/// Numbers that tell one answer from another. The whole answer is computed again from its start, which takes
/// time once instead of stack always.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found<T: Real> {
    /// Rank of the candidate that led to it.
    rank: usize,
    unknowns: Vector6<T>,
    variances: Vector6<T>,
    /// Sum of the squared residuals, each over its variance.
    pub(crate) chi_squared: T,
}

impl<T: Real> Found<T> {
    /// Headings of both cameras, radians in `[0, 2 pi)`.
    pub(crate) fn headings(&self) -> [T; 2] {
        [self.unknowns.x, self.unknowns.y].map(angle::wrap_positive)
    }

    /// Place of the target at the first stop.
    pub(crate) fn first_stop(&self) -> Point2<T> {
        Point2::new(self.unknowns.z, self.unknowns.w)
    }

    /// Direction of the displacements' x axis against the baseline, radians in `[0, 2 pi)`.
    pub(crate) fn frame_heading(&self) -> T {
        angle::wrap_positive(self.unknowns.a)
    }

    /// Distance between the cameras.
    pub(crate) fn baseline(&self) -> T {
        self.unknowns.b
    }
}

#[inline(never)] // for less stack
fn refine<T: Real>(
    problem: &Bearings<'_, T>,
    start: Vector6<T>,
    settings: ReferenceSettings,
) -> Result<ReferenceSolution<T>, Refusal> {
    let mut walk = Descent::new(start);
    let iterations = walk.run(problem, settings.method, settings.iteration_limit)?;
    let x = &walk.x;
    if !problem.all_in_front(x) {
        return Err(Refusal::TargetBehind);
    }
    let mut covariance = walk.covariance().ok_or(Refusal::Undetermined)?;
    let condition = condition(&walk.hessian, &covariance);
    // Twice the digits of the scalar are gone: the rest is noise.
    if !(condition < T::one() / T::default_epsilon()) {
        return Err(Refusal::Undetermined);
    }
    problem.keep_free(&mut covariance);
    profile::bound(problem, x, &mut covariance);
    if !covariance.diagonal().iter().all(|&v| v >= T::zero()) {
        return Err(Refusal::Undetermined);
    }
    Ok(ReferenceSolution {
        headings: [x.x, x.y].map(angle::wrap_positive),
        first_stop: Point2::new(x.z, x.w),
        frame_heading: angle::wrap_positive(x.a),
        baseline: x.b,
        covariance,
        chi_squared: walk.cost,
        degrees_of_freedom: problem.degrees_of_freedom(),
        iterations,
        condition,
    })
}

/// Returns true if two refined answers are one minimum: they differ by no more than where an iteration may
/// stop short, and rounding.
fn is_same<T: Real>(a: &Found<T>, b: &Found<T>) -> bool {
    let difference = a.unknowns - b.unknowns;
    let angles = [difference.x, difference.y, difference.a].map(|d| angle::wrap_signed(d).abs());
    let lengths = [difference.z, difference.w, difference.b].map(nalgebra::ComplexField::abs);
    let near = |d: T, variance: T, size: T| {
        d <= root(variance) * lit(2.0 * STALLED_SIGMAS) + size * T::default_epsilon() * lit(256.0)
    };
    let v = &a.variances;
    let [angle0, angle1, frame] = angles;
    let [x, y, baseline] = lengths;
    let size = a.unknowns.b + a.unknowns.z.abs() + a.unknowns.w.abs();
    near(angle0, v.x, T::pi())
        && near(angle1, v.y, T::pi())
        && near(frame, v.a, T::pi())
        && near(x, v.z, size)
        && near(y, v.w, size)
        && near(baseline, v.b, size)
}

/// The condition number (1-norm) of a normal matrix scaled to unit diagonal.
#[inline(never)] // for less stack
fn condition<T: Real>(normal: &Matrix6<T>, inverse: &Matrix6<T>) -> T {
    let scale = normal.diagonal().map(nalgebra::ComplexField::sqrt);
    let mut norms = [T::zero(); 2];
    // By columns, in which the numbers are kept.
    let columns = normal.as_slice().as_chunks::<6>().0.iter();
    let columns = columns.zip(inverse.as_slice().as_chunks::<6>().0.iter());
    for ((normal, inverse), of_column) in columns.zip(scale.iter()) {
        let mut sums = [T::zero(); 2];
        for ((entry, inverse), of_row) in normal.iter().zip(inverse).zip(scale.iter()) {
            let scaling = *of_column * *of_row;
            sums[0] += (*entry / scaling).abs();
            sums[1] += (*inverse * scaling).abs();
        }
        norms = [norms[0].max(sums[0]), norms[1].max(sums[1])];
    }
    norms[0] * norms[1]
}

/// For every stop the displacement since the first one, in the displacements' own frame, and its
/// covariance.
fn displacements_from_first<T: Real>(
    stops: &[Stop<T>],
) -> impl Iterator<Item = (Vector2<T>, Matrix2<T>)> {
    let mut sum = Vector2::zeros();
    let mut covariance = Matrix2::zeros();
    stops.iter().enumerate().map(move |(n, stop)| {
        if n > 0 {
            sum += stop.displacement;
            covariance += stop.displacement_covariance;
        }
        (sum, covariance)
    })
}

/// A covariance in a frame turned by a unit vector.
fn turned<T: Real>(covariance: &Matrix2<T>, turn: Vector2<T>) -> Matrix2<T> {
    let rotation = Matrix2::new(turn.x, -turn.y, turn.y, turn.x);
    angle::turned(covariance, &rotation)
}

#[cfg(test)]
mod tests {
    use core::f64::consts::{PI, TAU};

    use super::*;

    fn found(unknowns: [f64; 6]) -> Found<f64> {
        Found {
            rank: 0,
            unknowns: unknowns.into(),
            variances: Vector6::from([1e-4, 4e-4, 0.01, 0.04, 9e-4, 0.09]),
            chi_squared: 1.0,
        }
    }

    /// Each unknown by itself, up to a fifth of its sigma, either way; angles in circles.
    #[test]
    fn answers_are_one_within_a_fifth_of_a_sigma() {
        let unknowns = [0.0, 1.0, -2.0, 3.0, PI, 5.0];
        let sigmas = [0.01, 0.02, 0.1, 0.2, 0.03, 0.3];
        for k in 0..6 {
            for sign in [-1.0, 1.0] {
                let moved = |sigmas_off: f64| {
                    let mut other = unknowns;
                    other[k] += sign * sigmas_off * sigmas[k];
                    is_same(&found(unknowns), &found(other))
                };
                assert!(moved(0.0) && moved(0.199), "unknown {k}");
                assert!(!moved(0.201) && !moved(10.0), "unknown {k}");
            }
        }
        for k in [0, 1, 4] {
            let mut other = unknowns;
            other[k] += TAU - 0.1 * sigmas[k];
            assert!(is_same(&found(unknowns), &found(other)), "angle {k}");
        }
    }

    /// A known quantity has no sigma; the digits of a scene of some size are left, and no more.
    #[test]
    fn answers_without_sigmas_are_one_but_for_rounding() {
        let exact = |unknowns| Found {
            variances: Vector6::zeros(),
            ..found(unknowns)
        };
        let unknowns = [0.0, 1.0, -200.0, 300.0, 1.0, 500.0];
        let digit = 256.0 * f64::EPSILON;
        for (k, size) in [PI, PI, 1000.0, 1000.0, PI, 1000.0].into_iter().enumerate() {
            let moved = |by: f64| {
                let mut other = unknowns;
                other[k] += by * size * digit;
                is_same(&exact(unknowns), &exact(other))
            };
            assert!(moved(0.95) && !moved(1.05), "unknown {k}");
        }
    }

    /// The product of the norms of the matrix and of its inverse, whatever the units.
    #[test]
    fn the_condition_does_not_depend_on_units() {
        let mut normal = Matrix6::identity();
        for (row, column, entry) in [(0, 1, 0.5), (2, 5, -0.8), (3, 5, 0.1)] {
            normal[(row, column)] = entry;
            normal[(column, row)] = entry;
        }
        let norm = |m: &Matrix6<f64>| m.column_iter().map(|c| c.abs().sum()).fold(0.0, f64::max);
        let expected = norm(&normal) * norm(&normal.try_inverse().unwrap());
        for units in [[1.0; 6], [1e3, 0.1, 7.0, 1e-4, 2.0, 30.0]] {
            let units = Matrix6::from_diagonal(&Vector6::from(units));
            let normal = units * normal * units;
            let condition = condition(&normal, &normal.try_inverse().unwrap());
            assert!((condition / expected - 1.0).abs() < 1e-9, "{condition}");
        }
    }
}
