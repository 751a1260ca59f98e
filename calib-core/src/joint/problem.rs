//! Measurements, estimates, and the rows of the equations that they give.

use core::ops::Range;

use nalgebra::{Matrix2, Point2, Vector2, Vector3};

use super::{Prior, ProtectionLevels, Solver, StopTag, Undetermined};
use crate::{
    Real, angle,
    level::{Elevation, Mounting, Row, Tolerance},
    numerics::plane::{self, dot, quarter_turn},
    numerics::real::lit,
};

/// Most rows of a camera that tell how it hangs: its last ones.
const ROWS: usize = 32;

/// Number of references: cameras 0 and 1, which define the frame.
pub const REFERENCES: usize = 2;

/// Most unknowns of a camera, and their order. The block of a camera is a part of them: references have no place, and
/// the lens or its principal point may not be estimated.
pub(super) const BLOCK: usize = 5;
pub(super) const PLACE: usize = 0;
const ACROSS: usize = 1;
pub(super) const HEADING: usize = 2;
pub(super) const LENS: usize = 3;
pub(super) const PRINCIPAL: usize = 4;

/// Kept unknowns while cameras are eliminated: the carrier's scale and compass offset, then two for each
/// stop, then two for each mark.
pub(super) const SCALE: usize = 0;
pub(super) const COMPASS: usize = 1;
pub(super) const STOPS: usize = 2;

/// Camera 1 is on the x axis up to this share of the baseline.
const ON_AXIS: f64 = 1e-5;

/// Distance in stops within which a wrong leg and a camera that seemed to be moved may be one fault.
const NEAR: usize = 12;

/// Least factor by which the rows of an excluded leg are shortened: its sigmas are 50 times larger, or as large as its
/// length if that is more.
const EXCLUDED_LEG: f64 = 0.02;

/// A stop: the leg that leads there, and its estimated place.
#[derive(Clone, Copy, Debug)]
pub struct Stop<T: Real> {
    pub(super) place: Point2<T>,
    /// Displacement from the stop before, as the carrier measured it.
    pub(super) displacement: Vector2<T>,
    /// The root `W` of that measurement's information, `W^T W = C^-1`: lower triangular, by rows.
    /// Zeros where nothing was measured.
    pub(super) root: [T; 3],
    /// Standing of the displacement: counted or left out.
    pub(super) standing: Standing,
    /// Number that the caller gave it.
    pub(super) tag: StopTag,
    /// The step of its place.
    pub(super) step: Vector2<T>,
    /// Leverage of the leg that leads there: covariance `xx, xy, yy` of its two whitened rows.
    pub(super) leverage: [T; 3],
    /// True if no measurement determines its place, or if no other one checks the leg.
    pub(super) is_undetermined: bool,
    pub(super) is_leg_undetermined: bool,
    /// True if its place is one from which passes may begin. Before that its sightings do not count.
    pub(super) is_placed: bool,
}

/// A camera's measurement of the target: a bearing, or a range.
#[derive(Clone, Copy, Debug)]
pub struct Sight<T> {
    pub(super) stop: u16,
    pub(super) camera: u16,
    pub(super) quantity: Quantity,
    pub(super) value: T,
    pub(super) sigma: T,
    pub(super) standing: Standing,
    /// Elevation of a bearing above the camera's horizontal plane, if known.
    pub(super) elevation: Elevation,
    /// The sighting of this camera before, by descending stop.
    pub(super) next: u32,
}

/// The end of a camera's sights.
pub(super) const NONE: u32 = u32::MAX;

/// Quantity that a camera measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Quantity {
    /// The direction of the target off the optical axis, radians.
    Bearing,
    /// Its distance.
    Range,
}

impl<T> Sight<T> {
    pub(super) fn is_bearing(&self) -> bool {
        self.quantity == Quantity::Bearing
    }
}

