//! Drawing of cameras and of the worth of their estimates.

use std::f64::consts::PI;

use calib_core::{Pose, Status};
use nalgebra::{Point2, Rotation2, Vector2};

use super::canvas::{CAMERA, Colour, Entry, GREY, Mark, Plane, area, ellipse, line};
use crate::record::Node;

/// Length of the arrow that tells a heading, pixels.
pub(super) const ARROW: f64 = 24.0;

/// Worth of an estimate, the best first.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Worth {
    Calibrated,
    Weak,
    Doubtful,
    Refused,
    Waiting,
    /// Has no pose, and was not meant to have one.
    NotPlanned,
}

/// Of cameras without a pose.
const NO_POSE: Colour = "#480503";

/// Colour of cameras of this status, such as `#0068A8`: on maps, and by day on the page that shows a network.
pub fn status_colour(status: Status) -> &'static str {
    Worth::from(status).colour()
}

impl Worth {
    pub(super) const ALL: [Self; 6] = [
        Self::Calibrated,
        Self::Weak,
        Self::Doubtful,
        Self::Refused,
        Self::Waiting,
        Self::NotPlanned,
    ];

    pub(super) fn of_node(node: &Node) -> Self {
        match node.status {
            None | Some(Status::Waiting) if !node.expected => Self::NotPlanned,
            status => status.map_or(Self::Waiting, Self::from),
        }
    }

    /// Its name in a legend, and its mark.
    fn style(self) -> (&'static str, Mark, Colour) {
        match self {
            Self::Calibrated => ("calibrated", Mark::Dot, CAMERA),
            Self::Weak => ("weak", Mark::Diamond, "#897004"),
            Self::Doubtful => ("doubtful", Mark::Triangle, "#B84E63"),
            Self::Refused => ("refused", Mark::Cross, NO_POSE),
            Self::Waiting => ("waiting", Mark::Ring, NO_POSE),
            Self::NotPlanned => ("not planned", Mark::Ring, GREY),
        }
    }

    /// The entry of a legend for so many.
    pub(super) fn entry(self, count: usize) -> Entry {
        let (name, mark, colour) = self.style();
        Entry::new(format!("{count} {name}"), mark, colour)
    }

    pub(super) fn colour(self) -> Colour {
        self.style().2
    }

    pub(super) fn mark(self) -> Mark {
        self.style().1
    }
}

impl From<Status> for Worth {
    fn from(status: Status) -> Self {
        match status {
            Status::Calibrated => Self::Calibrated,
            Status::Weak => Self::Weak,
            Status::Doubtful => Self::Doubtful,
            Status::Refused => Self::Refused,
            Status::Waiting => Self::Waiting,
        }
    }
}

/// An estimate: its ellipse of 95 %, at so many pixels per unit of length, its heading and its mark.
/// Where there are `many`, ellipses are faint, or those upon one another would hide all below.
pub(super) fn draw_estimate(
    plane: &mut Plane,
    pose: &Pose<f64>,
    scale: f64,
    worth: Worth,
    many: bool,
) {
    let (at, colour) = (plane.place(pose.position), worth.colour());
    let (of, inside) = (pose.ellipse(0.95), if many { 0.06 } else { 0.14 });
    let half = [of.semi_major, of.semi_minor].map(|axis| axis * scale);
    let degrees = -of.angle.to_degrees();
    plane.add(ellipse(at, half, degrees, colour, inside));
    draw_arrow(plane, at, pose.heading, colour);
    plane.add(worth.mark().draw(at, 2.5, colour));
}

/// A heading, counter-clockwise, as an arrow from a place in pixels.
pub(super) fn draw_arrow(plane: &mut Plane, at: Point2<f64>, heading: f64, colour: Colour) {
    let turn = Rotation2::new(-heading);
    let place = |along: f64, left: f64| at + turn * Vector2::new(along, left);
    let shaft = [at, place(ARROW - 6.0, 0.0)];
    plane.add(line(&shaft, colour, 1.8));
    let head = [
        place(ARROW, 0.0),
        place(ARROW - 9.0, 4.0),
        place(ARROW - 9.0, -4.0),
    ];
    plane.add(area(&head, colour, [1.0, 0.0]));
}

/// Where a name should stand if it can: behind the camera, where its arrow is not; as an angle on
/// the drawing.
pub(super) fn behind(heading: f64) -> f64 {
    PI - heading
}
