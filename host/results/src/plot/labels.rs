//! Names beside things, so that they hide each other as little as may be.

use std::collections::HashMap;

use nalgebra::{Point2, Vector2};

/// Directions that are tried.
const DIRECTIONS: u8 = 16;
/// Size of the squares by which taken space is looked up, pixels.
const SQUARE: f64 = 64.0;

/// A box by its middle and half size, pixels.
type Taken = (Point2<f64>, Vector2<f64>);

/// Taken space, by the squares that it touches.
#[derive(Default)]
pub(super) struct Labels(HashMap<(i64, i64), Vec<Taken>>);

impl Labels {
    /// Nothing should be written over this.
    pub(super) fn keep_clear(&mut self, middle: Point2<f64>, half: f64) {
        self.take((middle, Vector2::repeat(half)));
    }

    fn take(&mut self, taken: Taken) {
        for square in squares(taken) {
            self.0.entry(square).or_default().push(taken);
        }
    }

    /// Part of a box that is taken, about: space that touches two squares counts in both.
    fn covered(&self, wanted: Taken) -> f64 {
        let near = squares(wanted).filter_map(|square| self.0.get(&square));
        near.flatten().map(|taken| overlap(wanted, *taken)).sum()
    }

    /// Where to write a name of some letters, `size` pixels high, beside a thing: as near to a
    /// favourite direction as it is free. Where nothing is, nowhere, or if it `must` be written,
    /// where it hides least.
    pub(super) fn place(
        &mut self,
        letters: usize,
        size: f64,
        thing: Point2<f64>,
        favourite: f64,
        must: bool,
    ) -> Option<Point2<f64>> {
        let half = Vector2::new(0.62 * letters as f64, 1.0) * size / 2.0;
        let options = (0..DIRECTIONS).flat_map(|k| {
            let turn = f64::from(k) * std::f64::consts::TAU / f64::from(DIRECTIONS);
            let (sin, cos) = (favourite + turn).sin_cos();
            [1.0, 1.6].map(|times| {
                let middle = thing + Vector2::new(cos, sin) * (size * 0.75 + 4.0) * times;
                let covered = self.covered((middle, half));
                // A little cost for every bit farther off the favourite place.
                (covered + 4.0 * (1.0 - turn.cos() + times), covered, middle)
            })
        });
        let (_, covered, middle) = options.min_by(|a, b| a.0.total_cmp(&b.0))?;
        (must || covered < 1.0).then(|| {
            self.take((middle, half));
            middle
        })
    }
}

fn squares((middle, half): Taken) -> impl Iterator<Item = (i64, i64)> {
    let square = |corner: Point2<f64>| corner.coords.map(|v| (v / SQUARE).floor() as i64);
    let (low, high) = (square(middle - half), square(middle + half));
    (low.x..=high.x).flat_map(move |x| (low.y..=high.y).map(move |y| (x, y)))
}

/// The area that two boxes share.
fn overlap(a: Taken, b: Taken) -> f64 {
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
        let thing = Point2::new(60.0, 60.0);
        let mut place = |must| labels.place(2, 12.0, thing, 0.0, must);
        let first = place(false).unwrap();
        assert!((first - Point2::new(73.0, 60.0)).norm() < 1e-9);
        let second = place(false).unwrap();
        assert!((second - first).amax() > 12.0);
        labels.keep_clear(thing, 60.0);
        assert_eq!(labels.place(2, 12.0, thing, 0.0, false), None);
        assert!(labels.place(2, 12.0, thing, 0.0, true).is_some());
    }
}
