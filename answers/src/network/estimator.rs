//! The joint estimator on the heap, of the size that is needed.

use calib_core::joint::{
    BearingResidual, Carrier, Finding, JointError, JointEstimator, JointSettings, Leg, LegResidual,
    ProtectionLevels, StopPlace, workspace,
};
use calib_core::{Pose, fit::Fit};

/// A bearing by numbers of stop and camera, radians.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub stop: usize,
    pub camera: usize,
    pub bearing: f64,
    pub sigma: f64,
}

/// What goes into an estimator.
#[derive(Clone, Debug)]
pub(super) struct Input {
    pub cameras: usize,
    pub baseline: f64,
    pub settings: JointSettings<f64>,
    /// One for each stop.
    pub legs: Vec<Option<Leg<f64>>>,
    /// By ascending stop.
    pub bearings: Vec<Seen>,
}

/// How much is asked of an estimator: poses alone cost least.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Depth {
    /// Poses, places and carrier from all measurements as they are.
    Answers,
    /// Without what contradicts, with residuals and protection levels.
    Checked { fit_legs: bool },
}

/// What comes out.
#[derive(Clone, Debug)]
pub(super) struct Output {
    pub fit: Fit<f64>,
    /// Of each camera, references included.
    pub poses: Vec<Option<Pose<f64>>>,
    pub protections: Vec<Option<ProtectionLevels<f64>>>,
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

/// Cameras, stops and bearings that the largest estimator takes.
pub(super) const MOST: [usize; 3] = [256, 4096, 32768];

/// Stack of the thread that makes an estimator, before it is moved to the heap, a few times over.
const STACK: usize = 256 << 20;

/// Why there is no output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Failure {
    TooMany,
    Joint(JointError),
}

/// Solves in the smallest estimator that has room.
pub(super) fn solve(input: &Input, depth: Depth) -> Result<Output, Failure> {
    let sizes = [input.cameras, input.legs.len(), input.bearings.len()];
    let fits = |most: [usize; 3]| sizes.iter().zip(most).all(|(size, most)| *size <= most);
    let solve_in: fn(&Input, Depth) -> Result<Output, JointError> = match () {
        () if fits([16, 64, 512]) => solve_in::<16, 64, 512, { workspace(16, 0) }>,
        () if fits([64, 512, 4096]) => solve_in::<64, 512, 4096, { workspace(64, 0) }>,
        () if fits(MOST) => {
            solve_in::<{ MOST[0] }, { MOST[1] }, { MOST[2] }, { workspace(MOST[0], 0) }>
        }
        () => return Err(Failure::TooMany),
    };
    let solved = std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().stack_size(STACK);
        let thread = thread.spawn_scoped(scope, || solve_in(input, depth));
        thread.ok().and_then(|thread| thread.join().ok())
    });
    solved.ok_or(Failure::TooMany)?.map_err(Failure::Joint)
}

fn solve_in<const C: usize, const S: usize, const B: usize, const W: usize>(
    input: &Input,
    depth: Depth,
) -> Result<Output, JointError> {
    let joint = JointEstimator::<f64, C, S, B, 0, W>::new(input.baseline, input.settings)?;
    let mut joint = Box::new(joint);
    for leg in &input.legs {
        joint.add_stop(*leg)?;
    }
    for seen in &input.bearings {
        joint.add_bearing(seen.stop, seen.camera, seen.bearing, seen.sigma)?;
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
    let poses = (0..input.cameras).map(|n| joint.pose(n).ok()).collect();
    let mut output = Output {
        fit: solved.fit,
        poses,
        protections: vec![None; input.cameras],
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
