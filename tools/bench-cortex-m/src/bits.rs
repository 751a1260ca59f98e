//! Results to compare between machines: the arithmetic is the same everywhere, so the bits should be.

use core::{f64::consts::FRAC_PI_4, fmt};

use calib_core::{
    Pose, Ray, Real, Sighting,
    intersection::StationBearing,
    lit, resection,
    tracking::{Look, Settings, Tracker},
};
use nalgebra::{Point2, Vector2};
use rand::{RngExt, SeedableRng, distr::uniform::SampleUniform};
use rand_chacha::ChaCha8Rng;

use crate::{joint, pose, scene::Scene};

const SEED: u64 = 2001;
/// Standard deviation of a bearing, radians, and the largest error of one.
const BEARING_SIGMA: f64 = 0.005;
const OFF: f64 = 0.01;

/// A number whose bits can be told.
pub trait Bits: Real + SampleUniform {
    /// Its bits.
    fn bits(self) -> u64;
}

impl Bits for f32 {
    fn bits(self) -> u64 {
        self.to_bits().into()
    }
}

impl Bits for f64 {
    fn bits(self) -> u64 {
        self.to_bits()
    }
}

/// Prints the results for which every processor has room: poses from three sightings. A line each: its name, and
/// its numbers in hexadecimal.
///
/// # Errors
/// The output's.
pub fn print_small(output: &mut impl fmt::Write) -> fmt::Result {
    for scene in pose::scenes() {
        let pose = pose::solve(&scene).map(f32::from_bits);
        line(output, "three", pose)?;
    }
    Ok(())
}

/// Prints these and all others: least squares, joint estimation and tracking, in single and in double
/// precision.
///
/// # Errors
/// The output's.
pub fn print_all(output: &mut impl fmt::Write) -> fmt::Result {
    print_small(output)?;
    print_rest::<f32>(output)?;
    print_rest::<f64>(output)
}

fn print_rest<T: Bits>(output: &mut impl fmt::Write) -> fmt::Result {
    least_squares::<T>(output)?;
    walk::<T>(output)?;
    tracks::<T>(output)
}

fn line<T: Bits>(
    output: &mut impl fmt::Write,
    what: &str,
    numbers: impl IntoIterator<Item = T>,
) -> fmt::Result {
    output.write_str(what)?;
    for number in numbers {
        write!(output, " {:x}", number.bits())?;
    }
    output.write_str("\n")
}

/// Refusals are results, too.
fn pose_line<T: Bits>(
    output: &mut impl fmt::Write,
    what: &str,
    pose: Option<Pose<T>>,
) -> fmt::Result {
    let Some(pose) = pose else {
        return line::<T>(output, what, []);
    };
    let place = [pose.position.x, pose.position.y, pose.heading];
    let numbers = place.into_iter().chain(pose.covariance_triangle());
    line(output, what, numbers)
}

/// Poses from six sightings of three targets.
fn least_squares<T: Bits>(output: &mut impl fmt::Write) -> fmt::Result {
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    for _ in 0..16 {
        let scene = Scene::<T>::random(&mut random);
        let sightings: [_; 6] = core::array::from_fn(|i| {
            let bearing = scene.rays[i % 3].bearing() + lit(random.random_range(-OFF..OFF));
            let ray = Ray::from_bearing(bearing);
            Sighting::new(scene.targets[i % 3], ray, lit(BEARING_SIGMA))
        });
        let solution = resection::solve(&sightings);
        pose_line(output, "six", solution.ok().map(|solution| solution.pose))?;
    }
    Ok(())
}

/// Poses, places and a carrier from everything together.
fn walk<T: Bits>(output: &mut impl fmt::Write) -> fmt::Result {
    joint::solve_thirteen::<T, _>(|joint| {
        for camera in 0..13 {
            pose_line(output, "joint", joint.pose(camera).ok())?;
        }
        for stop in 0..joint.stops() {
            let place = joint.place(stop).map(|place| {
                let c = place.covariance;
                [place.position.x, place.position.y, c.m11, c.m21, c.m22]
            });
            line(output, "stop", place.into_iter().flatten())?;
        }
        let carrier = joint.carrier().map(|carrier| {
            let c = carrier.covariance;
            [carrier.scale, carrier.compass, c.m11, c.m21, c.m22]
        });
        line(output, "carrier", carrier.into_iter().flatten())
    })
}

