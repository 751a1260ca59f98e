//! Answers of a solve, with covariances.

use core::task::Poll;

use nalgebra::{Matrix2, Point2, SMatrix};

use super::{
    Carrier, Lens, ReferenceHeadings, StopPlace,
    covariance::{Block, pose_of},
    problem::{HEADING, LENS, Problem, SCALE, STOPS, Standing, Stop, Told, Unknown},
    residuals::UNCHECKED,
};
use crate::{
    Pose, Real, Refusal, angle,
    level::{self, Levelness, Mounting},
    numerics::real::{lit, root},
};

/// Sigmas of belief and estimate together beyond which a lens is not the stated one.
const WRONG_LENS: f64 = 4.0;

impl<T: Real> Problem<'_, T> {
    /// Pose of a camera.
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
        let block = self.block(camera)?;
        if self.axes(camera).start == HEADING {
            let [[heading, ..], ..] = block;
            pose.covariance.m33 = heading;
        } else {
            pose.covariance = pose_of(&block);
        }
        if camera == 1 {
            // Nothing is across the x axis.
            let c = &mut pose.covariance;
            let zero = T::zero();
            (c.m12, c.m21, c.m22, c.m23, c.m32) = (zero, zero, zero, zero, zero);
        }
        Ok(pose)
    }

    /// The same with the error of a scale that sets all lengths.
    pub(super) fn told_pose(&mut self, camera: usize) -> Result<Pose<T>, Refusal> {
        let mut pose = self.pose(camera)?;
        let by_scale = self.scale_error(pose.position);
        let c = &mut pose.covariance;
        c.m11 += by_scale.m11;
        c.m12 += by_scale.m12;
        c.m21 += by_scale.m21;
        c.m22 += by_scale.m22;
        Ok(pose)
    }

    /// Covariance of a place by the error of a scale that sets all lengths.
    #[inline(never)] // for less flash
    fn scale_error(&self, at: Point2<T>) -> Matrix2<T> {
        let common = &self.common;
        if common.is_baseline_known {
            return Matrix2::zeros();
        }
        let off = at.coords * (common.scale_prior.sigma / common.scale_prior.mean);
        off * off.transpose()
    }

    /// The mounting of a camera, whose covariances are larger than told by `inflation`.
    pub(super) fn levelness(&mut self, camera: usize, inflation: T) -> Option<Levelness<T>> {
        let mut pose = self.pose(camera).ok()?;
        pose.covariance *= inflation;
        let mounting = self.cameras.get(camera)?.mounting;
        let (rows, count) = self.rows(camera);
        let rows = rows.get(..count)?;
        level::judge(&pose, rows, mounting, &self.tolerance())
    }

    /// Returns true if rows of a reference contradict any mounting: no pose of its frame is right.
    pub(super) fn is_frame_refused(&mut self, inflation: T) -> bool {
        (0..2).any(|reference| {
            let levelness = self.levelness(reference, inflation);
            levelness.is_some_and(|levelness| levelness.is_refused())
        })
    }

    /// Takes both references for ones that look down by this, radians. Returns false where no rows would tell.
    pub(super) fn pitch_references(&mut self, pitch: T) -> bool {
        let rows_tell =
            self.common.tilt > T::zero() && (0..2).all(|camera| self.rows(camera).1 > 0);
        if rows_tell {
            for camera in self.cameras.iter_mut().take(2) {
                camera.mounting = Mounting {
                    pitch,
                    roll: T::zero(),
                };
            }
        }
        rows_tell
    }

    /// Takes better mountings of all cameras that are not level. Returns true if there were any: all is to be solved again.
    pub(super) fn improve_mountings(&mut self) -> bool {
        let mut is_better = false;
        if !(self.common.tilt > T::zero()) {
            return false;
        }
        for camera in 0..self.cameras.len() {
            let Ok(pose) = self.pose(camera) else {
                continue;
            };
            let Some(mounting) = self.cameras.get(camera).map(|camera| camera.mounting) else {
                continue;
            };
            let (rows, count) = self.rows(camera);
            let rows = rows.get(..count).unwrap_or_default();
            let better = level::improved(&pose, rows, mounting, &self.tolerance());
            if let (Some(better), Some(unknown)) = (better, self.cameras.get_mut(camera)) {
                unknown.mounting = if camera < 2 {
                    mounting.towards(&better)
                } else {
                    better
                };
                is_better = true;
            }
        }
        if is_better {
            self.common.told = Told::Nothing;
        }
        is_better
    }

    /// Lens of a camera.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] for a camera without a pose, and where lenses are not estimated;
    /// [`Refusal::Undetermined`].
    pub(super) fn lens(&mut self, camera: usize) -> Result<Lens<T>, Refusal> {
        let unknown = self.cameras.get(camera);
        let unknown = unknown.filter(|_| self.is_estimated(camera));
        let (unknown, prior) = unknown
            .zip(self.common.optics.lens)
            .ok_or(Refusal::TooFew)?;
        let error = unknown.lens();
        let place = LENS.saturating_sub(self.axes(camera).start);
        let block = self.block(camera)?;
        let variance = { block.get(place) }.and_then(|row| row.get(place).copied());
        let variance = variance.ok_or(Refusal::Undetermined)?;
        // By so much the result of the bearings alone differs from the prior; nothing if they say nothing.
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

    /// Place of a stop.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] where there is no such stop; [`Refusal::Undetermined`].
    pub(super) fn place(&mut self, stop: usize) -> Result<StopPlace<T>, Refusal> {
        let known = self.stops.get(stop).ok_or(Refusal::TooFew)?;
        let (position, is_undetermined) = (known.place, known.is_undetermined);
        self.tell()?;
        let covariance = self.pair_covariance(STOPS + 2 * stop);
        let covariance = covariance.filter(|_| !is_undetermined);
        let covariance = covariance.ok_or(Refusal::Undetermined)?;
        Ok(StopPlace {
            position,
            covariance: covariance + self.scale_error(position),
        })
    }

    pub(super) fn carrier(&mut self) -> Result<Carrier<T>, Refusal> {
        self.tell()?;
        let covariance = self.pair_covariance(SCALE);
        let covariance = covariance.filter(|_| !self.common.is_carrier_undetermined);
        let mut covariance = covariance.ok_or(Refusal::Undetermined)?;
        let mut scale = self.common.carrier.x;
        if !self.common.is_baseline_known {
            let prior = self.common.scale_prior;
            scale = prior.mean;
            covariance.m11 = prior.sigma * prior.sigma;
        }
        Ok(Carrier {
            scale,
            compass: self.common.carrier.y,
            covariance,
        })
    }

    pub(super) fn reference_headings(&mut self) -> Result<ReferenceHeadings<T>, Refusal> {
        let heading = |n: usize| {
            let reference = self.cameras.get(n);
            reference.map_or_else(T::zero, |camera| angle::wrap_positive(camera.heading()))
        };
        let headings = [heading(0), heading(1)];
        let [[first, ..], ..] = self.block(0)?;
        let second = self.pose(1)?.covariance.m33;
        let [with, ..] = self.camera_covariance(0, 1).ok_or(Refusal::Undetermined)?;
        let with = with.get(HEADING.saturating_sub(self.axes(1).start));
        let with = *with.ok_or(Refusal::Undetermined)?;
        Ok(ReferenceHeadings {
            headings,
            covariance: Matrix2::new(first, with, with, second),
        })
    }

    /// A slice of the way to covariances. Returns true where none is left: they are there, or there are none.
    #[inline(never)] // for less flash
    pub(super) fn has_told(&mut self) -> bool {
        loop {
            if self.common.told == Told::Covariances || self.find_covariances() == Poll::Ready(None)
            {
                return true;
            }
            if !self.is_small() {
                return false;
            }
        }
    }

    /// Makes covariances ready.
    #[inline(never)] // for less flash
    pub(super) fn tell(&mut self) -> Result<(), Refusal> {
        while !self.has_told() {}
        if self.common.told == Told::Covariances {
            Ok(())
        } else {
            Err(Refusal::Undetermined)
        }
    }

    /// The covariance of a camera's unknowns.
    fn block(&mut self, camera: usize) -> Result<Block<T>, Refusal> {
        if !self.is_estimated(camera) {
            return Err(Refusal::TooFew);
        }
        self.tell()?;
        let is_determined = |unknown: &Unknown<T>| !unknown.is_undetermined;
        if !self.cameras.get(camera).is_some_and(is_determined) {
            return Err(Refusal::Undetermined);
        }
        self.camera_covariance(camera, camera)
            .ok_or(Refusal::Undetermined)
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
        // The carrier's priors are as many as its unknowns and the baseline.
        let rows = sights.count() + 2 * (legs.count() + self.visits.len());
        let cameras = self.cameras.iter().filter(|c| c.takes_part).count();
        let is_visited = |mark| self.visits.iter().any(|visit| visit.mark == mark);
        let marks = (0_u16..)
            .take(self.marks.len())
            .filter(|mark| is_visited(*mark));
        let marks = marks.count();
        let unknowns = 2 * (self.stops.len() - self.parts_without_place() + marks)
            + 3 * cameras
            + 2
            + usize::from(!self.common.is_baseline_known);
        rows.saturating_sub(unknowns)
    }
}

impl<T: Real> Lens<T> {
    /// Returns true if it is so far off the prior that it is another lens, or another projection: more than
    /// four sigmas.
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
