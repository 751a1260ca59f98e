//! Directions to places in the picture.

use std::f64::consts::{FRAC_PI_2, PI};

use calib_core::camera::Projection;

use super::scene::Extent;

/// A CMUcam2's pixels are twice as wide as they are tall.
pub(super) const PIXEL_ASPECT: f64 = 2.0;

/// Lens of a camera of square directions: projection, field of view, and columns and rows of its picture in low
/// resolution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    projection: Projection,
    columns: f64,
    rows: f64,
    /// Columns for a tangent of 1 (pin-hole) or for one radian (equal angles).
    focal: f64,
    /// Number of rows that are as much as a column.
    aspect: f64,
}

/// Place and direction of a camera, level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Place.
    pub x: f64,
    /// Place.
    pub y: f64,
    /// Height of the lens above the ground.
    pub height: f64,
    /// Direction of the optical axis, radians from the x axis towards the y axis.
    pub heading: f64,
}

impl Lens {
    /// A pin-hole with this field of view from the middle of the first column to that of the last
    /// one, radians, as [`calib_core::camera::Camera::pin_hole`] has it.
    ///
    /// `None` unless the field of view is between 0 and pi.
    pub fn new(field_of_view: f64, columns: u8, rows: u8) -> Option<Self> {
        Self::with_projection(Projection::PinHole, field_of_view, columns, rows)
    }

    /// [`Lens::new`] with any projection. Equal angles may span up to `2 pi`.
    pub fn with_projection(
        projection: Projection,
        field_of_view: f64,
        columns: u8,
        rows: u8,
    ) -> Option<Self> {
        let frame = [columns, rows].map(u16::from);
        Self::of_frame(projection, field_of_view, frame, PIXEL_ASPECT)
    }

    /// The lens of another camera: columns and rows of its frame, and the number of rows that are as much as a
    /// column.
    pub fn of_frame(
        projection: Projection,
        field_of_view: f64,
        frame: [u16; 2],
        aspect: f64,
    ) -> Option<Self> {
        let [columns, rows] = frame.map(f64::from);
        let half_view = field_of_view / 2.0;
        let (half_width, possible) = match projection {
            Projection::PinHole => (half_view.tan(), half_view < FRAC_PI_2),
            Projection::EqualAngle => (half_view, half_view <= PI),
        };
        let focal = (columns - 1.0) / 2.0 / half_width;
        (possible && half_view > 0.0 && focal > 0.0).then_some(Self {
            projection,
            columns,
            rows,
            focal,
            aspect,
        })
    }

    /// Columns of the picture.
    pub fn columns(&self) -> f64 {
        self.columns
    }

    /// Returns the projection.
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// Directions beyond this many radians off the axis are not projected.
    pub fn limit(&self) -> f64 {
        match self.projection {
            Projection::PinHole => FRAC_PI_2,
            Projection::EqualAngle => PI,
        }
    }

    /// Half of what is in the picture, radians: from the axis to its border, half a column beyond
    /// the middle of the last one.
    pub fn half_view(&self) -> f64 {
        self.bearing(-0.5)
    }

    /// The same in height: from the axis to its upper border.
    pub fn half_height(&self) -> f64 {
        self.angle(self.rows / 2.0 / self.aspect)
    }

    /// Distance from the middle of the picture of an angle off the axis, columns.
    fn off(&self, angle: f64) -> f64 {
        self.focal
            * match self.projection {
                Projection::PinHole => angle.tan(),
                Projection::EqualAngle => angle,
            }
    }

    /// The column of a bearing, from 0 at the middle of the first one.
    pub fn column(&self, bearing: f64) -> f64 {
        (self.columns - 1.0) / 2.0 - self.off(bearing)
    }

    /// The bearing of a column, from 0 at the middle of the first one; radians.
    pub fn bearing(&self, column: f64) -> f64 {
        self.angle((self.columns - 1.0) / 2.0 - column)
    }

    /// Angle off the axis of a distance from the middle of the picture, columns.
    fn angle(&self, off: f64) -> f64 {
        let off = off / self.focal;
        match self.projection {
            Projection::PinHole => off.atan(),
            Projection::EqualAngle => off,
        }
    }

    /// Place of a bearing, in fractions of the width.
    pub fn across(&self, bearing: f64) -> f64 {
        self.right(self.off(bearing))
    }

    /// Place of an elevation, in fractions of the height.
    pub fn down(&self, elevation: f64) -> f64 {
        self.below(self.off(elevation))
    }

    /// So many columns to the left of the middle, in fractions of the width.
    fn right(&self, left: f64) -> f64 {
        0.5 - left / self.columns
    }

    /// Place so many columns' widths above the middle, in fractions of the height.
    fn below(&self, up: f64) -> f64 {
        0.5 - up * self.aspect / self.rows
    }

