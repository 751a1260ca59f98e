//! Drawings as SVG: [maps of answers](svg), [maps of runs](map) with their [errors] and
//! [residuals], and [errors over many runs](sweep()).

use std::collections::HashSet;

use calib_core::{Pose, Status};
use nalgebra::{Point2, Rotation2, Vector2};
use plotters::prelude::*;

use frame::{
    ARROW, Drawn, Entry, Root, TARGET, draw_arrow, draw_head, draw_name, draw_outline, ellipse,
    map_plane, to_pair,
};
use style::{draw_mark, style};
use view::View;

mod even_sample;
mod fine;
mod frame;
mod labels;
mod panels;
mod run;
mod style;
mod sweep;
mod view;

pub use even_sample::EvenSample;
pub use run::{errors, map, residuals};
pub use sweep::sweep;

/// Cameras beyond this number hide each other.
pub const MOST_CAMERAS: usize = 500;

/// Of more cameras than this, names would hide more than they tell.
const MOST_NAMES: usize = 40;

/// A camera on the map.
#[derive(Clone, Debug)]
pub struct MapCamera {
    /// Printed beside it, if there are only a few.
    pub name: String,
    /// Where, and how sure.
    pub pose: Pose<f64>,
    /// What the pose is worth: it has a colour and a shape.
    pub status: Status,
}

/// What to draw.
#[derive(Clone, Debug, Default)]
pub struct Map {
    /// What it shows.
    pub title: String,
    /// Name of the unit of length.
    pub unit: String,
    /// At most [`MOST_CAMERAS`], by convention.
    pub cameras: Vec<MapCamera>,
    /// Where targets stood. The same place may be given many times.
    pub targets: Vec<Point2<f64>>,
}

/// Why there is no map.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PlotError {
    /// The places are too far apart for numbers, or too close to each other for their size.
    #[error("the places to draw span too much, or too little, to be drawn on one map")]
    Span,
    /// The drawing library failed.
    #[error("drawing failed: {0}")]
    Drawing(String),
}

/// Draws the map. Cameras far outside of where nearly all of the others and the targets are
/// would shrink everything else to a dot; they are left out, and the map says how many.
///
/// # Errors
/// [`PlotError`]
pub fn svg(map: &Map) -> Result<String, PlotError> {
    let mut seen = HashSet::new();
    let mut targets = map.targets.clone();
    targets.retain(|t| seen.insert((t.x.to_bits(), t.y.to_bits())));
    let positions: Vec<_> = map.cameras.iter().map(|c| c.pose.position).collect();
    let view = View::of(&positions, &targets)?;
    let inside = map.cameras.iter();
    let mut cameras: Vec<_> = inside
        .filter(|camera| view.contains(camera.pose.position, ARROW))
        .collect();
    // The certain ones on top.
    cameras.sort_by_key(|camera| camera.is_calibrated());
    let size = frame::map_size(&view);
    let drawing = Drawing {
        map,
        cameras,
        targets,
        view,
    };
    frame::drawing(size, |root| drawing.draw(root))
}

/// What is on the map in the end.
struct Drawing<'a> {
    map: &'a Map,
    cameras: Vec<&'a MapCamera>,
    targets: Vec<Point2<f64>>,
    view: View,
}

impl Drawing<'_> {
    fn draw(&self, root: &Root<'_>) -> Drawn {
        let view = &self.view;
        draw_head(root, &self.map.title, &self.legend())?;
        let plane = map_plane(root, view, &self.map.unit)?;
        for camera in &self.cameras {
            let inside = if camera.is_calibrated() { 0.1 } else { 0.05 };
            let outline = ellipse(&camera.pose, 1.0);
            draw_outline(&plane, view, outline, camera.colour(), [inside, 0.5])?;
        }
        for &target in &self.targets {
            plane.draw(&Circle::new(to_pair(target), 5, TARGET.filled()))?;
        }
        for camera in &self.cameras {
            let (pose, colour) = (&camera.pose, camera.colour());
            draw_arrow(&plane, pose, view, colour)?;
            draw_mark(&plane, to_pair(pose.position), style(camera.status))?;
            if self.cameras.len() <= MOST_NAMES {
                // Behind the camera, where its arrow is not.
                let behind = Rotation2::new(pose.heading) * Vector2::new(-13.0, 0.0);
                draw_name(&plane, &camera.name, pose.position + behind / view.scale)?;
            }
        }
        Ok(())
    }

    fn legend(&self) -> Vec<Entry> {
        let outside = self.map.cameras.len() - self.cameras.len();
        let of = |status| self.cameras.iter().filter(|c| c.status == status).count();
        let colour = |status| Some(style(status).colour);
        let entries = [
            (
                of(Status::Calibrated),
                "calibrated, heading, 95 % ellipse",
                colour(Status::Calibrated),
            ),
            (of(Status::Weak), "weak (ring)", colour(Status::Weak)),
            (
                of(Status::Doubtful),
                "doubtful (triangle)",
                colour(Status::Doubtful),
            ),
            (self.targets.len(), "targets", Some(TARGET)),
            (outside, "far outside", None),
        ];
        let entries = entries.into_iter().filter(|(count, ..)| *count > 0);
        entries
            .map(|(count, name, colour)| Entry {
                text: format!("{count} {name}"),
                colour,
            })
            .collect()
    }
}

impl MapCamera {
    fn is_calibrated(&self) -> bool {
        self.status == Status::Calibrated
    }

    fn colour(&self) -> RGBColor {
        style(self.status).colour
    }
}
