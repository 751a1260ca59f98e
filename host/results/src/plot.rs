//! Drawings as SVG: [maps of answers](svg()), [maps of runs](map) with their [errors] and
//! [residuals], and [errors over many runs](sweep()).

use std::collections::HashSet;

use calib_core::{Pose, Status};
use nalgebra::Point2;

use cameras::{ARROW, Worth, behind, draw_estimate};
use canvas::{Entry, TARGET, dot, text};
use labels::Labels;
use view::View;

mod cameras;
mod canvas;
mod labels;
mod panels;
mod run;
mod seen;
mod sweep;
mod view;

pub use cameras::status_colour;
pub use run::{errors, map, residuals};
pub use sweep::sweep;

/// Cameras beyond this number hide each other: a caller with more chooses some.
pub const MOST_CAMERAS: usize = 500;

/// Up to so many cameras all have their names on a map; of more, those for whose names there is room.
const ALL_NAMED: usize = 40;

/// A camera on the map.
#[derive(Clone, Debug)]
pub struct MapCamera {
    /// Printed beside it, if there is room.
    pub name: String,
    /// Where, and how sure.
    pub pose: Pose<f64>,
    /// Status of the pose, shown by colour and shape.
    pub status: Status,
}

/// Content of a drawing.
#[derive(Clone, Debug, Default)]
pub struct Map {
    /// Title of the drawing.
    pub title: String,
    /// Name of the unit of length.
    pub unit: String,
    /// At most [`MOST_CAMERAS`], by convention.
    pub cameras: Vec<MapCamera>,
    /// Where targets stood. The same place may be given many times.
    pub targets: Vec<Point2<f64>>,
}

/// Why there is no drawing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PlotError {
    /// The places are too far apart for numbers, or too close to each other for their size.
    #[error("the places to draw span too much, or too little, to be drawn on one map")]
    Span,
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
        .map(|camera| (Worth::from(camera.status), camera))
        .collect();
    // The best ones on top.
    cameras.sort_by_key(|(worth, _)| std::cmp::Reverse(*worth));

    let outside = map.cameras.len() - cameras.len();
    let mut legend = count(&cameras.iter().map(|(worth, _)| *worth));
    legend.push(Entry::remark("arrow: heading, ellipse: 95 %"));
    if !targets.is_empty() {
        legend.push(Entry::dot(format!("{} targets", targets.len()), TARGET));
    }
    if outside > 0 {
        legend.push(Entry::remark(format!("{outside} far outside")));
    }
    let (canvas, mut plane) = view.map(&map.title, &legend, &map.unit)?;
    let is_large = cameras.len() > ALL_NAMED;
    let mut labels = Labels::default();
    for &target in &targets {
        let at = plane.place(target);
        labels.keep_clear(at, 5.0);
        plane.add(dot(at, 4.0, TARGET));
    }
    for (worth, camera) in &cameras {
        keep_clear(
            &mut labels,
            plane.place(camera.pose.position),
            camera.pose.heading,
        );
        draw_estimate(&mut plane, &camera.pose, view.scale, *worth, is_large);
    }
    for (_, camera) in &cameras {
        let (at, letters) = (
            plane.place(camera.pose.position),
            camera.name.chars().count(),
        );
        let (favourite, must) = (behind(camera.pose.heading), !is_large);
        if let Some(place) = labels.place(letters, 13.0, at, favourite, must) {
            plane.add(text(&camera.name, place, 13.0));
        }
    }
    Ok(canvas.finish([plane]))
}

/// Entries of a legend: number of cameras of each worth.
fn count(cameras: &(impl Iterator<Item = Worth> + Clone)) -> Vec<Entry> {
    let counts = Worth::ALL.into_iter().map(|worth| {
        let count = cameras.clone().filter(|other| *other == worth).count();
        (worth, count)
    });
    let some = counts.filter(|(_, count)| *count > 0);
    some.map(|(worth, count)| worth.entry(count)).collect()
}

/// Nothing should be written over a camera and its arrow.
fn keep_clear(labels: &mut Labels, at: Point2<f64>, heading: f64) {
    labels.keep_clear(at, 6.0);
    let (sin, cos) = heading.sin_cos();
    for along in [0.4, 0.8] {
        let arrow = nalgebra::Vector2::new(cos, -sin) * ARROW * along;
        labels.keep_clear(at + arrow, 5.0);
    }
}
