//! Obstacles to sight and ways.

use nalgebra::{Point2, Vector2};

/// Something opaque that stands on the floor.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// Its outline.
    pub shape: Shape,
    /// Height of its top above the middle of the balls. Infinity: it reaches to the ceiling.
    pub top: f64,
}

/// The outline of an obstacle.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A thin wall between two places.
    Segment([Point2<f64>; 2]),
    /// A pillar.
    Disc {
        /// Its middle.
        centre: Point2<f64>,
        /// Its radius.
        radius: f64,
    },
    /// Its border, closed from the last corner to the first, and what it encloses.
    Polygon(Vec<Point2<f64>>),
}

/// Directions, counter-clockwise of the one to a ball: from the least to the greatest.
pub(super) type Shadow = [f64; 2];

/// A shadow, and the height up to which it is dark where the ball is, above the middle of the balls.
pub(super) type Shade = (Shadow, f64);

impl From<Shape> for Obstacle {
    /// One that reaches to the ceiling.
    fn from(shape: Shape) -> Self {
        Self {
            shape,
            top: f64::INFINITY,
        }
    }
}

impl Obstacle {
    /// Where it hides a ball at a `distance` in the direction of the unit vector `ahead`, which is seen `half_width` to
    /// both sides, from an eye so far above the middle of the balls.
    pub(super) fn shades(
        &self,
        (eye, above): (Point2<f64>, f64),
        ahead: Vector2<f64>,
        distance: f64,
        half_width: f64,
        out: &mut Vec<Shade>,
    ) {
        let mut parts = Vec::new();
        self.shape
            .shadows(eye, ahead, distance, half_width, &mut parts);
        let up = self.top - above;
        out.extend(parts.into_iter().map(|(shadow, [near, far])| {
            // An eye above it looks over its far edge, one below it over the near one.
            let edge = if up < 0.0 { far } else { near };
            let dark = if up.is_finite() {
                above + up * distance / edge
            } else {
                up
            };
            (shadow, dark)
        }));
    }
}

impl Shape {
    /// Lowest and highest corner of what it covers.
    pub(super) fn bounds(&self) -> (Point2<f64>, Point2<f64>) {
        match self {
            Self::Segment([a, b]) => (a.inf(b), a.sup(b)),
            Self::Disc { centre, radius } => {
                let reach = Vector2::repeat(*radius);
                (centre - reach, centre + reach)
            }
            Self::Polygon(corners) => {
                let first = corners.first().copied().unwrap_or_default();
                corners.iter().fold((first, first), |(low, high), corner| {
                    (low.inf(corner), high.sup(corner))
                })
            }
        }
    }

    /// The straight parts of its border.
    fn edges(&self) -> impl Iterator<Item = [Point2<f64>; 2]> + '_ {
        let corners: &[Point2<f64>] = match self {
            Self::Segment(ends) => ends,
            Self::Disc { .. } => &[],
            Self::Polygon(corners) => corners,
        };
        // A wall is its own way back.
        let next = corners.iter().cycle().skip(1);
        corners.iter().zip(next).map(|(&a, &b)| [a, b])
    }

    /// Returns true if a place is inside.
    pub fn contains(&self, place: Point2<f64>) -> bool {
        match self {
            Self::Segment(_) => false,
            Self::Disc { centre, radius } => (place - centre).norm() < *radius,
            Self::Polygon(_) => {
                // A ray along x crosses the border an odd number of times.
                let crossings = self.edges().filter(|[a, b]| {
                    (a.y > place.y) != (b.y > place.y)
                        && place.x < a.x + (place.y - a.y) / (b.y - a.y) * (b.x - a.x)
                });
                crossings.count() % 2 == 1
            }
        }
    }

    /// Least distance between it and the straight way between two places; 0 if the way crosses it.
    pub fn distance_to_way(&self, from: Point2<f64>, to: Point2<f64>) -> f64 {
        match self {
            Self::Disc { centre, radius } => {
                (distance_to_segment(*centre, [from, to]) - radius).max(0.0)
            }
            _ if self.contains(from) => 0.0,
            _ => self
                .edges()
                .map(|edge| distance_of_segments(edge, [from, to]))
                .fold(f64::INFINITY, f64::min),
        }
    }

    /// Directions that it hides before a ball, and how near and how far each part of it stands.
    fn shadows(
        &self,
        eye: Point2<f64>,
        ahead: Vector2<f64>,
        distance: f64,
        half_width: f64,
        out: &mut Vec<(Shadow, [f64; 2])>,
    ) {
        let local = |place: Point2<f64>| {
            let d = place - eye;
            Vector2::new(d.dot(&ahead), ahead.perp(&d))
        };
        if let Self::Disc { centre, radius } = self {
            let centre = local(*centre);
            let off = centre.norm();
            if off < distance {
                let direction = centre.y.atan2(centre.x);
                let half = super::half_width(off, *radius);
                let reach = [off - radius, (off + radius).min(distance)];
                out.push(([direction - half, direction + half], reach));
            }
            return;
        }
        // The triangle of eye and outline; beyond it the ball hides the obstacle.
        let (sin, cos) = half_width.sin_cos();
        let beyond = distance * cos * cos;
        let sides = [
            (Vector2::new(-sin, cos), 0.0),
            (Vector2::new(-sin, -cos), 0.0),
            (Vector2::new(1.0, 0.0), beyond),
        ];
        for edge in self.edges() {
            if let Some([a, b]) = clip(edge.map(local), &sides) {
                let reach = [a.x.min(b.x), a.x.max(b.x)];
                let (a, b) = (a.y.atan2(a.x), b.y.atan2(b.x));
                out.push(([a.min(b), a.max(b)], reach));
            }
        }
    }

    /// Distance that a ray along a unit vector runs until it hits.
    pub(super) fn hit(&self, eye: Point2<f64>, ray: Vector2<f64>) -> Option<f64> {
        if let Self::Disc { centre, radius } = self {
            return hit_disc(eye, ray, *centre, *radius);
        }
        self.edges()
            .filter_map(|[a, b]| {
                let (along, to) = (b - a, a - eye);
                let determinant = ray.perp(&along);
                let distance = to.perp(&along) / determinant;
                let share = to.perp(&ray) / determinant;
                ((0.0..=1.0).contains(&share) && distance >= 0.0).then_some(distance)
            })
            .min_by(f64::total_cmp)
    }
}

