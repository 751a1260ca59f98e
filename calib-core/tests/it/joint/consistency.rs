//! Are the sigmas what they claim? Squared errors over predicted covariances (NEES), from both sides.

use calib_core::{Limits, angle::wrap_signed};
use nalgebra::Vector2;
use test_support::{
    chi_squared_band, generator, turn,
    walk::{CarrierErrors, Walk},
};

use crate::joint::support::{WIDE, filled};

const RUNS: u64 = 500;

/// A mean of chi squared variables: sum, and degrees of freedom.
#[derive(Default)]
struct Nees {
    /// One sum for each run: the errors of one run are not independent.
    runs: Vec<(f64, f64)>,
}

impl Nees {
    fn add(&mut self, squared: f64, degrees: f64) {
        let last = self.runs.last_mut().unwrap();
        last.0 += squared;
        last.1 += degrees;
    }

    /// The mean over its expectation, and how far it may be off by chance: 2.58 standard errors of
    /// the spread over runs, which is its 99 % band.
    fn ratio(&self) -> (f64, f64) {
        let degrees: f64 = self.runs.iter().map(|run| run.1).sum();
        let ratio = self.runs.iter().map(|run| run.0).sum::<f64>() / degrees;
        let spread: f64 = { self.runs.iter() }
            .map(|run| (run.0 - ratio * run.1).powi(2))
            .sum();
        (ratio, 2.58 * spread.sqrt() / degrees)
    }
}

#[test]
fn sigmas_are_honest() {
    for (name, errors) in [
        ("unknown carrier", CarrierErrors::UNKNOWN),
        ("drift", CarrierErrors::DRIFT),
        ("perfect steps", CarrierErrors::PERFECT),
    ] {
        let mut all: [Nees; 5] = Default::default();
        let (mut chi_squared, mut degrees) = (0.0, 0.0);
        for seed in 0..RUNS {
            let walk = Walk::random(&mut generator(1000 + seed), 8, 16, errors, 0.0024);
            let mut joint = filled::<f32>(
                &walk,
                calib_core::Limits {
                    position: 0.5,
                    heading: 0.0873,
                },
            );
            let Ok(solution) = joint.solve() else {
                panic!("{name} {seed}: {:?}", joint.solve())
            };
            // As on a node; of an even run chi squared is judged with the noise that legs claim.
            joint.fit_leg_noise().unwrap();
            all.iter_mut().for_each(|nees| nees.runs.push((0.0, 0.0)));
            chi_squared += f64::from(solution.fit.chi_squared);
            degrees += solution.fit.degrees_of_freedom as f64;
            let [cameras, stops, references, scale, compass] = &mut all;
            for (n, truth) in walk.cameras.iter().enumerate().skip(2) {
                let Ok(pose) = joint.pose(n) else { continue };
                let position = truth.position().cast();
                let squared = pose
                    .normalised_error(position, truth.heading as f32)
                    .unwrap();
                cameras.add(squared.into(), 3.0);
            }
            for (n, truth) in walk.places.iter().enumerate().step_by(5) {
                let place = joint.place(n).unwrap();
                let off = place.position.cast::<f64>() - truth;
                let covariance = place.covariance.cast::<f64>();
                stops.add(off.dot(&(covariance.try_inverse().unwrap() * off)), 2.0);
            }
            let found = joint.reference_headings().unwrap();
            let off =
                Vector2::from_fn(|n, _| turn(found.headings[n].into(), walk.cameras[n].heading));
            let covariance = found.covariance.cast::<f64>();
            references.add(off.dot(&(covariance.try_inverse().unwrap() * off)), 2.0);
            let carrier = joint.carrier().unwrap();
            let off = f64::from(carrier.scale) - walk.carrier[0];
            scale.add(off * off / f64::from(carrier.covariance.m11), 1.0);
            let off = wrap_signed(f64::from(carrier.compass) - walk.carrier[1]);
            compass.add(off * off / f64::from(carrier.covariance.m22), 1.0);
        }
        for (of, nees) in ["cameras", "stops", "reference headings", "scale", "compass"]
            .into_iter()
            .zip(&all)
        {
            let (ratio, band) = nees.ratio();
            std::println!("{name}, {of}: NEES over degrees {ratio:.3} +/- {band:.3}");
            assert!(
                (ratio - 1.0).abs() < band.max(0.05),
                "{name}, {of}: {ratio:.3} +/- {band:.3}"
            );
        }
        assert!(
            chi_squared_band(degrees).contains(&chi_squared),
            "{name}: chi squared {chi_squared:.0} of {degrees:.0}"
        );
    }
}

/// Steps that are uncertain by a tenth leave the bearings of one camera with little to say, and all together
/// with enough: a camera takes part if its pose is as sure as asked for then.
#[test]
fn what_others_saw_counts_for_who_takes_part() {
    let errors = CarrierErrors {
        length: 0.1,
        direction: 0.1,
        ..CarrierErrors::UNKNOWN
    };
    let limits = Limits {
        position: 0.5,
        heading: 0.0873,
    };
    let (mut sure, mut missing) = (0, 0);
    let mut nees = Nees::default();
    for seed in 0..100 {
        let walk = Walk::random(&mut generator(2000 + seed), 8, 24, errors, 0.0024);
        let [mut asked, mut all] = [limits, WIDE].map(|limits| filled::<f64>(&walk, limits));
        if asked.solve().is_err() || all.solve().is_err() {
            continue;
        }
        nees.runs.push((0.0, 0.0));
        for (camera, truth) in walk.cameras.iter().enumerate().skip(2) {
            let pose = asked.pose(camera);
            if walk.seen_by(camera) >= 4 && all.pose(camera).is_ok_and(|pose| limits.allow(&pose)) {
                sure += 1;
                missing += usize::from(pose.is_err());
            }
            if let Ok(pose) = pose {
                let squared = pose.normalised_error(truth.position(), truth.heading);
                nees.add(squared.unwrap(), 3.0);
            }
        }
    }
    std::println!("{missing} of {sure}; {:?}", nees.ratio());
    assert!(sure > 100 && missing < sure / 20, "{missing} of {sure}");
    let (ratio, band) = nees.ratio();
    assert!(
        (ratio - 1.0).abs() < band.max(0.1),
        "{ratio:.3} +/- {band:.3}"
    );
}

/// More measurements never make anything less certain, on the mean.
#[test]
fn what_is_more_is_more() {
    let walk = Walk::random(&mut generator(7), 8, 24, CarrierErrors::UNKNOWN, 0.0024);
    let mut before = f64::INFINITY;
    for stops in [8, 12, 16, 24] {
        let mut part = walk.clone();
        part.places.truncate(stops);
        let mut joint = filled::<f64>(&part, WIDE);
        joint.solve().unwrap();
        let sigma = joint.carrier().unwrap().sigma_scale();
        assert!(sigma < before, "{stops} stops: {sigma}");
        before = sigma;
    }
}
