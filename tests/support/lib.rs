//! Random scenes with a known truth, made without the code under test.

pub mod batch;
pub mod walk;
pub mod walker;

use std::f64::consts::TAU;
use std::ops::RangeInclusive;
use std::path::PathBuf;

use nalgebra::Point2;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The generator of random numbers.
pub type Random = ChaCha8Rng;

/// A generator whose numbers are the same on every machine.
pub fn generator(seed: u64) -> Random {
    Random::seed_from_u64(seed)
}

/// A standard normal number (Box and Muller).
pub fn normal(rng: &mut impl Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random_range(1e-300..1.0), rng.random_range(0.0..1.0));
    (-2.0 * u.ln()).sqrt() * (v * TAU).cos()
}

/// The file of a site of cells, of which only the first has references, and the sum of their cameras.
pub fn building(cameras: usize, cell: usize) -> String {
    format!(
        r#"
        name = "building"
        [camera]
        projection = "pin-hole"
        field_of_view_deg = 60.0
        field_of_view_sigma = 0
        principal_sigma = 0
        range = 8.0
        [radio]
        medium = "unit-disk"
        range = 30.0
        [sensor]
        measures = false
        [firmware]
        systematic_heading_deg = 0.0
        systematic_scale = 0.0
        standing_sigma = 0.01
        weak_sigma = 1.0
        [grid]
        nodes = {cameras}
        cell_nodes = {cell}
        one_frame = true
        "#
    )
}

/// An amount of work: that of every day, or that of the night (`cargo xtask test --all`).
pub fn amount<T>(daily: T, nightly: T) -> T {
    match std::env::var_os("XTASK_ALL") {
        Some(_) => nightly,
        None => daily,
    }
}

/// The difference of two angles, in `(-pi, pi]`.
pub fn turn(a: f64, b: f64) -> f64 {
    (a - b).sin().atan2((a - b).cos())
}

/// Range of a chi squared of so many degrees of freedom, except for values as rare as a normal number
/// beyond four standard deviations on either side: one in 16,000. After Wilson and Hilferty (1931).
///
/// Of numbers that depend on each other, only the independent ones count.
pub fn chi_squared_band(degrees_of_freedom: f64) -> RangeInclusive<f64> {
    let variance = 2.0 / (9.0 * degrees_of_freedom);
    let end = |sigmas: f64| {
        let root = 1.0 - variance + sigmas * variance.sqrt();
        degrees_of_freedom * root.max(0.0).powi(3)
    };
    end(-4.0)..=end(4.0)
}

/// A file of the repository's own data.
pub fn data(name: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "data", name].iter().collect()
}

/// True pose of a camera.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    /// Position along the x axis.
    pub x: f64,
    /// Position along the y axis.
    pub y: f64,
    /// Direction of the optical axis, radians.
    pub heading: f64,
}

impl Truth {
    /// A pose anywhere within 20 units of the origin, looking in any direction.
    pub fn random(rng: &mut impl Rng) -> Self {
        Self {
            x: rng.random_range(-20.0..20.0),
            y: rng.random_range(-20.0..20.0),
            heading: rng.random_range(0.0..TAU),
        }
    }

    /// The camera's place.
    pub fn position(&self) -> Point2<f64> {
        Point2::new(self.x, self.y)
    }

    /// The place at a range and a bearing from this camera.
    pub fn place(&self, range: f64, bearing: f64) -> Point2<f64> {
        let angle = self.heading + bearing;
        Point2::new(self.x + range * angle.cos(), self.y + range * angle.sin())
    }

    /// Bearing that this camera measures, without noise.
    pub fn bearing_of(&self, target: Point2<f64>) -> f64 {
        let d = target - self.position();
        turn(d.y.atan2(d.x), self.heading)
    }

    /// Targets inside a view of about 60 degrees, 1 to 8 units away.
    pub fn targets<const N: usize>(&self, rng: &mut impl Rng) -> [Point2<f64>; N] {
        core::array::from_fn(|_| {
            self.place(rng.random_range(1.0..8.0), rng.random_range(-0.5..0.5))
        })
    }
}

/// Distance of a camera from the circle through three targets: zero on it, or on their line.
///
/// The determinant that tests four points for lying on one circle, over the fourth power of the
/// farthest range.
pub fn clearance(camera: Point2<f64>, targets: &[Point2<f64>; 3]) -> f64 {
    let [a, b, c] = targets.map(|t| {
        let d = t - camera;
        [d.x, d.y, d.norm_squared()]
    });
    let determinant = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0]);
    let farthest = a[2].max(b[2]).max(c[2]);
    determinant.abs() / farthest.powi(2)
}
