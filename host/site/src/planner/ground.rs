//! Where a target can stand, and is measured well.

use nalgebra::{Point2, Vector2};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::world::World;

/// Stops are not nearer to a camera than so many radii of the ball.
pub const NEAREST: f64 = 8.0;

/// Columns that stay free between blob and border: firmware refuses a blob within three, for it may
/// be cut off, and the target stands up to a column beside its place.
const BORDER_COLUMNS: f64 = 4.0;
/// Places to choose from, of each camera.
const CANDIDATES: usize = 96;

/// Cameras, obstacles and a ball.
#[derive(Clone, Copy)]
pub(crate) struct Ground<'a> {
    pub(crate) world: &'a World,
    /// Lowest and highest corner of where the target may go.
    pub(crate) bounds: [Point2<f64>; 2],
    /// Of the ball.
    pub(crate) radius: f64,
    /// Places at which a person can stand, if there are others in these bounds.
    pub(crate) may_stand: Option<&'a dyn Fn(Point2<f64>) -> bool>,
}

/// Bounds of nothing.
pub(super) const ANYWHERE: [Point2<f64>; 2] = [
    Point2::new(f64::NEG_INFINITY, f64::NEG_INFINITY),
    Point2::new(f64::INFINITY, f64::INFINITY),
];

impl Ground<'_> {
    /// Returns true if a camera would measure a ball there well.
    pub(crate) fn suits(&self, camera: usize, place: Point2<f64>) -> bool {
        let Some(sight) = self.world.sight(camera, place, self.radius) else {
            return false;
        };
        let camera = &self.world.cameras()[camera];
        let border = camera.lens.bearing(BORDER_COLUMNS - 0.5);
        sight.is_whole()
            && sight.bearing.abs() + sight.half_width <= border
            && sight.distance >= NEAREST * self.radius
            && sight.distance + self.radius <= camera.range
    }

    pub(crate) fn is_free(&self, place: Point2<f64>) -> bool {
        let [low, high] = self.bounds;
        let margin = Vector2::repeat(self.radius);
        let inside = place >= low + margin && place <= high - margin;
        inside
            && self
                .world
                .obstacle_on_way(place, place, 2.0 * self.radius)
                .is_none()
    }

    /// A random place in view of a camera.
    fn draw(&self, camera: usize, random: &mut ChaCha8Rng) -> Point2<f64> {
        let camera = &self.world.cameras()[camera];
        let distance =
            random.random_range(NEAREST * self.radius..camera.range.max(10.0 * self.radius));
        let border = camera.lens.half_view();
        let direction = camera.heading + random.random_range(-border..border);
        camera.place + Vector2::new(direction.cos(), direction.sin()) * distance
    }

    /// Some places that suit cameras, drawn in view of the first one.
    pub(super) fn candidates<T>(
        &self,
        cameras: &[usize],
        random: &mut ChaCha8Rng,
        tells: impl Fn(Point2<f64>) -> T,
    ) -> Vec<(Point2<f64>, T)> {
        (0..40 * CANDIDATES)
            .map(|_| self.draw(cameras[0], random))
            .filter(|&place| {
                self.is_free(place)
                    && cameras.iter().all(|&camera| self.suits(camera, place))
                    && self.may_stand.is_none_or(|may_stand| may_stand(place))
            })
            .take(CANDIDATES)
            .map(|place| (place, tells(place)))
            .collect()
    }
}
