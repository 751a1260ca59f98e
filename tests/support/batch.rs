//! The answer of a dense batch adjustment, to compare with: all unknowns at once, its own model,
//! derivatives by differences, normal equations in double precision.

use nalgebra::{Matrix2, Matrix3, Point2, Vector2, Vector3};

use super::{turn, walk::Walk};

/// The least squares answer to all measurements at once.
#[derive(Clone, Debug)]
pub struct Batch {
    /// Unknowns: scale, compass, both reference headings, every stop, `(x, y, heading)` of each camera
    /// that is solved, every mark, the error of every lens if there is one, that of every principal column, and the
    /// baseline if it is not known.
    pub x: Vec<f64>,
    /// Their covariance.
    pub covariance: Vec<Vec<f64>>,
    /// Sum of the squared, whitened residuals.
    pub chi_squared: f64,
    /// First unknown of each camera; `None` for references and those left out.
    pub first: Vec<Option<usize>>,
    /// First unknown of the lenses.
    lenses: usize,
    baseline: Option<usize>,
    stops: usize,
}

impl Batch {
    /// Solves from the truth on, over the cameras that have three bearings or more. `None` if something stays
    /// undetermined.
    ///
    /// `prior` are the sigmas of scale and compass around one and zero.
    pub fn solve(walk: &Walk, prior: [f64; 2], takes_part: impl Fn(usize) -> bool) -> Option<Self> {
        Self::solve_with(walk, prior, true, takes_part)
    }

    /// The same with a baseline that may be one of the unknowns.
    pub fn solve_with(
        walk: &Walk,
        prior: [f64; 2],
        is_baseline_known: bool,
        takes_part: impl Fn(usize) -> bool,
    ) -> Option<Self> {
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
        let lenses = x.len();
        for sigma in [walk.lens_sigma, walk.principal_sigma] {
            if sigma > 0.0 {
                x.extend(vec![0.0; walk.cameras.len()]);
            }
        }
        let baseline = (!is_baseline_known).then_some(x.len());
        x.extend(baseline.map(|_| walk.cameras[1].x));
        let system = System {
            walk,
            baseline,
            prior,
            first: &first,
            marks,
            lenses,
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
            lenses,
            baseline,
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

    /// The baseline and its variance, if it is not known.
    pub fn baseline(&self) -> Option<(f64, f64)> {
        let at = self.baseline?;
        Some((self.x[at], self.covariance[at][at]))
    }

    /// Scale and variance of a camera's lens.
    pub fn lens(&self, camera: usize) -> (f64, f64) {
        let at = self.lenses + camera;
        (1.0 + self.x[at], self.covariance[at][at])
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
    lenses: usize,
    baseline: Option<usize>,
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
        let baseline = { self.baseline }.map_or(self.walk.cameras[1].x, |at| x[at]);
        for seen in &self.walk.bearings {
            let at = 4 + 2 * seen.stop;
            let (camera, heading, mut takes) = match (seen.camera, self.first[seen.camera]) {
                (0, _) => (Point2::origin(), 2, vec![2]),
                (1, _) => {
                    let takes = [3].into_iter().chain(self.baseline);
                    (Point2::new(baseline, 0.0), 3, takes.collect())
                }
                (_, Some(c)) => (Point2::new(x[c], x[c + 1]), c + 2, vec![c, c + 1, c + 2]),
                _ => continue,
            };
            let d = place(seen.stop) - camera;
            takes.extend([at, at + 1]);
            let mut bearing = seen.bearing;
            if self.walk.lens_sigma > 0.0 {
                let lens = self.lenses + seen.camera;
                let mut tangent = (1.0 + x[lens]) * bearing.tan();
                takes.push(lens);
                if self.walk.principal_sigma > 0.0 {
                    let principal = lens + self.walk.cameras.len();
                    tangent += x[principal];
                    takes.push(principal);
                }
                bearing = tangent.atan();
            }
            let off = turn(d.y.atan2(d.x), x[heading] + bearing);
            all.push((off / seen.sigma, takes));
        }
        for ranged in &self.walk.ranges {
            let at = 4 + 2 * ranged.stop;
            let mut takes = vec![at, at + 1];
            let camera = match (ranged.camera, self.first[ranged.camera]) {
                (0, _) => Point2::origin(),
                (1, _) => Point2::new(baseline, 0.0),
                (_, Some(c)) => {
                    takes.extend([c, c + 1]);
                    Point2::new(x[c], x[c + 1])
                }
                _ => continue,
            };
            let off = (place(ranged.stop) - camera).norm() - ranged.range;
            all.push((off / ranged.sigma, takes));
        }
        for (lens, error) in x.iter().enumerate().skip(self.lenses) {
            if self.baseline == Some(lens) {
                break;
            }
            let is_focal = lens < self.lenses + self.walk.cameras.len();
            let sigma = match is_focal {
                true => self.walk.lens_sigma,
                false => self.walk.principal_sigma,
            };
            all.push((error / sigma, vec![lens]));
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
