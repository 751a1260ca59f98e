//! Residuals of the measurements against the estimates, normalised.
//!
//! A residual of a measurement that counts has the variance `1 - h` in units of its own, with the leverage
//! `h = g^T C g` of its row `g`: the estimates have moved towards it. An excluded one
//! has `1 + h`. `1 - h` is its redundancy number: the share of its error that shows in its residual.
//! Where it is nearly zero nothing checks the measurement. Baarda, "A testing procedure for use in
//! geodetic networks", 1968.

use super::{
    BearingResidual, LegResidual,
    integrity::IN_A_ROW,
    problem::{Problem, Sight, Standing},
};
use crate::{Real, Refusal, numerics::real::lit};

/// A measurement with less redundancy has none: its residual is rounding.
pub(super) const UNCHECKED: f64 = 0.02;
/// The same of a leg: carriers may measure much better than cameras, and slip by much more than either errs.
const UNCHECKED_LEG: f64 = 1e-3;
/// An excluded measurement that is closer to the estimates than this, in sigmas, is back in.
const READMITTED: f64 = 3.3;
/// A camera whose first bearing after a move is closer than this, in sigmas, was moved later.
const NOT_MOVED: f64 = 2.0;

impl<T: Real> Problem<'_, T> {
    /// The residual of a bearing or a range, with the share of it that is checked.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] for a camera without a pose, or no such bearing;
    /// [`Refusal::Undetermined`].
    pub(super) fn bearing_residual(&mut self, n: usize) -> Result<BearingResidual<T>, Refusal> {
        let sight = *self.sights.get(n).ok_or(Refusal::TooFew)?;
        let (stop, camera) = (usize::from(sight.stop), usize::from(sight.camera));
        self.tell()?;
        let row = self.sight_row(&sight).ok_or(Refusal::TooFew)?;
        let residual = row.residual;
        let of_stop = self
            .stops
            .get(stop)
            .is_some_and(|stop| stop.is_undetermined);
        let of_camera = { self.cameras.get(camera) }.is_some_and(|camera| camera.is_undetermined);
        let leverage = self.leverage(n, &row).filter(|_| !of_stop && !of_camera);
        let leverage = leverage.ok_or(Refusal::Undetermined)?;
        let counts = sight.standing == Standing::Counts;
        let redundancy = if counts {
            T::one() - leverage
        } else {
            T::one()
        };
        let variance = if counts {
            redundancy
        } else {
            T::one() + leverage
        };
        Ok(BearingResidual {
            stop,
            camera,
            quantity: sight.quantity,
            residual: residual * sight.sigma,
            redundancy,
            normalised: (variance >= lit(UNCHECKED)).then(|| residual / variance.sqrt()),
            standing: sight.standing,
        })
    }

    /// The residual of the leg to stop `later`: its chi squared, of as many degrees as are checked.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] where no leg was measured; [`Refusal::Undetermined`].
    pub(super) fn leg_residual(&mut self, later: usize) -> Result<LegResidual<T>, Refusal> {
        self.tell()?;
        let rows = self.leg_rows_of(later).ok_or(Refusal::TooFew)?;
        let stop = *self.stops.get(later).ok_or(Refusal::TooFew)?;
        if stop.is_leg_undetermined {
            return Err(Refusal::Undetermined);
        }
        let standing = stop.standing;
        // As it was measured, excluded or not.
        let weight = self.leg_weight(later).ok_or(Refusal::TooFew)?;
        let leverage = stop.leverage.map(|leverage| leverage / (weight * weight));
        let counts = standing == Standing::Counts;
        let [aa, ab, bb] = if counts {
            let [aa, ab, bb] = leverage;
            [T::one() - aa, -ab, T::one() - bb]
        } else {
            let [aa, ab, bb] = leverage;
            [T::one() + aa, ab, T::one() + bb]
        };
        // Along the axes of the covariance of the residual: one may be checked while the other is
        // not.
        let half = lit::<T>(0.5);
        let (mean, difference) = ((aa + bb) * half, (aa - bb) * half);
        let radius = (difference * difference + ab * ab).sqrt();
        let angle = ab.atan2(difference) * half;
        let (sine, cosine) = angle.sine_cosine();
        let [first, second] = rows.map(|row| row.residual);
        let along = cosine * first + sine * second;
        let across = cosine * second - sine * first;
        let (mut chi_squared, mut degrees_of_freedom) = (T::zero(), 0);
        for (residual, variance) in [(along, mean + radius), (across, mean - radius)] {
            if variance >= lit(UNCHECKED_LEG) {
                chi_squared += residual * residual / variance;
                degrees_of_freedom += 1;
            }
        }
        Ok(LegResidual {
            stop: later,
            chi_squared,
            degrees_of_freedom,
            squared: first * first + second * second,
            redundancy: if counts { aa + bb } else { T::zero() },
            standing,
        })
    }

    /// The next measurement, from one on, that is left out: bearings are counted first, then the stops that
    /// legs lead to. Among the sightings of a moved camera only the first is looked at.
    pub(super) fn next_excluded(&self, from: usize) -> Option<usize> {
        let bearings = { self.sights.iter() }.map(|sight| match sight.standing {
            Standing::Distrusted => self.is_first_moved(sight),
            standing => standing == Standing::Excluded,
        });
        let legs = { self.stops.iter() }.map(|stop| stop.standing == Standing::Excluded);
        let mut numbered = bearings.chain(legs).enumerate().skip(from);
        numbered.find(|(_, looks)| *looks).map(|(n, _)| n)
    }

    /// Returns true if this is where a camera was moved, as it was told, and there are more bearings than it
    /// takes to tell that.
    fn is_first_moved(&self, sight: &Sight<T>) -> bool {
        let camera = self.cameras.get(usize::from(sight.camera));
        let moved = self
            .sights
            .iter()
            .filter(|other| other.camera == sight.camera && other.standing == Standing::Distrusted);
        let first = moved.clone().map(|other| other.stop).min();
        camera.is_some_and(|camera| camera.takes_part)
            && first == Some(sight.stop)
            && moved.count() > IN_A_ROW
    }

    /// Puts back an excluded measurement that agrees after all; returns true if it does.
    pub(super) fn readmit(&mut self, n: usize) -> bool {
        let Some(sight) = self.sights.get(n).copied() else {
            return self.readmit_leg(n.saturating_sub(self.sights.len()));
        };
        let normalised = { self.bearing_residual(n).ok() }.and_then(|bearing| bearing.normalised);
        let within = match sight.standing {
            Standing::Distrusted => lit(NOT_MOVED),
            _ => lit(READMITTED),
        };
        if !normalised.is_some_and(|off| off.abs() < within) {
            return false;
        }
        if let Some(sight) = self.sights.get_mut(n) {
            sight.standing = Standing::Counts;
        }
        if sight.standing == Standing::Distrusted
            && let Some(camera) = self.cameras.get_mut(usize::from(sight.camera))
        {
            // It was moved later.
            camera.moved = Some(sight.stop.saturating_add(1));
        }
        true
    }

    fn readmit_leg(&mut self, stop: usize) -> bool {
        let fits = self.leg_residual(stop).is_ok_and(|leg| {
            leg.degrees_of_freedom > 0 && leg.chi_squared < lit(READMITTED * READMITTED)
        });
        if let Some(stop) = self.stops.get_mut(stop).filter(|_| fits) {
            stop.standing = Standing::Counts;
        }
        fits
    }
}
