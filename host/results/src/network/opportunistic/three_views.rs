//! Where to begin: three cameras that saw five points, or more, together.
//!
//! With the headings of all three known, a point seen along three rays gives one equation, linear
//! in the cameras' places: that the rays meet,
//! ```text
//! (n3 . u1) (n2 . p2) = (n2 . u1) (n3 . p3)
//! ```
//! with camera 1 at the origin, `u` along a ray and `n` across it. It is the trilinear constraint of
//! one-dimensional cameras: Faugeras, Quan and Sturm, "Self-calibration of a 1D projective camera
//! and its application to the self-calibration of a 2D projective camera", IEEE Trans. PAMI 22(10),
//! 2000. So the two unknown headings are searched, all over, and the places that fit best follow
//! from an eigenvector. Nothing has to be guessed. Lines have no direction: turned by half a turn a
//! camera has the same ones, and which way it looks follows from where the points are.
//!
//! Three views have two solutions in general, however many points there are: Astrom and Oskarsson,
//! "Solutions and ambiguities of the structure and motion problem for 1D retinal vision", J. Math.
//! Imaging and Vision 12, 2000. Both are among the starts. Often one has points behind cameras;
//! otherwise a fourth camera decides.

use std::f64::consts::PI;

use calib_core::angle;
use nalgebra::{Matrix4, Point2, SymmetricEigen, Vector2, Vector3, Vector4};

use super::adjustment::{Scene, Sight};

/// Points that three cameras have to have seen together.
pub(super) const LEAST: usize = 5;
/// Headings that are tried of each camera, over half a turn.
const GRID: usize = 60;
/// Local minima of the search that are followed.
const FOLLOWED: usize = 24;
/// The same solution, in chi squared and in headings to the first camera.
const SAME: f64 = 1e-3;

/// Bearings of one point by all three cameras, with their sigmas.
#[derive(Clone, Copy, Debug)]
pub(super) struct Common {
    pub point: usize,
    pub bearings: [f64; 3],
    pub sigmas: [f64; 3],
}

/// Poses of the second and third camera relative to the first, which is at the origin and looks along the x
/// axis; distances have no unit.
#[derive(Clone, Copy, Debug)]
struct Motion {
    headings: [f64; 2],
    places: [Vector2<f64>; 2],
    cost: f64,
}

fn unit(angle: f64) -> Vector2<f64> {
    Vector2::new(angle.cos(), angle.sin())
}

fn normal(angle: f64) -> Vector2<f64> {
    Vector2::new(angle.sin(), -angle.cos())
}

/// The places that fit headings best, and how badly they do.
fn motion(common: &[Common], headings: [f64; 2]) -> Motion {
    let mut weights = vec![1.0; common.len()];
    let mut places = Vector4::zeros();
    let mut cost = f64::INFINITY;
    // First as if all equations erred alike, then by how much they do.
    for _ in 0..3 {
        let mut sum = Matrix4::zeros();
        for (seen, weight) in common.iter().zip(&weights) {
            let row = equation(seen, headings);
            sum += row * row.transpose() * *weight;
        }
        let eigen = SymmetricEigen::new(sum);
        let least = eigen.eigenvalues.imin();
        places = eigen.eigenvectors.column(least).into_owned();
        cost = 0.0;
        for (seen, weight) in common.iter().zip(&mut weights) {
            *weight = variance(seen, headings, &places).recip();
            let off = equation(seen, headings).dot(&places);
            cost += off * off * *weight;
        }
    }
    Motion {
        headings,
        places: [places.xy(), Vector2::new(places.z, places.w)],
        cost,
    }
}

fn equation(seen: &Common, [second, third]: [f64; 2]) -> Vector4<f64> {
    let [a1, a2, a3] = seen.bearings;
    let (u1, n2, n3) = (unit(a1), normal(second + a2), normal(third + a3));
    let (by_second, by_third) = (n2 * n3.dot(&u1), n3 * -n2.dot(&u1));
    Vector4::new(by_second.x, by_second.y, by_third.x, by_third.y)
}

/// The variance of an equation's residual, to first order.
fn variance(seen: &Common, headings: [f64; 2], places: &Vector4<f64>) -> f64 {
    let [a1, a2, a3] = seen.bearings;
    let [alpha2, alpha3] = [headings[0] + a2, headings[1] + a3];
    let (p2, p3) = (places.xy(), Vector2::new(places.z, places.w));
    let (u1, n1) = (unit(a1), -normal(a1));
    let (n2, n3) = (normal(alpha2), normal(alpha3));
    // Turned, a normal becomes its ray's direction.
    let (u2, u3) = (unit(alpha2), unit(alpha3));
    let by = [
        n3.dot(&n1) * n2.dot(&p2) - n2.dot(&n1) * n3.dot(&p3),
        n3.dot(&u1) * u2.dot(&p2) - u2.dot(&u1) * n3.dot(&p3),
        u3.dot(&u1) * n2.dot(&p2) - n2.dot(&u1) * u3.dot(&p3),
    ];
    let squares = by
        .iter()
        .zip(seen.sigmas)
        .map(|(by, sigma)| (by * sigma).powi(2));
    squares.sum::<f64>().max(f64::MIN_POSITIVE)
}

