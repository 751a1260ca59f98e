//! One object: place, velocity, and its common errors with the cameras' poses.

use nalgebra::{Matrix2, Matrix4, Matrix4x3, Point2, SMatrix, SVector, Vector2, Vector3, Vector4};

use super::{Look, Settings};
use crate::{
    Pose, Real,
    intersection::{self, StationBearing},
    numerics::{cholesky::Cholesky, plane::dot, real::lit},
    resection::information::slope,
};

/// Cameras with which an object remembers its common errors. If there are more, the one that was not heard
/// for longest counts as independent again.
const SHARED: usize = 8;

/// No bearing is surer, radians, and no range as a share of it, whatever it claims: one false look that
/// claims to be exact would put an object where no other look agrees.
const SUREST: f64 = 2e-4;

/// The velocity is believed no longer than this without a look, microseconds.
const LONGEST_STEP: u64 = 10_000_000;

/// Common errors of an object and of a camera's pose.
#[derive(Clone, Copy, Debug)]
struct Shared<T: Real> {
    camera: u16,
    /// The pose as it was. The common errors with a later one are not known.
    position: Point2<T>,
    heading: T,
    /// Covariance of the object's state and the camera's `(x, y, heading)`.
    covariance: Matrix4x3<T>,
    heard: u64,
}

impl<T: Real> Shared<T> {
    fn is_same(&self, other: &Self) -> bool {
        (self.camera, self.position, self.heading) == (other.camera, other.position, other.heading)
    }

    fn is_of(&self, camera: u16, pose: &Pose<T>) -> bool {
        self.camera == camera && self.position == pose.position && self.heading == pose.heading
    }
}

/// A nearly constant velocity.
#[derive(Clone, Copy, Debug)]
pub(super) struct State<T: Real> {
    /// x, y and their rates.
    pub(super) x: Vector4<T>,
    pub(super) covariance: Matrix4<T>,
    /// Time of the state.
    pub(super) at: u64,
    shared: [Option<Shared<T>>; SHARED],
}

/// Agreement of a look with an object.
#[derive(Clone, Copy, Debug)]
pub(super) struct Agreement<T> {
    /// The squared innovation of bearing and range, each over its variance.
    pub(super) squared: T,
    /// Less by twice the logarithm of the likelihood: the number that is compared between objects.
    pub(super) score: T,
    /// By how much the bearing is off, radians, without sign, and the standard deviation of that.
    pub(super) off: (T, T),
}

/// One number that was measured, about the state.
struct Row<T: Real> {
    /// Measured less expected.
    innovation: T,
    /// Derivatives by the state.
    by_state: Vector4<T>,
    /// Derivatives by the camera's pose.
    by_pose: Vector3<T>,
    /// The measurement's own variance.
    variance: T,
}

impl<T: Real> State<T> {
    /// Where a look and a later one of another camera meet, or where the range of one ends. `None` if they
    /// meet nowhere, or not surely enough.
    pub(super) fn start(
        first: &Look<T>,
        last: Option<&Look<T>>,
        settings: &Settings<T>,
    ) -> Option<Self> {
        let looks = [Some(first), last];
        let bearings = looks.map(|look| look.unwrap_or(first).bearing);
        let count = looks.iter().flatten().count();
        let located = intersection::locate(bearings.get(..count)?).ok()?;
        let variance = located.covariance.trace();
        if !(variance < settings.start_sigma * settings.start_sigma) {
            return None;
        }
        // So little known beforehand that the looks decide; the common errors with the poses follow.
        let unknown = variance * lit(400.0) + lit(1e-6);
        let rate = settings.speed_sigma * settings.speed_sigma;
        let place = located.position;
        let mut state = Self {
            x: Vector4::new(place.x, place.y, T::zero(), T::zero()),
            covariance: Matrix4::from_diagonal(&Vector4::new(unknown, unknown, rate, rate)),
            at: first.at,
            shared: [None; SHARED],
        };
        for look in looks.into_iter().flatten() {
            state.go_to(look.at, settings.agility);
            state.take(look.at, look.camera, &look.bearing, true)?;
        }
        Some(state)
    }

    pub(super) fn place(&self) -> Point2<T> {
        Point2::new(self.x.x, self.x.y)
    }

    pub(super) fn rate(&self) -> Vector2<T> {
        Vector2::new(self.x.z, self.x.w)
    }

    pub(super) fn place_covariance(&self) -> Matrix2<T> {
        let c = &self.covariance;
        Matrix2::new(c.m11, c.m12, c.m21, c.m22)
    }