    /// Extent of an object of this width and height around a direction, radians. `None` if any of it is not before
    /// the camera.
    pub fn extent(&self, bearing: f64, elevation: f64, width: f64, height: f64) -> Option<Extent> {
        let (left, right) = (bearing + width / 2.0, bearing - width / 2.0);
        let (top, bottom) = (elevation + height / 2.0, elevation - height / 2.0);
        let visible = [left, right, top, bottom]
            .iter()
            .all(|angle| angle.abs() < self.limit());
        visible.then(|| Extent {
            left: self.across(left),
            right: self.across(right),
            top: self.down(top),
            bottom: self.down(bottom),
        })
    }

    /// Extent of a ball as it is seen. `None` unless all of it is before the camera.
    ///
    /// A pin-hole's outline is taken as that of a disc that faces the image plane, which is exact in
    /// the middle of the picture.
    pub fn extent_of_ball(&self, pose: &Pose, centre: [f64; 3], radius: f64) -> Option<Extent> {
        let (sin, cos) = pose.heading.sin_cos();
        let (dx, dy) = (centre[0] - pose.x, centre[1] - pose.y);
        let forward = dx * cos + dy * sin;
        let left = dy * cos - dx * sin;
        let up = centre[2] - pose.height;
        match self.projection {
            Projection::PinHole => {
                let across = |left: f64| self.right(self.focal * left / forward);
                let down = |up: f64| self.below(self.focal * up / forward);
                (forward > radius).then(|| Extent {
                    left: across(left + radius),
                    right: across(left - radius),
                    top: down(up + radius),
                    bottom: down(up - radius),
                })
            }
            Projection::EqualAngle => {
                let ground = left.hypot(forward);
                let size = 2.0 * (radius / ground.hypot(up)).asin();
                self.extent(left.atan2(forward), up.atan2(ground), size, size)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::camera::Camera;

    /// The column that the library has for a bearing is where the picture shows it.
    #[test]
    fn the_projection_is_that_of_the_library() {
        for projection in [Projection::PinHole, Projection::EqualAngle] {
            let lens = Lens::with_projection(projection, 0.8, 88, 143).unwrap();
            let camera = Camera::new(projection, 88, 0.8_f64).unwrap();
            for column in [0.0, 20.0, 43.5, 60.25, 87.0] {
                let extent = lens.extent(camera.bearing(column), 0.0, 0.0, 0.0).unwrap();
                assert!((extent.left * 88.0 - 0.5 - column).abs() < 1e-9);
                assert!((extent.top - 0.5).abs() < 1e-12);
            }
            assert!((camera.bearing(-0.5) - lens.half_view()).abs() < 1e-12);
        }
    }

    /// Seen all around, a ball behind is at the border; a ball on the axis is as round as before.
    #[test]
    fn equal_angles_reach_around() {
        let lens = Lens::with_projection(Projection::EqualAngle, 2.0 * PI, 88, 143).unwrap();
        let pose = Pose {
            x: 0.0,
            y: 0.0,
            height: 0.0,
            heading: 0.0,
        };
        let ball = lens.extent_of_ball(&pose, [-2.0, 0.5, 0.0], 0.1).unwrap();
        assert!(ball.right < 0.1, "{ball:?}");
        let ball = lens.extent_of_ball(&pose, [2.0, 0.0, 0.0], 0.1).unwrap();
        let width = 2.0 * (0.1_f64 / 2.0).asin();
        assert!((ball.right - ball.left - width * 87.0 / (2.0 * PI) / 88.0).abs() < 1e-12);
    }

    #[test]
    fn a_ball_in_the_world_is_where_its_bearing_says() {
        let lens = Lens::new(0.8, 88, 143).unwrap();
        let pose = Pose {
            x: 1.0,
            y: 2.0,
            height: 0.5,
            heading: 0.6,
        };
        let bearing = 0.2_f64;
        let direction = pose.heading + bearing;
        let ball = [
            1.0 + 3.0 * direction.cos(),
            2.0 + 3.0 * direction.sin(),
            0.5,
        ];
        let extent = lens.extent_of_ball(&pose, ball, 0.1).unwrap();
        let seen = lens.extent(bearing, 0.0, 0.0, 0.0).unwrap();
        let middle = f64::midpoint(extent.left, extent.right);
        assert!((middle - seen.left).abs() < 1e-12);
        // As wide as tall, on pixels twice as wide as tall.
        let (columns, rows) = (
            (extent.right - extent.left) * 88.0,
            (extent.bottom - extent.top) * 143.0,
        );
        assert!((rows / columns - 2.0).abs() < 1e-9);
        let behind = [1.0 - pose.heading.cos(), 2.0 - pose.heading.sin(), 0.5];
        assert_eq!(lens.extent_of_ball(&pose, behind, 0.1), None);
    }

    #[test]
    fn no_lens_without_a_field_of_view() {
        for wrong in [0.0, -1.0, std::f64::consts::PI, f64::NAN] {
            assert_eq!(Lens::new(wrong, 88, 143), None);
        }
    }
}
