//! Problems whose minimum, or whose next step, is known.

extern crate std;

use core::cell::RefCell;
use std::vec::Vec;

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::*;

const METHODS: [Method; 3] = [
    Method::GaussNewton,
    Method::SteepestDescent,
    Method::Levenberg,
];

/// Residuals with their slopes, of two unknowns and weight one; remembers the costs of where a
/// walk was.
struct Smooth<F> {
    residuals: F,
    costs: RefCell<Vec<f64>>,
}

impl<F: Fn(Vector2<f64>) -> [(f64, Vector2<f64>); 2]> Smooth<F> {
    fn new(residuals: F) -> Self {
        let costs = RefCell::default();
        Self { residuals, costs }
    }
}

impl<F: Fn(Vector2<f64>) -> [(f64, Vector2<f64>); 2]> Problem<f64> for Smooth<F> {
    fn model(&self, x: &[f64], model: &mut Quadratic<'_, f64>) {
        for (residual, slope) in (self.residuals)(Vector2::from_column_slice(x)) {
            model.add(residual, slope.as_slice(), 1.0);
        }
        self.costs.borrow_mut().push(model.cost);
    }

    fn cost(&self, x: &[f64], _: &[f64]) -> f64 {
        let residuals = (self.residuals)(Vector2::from_column_slice(x));
        residuals
            .iter()
            .map(|(residual, _)| residual * residual)
            .sum()
    }
}

/// One unknown and made-up numbers: its model is `cost + 2 gradient d + d^2` wherever it is,
/// with one cost after the other; its cost elsewhere is whatever a function of the place says.
struct MadeUp<C> {
    gradient: f64,
    costs: RefCell<std::vec::IntoIter<f64>>,
    elsewhere: C,
}

impl<C: Fn(f64) -> f64> Problem<f64> for MadeUp<C> {
    fn model(&self, _: &[f64], model: &mut Quadratic<'_, f64>) {
        model.hessian[0] = 1.0;
        model.gradient[0] = self.gradient;
        model.cost = self.costs.borrow_mut().next().unwrap();
    }

    fn cost(&self, x: &[f64], _: &[f64]) -> f64 {
        (self.elsewhere)(x[0])
    }
}

/// The place where a walk from zero ends, and the number of its steps.
fn made_up(
    gradient: f64,
    costs: &[f64],
    elsewhere: impl Fn(f64) -> f64,
    method: Method,
) -> Result<(usize, f64), Refusal> {
    let problem = MadeUp {
        gradient,
        costs: RefCell::new(Vec::from(costs).into_iter()),
        elsewhere,
    };
    let mut walk = Descent::new(SVector::from([0.0]));
    let steps = walk.run(&problem, method, costs.len())?;
    Ok((steps, walk.x[0]))
}

