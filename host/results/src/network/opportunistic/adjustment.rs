//! Bundle adjustment in the plane: cameras and points at once, from bearings alone.
//!
//! Two cameras keep their places and so define the frame and its scale; their headings are unknown.
//! Points are eliminated one by one, which leaves equations for the cameras. Levenberg and
//! Marquardt's damping leads downhill from where it begins. Triggs et al., "Bundle adjustment: a
//! modern synthesis", 2000.

use calib_core::angle;
use nalgebra::{Matrix2, Matrix3, Point2, Vector2, Vector3};

use super::matrix::Symmetric;

/// A bearing by numbers of point and camera, radians.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sight {
    pub point: usize,
    pub camera: usize,
    pub bearing: f64,
    pub sigma: f64,
    /// Not left out.
    pub counts: bool,
}

/// Unknowns and their estimates: `None` where one is not known yet.
#[derive(Clone, Debug)]
pub(crate) struct Scene {
    /// `(x, y, heading)`.
    pub cameras: Vec<Option<Vector3<f64>>>,
    pub points: Vec<Option<Point2<f64>>>,
    pub sights: Vec<Sight>,
    /// The cameras that keep their places.
    pub frame: [usize; 2],
}

/// The minimum, with the parts that covariances are made of.
pub(crate) struct Adjusted {
    pub chi_squared: f64,
    pub degrees_of_freedom: usize,
    covariance: Symmetric,
    columns: Vec<Columns>,
    points: Vec<Option<Eliminated>>,
}

/// Where a camera's three numbers are in the equations; given ones are in none.
type Columns = [Option<usize>; 3];

/// A bearing's residual and its derivatives, over its sigma.
struct Row {
    camera: usize,
    residual: f64,
    by_point: Vector2<f64>,
    by_camera: [f64; 3],
}

/// A point that was eliminated.
struct Eliminated {
    inverse: Matrix2<f64>,
    gradient: Vector2<f64>,
    /// Derivatives by the point times those by cameras: by column.
    with: Vec<(usize, Vector2<f64>)>,
}

const PASSES: usize = 200;
const CONVERGED: f64 = 1e-10;

impl Scene {
    fn row(&self, sight: &Sight) -> Option<Row> {
        let camera = self.cameras[sight.camera]?;
        let point = self.points[sight.point]?;
        let way = point.coords - camera.xy();
        let range2 = way.norm_squared();
        let weight = sight.sigma.recip();
        let off = way.y.atan2(way.x) - camera.z - sight.bearing;
        let by_point = Vector2::new(-way.y, way.x) * (weight / range2);
        (range2 > 0.0).then(|| Row {
            camera: sight.camera,
            residual: angle::wrap_signed(off) * weight,
            by_point,
            by_camera: [-by_point.x, -by_point.y, -weight],
        })
    }

