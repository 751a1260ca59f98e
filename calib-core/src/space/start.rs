//! Starts without a guess.

use nalgebra::{Complex, Point2, Point3, Vector3};

use super::{Pose, adjustment::Problem};
use crate::{Ray, Real, angle::wrap_signed, numerics::real::lit, resection};

/// Most starts of the scan.
pub(super) const MOST: usize = 8;

/// Most sightings that a start looks at.
const LOOKED_AT: usize = 16;

/// Steps of pitch and roll, radians: 5 and 15 degrees.
const PITCH_STEP: f64 = 0.087_266_46;
const ROLL_STEP: f64 = 0.261_799_39;

/// Rolls of a whole turn.
const FULL: i32 = 24;

/// Of a roll that is told to be within this, three are tried, radians: 8 degrees.
const NARROW: f64 = 0.14;

/// A target and the direction that it was seen in.
struct Seen<T: Real> {
    target: Point3<T>,
    direction: Vector3<T>,
}

/// A look of a camera that was set upright.
struct Upright<T> {
    /// Place of the target in the plane.
    place: Complex<T>,
    /// `(forward + i left) / down`
    w: Complex<T>,
    weight: T,
    /// Height of the target above the middle of all.
    above: T,
}

type Looks<T> = heapless::Vec<Seen<T>, LOOKED_AT>;

/// A pose with its cost.
type Candidate<T> = (Pose<T>, T);

/// Poses to begin with.
pub(super) fn starts<T: Real>(problem: &Problem<'_, T>) -> heapless::Vec<Pose<T>, { MOST + 1 }> {
    let looks = looks(problem);
    let mut kept: heapless::Vec<Candidate<T>, MOST> = heapless::Vec::new();
    let (middle, step, rolls) = match problem.priors.roll {
        Some(told) if told.sigma <= lit(NARROW) => (told.value, told.sigma * lit(1.5), 3),
        Some(told) => (told.value, lit(ROLL_STEP), FULL),
        None => (T::zero(), lit(ROLL_STEP), FULL),
    };
    for turn in 0..rolls {
        // To both sides in turns.
        let side = f64::from((turn + 1) / 2) * if turn % 2 == 0 { 1.0 } else { -1.0 };
        let roll = wrap_signed(middle + step * lit(side));
        for row in -17..=17_i32 {
            let pitch = lit::<T>(f64::from(row) * PITCH_STEP);
            if let Some(candidate) = upright(&looks, pitch, roll) {
                keep(&mut kept, candidate, step);
            }
        }
    }
    let mut poses: heapless::Vec<Pose<T>, { MOST + 1 }> =
        kept.into_iter().map(|(pose, _)| pose).collect();
    if let Some(pose) = level(&looks, middle) {
        // There is room for one more.
        let _ = poses.push(pose);
    }
    poses
}

/// Some of the sightings, evenly chosen, with their directions.
fn looks<T: Real>(problem: &Problem<'_, T>) -> Looks<T> {
    let all = problem.sightings;
    let count = all.len().min(LOOKED_AT);
    (0..count)
        .filter_map(|k| {
            let sighting = all.get(k * all.len() / count)?;
            Some(Seen {
                target: sighting.target,
                direction: problem.lens.direction(&sighting.pixel)?,
            })
        })
        .collect()
}

/// Keeps the best few candidates, one of those that are neighbours.
fn keep<T: Real>(kept: &mut heapless::Vec<Candidate<T>, MOST>, new: Candidate<T>, step: T) {
    let is_near = |old: &Candidate<T>| {
        (old.0.pitch - new.0.pitch).abs() < lit(2.5 * PITCH_STEP)
            && wrap_signed(old.0.roll - new.0.roll).abs() < step * lit(1.5)
    };
    if kept.iter().any(|old| is_near(old) && old.1 <= new.1) {
        return;
    }
    kept.retain(|old| !is_near(old));
    let Err(new) = kept.push(new) else {
        return;
    };
    let worst = kept.iter_mut().reduce(|a, b| if a.1 < b.1 { b } else { a });
    if let Some(worst) = worst.filter(|worst| new.1 < worst.1) {
        *worst = new;
    }
}

/// A direction in a level camera's axes of the same heading: forward, left, up.
fn level_axes<T: Real>(direction: &Vector3<T>, pitch: T, roll: T) -> Vector3<T> {
    let (sp, cp) = pitch.sine_cosine();
    let (sr, cr) = roll.sine_cosine();
    let left = direction.y * cr - direction.z * sr;
    let up = direction.y * sr + direction.z * cr;
    Vector3::new(direction.x * cp + up * sp, left, up * cp - direction.x * sp)
}

