//! Check of the sigmas: squared errors over predicted covariances, over 500 runs.

use calib_core::joint::Round;
use nalgebra::{Matrix2, Vector2};
use test_support::walk::{CarrierErrors, Walk};

use super::{
    Case,
    geometry::degrees_off,
    runs,
    solvers::{Joint, filled, finish},
};
use crate::figure::{Estimate, Goal, Sheet};

const RUNS: u64 = 500;
/// Standard errors of a 99 % band.
const BAND: f64 = 2.576;
const QUANTITIES: [&str; 5] = [
    "target places",
    "cameras",
    "cameras' headings",
    "reference headings",
    "carrier",
];

/// Sum of normalised squared errors of one run, and their degrees of freedom.
type Sums = [(f64, f64); QUANTITIES.len()];

/// Rows of a carrier drawn from its very priors, and of perfect steps; with the legs' noise estimated.
pub(super) fn run(sheet: &mut Sheet) -> anyhow::Result<()> {
    for (name, carrier, stops) in [
        ("unknown carrier, 3 stops", CarrierErrors::UNKNOWN, 3),
        ("unknown carrier, 10 stops", CarrierErrors::UNKNOWN, 10),
        ("drift, 10 stops", CarrierErrors::DRIFT, 10),
        ("perfect steps, 3 stops", CarrierErrors::PERFECT, 3),
    ] {
        let case = Case {
            stops: Some(stops),
            carrier,
            seeds: RUNS,
            ..Case::default()
        };
        sheet.heading(&format!(
            "Joint, thesis-13: {name}: squared error over predicted covariance, over its degrees, {RUNS} seeds"
        ));
        let sums = runs(&case, |walk| sums(walk, &case))?;
        let sums: Vec<Sums> = sums.into_iter().flatten().collect();
        let share = sums.len() as f64 / RUNS as f64;
        sheet.figure("runs with a frame", share, "", &Goal::AtLeast(0.97));
        for (n, quantity) in QUANTITIES.into_iter().enumerate() {
            let degrees: f64 = sums.iter().map(|run| run[n].1).sum();
            let ratio = sums.iter().map(|run| run[n].0).sum::<f64>() / degrees;
            // The errors of one run are not independent.
            let squares = sums.iter().map(|run| (run[n].0 - ratio * run[n].1).powi(2));
            let band = BAND * squares.sum::<f64>().sqrt() / degrees;
            let estimate = Estimate {
                value: ratio,
                standard_error: band / BAND,
            };
            let goal = Goal::Within(1.0 - band, 1.0 + band);
            sheet.estimate(quantity, estimate, "", &goal, false);
        }
    }
    Ok(())
}

fn sums(walk: &Walk, case: &Case) -> Option<Sums> {
    let prior = [walk.errors.scale, walk.errors.compass];
    let mut joint = filled(walk, &case.limits, prior);
    joint.begin(Round {
        leg_noise: true,
        ..Round::default()
    });
    finish(&mut joint).ok()?;
    let mut sums = Sums::default();
    places(&mut joint, walk, &mut sums[0])?;
    let [_, cameras, headings, ..] = &mut sums;
    for (n, truth) in walk.cameras.iter().enumerate().skip(2) {
        let Ok(pose) = joint.pose(n) else { continue };
        let squared = pose.normalised_error(truth.position().cast(), truth.heading as f32)?;
        cameras.0 += f64::from(squared);
        cameras.1 += 3.0;
        let off = degrees_off(pose.heading.into(), truth.heading).to_radians();
        headings.0 += off * off / f64::from(pose.covariance.m33);
        headings.1 += 1.0;
    }
    let references = joint.reference_headings().ok()?;
    let off = Vector2::from_fn(|n, _| {
        degrees_off(references.headings[n].into(), walk.cameras[n].heading).to_radians()
    });
    sums[3] = (squared(off, references.covariance)?, 2.0);
    let carrier = joint.carrier().ok()?;
    let off = Vector2::new(
        f64::from(carrier.scale) - walk.carrier[0],
        f64::from(carrier.compass) - walk.carrier[1],
    );
    sums[4] = (squared(off, carrier.covariance)?, 2.0);
    Some(sums)
}

fn places(joint: &mut Joint, walk: &Walk, sum: &mut (f64, f64)) -> Option<()> {
    for (stop, truth) in walk.places.iter().enumerate() {
        let place = joint.place(stop).ok()?;
        sum.0 += squared(place.position.cast() - truth, place.covariance)?;
        sum.1 += 2.0;
    }
    Some(())
}

fn squared(off: Vector2<f64>, covariance: Matrix2<f32>) -> Option<f64> {
    let inverse = covariance.cast::<f64>().try_inverse()?;
    Some(off.dot(&(inverse * off)))
}
