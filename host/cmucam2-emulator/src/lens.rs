//! Directions to places in the picture.

use std::f64::consts::{FRAC_PI_2, PI};

use calib_core::camera::Projection;

use super::scene::Extent;

/// A CMUcam2's pixels are twice as wide as they are tall.
pub(super) const PIXEL_ASPECT: f64 = 2.0;

/// Lens of a camera of square directions: projection, field of view, distortion, and columns and rows of its picture in low
/// resolution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    projection: Projection,
    columns: f64,
    rows: f64,
    /// Columns for a tangent of 1 (pin-hole) or for one radian (equal angles), on the axis.
    focal: f64,
    /// Number of rows that are as much as a column.
    aspect: f64,
    /// k1 and k2: a tangent or angle `q` is seen `q (1 + k1 q^2 + k2 q^4)` focal lengths from the middle.
    distortion: [f64; 2],
    /// The tangent or angle at which the distortion would begin to fold the picture back.
    rim: f64,
}

/// Slope of the picture at the rim of a lens, and beyond it.
const RIM_SLOPE: f64 = 0.05;
/// Halvings by which a direction is found.
const HALVINGS: usize = 60;
/// A tangent that no picture reaches.
const FAR: f64 = 1e6;

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
            distortion: [0.0; 2],
            rim: f64::INFINITY,
        })
    }

    /// The same field of view with this radial distortion, k1 and k2. `None` if it would fold the picture back at its
    /// left and right border.
    #[must_use]
    pub fn with_distortion(self, [k1, k2]: [f64; 2]) -> Option<Self> {
        let border = (self.columns - 1.0) / 2.0 / self.focal;
        // Zeros of the slope less that of the rim, in squares.
        let [a, b, c] = [5.0 * k2, 3.0 * k1, 1.0 - RIM_SLOPE];
        let roots = if a == 0.0 {
            [-c / b, f64::NAN]
        } else {
            let root = (b * b - 4.0 * a * c).sqrt();
            [(-b - root) / (2.0 * a), (-b + root) / (2.0 * a)]
        };
        let rims = roots.into_iter().filter(|square| *square > 0.0);
        let rim = rims.fold(f64::INFINITY, f64::min).sqrt();
        let shown = border * (1.0 + border * border * (k1 + border * border * k2));
        (self.distortion == [0.0; 2] && rim > border && shown > 0.0).then_some(Self {
            focal: (self.columns - 1.0) / 2.0 / shown,
            distortion: [k1, k2],
            rim,
            ..self
        })
    }

    /// Distance of a tangent or angle from the middle of the picture, focal lengths.
    fn shown(&self, q: f64) -> f64 {
        let [k1, k2] = self.distortion;
        let within = q.clamp(-self.rim, self.rim);
        let square = within * within;
        within * (1.0 + square * (k1 + square * k2)) + (q - within) * RIM_SLOPE
    }

    /// Distortion is none, and a column is one bearing in all rows.
    fn is_plain(&self) -> bool {
        self.projection == Projection::PinHole && self.distortion == [0.0; 2]
    }

    /// Columns' widths to the left of the middle and above it of a point, in tangents or angles.
    fn shown_at(&self, x: f64, y: f64) -> [f64; 2] {
        let radius = x.hypot(y);
        let scale = if self.distortion == [0.0; 2] || radius == 0.0 {
            self.focal
        } else {
            self.focal * self.shown(radius) / radius
        };
        [x, y].map(|part| part * scale)
    }

    /// Place of a bearing and an elevation in fractions of the width and height. To a pin-hole, the elevation is the
    /// angle of the row above the middle one, to other lenses that above the camera's horizontal plane.
    pub fn place(&self, bearing: f64, elevation: f64) -> [f64; 2] {
        let [left, up] = match self.projection {
            Projection::PinHole => self.shown_at(bearing.tan(), elevation.tan()),
            Projection::EqualAngle => {
                let (up, level) = elevation.sin_cos();
                let [ahead, left] = [level * bearing.cos(), level * bearing.sin()];
                let aside = left.hypot(up);
                let angle = aside.atan2(ahead);
                let share = if aside > 0.0 { angle / aside } else { 1.0 };
                self.shown_at(left * share, up * share)
            }
        };
        [self.right(left), self.below(up)]
    }

    /// Outline of an object of half this width and height around a direction.
    pub fn outline(
        &self,
        bearing: f64,
        elevation: f64,
        half_width: f64,
        half_height: f64,
    ) -> Extent {
        let limit = self.limit() - 1e-6;
        let place = |bearing: f64, elevation: f64| {
            self.place(bearing.clamp(-limit, limit), elevation.clamp(-limit, limit))
        };
        let [left, _] = place(bearing + half_width, elevation);
        let [right, _] = place(bearing - half_width, elevation);
        let [_, top] = place(bearing, elevation + half_height);
        let [_, bottom] = place(bearing, elevation - half_height);
        Extent {
            left,
            right,
            top,
            bottom,
        }
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

    /// The same at an elevation, which is that of [`Lens::place`].
    pub fn half_view_at(&self, elevation: f64) -> f64 {
        if self.is_plain() || elevation == 0.0 {
            return self.half_view();
        }
        self.border(|bearing| self.place(bearing, elevation)[0])
    }

    /// The same in height, at a bearing: from the axis to its upper border.
    pub fn half_height_at(&self, bearing: f64) -> f64 {
        if self.is_plain() {
            return self.angle(self.rows / 2.0 / self.aspect);
        }
        self.border(|elevation| self.place(bearing, elevation)[1])
    }

    /// The angle at which a place that falls with it gets to 0.
    fn border(&self, place: impl Fn(f64) -> f64) -> f64 {
        let half_turn = self.limit().min(FRAC_PI_2) - 1e-6;
        zero(half_turn, place)
    }

    /// Distance from the middle of the picture of an angle off the axis, columns.
    fn off(&self, angle: f64) -> f64 {
        let q = match self.projection {
            Projection::PinHole => angle.tan(),
            Projection::EqualAngle => angle,
        };
        self.focal * self.shown(q)
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
        let mut off = off / self.focal;
        if self.distortion != [0.0; 2] {
            off = off.signum() * zero(self.rim.min(FAR), |q| off.abs() - self.shown(q));
        }
        match self.projection {
            Projection::PinHole => off.atan(),
            Projection::EqualAngle => off,
        }
    }

    /// Place of an elevation straight above the middle, in fractions of the height.
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
        visible.then(|| self.outline(bearing, elevation, width / 2.0, height / 2.0))
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
                let place = |left: f64, up: f64| {
                    let [left, up] = self.shown_at(left / forward, up / forward);
                    [self.right(left), self.below(up)]
                };
                (forward > radius).then(|| Extent {
                    left: place(left + radius, up)[0],
                    right: place(left - radius, up)[0],
                    top: place(left, up + radius)[1],
                    bottom: place(left, up - radius)[1],
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

/// Where a function that falls from above 0 gets to 0; `most` where it does not before.
fn zero(most: f64, of: impl Fn(f64) -> f64) -> f64 {
    let (mut from, mut to) = (0.0, most);
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(from, to);
        if of(middle) > 0.0 {
            from = middle;
        } else {
            to = middle;
        }
    }
    to
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::camera::{Camera, Distortion};

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

    /// Bearings and elevations that the library has for the places of a picture are those that were put there, off the
    /// axis too: two formulas, one the inverse of the other.
    #[test]
    fn distorted_pictures_are_those_of_the_library() {
        for (projection, [k1, k2]) in [
            (Projection::PinHole, [-0.3, 0.08]),
            (Projection::PinHole, [0.1, 0.0]),
            (Projection::EqualAngle, [0.0, 0.0]),
            (Projection::EqualAngle, [-0.05, 0.01]),
        ] {
            let view = 1.2;
            let lens = Lens::with_projection(projection, view, 88, 143).unwrap();
            let lens = lens.with_distortion([k1, k2]).unwrap();
            let camera = Camera::new(projection, 88, view).unwrap();
            let camera = camera.with_distortion(Distortion { k1, k2 }).unwrap();
            assert!((lens.half_view() - camera.bearing(-0.5)).abs() < 1e-9);
            for (bearing, elevation) in [(0.5, 0.3), (-0.4, -0.3), (0.55, 0.0), (0.0, 0.25)] {
                // The angle of a pin-hole's row.
                let row: f64 = match projection {
                    Projection::PinHole => (f64::tan(elevation) / f64::cos(bearing)).atan(),
                    Projection::EqualAngle => elevation,
                };
                let [across, down] = lens.place(bearing, row);
                let (column, above) = (across * 88.0 - 0.5, (0.5 - down) * 143.0 / 2.0);
                assert!((camera.bearing_above(column, above) - bearing).abs() < 1e-9);
                let found = camera.elevation(bearing, column, [above; 2]);
                assert!((found - elevation).abs() < 1e-9, "{found} {elevation}");
            }
            // What is at the border of a row is in its first half column, and no farther.
            let border = lens.half_view_at(0.3);
            assert!(lens.place(border, 0.3)[0].abs() < 1e-9);
            let border = lens.half_height_at(0.3);
            assert!(lens.place(0.3, border)[1].abs() < 1e-9);
        }
        let wide = Lens::new(2.0, 88, 143).unwrap();
        assert_eq!(wide.with_distortion([-0.5, 0.0]), None);
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
