//! Do the sightings fit the lens that made their rays?
//!
//! A lens whose focal length is not what it is taken for stretches all tangents (pin-hole) or all
//! angles (equal angles) by one factor. Three sightings fit any factor; the fourth tells. The factor is a fourth
//! unknown beside `(x, y, heading)`, with a prior around one.

use nalgebra::Vector3;

use super::{
    Solution,
    information::{Row, kept},
};
use crate::{
    Pose, Ray, Real, Refusal, Sighting,
    camera::Projection,
    fit::one_in_a_thousand,
    numerics::{
        matrix::add_outer,
        plane::dot,
        real::{lit, root},
    },
};

/// Standard deviation of a focal length, relative to it, where nobody measured it: that of data
/// sheets.
pub const USUAL_LENS_SIGMA: f64 = 0.02;

/// Rounds of "stretch the rays, solve again". Two or three are usual.
const ROUND_LIMIT: usize = 10;
/// A round that changes the stretch by less than this many sigmas is the last.
const CONVERGED_SIGMAS: f64 = 0.01;

/// By how much the lens is off, as the sightings have it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LensFit<T> {
    /// True tangents (pin-hole) or angles (equal angles) over those of the rays, less one: 0.05 where
    /// the true focal length is 1.05 times shorter than it was taken for.
    pub stretch: T,
    /// Its standard deviation; the prior's where the sightings tell nothing.
    pub sigma: T,
    /// By how much chi squared of the sightings would fall with the lens that fits them best, whatever
    /// the prior: of one degree of freedom if the lens is what it was taken for.
    pub misfit: T,
}

impl<T: Real> LensFit<T> {
    /// Whether the lens is not what it is taken for: only one in a thousand right ones would seem to
    /// be off as much.
    pub fn is_off(&self) -> bool {
        self.misfit > one_in_a_thousand(1)
    }
}

impl<T: Real> Ray<T> {
    /// The ray with its tangent (pin-hole) or its angle (equal angles) multiplied.
    #[must_use]
    pub fn stretched(self, projection: Projection, factor: T) -> Self {
        match projection {
            Projection::PinHole => Self {
                left: self.left * factor,
                ..self
            },
            Projection::EqualAngle => Self::from_bearing(self.bearing() * factor),
        }
    }

    /// Derivative of the bearing by the factor of [`stretched`](Self::stretched), at one.
    fn slope(self, projection: Projection) -> T {
        match projection {
            Projection::PinHole => self.forward * self.left / dot(self.vector(), self.vector()),
            Projection::EqualAngle => self.bearing(),
        }
    }
}

/// How well the lens fits the sightings beside their pose, to first order: exact enough to tell
/// whether it does. [`solve_with_lens`] finds the pose that goes with it.
///
/// `pose` is the one that fits the sightings, as [`solve`](super::solve) gives it. `prior_sigma` is
/// that of the focal length, relative, see [`USUAL_LENS_SIGMA`]. What is `dropped` does not count;
/// an empty slice drops none. `None` for fewer than four sightings, which cannot tell.
pub fn lens_fit<T: Real>(
    sightings: &[Sighting<T>],
    dropped: &[bool],
    projection: Projection,
    pose: &Pose<T>,
    prior_sigma: T,
) -> Option<LensFit<T>> {
    let view = LensView::new(sightings, dropped, projection, pose)?;
    Some(view.fit(prior_sigma, T::zero()))
}

/// What the sightings tell about the stretch once the pose has taken its part.
struct LensView<T: Real> {
    /// Zero where rounding leaves none.
    information: T,
    /// Half the negative derivative of chi squared.
    pull: T,
    /// By how much the pose moves, for a stretch of one.
    by_stretch: Vector3<T>,
}

