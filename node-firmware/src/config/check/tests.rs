use std::string::ToString;

use pixy_driver::Model;

use super::*;
use crate::{
    config::{
        SensorConfig, Sigmas, SiteKey,
        examples::{ORANGE, camera, coordinator, node, target},
    },
    vision::{ColourWindow, Lens},
};

fn with(change: impl FnOnce(&mut Config)) -> Result<(), ConfigError> {
    let mut config = node(RoleConfig::Target(target()));
    change(&mut config);
    config.check().map(drop)
}

fn with_camera(change: impl FnOnce(&mut CameraConfig)) -> Result<(), ConfigError> {
    let mut camera = camera();
    change(&mut camera);
    node(RoleConfig::Camera(camera)).check().map(drop)
}

fn with_target(change: impl FnOnce(&mut TargetConfig)) -> Result<(), ConfigError> {
    let mut target = target();
    change(&mut target);
    node(RoleConfig::Target(target)).check().map(drop)
}

#[test]
fn the_examples_are_right() {
    for role in [
        RoleConfig::Camera(camera()),
        RoleConfig::Target(target()),
        RoleConfig::Coordinator(coordinator(32)),
        RoleConfig::Coordinator(CoordinatorConfig::default()),
        RoleConfig::Target(TargetConfig::default()),
        RoleConfig::Camera(CameraConfig::new(
            Lens::pin_hole(88, 45.0),
            Subjects::Motion { threshold: 10 },
        )),
    ] {
        assert_eq!(node(role).check().map(drop), Ok(()));
    }
}

#[test]
fn identity_and_radio() {
    use ConfigError as E;
    for key in [
        SiteKey::new(0, *b"0123456789abcdef"),
        SiteKey::new(1, [0xFF; 16]),
    ] {
        assert_eq!(with(|c| c.site_key = key), Err(E::SiteKey));
    }
    for channels in [0, 1 << 10, 1 << 27, u32::MAX] {
        assert_eq!(with(|c| c.channels = channels), Err(E::Channels));
    }
    assert_eq!(with(|c| c.channels = 1 << 11 | 1 << 26), Ok(()));
    assert_eq!(with(|c| c.tx_power = 21), Err(E::TxPower));
}

#[test]
fn the_channels_are_those_of_the_mask() {
    use zigbee_link::{network::Channels, radio::Channel};
    let mut config = node(RoleConfig::Target(target()));
    let channels = |config: &Config| config.clone().check().unwrap().channels();
    config.channels = 0x07FF_F800;
    assert_eq!(channels(&config), Channels::ALL);
    config.channels = 1 << 15 | 1 << 20;
    let [a, b] = [15, 20].map(|number| Channel::new(number).unwrap());
    assert_eq!(channels(&config), Channels::only(a).and(b));
}

#[test]
fn coordinators() {
    let check = |coordinator| node(RoleConfig::Coordinator(coordinator)).check().map(drop);
    let mut twice = coordinator(3);
    twice.allow[2] = twice.allow[0];
    assert_eq!(check(twice), Err(ConfigError::Allow));
    let mut long = coordinator(0);
    long.join_window_s = 601;
    assert_eq!(check(long), Err(ConfigError::JoinWindow));
    for metres in [0.0, -1.0, 1e6, f32::NAN] {
        let mut other = coordinator(0);
        other.metres_per_unit = metres;
        assert_eq!(check(other), Err(ConfigError::Unit));
    }
    let mut large = coordinator(0);
    large.ball_radius = f32::INFINITY;
    assert_eq!(check(large), Err(ConfigError::BallRadius));
}

