//! Outlines and what hides them.

use calib_core::camera::Projection;
use nalgebra::{Point2, Vector2, Vector3};

use super::{
    Camera, Mount, World, half_width,
    obstacle::{Shade, Shadow},
};
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
    /// Its upper and lower edge are in the picture, and no obstacle hides any of its height.
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
        let shades = ball.shades(world, camera);
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
        for ([right, left], dark) in &shades {
            let [top, bottom] = ball.dark_rows(camera, *dark);
            let cover = Extent {
                top,
                bottom,
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
        let nearer = balls[n + 1..].iter().map(|(_, nearer)| {
            let off = wrapped(nearer.bearing - ball.bearing);
            let shadow = [off - nearer.half_width, off + nearer.half_width];
            (shadow, f64::INFINITY)
        });
        if let Some(sight) = ball.seen(camera, shades.into_iter().chain(nearer)) {
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
    ball.seen(camera, ball.shades(world, camera))
}

/// Half widths of a ball that what covers its edge reaches from its middle.
const BEYOND: f64 = 4.0;

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
        let (elevation, of_rows) = row_of(camera, &seen);
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

    /// Shadows of obstacles that fall on it, relative to the bearing, and the height up to which each is dark.
    fn shades(&self, world: &World, camera: &Camera) -> Vec<Shade> {
        let mut shades = Vec::new();
        let ahead: Vector2<f64> = (self.place - camera.place) / self.distance;
        let half_angle = half_width(self.distance, self.radius);
        for index in world.obstacles_near(camera.place, self.place, self.radius) {
            world.obstacles[index].shades(
                (camera.place, camera.mount.height),
                ahead,
                self.distance,
                half_angle,
                &mut shades,
            );
        }
        shades.retain(|(_, dark)| *dark > self.above - self.radius);
        if camera.mount == Mount::LEVEL {
            return shades;
        }
        // Their edges pass through the ball's plane where the ball is. What ends at the ball's edge goes on beyond it, which
        // is farther away in a picture that is turned.
        let in_picture = |side: f64| {
            let goes_on = side.abs() >= half_angle * (1.0 - 1e-9);
            let side = if goes_on { BEYOND * side } else { side };
            let seen = camera
                .mount
                .seen(self.azimuth + side, self.distance, self.above);
            wrapped(seen.y.atan2(seen.x) - self.bearing)
        };
        let turned = shades.into_iter().map(|(shadow, dark)| {
            let [a, b] = shadow.map(in_picture);
            ([a.min(b), a.max(b)], dark)
        });
        turned.collect()
    }

    /// Returns true if a shadow that is dark up to here leaves a part of the ball above it.
    fn is_above(&self, dark: f64) -> bool {
        dark < self.above + self.radius
    }

    /// The rows of the picture where a shadow hides it, as shares of the height: all of them, or those of its lower part.
    fn dark_rows(&self, camera: &Camera, dark: f64) -> [f64; 2] {
        if !self.is_above(dark) {
            return [0.0, 1.0];
        }
        let row = |above: f64| {
            let seen = camera.mount.seen(self.azimuth, self.distance, above);
            let (elevation, _) = row_of(camera, &seen);
            let lens = &camera.lens;
            lens.outline(self.bearing, elevation, self.half_width, 0.0)
                .top
        };
        // Below the ball nothing else is.
        let [edge, below] = [dark, self.above - 2.0 * self.radius].map(row);
        [edge.min(below), edge.max(below)]
    }

    fn seen(&self, camera: &Camera, shades: impl IntoIterator<Item = Shade>) -> Option<Sight> {
        let border = camera.lens.half_view_at(self.elevation);
        let whole = [
            (self.bearing - self.half_width).max(-border),
            (self.bearing + self.half_width).min(border),
        ];
        let (mut shadows, mut is_cut) = (Vec::new(), false);
        for (shadow, dark) in shades {
            let [right, left] = shadow.map(|side| side + self.bearing);
            let is_before = right < whole[1] && left > whole[0];
            is_cut |= is_before && self.is_above(dark);
            // A part of which more than the middle is dark is not seen.
            if dark >= self.above {
                shadows.push([right, left]);
            }
        }
        let visible = without(whole, shadows);
        (!visible.is_empty()).then_some(Sight {
            distance: self.distance,
            bearing: self.bearing,
            half_width: self.half_width,
            is_high_enough: !is_cut
                && self.elevation.abs() + self.half_height
                    <= camera.lens.half_height_at(self.bearing),
            visible,
        })
    }
}

/// The angle of a direction off the middle row, and the distance from which the height of a ball there is seen.
fn row_of(camera: &Camera, seen: &Vector3<f64>) -> (f64, f64) {
    match camera.lens.projection() {
        Projection::PinHole => (seen.z.atan2(seen.x), seen.xz().norm()),
        Projection::EqualAngle => (seen.z.atan2(seen.xy().norm()), seen.norm()),
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
