//! A longer walk on emulated nRF52840s. It takes as long as all that [`chips`](super::chips) has of `lab`, and finds
//! little more: `cargo xtask test --stage soak`.
#![cfg(feature = "chip")]

use site::{Overrides, Scenario};

use super::chips::run;

/// From blank flash to 13 poses.
#[test]
#[ignore = "`cargo xtask test --stage soak`"]
fn thesis_13_calibrates() {
    let scenario = Scenario::load("thesis-13", &Overrides::default()).unwrap();
    let (_, record, _) = run(scenario, 0);
    assert_eq!(record.summary.calibrated, 13);
    for camera in record.cameras() {
        let error = camera.error.as_ref().unwrap();
        assert!(
            camera.nees.is_none_or(|nees| nees < 25.0),
            "{}: {error:?}",
            camera.id
        );
    }
}
