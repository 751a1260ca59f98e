//! Panels below each other, with one place per camera from left to right.

use std::ops::Range;

use nalgebra::{Point2, Vector2};

use super::{
    PlotError,
    canvas::{Axis, Canvas, Entry, HEAD, LEFT, Plane, RIGHT, text},
};

/// Height of a panel and of the names below it, pixels.
const HEIGHT: f64 = 222.0;
const NAMES: f64 = 42.0;
/// Least width of a name, pixels.
const NAME_WIDTH: f64 = 26.0;

/// A column of panels, being drawn.
pub(super) struct Panels {
    canvas: Canvas,
    drawn: Vec<Plane>,
    names: Vec<String>,
    width: f64,
}

impl Panels {
    /// So many panels over these names.
    pub(super) fn new(count: u8, names: Vec<String>, title: &str, legend: &[Entry]) -> Self {
        let things = names.len().min(2000) as f64;
        // Thousands make a wide drawing rather than one dark bar.
        let width = (things * 44.0).clamp(640.0, f64::max(1100.0, things * 8.0));
        let height = HEAD + f64::from(count) * (HEIGHT + NAMES) + 12.0;
        Self {
            canvas: Canvas::new([LEFT + width + RIGHT, height], title, legend),
            drawn: Vec::new(),
            names,
            width,
        }
    }

    /// Width of one thing, pixels.
    pub(super) fn pitch(&self) -> f64 {
        self.width / self.names.len().max(1) as f64
    }

    /// The next panel, x being 0, 1, 2 for the things by name.
    pub(super) fn panel(&mut self, y_name: &str, y: Range<f64>) -> Result<Plane, PlotError> {
        let last = self.names.len().max(1) as f64 - 0.5;
        let low = y.start;
        let plane = self.axes(("", -0.5..last, 0.0), (y_name, y))?;
        let every = (NAME_WIDTH / self.pitch()).ceil().max(1.0) as usize;
        for (place, name) in self.names.iter().enumerate().step_by(every) {
            let below = plane.at(place as f64, low) + Vector2::new(0.0, 13.0);
            self.canvas.add(text(name, below, 13.0));
        }
        Ok(plane)
    }

    /// The next panel, with an axis of its own.
    pub(super) fn free_panel(
        &mut self,
        (x_name, x): (&str, Range<f64>),
        y: (&str, Range<f64>),
    ) -> Result<Plane, PlotError> {
        self.axes((x_name, x, 11.0), y)
    }

    fn axes(
        &mut self,
        (x_name, x, x_ticks): (&str, Range<f64>, f64),
        (y_name, y): (&str, Range<f64>),
    ) -> Result<Plane, PlotError> {
        let top = HEAD + self.drawn.len() as f64 * (HEIGHT + NAMES);
        let axis = |name, range: Range<f64>, ticks| Axis {
            name,
            low: range.start,
            high: range.end,
            ticks,
        };
        self.canvas.plane(
            Point2::new(LEFT, top),
            Vector2::new(self.width, HEIGHT),
            [axis(x_name, x, x_ticks), axis(y_name, y, 7.0)],
        )
    }

    /// Takes a panel that is done.
    pub(super) fn add(&mut self, plane: Plane) {
        self.drawn.push(plane);
    }

    pub(super) fn finish(self) -> String {
        self.canvas.finish(self.drawn)
    }
}
