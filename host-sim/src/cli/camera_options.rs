//! The camera that recorded pixel columns are of.

use anyhow::ensure;
use calib_core::{
    Real,
    camera::{Camera, CameraError, Distortion, Projection},
};
use clap::{Args, ValueEnum};

use super::values;

/// Columns of a CMUcam2 in normal resolution.
pub(super) const USUAL_COLUMNS: u16 = 88;

/// Heading for commands that read a file of columns or bearings.
pub(super) const FOR_COLUMNS: &str = "Camera, for pixel columns instead of bearings";

#[derive(Args)]
pub(super) struct CameraOptions {
    /// Field of view in degrees, from the centre of the first column to that of the last one.
    ///
    /// There is no default: a wrong field of view makes every pose wrong. `solve` tells one from four
    /// sightings of a case on.
    #[arg(long, value_name = "DEGREES", value_parser = values::positive)]
    fov_deg: Option<f64>,
    /// Number of columns of the camera [default: 88, or those of a live camera, which has no others].
    #[arg(long, value_name = "N", requires = "fov_deg", value_parser = values::whole(0, u16::MAX))]
    columns: Option<u16>,
    /// Projection of the lens: how it spreads directions over the columns.
    #[arg(long, value_enum, default_value_t, requires = "fov_deg")]
    projection: ProjectionOption,
    /// The column of the optical axis, counted from 0 [default: the middle].
    #[arg(long, value_name = "COLUMN", value_parser = values::finite, requires = "fov_deg")]
    principal: Option<f64>,
    /// Radial distortion of the lens, k1 and k2, as calibration tools print them [default: none].
    #[arg(
        long, value_names = ["K1", "K2"], num_args = 2, allow_negative_numbers = true, value_parser = values::finite,
        requires = "fov_deg"
    )]
    distortion: Option<Vec<f64>>,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum ProjectionOption {
    /// Equal steps of the tangent: ordinary lenses, the CMUcam2.
    #[default]
    #[value(alias = "pin-hole")]
    Pinhole,
    /// Equal steps of the angle: scanning sensors, the blob finder of the Stage simulator.
    EqualAngle,
}

impl CameraOptions {
    /// Number of columns, if it was given.
    pub(super) fn columns(&self) -> Option<u16> {
        self.columns
    }

    /// The field of view, radians, if a camera was described.
    pub(super) fn field_of_view(&self) -> Option<f64> {
        self.fov_deg.map(f64::to_radians)
    }

    /// The camera, if one was described, with the usual number of columns if none was given.
    pub(super) fn camera<T: Real>(
        &self,
        usual_columns: u16,
    ) -> Result<Option<Camera<T>>, CameraError> {
        let real = nalgebra::convert::<f64, T>;
        let Some(field_of_view) = self.fov_deg else {
            return Ok(None);
        };
        let projection = match self.projection {
            ProjectionOption::Pinhole => Projection::PinHole,
            ProjectionOption::EqualAngle => Projection::EqualAngle,
        };
        let camera = Camera::new(
            projection,
            self.columns.unwrap_or(usual_columns),
            real(field_of_view.to_radians()),
        )?;
        let camera = match self.principal {
            Some(column) => camera.with_principal_point(real(column))?,
            None => camera,
        };
        match self.distortion.as_deref() {
            Some(&[k1, k2]) => {
                let [k1, k2] = [k1, k2].map(real);
                camera.with_distortion(Distortion { k1, k2 })
            }
            _ => Ok(camera),
        }
        .map(Some)
    }

    /// The same for a camera that is there and has so many columns.
    ///
    /// # Errors
    /// Another number was given, or there is no such camera.
    pub(super) fn of_live<T: Real>(&self, columns: u16) -> anyhow::Result<Option<Camera<T>>> {
        let given = self.columns.unwrap_or(columns);
        ensure!(
            given == columns,
            "--columns {given}: this camera has {columns} columns, so leave --columns out"
        );
        Ok(self.camera(columns)?)
    }
}