#[test]
fn a_step_solves_the_damped_normal_equations() {
    let (mut hessian, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
    let mut model = Quadratic {
        hessian: hessian.as_mut_slice(),
        gradient: gradient.as_mut_slice(),
        cost: 0.0,
        last_settles: false,
    };
    let rows = [
        (0.3, [1.0, 2.0, -1.0], 2.0),
        (-0.7, [0.5, -1.0, 3.0], 0.5),
        (1.1, [2.0, 0.0, 1.0], 1.5),
        (0.2, [-1.0, 1.0, 1.0], 1.0),
    ];
    let (mut h, mut g, mut cost) = (Matrix3::zeros(), Vector3::zeros(), 0.0);
    for (residual, slope, weight) in rows {
        model.add(residual, &slope, weight);
        let slope = Vector3::from(slope);
        h += slope * slope.transpose() * weight;
        g += slope * residual * weight;
        cost += residual * residual * weight;
    }
    assert!((model.cost - cost).abs() < 1e-12);
    assert!((model.trace() - h.trace()).abs() < 1e-12);
    for damping in [0.0, 0.1, 3.0] {
        let stretched = h + Matrix3::from_diagonal(&h.diagonal()) * damping;
        let expected = -stretched.try_inverse().unwrap() * g;
        let step = model.step(damping).unwrap();
        assert!((Vector3::from_column_slice(&step[..3]) - expected).norm() < 1e-12);
        assert_eq!(step[3..], [0.0; 3]);
    }
}

/// For linear residuals the model is exact.
#[test]
fn full_steps_solve_a_linear_problem_at_once() {
    let slopes = [Vector2::new(2.0, 1.0), Vector2::new(-1.0, 3.0)];
    let problem = Smooth::new(|x| [0, 1].map(|k| (slopes[k].dot(&x) - 5.0, slopes[k])));
    for method in [Method::GaussNewton, Method::Levenberg] {
        let mut walk = Descent::new(Vector2::new(-7.0, 30.0));
        // The second step is none.
        assert_eq!(walk.run(&problem, method, 2), Ok(2));
        assert!((walk.x - Vector2::new(10.0, 15.0) / 7.0).norm() < 1e-12);
        assert!(walk.cost < 1e-20);
        let hessian = Matrix2::new(5.0, -1.0, -1.0, 10.0);
        assert!((walk.hessian - hessian).norm() < 1e-12);
        let covariance = hessian.try_inverse().unwrap();
        assert!((walk.covariance().unwrap() - covariance).norm() < 1e-12);
        let mut walk = Descent::new(Vector2::new(-7.0, 30.0));
        assert_eq!(walk.run(&problem, method, 1), Err(Refusal::DidNotConverge));
    }
}

/// Independent unknowns are solved by one step against the gradient, for they are scaled to equal curvature.
/// For others the step ends where the cost is least along it: the slope there is across it.
#[test]
fn steepest_descent_takes_the_step_of_cauchy() {
    let scales = [1e3, 1e-2];
    let problem = Smooth::new(|x| {
        let axes = [Vector2::x(), Vector2::y()];
        [0, 1].map(|k| (scales[k] * (x[k] - 2.0), axes[k] * scales[k]))
    });
    let mut walk = Descent::new(Vector2::new(9.0, -80.0));
    assert_eq!(walk.run(&problem, Method::SteepestDescent, 2), Ok(2));
    assert!((walk.x - Vector2::new(2.0, 2.0)).norm() < 1e-9);

    let slopes = [Vector2::new(2.0, 1.0), Vector2::new(-1.0, 3.0)];
    let problem = Smooth::new(|x| [0, 1].map(|k| (slopes[k].dot(&x) - 5.0, slopes[k])));
    let x = [-1.0, 4.0];
    let (mut hessian, mut gradient) = ([0.0; 4], [0.0; 2]);
    let mut model = Quadratic {
        hessian: &mut hessian,
        gradient: &mut gradient,
        cost: 0.0,
        last_settles: false,
    };
    problem.model(&x, &mut model);
    let next = downhill(&problem, &x, &model).unwrap();
    let step = Vector2::new(next[0] - x[0], next[1] - x[1]);
    let direction = Vector2::new(-gradient[0] / 5.0, -gradient[1] / 10.0);
    assert!(step.normalize().dot(&direction.normalize()) > 1.0 - 1e-12);
    let (mut hessian, mut gradient) = ([0.0; 4], [0.0; 2]);
    let mut model = Quadratic {
        hessian: &mut hessian,
        gradient: &mut gradient,
        cost: 0.0,
        last_settles: false,
    };
    problem.model(&next[..2], &mut model);
    assert!(dot(step.as_slice(), &gradient).abs() < 1e-12);
}

/// The valley of Rosenbrock, and an arc tangent, of which full steps overshoot more and more.
#[test]
fn what_goes_downhill_never_goes_up() {
    let rosenbrock = |x: Vector2<f64>| {
        [
            (10.0 * (x.y - x.x * x.x), Vector2::new(-20.0 * x.x, 10.0)),
            (1.0 - x.x, Vector2::new(-1.0, 0.0)),
        ]
    };
    let arc = |x: Vector2<f64>| {
        [
            (
                100.0 * x.x.atan(),
                Vector2::new(100.0 / (1.0 + x.x * x.x), 0.0),
            ),
            (100.0 * (x.y - 1.0), Vector2::new(0.0, 100.0)),
        ]
    };
    for (method, limit) in [(Method::Levenberg, 40), (Method::SteepestDescent, 50_000)] {
        let (valley, bend) = (Smooth::new(rosenbrock), Smooth::new(arc));
        let mut walk = Descent::new(Vector2::new(-1.2, 1.0));
        walk.run(&valley, method, limit).unwrap();
        assert!(
            (walk.x - Vector2::new(1.0, 1.0)).norm() < 0.01,
            "{method:?}"
        );
        let mut walk = Descent::new(Vector2::new(3.0, -4.0));
        walk.run(&bend, method, limit).unwrap();
        assert!((walk.x - Vector2::y()).norm() < 1e-4, "{method:?}");
        for costs in [valley.costs.take(), bend.costs.take()] {
            assert!(costs.len() > 2 && costs.is_sorted_by(|before, after| after < before));
        }
    }
    let mut walk = Descent::new(Vector2::new(3.0, -4.0));
    // Full steps run away.
    let _ = walk.run(&Smooth::new(arc), Method::GaussNewton, 40);
    assert!(!((walk.x - Vector2::y()).norm() < 100.0));
}

#[test]
fn a_cost_that_is_not_finite_does_not_converge() {
    for method in METHODS {
        for cost in [f64::NAN, f64::INFINITY] {
            let result = made_up(0.0, &[cost], |_| cost, method);
            assert_eq!(result, Err(Refusal::DidNotConverge), "{method:?} {cost}");
        }
    }
}

#[test]
fn unknowns_without_curvature_do_not_converge() {
    let flat = Smooth::new(|x| [(x.x - 1.0, Vector2::x()), (2.0 * x.x, 2.0 * Vector2::x())]);
    for method in METHODS {
        let result = Descent::new(Vector2::zeros()).run(&flat, method, 20);
        assert_eq!(result, Err(Refusal::DidNotConverge), "{method:?}");
    }
}

/// With unit curvature the full step is as many sigmas long as the gradient is large. Up to a
/// thousandth it is the last; up to a tenth it is not needed where it lowers nothing.
#[test]
fn steps_end_where_they_are_short() {
    for method in METHODS {
        let end = |gradient| made_up(gradient, &[1.0], |_| 2.0, method);
        assert_eq!(end(0.99e-3), Ok((1, -0.99e-3)), "{method:?}");
        assert_eq!(end(1e-3), Ok((1, -1e-3)), "{method:?}");
    }
    for method in [Method::SteepestDescent, Method::Levenberg] {
        let end = |gradient| made_up(gradient, &[1.0], |_| 2.0, method);
        assert_eq!(end(1.01e-3), Ok((1, 0.0)), "{method:?}");
        assert_eq!(end(0.099), Ok((1, 0.0)), "{method:?}");
        assert_eq!(end(0.1), Ok((1, 0.0)), "{method:?}");
        assert_eq!(end(0.101), Err(Refusal::DidNotConverge), "{method:?}");
    }
}

/// Three times in a row; not where steps are short for another reason.
#[test]
fn a_cost_that_hardly_changes_ends_the_walk() {
    let steps = |costs: &[f64], method| made_up(1.0, costs, |_| 0.0, method).map(|end| end.0);
    let creeping = |by: f64| [0, 1, 2, 3, 4, 5].map(|n| 9.0 + by * f64::from(n));
    for method in [Method::GaussNewton, Method::Levenberg] {
        assert_eq!(steps(&creeping(-0.9e-4), method), Ok(4));
        assert_eq!(steps(&creeping(0.9e-4), method), Ok(4));
        for by in [1.1e-4, -1.1e-4] {
            assert_eq!(steps(&creeping(by), method), Err(Refusal::DidNotConverge));
        }
        // Two, and once more three.
        assert_eq!(steps(&[9.0, 9.0, 9.0, 8.0, 8.0, 8.0, 8.0], method), Ok(7));
    }
    let creeps = steps(&creeping(-0.9e-4), Method::SteepestDescent);
    assert_eq!(creeps, Err(Refusal::DidNotConverge));
}

/// From none on, a thousandth and then ten times as much each time, until the cost falls; back
/// by ten after each success, and to none.
#[test]
fn damping_grows_until_the_cost_falls() {
    let run = |limit: f64, damping: &mut f64| {
        let problem = MadeUp {
            gradient: 1.0,
            costs: RefCell::new(std::vec![1.0].into_iter()),
            elsewhere: |x: f64| if x.abs() < limit { 0.5 } else { 1.0 },
        };
        let mut model = Quadratic {
            hessian: &mut [0.0],
            gradient: &mut [0.0],
            cost: 0.0,
            last_settles: false,
        };
        problem.model(&[0.0], &mut model);
        damped(&problem, &[0.0], &model, damping).map(|next| next[0])
    };
    let near = |a: f64, b: f64| (a - b).abs() < 1e-9 * b.abs();
    let mut damping = 0.0;
    // A step of a twentieth needs a damping of 19.
    let step = run(0.05, &mut damping).unwrap();
    assert!(near(step, -1.0 / 101.0) && near(damping, 10.0), "{damping}");
    for left in [1.0, 0.1, 0.01, 0.001] {
        let step = run(2.0, &mut damping).unwrap();
        assert!(near(step, -1.0 / (1.0 + 10.0 * left)) && near(damping, left));
    }
    damping = 1e-3;
    assert!(run(2.0, &mut damping).is_some());
    assert_eq!(damping, 0.0);
    assert!(near(run(0.9995, &mut damping).unwrap(), -1.0 / 1.001));
    assert_eq!(run(0.0, &mut damping), None);
    assert!((1e9..2e10).contains(&damping), "{damping:e}");
}
