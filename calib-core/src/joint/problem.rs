//! What is estimated and from what: measurements, estimates, and which column of the triangle
//! belongs to which unknown.

use nalgebra::{Matrix2, Point2, Vector2, Vector3, Vector4};

use super::{
    Prior, ProtectionLevels, StopTag,
    triangle::{Triangle, packed},
};
use crate::{
    Real, angle,
    numerics::plane::{self, dot, quarter_turn},
    numerics::real::lit,
};

/// Cameras 0 and 1: they define the frame.
pub(super) const REFERENCES: usize = 2;

/// Columns of the triangle: of the place that is about to be eliminated, of the next one, and of
/// the one that stays.
pub(super) const LEAVING: usize = 0;
pub(super) const NEXT: usize = 2;
pub(super) const HELD: usize = 4;
/// The carrier's scale and compass offset, and the headings of both references.
pub(super) const SCALE: usize = 6;
pub(super) const COMPASS: usize = 7;
pub(super) const HEADINGS: usize = 8;
/// Of the references' lenses if they are estimated, then of the other cameras, `(x, y, heading)` and
/// the lens of each, then of the marks, two each.
pub(super) const KEPT: usize = 10;

/// Columns of so many cameras, references included, and marks; the right side included.
pub(super) const fn width(cameras: usize, marks: usize, lenses: bool) -> usize {
    let lens = if lenses { 1 } else { 0 };
    let others = cameras.saturating_sub(REFERENCES);
    KEPT + lens * REFERENCES + (3 + lens) * others + 2 * marks + 1
}

/// Vectors as long as a row, beside the triangle.
const VECTORS: usize = 3;

/// Numbers of the workspace.
pub(super) const fn workspace(cameras: usize, marks: usize, lenses: bool) -> usize {
    let width = width(cameras, marks, lenses);
    packed(width) + VECTORS * width
}

/// A leg that was not as measured, and a camera that seemed to be moved so few stops before or after it, may
/// be one fault.
const NEAR: usize = 12;

/// By how much an excluded leg's rows are shortened, at least: it has 50 times its sigmas, or as much as it is
/// long if that is more.
const EXCLUDED_LEG: f64 = 0.02;

/// A stop: how it was reached, and where it is thought to be.
#[derive(Clone, Copy, Debug)]
pub struct Stop<T: Real> {
    pub(super) place: Point2<T>,
    /// From the stop before, as the carrier measured it.
    pub(super) displacement: Vector2<T>,
    /// The root `W` of that measurement's information, `W^T W = C^-1`: lower triangular, by rows.
    /// Zeros where nothing was measured.
    pub(super) root: [T; 3],
    /// Whether the displacement counts.
    pub(super) standing: Standing,
    /// The caller's own.
    pub(super) tag: StopTag,
    /// The second sweep's own: the equations for this place that the stops before it leave, and
    /// after it in the first two the step.
    pub(super) chain: [T; 5],
}

/// What a camera measured of the target: a bearing, or a range.
#[derive(Clone, Copy, Debug)]
pub struct Sight<T> {
    pub(super) stop: u16,
    pub(super) camera: u16,
    pub(super) quantity: Quantity,
    pub(super) value: T,
    pub(super) sigma: T,
    pub(super) standing: Standing,
}

/// What a camera measures.
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

/// Whether a measurement counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Standing {
    /// It counts.
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
    /// `(x, y, heading, lens)`; the heading over more than a turn, of the lens the true tangent of a
    /// bearing over the measured one, less one.
    pub(super) value: Vector4<T>,
    pub(super) step: Vector4<T>,
    /// First column in the triangle, while it is estimated.
    pub(super) column: Option<u16>,
    /// Bearings it had when it was last looked at, so that it is not looked at again for nothing.
    pub(super) tried: u16,
    /// It was taken in since the passes last came to an end.
    pub(super) is_new: bool,
    /// Stop from which on what it saw is not its own, because it was moved.
    pub(super) moved: Option<u16>,
    /// The camera that those bearings belong to.
    pub(super) successor: Option<u16>,
    pub(super) protection: ProtectionLevels<T>,
}

