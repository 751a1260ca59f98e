//! Conditions that must hold of a run, and the check of them.

use std::{collections::BTreeMap, fmt};

use calib_core::{Refusal, Status};
use results::record::{Node, RunRecord};
use serde::{Deserialize, Serialize};
use site::Scenario;

use crate::{calm, runs::Outcome};

/// A pose that is told as good may err by so many sigmas, or by so many units.
pub const SIGMAS: f64 = 5.0;
/// See [`SIGMAS`].
pub const UNITS: f64 = 0.5;
/// A heading that is told as good may err by [`SIGMAS`], or by so many degrees.
pub const DEGREES: f64 = 2.0;

/// Condition that does not hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Failure {
    /// A pose that is told as checked errs by more than its protection level, in the unit of the site.
    Unprotected {
        /// The camera.
        camera: u16,
        /// Its error.
        error: f64,
        /// Its protection level.
        level: f64,
    },
    /// A pose that is told as good errs by more than five sigmas, and by more than half a unit.
    /// A camera that was moved and since then hardly saw a target is none of these.
    Deceives {
        /// The camera.
        camera: u16,
        /// Its error, in the unit of the site.
        error: f64,
        /// The same in sigmas of the direction in which it errs. None: its place was given as exact.
        sigmas: Option<f64>,
    },
    /// The same of a heading: more than five sigmas, and more than two degrees.
    Turned {
        /// The camera.
        camera: u16,
        /// Its error.
        degrees: f64,
        /// The same in its sigmas.
        sigmas: f64,
    },
    /// A camera that saw enough after the last fault is not calibrated.
    Late {
        /// The camera.
        camera: u16,
        /// Its status.
        status: Status,
        /// Reason why it has no pose.
        reason: Option<Refusal>,
    },
    /// A node's firmware gave up.
    Stopped {
        /// The node.
        node: u16,
        /// Reason.
        why: String,
    },
    /// A panic.
    Panicked(String),
    /// It never comes to its end; simulated seconds.
    Hung(f64),
}

/// Kinds of failures, in the order in which they are told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// [`Failure::Panicked`]
    Panic,
    /// [`Failure::Hung`]
    Hang,
    /// [`Failure::Stopped`]
    Stopped,
    /// [`Failure::Unprotected`]
    Unprotected,
    /// [`Failure::Deceives`]
    Deceives,
    /// [`Failure::Turned`]
    Turned,
    /// [`Failure::Late`]
    Late,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Panic,
        Self::Hang,
        Self::Stopped,
        Self::Unprotected,
        Self::Deceives,
        Self::Turned,
        Self::Late,
    ];

    /// In words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Panic => "panic",
            Self::Hang => "hang",
            Self::Stopped => "firmware gave up",
            Self::Unprotected => "checked, beyond its protection level",
            Self::Deceives => "calibrated, beyond 5 sigma and 0.5 units",
            Self::Turned => "calibrated, heading beyond 5 sigma and 2 degrees",
            Self::Late => "saw enough, not calibrated",
        }
    }
}

impl Failure {
    /// Its kind.
    pub const fn kind(&self) -> Kind {
        match self {
            Self::Unprotected { .. } => Kind::Unprotected,
            Self::Deceives { .. } => Kind::Deceives,
            Self::Turned { .. } => Kind::Turned,
            Self::Late { .. } => Kind::Late,
            Self::Stopped { .. } => Kind::Stopped,
            Self::Panicked(_) => Kind::Panic,
            Self::Hung(_) => Kind::Hang,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unprotected {
                camera,
                error,
                level,
            } => write!(
                f,
                "camera {camera} is checked and errs by {error:.2}, more than its protection level of {level:.2}"
            ),
            Self::Deceives {
                camera,
                error,
                sigmas: None,
            } => write!(
                f,
                "camera {camera} is calibrated at the place that it was given, {error:.2} units off"
            ),
            Self::Deceives {
                camera,
                error,
                sigmas: Some(sigmas),
            } => write!(
                f,
                "camera {camera} is calibrated and errs by {error:.2} units, {sigmas:.0} sigmas"
            ),
            Self::Turned {
                camera,
                degrees,
                sigmas,
            } => write!(
                f,
                "camera {camera} is calibrated and its heading errs by {degrees:.1} degrees, {sigmas:.0} sigmas"
            ),
            Self::Late {
                camera,
                status,
                reason,
            } => {
                write!(f, "camera {camera} saw enough and is {}", status.name())?;
                reason.map_or(Ok(()), |reason| write!(f, ": {}", reason.name()))
            }
            Self::Stopped { node, why } => write!(f, "node {node} gave up: {why}"),
            Self::Panicked(message) => write!(f, "a panic: {message}"),
            Self::Hung(seconds) => write!(f, "not over after {seconds:.0} simulated seconds"),
        }
    }
}

/// Facts about one camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraResult {
    /// Status that it tells.
    pub status: Status,
    /// Distance of its pose from the truth, unless its place was given.
    pub error: Option<f64>,
    /// It is doubtful or refused as contradicting itself, though its pose errs by no more than it
    /// says.
    pub is_false_alarm: bool,
    /// Its pose has a protection level.
    pub is_checked: bool,
    /// It saw enough after the last fault.
    pub saw_enough: bool,
}