/// The target stood on a mark.
#[derive(Clone, Copy, Debug)]
pub struct Visit<T> {
    pub(super) stop: u16,
    pub(super) mark: u16,
    pub(super) sigma: T,
}

/// Standing of a measurement: counted or left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Standing {
    /// Counted.
    #[default]
    Counts,
    /// Left out because it contradicts the others; it comes back when it agrees with them.
    Excluded,
    /// Left out together with all that this camera has seen since: the camera was moved, or is
    /// stuck.
    Distrusted,
}

/// A camera, or with its first two numbers a mark.
#[derive(Clone, Copy, Debug)]
pub struct Unknown<T: Real> {
    /// `(x, y, heading, lens, principal)`; the heading over more than a turn, of the lens the true tangent of a
    /// bearing over the measured one, less one, and what is added to it for the principal column.
    pub(super) value: [T; BLOCK],
    pub(super) step: [T; BLOCK],
    /// Its last sighting.
    pub(super) last: u32,
    /// True if it is estimated.
    pub(super) takes_part: bool,
    /// True if no measurement determines its pose.
    pub(super) is_undetermined: bool,
    /// Bearings that it had at the last look, so that the same ones are not looked at again.
    pub(super) tried: u16,
    /// True if it was let in since the passes converged last.
    pub(super) is_new: bool,
    /// Stop since which its sightings are not its own: it was moved.
    pub(super) moved: Option<u16>,
    /// Camera that has the sightings since then.
    pub(super) successor: Option<u16>,
    pub(super) protection: ProtectionLevels<T>,
    /// Pitch and roll by which its directions are turned upright.
    pub(super) mounting: Mounting<T>,
}

impl<T: Real> Default for Stop<T> {
    /// A stop at the origin, without a leg.
    fn default() -> Self {
        let zero = T::zero();
        Self {
            place: Point2::origin(),
            displacement: Vector2::zeros(),
            root: [zero; 3],
            standing: Standing::Counts,
            tag: StopTag::default(),
            step: Vector2::zeros(),
            leverage: [zero; 3],
            is_undetermined: false,
            is_leg_undetermined: false,
            is_placed: false,
        }
    }
}

impl<T: Real> Default for Sight<T> {
    /// A sighting without a measurement.
    fn default() -> Self {
        Self {
            stop: 0,
            camera: 0,
            quantity: Quantity::Bearing,
            value: T::zero(),
            sigma: T::one(),
            standing: Standing::Counts,
            elevation: Elevation::UNKNOWN,
            next: NONE,
        }
    }
}

impl<T: Real> Default for Visit<T> {
    /// A visit without a measurement.
    fn default() -> Self {
        Self {
            stop: 0,
            mark: 0,
            sigma: T::one(),
        }
    }
}

impl<T: Real> Default for Unknown<T> {
    /// A camera without sightings.
    fn default() -> Self {
        Self {
            value: [T::zero(); BLOCK],
            step: [T::zero(); BLOCK],
            last: NONE,
            takes_part: false,
            is_undetermined: false,
            tried: 0,
            is_new: false,
            moved: None,
            successor: None,
            protection: ProtectionLevels::default(),
            mounting: Mounting::level(),
        }
    }
}

