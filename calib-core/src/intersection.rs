//! Intersection: the place of a target from bearings of two or more cameras of known pose, or from the
//! bearing and the range of one.
//!
//! The counterpart of [resection](crate::resection), and the surveyor's word for it.
//!
//! # How
//! The point nearest to all rays' lines is a closed form. Least squares on the bearings' residuals
//! starts from it.
//!
//! # Uncertainty
//! A bearing counts with its own variance plus that of the pose it was taken from: with
//! `g = (sin a / r, -cos a / r, -1)`, world bearing `a` and range `r`, that is
//! `sigma^2 + g^T C g`. The covariance of the place is the inverse of the sum of
//! `g_xy g_xy^T` over these variances. It holds while the rays meet at an angle that is large
//! against their sigmas. A range `d`, told by the size of the target in the picture, counts with its own
//! variance plus that of the camera's place along the ray. The poses count as independent of each other;
//! those of cameras that were calibrated by one walk are not quite.

use nalgebra::{ComplexField, Matrix2, Point2, Vector2};

use crate::{
    Pose, Ray, Real, Refusal,
    fit::Fit,
    numerics::{
        minimize::{Descent, Method, Problem, Quadratic},
        plane::{cross, mul, taxicab, unit},
        real::lit,
    },
    resection::information::{rounding, slope},
};

/// The direction in which a camera of known pose, a *station* to surveyors, saw the target.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StationBearing<T: Real> {
    /// The camera, with its covariance; zeros if it is known exactly.
    pub pose: Pose<T>,
    /// The direction, in the camera's frame.
    pub ray: Ray<T>,
    /// Standard deviation of that direction, radians, above zero.
    pub bearing_sigma: T,
    /// Distance of the target and its standard deviation, both above zero, if its size tells it (thesis 5.2).
    pub range: Option<(T, T)>,
}

/// A target's place from bearings that meet there, and ranges that reach there.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Intersection<T: Real> {
    /// Where the bearings meet, in the frame of the cameras' poses.
    pub position: Point2<T>,
    /// Covariance of `position`, symmetric; to first order.
    pub covariance: Matrix2<T>,
    /// Sum of the squared residuals, each over its variance. About
    /// [`degrees_of_freedom`](Intersection::degrees_of_freedom) when poses and sigmas are right.
    pub chi_squared: T,
    /// Number of bearings and ranges that it rests on: all that were given.
    pub used: usize,
}

impl<T: Real> Intersection<T> {
    /// Bearings and ranges beyond the two that a place needs.
    pub fn degrees_of_freedom(&self) -> usize {
        self.used.saturating_sub(2)
    }

    /// Chi squared and the bearings beyond two, for [`Fit::is_bad`].
    pub fn fit(&self) -> Fit<T> {
        Fit {
            chi_squared: self.chi_squared,
            degrees_of_freedom: self.degrees_of_freedom(),
        }
    }
}

#[cfg(feature = "defmt")]
impl<T: Real + defmt::Format> defmt::Format for Intersection<T> {
    fn format(&self, f: defmt::Formatter<'_>) {
        let c = &self.covariance;
        defmt::write!(
            f,
            "({}, {}) covariance ({}, {}; {}) from {}, chi squared {}",
            self.position.x,
            self.position.y,
            c.m11,
            c.m12,
            c.m22,
            self.used,
            self.chi_squared
        );
    }
}

/// Iterations after which a solve is given up. Three are usual.
const ITERATION_LIMIT: usize = 30;

