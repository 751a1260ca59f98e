//! Least squares of a pose in space and its lens to the pixels.

use nalgebra::{SMatrix, SVector, Vector3};

use super::{Lens, Pose, Priors, Sighting};
use crate::{
    Real, Refusal,
    angle::wrap_signed,
    numerics::{
        cholesky::Cholesky,
        real::{lit, root},
    },
};

/// x, y, z, heading, pitch, roll; factor of the focal length, k1, k2.
const UNKNOWNS: usize = 9;

type Vector<T> = SVector<T, UNKNOWNS>;
type Square<T> = SMatrix<T, UNKNOWNS, UNKNOWNS>;

/// Most rounds of an adjustment.
const ROUNDS: usize = 60;

/// A camera's sightings with what is told beforehand.
#[derive(Clone, Copy)]
pub(super) struct Problem<'a, T: Real> {
    pub(super) sightings: &'a [Sighting<T>],
    pub(super) lens: &'a Lens<T>,
    pub(super) priors: &'a Priors<T>,
}

/// A minimum.
#[derive(Clone, Copy)]
pub(super) struct Adjusted<T: Real> {
    pub(super) pose: Pose<T>,
    pub(super) lens: Vector3<T>,
    pub(super) covariance: Square<T>,
    pub(super) chi_squared: T,
}

impl<T: Real> Adjusted<T> {
    pub(super) fn lens_sigmas(&self) -> Vector3<T> {
        self.covariance.diagonal().fixed_rows::<3>(6).map(root)
    }
}

/// Values of all unknowns.
#[derive(Clone, Copy)]
pub(super) struct Values<T: Real> {
    pub(super) pose: Pose<T>,
    pub(super) lens: Vector3<T>,
}

impl<T: Real> Values<T> {
    fn plus(&self, step: &Vector<T>) -> Self {
        let mut next = *self;
        next.pose.position += step.fixed_rows::<3>(0);
        next.pose.heading = wrap_signed(next.pose.heading + step[3]);
        next.pose.pitch = wrap_signed(next.pose.pitch + step[4]);
        next.pose.roll = wrap_signed(next.pose.roll + step[5]);
        next.lens += step.fixed_rows::<3>(6);
        next
    }
}

/// A sighting's residual at some values.
pub(super) struct Row<T: Real> {
    pub(super) residual: SVector<T, 2>,
    pub(super) by_unknowns: SMatrix<T, 2, UNKNOWNS>,
    weight: SMatrix<T, 2, 2>,
}

/// The sum of squares near some values.
struct Model<T: Real> {
    hessian: Square<T>,
    gradient: Vector<T>,
}

