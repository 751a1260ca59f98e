//! Outlines and what hides them.

use calib_core::camera::Projection;
use nalgebra::{Point2, Vector2};

use super::{Camera, Mount, World, half_width, obstacle::Shadow};
use cmucam2_emulator::{Extent, Object, Place, Rgb, Shape};

/// Sight that a camera has of one ball.
#[derive(Clone, Debug, PartialEq)]
pub struct Sight {
    /// Distance of its middle.
    pub distance: f64,
    /// Bearing of its middle in the camera's own horizontal plane, radians, positive to the left of the axis.
    pub bearing: f64,
    /// Half the angle under which all of it is seen there, radians.
    pub half_width: f64,
    /// Its upper and lower edge are in the picture.
    pub is_high_enough: bool,
    /// The bearings of the parts that are in the picture and not hidden, each from right to left, ascending. Of a
    /// ray scan: of the columns that hit, which seldom reach both edges of the ball.
    pub visible: Vec<[f64; 2]>,
}

impl Sight {
    /// Returns true if all of it is in the picture and nothing hides any of its width.
    pub fn is_whole(&self) -> bool {
        let [right, left] = [
            self.bearing - self.half_width,
            self.bearing + self.half_width,
        ];
        self.is_high_enough && matches!(self.visible[..], [[a, b]] if a <= right && b >= left)
    }

    /// Share of its width that is in the picture and not hidden, 0 to 1.
    pub fn visible_share(&self) -> f64 {
        let seen: f64 = self.visible.iter().map(|[right, left]| left - right).sum();
        (seen / (2.0 * self.half_width)).min(1.0)
    }
}

/// View of a camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct View {
    /// Number of a target and its sight, the farthest first.
    pub sights: Vec<(usize, Sight)>,
    /// From back to front.
    pub(super) patches: Vec<Patch>,
}

/// A part of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// The target that is seen there.
    pub target: Option<usize>,
    /// Its colour. `None`: the thing that hides a target here looks like the backdrop.
    pub colour: Option<Rgb>,
    /// Its outline.
    pub shape: Shape,
    /// Its place.
    pub extent: Extent,
}

impl View {
    /// Sight of a target.
    pub fn of(&self, target: usize) -> Option<&Sight> {
        let found = self.sights.iter().find(|(index, _)| *index == target);
        found.map(|(_, sight)| sight)
    }

    /// Where it is in the picture, from back to front.
    pub fn patches(&self) -> &[Patch] {
        &self.patches
    }

    /// Gives targets that wear tags the outline of these, in a scene into which this view was put: `worn` tells the
    /// number of a target's tag.
    pub fn tag(&self, worn: impl Fn(usize) -> Option<u16>, objects: &mut [Object]) {
        for (patch, object) in self.patches.iter().zip(objects) {
            if let Some(number) = patch.target.and_then(&worn) {
                object.shape = Shape::Tag(number);
            }
        }
    }

    /// Puts it into a scene, in place of all objects there. Obstacles have the colour of the
    /// `backdrop`: they are in the picture before a target comes, as is all else that is not one.
    pub fn paint(&self, backdrop: Rgb, objects: &mut Vec<Object>) {
        objects.clear();
        objects.extend(self.patches.iter().map(|patch| Object {
            colour: patch.colour.unwrap_or(backdrop),
            shape: patch.shape,
            place: Place::At(patch.extent),
        }));
    }
}

/// The targets `near` as they are.
pub(super) fn look(world: &World, camera: &Camera, near: &[usize]) -> View {
    let mut balls: Vec<_> = near
        .iter()
        .filter_map(|&index| {
            let target = &world.targets[index];
            let ball = Ball::new(camera, target.place, target.above, target.radius)?;
            Some((index, ball))
        })
        .collect();
    balls.sort_by(|(_, a), (_, b)| b.distance.total_cmp(&a.distance));
    let mut view = View::default();
    for (n, (index, ball)) in balls.iter().enumerate() {
        let mut shadows = ball.shadows(world, camera);
        let lens = &camera.lens;
        let outline = |right: f64, left: f64| {
            let bearing = ball.bearing + f64::midpoint(right, left);
            lens.outline(
                bearing,
                ball.elevation,
                (left - right) / 2.0,
                ball.half_height,
            )
        };
        let extent = lens.outline(
            ball.bearing,
            ball.elevation,
            ball.half_width,
            ball.half_height,
        );
        view.patches.push(Patch {
            target: Some(*index),
            colour: Some(world.targets[*index].colour),
            shape: Shape::Disc,
            extent,
        });
        // Before the ball, but behind the nearer balls that come later.
        for [right, left] in &shadows {
            let cover = Extent {
                top: 0.0,
                bottom: 1.0,
                ..outline(right.max(-ball.half_width), left.min(ball.half_width))
            };
            if cover.left < cover.right {
                view.patches.push(Patch {
                    target: None,
                    colour: None,
                    shape: Shape::Box,
                    extent: cover,
                });
            }
        }
        for (_, nearer) in &balls[n + 1..] {
            let off = wrapped(nearer.bearing - ball.bearing);
            shadows.push([off - nearer.half_width, off + nearer.half_width]);
        }
        if let Some(sight) = ball.seen(camera, shadows) {
            view.sights.push((*index, sight));
        }
    }
    view
}

