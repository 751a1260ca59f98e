//! The joint estimator on the heap, of the size that is needed.

use calib_core::joint::{
    BearingResidual, BearingStorage, Capacity, Carrier, Finding, JointError, JointEstimator,
    JointMemory, JointSettings, Leg, LegResidual, Lens, ProtectionLevels, Quantity, StopPlace,
    StopStorage, UnknownStorage, VisitStorage,
};
use calib_core::{
    Pose,
    fit::Fit,
    level::{Elevation, Levelness},
};
use nalgebra::Matrix3;

use super::sparse::Sparse;

/// A bearing, radians, or a range by numbers of stop and camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub stop: usize,
    pub camera: usize,
    pub quantity: Quantity,
    pub value: f64,
    pub sigma: f64,
    pub elevation: Elevation,
}

/// A visit by numbers of stop and mark.
#[derive(Clone, Copy, Debug)]
pub(super) struct Visit {
    pub stop: usize,
    pub mark: usize,
    pub sigma: f64,
}

/// Input of an estimator.
#[derive(Clone, Debug)]
pub(super) struct Input {
    pub cameras: usize,
    pub marks: usize,
    pub baseline: f64,
    pub settings: JointSettings<f64>,
    /// One for each stop.
    pub legs: Vec<Option<Leg<f64>>>,
    /// By ascending stop, ranges among them.
    pub bearings: Vec<Seen>,
    pub visits: Vec<Visit>,
}

/// Amount of work asked of an estimator: poses alone cost least.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Depth {
    /// Poses, places and carrier from all measurements as they are.
    Answers,
    /// Without contradicting measurements, with residuals and protection levels.
    Checked { fit_legs: bool },
}

impl Depth {
    /// The same, believing what displacements claim.
    pub(super) const fn believing(self) -> Self {
        match self {
            Self::Answers => self,
            Self::Checked { .. } => Self::Checked { fit_legs: false },
        }
    }
}

/// Output of an estimator.
#[derive(Clone, Debug)]
pub(super) struct Output {
    pub fit: Fit<f64>,
    /// Poses of all cameras, references included.
    pub poses: Vec<Option<Pose<f64>>>,
    /// Of cameras whose rows are known.
    pub mounts: Vec<Option<Levelness<f64>>>,
    pub protections: Vec<Option<ProtectionLevels<f64>>>,
    /// Where they are estimated.
    pub lenses: Vec<Option<Lens<f64>>>,
    /// Of each stop.
    pub places: Vec<Option<StopPlace<f64>>>,
    pub carrier: Carrier<f64>,
    pub findings: Vec<Finding<f64>>,
    /// In the order of the input; `None` for cameras without a pose.
    pub bearings: Vec<Option<BearingResidual<f64>>>,
    /// Of each stop.
    pub legs: Vec<Option<LegResidual<f64>>>,
    pub leg_factor: Option<f64>,
}

/// Contradictions that are looked for, at most: of more, something else is wrong.
fn most_findings(input: &Input) -> usize {
    8 + input.bearings.len() / 10
}

/// Stops and marks of which the equations are held densely.
const MOST_KEPT: usize = 400;

/// Stops and cameras are counted in 16 bits.
pub(super) const MOST: usize = u16::MAX as usize;

/// Why there is no output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Failure {
    TooMany,
    Joint(JointError),
}

/// Solves in as much memory as it takes.
pub(super) fn solve(input: &Input, depth: Depth) -> Result<Output, Failure> {
    if input.cameras.max(input.legs.len()).max(input.marks) > MOST {
        return Err(Failure::TooMany);
    }
    let is_long = input.legs.len() + input.marks > MOST_KEPT;
    solve_in_memory(input, depth, is_long).map_err(Failure::Joint)
}

