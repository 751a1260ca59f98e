//! Directions of columns.

use core::fmt;

use calib_core::camera::{Camera, CameraError, Distortion, Projection};
use serde::{Deserialize, Serialize};

/// A camera's lens and columns.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Lens {
    /// Columns of a frame: 88 (CMUcam2 with OV6620), 176 (the same in high resolution), 160
    /// (OV7620).
    pub columns: u16,
    /// Angle from the middle of the first column to that of the last one, degrees, above 0; below
    /// 180 for a pin-hole, at most 360 for equal angles. The CMUcam2's is 44 to 50, by lens.
    pub field_of_view_deg: f32,
    /// Spread of directions over the columns.
    pub projection: Projection,
    /// Column of the optical axis, 0 to `columns - 1`; `None`: in the middle.
    pub principal_column: Option<f32>,
    /// k1 and k2 of its radial [`Distortion`]; 0 of a lens that has none.
    // Behind all else in a page, where older ones have nothing.
    #[serde(skip)]
    pub distortion: [f32; 2],
}

impl Lens {
    /// A pin-hole with the optical axis in the middle.
    pub const fn pin_hole(columns: u16, field_of_view_deg: f32) -> Self {
        Self {
            columns,
            field_of_view_deg,
            projection: Projection::PinHole,
            principal_column: None,
            distortion: [0.0; 2],
        }
    }

    /// The camera of this lens.
    ///
    /// # Errors
    /// [`LensError`].
    pub fn camera(&self) -> Result<Camera<f32>, LensError> {
        let view = self.field_of_view_deg.to_radians();
        let camera = Camera::new(self.projection, self.columns, view).map_err(LensError::Camera)?;
        let camera = match self.principal_column {
            None => Ok(camera),
            Some(column) if !camera.has_column(column) => return Err(LensError::PrincipalColumn),
            Some(column) => camera.with_principal_point(column),
        };
        let [k1, k2] = self.distortion;
        camera
            .and_then(|camera| camera.with_distortion(Distortion { k1, k2 }))
            .map_err(LensError::Camera)
    }
}

/// Reason why there is no such lens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum LensError {
    /// Columns or field of view.
    Camera(CameraError),
    /// The optical axis is not within the columns.
    PrincipalColumn,
}

impl fmt::Display for LensError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Camera(error) => error.fmt(f),
            Self::PrincipalColumn => {
                f.write_str("the principal column must be one of the lens's columns, 0 to W-1")
            }
        }
    }
}

impl core::error::Error for LensError {}

#[cfg(test)]
mod tests {
    use super::*;

    /// Thesis Appendix B: blob 67 is seen at -17.3228 degrees, blob 38 at 4.17509.
    #[test]
    fn the_thesis_camera() {
        let camera = Lens::pin_hole(88, 60.0).camera().unwrap();
        assert!((camera.bearing(67.0).to_degrees() - -17.3228).abs() < 1e-4);
        assert!((camera.bearing(38.0).to_degrees() - 4.17509).abs() < 1e-4);
    }

    #[test]
    fn the_axis_may_be_elsewhere_but_in_the_frame() {
        let mut lens = Lens::pin_hole(88, 60.0);
        lens.principal_column = Some(40.0);
        assert_eq!(lens.camera().unwrap().bearing(40.0), 0.0);
        for outside in [-0.5, 87.5, f32::NAN, f32::INFINITY] {
            lens.principal_column = Some(outside);
            assert_eq!(lens.camera(), Err(LensError::PrincipalColumn));
        }
    }

    #[test]
    fn impossible_lenses() {
        for (columns, view, error) in [
            (1, 60.0, CameraError::Columns),
            (88, 0.0, CameraError::FieldOfView),
            (88, 180.0, CameraError::FieldOfView),
            (88, f32::NAN, CameraError::FieldOfView),
        ] {
            let lens = Lens::pin_hole(columns, view);
            assert_eq!(lens.camera(), Err(LensError::Camera(error)));
        }
        let wide = Lens {
            projection: Projection::EqualAngle,
            ..Lens::pin_hole(360, 359.0)
        };
        assert!(wide.camera().is_ok());
    }
}
