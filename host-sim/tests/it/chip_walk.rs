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

/// Six cameras of a room hang 1.5 m above the ball and look down by 25 to 35 degrees; the ball bobs. Their chips find the
/// poses, and height, pitch and roll come out.
#[test]
#[ignore = "`cargo xtask test --stage soak`"]
fn cameras_that_look_down_calibrate() {
    let scenario = Scenario::from_toml(ROOM, &Overrides::default()).unwrap();
    let (_, record, _) = run(scenario, 0);
    assert_eq!(record.summary.calibrated, 6);
    for camera in record.cameras() {
        assert!(camera.nees.is_none_or(|nees| nees < 25.0), "{camera:?}");
        // Where a reference's stops were is not read from a chip.
        if camera.reference {
            continue;
        }
        let found = camera.estimate.and_then(|estimate| estimate.hung).unwrap();
        let error = camera.error.and_then(|error| error.hung).unwrap();
        for (error, sigma, least) in [
            (error.z, found.sigma_z, 0.2),
            (error.pitch_deg, found.sigma_pitch_deg, 5.0),
            (error.roll_deg, found.sigma_roll_deg, 5.0),
        ] {
            let is_right = error.abs() < 4.0 * sigma && error.abs() < least;
            assert!(is_right, "{}: {found:?} {error:?}", camera.id);
        }
    }
}

const ROOM: &str = r#"
name = "room from above"
unit = "m"
stops = 6

[camera]
projection = "pin-hole"
field_of_view_deg = 60.0
range = 9.0

[world]
low = [0.0, 0.0]
high = [8.0, 7.0]

[walk]
bob_sigma = 0.02

[sensor]
measures = true
scale_bias = 0.03
heading_bias_deg = -1.5

[firmware]
systematic_scale = 0.05
systematic_heading_deg = 2.0

[[network]]
references = { cameras = [1, 2] }
camera = [
  { id = 1, x = 0.2, y = 0.2, heading_deg = 50.0, height = 2.5, pitch_deg = 30.0, roll_deg = 1.0 },
  { id = 2, x = 7.8, y = 0.2, heading_deg = 130.0, height = 2.5, pitch_deg = 28.0, roll_deg = -2.0 },
  { id = 3, x = 4.0, y = 6.8, heading_deg = 265.0, height = 2.6, pitch_deg = 32.0 },
  { id = 4, x = 0.2, y = 4.5, heading_deg = 5.0, height = 2.4, pitch_deg = 35.0 },
  { id = 5, x = 7.8, y = 4.0, heading_deg = 175.0, height = 2.5, pitch_deg = 25.0, roll_deg = 1.5 },
  { id = 6, x = 3.5, y = 0.2, heading_deg = 95.0, height = 2.5, pitch_deg = 30.0 },
]
target = [{ id = 20 }]
"#;