#[test]
fn cameras() {
    use ConfigError as E;
    let nan = f32::NAN;
    let lens = with_camera(|c| c.lens.field_of_view_deg = 180.0);
    assert!(matches!(lens, Err(E::Lens(_))));
    let text = lens.unwrap_err().to_string();
    assert!(
        text.starts_with("lens: ") && text.contains("180 degrees"),
        "{text}"
    );
    assert_eq!(
        with_camera(|c| c.lens = Lens::pin_hole(256, 45.0)),
        Err(E::Columns)
    );
    assert_eq!(with_camera(|c| c.baud = 38_000), Err(E::Baud));
    assert_eq!(with_camera(|c| c.first_column = 2), Err(E::FirstColumn));
    let colours = |windows: &[ColourWindow]| {
        let windows = windows.iter().copied().collect();
        with_camera(|c| c.subjects = Subjects::Colours(windows))
    };
    assert_eq!(colours(&[]), Err(E::Colours));
    let inverted = ColourWindow {
        green: [90, 80],
        ..ORANGE
    };
    assert_eq!(colours(&[ORANGE, inverted]), Err(E::Colours));
    assert_eq!(
        with_camera(|c| c.subjects = Subjects::Motion { threshold: 0 }),
        Err(E::Threshold)
    );
    // A CMUcam2 has no signatures, the Pixy family nothing else; its frames have one width each.
    for model in [Model::Pixy2, Model::Pixy, Model::OpenMv, Model::OpenMvTags] {
        let with = |change: fn(&mut CameraConfig)| {
            let mut camera = CameraConfig::pixy(model, 2);
            change(&mut camera);
            node(RoleConfig::Camera(camera)).check().map(drop)
        };
        assert_eq!(with(|_| ()), Ok(()));
        assert_eq!(with(|c| c.lens.columns -= 1), Err(E::Columns));
        assert!(with(|c| c.kind = CameraKind::Cmucam2).is_err());
        let tags = with(|c| c.subjects = Subjects::Tags);
        let signatures = with(|c| c.subjects = Subjects::Signatures(1));
        let sees_tags = model == Model::OpenMvTags;
        assert_eq!((tags.is_ok(), signatures.is_ok()), (sees_tags, !sees_tags));
    }
    assert_eq!(
        with_camera(|c| c.subjects = Subjects::Tags),
        Err(E::Signatures)
    );
    let pixy2 = |change: fn(&mut CameraConfig)| {
        let mut camera = CameraConfig::pixy(Model::Pixy2, 1);
        change(&mut camera);
        node(RoleConfig::Camera(camera)).check().map(drop)
    };
    assert_eq!(pixy2(|c| c.subjects = Subjects::Signatures(4)), Ok(()));
    for taught in [0, 5] {
        assert_eq!(
            with_camera(|c| {
                let pixy2 = CameraConfig::pixy(Model::Pixy2, taught);
                (c.kind, c.lens, c.subjects) = (pixy2.kind, pixy2.lens, pixy2.subjects);
            }),
            Err(E::Signatures)
        );
    }
    assert_eq!(
        with_camera(|c| c.subjects = Subjects::Signatures(1)),
        Err(E::Signatures)
    );
    let motion: fn(&mut CameraConfig) = |c| c.subjects = Subjects::Motion { threshold: 10 };
    assert_eq!(pixy2(motion), Err(E::Signatures));
    assert_eq!(
        pixy2(|c| c.lens = Lens::pin_hole(88, 45.0)),
        Err(E::Columns)
    );
    let placed = with_camera(|c| c.reference.as_mut().unwrap().position = Some([0.0, nan]));
    assert_eq!(placed, Err(E::ReferencePosition));
    for baseline in [0.0, -1.0, nan, f32::INFINITY] {
        assert_eq!(
            with_camera(|c| c.baseline = Some(baseline)),
            Err(E::Baseline)
        );
    }
    assert_eq!(
        with_camera(|c| c.frame_heading_deg = Some(nan)),
        Err(E::FrameHeading)
    );
    // Two stops do when only headings and the target are unknown (thesis notes, counting).
    assert_eq!(
        with_camera(|c| c.reference_stops = 2),
        Err(E::ReferenceStops)
    );
    let known = with_camera(|c| {
        c.reference_stops = 2;
        c.frame_heading_deg = Some(0.0);
    });
    assert_eq!(known, Ok(()));
    // With more than a camera keeps it would wait for ever.
    assert_eq!(with_camera(|c| c.reference_stops = 12), Ok(()));
    let most = with_camera(|c| c.reference_stops = 13);
    assert_eq!(most, Err(E::ReferenceStops));
    let text = most.unwrap_err().to_string();
    assert!(text.contains("2 to 12"), "{text}");
    assert_eq!(with_camera(|c| c.stops = 2), Err(E::Stops));
    // A camera keeps 16 sightings.
    assert_eq!(with_camera(|c| c.stops = 16), Ok(()));
    assert_eq!(with_camera(|c| c.stops = 17), Err(E::Stops));
    assert_eq!(
        with_camera(|c| c.good_enough.heading_deg = 0.0),
        Err(E::GoodEnough)
    );
    // The good-enough ones are 0.05 and 0.25.
    for (position, heading_deg, expected) in [
        (0.05, 0.25, Ok(())),
        (1e30, 180.0, Ok(())),
        (0.04, 0.25, Err(E::Weak)),
        (0.05, 0.24, Err(E::Weak)),
        (0.05, 180.5, Err(E::Weak)),
        (nan, 8.0, Err(E::Weak)),
        (0.5, nan, Err(E::Weak)),
        (f32::INFINITY, 8.0, Err(E::Weak)),
    ] {
        let weak = Sigmas {
            position,
            heading_deg,
        };
        assert_eq!(with_camera(|c| c.weak = weak), expected, "{weak:?}");
    }
    for floor in [-0.1, nan, 11.0] {
        assert_eq!(
            with_camera(|c| c.sigma_floor_px = floor),
            Err(E::SigmaFloor)
        );
    }
}

