//! What the measurements say against the estimates, normalised.
//!
//! A residual of a measurement that counts has the variance `1 - h` in units of its own, with the
//! leverage `h = g^T C g` of its row `g`: the estimates have moved towards it. One that was left out
//! has `1 + h`. `1 - h` is its redundancy number: the share of its error that shows in its residual.
//! Where it is nearly zero nothing checks the measurement. Baarda, "A testing procedure for use in
//! geodetic networks", 1968.

use nalgebra::Vector2;

use super::{
    BearingResidual, LegResidual,
    answers::dot,
    integrity::IN_A_ROW,
    problem::{HELD, LEAVING, LegRow, Problem, SCALE, Sight, Standing},
};
use crate::{Real, Refusal, numerics::real::lit};

/// A measurement with less redundancy has none: its residual is rounding.
pub(super) const UNCHECKED: f64 = 0.02;
/// The same of a leg: carriers may measure much better than cameras, and slip by much more than either errs.
const UNCHECKED_LEG: f64 = 1e-3;
/// What was left out and is closer to the estimates than this, in sigmas, is back in.
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
        let stop = usize::from(sight.stop);
        self.hold(stop).ok_or(Refusal::Undetermined)?;
        let residual = self.sight_row(&sight).ok_or(Refusal::TooFew)?.residual;
        let leverage = self.leverage(&sight).ok_or(Refusal::Undetermined)?;
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
            camera: usize::from(sight.camera),
            quantity: sight.quantity,
            residual: residual * sight.sigma,
            redundancy,
            normalised: (variance >= lit(UNCHECKED)).then(|| residual / variance.sqrt()),
            standing: sight.standing,
        })
    }

    /// The variance of what the estimates say of a bearing, in units of the bearing's own. The
    /// triangle has to hold its stop.
    fn leverage(&mut self, sight: &Sight<T>) -> Option<T> {
        self.enter_sight(sight)?;
        let (triangle, [g, ..]) = self.triangle()?;
        triangle.forward_substitute(g)?;
        Some(dot(g, g))
    }

    /// A bearing's row into the first vector.
    fn enter_sight(&mut self, sight: &Sight<T>) -> Option<()> {
        let row = self.sight_row(sight)?;
        let columns = self.columns(usize::from(sight.camera))?;
        let (_, [g, ..]) = self.triangle()?;
        g.fill(T::zero());
        put(g, HELD, row.by_place);
        if let Some(place) = columns.place {
            put(g, place, -row.by_place);
        }
        *g.get_mut(columns.heading)? = row.by_heading;
        if let Some(lens) = columns.lens {
            *g.get_mut(lens)? = row.by_lens;
        }
        Some(())
    }

    /// The residual of the leg to stop `later`: its chi squared, of as many degrees as are checked.
    ///
    /// # Errors
    /// [`Refusal::TooFew`] where no leg was measured; [`Refusal::Undetermined`].
    pub(super) fn leg_residual(&mut self, later: usize) -> Result<LegResidual<T>, Refusal> {
        self.whole_leg_residual(later).map(|(leg, _)| leg)
    }

    /// The same, and the redundancy of each of its two rows, which are left in the first two vectors,
    /// forward substituted.
    pub(super) fn whole_leg_residual(
        &mut self,
        later: usize,
    ) -> Result<(LegResidual<T>, [T; 2]), Refusal> {
        let before = later.checked_sub(1).ok_or(Refusal::TooFew)?;
        let standing = self.stops.get(later).ok_or(Refusal::TooFew)?.standing;
        self.hold(before).ok_or(Refusal::Undetermined)?;
        let rows = self.leg_rows_of(later).ok_or(Refusal::TooFew)?;
        for (n, row) in rows.iter().enumerate() {
            self.enter_leg(n, row).ok_or(Refusal::Undetermined)?;
        }
        let (triangle, [a, b, _]) = self.triangle().ok_or(Refusal::Undetermined)?;
        for g in [&mut *a, &mut *b] {
            triangle
                .forward_substitute(g)
                .ok_or(Refusal::Undetermined)?;
        }
        let leverage = [dot(a, a), dot(a, b), dot(b, b)];
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
        let residual = LegResidual {
            stop: later,
            chi_squared,
            degrees_of_freedom,
            squared: first * first + second * second,
            redundancy: if counts { aa + bb } else { T::zero() },
            standing,
        };
        Ok((residual, [aa, bb]))
    }

    /// A leg's row into one of the vectors: the triangle holds the earlier stop, and the later one is
    /// about to leave.
    fn enter_leg(&mut self, vector: usize, row: &LegRow<T>) -> Option<()> {
        let (by_place, by_carrier) = (row.by_place, row.by_carrier);
        let (_, mut vectors) = self.triangle()?;
        let g = vectors.get_mut(vector)?;
        g.fill(T::zero());
        put(g, HELD, -by_place);
        put(g, LEAVING, by_place);
        put(g, SCALE, by_carrier);
        Some(())
    }

    /// The next measurement, from one on, that is left out: bearings are counted first, then the stops
    /// that legs lead to. Of what a camera saw since it was moved only the first is looked at.
    pub(super) fn next_excluded(&self, from: usize) -> Option<usize> {
        let bearings = { self.sights.iter() }.map(|sight| match sight.standing {
            Standing::Distrusted => self.is_first_moved(sight),
            standing => standing == Standing::Excluded,
        });
        let legs = { self.stops.iter() }.map(|stop| stop.standing == Standing::Excluded);
        let mut numbered = bearings.chain(legs).enumerate().skip(from);
        numbered.find(|(_, looks)| *looks).map(|(n, _)| n)
    }

    /// Whether this is where a camera was moved, as it was told, and there are more than it takes to tell
    /// that.
    fn is_first_moved(&self, sight: &Sight<T>) -> bool {
        let camera = self.cameras.get(usize::from(sight.camera));
        let moved = self
            .sights
            .iter()
            .filter(|other| other.camera == sight.camera && other.standing == Standing::Distrusted);
        let first = moved.clone().map(|other| other.stop).min();
        camera.is_some_and(|camera| camera.column.is_some())
            && first == Some(sight.stop)
            && moved.count() > IN_A_ROW
    }

    /// Puts back what was left out and agrees after all; whether it does. A pass.
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

fn put<T: Real>(row: &mut [T], column: usize, numbers: Vector2<T>) {
    for (place, number) in row.iter_mut().skip(column).zip(&numbers) {
        *place = *number;
    }
}