impl<T: Real> LensView<T> {
    fn new(
        sightings: &[Sighting<T>],
        dropped: &[bool],
        projection: Projection,
        pose: &Pose<T>,
    ) -> Option<Self> {
        let (mut information, mut pull, mut mixed) = (T::zero(), T::zero(), Vector3::zeros());
        let mut count = 0_usize;
        for sighting in kept(sightings, dropped) {
            let to_target = sighting.target - pose.position;
            let row = Row::new(sighting, to_target);
            let residual = sighting.ray.residual(pose.heading, to_target);
            let slope = sighting.ray.slope(projection);
            let weighted = row.weight * slope;
            information += weighted * slope;
            pull += weighted * residual;
            mixed += row.slope * weighted;
            count += 1;
        }
        if count < 4 {
            return None;
        }
        let by_stretch = pose.covariance * mixed;
        let left = information - by_stretch.dot(&mixed);
        let is_left = left > information * lit::<T>(64.0) * T::default_epsilon();
        Some(Self {
            information: if is_left { left } else { T::zero() },
            pull,
            by_stretch,
        })
    }

    /// The step from a stretch that the rays have already.
    fn fit(&self, prior_sigma: T, already: T) -> LensFit<T> {
        let prior = (prior_sigma * prior_sigma).recip();
        let information = self.information + prior;
        LensFit {
            stretch: (self.pull - already * prior) / information,
            sigma: root(information.recip()),
            misfit: if self.information > T::zero() {
                self.pull * self.pull / self.information
            } else {
                T::zero()
            },
        }
    }
}

/// The pose with the lens as a fourth unknown, from four or more sightings. Their rays are changed to what that
/// lens would have made of them.
///
/// The pose's covariance contains the lens's uncertainty, chi squared that of the prior: it still has
/// as many degrees of freedom as there are sightings beyond three.
///
/// # Errors
/// As [`solve`](super::solve); [`Refusal::TooFew`] below four; [`Refusal::DidNotConverge`].
///
/// # Example
/// ```
/// # use calib_core::{camera::{Camera, Projection}, resection, Ray, Sighting};
/// # use nalgebra::Point2;
/// // A lens of 47 degrees that is taken for one of 45.
/// let [is, seems] = [47.0_f64, 45.0].map(|view| Camera::pin_hole(160, view.to_radians()).unwrap());
/// let mut sightings = [(4.0, 1.5), (5.0, -2.0), (1.0, 0.0), (6.0, 2.5), (2.0, -0.8)].map(|(x, y)| {
///     let target = Point2::new(x, y);
///     let column = is.column(Ray::towards(Point2::origin(), 0.0, target)).unwrap();
///     Sighting::new(target, seems.ray(column), 0.001)
/// });
/// let as_given = resection::solve(&sightings)?.pose;
/// let (solution, lens) = resection::solve_with_lens(&mut sightings, Projection::PinHole, 0.02)?;
/// assert!(lens.is_off() && (lens.stretch - 0.05).abs() < 0.01);
/// assert!(solution.pose.position.coords.norm() < 0.2 * as_given.position.coords.norm());
/// # Ok::<(), calib_core::Refusal>(())
/// ```
pub fn solve_with_lens<T: Real>(
    sightings: &mut [Sighting<T>],
    projection: Projection,
    prior_sigma: T,
) -> Result<(Solution<T>, LensFit<T>), Refusal> {
    if sightings.len() < 4 {
        return Err(Refusal::TooFew);
    }
    let mut solution = super::solve(sightings)?;
    let mut stretch = T::zero();
    let mut misfit = None;
    for _ in 0..ROUND_LIMIT {
        let view =
            LensView::new(sightings, &[], projection, &solution.pose).ok_or(Refusal::TooFew)?;
        let step = view.fit(prior_sigma, stretch);
        let misfit = *misfit.get_or_insert(step.misfit);
        // Relative to rays that are stretched already.
        let next = stretch + step.stretch;
        let factor = (T::one() + next) / (T::one() + stretch);
        if !(factor > T::zero()) {
            break;
        }
        for sighting in sightings.iter_mut() {
            sighting.ray = sighting.ray.stretched(projection, factor);
        }
        stretch = next;
        solution = super::solve(sightings)?;
        if step.stretch.abs() < step.sigma * lit(CONVERGED_SIGMAS) {
            let of_prior = stretch / prior_sigma;
            solution.chi_squared += of_prior * of_prior;
            add_outer(
                solution.pose.covariance.as_mut_slice(),
                view.by_stretch.as_slice(),
                step.sigma * step.sigma,
            );
            let lens = LensFit {
                stretch,
                misfit,
                ..step
            };
            return Ok((solution, lens));
        }
    }
    Err(Refusal::DidNotConverge)
}