/// All unknowns of a long walk are solved together, as sparse equations.
fn solve_in_memory(input: &Input, depth: Depth, is_long: bool) -> Result<Output, JointError> {
    let capacity = Capacity {
        cameras: input.cameras,
        stops: input.legs.len(),
        bearings: input.bearings.len(),
        marks: input.marks,
    };
    let mut seen = vec![0; input.cameras];
    for sight in &input.bearings {
        seen[sight.camera] += 1;
    }
    // All of what a camera saw can be left out together.
    let most = seen.into_iter().max().unwrap_or_default();
    let workspace = match is_long {
        true => capacity.workspace_beside_solver(),
        false => capacity.workspace_with_lenses(),
    };
    let workspace = workspace + most * (most + 3) / 2;
    let mut solver = Sparse::default();
    let memory = JointMemory {
        cameras: &mut vec![UnknownStorage::default(); input.cameras],
        stops: &mut vec![StopStorage::default(); input.legs.len()],
        bearings: &mut vec![BearingStorage::default(); input.bearings.len()],
        marks: &mut vec![UnknownStorage::default(); input.marks],
        visits: &mut vec![VisitStorage::default(); input.visits.len()],
        workspace: &mut vec![0.0; workspace],
    };
    let mut joint = match is_long {
        true => JointEstimator::with_solver(memory, &mut solver, input.baseline, input.settings)?,
        false => JointEstimator::new(memory, input.baseline, input.settings)?,
    };
    for leg in &input.legs {
        joint.add_stop(*leg)?;
    }
    for seen in &input.bearings {
        match seen.quantity {
            Quantity::Bearing => {
                joint.add_bearing(seen.stop, seen.camera, seen.value, seen.sigma)?;
                joint.add_elevation(seen.elevation)?;
            }
            Quantity::Range => joint.add_range(seen.stop, seen.camera, seen.value, seen.sigma)?,
        }
    }
    for visit in &input.visits {
        joint.add_visit(visit.stop, visit.mark, visit.sigma)?;
    }
    let mut solved = joint.solve();
    let (mut findings, mut leg_factor) = (Vec::new(), None);
    if let Depth::Checked { fit_legs } = depth
        && !matches!(solved, Err(JointError::Start(_)))
    {
        while findings.len() < most_findings(input) {
            match joint.check() {
                Ok(Some(finding)) => findings.push(finding),
                Ok(None) => break,
                Err(why) => {
                    solved = Err(why);
                    break;
                }
            }
        }
        if !findings.is_empty() {
            solved = joint.solve();
        }
        if fit_legs && solved.is_ok() {
            leg_factor = joint.fit_leg_noise().ok();
            solved = joint.solve();
        }
    }
    let solved = solved?;
    let last = input.legs.len().saturating_sub(1);
    let carrier = joint.carrier().map_err(JointError::Solve)?;
    let cameras = 0..input.cameras;
    let mounts: Vec<_> = { cameras.clone() }
        .map(|n| joint.levelness(n, 1.0))
        .collect();
    let poses = cameras.map(|n| {
        let mut pose = joint.pose(n).ok()?;
        pose.covariance += mounts[n].map_or_else(Matrix3::zeros, |mount| mount.widening);
        Some(pose)
    });
    let poses = poses.collect();
    let mut output = Output {
        fit: solved.fit,
        poses,
        mounts,
        protections: vec![None; input.cameras],
        lenses: (0..input.cameras).map(|n| joint.lens(n).ok()).collect(),
        places: (0..=last).map(|stop| joint.place(stop).ok()).collect(),
        carrier,
        findings,
        bearings: Vec::new(),
        legs: Vec::new(),
        leg_factor,
    };
    if depth != Depth::Answers {
        if joint.protect().is_ok() {
            let levels = (0..input.cameras).map(|n| joint.protection(n));
            output.protections = levels.collect();
        }
        let bearings = 0..input.bearings.len();
        output.bearings = bearings.map(|n| joint.bearing_residual(n).ok()).collect();
        output.legs = (0..=last)
            .map(|stop| joint.leg_residual(stop).ok())
            .collect();
    }
    Ok(output)
}

#[cfg(test)]
mod tests {
    use calib_core::{Limits, joint::Prior};
    use test_support::{
        generator,
        walk::{CarrierErrors, Walk},
    };

    use super::*;