impl<T: Real> Default for Stop<T> {
    /// At the origin, and nobody knows how it was reached.
    fn default() -> Self {
        let zero = T::zero();
        Self {
            place: Point2::origin(),
            displacement: Vector2::zeros(),
            root: [zero; 3],
            standing: Standing::Counts,
            tag: StopTag::default(),
            chain: [zero; 5],
        }
    }
}

impl<T: Real> Default for Sight<T> {
    /// No bearing worth anything.
    fn default() -> Self {
        Self {
            stop: 0,
            camera: 0,
            quantity: Quantity::Bearing,
            value: T::zero(),
            sigma: T::one(),
            standing: Standing::Counts,
        }
    }
}

impl<T: Real> Default for Visit<T> {
    /// None worth anything.
    fn default() -> Self {
        Self {
            stop: 0,
            mark: 0,
            sigma: T::one(),
        }
    }
}

impl<T: Real> Default for Unknown<T> {
    /// Nothing was seen of it.
    fn default() -> Self {
        Self {
            value: Vector4::zeros(),
            step: Vector4::zeros(),
            column: None,
            tried: 0,
            is_new: false,
            moved: None,
            successor: None,
            protection: ProtectionLevels::default(),
        }
    }
}

/// What cannot be left out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Common<T: Real> {
    pub baseline: T,
    pub scale_prior: Prior<T>,
    pub compass_prior: Prior<T>,
    pub standing: T,
    /// Standard deviation of all lenses, if they are estimated.
    pub lens_prior: Option<T>,
    /// Scale and compass offset.
    pub carrier: Vector2<T>,
    pub carrier_step: Vector2<T>,
    /// By how much the legs' sigmas are larger than they claim.
    pub leg_factor: T,
    /// The stop that the triangle holds.
    pub held: Option<usize>,
    /// The passes have a frame to begin with.
    pub is_started: bool,
    /// First and last stop whose bearings are looked at: all of them but during a start.
    pub window: [u16; 2],
    /// A camera that is off since some stop, and why that may be.
    pub suspect: Option<Suspect<T>>,
}

/// A camera of which the last bearings are off: it was moved, or the way there was not as measured. Both are
/// tried.
#[derive(Clone, Copy, Debug)]
pub(super) struct Suspect<T> {
    pub camera: u16,
    /// The first stop at which it is off.
    pub from: u16,
    /// The leg that is left out to see whether that explains it, and what it was off as chi squared.
    pub leg: Option<(u16, T)>,
}

/// The numbers of an estimator, whatever its capacities: the mathematics exists once for all of
/// them.
pub(super) struct Problem<'a, T: Real> {
    pub common: &'a mut Common<T>,
    pub stops: &'a mut [Stop<T>],
    pub sights: &'a mut [Sight<T>],
    pub visits: &'a [Visit<T>],
    pub cameras: &'a mut [Unknown<T>],
    pub marks: &'a mut [Unknown<T>],
    pub workspace: &'a mut [T],
}

/// A bearing's or a range's residual around the present estimates, over its sigma.
pub(super) struct SightRow<T: Real> {
    pub residual: T,
    /// By the place; by the camera's place it is the negative.
    pub by_place: Vector2<T>,
    /// By the camera's heading.
    pub by_heading: T,
    /// By its lens.
    pub by_lens: T,
}

/// Columns of a camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Columns {
    /// Of its place, unless it is a reference.
    pub place: Option<usize>,
    pub heading: usize,
    /// Of its lens, if lenses are estimated.
    pub lens: Option<usize>,
}

/// A leg's, one of two rows.
pub(super) struct LegRow<T: Real> {
    pub residual: T,
    /// By the later place; by the earlier it is the negative.
    pub by_place: Vector2<T>,
    pub by_carrier: Vector2<T>,
}