/// Common values of the problem.
#[derive(Clone, Copy, Debug)]
pub(super) struct Common<T: Real> {
    pub baseline: T,
    /// True if the baseline is known. Otherwise it is a guess, and the scale of the carrier sets all lengths.
    pub is_baseline_known: bool,
    pub scale_prior: Prior<T>,
    pub compass_prior: Prior<T>,
    pub standing: T,
    /// Standard deviation of the pitch and roll of a level camera; zero if rows are not looked at.
    pub tilt: T,
    /// Standard deviations of all lenses, if they are estimated.
    pub optics: Optics<T>,
    /// Scale and compass offset.
    pub carrier: Vector2<T>,
    pub carrier_step: Vector2<T>,
    /// Noise of the legs, relative to the told noise.
    pub leg_factor: T,
    /// Stage of the last pass.
    pub told: Told,
    /// Chi squared of the equations, as far as they are there: of cameras and marks, and of the carrier.
    pub cost: [T; 2],
    /// First unknown that the pass did not determine.
    pub undetermined: Option<Undetermined>,
    pub is_carrier_undetermined: bool,
    /// True once a start was found.
    pub is_started: bool,
    /// First and last stop whose bearings count: all, except during a start.
    pub window: [u16; 2],
    /// True if one solver has all unknowns.
    pub is_whole: bool,
    /// Camera and stop since which its sightings are left out of the equations for a test.
    pub left_out: Option<(usize, usize)>,
    /// Camera that is wrong since some stop, and the possible reason.
    pub suspect: Option<Suspect<T>>,
}

impl<T: Real> Common<T> {
    /// Returns true where all unknowns are a solver's. Without the feature the compiler leaves out the code
    /// for them.
    pub(super) fn is_whole(&self) -> bool {
        cfg!(feature = "solver") && self.is_whole
    }
}

/// Prior knowledge of lenses: standard deviations, `None` where a number is exact.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Optics<T> {
    /// Of the focal length, relative.
    pub lens: Option<T>,
    /// Of the principal column, as a tangent. Only where the focal length has one as well.
    pub principal: Option<T>,
    /// True if ranges are seen through the lens.
    pub are_ranges_seen: bool,
}

impl<T: Real> Optics<T> {
    /// Returns what is not zero. A lens of which only the principal column is unknown has a focal length that is
    /// nearly exact.
    pub(super) fn new(lens: Option<T>, principal: Option<T>, are_ranges_seen: bool) -> Self {
        let given = |sigma: &T| *sigma != T::zero();
        let principal = principal.filter(given);
        let exact = principal.map(|_| lit(NEARLY_EXACT));
        Self {
            lens: lens.filter(given).or(exact),
            principal,
            are_ranges_seen,
        }
    }

    /// Unknowns of a camera with such a lens.
    pub(super) const fn block(&self) -> usize {
        match (&self.lens, &self.principal) {
            (None, _) => LENS,
            (_, None) => PRINCIPAL,
            _ => BLOCK,
        }
    }
}

/// Share of a focal length that no measurement tells.
const NEARLY_EXACT: f64 = 1e-4;

/// Contents of the workspace about the present estimates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Told {
    Nothing,
    /// The equations, or less.
    Equations,
    /// The equations in the making, and the next step of that.
    Assembling(usize),
    /// The equations, of which the kept part is factored up to a row.
    Factoring {
        /// The next row.
        row: usize,
        /// Unknowns that were dropped.
        dropped: usize,
    },
    /// The factor of the kept part.
    Factor,
    /// Covariances in the making, and how far they are.
    Inverting(usize),
    /// Covariances.
    Covariances,
}

/// Camera whose last bearings are wrong: it was moved, or a leg was not as measured. Both are tried.
#[derive(Clone, Copy, Debug)]
pub(super) struct Suspect<T> {
    pub camera: u16,
    /// First stop at which it is wrong.
    pub from: u16,
    /// Leg that is left out for a test, and its error as chi squared.
    pub leg: Option<(u16, T)>,
}

/// The numbers of an estimator. The mathematics exists once for all capacities.
pub(super) struct Problem<'a, T: Real> {
    pub common: &'a mut Common<T>,
    pub stops: &'a mut [Stop<T>],
    pub sights: &'a mut [Sight<T>],
    pub visits: &'a [Visit<T>],
    pub cameras: &'a mut [Unknown<T>],
    pub marks: &'a mut [Unknown<T>],
    pub workspace: &'a mut [T],
    /// Solver of all unknowns together, instead of the kept ones.
    pub solver: Option<&'a mut dyn Solver<T>>,
}

