//! Another place that the sightings allow, far beyond the sigmas that are claimed.

use nalgebra::{Point2, Vector2};

use super::information::{Row, kept};
use crate::{
    Pose, Real, Sighting,
    numerics::{
        plane::{cross, dot, mul_conj, quarter_turn},
        real::{lit, root},
    },
};

/// Distance at which another place is looked for, in sigmas.
const FAR: f64 = 5.0;
/// The most that chi squared may rise up to there: three sigmas, squared.
const RISE: f64 = 9.0;
/// Looks on the way around the circle into the valley of the cost.
const LOOKS: usize = 4;
/// The longest step between them, radians: beyond it the slopes of the bearings say nothing.
const LONGEST_STEP: f64 = 0.7;

/// A place that the sightings allow although it is five times `sigma` from the pose: chi squared,
/// with the heading that is best there, is above that of the pose by less than 9. A pose that has
/// one cannot be relied on, however small its own sigmas are.
///
/// A covariance holds as far as bearings change in proportion to places. Near the danger circle, and
/// among targets close to each other, it does not: noise may put the pose where the sightings are by
/// chance strict, usually right beside a target, and the truth is far off in a curved valley of the
/// cost (profile likelihood). So the least cost is looked for on the circle of five sigmas around the
/// pose, from both ends of its longest axis, by nine evaluations of all sightings at most.
///
/// Nearer to a target than its own sigma, a pose has no linear prediction at all; then the alternative
/// is the place of that target.
///
/// `pose` is the one that fits the sightings, as [`solve`](super::solve) gives it; `sigma` is the claimed
/// one, [`Pose::sigma_position`] unless more is known of it, as for places that [err
/// together](crate::dead_reckoning::correlate). `dropped` sightings do not count; an empty slice drops none.
///
/// The figures are of random scenes near the danger circle and among clustered targets. Poses that claim less
/// than a tenth of the range and are more than four sigmas off have an alternative in 99 % of cases; right
/// ones in one of a thousand (`tests/it/alternative.rs`).
///
/// # Example
/// ```
/// # use calib_core::{resection, Ray, Sighting};
/// # use nalgebra::Point2;
/// // Three targets close to each other: whether it is 5 units from them or 15 hardly shows.
/// let (camera, heading) = (Point2::new(0.0, 0.0), 0.0);
/// let sightings = [(5.0, 0.0), (5.0, 0.2), (5.3, 0.1)].map(|(x, y)| {
///     let target = Point2::new(x, y);
///     Sighting::new(target, Ray::towards(camera, heading, target), 0.01)
/// });
/// let pose = resection::solve(&sightings)?.pose;
/// assert!(resection::alternative(&sightings, &[], &pose, pose.sigma_position()).is_some());
/// # Ok::<(), calib_core::Refusal>(())
/// ```
pub fn alternative<T: Real>(
    sightings: &[Sighting<T>],
    dropped: &[bool],
    pose: &Pose<T>,
    sigma: T,
) -> Option<Point2<T>> {
    let circle = Circle {
        sightings,
        dropped,
        centre: pose.position,
        radius: sigma * lit(FAR),
    };
    let own_sigma = pose.sigma_position();
    if let Some(beside) = kept(sightings, dropped).find(|s| {
        let away = s.target - pose.position;
        dot(away, away) < own_sigma * own_sigma
    }) {
        return Some(beside.target);
    }
    let along = weakest_direction(pose);
    let limit = circle.look(pose.position, along).cost + lit(RISE);
    [along, -along]
        .into_iter()
        .find_map(|start| circle.below(limit, start))
}

/// Places at one distance from a pose, in all directions.
struct Circle<'a, T: Real> {
    sightings: &'a [Sighting<T>],
    dropped: &'a [bool],
    centre: Point2<T>,
    radius: T,
}

/// The cost of a place with the best heading there, and how it changes around the circle.
struct View<T> {
    cost: T,
    /// Half the derivative by the angle.
    gradient: T,
    /// Half the second derivative, by Gauss and Newton.
    curvature: T,
}

impl<T: Real> Circle<'_, T> {
    /// A place on the circle whose cost is below the limit, from a direction downhill.
    fn below(&self, limit: T, mut direction: Vector2<T>) -> Option<Point2<T>> {
        let longest = lit(LONGEST_STEP);
        for _ in 0..LOOKS {
            let place = self.centre + direction * self.radius;
            let across = quarter_turn(direction);
            let view = self.look(place, across * self.radius);
            if view.cost < limit {
                return Some(place);
            }
            let step = (-view.gradient / view.curvature).min(longest).max(-longest);
            let next = direction + across * step;
            direction = next / root(dot(next, next));
        }
        None
    }

    /// The derivatives are those by a move along the tangent.
    #[inline(never)] // for less flash
    fn look(&self, place: Point2<T>, tangent: Vector2<T>) -> View<T> {
        let [mut w, mut r, mut s, mut rr, mut rs, mut ss] = [T::zero(); 6];
        let mut first = None;
        for sighting in kept(self.sightings, self.dropped) {
            let to_target = sighting.target - place;
            let row = Row::new(sighting, to_target);
            // The heading that this sighting alone asks for, against that of the first one.
            let heading = mul_conj(to_target, sighting.ray.vector());
            let reference = *first.get_or_insert(heading);
            let residual = cross(reference, heading).atan2(dot(reference, heading));
            let slope = dot(row.slope.xy(), tangent);
            w += row.weight;
            r += row.weight * residual;
            s += row.weight * slope;
            rr += row.weight * residual * residual;
            rs += row.weight * residual * slope;
            ss += row.weight * slope * slope;
        }
        // Less the part that the best heading explains.
        View {
            cost: rr - r * r / w,
            gradient: rs - r * s / w,
            curvature: ss - s * s / w,
        }
    }
}

/// The unit vector along which the place is least certain.
fn weakest_direction<T: Real>(pose: &Pose<T>) -> Vector2<T> {
    let c = &pose.covariance;
    let half = (c.m11 - c.m22) * lit(0.5);
    let radius = root(half * half + c.m12 * c.m12);
    // The one of the two vectors along it that is no small difference.
    let along = if half >= T::zero() {
        Vector2::new(half + radius, c.m12)
    } else {
        Vector2::new(c.m12, radius - half)
    };
    let length = root(dot(along, along));
    if length > T::zero() {
        along / length
    } else {
        Vector2::new(T::one(), T::zero())
    }
}
