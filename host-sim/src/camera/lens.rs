//! Directions to places in the picture: a pin-hole.

use super::scene::Extent;

/// Pixels are twice as wide as they are tall.
const PIXEL_ASPECT: f64 = 2.0;

/// A pin-hole camera of square directions: its field of view, and its columns and rows in low
/// resolution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    columns: f64,
    rows: f64,
    /// Columns for a tangent of 1.
    focal: f64,
}

/// Where a camera stands and looks, level.
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
    /// A lens with this field of view from the middle of the first column to that of the last one,
    /// radians, as [`calib_core::camera::Camera::pin_hole`] has it.
    ///
    /// `None` unless the field of view is between 0 and pi.
    pub fn new(field_of_view: f64, columns: u8, rows: u8) -> Option<Self> {
        let (columns, rows) = (f64::from(columns), f64::from(rows));
        let focal = (columns - 1.0) / 2.0 / (field_of_view / 2.0).tan();
        let sensible = field_of_view > 0.0 && field_of_view < std::f64::consts::PI;
        (sensible && focal > 0.0).then_some(Self {
            columns,
            rows,
            focal,
        })
    }

    /// How far to the right of the middle a tangent to the left is, in fractions of the width.
    fn right(&self, tangent: f64) -> f64 {
        0.5 - tangent * self.focal / self.columns
    }

    fn down(&self, tangent: f64) -> f64 {
        0.5 - tangent * self.focal * PIXEL_ASPECT / self.rows
    }

    /// What fills this width and height around a direction, radians. `None` if any of it is not
    /// before the camera.
    pub fn extent(&self, bearing: f64, elevation: f64, width: f64, height: f64) -> Option<Extent> {
        const QUARTER: f64 = std::f64::consts::FRAC_PI_2;
        let (left, right) = (bearing + width / 2.0, bearing - width / 2.0);
        let (top, bottom) = (elevation + height / 2.0, elevation - height / 2.0);
        let visible = [left, right, top, bottom]
            .iter()
            .all(|angle| angle.abs() < QUARTER);
        visible.then(|| Extent {
            left: self.right(left.tan()),
            right: self.right(right.tan()),
            top: self.down(top.tan()),
            bottom: self.down(bottom.tan()),
        })
    }

    /// Where a ball is seen. Its outline is taken as that of a disc that faces the image plane,
    /// which is exact in the middle of the picture. `None` unless all of it is before the camera.
    pub fn extent_of_ball(&self, pose: &Pose, centre: [f64; 3], radius: f64) -> Option<Extent> {
        let (sin, cos) = pose.heading.sin_cos();
        let (dx, dy) = (centre[0] - pose.x, centre[1] - pose.y);
        let forward = dx * cos + dy * sin;
        let left = dy * cos - dx * sin;
        let up = centre[2] - pose.height;
        (forward > radius).then(|| Extent {
            left: self.right((left + radius) / forward),
            right: self.right((left - radius) / forward),
            top: self.down((up + radius) / forward),
            bottom: self.down((up - radius) / forward),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::camera::Camera;

    /// The column that the library has for a bearing is where the picture shows it.
    #[test]
    fn the_projection_is_that_of_the_library() {
        let lens = Lens::new(0.8, 88, 143).unwrap();
        let camera = Camera::pin_hole(88, 0.8_f64).unwrap();
        for column in [0.0, 20.0, 43.5, 60.25, 87.0] {
            let extent = lens.extent(camera.bearing(column), 0.0, 0.0, 0.0).unwrap();
            assert!((extent.left * 88.0 - 0.5 - column).abs() < 1e-9);
            assert!((extent.top - 0.5).abs() < 1e-12);
        }
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