/// The pose of this pitch and roll that fits best, with its cost; `None` with a target at the horizon, or
/// on both sides of it.
fn upright<T: Real>(looks: &Looks<T>, pitch: T, roll: T) -> Option<Candidate<T>> {
    let zero = Complex::new(T::zero(), T::zero());
    let mut level: heapless::Vec<Upright<T>, LOOKED_AT> = heapless::Vec::new();
    let mut is_below = None;
    let count = T::whole(u32::try_from(looks.len()).ok()?);
    let middle = looks
        .iter()
        .fold(T::zero(), |sum, seen| sum + seen.target.z)
        / count;
    for seen in looks {
        let turned = level_axes(&seen.direction, pitch, roll);
        let down = -turned.z;
        if !(down.abs() > lit::<T>(1e-3) * turned.norm()) {
            return None;
        }
        if *is_below.get_or_insert(down > T::zero()) != (down > T::zero()) {
            return None;
        }
        let w = Complex::new(turned.x / down, turned.y / down);
        // A mistake of the angle moves `w` by `1 + |w|^2`: far ones count less.
        let far = T::one() + w.re * w.re + w.im * w.im;
        // As many as there are looks.
        let _ = level.push(Upright {
            place: Complex::new(seen.target.x, seen.target.y),
            w,
            weight: (far * far).recip(),
            above: seen.target.z - middle,
        });
    }
    let total = level.iter().fold(T::zero(), |sum, one| sum + one.weight);
    let (mut foot, mut stretch) = (zero, zero);
    // First as if all were at one height, then with their heights.
    for _ in 0..2 {
        let size = modulus(stretch);
        let direction = match size > T::zero() {
            true => scale(stretch, size.recip()),
            false => zero,
        };
        let direction = match is_below {
            Some(false) => -direction,
            _ => direction,
        };
        let lowered = |one: &Upright<T>| one.place + scale(direction * one.w, one.above);
        let (mut place, mut w) = (zero, zero);
        for one in &level {
            place += scale(lowered(one), one.weight / total);
            w += scale(one.w, one.weight / total);
        }
        let (mut cross, mut square) = (zero, T::zero());
        for one in &level {
            let off = one.w - w;
            cross += scale((lowered(one) - place) * off.conj(), one.weight);
            square += one.weight * (off.re * off.re + off.im * off.im);
        }
        if !(square > T::zero()) {
            return None;
        }
        stretch = scale(cross, square.recip());
        foot = place - stretch * w;
    }
    let size = modulus(stretch);
    if !(size > T::zero()) {
        return None;
    }
    let sign = if is_below == Some(false) {
        -T::one()
    } else {
        T::one()
    };
    let direction = scale(stretch, sign / size);
    let cost = level.iter().fold(T::zero(), |sum, one| {
        let off = one.place + scale(direction * one.w, one.above) - foot - stretch * one.w;
        sum + one.weight * (off.re * off.re + off.im * off.im)
    });
    let pose = Pose {
        position: Point3::new(foot.re, foot.im, middle + sign * size),
        heading: direction.im.atan2(direction.re),
        pitch,
        roll,
    };
    Some((pose, cost / (size * size)))
}

/// The pose of a camera among the targets, at their height.
fn level<T: Real>(looks: &Looks<T>, roll: T) -> Option<Pose<T>> {
    let sum = looks.iter().fold(Vector3::zeros(), |sum, seen| {
        sum + seen.direction.normalize()
    });
    let upright = level_axes(&sum, T::zero(), roll);
    let pitch = upright.z.atan2(upright.x);
    let count = T::whole(u32::try_from(looks.len()).ok()?);
    let height = looks
        .iter()
        .fold(T::zero(), |sum, seen| sum + seen.target.z)
        / count;
    let sightings: heapless::Vec<_, LOOKED_AT> = looks
        .iter()
        .map(|seen| {
            let turned = level_axes(&seen.direction, pitch, roll);
            let ray = Ray::from_bearing(turned.y.atan2(turned.x));
            crate::Sighting::new(Point2::new(seen.target.x, seen.target.y), ray, lit(1e-2))
        })
        .collect();
    let plane = resection::solve(&sightings).ok()?.pose;
    Some(Pose {
        position: Point3::new(plane.position.x, plane.position.y, height),
        heading: plane.heading,
        pitch,
        roll,
    })
}

fn modulus<T: Real>(number: Complex<T>) -> T {
    (number.re * number.re + number.im * number.im).sqrt()
}

fn scale<T: Real>(number: Complex<T>, factor: T) -> Complex<T> {
    Complex::new(number.re * factor, number.im * factor)
}
