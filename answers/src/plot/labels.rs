//! Names beside things, so that they hide each other as little as may be.

use nalgebra::{Point2, Vector2};

/// About what a letter takes, in pixels, at the size of names.
const LETTER: f64 = 8.0;
const HEIGHT: f64 = 14.0;
/// Directions that are tried.
const DIRECTIONS: u8 = 16;

/// What is taken, in pixels: boxes by their middle and half size.
#[derive(Default)]
pub(super) struct Labels {
    taken: Vec<(Point2<f64>, Vector2<f64>)>,
}

impl Labels {
    /// Nothing should be written over this.
    pub(super) fn keep_clear(&mut self, middle: Point2<f64>, half: f64) {
        self.taken.push((middle, Vector2::repeat(half)));
    }

    /// Where to write a name beside a thing, as near to a favourite direction as it is free.
    pub(super) fn place(
        &mut self,
        name: &str,
        thing: Point2<f64>,
        distance: f64,
        favourite: f64,
    ) -> Point2<f64> {
        let half = Vector2::new(name.chars().count() as f64 * LETTER, HEIGHT) / 2.0;
        let options = (0..DIRECTIONS).flat_map(|k| {
            let turn = f64::from(k) * std::f64::consts::TAU / f64::from(DIRECTIONS);
            let (sin, cos) = (favourite + turn).sin_cos();
            // A little cost for every bit farther off the favourite place.
            let cost = 1.0 - turn.cos();
            [1.0, 1.6].map(|times| {
                let middle = thing + Vector2::new(cos, sin) * distance * times;
                (middle, 4.0 * (cost + times))
            })
        });
        let mut best = (f64::INFINITY, thing);
        for (middle, cost) in options {
            let covered: f64 = self.taken.iter().map(|b| overlap((middle, half), *b)).sum();
            if covered + cost < best.0 {
                best = (covered + cost, middle);
            }
        }
        self.taken.push((best.1, half));
        best.1
    }
}

/// The area that two boxes share.
fn overlap(a: (Point2<f64>, Vector2<f64>), b: (Point2<f64>, Vector2<f64>)) -> f64 {
    let gap = (a.0 - b.0).abs();
    let shared = (a.1 + b.1 - gap).inf(&(a.1.inf(&b.1) * 2.0));
    shared.x.max(0.0) * shared.y.max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_takes_its_favourite_place_until_that_is_taken() {
        let mut labels = Labels::default();
        let thing = Point2::new(100.0, 100.0);
        let first = labels.place("12", thing, 15.0, 0.0);
        assert!((first - Point2::new(115.0, 100.0)).norm() < 1e-9);
        let second = labels.place("13", thing, 15.0, 0.0);
        let half = Vector2::new(LETTER, HEIGHT / 2.0);
        assert!(overlap((first, half), (second, half)) < 8.0);
    }
}
