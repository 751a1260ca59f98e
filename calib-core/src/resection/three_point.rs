//! Three sightings, closed form, from rays.
//!
//! Write places and rays as complex numbers. With targets `b1 b2 b3` and rays `u1 u2 u3` of any
//! positive length, `m12 = u2 conj(u1)` turns the first ray towards the second one and
//! `m23 = u3 conj(u2)` the second one towards the third. Let `s12`, `s23` be their imaginary
//! parts and
//! ```text
//! B1 = (b1 - b2) m12          Z = s23 B1 + s12 B3
//! B3 = (b3 - b2) conj(m23)    c = Im(B1 conj(B3))
//! ```
//! Then the camera is at `b2 + (c / |Z|^2) Z`, and its optical axis points along `-c Z conj(u2)`.
//! One division, no branch and no trigonometry; the heading comes out over the full circle. The
//! algebra is in the spirit of Betke and Gurvits, "Mobile robot localization using landmarks",
//! IEEE Trans. Robotics and Automation 13(2), 1997.
//!
//! `Z` vanishes exactly where three bearings do not determine a place: on the circle through the
//! targets, on the line of collinear ones, and for coincident ones.

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use crate::{
    Pose, Real, Refusal, Sighting,
    numerics::{
        plane::{cross, dot, mul, mul_conj, quarter_turn, taxicab},
        real::lit,
    },
};

/// Place and direction from three sightings, without their uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix<T: Real> {
    /// The camera's centre.
    pub position: Point2<T>,
    /// A vector along the optical axis, of arbitrary positive length.
    pub axis: Vector2<T>,
}

impl<T: Real> Fix<T> {
    /// Direction of the optical axis, radians in `[0, 2 pi)`.
    #[inline]
    pub fn heading(&self) -> T {
        // From the opposite direction, so that only the seam needs a comparison.
        let heading = (-self.axis.y).atan2(-self.axis.x) + T::pi();
        if heading < T::two_pi() {
            heading
        } else {
            T::zero()
        }
    }

    /// Adds the heading and the covariance that the sightings' sigmas imply (see the module
    /// [`resection`](crate::resection#uncertainty)).
    ///
    /// # Errors
    /// [`Refusal::NotFinite`] if a sigma is not finite, or the covariance overflows.
    #[inline]
    pub fn into_pose(self, sightings: &[Sighting<T>; 3]) -> Result<Pose<T>, Refusal> {
        let [s1, s2, s3] = sightings;
        let [d1, d2, d3] = [s1, s2, s3].map(|s| s.target - self.position);
        let [row1, row2, row3] = [d1, d2, d3].map(|d| Vector3::new(d.y, -d.x, -dot(d, d)));
        // Rows scaled by the squared range, so that nothing is divided before the determinant:
        // the columns of the inverse, times the determinant, are the cross products of the rows.
        let columns = [row2.cross(&row3), row3.cross(&row1), row1.cross(&row2)];
        let determinant = row1.dot(&row2.cross(&row3));
        // Twice by the determinant: its square leaves single precision where targets are some
        // 50,000 units away.
        let scale = determinant.recip();
        let variances = [(s1, d1), (s2, d2), (s3, d3)]
            .map(|(s, d)| s.bearing_variance_range4(d) * scale * scale);
        let mut covariance = Matrix3::<T>::zeros();
        for (column, variance) in columns.iter().zip(variances) {
            let weighted = column * variance;
            covariance.m11 += weighted.x * column.x;
            covariance.m12 += weighted.x * column.y;
            covariance.m13 += weighted.x * column.z;
            covariance.m22 += weighted.y * column.y;
            covariance.m23 += weighted.y * column.z;
            covariance.m33 += weighted.z * column.z;
        }
        covariance.m21 = covariance.m12;
        covariance.m31 = covariance.m13;
        covariance.m32 = covariance.m23;
        // A sum of squares is finite only if every part is, and zero only for sigmas of zero.
        let total = covariance.m11 + covariance.m22 + covariance.m33;
        if !(total.is_finite() && total > T::zero()) {
            return Err(Refusal::NotFinite);
        }
        Ok(Pose {
            position: self.position,
            heading: self.heading(),
            covariance,
        })
    }
}

/// Place and direction of the camera that made these three sightings.
///
/// # Errors
/// [`Refusal::CoincidentTargets`], [`Refusal::DangerCircle`], [`Refusal::DangerLine`] where the
/// geometry leaves no digit of the answer; [`Refusal::TargetBehind`]; [`Refusal::NotFinite`].
/// Poor geometry that is not quite degenerate is *answered*, with a covariance that says so.
#[inline]
pub fn fix<T: Real>(sightings: &[Sighting<T>; 3]) -> Result<Fix<T>, Refusal> {
    let [s1, s2, s3] = sightings;
    let [u1, u2, u3] = [s1, s2, s3].map(|s| s.ray.vector());
    let m12 = mul_conj(u2, u1);
    let m23 = mul_conj(u3, u2);
    let to_b1 = mul(s1.target - s2.target, m12);
    let to_b3 = mul_conj(s3.target - s2.target, m23);
    let z = to_b1 * m23.y + to_b3 * m12.y;
    let minus_c = cross(to_b1, to_b3);
    let z2 = dot(z, z);
    let minus_cz = z * minus_c;

    // In front means a positive range along the ray. That of the second target always is positive; those of
    // the others have the sign of these numbers, of which the common positive factors are left out.
    let c2 = minus_c * minus_c;
    let front1 = c2 * m12.x + dot(minus_cz, to_b1);
    let front3 = c2 * m23.x + dot(minus_cz, to_b3);
    let in_front = front1 > T::zero() && front3 > T::zero();
    // Two equal targets make their ranges zero; of these two only up to rounding.
    let apart = s1.target != s3.target;

    // The effect of the rays' rounding alone on Z. Below it no digit is left.
    let noise = lit::<T>(24.0) * T::default_epsilon();
    let noise2 =
        (dot(to_b1, to_b1) * dot(m23, m23) + dot(to_b3, to_b3) * dot(m12, m12)) * (noise * noise);
    let determined = z2 > noise2;
    if !(in_front && apart && determined) {
        return Err(why_not(sightings, determined));
    }
    Ok(Fix {
        position: s2.target - minus_cz * z2.recip(),
        axis: mul_conj(minus_cz, u2),
    })
}

/// [`fix`] with its covariance.
///
/// # Errors
/// As [`fix`].
#[inline]
pub fn solve<T: Real>(sightings: &[Sighting<T>; 3]) -> Result<Pose<T>, Refusal> {
    fix(sightings)?.into_pose(sightings)
}

/// Names the reason; off the usual path, so that the usual path stays short.
#[cold]
#[inline(never)]
fn why_not<T: Real>(sightings: &[Sighting<T>; 3], determined: bool) -> Refusal {
    if !sightings.iter().all(Sighting::is_usable) {
        return Refusal::NotFinite;
    }
    let [a, b, c] = sightings.each_ref().map(|s| s.target);
    let [ab, bc, ca] = [b - a, c - b, a - c];
    let size = taxicab(ab) + taxicab(bc) + taxicab(ca);
    // Coordinates are known to their own rounding, not to that of their differences.
    let rounding = (taxicab(a.coords) + size) * (T::default_epsilon() * lit(4.0));
    if [ab, bc, ca].iter().any(|&d| taxicab(d) <= rounding) {
        Refusal::CoincidentTargets
    } else if determined {
        Refusal::TargetBehind
    } else if dot(quarter_turn(ab), bc).abs() <= rounding * size {
        Refusal::DangerLine
    } else {
        Refusal::DangerCircle
    }
}
