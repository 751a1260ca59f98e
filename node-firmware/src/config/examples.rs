//! Configurations for tests.

use super::{
    CameraConfig, Config, CoordinatorConfig, LensSigma, RoleConfig, SensorConfig, Sigmas, SiteKey,
    Subjects, SurveySigma, TargetConfig,
};
use crate::message::{Duty, Reference};
use crate::vision::{CameraKind, ColourWindow, Lens};
use zigbee_link::security::Protection;

pub(crate) const ORANGE: ColourWindow = ColourWindow {
    red: [170, 240],
    green: [60, 140],
    blue: [16, 80],
};

pub(crate) fn node(role: RoleConfig) -> Config {
    Config {
        id: 3,
        site_key: SiteKey::new(1, *b"0123456789abcdef"),
        channels: 0x0210_8800,
        tx_power: -4,
        protection: Protection::EncMic64,
        role,
        sleeps: false,
    }
}

pub(crate) fn camera() -> CameraConfig {
    CameraConfig {
        kind: CameraKind::Cmucam2,
        lens: Lens::pin_hole(88, 45.0),
        baud: 38_400,
        first_column: 1,
        subjects: Subjects::Colours([ORANGE].into_iter().collect()),
        round: true,
        reference: Some(Reference {
            duty: Duty::Second,
            position: Some([10.0, -0.5]),
        }),
        may_be_elected: false,
        baseline: Some(10.0),
        frame_heading_deg: None,
        reference_stops: 3,
        stops: 5,
        refine: true,
        good_enough: Sigmas {
            position: 0.05,
            heading_deg: 0.25,
        },
        weak: Sigmas {
            position: 0.5,
            heading_deg: 8.0,
        },
        sigma_floor_px: 0.0625,
        lens_sigma: LensSigma {
            focal: 0.05,
            principal_deg: 1.0,
            tilt_deg: 1.5,
        },
    }
}

/// The same with a Pixy2 of 19,200 baud.
pub(crate) fn pixy2() -> CameraConfig {
    CameraConfig {
        kind: CameraKind::Pixy2,
        lens: Lens::pin_hole(316, 60.0),
        baud: 19_200,
        subjects: Subjects::Signatures(2),
        ..camera()
    }
}

/// The same with an OpenMV Cam that looks for tags.
pub(crate) fn tags() -> CameraConfig {
    CameraConfig {
        kind: CameraKind::OpenMvTags,
        lens: Lens::pin_hole(160, 70.75),
        baud: 19_200,
        subjects: Subjects::Tags,
        ..camera()
    }
}

pub(crate) fn target() -> TargetConfig {
    TargetConfig {
        colour: 2,
        still_after_ms: 1_500,
        systematic_heading_deg: 0.5,
        systematic_scale: 0.015_625,
        standing_sigma: 0.02,
        ball_radius: 0.75,
        dwell_least_ms: 2_000,
        dwell_most_ms: 120_000,
        roams: false,
        lens_sigma: LensSigma {
            focal: 0.05,
            principal_deg: 1.0,
            tilt_deg: 1.5,
        },
        survey_sigma: SurveySigma {
            baseline: 0.01,
            position: 0.02,
        },
        sensor: SensorConfig {
            hard_iron: [12.5, -30.0, 0.25],
            step_length: 0.5,
        },
    }
}

pub(crate) fn coordinator(devices: u8) -> CoordinatorConfig {
    CoordinatorConfig {
        allow: (1..=devices).map(u16::from).collect(),
        join_window_s: 300,
        metres_per_unit: 0.0254,
        ball_radius: 0.75,
    }
}