/// The place where the bearings meet.
///
/// # Errors
/// [`Refusal::TooFew`] below two bearings or ranges; [`Refusal::NotFinite`] for an unusable number;
/// [`Refusal::DangerLine`] for cameras that look along one line, [`Refusal::Undetermined`] for ones
/// that look along parallel lines, as far as the arithmetic can tell: poor geometry that is not
/// quite degenerate is *answered*, with a covariance that says so; [`Refusal::TargetBehind`] where
/// the lines meet behind a camera; [`Refusal::Inconsistent`] where
/// they [contradict each other](Fit::is_bad);
/// [`Refusal::DidNotConverge`].
///
/// # Example
/// ```
/// # use calib_core::{intersection::{self, StationBearing}, Pose, Ray};
/// # use nalgebra::{Matrix3, Point2};
/// // Two cameras 10 units apart, both turned 45 degrees inwards, see the target right ahead.
/// let ahead = |x: f64, heading: f64| StationBearing {
///     pose: Pose {
///         position: Point2::new(x, 0.0),
///         heading: heading.to_radians(),
///         covariance: Matrix3::zeros(),
///     },
///     ray: Ray::from_bearing(0.0),
///     bearing_sigma: 0.01,
///     range: None,
/// };
/// let target = intersection::locate(&[ahead(0.0, 45.0), ahead(10.0, 135.0)])?;
/// assert!((target.position - Point2::new(5.0, 5.0)).norm() < 1e-9);
/// # Ok::<(), calib_core::Refusal>(())
/// ```
pub fn locate<T: Real>(bearings: &[StationBearing<T>]) -> Result<Intersection<T>, Refusal> {
    if !bearings.iter().all(StationBearing::is_usable) {
        return Err(Refusal::NotFinite);
    }
    let ranges = bearings.iter().filter(|b| b.range.is_some()).count();
    let used = bearings.len() + ranges;
    if used < 2 {
        return Err(Refusal::TooFew);
    }
    let start = match bearings.iter().find_map(StationBearing::at_range) {
        Some(place) => place,
        None => nearest_to_lines(bearings)?,
    };
    // Two lines have one point in common. More may still have one in front of all cameras.
    if bearings.len() == 2 && !all_in_front(bearings, &start) {
        return Err(Refusal::TargetBehind);
    }
    let mut walk = Descent::new(start.coords);
    walk.run(&Rays(bearings), Method::Levenberg, ITERATION_LIMIT)?;
    let x = walk.x;
    let found = Intersection {
        position: x.into(),
        covariance: walk.covariance().ok_or(Refusal::Undetermined)?,
        chi_squared: walk.cost,
        used,
    };
    if !(x.iter().all(ComplexField::is_finite)
        && found.covariance.iter().all(ComplexField::is_finite))
    {
        return Err(Refusal::NotFinite);
    }
    if !all_in_front(bearings, &found.position) {
        return Err(Refusal::TargetBehind);
    }
    if found.fit().is_bad() {
        return Err(Refusal::Inconsistent);
    }
    Ok(found)
}

impl<T: Real> StationBearing<T> {
    pub(crate) fn is_usable(&self) -> bool {
        let Pose {
            position,
            heading,
            covariance,
        } = &self.pose;
        let all =
            taxicab(position.coords) + heading.abs() + self.bearing_sigma + covariance.sum().abs();
        let [range, range_sigma] = self.range.map_or([T::one(); 2], <[T; 2]>::from);
        all.is_finite()
            && (range + range_sigma).is_finite()
            && range > T::zero()
            && range_sigma > T::zero()
            && self.ray.is_usable()
            && self.bearing_sigma > T::zero()
            && covariance.diagonal().iter().all(|&d| d >= T::zero())
    }

    /// The unit vector along the ray, in the world.
    fn direction(&self) -> Vector2<T> {
        let ray = self.ray.vector();
        // By the larger part first, so that no square overflows.
        let ray = ray / ray.amax();
        mul(unit(self.pose.heading), ray / ray.norm())
    }

    /// Place of the target by this bearing and range alone.
    fn at_range(&self) -> Option<Point2<T>> {
        let (range, _) = self.range?;
        Some(self.pose.position + self.direction() * range)
    }

    /// The excess of the range, its derivative by the target's place, and one over its variance,
    /// that of the camera's place along the ray included.
    fn range_row(&self, to_target: Vector2<T>) -> Option<(T, Vector2<T>, T)> {
        let (range, sigma) = self.range?;
        let distance = to_target.norm();
        let along = to_target / distance;
        let place = self.pose.covariance.fixed_view::<2, 2>(0, 0);
        let of_pose = along.dot(&(place * along)).max(T::zero());
        let own = sigma * sigma;
        let weight = (own + of_pose + rounding(range)).recip();
        (distance > T::zero()).then_some((distance - range, along, weight))
    }