/// Judgement of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    /// Conditions that do not hold.
    pub failures: Vec<Failure>,
    /// Its cameras; none if it did not end.
    pub cameras: Vec<CameraResult>,
}

impl Judgement {
    /// Returns true if it fails as another one did: in the same way, and with a camera that is late for the same
    /// reason.
    pub fn fails_as(&self, other: &Failure) -> bool {
        self.failures.iter().any(|own| match (own, other) {
            (
                Failure::Late { status, reason, .. },
                Failure::Late {
                    status: other,
                    reason: because,
                    ..
                },
            ) => status == other && reason == because,
            _ => own.kind() == other.kind(),
        })
    }

    /// Returns true if there is a failure of this kind.
    pub fn has(&self, kind: Kind) -> bool {
        self.failures.iter().any(|failure| failure.kind() == kind)
    }
}

/// Distance of a camera's pose from the truth, and the same in predicted sigmas, for the directions in which it was
/// estimated. The place that was given to a reference has the sigmas `surveyed`, if any
/// ([`RunRecord::surveyed_sigmas`]).
pub fn position_error(camera: &Node, surveyed: Option<[f64; 2]>) -> Option<(f64, Option<f64>)> {
    let error = camera.error?;
    let sigmas = match camera.position_fit() {
        Some(fit) => Some(fit.chi_squared.sqrt()),
        None => surveyed.map(|[along, across]| {
            // Zero over zero, where a sigma of zero was told.
            let share = |error: f64, sigma: f64| if error == 0.0 { 0.0 } else { error / sigma };
            share(error.x, along).hypot(share(error.y, across))
        }),
    };
    Some((error.x.hypot(error.y), sigmas))
}

/// The error of a pose that is told as good, if it is more than five sigmas, and more than half a unit or two
/// degrees.
pub fn deceives(camera: &Node, surveyed: Option<[f64; 2]>) -> Option<Failure> {
    if !camera.is_calibrated() {
        return None;
    }
    let (error, sigmas) = position_error(camera, surveyed)?;
    if error > UNITS && sigmas.is_none_or(|sigmas| sigmas > SIGMAS) {
        return Some(Failure::Deceives {
            camera: camera.id,
            error,
            sigmas,
        });
    }
    let (degrees, sigmas) = camera.heading_error()?;
    (degrees > DEGREES && sigmas > SIGMAS).then_some(Failure::Turned {
        camera: camera.id,
        degrees,
        sigmas,
    })
}

/// A pose that is told as good and checked, and errs by more than its protection level.
fn unprotected(camera: &Node, level: Option<&f64>) -> Option<Failure> {
    let level = *level.filter(|_| camera.is_calibrated())?;
    let error = camera.error?;
    let error = error.x.hypot(error.y);
    (error > level).then_some(Failure::Unprotected {
        camera: camera.id,
        error,
        level,
    })
}

/// Compares the outcome of a scenario with the conditions that must hold.
pub fn judge(scenario: &Scenario, outcome: &Outcome) -> Judgement {
    match outcome {
        Outcome::Panicked(message) => of_failure(Failure::Panicked(message.clone())),
        Outcome::Hung(seconds) => of_failure(Failure::Hung(*seconds)),
        Outcome::Ended { record, protection } => of_record(scenario, record, protection),
    }
}

fn of_failure(failure: Failure) -> Judgement {
    Judgement {
        failures: vec![failure],
        cameras: Vec::new(),
    }
}

fn of_record(
    scenario: &Scenario,
    record: &RunRecord,
    protection: &BTreeMap<u16, f64>,
) -> Judgement {
    let served = calm::well_served(scenario, record);
    let unseen = calm::bumped_unseen(scenario, record);
    let mut judgement = Judgement::default();
    for node in &record.nodes {
        let failed = node.failures.first().map(|failure| Failure::Stopped {
            node: node.id,
            why: failure.why.clone(),
        });
        judgement.failures.extend(failed);
    }
    for camera in record.cameras() {
        let status = camera.status.unwrap_or(Status::Waiting);
        let saw_enough = served.contains(&camera.id);
        // The pose of a camera that was just moved cannot be known.
        if !unseen.contains(&camera.id) {
            judgement
                .failures
                .extend(unprotected(camera, protection.get(&camera.id)));
            let surveyed = record.surveyed_sigmas(camera);
            judgement.failures.extend(deceives(camera, surveyed));
        }
        if saw_enough && status != Status::Calibrated {
            judgement.failures.push(Failure::Late {
                camera: camera.id,
                status,
                reason: camera.reason,
            });
        }
        judgement.cameras.push(CameraResult {
            status,
            error: camera
                .estimate
                .filter(|estimate| estimate.sigma_position() > 0.0)
                .and(camera.error)
                .map(|error| error.x.hypot(error.y)),
            is_false_alarm: is_false_alarm(camera, status),
            is_checked: protection.contains_key(&camera.id),
            saw_enough,
        });
    }
    judgement
}