#[test]
fn targets() {
    use ConfigError as E;
    assert_eq!(with_target(|t| t.colour = 4), Err(E::TargetColour));
    assert_eq!(with_target(|t| t.still_after_ms = 99), Err(E::StillAfter));
    assert_eq!(
        with_target(|t| t.systematic_scale = -0.1),
        Err(E::Systematic)
    );
    assert_eq!(
        with_target(|t| t.systematic_heading_deg = f32::NAN),
        Err(E::Systematic)
    );
    for sensor in [
        SensorConfig {
            hard_iron: [0.0, f32::NAN, 0.0],
            ..SensorConfig::UNCALIBRATED
        },
        SensorConfig {
            hard_iron: [-401.0, 0.0, 0.0],
            ..SensorConfig::UNCALIBRATED
        },
        SensorConfig {
            step_length: 0.0,
            ..SensorConfig::UNCALIBRATED
        },
    ] {
        assert_eq!(with_target(|t| t.sensor = sensor), Err(E::Sensor));
    }
    // Finite is not enough: so must its square be.
    for sigma in [f32::NAN, -0.1, 1e20, 1001.0] {
        assert_eq!(
            with_target(|t| t.standing_sigma = sigma),
            Err(E::StandingSigma)
        );
        assert_eq!(with_target(|t| t.ball_radius = sigma), Err(E::BallRadius));
    }
    for wrong in [f32::NAN, -0.1, 0.6] {
        assert_eq!(
            with_target(|t| t.lens_sigma.focal = wrong),
            Err(E::LensSigma)
        );
        assert_eq!(
            with_target(|t| t.survey_sigma.baseline = wrong),
            Err(E::SurveySigma)
        );
    }
    for wrong in [f32::NAN, -0.1, 1e20] {
        assert_eq!(
            with_target(|t| t.lens_sigma.principal_deg = wrong),
            Err(E::LensSigma)
        );
        assert_eq!(
            with_target(|t| t.lens_sigma.tilt_deg = wrong),
            Err(E::LensSigma)
        );
        assert_eq!(
            with_target(|t| t.survey_sigma.position = wrong),
            Err(E::SurveySigma)
        );
    }
    assert!(E::StandingSigma.to_string().contains("0 to 1000"));
    assert_eq!(with_target(|t| t.dwell_least_ms = 120_001), Err(E::Dwell));
}
