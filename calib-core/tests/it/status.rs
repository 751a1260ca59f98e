//! Each status, on both sides of its boundary.

use calib_core::{Limits, Pose, Refusal, Status, fit::Fit, joint::is_consensus};
use nalgebra::{Matrix3, Point2};

const LIMITS: Limits<f64> = Limits {
    position: 0.5,
    heading: 0.1,
};
const GOOD: Fit<f64> = Fit {
    chi_squared: 4.0,
    degrees_of_freedom: 4,
};

fn pose(sigmas: [f64; 3]) -> Pose<f64> {
    Pose {
        position: Point2::origin(),
        heading: 1.0,
        covariance: Matrix3::from_diagonal(&sigmas.map(|s| s * s).into()),
    }
}

/// The sigma of the position is 0.5 when those of x and y are 0.3 and 0.4.
#[test]
fn a_pose_is_weak_beyond_a_limit() {
    let of = |sigmas| Status::of(&pose(sigmas), &GOOD, &LIMITS);
    assert_eq!(of([0.3, 0.399, 0.099]), Status::Calibrated);
    assert_eq!(of([0.3, 0.401, 0.099]), Status::Weak);
    assert_eq!(of([0.3, 0.399, 0.101]), Status::Weak);
    assert_eq!(of([0.0; 3]), Status::Calibrated);
    assert_eq!(of([f64::NAN, 0.0, 0.0]), Status::Weak);
    let any = Limits {
        position: f64::INFINITY,
        heading: f64::INFINITY,
    };
    assert_eq!(
        Status::of(&pose([1e6, 1e6, 3.0]), &GOOD, &any),
        Status::Calibrated
    );
}

#[test]
fn a_contradicted_pose_is_doubtful_however_certain() {
    // 18.47 is exceeded once in a thousand.
    let of = |sigma, chi_squared| {
        let fit = Fit {
            chi_squared,
            ..GOOD
        };
        Status::of(&pose([sigma, 0.0, 0.0]), &fit, &LIMITS)
    };
    assert_eq!(of(0.1, 18.4), Status::Calibrated);
    assert_eq!(of(0.1, 18.6), Status::Doubtful);
    assert_eq!(of(0.6, 18.4), Status::Weak);
    assert_eq!(of(0.6, 18.6), Status::Doubtful);
    assert_eq!(of(0.1, f64::NAN), Status::Doubtful);
}

#[test]
fn too_few_sightings_are_waited_for() {
    assert_eq!(Status::from(Refusal::TooFew), Status::Waiting);
    for refusal in [
        Refusal::DangerCircle,
        Refusal::Inconsistent,
        Refusal::NotFinite,
    ] {
        assert_eq!(Status::from(refusal), Status::Refused);
    }
}

#[test]
fn one_spelling() {
    for (status, name) in [
        (Status::Calibrated, "calibrated"),
        (Status::Weak, "weak"),
        (Status::Doubtful, "doubtful"),
        (Status::Refused, "refused"),
        (Status::Waiting, "waiting"),
    ] {
        assert_eq!(status.name(), name);
        assert_eq!(status.to_string(), name);
        assert_eq!(format!("{status:12}|"), format!("{name:12}|"));
        #[cfg(feature = "serde")]
        assert_eq!(serde_json::to_value(status).unwrap(), name);
    }
}

/// Two of three agree where the pose is checked, and otherwise four of five from five on.
#[test]
fn a_pose_needs_sightings_that_agree() {
    for (counting, all, checked, unchecked) in [
        (3, 3, true, true),
        (3, 4, true, true),
        (2, 3, true, true),
        (2, 4, false, false),
        (4, 5, true, true),
        (7, 9, true, false),
        (11, 16, true, false),
        (13, 16, true, true),
        (10, 16, false, false),
    ] {
        let told = [true, false].map(|is_checked| is_consensus(counting, all, is_checked));
        assert_eq!(told, [checked, unchecked], "{counting} of {all}");
    }
}

/// 3.09 sigmas are exceeded once in a thousand.
#[test]
fn a_checked_pose_errs_as_little_as_a_calibrated_one() {
    assert!(LIMITS.tolerate(1.544, 0.308));
    assert!(!LIMITS.tolerate(1.546, 0.308));
    assert!(!LIMITS.tolerate(1.544, 0.31));
    assert!(!LIMITS.tolerate(f64::MAX, f64::MAX));
}
