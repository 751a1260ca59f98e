//! Part of the world that a map shows, and its scale.

use nalgebra::{Point2, Vector2};

use super::{
    PlotError,
    canvas::{Axis, BELOW, Canvas, Entry, HEAD, LEFT, Plane, RIGHT},
};
use crate::accuracy::quantile;

// All in pixels.
const LARGEST: Vector2<f64> = Vector2::new(1000.0, 760.0);
const SMALLEST: Vector2<f64> = Vector2::new(560.0, 320.0);
/// So many cameras have room on the largest map; it grows with more, up to so many times.
const ROOMY: f64 = 80.0;
const MOST_TIMES: f64 = 4.0;
/// Pixels from one number of an axis to the next.
const TICK_DISTANCE: f64 = 85.0;
/// Room around what is drawn.
const RIM: f64 = 34.0;

/// The part of the world that is drawn, and how large.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    pub(super) low: Point2<f64>,
    pub(super) high: Point2<f64>,
    /// Pixels per unit of length, the same in x and y.
    pub(super) scale: f64,
    /// Size in pixels, whole numbers.
    pub(super) pixels: Vector2<f64>,
}

impl View {
    /// All targets, and nearly all cameras.
    pub(super) fn of(cameras: &[Point2<f64>], targets: &[Point2<f64>]) -> Result<Self, PlotError> {
        let axis = |of: fn(&Point2<f64>) -> f64| {
            let mut places: Vec<f64> = cameras.iter().map(of).collect();
            places.sort_unstable_by(f64::total_cmp);
            // A few cameras are all worth showing; of many, a few may be far off.
            let spare = if places.len() > 50 { 0.02 } else { 0.0 };
            let ends = [quantile(&places, spare), quantile(&places, 1.0 - spare)];
            let all = targets.iter().map(of).chain(ends.into_iter().flatten());
            let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
                (low.min(v), high.max(v))
            });
            if low <= high { (low, high) } else { (0.0, 1.0) }
        };
        let ((left, right), (bottom, top)) = (axis(|p| p.x), axis(|p| p.y));
        let span = Vector2::new(right - left, top - bottom);
        let size = left.abs().max(right.abs()).max(bottom.abs()).max(top.abs());
        if !(span.max() > size * 1e-9 && span.max() < 1e150) {
            return Err(PlotError::Span);
        }
        let times = (cameras.len() as f64 / ROOMY).sqrt().clamp(1.0, MOST_TIMES);
        let room = LARGEST * times - Vector2::repeat(2.0 * RIM);
        let scale = room.component_div(&span).min();
        let pixels = (span * scale + Vector2::repeat(2.0 * RIM))
            .sup(&SMALLEST)
            .map(f64::round);
        let middle = Point2::new(left + span.x / 2.0, bottom + span.y / 2.0);
        let half = pixels / (2.0 * scale);
        Ok(Self {
            low: middle - half,
            high: middle + half,
            scale,
            pixels,
        })
    }

    /// Paper for a map of it, with its axes.
    pub(super) fn map(
        &self,
        title: &str,
        legend: &[Entry],
        unit: &str,
    ) -> Result<(Canvas, Plane), PlotError> {
        let size = self.pixels + Vector2::new(LEFT + RIGHT, HEAD + BELOW);
        let mut canvas = Canvas::new(size.into(), title, legend);
        let names = ["x", "y"].map(|axis| format!("{axis} [{unit}]"));
        let axis = |of: usize| Axis {
            name: &names[of],
            low: self.low[of],
            high: self.high[of],
            ticks: self.pixels[of] / TICK_DISTANCE,
        };
        let axes = [axis(0), axis(1)];
        let plane = canvas.plane(Point2::new(LEFT, HEAD), self.pixels, axes)?;
        Ok((canvas, plane))
    }

    /// Returns true if a place is inside, at least so many pixels from the border.
    pub(super) fn contains(&self, p: Point2<f64>, pixels: f64) -> bool {
        let rim = pixels / self.scale;
        p.x > self.low.x + rim
            && p.x < self.high.x - rim
            && p.y > self.low.y + rim
            && p.y < self.high.y - rim
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_axes_have_one_scale_and_everything_is_inside() {
        for corner in [
            Point2::new(10.0, 10.0),
            Point2::new(1000.0, 0.1),
            Point2::new(0.001, 5.0),
            Point2::new(3.0, 0.0),
        ] {
            let view = View::of(&[Point2::origin()], &[corner]).unwrap();
            let scales = view.pixels.component_div(&(view.high - view.low));
            assert!((scales.x / view.scale - 1.0).abs() < 1e-12);
            assert!((scales.y / view.scale - 1.0).abs() < 1e-12);
            assert!(view.contains(corner, RIM - 1.0) && view.contains(Point2::origin(), RIM - 1.0));
            assert!(view.pixels.x <= LARGEST.x.max(SMALLEST.x) && view.pixels.y <= LARGEST.y);
        }
    }

    #[test]
    fn a_few_far_cameras_do_not_shrink_the_rest() {
        let mut cameras: Vec<_> = (0..100)
            .map(|k| Point2::new(f64::from(k % 10), 5.0))
            .collect();
        cameras.push(Point2::new(1e9, 0.0));
        let view = View::of(&cameras, &[Point2::origin()]).unwrap();
        assert!(view.high.x < 20.0);
    }

    #[test]
    fn nothing_to_see_is_refused_or_empty() {
        assert!(View::of(&[], &[]).is_ok());
        let place = Point2::new(1e20, 1.0);
        assert_eq!(View::of(&[place], &[place]).unwrap_err(), PlotError::Span);
        let ends = [Point2::new(-1e300, 0.0), Point2::new(1e300, 0.0)];
        assert_eq!(View::of(&ends, &[]).unwrap_err(), PlotError::Span);
    }
}
