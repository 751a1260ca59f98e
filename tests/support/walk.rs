//! Walks of a target past cameras, with what everybody measures, and the answer of a dense batch
//! adjustment to compare with: all unknowns at once, its own model, derivatives by differences.

use nalgebra::{Matrix2, Matrix3, Point2, Vector2, Vector3};
use rand::RngExt;

use super::{Random, Truth, normal, turn};

/// How a carrier errs, standard deviations: of its scale and compass, and of each leg's length (a
/// share of it) and direction (radians).
#[derive(Clone, Copy, Debug)]
pub struct CarrierErrors {
    /// Of its scale, drawn once.
    pub scale: f64,
    /// Of its compass offset, radians, drawn once.
    pub compass: f64,
    /// Of a leg's length, a share of it.
    pub length: f64,
    /// Of a leg's direction, radians.
    pub direction: f64,
    /// Of both ends of any leg, in units of length: none is better.
    pub least: f64,
}

impl CarrierErrors {
    /// Of a carrier of which nothing is known: 5 % and 2 degrees, then 1 % and half a degree a leg.
    pub const UNKNOWN: Self = Self {
        scale: 0.05,
        compass: 2.0 * PER_DEGREE,
        ..Self::DRIFT
    };
    /// Calibrated, but for 1 % and half a degree a leg.
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

/// A stop on a mark.
#[derive(Clone, Copy, Debug)]
pub struct Visited {
    /// The stop.
    pub stop: usize,
    /// The mark.
    pub mark: usize,
    /// Standard deviation of standing on it.
    pub sigma: f64,
}

/// What is true and what was measured, in the frame of cameras 0 and 1.
#[derive(Clone, Debug)]
pub struct Walk {
    /// All cameras.
    pub cameras: Vec<Truth>,
    /// Every stop.
    pub places: Vec<Point2<f64>>,
    /// What the carrier reads over the true length, and its compass offset.
    pub carrier: [f64; 2],
    /// Standard deviations of both.
    pub errors: CarrierErrors,
    /// To each stop but the first.
    pub legs: Vec<WalkedLeg>,
    /// By stop.
    pub bearings: Vec<SeenAt>,
    /// Closed loops.
    pub visits: Vec<Visited>,
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

    /// What would be measured on this walk: bearings by every camera that has a stop in view.
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
            visits: Vec::new(),
        };
        walk.carry(rng);
        walk
    }

    /// Draws a carrier and what it measures.
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

    /// Bearings of a camera.
    pub fn seen_by(&self, camera: usize) -> usize {
        self.bearings.iter().filter(|b| b.camera == camera).count()
    }
}

/// Whether a camera of 60 degrees has a place in view.
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

/// The least squares answer to all measurements at once.
#[derive(Clone, Debug)]
pub struct Batch {
    /// Unknowns: scale, compass, both reference headings, every stop, `(x, y, heading)` of each camera
    /// that is solved, every mark.
    pub x: Vec<f64>,
    /// Their covariance.
    pub covariance: Vec<Vec<f64>>,
    /// Sum of the squared, whitened residuals.
    pub chi_squared: f64,
    /// First unknown of each camera; `None` for references and those left out.
    pub first: Vec<Option<usize>>,
    stops: usize,
}

impl Batch {
    /// From the truth, over the cameras that have three bearings or more. `None` if something stays
    /// undetermined.
    ///
    /// `prior` are the sigmas of scale and compass around one and zero.
    pub fn solve(walk: &Walk, prior: [f64; 2], takes_part: impl Fn(usize) -> bool) -> Option<Self> {
        let mut x = vec![
            walk.carrier[0],
            walk.carrier[1],
            walk.cameras[0].heading,
            walk.cameras[1].heading,
        ];
        x.extend(walk.places.iter().flat_map(|p| [p.x, p.y]));
        let mut first = vec![None; walk.cameras.len()];
        for (n, camera) in walk.cameras.iter().enumerate().skip(2) {
            if takes_part(n) {
                first[n] = Some(x.len());
                x.extend([camera.x, camera.y, camera.heading]);
            }
        }
        let marks = x.len();
        for mark in 0..walk.visits.iter().map(|v| v.mark + 1).max().unwrap_or(0) {
            let visit = walk.visits.iter().find(|v| v.mark == mark)?;
            let place = walk.places[visit.stop];
            x.extend([place.x, place.y]);
        }
        let system = System {
            walk,
            prior,
            first: &first,
            marks,
        };
        for _ in 0..30 {
            let (normal, gradient, _) = system.normal_equations(&x);
            let step = Factor::new(&normal)?.solve(&gradient);
            x.iter_mut().zip(&step).for_each(|(x, s)| *x -= s);
            if step.iter().all(|s| s.abs() < 1e-11) {
                break;
            }
        }
        let (normal, _, chi_squared) = system.normal_equations(&x);
        let mut covariance = Vec::new();
        let factor = Factor::new(&normal)?;
        for n in 0..x.len() {
            let mut unit = vec![0.0; x.len()];
            unit[n] = 1.0;
            covariance.push(factor.solve(&unit));
        }
        Some(Self {
            x,
            covariance,
            chi_squared,
            first,
            stops: walk.places.len(),
        })
    }

