//! How a camera's status is drawn.

use calib_core::Status;
use plotters::prelude::*;

use super::frame::{BAD, CAMERA, DOUBT, Drawn, Plane, UNCERTAIN};

/// The shape of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mark {
    /// A filled circle.
    Disc,
    /// A ring.
    Ring,
    /// Two strokes across each other.
    Cross,
    /// A triangle.
    Triangle,
}

/// How a camera is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Style {
    pub(super) colour: RGBColor,
    pub(super) mark: Mark,
}

/// Colour and shape by status, so that neither alone has to be told apart.
pub(super) fn style(status: Status) -> Style {
    let (colour, mark) = match status {
        Status::Calibrated => (CAMERA, Mark::Disc),
        Status::Weak => (UNCERTAIN, Mark::Ring),
        Status::Doubtful => (DOUBT, Mark::Triangle),
        Status::Refused | Status::Waiting => (BAD, Mark::Cross),
    };
    Style { colour, mark }
}

/// Draws the shape of a camera here.
pub(super) fn draw_mark(plane: &Plane<'_>, (x, y): (f64, f64), style: Style) -> Drawn {
    let Style { colour, mark } = style;
    match mark {
        Mark::Disc => plane.draw(&Circle::new((x, y), 3, colour.filled()))?,
        Mark::Ring => plane.draw(&Circle::new((x, y), 4, colour.stroke_width(2)))?,
        Mark::Cross => plane.draw(&Cross::new((x, y), 4, colour.stroke_width(2)))?,
        Mark::Triangle => plane.draw(&TriangleMarker::new((x, y), 5, colour.filled()))?,
    }
    Ok(())
}