/// A bearing's or a range's residual around the present estimates, over its sigma.
pub(super) struct SightRow<T: Real> {
    pub residual: T,
    pub by_place: Vector2<T>,
    pub by_camera: [T; BLOCK],
}

/// A camera's sights, by descending stop, with their numbers.
#[derive(Clone, Debug)]
pub(super) struct Own<'p, T> {
    sights: &'p [Sight<T>],
    next: u32,
}

impl<'p, T> Iterator for Own<'p, T> {
    type Item = (usize, &'p Sight<T>);

    #[inline]
    fn next(&mut self) -> Option<Self::Item> {
        let n = usize::try_from(self.next).ok()?;
        let sight = self.sights.get(n)?;
        self.next = sight.next;
        Some((n, sight))
    }
}

impl<T: Real> Unknown<T> {
    pub(super) fn place(&self) -> Vector2<T> {
        let [x, y, ..] = self.value;
        Vector2::new(x, y)
    }

    pub(super) fn put(&mut self, place: Vector2<T>) {
        let [x, y, ..] = &mut self.value;
        (*x, *y) = (place.x, place.y);
    }

    pub(super) const fn heading(&self) -> T {
        let [_, _, heading, ..] = self.value;
        heading
    }

    pub(super) fn turn(&mut self, heading: T) {
        let [_, _, own, ..] = &mut self.value;
        *own = heading;
    }

    /// The true tangent of a bearing over the measured one, less one, by the lens.
    pub(super) const fn lens(&self) -> T {
        let [_, _, _, lens, ..] = self.value;
        lens
    }

    /// Addition to the tangent of each bearing because the principal column is another one.
    pub(super) const fn principal(&self) -> T {
        let [_, _, _, _, principal] = self.value;
        principal
    }

    /// Sets the lens back to the told one.
    pub(super) fn trust_lens(&mut self) {
        let [_, _, _, lens, principal] = &mut self.value;
        (*lens, *principal) = (T::zero(), T::zero());
    }
}

/// One of the two rows of a leg.
pub(super) struct LegRow<T: Real> {
    pub residual: T,
    /// Derivative by the later place; that by the earlier one is its negative.
    pub by_place: Vector2<T>,
    pub by_carrier: Vector2<T>,
}

impl<T: Real> Problem<'_, T> {
    /// Unknowns of a camera's block, of [`BLOCK`].
    pub(super) fn axes(&self, camera: usize) -> Range<usize> {
        let is_placed = camera == 0 || camera == 1 && self.common.is_baseline_known;
        let first = if is_placed { HEADING } else { PLACE };
        first..self.last_axis()
    }

    pub(super) fn last_axis(&self) -> usize {
        self.common.optics.block()
    }

    /// The prior of a camera's unknown, as a row of it alone: residual and weight.
    pub(super) fn prior_of(&self, camera: usize, axis: usize) -> Option<(T, T)> {
        let Optics {
            lens, principal, ..
        } = self.common.optics;
        let of = self.cameras.get(camera)?;
        let (sigma, value) = match axis {
            LENS => (lens?, of.lens()),
            PRINCIPAL => (principal?, of.principal()),
            // It is on the x axis: its place is one of the unknowns.
            ACROSS if camera == 1 => {
                let [_, y, ..] = of.value;
                (self.common.baseline * lit(ON_AXIS), y)
            }
            _ => return None,
        };
        let weight = sigma.recip();
        Some((value * weight, weight))
    }

    /// Returns true if a sighting is in the equations, apart from its row.
    pub(super) fn counts(&self, camera: usize, sight: &Sight<T>) -> bool {
        let is_left_out = { self.common.left_out }
            .is_some_and(|(of, from)| of == camera && usize::from(sight.stop) >= from);
        sight.standing == Standing::Counts && !is_left_out
    }