/// All solutions of three cameras, the best first. Each is a scene of these cameras and the points that all
/// of them saw; the first camera and another one are the frame.
pub(super) fn solutions(
    cameras: [usize; 3],
    common: &[Common],
    (camera_count, point_count): (usize, usize),
) -> Vec<(f64, Scene)> {
    let heading = |scene: &Scene, camera: usize| {
        let of = |camera: usize| scene.cameras[camera].map_or(0.0, |camera| camera.z);
        of(camera) - of(cameras[0])
    };
    let mut found: Vec<(f64, Scene)> = Vec::new();
    for motion in minima(common) {
        let Some(mut scene) = scene(cameras, common, &motion, (camera_count, point_count)) else {
            continue;
        };
        let Some(adjusted) = scene.adjust() else {
            continue;
        };
        let is_in_front = |sight: &Sight| scene.is_in_front(sight) == Some(true);
        if !scene.sights.iter().all(is_in_front) {
            continue;
        }
        let is_same = |(cost, other): &(f64, Scene)| {
            (cost - adjusted.chi_squared).abs() < SAME * (1.0 + cost)
                && cameras.iter().all(|&camera| {
                    let apart = heading(&scene, camera) - heading(other, camera);
                    angle::wrap_signed(apart).abs() < SAME
                })
        };
        if !found.iter().any(is_same) {
            found.push((adjusted.chi_squared, scene));
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found
}

/// The search's local minima, the best first.
fn minima(common: &[Common]) -> Vec<Motion> {
    let heading = |n: usize| PI * n as f64 / GRID as f64;
    let all: Vec<Motion> = (0..GRID * GRID)
        .map(|n| motion(common, [heading(n / GRID), heading(n % GRID)]))
        .collect();
    let cost = |i: usize, j: usize| all[(i % GRID) * GRID + j % GRID].cost;
    let mut minima = Vec::new();
    for i in 0..GRID {
        for j in 0..GRID {
            let own = cost(i, j);
            let around = [GRID - 1, 0, 1]
                .into_iter()
                .flat_map(|di| [GRID - 1, 0, 1].into_iter().map(move |dj| (i + di, j + dj)));
            if around.into_iter().all(|(i, j)| cost(i, j) >= own) {
                minima.push(all[i * GRID + j]);
            }
        }
    }
    minima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    minima.truncate(FOLLOWED);
    minima
}

/// Cameras and points of a motion, with the directions in which most points are before the cameras.
/// The first camera and the one farther from it are a unit apart.
fn scene(
    cameras: [usize; 3],
    common: &[Common],
    motion: &Motion,
    (camera_count, point_count): (usize, usize),
) -> Option<Scene> {
    let [mut p2, mut p3] = motion.places;
    let [mut h2, mut h3] = motion.headings;
    let mut ahead = [0_i32; 3];
    let mut points = Vec::new();
    for seen in common {
        let [a1, a2, a3] = seen.bearings;
        let u1 = unit(a1);
        let (n2, n3) = (normal(h2 + a2), normal(h3 + a3));
        // Along the first ray to where both others meet it, the one more across it counting more.
        let (by2, by3) = (n2.dot(&u1), n3.dot(&u1));
        let along = (n2.dot(&p2) * by2 + n3.dot(&p3) * by3) / (by2 * by2 + by3 * by3);
        let point = u1 * along;
        let depths = [
            along,
            unit(h2 + a2).dot(&(point - p2)),
            unit(h3 + a3).dot(&(point - p3)),
        ];
        for (count, depth) in ahead.iter_mut().zip(depths) {
            *count += if depth > 0.0 { 1 } else { -1 };
        }
        points.push(point);
    }
    let mut signs = ahead.map(|count| count > 0);
    if !signs[0] {
        (p2, p3) = (-p2, -p3);
        points.iter_mut().for_each(|point| *point = -*point);
        signs = signs.map(|sign| !sign);
    }
    if !signs[1] {
        h2 += PI;
    }
    if !signs[2] {
        h3 += PI;
    }
    let (farther, baseline) = if p2.norm() >= p3.norm() {
        (cameras[1], p2)
    } else {
        (cameras[2], p3)
    };
    let length = baseline.norm();
    if !(length > 0.0 && length.is_finite()) {
        return None;
    }
    let turn = -baseline.y.atan2(baseline.x);
    let placed = |place: Vector2<f64>| {
        let c = unit(turn);
        Vector2::new(c.x * place.x - c.y * place.y, c.y * place.x + c.x * place.y) / length
    };
    let mut scene = Scene {
        cameras: vec![None; camera_count],
        points: vec![None; point_count],
        sights: Vec::new(),
        frame: [cameras[0], farther],
    };
    for (camera, (place, heading)) in
        cameras
            .into_iter()
            .zip([(Vector2::zeros(), 0.0), (p2, h2), (p3, h3)])
    {
        let place = placed(place);
        scene.cameras[camera] = Some(Vector3::new(place.x, place.y, heading + turn));
    }
    for (seen, point) in common.iter().zip(points) {
        scene.points[seen.point] = Some(Point2::from(placed(point)));
        for ((camera, bearing), sigma) in cameras.into_iter().zip(seen.bearings).zip(seen.sigmas) {
            scene.sights.push(Sight {
                point: seen.point,
                camera,
                bearing,
                sigma,
                counts: true,
            });
        }
    }
    Some(scene)
}
