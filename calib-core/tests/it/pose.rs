//! Poses that come from a message or a memory.

use std::f64::consts::TAU;

use calib_core::{Pose, PoseError};
use nalgebra::{Matrix3, Point2, Rotation2, Vector2};
use proptest::prelude::*;

const POSITION: Point2<f64> = Point2::new(3.0, -4.0);

#[test]
fn the_triangle_goes_by_rows() {
    let pose = Pose::from_parts(POSITION, 1.0, [4.0, 0.5, 9.0, 0.1, -0.2, 0.01]).unwrap();
    let expected = Matrix3::new(4.0, 0.5, 0.1, 0.5, 9.0, -0.2, 0.1, -0.2, 0.01);
    assert_eq!(pose.covariance, expected);
    assert_eq!(pose.sigma_y(), 3.0);
    assert_eq!(pose.covariance_triangle(), [4.0, 0.5, 9.0, 0.1, -0.2, 0.01]);
    let turned = Pose::from_parts(POSITION, -1.0, [0.0; 6]).unwrap();
    assert_eq!(turned.heading, TAU - 1.0);
}

#[test]
fn what_is_no_pose_is_refused() {
    let good = [4.0, 0.5, 9.0, 0.1, -0.2, 0.01];
    let nan = f64::NAN;
    let refused = |place, heading, c| Pose::from_parts(place, heading, c).unwrap_err();
    assert_eq!(
        refused(Point2::new(nan, 0.0), 0.0, good),
        PoseError::NotFinite
    );
    assert_eq!(refused(POSITION, f64::INFINITY, good), PoseError::NotFinite);
    for k in 0..6 {
        let mut bad = good;
        bad[k] = nan;
        assert_eq!(refused(POSITION, 0.0, bad), PoseError::NotFinite);
    }
    for bad in [
        [-4.0, 0.5, 9.0, 0.1, -0.2, 0.01],
        [4.0, 6.1, 9.0, 0.0, 0.0, 0.01],
        [4.0, 0.5, 9.0, 0.3, -0.2, 0.01],
        [4.0, 0.5, 9.0, 0.1, -0.2, 0.0],
        // Each pair could be, all three together cannot.
        [1.0, 0.9, 1.0, -0.9, 0.9, 1.0],
        // Small as the heading's variance is, it cannot err more than wholly with x.
        [1.0, 0.0, 1.0, 2e-4, 0.0, 1e-8],
    ] {
        assert_eq!(
            refused(POSITION, 0.0, bad),
            PoseError::NotACovariance,
            "{bad:?}"
        );
    }
}

proptest! {
    /// Also where it has no rank, and where it was rounded to single precision on the way.
    #[test]
    fn every_covariance_comes_back(
        factor in prop::array::uniform9(-10.0..10.0_f64), rank in 0_usize..4, heading_unit in 1e-4..1.0_f64,
    ) {
        let mut factor = Matrix3::from_column_slice(&factor);
        for k in rank..3 {
            factor.column_mut(k).fill(0.0);
        }
        factor.row_mut(2).scale_mut(heading_unit);
        let pose = Pose {
            position: Point2::new(3.0_f32, -4.0),
            heading: 1.0,
            covariance: (factor * factor.transpose()).cast::<f32>(),
        };
        let back = Pose::from_parts(pose.position, pose.heading, pose.covariance_triangle());
        prop_assert_eq!(back, Ok(pose));
    }
}

/// A sigma of zero would be the best of all.
#[test]
fn what_is_not_a_number_has_no_sigma() {
    let mut pose = Pose::from_parts(POSITION, 1.0, [4.0, 0.5, 9.0, 0.1, -0.2, 0.01]).unwrap();
    pose.covariance = Matrix3::repeat(f64::NAN);
    let sigmas = [
        pose.sigma_x(),
        pose.sigma_y(),
        pose.sigma_position(),
        pose.sigma_heading(),
    ];
    assert!(sigmas.iter().all(|sigma| sigma.is_nan()), "{sigmas:?}");
    let ellipse = pose.ellipse(0.9);
    assert!(ellipse.semi_major.is_nan() && ellipse.semi_minor.is_nan());
}

#[test]
fn it_is_told_in_degrees() {
    let mut pose = Pose::from_parts(POSITION, 1.5, [4.0, 0.5, 9.0, 0.1, -0.2, 0.01]).unwrap();
    let text = "x 3.000 +/- 2.000, y -4.000 +/- 3.000, heading 85.94 +/- 5.73 deg";
    assert_eq!(pose.to_string(), text);
    pose.heading = TAU / 8.0;
    assert!(pose.to_string().contains("heading 45.00 "));
}

/// Between the axes of the ellipse the variance is that of the covariance, in all directions: the
/// quadratic form of its inverse is the quantile of chi squared.
#[test]
fn the_ellipse_is_where_the_quantile_is() {
    for [xx, xy, yy] in [
        [4.0, 0.5, 9.0],
        [9.0, -3.0, 2.0],
        [1.0, 0.0, 4.0],
        [4.0, 0.0, 1.0],
    ] {
        let pose = Pose::from_parts(POSITION, 0.0, [xx, xy, yy, 0.0, 0.0, 1.0]).unwrap();
        for probability in [0.1_f64, 0.5, 0.95] {
            let ellipse = pose.ellipse(probability);
            assert!(ellipse.semi_major >= ellipse.semi_minor);
            for k in 0..8 {
                let (sine, cosine) = (f64::from(k) * TAU / 8.0).sin_cos();
                let point = Rotation2::new(ellipse.angle)
                    * Vector2::new(ellipse.semi_major * cosine, ellipse.semi_minor * sine);
                let form = (yy * point.x * point.x - 2.0 * xy * point.x * point.y
                    + xx * point.y * point.y)
                    / (xx * yy - xy * xy);
                // For two degrees of freedom the share within is one less exp(-form / 2).
                assert!((1.0 - (-form / 2.0).exp() - probability).abs() < 1e-12);
            }
        }
    }
}