    /// White noise of acceleration, of this density (Bar-Shalom et al. 2001, 6.2.2).
    pub(super) fn go_to(&mut self, at: u64, agility: T) {
        let Some(time) = at.checked_sub(self.at).filter(|&time| time > 0) else {
            return;
        };
        self.at = at;
        let dt = seconds(time.min(LONGEST_STEP));
        let [state] = &mut self.x.data.0;
        go(state, dt);
        let columns = &mut self.covariance.data.0;
        for column in &mut *columns {
            go(column, dt);
        }
        let [x, y, vx, vy] = columns;
        for (place, rate) in [(x, vx), (y, vy)] {
            for (place, rate) in place.iter_mut().zip(rate) {
                *place += dt * *rate;
            }
        }
        let place = agility * dt * dt * dt / lit(3.0);
        let both = agility * dt * dt * lit(0.5);
        let c = &mut self.covariance;
        c.m11 += place;
        c.m22 += place;
        c.m33 += agility * dt;
        c.m44 += agility * dt;
        c.m13 += both;
        c.m31 += both;
        c.m24 += both;
        c.m42 += both;
        for shared in self.shared.iter_mut().flatten() {
            for column in &mut shared.covariance.data.0 {
                go(column, dt);
            }
        }
    }

    /// Takes a look into account, which may be of a time shortly before the state's. `None` if numbers are
    /// lost by it: then the state is of no use. `is_start`: the state is about the place that the looks
    /// themselves told, and nothing else is known of it.
    fn take(
        &mut self,
        at: u64,
        camera: u16,
        look: &StationBearing<T>,
        is_start: bool,
    ) -> Option<Agreement<T>> {
        let slot = self.slot(camera, &look.pose)?;
        // The object was there, by its velocity; its other movement in so short a time is noise.
        let before = seconds(self.at.saturating_sub(at));
        let back = |place: Vector2<T>| {
            Vector4::new(place.x, place.y, -place.x * before, -place.y * before)
        };
        let velocity = self.rate();
        let to_target = self.x.xy() - velocity * before - look.pose.position.coords;
        let range2 = dot(to_target, to_target);
        let spread = self.covariance.m11 + self.covariance.m22;
        // The bearing is no linear function of the place (second order, ib. 10.3.3).
        let bend = if is_start { T::zero() } else { spread / range2 };
        let by_pose = slope(to_target);
        let own = look.bearing_sigma * look.bearing_sigma;
        let bearing = Row {
            innovation: -look.residual(to_target),
            by_state: back(-by_pose.xy()),
            by_pose,
            variance: own + square(SUREST) + bend * bend * lit(0.5),
        };
        let off = bearing.innovation.abs();
        let (mut squared, variance) = self.update(slot, &look.pose, &bearing)?;
        let mut score = squared + variance.ln();
        if let Some((range, sigma)) = look.range {
            let to_target = self.x.xy() - self.rate() * before - look.pose.position.coords;
            let distance = to_target.norm();
            let along = to_target / distance;
            let row = Row {
                innovation: range - distance,
                by_state: back(along),
                by_pose: Vector3::new(-along.x, -along.y, T::zero()),
                variance: sigma * sigma + square::<T>(SUREST) * range * range,
            };
            let (more, variance) = self.update(slot, &look.pose, &row)?;
            squared += more;
            // In units of the range, so that looks with and without one can be compared.
            score += more + (variance / (range * range)).ln();
        }
        let heard = self.at.max(at);
        if let Some(Some(shared)) = self.shared.get_mut(slot) {
            shared.heard = heard;
        }
        let off = (off, variance.sqrt());
        let agreement = Agreement {
            squared,
            score,
            off,
        };
        (self.is_sound() && squared.is_finite()).then_some(agreement)
    }

    /// Agreement of a look. Apart, so that the state that takes it into account is on the stack once.
    #[inline(never)] // for less stack
    pub(super) fn agreement(
        &self,
        at: u64,
        camera: u16,
        look: &StationBearing<T>,
    ) -> Option<Agreement<T>> {
        { *self }.take(at, camera, look, false)
    }

    /// Takes a look into account that is of this object with this probability.
    #[inline(never)] // for less stack
    pub(super) fn take_share(&mut self, at: u64, camera: u16, look: &StationBearing<T>, share: T) {
        let mut state = *self;
        if state.take(at, camera, look, false).is_some() {
            self.mix(&state, share);
        }
    }

    /// Where a camera's pose is remembered: a new place if it was not yet, or has changed.
    fn slot(&mut self, camera: u16, pose: &Pose<T>) -> Option<usize> {
        let known = |s: &Option<Shared<T>>| s.is_some_and(|s| s.is_of(camera, pose));
        if let Some(slot) = self.shared.iter().position(known) {
            return Some(slot);
        }
        let age = |s: &Option<Shared<T>>| {
            s.filter(|s| s.camera != camera)
                .map_or(0, |s| s.heard.saturating_add(1))
        };
        let slots = self.shared.iter_mut().enumerate();
        let (slot, oldest) = slots.min_by_key(|(_, shared)| age(shared))?;
        *oldest = Some(Shared {
            camera,
            position: pose.position,
            heading: pose.heading,
            covariance: Matrix4x3::zeros(),
            heard: self.at,
        });
        Some(slot)
    }

