//! Reference solves of twelve stops, as the first reference camera makes them.

use core::fmt;

use calib_core::{
    Ray,
    reference::{self, Known, ReferenceSettings, Stop},
};
use nalgebra::{Matrix2, Point2, Vector2};
use rand::{Rng, RngExt};

use crate::measure::{Bench, Counter, Error};

/// Stops that a reference camera keeps.
const STOPS: usize = 12;
const BASELINE: f32 = 10.0;
/// Standard deviations of a bearing, radians, and of a leg in each direction.
const BEARING_SIGMA: f32 = 0.0024;
const LEG_SIGMA: f32 = 0.02;

/// Counts solves with all known, with an unknown direction of the steps, and with an unknown baseline.
///
/// # Errors
/// As [`Bench::measure`].
pub fn measure_all<C: Counter, W: fmt::Write>(bench: &mut Bench<C, W>) -> Result<(), Error> {
    for (name, baseline, frame_heading) in [
        ("reference_solve_12_stops", Some(BASELINE), Some(0.0)),
        ("reference_solve_unknown_direction", Some(BASELINE), None),
        ("reference_solve_unknown_baseline", None, Some(0.0)),
    ] {
        let known = Known {
            baseline,
            frame_heading,
        };
        bench.measure_long(name, stops, |stops| {
            reference::solve(stops, &known, &ReferenceSettings::default())
                .map(|outcome| outcome.best.chi_squared)
        })?;
    }
    Ok(())
}

/// A walk between both cameras, which look at it.
fn stops(random: &mut impl Rng) -> [Stop<f32>; STOPS] {
    let cameras = [
        (Point2::origin(), core::f32::consts::FRAC_PI_4),
        (
            Point2::new(BASELINE, 0.0),
            3.0 * core::f32::consts::FRAC_PI_4,
        ),
    ];
    let mut before = Point2::origin();
    core::array::from_fn(|_| {
        let mut place = || random.random_range(2.0..8.0_f32);
        let place = Point2::new(place(), place());
        let mut off = || random.random_range(-1.7..1.7_f32);
        let leg = place - before + Vector2::new(off(), off()) * LEG_SIGMA;
        before = place;
        Stop {
            rays: cameras.map(|(at, heading)| {
                let bearing = libm::atan2f(place.y - at.y, place.x - at.x) - heading;
                Ray::from_bearing(bearing + off() * BEARING_SIGMA)
            }),
            bearing_sigmas: [BEARING_SIGMA; 2],
            displacement: leg,
            displacement_covariance: Matrix2::from_diagonal_element(LEG_SIGMA * LEG_SIGMA),
        }
    })
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn the_headings_are_found() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let known = Known {
            baseline: Some(BASELINE),
            frame_heading: None,
        };
        for _ in 0..65 {
            let solved =
                reference::solve(&stops(&mut random), &known, &ReferenceSettings::default());
            let [first, second] = solved.expect("an answer").best.headings;
            assert!((first.to_degrees() - 45.0).abs() < 2.0, "{first}");
            assert!((second.to_degrees() - 135.0).abs() < 2.0, "{second}");
        }
    }
}
