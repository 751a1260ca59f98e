//! Resection: the pose of a camera from sightings of targets at known places.
//!
//! Three sightings have a closed form, from rays: [`three_point`]. [`solve`] takes any number and is
//! what most callers want; [`solve_rejecting`] also survives wrong sightings. The thesis's own
//! equations (7) to (9) are kept, as the documented original, in this crate's tests.
//!
//! # Uncertainty
//! A bearing is `atan2(y_i - y, x_i - x) - heading` plus noise. With the range `r_i`, the world
//! bearing `a_i` and `g_i = (sin a_i / r_i, -cos a_i / r_i, -1)`, the covariance of
//! `(x, y, heading)` is the inverse of `sum g_i g_i^T / v_i`, the Cramer-Rao bound. The variance
//! `v_i` is the bearing's own plus that of the target's place across the line of sight over
//! `r_i^2`. Errors of different sightings count as independent. Those of dead-reckoned stops are
//! not: [`correlate`](crate::dead_reckoning::correlate) then gives the covariance.
//!
//! The covariance is *predicted* from the sigmas given, not fitted to the residuals: three sightings leave
//! none. [`Solution::fit`] tells whether the prediction was believable. It holds as far as bearings change in
//! proportion to places; [`alternative()`] tells where they do not. The covariance does not know of a wrong
//! lens either: [`lens_fit`] asks the sightings, [`solve_with_lens`] corrects it, [`other_lens`] names the
//! one that fits. [`predict`] gives the covariance before anything is seen, [`information()`] the part that
//! one sighting adds.

use crate::{Pose, Real, Refusal, Sighting, fit::Fit};

mod alternative;
pub(crate) mod information;
mod least_squares;
mod lens;
mod rejection;
pub mod three_point;

pub use alternative::alternative;
pub use information::{information, predict};
pub use lens::{LensFit, OtherLens, USUAL_LENS_SIGMA, lens_fit, other_lens, solve_with_lens};

/// A pose, and its source.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Solution<T: Real> {
    /// Where the camera is and looks, with the predicted covariance.
    pub pose: Pose<T>,
    /// Number of sightings that it rests on; those that were left out do not count.
    pub used: usize,
    /// Sum of the squared residuals, each over its variance. About
    /// [`degrees_of_freedom`](Solution::degrees_of_freedom) when the sigmas are right; much more
    /// when a sighting is wrong or the camera model is.
    pub chi_squared: T,
    /// Least-squares iterations; 0 for the closed form.
    pub iterations: usize,
}

impl<T: Real> Solution<T> {
    /// Sightings beyond the three that a pose needs.
    pub fn degrees_of_freedom(&self) -> usize {
        self.used.saturating_sub(3)
    }

    /// Chi squared and the sightings beyond three, for [`Fit::is_bad`].
    pub fn fit(&self) -> Fit<T> {
        Fit {
            chi_squared: self.chi_squared,
            degrees_of_freedom: self.degrees_of_freedom(),
        }
    }
}

/// The pose from three or more sightings: closed form for three, least squares for more.
///
/// # Errors
/// [`Refusal::TooFew`] below three; [`Refusal::NotFinite`] for an unusable number; otherwise the reason why
/// the geometry was refused.
pub fn solve<T: Real>(sightings: &[Sighting<T>]) -> Result<Solution<T>, Refusal> {
    check(sightings)?;
    match sightings {
        &[a, b, c] => Ok(Solution {
            pose: three_point::solve(&[a, b, c])?,
            used: 3,
            chi_squared: T::zero(),
            iterations: 0,
        }),
        _ => least_squares::solve(sightings),
    }
}

/// [`solve`], leaving out sightings that lie more than `gate` sigmas off the pose on which most of
/// the others agree. 3 to 5 are usual gates.
///
/// `dropped` must be as long as `sightings`; it reports which were left out. Three sightings cannot
/// contradict each other and are solved as they are. One wrong one among four is noticed but cannot be told
/// from the others ([`Refusal::Inconsistent`]); from five on it is found.
///
/// # Errors
/// As [`solve`]; [`Refusal::Inconsistent`] when fewer than four agree, or not more than half;
/// [`Refusal::NotFinite`] for a gate that is not above zero.
///
/// # Example
/// ```
/// # use calib_core::{resection, Ray, Sighting};
/// # use nalgebra::Point2;
/// // A camera at the origin that looks along x sees five targets, one of them mistaken.
/// let mut sightings = [(4.0, 1.0), (5.0, -2.0), (2.0, 0.5), (6.0, 3.0), (3.0, -1.0)]
///     .map(|(x, y): (f64, f64)| Sighting::new(Point2::new(x, y), Ray::from_bearing(y.atan2(x)), 0.01));
/// sightings[1].ray = Ray::from_bearing(0.3);
/// let mut dropped = [false; 5];
/// let solution = resection::solve_rejecting(&sightings, 4.0, &mut dropped)?;
/// assert_eq!(dropped, [false, true, false, false, false]);
/// assert!(solution.pose.position.coords.norm() < 1e-9);
/// # Ok::<(), calib_core::Refusal>(())
/// ```
pub fn solve_rejecting<T: Real>(
    sightings: &[Sighting<T>],
    gate: T,
    dropped: &mut [bool],
) -> Result<Solution<T>, Refusal> {
    dropped.fill(false);
    if sightings.len() <= 3 {
        return solve(sightings);
    }
    check(sightings)?;
    if !(gate > T::zero() && dropped.len() == sightings.len()) {
        return Err(Refusal::NotFinite);
    }
    rejection::solve(sightings, gate, dropped)
}

fn check<T: Real>(sightings: &[Sighting<T>]) -> Result<(), Refusal> {
    if !sightings.iter().all(Sighting::is_usable) {
        Err(Refusal::NotFinite)
    } else if sightings.len() < 3 {
        Err(Refusal::TooFew)
    } else {
        Ok(())
    }
}