    /// The filter of Schmidt (1966): the state is corrected, the camera's pose is not, but the common errors
    /// of both are kept. Returns the squared innovation over its variance, and this variance.
    fn update(&mut self, slot: usize, pose: &Pose<T>, row: &Row<T>) -> Option<(T, T)> {
        let of_camera = self.shared.get(slot)?.as_ref()?.covariance;
        let of_pose = times(&pose.covariance, &row.by_pose);
        let with_state = times(&self.covariance, &row.by_state) + times(&of_camera, &row.by_pose);
        let with_pose = transposed_times(&of_camera, &row.by_state) + of_pose;
        let variance =
            inner(&row.by_state, &with_state) + inner(&row.by_pose, &with_pose) + row.variance;
        if !(variance >= row.variance * lit(0.99) && variance.is_finite()) {
            return None;
        }
        let gain = with_state / variance;
        for (n, shared) in self.shared.iter_mut().enumerate() {
            let Some(shared) = shared else { continue };
            let mut with_pose = transposed_times(&shared.covariance, &row.by_state);
            if n == slot {
                with_pose += of_pose;
            }
            add_outer(&mut shared.covariance, &-gain, &with_pose);
        }
        self.x += gain * row.innovation;
        add_outer(&mut self.covariance, &-gain, &with_state);
        self.covariance = (self.covariance + self.covariance.transpose()) * lit::<T>(0.5);
        Some((row.innovation * row.innovation / variance, variance))
    }

    /// Becomes `other` with this probability: mean and covariance of both together.
    fn mix(&mut self, other: &Self, share: T) {
        let rest = T::one() - share;
        let apart = other.x - self.x;
        self.covariance = self.covariance * rest + other.covariance * share;
        add_outer(&mut self.covariance, &(apart * (share * rest)), &apart);
        self.x += apart * share;
        // Slots are the same but for the one that the look took.
        for (one, other) in self.shared.iter_mut().zip(&other.shared) {
            *one = match (&one, other) {
                (Some(mine), Some(new)) if mine.is_same(new) => Some(Shared {
                    covariance: mine.covariance * rest + new.covariance * share,
                    ..*new
                }),
                (_, Some(new)) => Some(Shared {
                    covariance: new.covariance * share,
                    ..*new
                }),
                (_, None) => None,
            };
        }
    }

    /// The squared distance between two places over the covariance of both.
    pub(super) fn distance(&self, other: &Self) -> Option<T> {
        let difference = self.place() - other.place();
        let both = Cholesky::new(self.place_covariance() + other.place_covariance())?;
        Some(both.solve(&difference).dot(&difference))
    }

    fn is_sound(&self) -> bool {
        self.x.iter().all(T::is_finite) && Cholesky::new(self.covariance).is_some()
    }
}

/// Places go on by rates, in one column of a matrix.
fn go<T: Real>([x, y, vx, vy]: &mut [T; 4], dt: T) {
    *x += dt * *vx;
    *y += dt * *vy;
}

// Products of matrices in which no branch to a panic is left.

fn times<T: Real, const R: usize, const C: usize>(
    matrix: &SMatrix<T, R, C>,
    vector: &SVector<T, C>,
) -> SVector<T, R> {
    let mut product = SVector::zeros();
    let [product_column] = &mut product.data.0;
    let [vector] = &vector.data.0;
    for (column, &factor) in matrix.data.0.iter().zip(vector) {
        for (sum, &value) in product_column.iter_mut().zip(column) {
            *sum += value * factor;
        }
    }
    product
}

fn transposed_times<T: Real, const R: usize, const C: usize>(
    matrix: &SMatrix<T, R, C>,
    vector: &SVector<T, R>,
) -> SVector<T, C> {
    let mut product = SVector::zeros();
    let [product_column] = &mut product.data.0;
    let [vector] = &vector.data.0;
    for (sum, column) in product_column.iter_mut().zip(&matrix.data.0) {
        *sum = pairs(column, vector);
    }
    product
}

fn inner<T: Real, const R: usize>(one: &SVector<T, R>, other: &SVector<T, R>) -> T {
    let ([one], [other]) = (&one.data.0, &other.data.0);
    pairs(one, other)
}

fn pairs<T: Real, const R: usize>(one: &[T; R], other: &[T; R]) -> T {
    let products = one.iter().zip(other).map(|(&a, &b)| a * b);
    products.fold(T::zero(), |sum, product| sum + product)
}

/// Adds the product of a column and a row.
fn add_outer<T: Real, const R: usize, const C: usize>(
    matrix: &mut SMatrix<T, R, C>,
    column: &SVector<T, R>,
    row: &SVector<T, C>,
) {
    let ([column], [row]) = (&column.data.0, &row.data.0);
    for (into, &factor) in matrix.data.0.iter_mut().zip(row) {
        for (sum, &value) in into.iter_mut().zip(column) {
            *sum += value * factor;
        }
    }
}

fn square<T: Real>(value: f64) -> T {
    lit(value * value)
}

pub(super) fn seconds<T: Real>(microseconds: u64) -> T {
    // In halves: a node has no numbers of 64 bits to make a real one of.
    let [high, low] = [microseconds >> 32, microseconds].map(|half| T::whole(half as u32));
    high * lit(4_294.967_296) + low * lit(1e-6)
}