    /// Pose and covariance of a camera that is no reference.
    pub fn camera(&self, camera: usize) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let first = self.first[camera]?;
        Some((
            Vector3::from_fn(|i, _| self.x[first + i]),
            Matrix3::from_fn(|i, j| self.covariance[first + i][first + j]),
        ))
    }

    /// Place and covariance of a stop.
    pub fn stop(&self, stop: usize) -> (Vector2<f64>, Matrix2<f64>) {
        assert!(stop < self.stops);
        self.pair(4 + 2 * stop)
    }

    /// Scale and compass, or the reference headings, with their covariance.
    pub fn pair(&self, first: usize) -> (Vector2<f64>, Matrix2<f64>) {
        (
            Vector2::from_fn(|i, _| self.x[first + i]),
            Matrix2::from_fn(|i, j| self.covariance[first + i][first + j]),
        )
    }
}

struct System<'a> {
    walk: &'a Walk,
    prior: [f64; 2],
    first: &'a [Option<usize>],
    marks: usize,
}

impl System<'_> {
    /// All residuals over their sigmas, each with the unknowns it takes.
    fn residuals(&self, x: &[f64]) -> Vec<(f64, Vec<usize>)> {
        let mut all = vec![
            ((x[0] - 1.0) / self.prior[0], vec![0]),
            (x[1] / self.prior[1], vec![1]),
        ];
        let place = |stop: usize| Point2::new(x[4 + 2 * stop], x[5 + 2 * stop]);
        for (n, leg) in self.walk.legs.iter().enumerate() {
            let way = place(n + 1) - place(n);
            let (length, angle) = (way.norm() * x[0], way.y.atan2(way.x) + x[1]);
            let off = Vector2::new(length * angle.cos(), length * angle.sin()) - leg.displacement;
            let lower = leg.covariance.cholesky().expect("a covariance").l();
            let white = lower.solve_lower_triangular(&off).expect("regular");
            let from = 4 + 2 * n;
            for residual in [white.x, white.y] {
                all.push((residual, vec![0, 1, from, from + 1, from + 2, from + 3]));
            }
        }
        let baseline = self.walk.cameras[1].x;
        for seen in &self.walk.bearings {
            let at = 4 + 2 * seen.stop;
            let (camera, heading, mut takes) = match (seen.camera, self.first[seen.camera]) {
                (0, _) => (Point2::origin(), 2, vec![2]),
                (1, _) => (Point2::new(baseline, 0.0), 3, vec![3]),
                (_, Some(c)) => (Point2::new(x[c], x[c + 1]), c + 2, vec![c, c + 1, c + 2]),
                _ => continue,
            };
            let d = place(seen.stop) - camera;
            takes.extend([at, at + 1]);
            let off = turn(d.y.atan2(d.x), x[heading] + seen.bearing);
            all.push((off / seen.sigma, takes));
        }
        for visit in &self.walk.visits {
            for axis in 0..2 {
                let (at, mark) = (
                    4 + 2 * visit.stop + axis,
                    self.marks + 2 * visit.mark + axis,
                );
                all.push(((x[at] - x[mark]) / visit.sigma, vec![at, mark]));
            }
        }
        all
    }

    fn normal_equations(&self, x: &[f64]) -> (Vec<Vec<f64>>, Vec<f64>, f64) {
        let here = self.residuals(x);
        let mut slopes = vec![Vec::new(); here.len()];
        for n in 0..x.len() {
            let step = 1e-6;
            let moved = |by: f64| {
                let mut x = x.to_vec();
                x[n] += by;
                self.residuals(&x)
            };
            let (up, down) = (moved(step), moved(-step));
            for (row, (_, takes)) in here.iter().enumerate() {
                if takes.contains(&n) {
                    slopes[row].push((n, (up[row].0 - down[row].0) / (2.0 * step)));
                }
            }
        }
        let mut normal = vec![vec![0.0; x.len()]; x.len()];
        let (mut gradient, mut cost) = (vec![0.0; x.len()], 0.0);
        for ((residual, _), slopes) in here.iter().zip(&slopes) {
            cost += residual * residual;
            for &(i, a) in slopes {
                gradient[i] += a * residual;
                for &(j, b) in slopes {
                    normal[i][j] += a * b;
                }
            }
        }
        (normal, gradient, cost)
    }
}

/// The root of symmetric positive definite equations, scaled to a unit diagonal (Cholesky).
struct Factor {
    scale: Vec<f64>,
    l: Vec<Vec<f64>>,
}

impl Factor {
    fn new(matrix: &[Vec<f64>]) -> Option<Self> {
        let n = matrix.len();
        let scale: Vec<f64> = (0..n).map(|i| matrix[i][i].sqrt().recip()).collect();
        let mut l = vec![vec![0.0; n]; n];
        for i in 0..n {
            for j in 0..=i {
                let known: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
                let rest = matrix[i][j] * scale[i] * scale[j] - known;
                if i == j {
                    if !(rest > 1e-13) {
                        return None;
                    }
                    l[i][i] = rest.sqrt();
                } else {
                    l[i][j] = rest / l[j][j];
                }
            }
        }
        Some(Self { scale, l })
    }

    fn solve(&self, right: &[f64]) -> Vec<f64> {
        let (n, l) = (right.len(), &self.l);
        let mut x: Vec<f64> = (0..n).map(|i| right[i] * self.scale[i]).collect();
        for i in 0..n {
            let known: f64 = (0..i).map(|k| l[i][k] * x[k]).sum();
            x[i] = (x[i] - known) / l[i][i];
        }
        for i in (0..n).rev() {
            let known: f64 = (i + 1..n).map(|k| l[k][i] * x[k]).sum();
            x[i] = (x[i] - known) / l[i][i];
        }
        (0..n).map(|i| x[i] * self.scale[i]).collect()
    }
}
