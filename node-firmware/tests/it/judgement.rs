//! Status of a camera by what its sightings say.

use calib_core::{Limits, Status};
use node_firmware::message::{CameraState, PoseParts, ProtectionLevel};

const LIMITS: Limits<f32> = Limits {
    position: 0.5,
    heading: 0.17,
};

const GOOD: CameraState = CameraState::Calibrated(PoseParts {
    position: [1.0, 2.0],
    heading: 0.5,
    covariance: [1e-4, 0.0, 1e-4, 0.0, 0.0, 1e-4],
});

#[test]
fn a_pose_that_next_to_nothing_checks_is_weak() {
    let status = |position, heading| {
        let level = ProtectionLevel { position, heading };
        GOOD.checked(&level, &LIMITS).status()
    };
    let (place, heading) = (9.0 * LIMITS.position, 9.0 * LIMITS.heading);
    assert_eq!(status(place, heading), Status::Calibrated);
    assert_eq!(status(1.1 * place, heading), Status::Weak);
    assert_eq!(status(place, 1.1 * heading), Status::Weak);
    let unknown = GOOD.checked(&ProtectionLevel::NONE, &LIMITS);
    assert_eq!(unknown.status(), Status::Weak);
    // Its place was given.
    let reference = GOOD.checked(&ProtectionLevel::OF_REFERENCE, &LIMITS);
    assert_eq!(reference.status(), Status::Calibrated);
    let waits = CameraState::Waiting.checked(&ProtectionLevel::NONE, &LIMITS);
    assert_eq!(waits.status(), Status::Waiting);
}
