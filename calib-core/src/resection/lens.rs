//! Do the sightings fit the lens that made their rays?
//!
//! A lens whose focal length is not what it is taken for stretches all tangents (pin-hole) or all angles
//! (equal angles) by one factor. Three sightings fit any factor; the fourth tells. The factor is a fourth
//! unknown beside `(x, y, heading)`, with a prior around one.

use nalgebra::Vector3;

use super::{
    Solution,
    information::{Row, kept},
};
use crate::{
    Pose, Ray, Real, Refusal, Sighting,
    camera::{Projection, tangent},
    fit::{Fit, one_in_a_thousand},
    numerics::{
        matrix::add_outer,
        plane::dot,
        real::{lit, root},
    },
};

/// Standard deviation of a focal length, relative to it, where it was not measured: that of data sheets.
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
    /// Returns true if the lens is not what it is taken for: only one in a thousand right ones would seem to
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

    /// The ray for the same column by another projection, of as many columns over as wide a field of view.
    /// `half_view` is half of that, radians.
    #[must_use]
    pub fn decoded(self, from: Projection, to: Projection, half_view: T) -> Self {
        match (from, to) {
            (Projection::PinHole, Projection::EqualAngle) => {
                let share = self.left / self.forward / tangent(half_view);
                Self::from_bearing(share * half_view)
            }
            (Projection::EqualAngle, Projection::PinHole) => Self {
                forward: T::one(),
                left: self.bearing() / half_view * tangent(half_view),
            },
            _ => self,
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

/// Fit of the lens to the sightings beside their pose, to first order: exact enough to tell if it fits.
/// [`solve_with_lens`] finds the pose that goes with it.
///
/// `pose` is the one that fits the sightings, as [`solve`](super::solve) gives it. `prior_sigma` is
/// that of the focal length, relative, see [`USUAL_LENS_SIGMA`]. `dropped` sightings do not count; an empty
/// slice drops none. `None` for fewer than four sightings, which cannot tell.
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

/// Information of the sightings about the stretch once the pose has taken its part.
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

/// The pose with the lens as a fourth unknown, from four or more sightings. Their rays are changed to those
/// of that lens.
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

/// Sightings that tell another lens from one wrong sighting: a pose, a lens, and one beyond.
const WITNESSED: usize = 5;
/// Relative sigma of a lens of which nothing is known.
const ANY_LENS_SIGMA: f64 = 0.2;
/// A right lens is worse than the best one by more once in 100,000: 4.42 sigmas.
const NOT_CHANCE: f64 = 19.5;

/// A lens that fits the sightings, where the one that was given does not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OtherLens<T: Real> {
    /// Its projection.
    pub projection: Projection,
    /// From the centre of the first column to that of the last one, radians.
    pub field_of_view: T,
    /// The pose with it, with the lens's uncertainty.
    pub solution: Solution<T>,
}

/// The lens that fits sightings of one camera where the lens that decoded them, of this projection and field
/// of view (radians), does not. Its chi squared is less than with that lens, by more than chance takes off in
/// one of 100,000, and is believable. Another projection has to be better than another width, too.
///
/// `None` where the given one fits, no lens does, or fewer than five sightings could not tell a lens
/// from one wrong sighting. `sightings` may be made again and again, for which `scratch` is room.
pub fn other_lens<T: Real>(
    sightings: &(impl Iterator<Item = Sighting<T>> + Clone),
    scratch: &mut [Sighting<T>],
    projection: Projection,
    field_of_view: T,
) -> Option<OtherLens<T>> {
    let count = sightings.clone().count();
    let scratch = scratch.get_mut(..count)?;
    if count < WITNESSED {
        return None;
    }
    for (place, sighting) in scratch.iter_mut().zip(sightings.clone()) {
        *place = sighting;
    }
    let as_given = match super::solve(scratch) {
        Ok(solution) => solution.chi_squared,
        Err(Refusal::NotFinite) => return None,
        Err(_) => T::max_value().unwrap_or_else(T::one),
    };
    if !(as_given > lit(NOT_CHANCE)) {
        return None;
    }
    let half_view = field_of_view * lit(0.5);
    let mut best: Option<(T, OtherLens<T>)> = None;
    let other = match projection {
        Projection::PinHole => Projection::EqualAngle,
        Projection::EqualAngle => Projection::PinHole,
    };
    for (to, margin) in [(projection, T::zero()), (other, one_in_a_thousand::<T>(1))] {
        for (decoded, sighting) in scratch.iter_mut().zip(sightings.clone()) {
            *decoded = sighting;
            decoded.ray = sighting.ray.decoded(projection, to, half_view);
        }
        let Ok((solution, lens)) = solve_with_lens(scratch, to, lit(ANY_LENS_SIGMA)) else {
            continue;
        };
        let fit = Fit {
            chi_squared: solution.chi_squared,
            degrees_of_freedom: count - 4,
        };
        let cost = solution.chi_squared + margin;
        let is_better = best.as_ref().is_none_or(|(least, _)| cost < *least);
        if fit.is_bad() || !is_better || !(as_given - cost > lit(NOT_CHANCE)) {
            continue;
        }
        let factor = T::one() + lens.stretch;
        let half_view = match to {
            Projection::PinHole => (tangent(half_view) * factor).atan2(T::one()),
            Projection::EqualAngle => half_view * factor,
        };
        best = Some((
            cost,
            OtherLens {
                projection: to,
                field_of_view: half_view * lit(2.0),
                solution,
            },
        ));
    }
    best.map(|(_, lens)| lens)
}
