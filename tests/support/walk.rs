//! Walks of a target past cameras, with all measurements.

use nalgebra::{Matrix2, Point2, Vector2};
use rand::RngExt;

use super::{Random, Truth, normal};

/// Errors of a carrier, standard deviations: of its scale and compass, and of each leg's length (a
/// share of it) and direction (radians).
#[derive(Clone, Copy, Debug)]
pub struct CarrierErrors {
    /// Standard deviation of its scale, drawn once.
    pub scale: f64,
    /// Standard deviation of its compass offset, radians, drawn once.
    pub compass: f64,
    /// Standard deviation of a leg's length, a share of it.
    pub length: f64,
    /// Standard deviation of a leg's direction, radians.
    pub direction: f64,
    /// Standard deviation of both ends of any leg, in units of length: none is better.
    pub least: f64,
}

impl CarrierErrors {
    /// Errors of an unknown carrier: 5 % and 2 degrees, then 1 % and half a degree a leg.
    pub const UNKNOWN: Self = Self {
        scale: 0.05,
        compass: 2.0 * PER_DEGREE,
        ..Self::DRIFT
    };
    /// Errors of a calibrated carrier: only 1 % and half a degree a leg.
    pub const DRIFT: Self = Self {
        scale: 1e-4,
        compass: 1e-4,
        length: 0.01,
        direction: 0.5 * PER_DEGREE,
        least: 1e-3,
    };
    /// Steps known to a thousandth of a unit.
    pub const PERFECT: Self = Self {
        length: 0.0,
        direction: 0.0,
        ..Self::DRIFT
    };
}

const PER_DEGREE: f64 = std::f64::consts::PI / 180.0;

/// One displacement.
#[derive(Clone, Copy, Debug)]
pub struct WalkedLeg {
    /// As the carrier measured it.
    pub displacement: Vector2<f64>,
    /// Its covariance.
    pub covariance: Matrix2<f64>,
}

/// One bearing.
#[derive(Clone, Copy, Debug)]
pub struct SeenAt {
    /// The stop.
    pub stop: usize,
    /// The camera.
    pub camera: usize,
    /// Off its optical axis, radians.
    pub bearing: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// One range.
#[derive(Clone, Copy, Debug)]
pub struct RangedAt {
    /// The stop.
    pub stop: usize,
    /// The camera.
    pub camera: usize,
    /// Distance of the target.
    pub range: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// A stop on a mark.
#[derive(Clone, Copy, Debug)]
pub struct Visited {
    /// The stop.
    pub stop: usize,
    /// The mark.
    pub mark: usize,
    /// Standard deviation of the target's distance from it.
    pub sigma: f64,
}

/// The truth and the measurements, in the frame of cameras 0 and 1.
#[derive(Clone, Debug)]
pub struct Walk {
    /// All cameras.
    pub cameras: Vec<Truth>,
    /// Every stop.
    pub places: Vec<Point2<f64>>,
    /// Ratio of the carrier's readings to the true length, and its compass offset.
    pub carrier: [f64; 2],
    /// Standard deviations of both.
    pub errors: CarrierErrors,
    /// Legs to each stop but the first.
    pub legs: Vec<WalkedLeg>,
    /// By stop.
    pub bearings: Vec<SeenAt>,
    /// By stop.
    pub ranges: Vec<RangedAt>,
    /// Closed loops.
    pub visits: Vec<Visited>,
    /// Standard deviation of the scale that every camera's lens has, relative; zero if all lenses are as
    /// they are said to be.
    pub lens_sigma: f64,
    /// Standard deviation of what every camera's principal column adds to the tangent of a bearing; zero if all
    /// are what they are said to be. Only beside `lens_sigma`.
    pub principal_sigma: f64,
}

impl Walk {
    /// References 10 units apart that look at a common area; `cameras - 2` others around it; `stops`
    /// places of which the first five are in view of both references. Cameras have 60 degrees and
    /// see 8 units far.
    pub fn random(
        rng: &mut Random,
        cameras: usize,
        stops: usize,
        errors: CarrierErrors,
        sigma: f64,
    ) -> Self {
        let camera = |x, y, heading| Truth { x, y, heading };
        loop {
            let mut all = vec![
                camera(0.0, 0.0, 0.8 + 0.1 * normal(rng)),
                camera(10.0, 0.0, 2.3 + 0.1 * normal(rng)),
            ];
            while all.len() < cameras {
                let place = Point2::new(rng.random_range(-1.0..11.0), rng.random_range(1.0..12.0));
                let middle = Point2::new(rng.random_range(3.0..7.0), rng.random_range(3.0..8.0));
                let d = middle - place;
                if (2.5..7.0).contains(&d.norm()) {
                    all.push(camera(place.x, place.y, d.y.atan2(d.x)));
                }
            }
            if let Some(places) = places(rng, &all, stops) {
                return Self::measured(rng, all, places, errors, sigma);
            }
        }
    }