impl<T: Real> Problem<'_, T> {
    /// The lens as it was told, as unknowns.
    pub(super) fn told_lens(&self) -> Vector3<T> {
        let k = &self.lens.distortion;
        Vector3::new(T::one(), k.x, k.y)
    }

    /// A sighting's residual; `None` where the camera would not see the target.
    pub(super) fn row(&self, values: &Values<T>, sighting: &Sighting<T>) -> Option<Row<T>> {
        let axes = values.pose.axes();
        let off = sighting.target - values.pose.position;
        let seen = axes * off;
        let picture = self.lens.with(&values.lens).picture(&seen)?;
        let (sr, cr) = values.pose.roll.sine_cosine();
        let turned = axes * Vector3::new(off.y, -off.x, T::zero());
        let pitched = Vector3::new(-(sr * seen.y + cr * seen.z), sr * seen.x, cr * seen.x);
        let rolled = Vector3::new(T::zero(), seen.z, -seen.y);
        let by_target = picture.by_direction * axes;
        let mut by_unknowns = SMatrix::<T, 2, UNKNOWNS>::zeros();
        by_unknowns.fixed_columns_mut::<3>(0).copy_from(&-by_target);
        for (column, turn) in [(3, turned), (4, pitched), (5, rolled)] {
            by_unknowns.set_column(column, &(picture.by_direction * turn));
        }
        // The factor is of the told focal length, the derivative by that of the present one.
        let focal = picture.by_lens.column(0) / values.lens.x;
        let parts = [
            focal,
            picture.by_lens.column(1).into_owned(),
            picture.by_lens.column(2).into_owned(),
        ];
        for ((column, part), sigma) in (6..).zip(&parts).zip(&self.lens.sigmas) {
            if *sigma > T::zero() {
                by_unknowns.set_column(column, part);
            }
        }
        let spread = by_target * SMatrix::from_diagonal(&sighting.target_sigma);
        let noise = sighting.pixel_sigma * sighting.pixel_sigma;
        let covariance =
            spread * spread.transpose() + SMatrix::<T, 2, 2>::from_diagonal_element(noise);
        Some(Row {
            residual: picture.pixel - sighting.pixel,
            by_unknowns,
            weight: covariance.try_inverse()?,
        })
    }

    /// Deviations from what was told, each with its sigma; by the number of the unknown.
    fn deviations(&self, values: &Values<T>) -> [Option<(usize, T, T)>; 6] {
        let [height, pitch, roll] = self.priors.all();
        let lens = values.lens - self.told_lens();
        let sigmas = &self.lens.sigmas;
        let free = |n, off, sigma: T| (sigma > T::zero()).then_some((n, off, sigma));
        let pose = &values.pose;
        [
            height.map(|told| (2, pose.position.z - told.value, told.sigma)),
            pitch.map(|told| (4, wrap_signed(pose.pitch - told.value), told.sigma)),
            roll.map(|told| (5, wrap_signed(pose.roll - told.value), told.sigma)),
            free(6, lens.x, sigmas.x),
            free(7, lens.y, sigmas.y),
            free(8, lens.z, sigmas.z),
        ]
    }

    /// The sum of squares at some values, with the weights at others.
    fn chi_squared(&self, values: &Values<T>, weights_at: &Values<T>) -> Option<T> {
        let mut sum = T::zero();
        for sighting in self.sightings {
            let weight = self.row(weights_at, sighting)?.weight;
            let off = self
                .lens
                .with(&values.lens)
                .pixel(&(values.pose.axes() * (sighting.target - values.pose.position)))?
                - sighting.pixel;
            sum += (weight * off).dot(&off);
        }
        for (_, off, sigma) in self.deviations(values).into_iter().flatten() {
            sum += (off / sigma) * (off / sigma);
        }
        sum.is_finite().then_some(sum)
    }

    fn model(&self, values: &Values<T>) -> Option<(Model<T>, T)> {
        let mut hessian = Square::<T>::zeros();
        let mut gradient = Vector::<T>::zeros();
        let mut sum = T::zero();
        for sighting in self.sightings {
            let row = self.row(values, sighting)?;
            let weighted = row.by_unknowns.transpose() * row.weight;
            hessian += weighted * row.by_unknowns;
            gradient += weighted * row.residual;
            sum += (row.weight * row.residual).dot(&row.residual);
        }
        for (n, off, sigma) in self.deviations(values).into_iter().flatten() {
            let weight = (sigma * sigma).recip();
            add(&mut hessian, n, weight);
            if let Some(entry) = gradient.get_mut(n) {
                *entry += off * weight;
            }
            sum += off * off * weight;
        }
        // What is exact takes no part.
        for (n, sigma) in (6..).zip(&self.lens.sigmas) {
            if *sigma <= T::zero() {
                add(&mut hessian, n, T::one());
            }
        }
        sum.is_finite()
            .then_some((Model { hessian, gradient }, sum))
    }

    /// The minimum that a start leads to (Levenberg and Marquardt).
    pub(super) fn adjust(&self, start: &Pose<T>, lens: Vector3<T>) -> Result<Adjusted<T>, Refusal> {
        let mut values = Values { pose: *start, lens };
        let mut damping = lit::<T>(1e-3);
        for _ in 0..ROUNDS {
            let (model, now) = self.model(&values).ok_or(Refusal::TargetBehind)?;
            let Some((step, gain)) = model.step(damping) else {
                damping *= lit(10.0);
                continue;
            };
            let next = values.plus(&step);
            // Less than a hundredth of a sigma is left.
            let small = lit::<T>(1e-4) * (T::one() + now * lit(1e-3));
            let settles = gain < small && damping <= lit(1e-3);
            match self.chi_squared(&next, &values) {
                Some(sum) if settles || sum < now => {
                    values = next;
                    damping *= lit(0.1);
                }
                _ if damping > lit(1e8) => return Err(Refusal::DidNotConverge),
                _ => damping = (damping * lit(10.0)).max(lit(1e-4)),
            }
            if settles {
                return self.at(&values);
            }
        }
        Err(Refusal::DidNotConverge)
    }

    /// Chi squared and covariance at a minimum.
    fn at(&self, values: &Values<T>) -> Result<Adjusted<T>, Refusal> {
        let (model, chi_squared) = self.model(values).ok_or(Refusal::TargetBehind)?;
        let mut covariance = model.covariance().ok_or(Refusal::Undetermined)?;
        for (n, sigma) in (6..).zip(&self.lens.sigmas) {
            if *sigma <= T::zero()
                && let Some(entry) = covariance.get_mut((n, n))
            {
                *entry = T::zero();
            }
        }
        let (pose, is_over) = values.pose.normalised();
        // A camera upside down would meet what is told of its roll or pitch in numbers only.
        if is_over && (self.priors.roll.is_some() || self.priors.pitch.is_some()) {
            return Err(Refusal::DidNotConverge);
        }
        Ok(Adjusted {
            pose,
            lens: values.lens,
            covariance,
            chi_squared,
        })
    }
}