    /// Sights of a camera.
    #[inline]
    pub(super) fn own(&self, camera: usize) -> Own<'_, T> {
        Own {
            sights: self.sights,
            next: self.cameras.get(camera).map_or(NONE, |camera| camera.last),
        }
    }

    /// Returns the next sighting of a list, while estimates may change.
    pub(super) fn next_own(&self, next: &mut u32) -> Option<(usize, Sight<T>)> {
        let n = usize::try_from(*next).ok()?;
        let sight = self.sights.get(n)?;
        *next = sight.next;
        Some((n, *sight))
    }

    /// Links the sightings of each camera to a list.
    pub(super) fn link(&mut self) {
        for camera in self.cameras.iter_mut() {
            camera.last = NONE;
        }
        for n in 0..self.sights.len() {
            let Some(sight) = self.sights.get(n) else {
                return;
            };
            let (camera, stop) = (usize::from(sight.camera), sight.stop);
            let comes_after = |other: &(usize, &Sight<T>)| other.1.stop > stop;
            let before = self.own(camera).take_while(comes_after).last();
            let number = u32::try_from(n).unwrap_or(NONE);
            let place = match before.map(|(n, _)| n) {
                Some(before) => self.sights.get_mut(before).map(|sight| &mut sight.next),
                None => self.cameras.get_mut(camera).map(|camera| &mut camera.last),
            };
            let next = place.map(|place| core::mem::replace(place, number));
            if let (Some(next), Some(sight)) = (next, self.sights.get_mut(n)) {
                sight.next = next;
            }
        }
    }

    /// Estimated pose of a camera.
    pub(super) fn camera(&self, camera: usize) -> Option<Vector3<T>> {
        let unknown = self.cameras.get(camera)?;
        // References stand where the frame says.
        let place = match camera {
            0 => Vector2::zeros(),
            1 if self.common.is_baseline_known => Vector2::new(self.common.baseline, T::zero()),
            1 => Vector2::new(unknown.place().x, T::zero()),
            _ => unknown.place(),
        };
        Some(place.push(unknown.heading()))
    }

    /// Returns true if a camera's bearings are used: it is a reference, or admitted.
    pub(super) fn is_estimated(&self, camera: usize) -> bool {
        camera < REFERENCES || self.cameras.get(camera).is_some_and(|c| c.takes_part)
    }

    /// Estimated place of a stop, if it has one.
    pub(super) fn placed(&self, stop: u16) -> Option<Point2<T>> {
        let stop = self.stops.get(usize::from(stop))?;
        stop.is_placed.then_some(stop.place)
    }

    /// Returns true if a camera is the successor of one that was moved.
    pub(super) fn is_successor(&self, camera: usize) -> bool {
        let of = |other: &Unknown<T>| other.successor.map(usize::from) == Some(camera);
        self.cameras.iter().any(of)
    }

    /// Gives the bearings since a move to the successor of the moved camera. Without a successor they are left out.
    pub(super) fn sort_moved(&mut self) {
        for sight in self.sights.iter_mut() {
            // A successor is always a later camera, so this ends.
            while let Some(camera) = self.cameras.get(usize::from(sight.camera))
                && camera.moved.is_some_and(|from| sight.stop >= from)
            {
                let Some(successor) = camera.successor else {
                    sight.standing = Standing::Distrusted;
                    break;
                };
                sight.camera = successor;
                sight.standing = Standing::Counts;
            }
        }
    }

    /// Gives cameras that seemed to be moved near this stop, or anywhere, their sightings back.
    pub(super) fn undo_moves(&mut self, near: Option<usize>) {
        for camera in 0..self.cameras.len() {
            let Some(unknown) = self.cameras.get_mut(camera) else {
                break;
            };
            let is_near =
                |from: &u16| near.is_none_or(|near| near.abs_diff((*from).into()) <= NEAR);
            let Some(from) = unknown.moved.filter(is_near) else {
                continue;
            };
            unknown.moved = None;
            let successor = unknown.successor.take().map(usize::from);
            for sight in self.sights.iter_mut() {
                let of = usize::from(sight.camera);
                let is_its = of == camera && sight.standing == Standing::Distrusted;
                if sight.stop >= from && (is_its || Some(of) == successor) {
                    sight.camera = u16::try_from(camera).unwrap_or(sight.camera);
                    sight.standing = Standing::Counts;
                }
            }
            if let Some(successor) = successor.and_then(|n| self.cameras.get_mut(n)) {
                *successor = Unknown::default();
            }
        }
        self.link();
    }

    /// A bearing as a level camera would measure it through a right lens, and by how much it changes with lens and principal
    /// column: the derivatives of `atan((1 + e) tan b + p)` by `e` and `p`.
    pub(super) fn through_lens(&self, sight: &Sight<T>) -> (T, [T; 2]) {
        let camera = self.cameras.get(usize::from(sight.camera));
        if let Some(camera) = camera.filter(|camera| !camera.mounting.is_level()) {
            return turned_upright(camera, sight);
        }
        if self.common.optics.lens.is_none() {
            return (sight.value, [T::zero(); 2]);
        }
        let lens = camera.map_or_else(T::zero, Unknown::lens);
        let principal = camera.map_or_else(T::zero, Unknown::principal);
        let ray = plane::unit(sight.value);
        let true_ray = Vector2::new(ray.x, ray.y * (lens + T::one()) + ray.x * principal);
        let by_tangent = ray.x / dot(true_ray, true_ray);
        (
            true_ray.y.atan2(true_ray.x),
            [ray.y * by_tangent, ray.x * by_tangent],
        )
    }

    /// Change of a bearing with its elevation, which errs by as much as the bearing does, with a ball that bobs. None of
    /// a level camera; `None` of a row that is not known of another one.
    fn by_elevation(&self, sight: &Sight<T>) -> Option<T> {
        let mounting = self.cameras.get(usize::from(sight.camera))?.mounting;
        if mounting.is_level() {
            return Some(T::zero());
        }
        let elevation = sight.elevation.radians::<T>()?;
        Some(mounting.by_elevation(sight.value, elevation))
    }

    /// Distance to the target along the floor, as a share of the distance itself, by the row in which the camera saw it at
    /// the stop of a range. `None` of a camera that is not level and did not tell the row.
    #[inline(never)] // for less flash
    pub(super) fn along_floor(&self, range: &Sight<T>) -> Option<T> {
        let camera = usize::from(range.camera);
        let mounting = self.cameras.get(camera)?.mounting;
        let mut own = self.own(camera).map(|(_, sight)| sight);
        let seen = own.find(|sight| sight.stop == range.stop && sight.is_bearing());
        match seen.and_then(|seen| Some((seen.value, seen.elevation.radians::<T>()?))) {
            Some((bearing, elevation)) => {
                let up = mounting.seen(bearing, elevation).up;
                Some((T::one() - up * up).sqrt())
            }
            None => mounting.is_level().then(T::one),
        }
    }

    /// The last rows of a camera that count, and their number.
    #[inline(never)] // for less stack
    pub(super) fn rows(&self, camera: usize) -> ([Row<T>; ROWS], usize) {
        let mut rows = [Row::default(); ROWS];
        let standing = self.common.standing;
        let counting = { self.own(camera) }
            .filter(|(_, sight)| sight.standing == Standing::Counts && sight.is_bearing());
        let mut count = 0;
        for (_, sight) in counting {
            if let (Some(target), Some(elevation), Some(row)) = (
                self.placed(sight.stop),
                sight.elevation.radians(),
                rows.get_mut(count),
            ) {
                *row = Row {
                    target,
                    target_variance: standing * standing,
                    bearing: sight.value,
                    elevation,
                    sigma: sight.sigma,
                };
                count += 1;
            }
        }
        (rows, count)
    }

    /// Tolerance of the test of rows. A ball bobs as much as it stands beside its stop.
    pub(super) fn tolerance(&self) -> Tolerance<T> {
        Tolerance {
            tilt: self.common.tilt,
            bob: self.common.standing,
        }
    }

    /// Bearing and standard deviation for callers that do not estimate lenses. The heading takes up nearly all of an
    /// error of the principal column.
    pub(super) fn bearing_at(&self, sight: &Sight<T>) -> (T, T) {
        let (bearing, [by_lens, _]) = self.through_lens(sight);
        let Some(prior) = self.common.optics.lens else {
            return (bearing, sight.sigma);
        };
        let of_lens = by_lens * prior;
        (
            bearing,
            (sight.sigma * sight.sigma + of_lens * of_lens).sqrt(),
        )
    }

    /// A bearing's or a range's row; `None` if its camera is not estimated, its stop is not placed or the target is right
    /// on the camera, and for a range where no length is known.
    pub(super) fn sight_row(&self, sight: &Sight<T>) -> Option<SightRow<T>> {
        let camera = usize::from(sight.camera);
        let [first, last] = self.common.window;
        if !self.is_estimated(camera) || sight.stop < first || sight.stop > last {
            return None;
        }
        let pose = self.camera(camera)?;
        let place = self.placed(sight.stop)?;
        let to_target = place.coords - pose.xy();
        let range2 = dot(to_target, to_target);
        if !(range2 > T::zero()) {
            return None;
        }
        // The target stood a little beside the place of its stop when this camera looked.
        let (sigma, standing) = (sight.sigma, self.common.standing);
        if sight.quantity == Quantity::Range {
            if !self.common.is_baseline_known {
                return None;
            }
            // A lens that is wider than told makes the target smaller.
            let camera = self
                .cameras
                .get(camera)
                .filter(|_| self.common.optics.are_ranges_seen);
            let wider = camera.map_or_else(T::zero, Unknown::lens) + T::one();
            let share = self.along_floor(sight)? / wider;
            let (told, sigma) = (sight.value * share, sigma * share);
            let by_lens = camera.map_or_else(T::zero, |_| told / wider);
            let weight = (sigma * sigma + standing * standing).sqrt().recip();
            let range = range2.sqrt();
            let by_place = to_target * (weight / range);
            return Some(SightRow {
                residual: (range - told) * weight,
                by_place,
                by_camera: [
                    -by_place.x,
                    -by_place.y,
                    T::zero(),
                    by_lens * weight,
                    T::zero(),
                ],
            });
        }
        let variance = sigma * sigma + standing * standing / range2;
        let by_row = self.by_elevation(sight)?;
        let weight = (variance * (T::one() + by_row * by_row)).sqrt().recip();
        let (bearing, [by_lens, by_principal]) = self.through_lens(sight);
        let off = to_target.y.atan2(to_target.x) - pose.z - bearing;
        let by_place = quarter_turn(to_target) * (weight / range2);
        Some(SightRow {
            residual: angle::wrap_signed(off) * weight,
            by_place,
            by_camera: [
                -by_place.x,
                -by_place.y,
                -weight,
                -by_lens * weight,
                -by_principal * weight,
            ],
        })
    }

    /// The two rows of a leg: its expected measurement less the actual one, whitened. An excluded leg still ties its
    /// ends together, but loosely.
    pub(super) fn leg_rows(&self, later: usize) -> Option<[LegRow<T>; 2]> {
        let weight = self.leg_weight(later)?;
        let rows = self.leg_rows_of(later)?;
        Some(rows.map(|row| LegRow {
            residual: row.residual * weight,
            by_place: row.by_place * weight,
            by_carrier: row.by_carrier * weight,
        }))
    }

    /// Factor of the rows: one, or less for an excluded leg.
    pub(super) fn leg_weight(&self, later: usize) -> Option<T> {
        let stop = self.stops.get(later)?;
        let [w11, _, w22] = stop.root;
        let length = dot(stop.displacement, stop.displacement).sqrt();
        Some(if stop.standing == Standing::Counts {
            T::one()
        } else {
            let claims = w11.max(w22) * length * lit(EXCLUDED_LEG);
            lit::<T>(EXCLUDED_LEG) / claims.max(T::one())
        })
    }

    /// The two rows without that factor.
    pub(super) fn leg_rows_of(&self, later: usize) -> Option<[LegRow<T>; 2]> {
        let stop = self.stops.get(later)?;
        let before = self.stops.get(later.checked_sub(1)?)?;
        if stop.root == [T::zero(); 3] {
            return None;
        }
        let (scale, compass) = (self.common.carrier.x, self.common.carrier.y);
        let turn = plane::unit(compass);
        let way = plane::mul(turn, stop.place - before.place);
        let read = way * scale;
        let off = read - stop.displacement;
        let [w11, w21, w22] = stop.root.map(|w| w / self.common.leg_factor);
        let by_compass = quarter_turn(read);
        let turned = turn * scale;
        // `scale` times the rotation, by rows: `(c, -s)` and `(s, c)`.
        let row = |w1: T, w2: T| LegRow {
            residual: off.x * w1 + off.y * w2,
            by_place: Vector2::new(turned.x * w1 + turned.y * w2, turned.x * w2 - turned.y * w1),
            by_carrier: Vector2::new(
                way.x * w1 + way.y * w2,
                by_compass.x * w1 + by_compass.y * w2,
            ),
        };
        Some([row(w11, T::zero()), row(w21, w22)])
    }

    /// Place of a mark from the place of a visit, over the sigma of the visit.
    pub(super) fn visit_rows(&self, visit: &Visit<T>) -> Option<(Vector2<T>, T)> {
        let mark = self.marks.get(usize::from(visit.mark))?;
        let place = self.stops.get(usize::from(visit.stop))?.place;
        let weight = visit.sigma.recip();
        Some(((place.coords - mark.place()) * weight, weight))
    }

    /// A displacement by dead reckoning: as the carrier measured it, less its estimated errors.
    pub(super) fn true_way(&self, displacement: Vector2<T>) -> Vector2<T> {
        let turned = plane::mul_conj(displacement, plane::unit(self.common.carrier.y));
        turned / self.common.carrier.x
    }
}