    fn rows_of(&self, point: usize) -> impl Iterator<Item = Row> + '_ {
        let own = self.sights.iter();
        let own = own.filter(move |sight| sight.point == point && sight.counts);
        own.filter_map(|sight| self.row(sight))
    }

    pub(crate) fn chi_squared(&self) -> f64 {
        let counting = self.sights.iter().filter(|sight| sight.counts);
        let rows = counting.filter_map(|sight| self.row(sight));
        rows.map(|row| row.residual * row.residual).sum()
    }

    /// Returns true if a bearing's camera and point are estimated and the point is before the camera.
    pub(crate) fn is_in_front(&self, sight: &Sight) -> Option<bool> {
        let row = self.row(sight)?;
        Some((row.residual * sight.sigma).abs() < std::f64::consts::FRAC_PI_2)
    }

    fn columns(&self) -> (Vec<Columns>, usize) {
        let mut next = 0;
        let mut column = |is_free: bool| {
            is_free.then(|| {
                next += 1;
                next - 1
            })
        };
        let columns = { self.cameras.iter().enumerate() }
            .map(|(n, camera)| {
                let is_known = camera.is_some();
                let moves = is_known && !self.frame.contains(&n);
                [column(moves), column(moves), column(is_known)]
            })
            .collect();
        (columns, next)
    }

    /// The equations for the cameras around the present estimates, points eliminated.
    fn equations(
        &self,
        columns: &[Columns],
        width: usize,
        damping: f64,
    ) -> Option<(Symmetric, Vec<f64>, Vec<Option<Eliminated>>)> {
        let mut normal = Symmetric::zeros(width);
        let mut gradient = vec![0.0; width];
        let mut points = Vec::new();
        let mut by_point: Vec<Vec<&Sight>> = vec![Vec::new(); self.points.len()];
        for sight in self.sights.iter().filter(|sight| sight.counts) {
            by_point[sight.point].push(sight);
        }
        let mut reductions: Vec<(usize, usize, f64)> = Vec::new();
        for own in &by_point {
            let mut block = Matrix2::zeros();
            let mut point_gradient = Vector2::zeros();
            let mut with: Vec<(usize, Vector2<f64>)> = Vec::new();
            let mut any = false;
            for row in own.iter().filter_map(|sight| self.row(sight)) {
                any = true;
                block += row.by_point * row.by_point.transpose();
                point_gradient += row.by_point * row.residual;
                for (i, by_i) in columns[row.camera].iter().zip(row.by_camera) {
                    let Some(i) = *i else { continue };
                    gradient[i] += by_i * row.residual;
                    let product = row.by_point * by_i;
                    match with.iter_mut().find(|(column, _)| *column == i) {
                        Some((_, sum)) => *sum += product,
                        None => with.push((i, product)),
                    }
                    for (j, by_j) in columns[row.camera].iter().zip(row.by_camera) {
                        if let Some(j) = *j {
                            normal.add(i, j, by_i * by_j);
                        }
                    }
                }
            }
            if !any {
                points.push(None);
                continue;
            }
            block.m11 *= 1.0 + damping;
            block.m22 *= 1.0 + damping;
            let inverse = block.try_inverse()?;
            for (i, by_i) in &with {
                let weighed = inverse * by_i;
                gradient[*i] -= weighed.dot(&point_gradient);
                reductions.extend(with.iter().map(|(j, by_j)| (*i, *j, weighed.dot(by_j))));
            }
            points.push(Some(Eliminated {
                inverse,
                gradient: point_gradient,
                with,
            }));
        }
        normal.damp(damping);
        for (i, j, number) in reductions {
            normal.add(i, j, -number);
        }
        Some((normal, gradient, points))
    }

    /// Goes to the minimum. `None` if there is none, or it is not determined.
    pub(crate) fn adjust(&mut self) -> Option<Adjusted> {
        let (columns, width) = self.columns();
        let mut cost = self.chi_squared();
        let mut damping = 1e-3;
        let mut converged = false;
        for _ in 0..PASSES {
            let Some(next) = self.step(&columns, width, damping) else {
                damping *= 10.0;
                if damping > 1e12 {
                    return None;
                }
                continue;
            };
            let next_cost = next.chi_squared();
            if next_cost <= cost {
                converged = cost - next_cost <= CONVERGED * (1.0 + cost);
                *self = next;
                cost = next_cost;
                damping = (damping * 0.1).max(1e-12);
                if converged {
                    break;
                }
            } else {
                damping *= 10.0;
                if damping > 1e12 {
                    // Rounding: as low as it gets.
                    converged = true;
                    break;
                }
            }
        }
        if !converged {
            return None;
        }
        let (normal, _, points) = self.equations(&columns, width, 0.0)?;
        let covariance = normal.factor()?.inverse();
        let counting = self.sights.iter().filter(|sight| sight.counts);
        let rows = counting.filter(|sight| self.row(sight).is_some()).count();
        let unknowns = width + 2 * points.iter().flatten().count();
        Some(Adjusted {
            chi_squared: cost,
            degrees_of_freedom: rows.saturating_sub(unknowns),
            covariance,
            columns,
            points,
        })
    }

    /// The same scene, a step further.
    fn step(&self, columns: &[Columns], width: usize, damping: f64) -> Option<Self> {
        let (normal, mut step, eliminated) = self.equations(columns, width, damping)?;
        normal.factor()?.solve(&mut step);
        let mut next = self.clone();
        for (camera, columns) in next.cameras.iter_mut().zip(columns) {
            if let Some(camera) = camera {
                for (number, column) in camera.iter_mut().zip(columns) {
                    *number -= column.map_or(0.0, |column| step[column]);
                }
            }
        }
        for (point, own) in next.points.iter_mut().zip(&eliminated) {
            if let (Some(point), Some(own)) = (point, own) {
                let by_cameras = { own.with.iter() }.fold(Vector2::zeros(), |sum, (column, by)| {
                    sum + by * step[*column]
                });
                *point -= own.inverse * (own.gradient - by_cameras);
            }
        }
        Some(next)
    }

    /// Residual over sigma of a bearing, and the share of it that is checked.
    pub(crate) fn residual(&self, adjusted: &Adjusted, sight: &Sight) -> Option<(f64, f64)> {
        let row = self.row(sight)?;
        let leverage = adjusted.leverage(&row, sight.point)?;
        let redundancy = if sight.counts { 1.0 - leverage } else { 1.0 };
        Some((row.residual, redundancy))
    }

    /// By how much a bearing that is wrong by its sigma moves a camera.
    pub(crate) fn influence(
        &self,
        adjusted: &Adjusted,
        sight: &Sight,
        camera: usize,
    ) -> Option<Vector3<f64>> {
        adjusted.influence(&self.row(sight)?, sight.point, camera)
    }

    /// Number of bearings of a point that count and have a camera.
    pub(crate) fn seen(&self, point: usize) -> usize {
        self.rows_of(point).count()
    }
}