fn is_false_alarm(camera: &Node, status: Status) -> bool {
    let doubts = status == Status::Doubtful || camera.reason == Some(Refusal::Inconsistent);
    let is_right = camera.truth_fit().is_some_and(|fit| !fit.is_bad());
    doubts && is_right
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::Pose;
    use nalgebra::{Matrix3, Point2, Vector3};
    use results::record::{Place, Role};

    /// A camera at the origin that errs so much along x, with this sigma.
    fn camera(error: f64, sigma: f64, status: Status) -> Node {
        let mut node = Node::new(3, Role::Camera);
        node.status = Some(status);
        node.truth = Some(Place::new(0.0, 0.0, 0.0));
        node.set_pose(&Pose {
            position: Point2::new(error, 0.0),
            heading: 0.0,
            covariance: Matrix3::from_diagonal_element(sigma * sigma),
        });
        node
    }

    #[test]
    fn a_pose_deceives_that_is_told_as_good_and_is_far_off() {
        for (error, sigma, status, is_told) in [
            (0.6, 0.1, Status::Calibrated, true),
            (0.6, 0.1, Status::Doubtful, false),
            (0.6, 0.1, Status::Weak, false),
            // Within its sigmas, or nothing that hurts.
            (0.6, 0.13, Status::Calibrated, false),
            (0.4, 0.01, Status::Calibrated, false),
            // A reference that was moved: its place was given.
            (0.6, 0.0, Status::Calibrated, true),
        ] {
            let told = deceives(&camera(error, sigma, status), None);
            assert_eq!(told.is_some(), is_told, "{error} {sigma} {status:?}");
        }
    }

    /// Ten times as far along the baseline as across it.
    #[test]
    fn a_place_that_was_measured_errs_as_the_tape_does() {
        let reference = camera(0.6, 0.0, Status::Calibrated);
        for (sigmas, is_told) in [([0.2, 0.02], false), ([0.02, 0.2], true)] {
            assert_eq!(deceives(&reference, Some(sigmas)).is_some(), is_told);
        }
    }

    #[test]
    fn a_heading_deceives_as_a_place_does() {
        for (degrees, sigma_deg, is_told) in [
            (3.0, 0.5, true),
            (3.0, 0.7, false),
            (1.9, 0.1, false),
            // It was given.
            (3.0, 0.0, false),
        ] {
            let mut node = camera(0.0, 0.1, Status::Calibrated);
            node.set_pose(&Pose {
                position: Point2::origin(),
                heading: f64::to_radians(degrees),
                covariance: Matrix3::from_diagonal(&Vector3::new(
                    0.01,
                    0.01,
                    f64::to_radians(sigma_deg).powi(2),
                )),
            });
            let is_turned = matches!(deceives(&node, None), Some(Failure::Turned { .. }));
            assert_eq!(is_turned, is_told, "{degrees} {sigma_deg}");
        }
    }

    /// The frame says that a second reference has no error across the line between both: its other direction
    /// counts.
    #[test]
    fn a_direction_that_was_given_has_no_sigmas() {
        for (error, sigmas) in [(0.3, 3.0), (0.6, 6.0)] {
            let mut node = camera(0.0, 1.0, Status::Calibrated);
            node.set_pose(&Pose {
                position: Point2::new(error, 0.1),
                heading: 0.0,
                covariance: Matrix3::from_diagonal(&Vector3::new(0.01, 0.0, 1e-4)),
            });
            let (_, told) = position_error(&node, None).unwrap();
            assert!((told.unwrap() - sigmas).abs() < 1e-9, "{told:?}");
        }
    }

    #[test]
    fn a_checked_pose_is_within_its_protection_level() {
        let is_told =
            |error, level, status| unprotected(&camera(error, 0.1, status), level).is_some();
        assert!(is_told(0.4, Some(&0.3), Status::Calibrated));
        assert!(!is_told(0.2, Some(&0.3), Status::Calibrated));
        assert!(!is_told(0.4, Some(&0.3), Status::Doubtful));
        assert!(!is_told(0.4, None, Status::Calibrated));
    }

    #[test]
    fn sigmas_are_those_of_the_direction_of_the_error() {
        let mut node = camera(0.0, 1.0, Status::Calibrated);
        node.set_pose(&Pose {
            position: Point2::new(0.3, 0.4),
            heading: 0.0,
            covariance: Matrix3::new(0.04, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 1.0),
        });
        let (error, sigmas) = position_error(&node, None).unwrap();
        assert!((error - 0.5).abs() < 1e-12);
        assert!((sigmas.unwrap() - (1.5_f64.powi(2) + 16.0).sqrt()).abs() < 1e-9);
    }

    #[test]
    fn doubt_of_a_right_pose_is_a_false_alarm() {
        let is_false = |error, status| is_false_alarm(&camera(error, 0.1, status), status);
        assert!(is_false(0.1, Status::Doubtful));
        assert!(!is_false(0.1, Status::Calibrated));
        assert!(!is_false(1.0, Status::Doubtful));
    }
}