/// Adds to an entry of the diagonal.
fn add<T: Real>(matrix: &mut Square<T>, n: usize, what: T) {
    if let Some(entry) = matrix.get_mut((n, n)) {
        *entry += what;
    }
}

impl<T: Real> Model<T> {
    /// The matrix with ones on its diagonal, and the scale of each unknown.
    fn scaled(&self, damping: T) -> (Square<T>, Vector<T>) {
        let scale = self.hessian.diagonal().map(|square| root(square).recip());
        let mut matrix = self.hessian.component_mul(&(scale * scale.transpose()));
        for n in 0..UNKNOWNS {
            add(&mut matrix, n, damping);
        }
        (matrix, scale)
    }

    /// A damped step, and how much its linear part gains.
    fn step(&self, damping: T) -> Option<(Vector<T>, T)> {
        let (matrix, scale) = self.scaled(damping);
        let gradient = self.gradient.component_mul(&scale);
        let step = -Cholesky::new(matrix)?.solve(&gradient);
        let gain = -gradient.dot(&step);
        Some((step.component_mul(&scale), gain))
    }

    fn covariance(&self) -> Option<Square<T>> {
        let (matrix, scale) = self.scaled(T::zero());
        let factor = Cholesky::new(matrix)?;
        let least = lit::<T>(8.0) * T::default_epsilon();
        if factor
            .diagonal()
            .iter()
            .any(|pivot| !(*pivot * *pivot > least))
        {
            return None;
        }
        Some(factor.inverse().component_mul(&(scale * scale.transpose())))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector2};

    use super::*;
    use crate::camera::Projection;

    #[test]
    fn derivatives_are_those_of_differences() {
        for projection in [Projection::PinHole, Projection::EqualAngle] {
            let lens = Lens {
                projection,
                focal: Vector2::new(270.0, 300.0),
                principal: Vector2::new(157.0, 104.0),
                distortion: Vector2::new(-0.2, 0.05),
                sigmas: Vector3::repeat(0.1),
            };
            let sighting = Sighting {
                target: Point3::new(3.0, 1.0, 0.2),
                target_sigma: Vector3::repeat(0.01),
                pixel: Vector2::new(150.0, 90.0),
                pixel_sigma: 0.3,
            };
            let problem = Problem {
                sightings: &[sighting],
                lens: &lens,
                priors: &Priors::default(),
            };
            let values = Values {
                pose: Pose {
                    position: Point3::new(0.1, -0.2, 1.7),
                    heading: 0.5_f64,
                    pitch: 0.4,
                    roll: -0.3,
                },
                lens: Vector3::new(1.05, -0.18, 0.04),
            };
            let row = problem.row(&values, &sighting).unwrap();
            for n in 0..UNKNOWNS {
                let step = Vector::<f64>::ith(n, 1e-6);
                let at = |step| {
                    problem
                        .row(&values.plus(&step), &sighting)
                        .unwrap()
                        .residual
                };
                let difference = (at(step) - at(-step)) / 2e-6;
                let error = (row.by_unknowns.column(n) - difference).norm();
                assert!(
                    error < 1e-6 * (1.0 + difference.norm()),
                    "{projection:?} {n}: {error:e}"
                );
            }
        }
    }
}