impl Adjusted {
    /// Covariance of a camera; zero where it is given.
    pub(crate) fn camera(&self, camera: usize) -> Matrix3<f64> {
        let columns = self.columns[camera];
        Matrix3::from_fn(|i, j| match (columns[i], columns[j]) {
            (Some(i), Some(j)) => self.covariance.at(i, j),
            _ => 0.0,
        })
    }

    /// Covariance of a point.
    pub(crate) fn point(&self, point: usize) -> Option<Matrix2<f64>> {
        let own = self.points[point].as_ref()?;
        let mut sum = Matrix2::zeros();
        for (i, by_i) in &own.with {
            for (j, by_j) in &own.with {
                sum += by_i * by_j.transpose() * self.covariance.at(*i, *j);
            }
        }
        Some(own.inverse + own.inverse * sum * own.inverse)
    }

    /// The covariance of a camera with the prediction of a row.
    fn influence(&self, row: &Row, point: usize, camera: usize) -> Option<Vector3<f64>> {
        let own = self.points[point].as_ref()?;
        let direct = self.columns[row.camera].iter().zip(row.by_camera);
        let direct = direct.filter_map(|(column, by)| Some(((*column)?, by)));
        let by_point = own.with.iter().map(|(column, by)| {
            let across = row.by_point.dot(&(own.inverse * by));
            (*column, -across)
        });
        let row: Vec<(usize, f64)> = direct.chain(by_point).collect();
        Some(Vector3::from_fn(|i, _| {
            self.columns[camera][i].map_or(0.0, |i| {
                let products = row.iter().map(|(j, by)| self.covariance.at(i, *j) * by);
                products.sum()
            })
        }))
    }

    fn leverage(&self, row: &Row, point: usize) -> Option<f64> {
        let own = self.points[point].as_ref()?;
        let columns = self.columns[row.camera];
        let takes = || {
            let both = columns.iter().zip(row.by_camera);
            both.filter_map(|(column, by)| Some(((*column)?, by)))
        };
        let mut leverage = row.by_point.dot(&(self.point(point)? * row.by_point));
        for (i, by_i) in takes() {
            for (j, by_j) in takes() {
                leverage += by_i * by_j * self.covariance.at(i, j);
            }
            for (j, by_j) in &own.with {
                let across = row.by_point.dot(&(own.inverse * by_j));
                leverage -= 2.0 * by_i * across * self.covariance.at(i, *j);
            }
        }
        Some(leverage)
    }
}