impl<T: Real> Problem<'_, T> {
    /// Columns in use, that of the right side included.
    pub(super) fn width(&self) -> usize {
        let used = |unknowns: &[Unknown<T>]| unknowns.iter().filter(|u| u.column.is_some()).count();
        let lens = self.lens_columns();
        KEPT + lens * REFERENCES + (3 + lens) * used(self.cameras) + 2 * used(self.marks) + 1
    }

    /// Columns of one lens: one, or none if they are not estimated.
    pub(super) fn lens_columns(&self) -> usize {
        usize::from(self.common.lens_prior.is_some())
    }

    /// Gives everything that is estimated its column.
    pub(super) fn lay_out(&mut self) {
        let lens = self.lens_columns();
        let mut next = KEPT + lens * REFERENCES;
        let visits = self.visits;
        for (mark, number) in self.marks.iter_mut().zip(0_u16..) {
            let visited = visits.iter().any(|visit| visit.mark == number);
            mark.column = visited.then_some(0);
        }
        let cameras = self.cameras.iter_mut().map(|camera| (camera, 3 + lens));
        let marks = self.marks.iter_mut().map(|mark| (mark, 2));
        for (unknown, columns) in cameras.chain(marks) {
            if unknown.column.is_some() {
                unknown.column = u16::try_from(next).ok();
                next += columns;
            }
        }
    }

    /// The triangle, and vectors as long as its rows.
    pub(super) fn triangle(&mut self) -> Option<(Triangle<'_, T>, [&mut [T]; VECTORS])> {
        let width = self.width();
        let (triangle, vectors) = self.workspace.split_at_mut_checked(packed(width))?;
        let mut vectors = vectors.chunks_exact_mut(width.max(1));
        let vectors = [vectors.next()?, vectors.next()?, vectors.next()?];
        Some((Triangle::new(triangle, width)?, vectors))
    }

    /// Where a camera is thought to be.
    pub(super) fn camera(&self, camera: usize) -> Option<Vector3<T>> {
        let value = self.cameras.get(camera)?.value;
        // References stand where the frame says, whatever their numbers hold.
        Some(match camera {
            0 => Vector3::new(T::zero(), T::zero(), value.z),
            1 => Vector3::new(self.common.baseline, T::zero(), value.z),
            _ => value.xyz(),
        })
    }

    /// Whether a camera's bearings are used: it is a reference, or admitted.
    pub(super) fn is_estimated(&self, camera: usize) -> bool {
        camera < REFERENCES || self.cameras.get(camera).is_some_and(|c| c.column.is_some())
    }

    /// Whether a camera is what another one became when it was moved.
    pub(super) fn is_successor(&self, camera: usize) -> bool {
        let of = |other: &Unknown<T>| other.successor.map(usize::from) == Some(camera);
        self.cameras.iter().any(of)
    }

    /// Gives bearings since a move to the camera that the moved one became or, where there is none,
    /// leaves them out.
    pub(super) fn sort_moved(&mut self) {
        for sight in self.sights.iter_mut() {
            // Nobody becomes who was there before, so this ends.
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

    /// Cameras that seemed to be moved near this stop, or anywhere, were not: what they saw is their own
    /// again.
    pub(super) fn undo_moves(&mut self, near: Option<usize>) {
        for camera in 0..self.cameras.len() {
            let Some(unknown) = self.cameras.get_mut(camera) else {
                return;
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
    }

    /// Columns of a camera that is estimated.
    pub(super) fn columns(&self, camera: usize) -> Option<Columns> {
        let has_lens = self.common.lens_prior.is_some();
        if camera < REFERENCES {
            return Some(Columns {
                place: None,
                heading: HEADINGS + camera,
                lens: has_lens.then_some(KEPT + camera),
            });
        }
        let place = usize::from(self.cameras.get(camera)?.column?);
        Some(Columns {
            place: Some(place),
            heading: place + 2,
            lens: has_lens.then_some(place + 3),
        })
    }

    /// A bearing as it would be measured through a right lens, and by how much it changes with the
    /// lens: `d atan((1 + e) tan b) / de`.
    pub(super) fn through_lens(&self, sight: &Sight<T>) -> (T, T) {
        if self.common.lens_prior.is_none() {
            return (sight.value, T::zero());
        }
        let camera = self.cameras.get(usize::from(sight.camera));
        let lens = camera.map_or_else(T::zero, |camera| camera.value.w);
        let ray = plane::unit(sight.value);
        let true_ray = Vector2::new(ray.x, ray.y * (lens + T::one()));
        let by_lens = ray.x * ray.y / dot(true_ray, true_ray);
        (true_ray.y.atan2(true_ray.x), by_lens)
    }

    /// A bearing for those who do not estimate lenses, with its standard deviation.
    pub(super) fn bearing_at(&self, sight: &Sight<T>) -> (T, T) {
        let (bearing, by_lens) = self.through_lens(sight);
        let Some(prior) = self.common.lens_prior else {
            return (bearing, sight.sigma);
        };
        let of_lens = by_lens * prior;
        (
            bearing,
            (sight.sigma * sight.sigma + of_lens * of_lens).sqrt(),
        )
    }

    /// A bearing's or a range's row; `None` if its camera is not estimated or the target is right on it.
    pub(super) fn sight_row(&self, sight: &Sight<T>) -> Option<SightRow<T>> {
        let camera = usize::from(sight.camera);
        let [first, last] = self.common.window;
        if !self.is_estimated(camera) || sight.stop < first || sight.stop > last {
            return None;
        }
        let pose = self.camera(camera)?;
        let place = self.stops.get(usize::from(sight.stop))?.place;
        let to_target = place.coords - pose.xy();
        let range2 = dot(to_target, to_target);
        if !(range2 > T::zero()) {
            return None;
        }
        // Where the target stood when this camera looked is a little beside where it stopped.
        let (sigma, standing) = (sight.sigma, self.common.standing);
        if sight.quantity == Quantity::Range {
            let weight = (sigma * sigma + standing * standing).sqrt().recip();
            let range = range2.sqrt();
            return Some(SightRow {
                residual: (range - sight.value) * weight,
                by_place: to_target * (weight / range),
                by_heading: T::zero(),
                by_lens: T::zero(),
            });
        }
        let weight = (sigma * sigma + standing * standing / range2)
            .sqrt()
            .recip();
        let (bearing, by_lens) = self.through_lens(sight);
        let off = to_target.y.atan2(to_target.x) - pose.z - bearing;
        Some(SightRow {
            residual: angle::wrap_signed(off) * weight,
            by_place: quarter_turn(to_target) * (weight / range2),
            by_heading: -weight,
            by_lens: -by_lens * weight,
        })
    }

    /// A leg's two rows: how the carrier would have measured the way between the two places, less
    /// how it did, whitened.
    /// One that is excluded still ties its ends together, but loosely.
    pub(super) fn leg_rows(&self, later: usize) -> Option<[LegRow<T>; 2]> {
        let stop = self.stops.get(later)?;
        let [w11, _, w22] = stop.root;
        let length = dot(stop.displacement, stop.displacement).sqrt();
        let weight = if stop.standing == Standing::Counts {
            T::one()
        } else {
            let claims = w11.max(w22) * length * lit(EXCLUDED_LEG);
            lit::<T>(EXCLUDED_LEG) / claims.max(T::one())
        };
        let rows = self.leg_rows_of(later)?;
        Some(rows.map(|row| LegRow {
            residual: row.residual * weight,
            by_place: row.by_place * weight,
            by_carrier: row.by_carrier * weight,
        }))
    }

    /// The same as they were measured, excluded or not.
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

    /// Where a visited mark lies from the place of a visit, over the visit's sigma.
    pub(super) fn visit_rows(&self, visit: &Visit<T>) -> Option<(Vector2<T>, T, usize)> {
        let mark = self.marks.get(usize::from(visit.mark))?;
        let place = self.stops.get(usize::from(visit.stop))?.place;
        let weight = visit.sigma.recip();
        let off = (place.coords - mark.value.xy()) * weight;
        Some((off, weight, usize::from(mark.column?)))
    }

    /// A displacement by dead reckoning: as the carrier measured it, less what is thought to be
    /// wrong with it.
    pub(super) fn true_way(&self, displacement: Vector2<T>) -> Vector2<T> {
        let turned = plane::mul_conj(displacement, plane::unit(self.common.carrier.y));
        turned / self.common.carrier.x
    }
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
