//! Any number of sightings: weighted least squares on the wrapped bearing residuals.

use nalgebra::{Point2, Vector3};

use super::{
    Solution,
    information::{Row, kept},
    three_point,
};
use crate::{
    Pose, Real, Refusal, Sighting,
    numerics::{
        angle,
        minimize::{Descent, Method, Problem, Quadratic},
        ranking::Ranking,
        subsets,
    },
};

/// Iterations after which a start is given up. From a closed-form start, four are usual.
const ITERATION_LIMIT: usize = 30;
/// The sightings that count, and the unknowns `(x, y, heading)`.
struct Bearings<'a, T: Real> {
    sightings: &'a [Sighting<T>],
    dropped: &'a [bool],
}

/// One sighting against one pose.
struct Comparison<T: Real> {
    /// World bearing of the target minus that of the ray, wrapped by construction.
    residual: T,
    /// One over the residual's variance.
    weight: T,
    /// Derivatives of the residual by x, y, heading.
    slope: Vector3<T>,
}

fn compare<T: Real>(sighting: &Sighting<T>, position: Point2<T>, heading: T) -> Comparison<T> {
    let to_target = sighting.target - position;
    let Row { slope, weight } = Row::new(sighting, to_target);
    Comparison {
        residual: sighting.ray.residual(heading, to_target),
        weight,
        slope,
    }
}

/// Squared distance of a sighting from a pose, in sigmas.
pub(super) fn squared_sigmas<T: Real>(sighting: &Sighting<T>, pose: &Pose<T>) -> T {
    let c = compare(sighting, pose.position, pose.heading);
    c.residual * c.residual * c.weight
}

impl<T: Real> Bearings<'_, T> {
    fn kept(&self) -> impl Iterator<Item = &Sighting<T>> {
        kept(self.sightings, self.dropped)
    }

    /// Of the residuals at `x`, with the weights at `weights_at`.
    fn sums(&self, x: &[T], weights_at: &[T]) -> Sums<T> {
        let ((position, heading), (position_then, _)) = (pose(x), pose(weights_at));
        let mut sums = Sums {
            weight: T::zero(),
            residual: T::zero(),
            cost: T::zero(),
        };
        for sighting in self.kept() {
            let weight = Row::new(sighting, sighting.target - position_then).weight;
            let residual = sighting.ray.residual(heading, sighting.target - position);
            sums.weight += weight;
            sums.residual += residual * weight;
            sums.cost += residual * residual * weight;
        }
        sums
    }
}

/// Weighted sums over the sightings that count.
struct Sums<T> {
    weight: T,
    residual: T,
    /// Of the squared residuals.
    cost: T,
}

impl<T: Real> Problem<T> for Bearings<'_, T> {
    fn model(&self, x: &[T], model: &mut Quadratic<'_, T>) {
        let (position, heading) = pose(x);
        for sighting in self.kept() {
            let c = compare(sighting, position, heading);
            model.add(c.residual, c.slope.as_slice(), c.weight);
        }
    }

    fn cost(&self, x: &[T], weights_at: &[T]) -> T {
        self.sums(x, weights_at).cost
    }

    fn last_settles(&self) -> bool {
        true
    }

    /// The heading turns by the mean of the residuals. Stops nearly on one line leave a valley along
    /// which it turns with the place.
    fn settled(&self, x: &mut [T], weights_at: &[T]) -> T {
        let Sums {
            weight,
            residual,
            cost,
        } = self.sums(x, weights_at);
        let turn = residual / weight;
        if let [_, _, heading] = x {
            *heading += turn;
        }
        cost - residual * turn
    }
}

/// The unknowns by name.
fn pose<T: Real>(x: &[T]) -> (Point2<T>, T) {
    match *x {
        [x, y, heading] => (Point2::new(x, y), heading),
        _ => {
            debug_assert!(false, "the unknowns of another problem");
            (Point2::origin(), T::zero())
        }
    }
}

/// Least squares from a start, over the sightings not dropped (an empty slice drops none).
///
/// # Errors
/// [`Refusal::DidNotConverge`]; [`Refusal::TargetBehind`]; [`Refusal::Undetermined`].
pub(super) fn refine<T: Real>(
    sightings: &[Sighting<T>],
    dropped: &[bool],
    start: &Pose<T>,
) -> Result<Solution<T>, Refusal> {
    let problem = Bearings { sightings, dropped };
    let start = Vector3::new(start.position.x, start.position.y, start.heading);
    let mut walk = Descent::new(start);
    let iterations = walk.run(&problem, Method::Levenberg, ITERATION_LIMIT)?;
    let (position, heading) = (Point2::from(walk.x.xy()), walk.x.z);
    let covariance = walk.covariance().ok_or(Refusal::Undetermined)?;
    let quarter = T::frac_pi_2();
    if problem
        .kept()
        .any(|s| !(compare(s, position, heading).residual.abs() < quarter))
    {
        return Err(Refusal::TargetBehind);
    }
    Ok(Solution {
        pose: Pose {
            position,
            heading: angle::wrap_positive(heading),
            covariance,
        },
        used: problem.kept().count(),
        chi_squared: walk.cost,
        iterations,
    })
}

/// The triples that [`subsets::triples`] picks.
pub(super) fn triples<T: Real>(
    sightings: &[Sighting<T>],
) -> impl Iterator<Item = [Sighting<T>; 3]> + '_ {
    subsets::triples(sightings.len())
        .filter_map(|[i, j, k]| Some([*sightings.get(i)?, *sightings.get(j)?, *sightings.get(k)?]))
}

/// Least squares over all sightings, from the triple whose pose explains all of them best; if that fails,
/// from the next best ones.
///
/// Best is the least sum of absolute residuals: a triple in poor geometry, or with a wild
/// sighting in it, predicts the others badly. Its own predicted sigma would be a bad judge, since
/// noise that puts the camera right beside a target makes it small.
///
/// # Errors
/// The reason why the triples were refused, if all were; otherwise why the last start failed.
pub(super) fn solve<T: Real>(sightings: &[Sighting<T>]) -> Result<Solution<T>, Refusal> {
    let mut starts = Ranking::<_, _, 3>::new();
    let mut refusal = None;
    for triple in triples(sightings) {
        match three_point::solve(&triple) {
            Ok(pose) => {
                if let Some(residuals) = sum_of_residuals(sightings, &pose, starts.limit()) {
                    starts.offer(residuals, pose);
                }
            }
            // A place seen twice spoils its own triples only: a better reason may follow.
            Err(why) if refusal.is_none_or(|r| r == Refusal::CoincidentTargets) => {
                refusal = Some(why);
            }
            Err(_) => {}
        }
    }
    let mut result = Err(refusal.unwrap_or(Refusal::TooFew));
    for start in starts.iter() {
        result = refine(sightings, &[], start);
        if result.is_ok() {
            break;
        }
    }
    result
}

/// In sigmas; `None` as soon as it reaches the limit.
fn sum_of_residuals<T: Real>(
    sightings: &[Sighting<T>],
    pose: &Pose<T>,
    limit: Option<T>,
) -> Option<T> {
    let mut sum = T::zero();
    for sighting in sightings {
        sum += squared_sigmas(sighting, pose).sqrt();
        if limit.is_some_and(|limit| sum >= limit) {
            return None;
        }
    }
    Some(sum)
}