    /// Nine cameras, one of them bumped half way and one bearing wrong, with lenses that are estimated.
    fn input(seed: u64) -> Input {
        let mut walk = Walk::random(&mut generator(seed), 9, 24, CarrierErrors::UNKNOWN, 0.0024);
        let bumped = (2..9).max_by_key(|camera| walk.seen_by(*camera)).unwrap();
        let mut others = walk
            .bearings
            .iter_mut()
            .filter(|seen| seen.camera != bumped);
        others.nth(30).unwrap().bearing += 0.05;
        for seen in &mut walk.bearings {
            if seen.camera == bumped && seen.stop > 12 {
                seen.bearing += 0.1;
            }
        }
        let legs = walk.legs.iter().map(|leg| {
            Some(Leg {
                displacement: leg.displacement,
                covariance: leg.covariance,
            })
        });
        let bearings = walk.bearings.iter().map(|seen| Seen {
            stop: seen.stop,
            camera: seen.camera,
            quantity: Quantity::Bearing,
            value: seen.bearing,
            sigma: seen.sigma,
            elevation: Elevation::UNKNOWN,
        });
        let prior = |mean, sigma| Prior { mean, sigma };
        let mut settings = JointSettings::default();
        settings.scale = prior(1.0, walk.errors.scale);
        settings.compass = prior(0.0, walk.errors.compass);
        settings.lens = Some(0.02);
        settings.limits = Limits {
            position: 3.0,
            heading: 0.5,
        };
        Input {
            cameras: 9,
            marks: 1,
            baseline: walk.cameras[1].x,
            settings,
            legs: std::iter::once(None).chain(legs).collect(),
            bearings: bearings.collect(),
            visits: [3, 14]
                .map(|stop| Visit {
                    stop,
                    mark: 0,
                    sigma: 3.0,
                })
                .into(),
        }
    }

    /// The results, and what is left out, do not depend on which equations are solved.
    #[test]
    fn sparse_equations_say_the_same() {
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-5 * (1.0 + b.abs());
        for seed in 0..8 {
            let (input, depth) = (input(seed), Depth::Checked { fit_legs: false });
            let [kept, sparse] =
                [false, true].map(|is_long| solve_in_memory(&input, depth, is_long).unwrap());
            assert_eq!(kept.findings.len(), sparse.findings.len(), "{seed}");
            for (a, b) in kept.findings.iter().zip(&sparse.findings) {
                assert_eq!(
                    std::mem::discriminant(a),
                    std::mem::discriminant(b),
                    "{a:?} {b:?}"
                );
            }
            assert!(near(kept.fit.chi_squared, sparse.fit.chi_squared));
            for (a, b) in kept.poses.iter().zip(&sparse.poses) {
                assert_eq!(a.is_some(), b.is_some());
                let (Some(a), Some(b)) = (a, b) else { continue };
                assert!((a.position - b.position).norm() < 1e-5);
                assert!((a.covariance - b.covariance).norm() < 1e-5 * a.covariance.norm());
            }
            for (a, b) in kept.protections.iter().zip(&sparse.protections) {
                let (Some(a), Some(b)) = (a, b) else { continue };
                // Where hardly anything is checked, the last digits of an estimate show.
                let near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-3;
                assert!(near(a.position_bearing, b.position_bearing), "{a:?} {b:?}");
                assert!(near(a.position_leg, b.position_leg), "{a:?} {b:?}");
                assert!(near(a.heading_leg, b.heading_leg), "{a:?} {b:?}");
            }
            for (a, b) in kept.bearings.iter().zip(&sparse.bearings) {
                let (Some(a), Some(b)) = (a, b) else { continue };
                assert!(near(a.redundancy, b.redundancy) && a.standing == b.standing);
            }
            for (a, b) in kept.legs.iter().zip(&sparse.legs) {
                let (Some(a), Some(b)) = (a, b) else { continue };
                assert!(near(a.chi_squared, b.chi_squared) && near(a.redundancy, b.redundancy));
            }
            for (a, b) in kept.places.iter().zip(&sparse.places) {
                let (Some(a), Some(b)) = (a, b) else { continue };
                assert!((a.covariance - b.covariance).norm() < 1e-5 * a.covariance.norm());
            }
            for (a, b) in kept.lenses.iter().zip(&sparse.lenses) {
                let (Some(a), Some(b)) = (a, b) else { continue };
                assert!(near(a.scale, b.scale) && near(a.sigma, b.sigma));
            }
        }
    }
}
