//! Closed-form answers from two or three stops, for least squares to start from.
//!
//! **Two circles.** Camera `k` sees the displacement `L` between two stops under the angle between
//! its two rays, `m_k = u_k' conj(u_k)`. Relative to the first of the two stops it is therefore at
//! a place `c` with `s |c|^2 + Im(conj(m) L conj(c)) = 0`, `s = Im m`: a circle through both stops
//! (a line when `s` is zero). Both cameras are tied together by the baseline, `c_1 = c_0 + d`, so
//! `c_0` is on two circles, which meet in up to two points. When noise makes them miss each other,
//! the point of the radical line closest to both stands in.
//!
//! **Two resections.** In the displacements' own frame all stops are known, so each camera solves
//! three of them like any other camera does. The baseline's length and the frame's heading follow.

use nalgebra::{Vector2, Vector6};

use super::{Known, Stop, model::Bearings};
use crate::{
    Ray, Real, Refusal, Sighting,
    numerics::{
        angle,
        plane::{cross, dot, mul, mul_conj, quarter_turn, taxicab, unit},
        ranking::Ranking,
        real::lit,
        subsets,
    },
    resection::three_point::{self, Fix},
};

/// Starts for least squares, by how well they fit all stops. Duplicates of one answer come from
/// different pairs of stops.
pub(super) type Proposals<T> = Ranking<T, Vector6<T>, 6>;

/// Headings of two cameras that may be those of one answer, radians.
const ALIKE: f64 = 0.15;
/// Starts of one answer, at most: two places that are visited again and again give dozens, and the other answer counts
/// as well.
const OF_ONE: usize = 2;

/// Trial headings for a frame whose heading is not known: every 15 degrees.
const TRIAL_HEADINGS: u32 = 24;

/// Number of parts in which the closed forms propose.
pub(super) fn parts<T: Real>(known: &Known<T>) -> u32 {
    if known.baseline.is_some() && known.frame_heading.is_none() {
        1 + TRIAL_HEADINGS
    } else {
        1
    }
}

/// Offers the candidates of one of the [parts].
///
/// # Errors
/// The reason why a closed form refused some stops.
#[inline(never)] // for less stack
pub(super) fn propose<T: Real>(
    problem: &Bearings<'_, T>,
    part: u32,
    proposals: &mut Proposals<T>,
) -> Result<(), Refusal> {
    let mut best = Best { problem, proposals };
    let Known {
        baseline,
        frame_heading,
    } = *problem.known;
    let (Some(baseline), true) = (baseline, frame_heading.is_some() || part > 0) else {
        return best.offer_resections();
    };
    let trial = || T::two_pi() * (T::whole(part) / T::whole(TRIAL_HEADINGS));
    best.offer_circles(baseline, frame_heading.unwrap_or_else(trial));
    Ok(())
}

struct Best<'a, T: Real> {
    problem: &'a Bearings<'a, T>,
    proposals: &'a mut Proposals<T>,
}