/// Two objects that walk through a room with a camera in each corner, as they are tracked.
fn tracks<T: Bits>(output: &mut impl fmt::Write) -> fmt::Result {
    const PERIOD: u64 = 50_000;
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut tracker = Tracker::<T>::new(Settings::walking());
    let corners = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)];
    let ways = [
        (Point2::new(3.0, 4.0), Vector2::new(0.4, 0.2)),
        (Point2::new(7.0, 6.5), Vector2::new(-0.1, -0.4)),
    ];
    for number in 0..160 {
        let now = number * PERIOD;
        let camera = number as usize % corners.len();
        let (x, y) = corners[camera];
        let heading = FRAC_PI_4 * (2 * camera + 1) as f64;
        let known = [1e-4, 0.0, 1e-4, 0.0, 0.0, 1e-6].map(lit);
        let pose = Pose::from_parts(Point2::new(lit(x), lit(y)), lit(heading), known);
        let pose = pose.expect("a pose");
        for (begin, velocity) in ways {
            let place = begin + velocity * (now as f64 * 1e-6);
            let off = random.random_range(-OFF..OFF);
            let bearing = libm::atan2(place.y - y, place.x - x) - heading + off;
            let look = Look {
                camera: camera as u16,
                at: now,
                bearing: StationBearing {
                    pose,
                    ray: Ray::from_bearing(lit(bearing)),
                    bearing_sigma: lit(BEARING_SIGMA),
                    range: None,
                },
                half_width: T::zero(),
                is_wide: false,
            };
            tracker.take(now, &look);
        }
        if number % 8 == 7 {
            for object in tracker.objects() {
                let (p, v, c) = (object.position, object.velocity, object.covariance);
                line(output, "object", [p.x, p.y, v.x, v.y, c.m11, c.m21, c.m22])?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::{string::String, vec::Vec};

    use super::*;

    fn numbers(line: &str) -> Vec<f64> {
        let bits = line.split(' ').skip(1);
        let bits = bits.map(|bits| u64::from_str_radix(bits, 16).unwrap());
        bits.map(f64::from_bits).collect()
    }

    /// There are as many results as expected, none refused, and those of the walk and the tracks in double
    /// precision are right.
    #[test]
    fn they_are_results() {
        let mut all = String::new();
        print_all(&mut all).unwrap();
        for (what, count, length) in [
            ("three", 65, 9),
            ("six", 2 * 16, 9),
            ("joint", 2 * 13, 9),
            ("stop", 2 * 32, 5),
            ("carrier", 2, 5),
        ] {
            let lines = all.lines().filter(|line| line.starts_with(what));
            let lines: Vec<_> = lines.collect();
            assert_eq!(lines.len(), count, "{what}");
            assert!(
                lines
                    .iter()
                    .all(|line| line.split(' ').count() == length + 1)
            );
        }
        let scale = all.lines().rfind(|line| line.starts_with("carrier"));
        let scale = numbers(scale.unwrap())[0];
        assert!((scale - 1.0).abs() < 0.01, "{scale}");
        let mut last = all.lines().rev();
        let ends = [(); 2].map(|()| numbers(last.next().unwrap()));
        // Their places after 7.95 s.
        for (x, y) in [(6.18, 5.59), (6.205, 3.32)] {
            let is_there = |end: &Vec<f64>| (end[0] - x).hypot(end[1] - y) < 0.1;
            assert!(ends.iter().any(is_there), "{ends:?}");
        }
        let mut small = String::new();
        print_small(&mut small).unwrap();
        assert!(all.starts_with(&small));
    }
}