    /// The measurements of this walk: bearings by every camera that has a stop in view.
    pub fn measured(
        rng: &mut Random,
        cameras: Vec<Truth>,
        places: Vec<Point2<f64>>,
        errors: CarrierErrors,
        sigma: f64,
    ) -> Self {
        let mut bearings = Vec::new();
        for (stop, &place) in places.iter().enumerate() {
            for (n, camera) in cameras.iter().enumerate() {
                if sees(camera, place) {
                    let bearing = camera.bearing_of(place) + sigma * normal(rng);
                    bearings.push(SeenAt {
                        stop,
                        camera: n,
                        bearing,
                        sigma,
                    });
                }
            }
        }
        let mut walk = Self {
            cameras,
            places,
            carrier: [1.0, 0.0],
            errors,
            legs: Vec::new(),
            bearings,
            ranges: Vec::new(),
            visits: Vec::new(),
            lens_sigma: 0.0,
            principal_sigma: 0.0,
        };
        walk.carry(rng);
        walk
    }

    /// Draws a carrier and its measurements.
    pub fn carry(&mut self, rng: &mut Random) {
        let errors = self.errors;
        let carrier = [
            1.0 + errors.scale * normal(rng),
            errors.compass * normal(rng),
        ];
        self.carrier = carrier;
        self.legs = { self.places.windows(2) }
            .map(|ends| {
                let way = ends[1] - ends[0];
                let (cos, sin) = (carrier[1].cos(), carrier[1].sin());
                let read = Vector2::new(cos * way.x - sin * way.y, sin * way.x + cos * way.y);
                let read = read * carrier[0];
                let along = read.normalize();
                let across = Vector2::new(-along.y, along.x);
                let sigmas = [errors.length, errors.direction]
                    .map(|share| (share * read.norm()).max(errors.least));
                WalkedLeg {
                    displacement: read
                        + along * (sigmas[0] * normal(rng))
                        + across * (sigmas[1] * normal(rng)),
                    covariance: along * along.transpose() * sigmas[0].powi(2)
                        + across * across.transpose() * sigmas[1].powi(2),
                }
            })
            .collect();
    }

    /// Adds a range to each bearing, off by a share of it at one sigma.
    pub fn range(&mut self, rng: &mut Random, share: f64) {
        let ranged = self.bearings.iter().map(|seen| {
            let truth = self.places[seen.stop] - self.cameras[seen.camera].position();
            let sigma = share * truth.norm();
            RangedAt {
                stop: seen.stop,
                camera: seen.camera,
                range: truth.norm() + sigma * normal(rng),
                sigma,
            }
        });
        self.ranges = ranged.collect();
    }

    /// Makes what a camera measures that of a lens whose true tangents are the measured ones times
    /// `scale`, and `principal` more.
    pub fn look_through(&mut self, camera: usize, scale: f64, principal: f64) {
        for seen in self
            .bearings
            .iter_mut()
            .filter(|seen| seen.camera == camera)
        {
            let truth = self.cameras[camera].bearing_of(self.places[seen.stop]);
            let noise = seen.bearing - truth;
            seen.bearing = ((truth.tan() - principal) / scale).atan() + noise;
        }
    }

    /// Bearings of a camera.
    pub fn seen_by(&self, camera: usize) -> usize {
        self.bearings.iter().filter(|b| b.camera == camera).count()
    }
}

/// Returns true if a camera of 60 degrees has a place in view.
pub fn sees(camera: &Truth, place: Point2<f64>) -> bool {
    let range = (place - camera.position()).norm();
    (0.8..8.0).contains(&range) && camera.bearing_of(place).abs() < 0.5
}

fn places(rng: &mut Random, cameras: &[Truth], stops: usize) -> Option<Vec<Point2<f64>>> {
    let mut places: Vec<Point2<f64>> = Vec::new();
    for _ in 0..4000 {
        if places.len() == stops {
            return Some(places);
        }
        let place = Point2::new(rng.random_range(1.0..9.0), rng.random_range(1.0..10.0));
        let seen = cameras.iter().filter(|c| sees(c, place)).count();
        let wanted = if places.len() < 5 {
            sees(&cameras[0], place) && sees(&cameras[1], place)
        } else {
            seen >= 2
        };
        let apart = places
            .last()
            .is_none_or(|last| (0.7..4.0).contains(&(place - last).norm()));
        if wanted && apart && places.iter().all(|p| (p - place).norm() > 0.4) {
            places.push(place);
        }
    }
    None
}