impl<T: Real> Best<'_, T> {
    fn offer(&mut self, x: Vector6<T>) {
        let limit = self.proposals.limit();
        // Most candidates are far off, which a few stops show.
        if let Some(cost) = self.problem.chi_squared(&x, limit) {
            let is_alike = |held: &Vector6<T>| {
                let near = |a: T, b: T| angle::wrap_signed(a - b).abs() < lit(ALIKE);
                near(held.x, x.x) && near(held.y, x.y)
            };
            self.proposals.offer_among(cost, x, OF_ONE, is_alike);
        }
    }

    fn offer_circles(&mut self, baseline: T, frame_heading: T) {
        let turn = unit(frame_heading);
        let to_camera1 = Vector2::new(baseline, T::zero());
        for [i, j] in subsets::pairs(self.problem.stops.len()) {
            let (Some((a, to_a)), Some((b, to_b))) = (self.problem.stop(i), self.problem.stop(j))
            else {
                continue;
            };
            let [ray0, ray1] = a.rays;
            let leg = mul(turn, to_b - to_a);
            for camera0 in meet(&a.rays, &b.rays, leg, baseline).into_iter().flatten() {
                // Relative to the stop, the camera is at `camera0`; it is the origin of the frame.
                let place = -camera0;
                let axis0 = mul_conj(place, ray0.vector());
                let axis1 = mul_conj(place - to_camera1, ray1.vector());
                let first = place - mul(turn, to_a);
                self.offer(Vector6::new(
                    axis0.y.atan2(axis0.x),
                    axis1.y.atan2(axis1.x),
                    first.x,
                    first.y,
                    frame_heading,
                    baseline,
                ));
            }
        }
    }

    /// # Errors
    /// The reason why the last refused triple was.
    fn offer_resections(&mut self) -> Result<(), Refusal> {
        let known = self.problem.known;
        let mut result = Ok(());
        for triple in subsets::triples(self.problem.stops.len()) {
            let [Some(a), Some(b), Some(c)] = triple.map(|n| self.problem.stop(n)) else {
                continue;
            };
            // A fix needs no sigma.
            let fix = |ray: fn(&Stop<T>) -> Ray<T>| {
                three_point::fix(&[a, b, c].map(|(stop, displacement)| {
                    Sighting::new(displacement.into(), ray(stop), T::one())
                }))
            };
            match (fix(|stop| stop.rays[0]), fix(|stop| stop.rays[1])) {
                (Ok(fix0), Ok(fix1)) => {
                    let mut x = joined(&fix0, &fix1);
                    x.a = known.frame_heading.unwrap_or(x.a);
                    x.b = known.baseline.unwrap_or(x.b);
                    self.offer(x);
                }
                (Err(why), _) | (_, Err(why)) => result = Err(why),
            }
        }
        result
    }
}

/// Two cameras placed in the displacements' frame, seen from the frame of their baseline.
fn joined<T: Real>(fix0: &Fix<T>, fix1: &Fix<T>) -> Vector6<T> {
    let between = fix1.position - fix0.position;
    let length = dot(between, between).sqrt();
    let axis0 = mul_conj(fix0.axis, between);
    let axis1 = mul_conj(fix1.axis, between);
    let first = mul_conj(-fix0.position.coords, between) / length;
    Vector6::new(
        axis0.y.atan2(axis0.x),
        axis1.y.atan2(axis1.x),
        first.x,
        first.y,
        -between.y.atan2(between.x),
        length,
    )
}

/// A circle, or a line, on which a camera is: `s |c|^2 + a . c + k = 0`.
#[derive(Clone, Copy)]
struct Circle<T: Real> {
    s: T,
    a: Vector2<T>,
    k: T,
}

impl<T: Real> Circle<T> {
    /// Where a camera sees the leg from the origin to `leg` under the angle from `from` to `to`.
    fn of_view(from: Ray<T>, to: Ray<T>, leg: Vector2<T>) -> Self {
        let m = mul_conj(to.vector(), from.vector());
        let w = mul_conj(leg, m);
        Self {
            s: m.y,
            a: Vector2::new(w.y, -w.x),
            k: T::zero(),
        }
    }

    /// The same circle for a camera that is `offset` away from the one it is about.
    fn seen_from(self, offset: Vector2<T>) -> Self {
        Self {
            s: self.s,
            a: self.a + offset * (self.s + self.s),
            k: self.k + dot(self.a, offset) + self.s * dot(offset, offset),
        }
    }
}

/// The places of camera 0, relative to the first of two stops, from which both cameras see both
/// stops in front of them.
fn meet<T: Real>(
    from: &[Ray<T>; 2],
    to: &[Ray<T>; 2],
    leg: Vector2<T>,
    baseline: T,
) -> [Option<Vector2<T>>; 2] {
    let offset = Vector2::new(baseline, T::zero());
    let ([from0, from1], [to0, to1]) = (*from, *to);
    let circle0 = Circle::of_view(from0, to0, leg);
    let circle1 = Circle::of_view(from1, to1, leg).seen_from(offset);
    intersections(circle0, circle1).map(|point| {
        point.filter(|&c| {
            in_front(from0, to0, -c, leg - c) && in_front(from1, to1, -c - offset, leg - c - offset)
        })
    })
}

/// The one of the two arcs over a leg from which the rays point at the stops and not away from them: the
/// ranges along both rays have the same sign, and turning the camera makes it positive.
fn in_front<T: Real>(
    from: Ray<T>,
    to: Ray<T>,
    to_first: Vector2<T>,
    to_second: Vector2<T>,
) -> bool {
    let axis = mul_conj(to_first, from.vector());
    dot(mul(axis, to.vector()), to_second) > T::zero()
}