    pub(crate) fn residual(&self, to_target: Vector2<T>) -> T {
        self.ray.residual(self.pose.heading, to_target)
    }

    /// One over the variance of the bearing, that of the pose included.
    fn weight(&self, to_target: Vector2<T>) -> T {
        let g = slope(to_target);
        let of_pose = g.dot(&(self.pose.covariance * g)).max(T::zero());
        let own = self.bearing_sigma * self.bearing_sigma;
        (own + of_pose + rounding(T::one())).recip()
    }
}

fn all_in_front<T: Real>(bearings: &[StationBearing<T>], target: &Point2<T>) -> bool {
    bearings
        .iter()
        .all(|b| b.residual(target - b.pose.position).abs() < T::frac_pi_2())
}

/// The point with the least sum of squared distances to the rays' lines: the mean of the points
/// where two of them meet, weighted by the squared sine between the two (Jacobi's theorem on
/// least squares). Nothing cancels, however flat the angles are.
fn nearest_to_lines<T: Real>(bearings: &[StationBearing<T>]) -> Result<Point2<T>, Refusal> {
    let (first, rest) = bearings.split_first().ok_or(Refusal::TooFew)?;
    // About the first camera, so that a far origin costs no digits.
    let origin = first.pose.position;
    let (mut sum, mut squared_sines, mut pairs) = (Vector2::zeros(), T::zero(), T::zero());
    for (i, a) in bearings.iter().enumerate() {
        let along_a = a.direction();
        let past_a = cross(along_a, a.pose.position - origin);
        for b in bearings.iter().skip(i + 1) {
            let along_b = b.direction();
            let past_b = cross(along_b, b.pose.position - origin);
            let sine = cross(along_a, along_b);
            sum += (along_b * past_a - along_a * past_b) * sine;
            squared_sines += sine * sine;
            pairs += T::one();
        }
    }
    let noise = T::default_epsilon() * lit(8.0);
    if squared_sines > pairs * noise * noise {
        return Ok(origin + sum / squared_sines);
    }
    let line = first.direction();
    let on_line = rest.iter().all(|b| {
        let size = taxicab(origin.coords) + taxicab(b.pose.position.coords);
        cross(line, b.pose.position - origin).abs() <= size * noise
    });
    Err(if on_line {
        Refusal::DangerLine
    } else {
        Refusal::Undetermined
    })
}

/// The bearings with their ranges, and the unknowns `(x, y)`.
struct Rays<'a, T: Real>(&'a [StationBearing<T>]);

impl<T: Real> Problem<T> for Rays<'_, T> {
    fn model(&self, x: &[T], model: &mut Quadratic<'_, T>) {
        let x = place(x);
        for bearing in self.0 {
            let to_target = x - bearing.pose.position.coords;
            // The target moves the bearing as the camera would, the other way.
            let slope = -slope(to_target).xy();
            model.add(
                bearing.residual(to_target),
                slope.as_slice(),
                bearing.weight(to_target),
            );
            if let Some((residual, slope, weight)) = bearing.range_row(to_target) {
                model.add(residual, slope.as_slice(), weight);
            }
        }
    }

    fn cost(&self, x: &[T], weights_at: &[T]) -> T {
        let (x, weights_at) = (place(x), place(weights_at));
        self.0.iter().fold(T::zero(), |sum, bearing| {
            let camera = bearing.pose.position.coords;
            let residual = bearing.residual(x - camera);
            let of_range = bearing
                .range_row(x - camera)
                .map_or(T::zero(), |(residual, _, _)| {
                    let at = bearing.range_row(weights_at - camera);
                    residual * residual * at.map_or(T::zero(), |(_, _, weight)| weight)
                });
            sum + residual * residual * bearing.weight(weights_at - camera) + of_range
        })
    }
}

/// The unknowns by name.
fn place<T: Real>(x: &[T]) -> Vector2<T> {
    match *x {
        [x, y] => Vector2::new(x, y),
        _ => {
            debug_assert!(false, "the unknowns of another problem");
            Vector2::zeros()
        }
    }
}
