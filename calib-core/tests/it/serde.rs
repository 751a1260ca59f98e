//! Values that a node stores and sends come back the same.
#![cfg(feature = "serde")]

use core::fmt::Debug;

use calib_core::{
    Limits, Method, Pose, Ray, Refusal, Sighting, Status,
    dead_reckoning::{Place, PlaceParts, Step, Systematic, Track},
    intersection::StationBearing,
    reference::{Known, Stop},
    resection,
};
use nalgebra::{Matrix2, Point2, Vector2};
use serde::{Serialize, de::DeserializeOwned};

fn comes_back<T: Serialize + DeserializeOwned + PartialEq + Debug>(value: &T) {
    let text = serde_json::to_string(value).unwrap();
    assert_eq!(&serde_json::from_str::<T>(&text).unwrap(), value, "{text}");
}

#[test]
fn values_come_back() {
    let sightings = [(4.0, 0.3), (5.0, -0.4), (2.5, 0.1)].map(|(range, bearing): (f32, f32)| {
        let target = Point2::new(range * bearing.cos(), range * bearing.sin() + 0.5);
        Sighting::new(target, Ray::from_bearing(bearing), 0.01).with_target_sigma(0.02)
    });
    let solution = resection::solve(&sightings).unwrap();
    comes_back(&sightings);
    comes_back::<Pose<f32>>(&solution.pose);
    comes_back(&solution);
    comes_back(&solution.fit());
    comes_back(&Limits {
        position: 0.5_f32,
        heading: 0.1,
    });
    comes_back(&Status::Doubtful);
    comes_back(&Stop {
        rays: [sightings[0].ray, sightings[1].ray],
        bearing_sigmas: [0.01_f32; 2],
        displacement: Vector2::new(1.0, -2.0),
        displacement_covariance: Matrix2::new(0.1, 0.01, 0.01, 0.2),
    });
    comes_back(&Known {
        baseline: Some(10.0_f32),
        frame_heading: None,
    });
    let mut track = Track::start(
        Point2::new(1.0_f32, 2.0),
        Matrix2::identity(),
        Systematic::default(),
    )
    .unwrap();
    let step = Step {
        distance: 0.7,
        heading: 1.0,
        distance_sigma: 0.05,
        heading_sigma: 0.1,
    };
    track.advance(&step).unwrap();
    comes_back(&step);
    comes_back(&track);
    let place = track.place(0.02).unwrap();
    comes_back(&place);
    let forged = PlaceParts {
        standing_sigma: -1.0,
        ..*place.parts()
    };
    let text = serde_json::to_string(&forged).unwrap();
    assert!(serde_json::from_str::<Place<f32>>(&text).is_err());
    comes_back(&StationBearing {
        pose: solution.pose,
        ray: sightings[0].ray,
        bearing_sigma: 0.01,
        range: Some((3.0, 0.1)),
    });
}

/// Files and messages carry the same names as [`Refusal::name`].
#[test]
fn refusals_are_spelled_as_they_are_named() {
    for refusal in [
        Refusal::TooFew,
        Refusal::CoincidentTargets,
        Refusal::DangerCircle,
        Refusal::DangerLine,
        Refusal::Undetermined,
        Refusal::TargetBehind,
        Refusal::NotFinite,
        Refusal::DidNotConverge,
        Refusal::Inconsistent,
    ] {
        assert_eq!(serde_json::to_value(refusal).unwrap(), refusal.name());
        comes_back(&refusal);
    }
    assert_eq!(
        serde_json::to_value(Method::GaussNewton).unwrap(),
        "gauss-newton"
    );
}
