//! Status of a camera by what was tested.

use calib_core::{Limits, Status};
use node_firmware::message::{CameraState, Duty, PoseParts, ProtectionLevel, Report};

const LIMITS: Limits<f32> = Limits {
    position: 0.5,
    heading: 0.17,
};

const LEVEL: ProtectionLevel = ProtectionLevel {
    position: 1.0,
    heading: 0.1,
};

fn status(duty: Option<Duty>, joint: Option<ProtectionLevel>, sigma: f32) -> Status {
    let parts = PoseParts {
        position: [1.0, 2.0],
        heading: 0.5,
        covariance: [sigma * sigma, 0.0, sigma * sigma, 0.0, 0.0, 1e-4],
    };
    let report = Report {
        id: 1,
        duty,
        sightings: 5,
        used: 5,
        chi_squared: 1.0,
        done: false,
        joint,
        state: CameraState::Weak(parts),
        mount: None,
    };
    let once = report.state.judged_again(&LIMITS, report.is_tested());
    let again = once.judged_again(&LIMITS, report.is_tested());
    assert_eq!(again, once);
    once.status()
}

#[test]
fn a_reference_is_weak_until_a_target_has_estimated_it() {
    for duty in [Duty::First, Duty::Second] {
        assert_eq!(status(Some(duty), None, 0.01), Status::Weak);
        let joint = Some(ProtectionLevel::OF_REFERENCE);
        assert_eq!(status(Some(duty), joint, 0.01), Status::Calibrated);
        assert_eq!(status(Some(duty), joint, 1.0), Status::Weak);
    }
}

#[test]
fn a_camera_of_an_estimate_that_tells_no_level_is_weak() {
    let joint = Some(ProtectionLevel::NONE);
    assert_eq!(status(None, joint, 0.01), Status::Weak);
    assert_eq!(status(None, Some(LEVEL), 0.01), Status::Calibrated);
    // A network may get its frame from cameras that have no duty in it.
    let joint = Some(ProtectionLevel::OF_REFERENCE);
    assert_eq!(status(None, joint, 0.01), Status::Calibrated);
    assert_eq!(status(None, Some(LEVEL), 1.0), Status::Weak);
    // Three sightings of its own are enough.
    assert_eq!(status(None, None, 0.01), Status::Calibrated);
}