/// Distance that a ray runs until it hits a disc from outside.
pub(super) fn hit_disc(
    eye: Point2<f64>,
    ray: Vector2<f64>,
    centre: Point2<f64>,
    radius: f64,
) -> Option<f64> {
    let to = centre - eye;
    let (along, across) = (to.dot(&ray), ray.perp(&to));
    let inside = radius * radius - across * across;
    (along > 0.0 && inside >= 0.0).then(|| along - inside.sqrt())
}

/// The part of a segment on the inner side `normal . p <= limit` of every line.
fn clip([a, b]: [Vector2<f64>; 2], sides: &[(Vector2<f64>, f64)]) -> Option<[Vector2<f64>; 2]> {
    let along = b - a;
    let (mut first, mut last) = (0.0_f64, 1.0_f64);
    for (normal, limit) in sides {
        let (room, growth) = (limit - normal.dot(&a), normal.dot(&along));
        if growth > 0.0 {
            last = last.min(room / growth);
        } else if growth < 0.0 {
            first = first.max(room / growth);
        } else if room < 0.0 {
            return None;
        }
    }
    (first < last).then(|| [a + along * first, a + along * last])
}

fn distance_to_segment(place: Point2<f64>, [a, b]: [Point2<f64>; 2]) -> f64 {
    let along = b - a;
    let length2 = along.norm_squared();
    let share = if length2 > 0.0 {
        ((place - a).dot(&along) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (place - (a + along * share)).norm()
}

fn distance_of_segments(first: [Point2<f64>; 2], second: [Point2<f64>; 2]) -> f64 {
    let side = |[a, b]: [Point2<f64>; 2], p: Point2<f64>| (b - a).perp(&(p - a));
    let parts =
        |of: [Point2<f64>; 2], by: [Point2<f64>; 2]| side(by, of[0]) * side(by, of[1]) < 0.0;
    if parts(first, second) && parts(second, first) {
        return 0.0;
    }
    [
        distance_to_segment(first[0], second),
        distance_to_segment(first[1], second),
        distance_to_segment(second[0], first),
        distance_to_segment(second[1], first),
    ]
    .into_iter()
    .fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn p(x: f64, y: f64) -> Point2<f64> {
        Point2::new(x, y)
    }

    /// A unit square around (3, 0).
    fn square() -> Shape {
        Shape::Polygon(vec![p(2.5, -0.5), p(3.5, -0.5), p(3.5, 0.5), p(2.5, 0.5)])
    }

    #[test]
    fn inside_is_inside() {
        assert!(square().contains(p(3.4, 0.4)));
        assert!(!square().contains(p(3.6, 0.4)));
        assert!(!square().contains(p(3.0, 0.6)));
    }

    #[test]
    fn ways_pass_or_cross() {
        let wall = Shape::Segment([p(1.0, -1.0), p(1.0, 1.0)]);
        assert_eq!(wall.distance_to_way(p(0.0, 0.0), p(2.0, 0.0)), 0.0);
        assert_eq!(wall.distance_to_way(p(0.0, 0.0), p(0.5, 0.0)), 0.5);
        assert!((wall.distance_to_way(p(0.0, 1.5), p(3.0, 1.5)) - 0.5).abs() < 1e-12);
        assert_eq!(square().distance_to_way(p(3.0, 0.1), p(3.1, 0.1)), 0.0);
        let pillar = Shape::Disc {
            centre: p(0.0, 2.0),
            radius: 0.5,
        };
        assert_eq!(pillar.distance_to_way(p(-1.0, 0.0), p(1.0, 0.0)), 1.5);
    }

    /// A ray finds the nearest side.
    #[test]
    fn rays_end_at_the_border() {
        let hit = |y: f64| square().hit(p(0.0, 0.0), Vector2::new(1.0, y).normalize());
        assert_eq!(hit(0.0), Some(2.5));
        assert_eq!(hit(0.3), None);
        let pillar = Shape::Disc {
            centre: p(4.0, 0.0),
            radius: 1.0,
        };
        assert_eq!(pillar.hit(p(0.0, 0.0), Vector2::x()), Some(3.0));
        assert_eq!(pillar.hit(p(0.0, 0.0), -Vector2::x()), None);
    }

    /// A wall over the left half of a ball hides just that; one behind it hides nothing.
    #[test]
    fn a_shadow_is_as_wide_as_what_casts_it() {
        let shadows = |wall: Shape| {
            let mut out = Vec::new();
            wall.shadows(p(0.0, 0.0), Vector2::x(), 4.0, 0.25, &mut out);
            out
        };
        let wall = |x: f64| Shape::Segment([p(x, 0.0), p(x, 5.0)]);
        let [([from, to], reach), ..] = shadows(wall(2.0))[..] else {
            panic!("no shadow");
        };
        assert!(from.abs() < 1e-12 && (to - 0.25).abs() < 1e-12 && reach == [2.0; 2]);
        assert!(shadows(wall(4.5)).is_empty());
        assert!(shadows(wall(-2.0)).is_empty());
    }
}
