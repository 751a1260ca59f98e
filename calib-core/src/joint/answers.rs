//! What a solve says, with covariances, from the triangle of its last pass.

use nalgebra::{Point2, SMatrix};

use super::{
    Carrier, Lens, ReferenceHeadings, StopPlace,
    problem::{COMPASS, Columns, HEADINGS, HELD, Problem, SCALE, Standing, Stop},
    residuals::UNCHECKED,
    sweep::Without,
    triangle::Triangle,
};
use crate::{
    Pose, Real, Refusal, angle,
    numerics::real::{lit, root},
};

/// Sigmas of belief and estimate together beyond which a lens is not what it was said to be.
const WRONG_LENS: f64 = 4.0;

impl<T: Real> Problem<'_, T> {
    /// Where a camera stands and looks.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] for one that waits; [`Refusal::Undetermined`].
    pub(super) fn pose(&mut self, camera: usize) -> Result<Pose<T>, Refusal> {
        let value = self.camera(camera).ok_or(Refusal::TooFew)?;
        let mut pose = Pose {
            position: Point2::from(value.xy()),
            heading: angle::wrap_positive(value.z),
            covariance: SMatrix::zeros(),
        };
        let Columns { place, heading, .. } = self.columns(camera).ok_or(Refusal::TooFew)?;
        match place {
            Some(x) => pose.covariance = self.covariance([x, x + 1, heading])?,
            None => pose.covariance.m33 = self.covariance([heading])?.x,
        }
        Ok(pose)
    }

    /// What a camera's lens is.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] for a camera without a pose, and where lenses are not estimated;
    /// [`Refusal::Undetermined`].
    pub(super) fn lens(&mut self, camera: usize) -> Result<Lens<T>, Refusal> {
        let columns = self.columns(camera).ok_or(Refusal::TooFew)?;
        let (column, prior) =
            { columns.lens.zip(self.common.lens_prior) }.ok_or(Refusal::TooFew)?;
        let error = { self.cameras.get(camera) }.map_or_else(T::zero, |camera| camera.value.w);
        let variance = self.covariance([column])?.x;
        // What the bearings alone say differs from the prior by this much; nothing if they say nothing.
        let told = prior * prior - variance;
        let is_told = told > prior * prior * lit(UNCHECKED);
        Ok(Lens {
            scale: error + T::one(),
            sigma: root(variance),
            off: if is_told {
                error / root(told)
            } else {
                T::zero()
            },
        })
    }

    /// Where a stop is. A pass for another stop than the one asked for last.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] where there is no such stop; [`Refusal::Undetermined`].
    pub(super) fn place(&mut self, stop: usize) -> Result<StopPlace<T>, Refusal> {
        let position = self.stops.get(stop).ok_or(Refusal::TooFew)?.place;
        self.hold(stop).ok_or(Refusal::Undetermined)?;
        let covariance = self.covariance([HELD, HELD + 1])?;
        Ok(StopPlace {
            position,
            covariance,
        })
    }

    pub(super) fn carrier(&mut self) -> Result<Carrier<T>, Refusal> {
        Ok(Carrier {
            scale: self.common.carrier.x,
            compass: self.common.carrier.y,
            covariance: self.covariance([SCALE, COMPASS])?,
        })
    }

    pub(super) fn reference_headings(&mut self) -> Result<ReferenceHeadings<T>, Refusal> {
        let heading = |n: usize| {
            let reference = self.cameras.get(n);
            reference.map_or_else(T::zero, |camera| angle::wrap_positive(camera.value.z))
        };
        Ok(ReferenceHeadings {
            headings: [heading(0), heading(1)],
            covariance: self.covariance([HEADINGS, HEADINGS + 1])?,
        })
    }

    /// Makes the triangle hold a stop.
    pub(super) fn hold(&mut self, stop: usize) -> Option<()> {
        if self.common.held != Some(stop) {
            self.sweep(stop, Without::Nothing)?;
        }
        Some(())
    }

    /// The covariance of up to three unknowns, by their columns.
    #[inline(never)] // for less flash
    fn covariance<const N: usize>(
        &mut self,
        columns: [usize; N],
    ) -> Result<SMatrix<T, N, N>, Refusal> {
        let determined = |(triangle, mut vectors): (Triangle<'_, T>, [&mut [T]; 3])| {
            for (vector, column) in vectors.iter_mut().zip(columns) {
                vector.fill(T::zero());
                *vector.get_mut(column)? = T::one();
                triangle.forward_substitute(vector)?;
            }
            let mut covariance = SMatrix::<T, N, N>::zeros();
            for (j, a) in vectors.iter().enumerate().take(N) {
                for (i, b) in vectors.iter().enumerate().take(N) {
                    *covariance.get_mut((i, j))? = dot(a, b);
                }
            }
            Some(covariance)
        };
        let covariance = self.triangle().and_then(determined);
        covariance.ok_or(Refusal::Undetermined)
    }

    /// Measurements beyond the unknowns.
    pub(super) fn redundancy(&self) -> usize {
        let sights = self
            .sights
            .iter()
            .filter(|sight| sight.standing == Standing::Counts && self.sight_row(sight).is_some());
        let legs = (1..self.stops.len()).filter(|&stop| {
            let counts = |stop: &Stop<T>| stop.standing == Standing::Counts;
            self.stops.get(stop).is_some_and(counts) && self.leg_rows(stop).is_some()
        });
        // The carrier's priors are as many as its unknowns.
        let rows = sights.count() + 2 * (legs.count() + self.visits.len());
        let cameras = self.cameras.iter().filter(|c| c.column.is_some()).count();
        let marks = self.marks.iter().filter(|m| m.column.is_some()).count();
        let unknowns = 2 * (self.stops.len() + marks) + 3 * cameras + 2;
        rows.saturating_sub(unknowns)
    }
}

pub(super) fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    a.iter().zip(b).fold(T::zero(), |sum, (a, b)| sum + *a * *b)
}

impl<T: Real> Lens<T> {
    /// Whether it is so far off what was believed that it is another lens, or another projection:
    /// more than four sigmas.
    pub fn is_wrong(&self) -> bool {
        !(self.off.abs() <= lit(WRONG_LENS))
    }
}

impl<T: Real> StopPlace<T> {
    /// Standard deviation of the place: the expected rms distance to the truth.
    pub fn sigma(&self) -> T {
        root(self.covariance.m11 + self.covariance.m22)
    }
}

impl<T: Real> Carrier<T> {
    /// Standard deviation of the scale.
    pub fn sigma_scale(&self) -> T {
        root(self.covariance.m11)
    }

    /// Standard deviation of the compass offset, radians.
    pub fn sigma_compass(&self) -> T {
        root(self.covariance.m22)
    }
}

impl<T: Real> ReferenceHeadings<T> {
    /// Standard deviations of both headings, radians.
    pub fn sigmas(&self) -> [T; 2] {
        [self.covariance.m11, self.covariance.m22].map(root)
    }
}