/// A ball alone.
pub(super) fn sight(
    world: &World,
    camera: &Camera,
    place: Point2<f64>,
    radius: f64,
) -> Option<Sight> {
    let ball = Ball::new(camera, place, 0.0, radius)?;
    ball.seen(camera, ball.shadows(world, camera))
}

struct Ball {
    place: Point2<f64>,
    /// On the floor.
    distance: f64,
    above: f64,
    radius: f64,
    /// Direction on the floor, radians left of the camera's heading.
    azimuth: f64,
    bearing: f64,
    half_width: f64,
    /// Angle of its row off the middle one.
    elevation: f64,
    half_height: f64,
}

impl Ball {
    /// `None` out of range or beside the picture.
    fn new(camera: &Camera, place: Point2<f64>, above: f64, radius: f64) -> Option<Self> {
        let to = place - camera.place;
        let distance = to.norm();
        let azimuth = wrapped(to.y.atan2(to.x) - camera.heading);
        let seen = camera.mount.seen(azimuth, distance, above);
        let (elevation, of_rows) = match camera.lens.projection() {
            Projection::PinHole => (seen.z.atan2(seen.x), seen.xz().norm()),
            Projection::EqualAngle => (seen.z.atan2(seen.xy().norm()), seen.norm()),
        };
        let ball = Self {
            place,
            distance,
            above,
            radius,
            azimuth,
            bearing: seen.y.atan2(seen.x),
            half_width: half_width(seen.xy().norm(), radius),
            elevation,
            half_height: half_width(of_rows, radius),
        };
        let in_view = distance <= camera.range
            && ball.bearing.abs() - ball.half_width < camera.lens.half_view_at(ball.elevation)
            && ball.elevation.abs() - ball.half_height < camera.lens.half_height_at(ball.bearing);
        in_view.then_some(ball)
    }

    /// Shadows of obstacles, relative to the bearing.
    fn shadows(&self, world: &World, camera: &Camera) -> Vec<Shadow> {
        let mut shadows = Vec::new();
        let ahead: Vector2<f64> = (self.place - camera.place) / self.distance;
        let half_angle = half_width(self.distance, self.radius);
        for index in world.obstacles_near(camera.place, self.place, self.radius) {
            world.obstacles[index].shadows(
                camera.place,
                ahead,
                self.distance,
                half_angle,
                &mut shadows,
            );
        }
        if camera.mount == Mount::LEVEL {
            return shadows;
        }
        // Their edges pass through the ball's plane where the ball is.
        let in_picture = |side: f64| {
            let seen = camera
                .mount
                .seen(self.azimuth + side, self.distance, self.above);
            wrapped(seen.y.atan2(seen.x) - self.bearing)
        };
        let turned = shadows.into_iter().map(|shadow| {
            let [a, b] = shadow.map(in_picture);
            [a.min(b), a.max(b)]
        });
        turned.collect()
    }

    fn seen(&self, camera: &Camera, shadows: Vec<Shadow>) -> Option<Sight> {
        let border = camera.lens.half_view_at(self.elevation);
        let whole = [
            (self.bearing - self.half_width).max(-border),
            (self.bearing + self.half_width).min(border),
        ];
        let shadows = shadows
            .into_iter()
            .map(|shadow| shadow.map(|side| side + self.bearing))
            .collect();
        let visible = without(whole, shadows);
        (!visible.is_empty()).then_some(Sight {
            distance: self.distance,
            bearing: self.bearing,
            half_width: self.half_width,
            is_high_enough: self.elevation.abs() + self.half_height
                <= camera.lens.half_height_at(self.bearing),
            visible,
        })
    }
}

/// Parts of an interval that are left when shadows are taken away.
fn without([mut from, to]: [f64; 2], mut shadows: Vec<Shadow>) -> Vec<[f64; 2]> {
    shadows.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut left = Vec::new();
    for [begin, end] in shadows {
        if begin >= to {
            break;
        }
        if begin > from {
            left.push([from, begin]);
        }
        from = from.max(end);
    }
    if from < to {
        left.push([from, to]);
    }
    left
}

pub(super) fn wrapped(angle: f64) -> f64 {
    calib_core::angle::wrap_signed(angle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shadows_are_taken_away() {
        let rest = |shadows: &[Shadow]| without([0.0, 1.0], shadows.to_vec());
        assert_eq!(rest(&[]), [[0.0, 1.0]]);
        assert_eq!(rest(&[[0.4, 0.5], [0.45, 0.6]]), [[0.0, 0.4], [0.6, 1.0]]);
        assert_eq!(rest(&[[-1.0, 0.2], [0.9, 3.0]]), [[0.2, 0.9]]);
        assert!(rest(&[[-1.0, 0.7], [0.6, 3.0]]).is_empty());
        assert_eq!(rest(&[[0.2, 0.8], [0.3, 0.4]]), [[0.0, 0.2], [0.8, 1.0]]);
    }
}