fn intersections<T: Real>(p: Circle<T>, q: Circle<T>) -> [Option<Vector2<T>>; 2] {
    // The radical line n . c + k = 0: the combination of both circles without |c|^2.
    let n = p.a * q.s - q.a * p.s;
    let k = p.k * q.s - q.k * p.s;
    let n2 = dot(n, n);
    if p.s == T::zero() && q.s == T::zero() {
        // Two lines.
        let parallel = cross(p.a, q.a);
        let point = (quarter_turn(q.a) * p.k - quarter_turn(p.a) * q.k) / parallel;
        return [taxicab(point).is_finite().then_some(point), None];
    }
    let foot = n * (-k / n2);
    if !taxicab(foot).is_finite() {
        return [None, None];
    }
    // Along the line, from its foot: s t^2 + 2 h t + g = 0, by the rounder of the two circles.
    let circle = if p.s.abs() > q.s.abs() { p } else { q };
    let along = quarter_turn(n) / n2.sqrt();
    let h = (dot(circle.a, along)) * lit(0.5);
    let g = circle.s * dot(foot, foot) + dot(circle.a, foot) + circle.k;
    let discriminant = h * h - circle.s * g;
    if discriminant <= T::zero() {
        // They miss, or touch: the middle of the gap.
        return [Some(foot - along * (h / circle.s)), None];
    }
    // Without cancellation: the larger root first, the other from the product of both.
    let root = discriminant.sqrt();
    let sum = -(h + if h < T::zero() { -root } else { root });
    let [t1, t2] = [sum / circle.s, g / sum];
    [t1, t2].map(|t| {
        let point = foot + along * t;
        taxicab(point).is_finite().then_some(point)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The circle through two points, its centre so far beside their middle.
    fn through(a: Vector2<f64>, b: Vector2<f64>, beside: f64, s: f64) -> Circle<f64> {
        let centre = (a + b) * 0.5 + quarter_turn(b - a).normalize() * beside;
        Circle {
            s,
            a: centre * (-2.0 * s),
            k: s * (centre.norm_squared() - (a - centre).norm_squared()),
        }
    }

    /// Also where one of the points is next to the foot of the radical line, so that its formula
    /// subtracts two numbers that are nearly one.
    #[test]
    fn circles_meet_where_they_were_made_to_meet() {
        for turned in 0..16 {
            let along = unit(f64::from(turned) * 0.4);
            let foot = quarter_turn(along) * 1.5;
            for [near, far] in [[1e-9, 5.0], [1e-9, -5.0], [-2.0, 3.0], [1.0, 4.0]] {
                let (a, b) = (foot + along * near, foot + along * far);
                for s in [1.0, -0.7] {
                    let p = through(a, b, 2.0, s);
                    let q = through(a, b, -1.0, 0.5);
                    let points = intersections(p, q).map(Option::unwrap);
                    for expected in [a, b] {
                        let off = points.map(|point| (point - expected).norm());
                        assert!(off[0].min(off[1]) < 1e-12, "{near} {far} {s}: {off:?}");
                    }
                }
            }
        }
    }

    /// For cameras that see no angle between their rays the circles are lines.
    #[test]
    fn lines_meet_where_they_cross() {
        let crossing = Vector2::new(3.0, -2.0);
        let line = |angle: f64| {
            let a = unit(angle) * 1.7;
            let (s, k) = (0.0, -a.dot(&crossing));
            Circle { s, a, k }
        };
        for (p, q) in [(0.3, 1.1), (2.0, 5.5), (4.0, 0.1)] {
            let [point, none] = intersections(line(p), line(q));
            assert!((point.unwrap() - crossing).norm() < 1e-12 && none.is_none());
        }
        // One of them through the origin, as that of the first camera is.
        let through_origin = Circle {
            k: 0.0,
            ..line(2.0)
        };
        let point = intersections(through_origin, line(0.5))[0].unwrap();
        assert!(through_origin.a.dot(&point).abs() < 1e-12);
        assert!((line(0.5).a.dot(&point) + line(0.5).k).abs() < 1e-12);
        assert_eq!(intersections(line(1.0), line(1.0)), [None; 2]);
    }
}