/// A bearing as of a level camera, and its derivatives by the focal length and by the principal column.
#[inline(never)] // for less stack
fn turned_upright<T: Real>(camera: &Unknown<T>, sight: &Sight<T>) -> (T, [T; 2]) {
    let elevation = sight.elevation.radians().unwrap_or_else(T::zero);
    let (sine, cosine) = sight.value.sine_cosine();
    let (up, level) = elevation.sine_cosine();
    let (forward, left) = (cosine * level, sine * level);
    let scale = camera.lens() + T::one();
    let zero = T::zero();
    let turn = |forward, left, up| camera.mounting.upright(forward, left, up);
    let seen = turn(
        forward,
        left * scale + forward * camera.principal(),
        up * scale,
    );
    let by_lens = seen.turn(&turn(zero, left, up));
    let by_principal = seen.turn(&turn(zero, forward, zero));
    (seen.azimuth(), [by_lens, by_principal])
}

/// The root of a covariance's information, lower triangular by rows. `None` if it is not positive
/// definite.
pub(super) fn root_information<T: Real>(c: &Matrix2<T>) -> Option<[T; 3]> {
    let l11 = c.m11.sqrt();
    let l21 = c.m21 / l11;
    let l22 = (c.m22 - l21 * l21).sqrt();
    let root = [l11.recip(), -l21 / (l11 * l22), l22.recip()];
    let usable = c.m11 > T::zero() && l22 > T::zero() && root.iter().all(T::is_finite);
    usable.then_some(root)
}
