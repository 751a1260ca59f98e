//! Maps of answers as SVG: cameras with headings and 95 % ellipses, and the targets they saw.

use std::{collections::HashSet, error::Error};

use calib_core::Pose;
use nalgebra::{Point2, Rotation2, Vector2};
use plotters::{
    coord::Shift,
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};
use view::View;

mod even_sample;
mod view;

pub use even_sample::EvenSample;

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
    /// Drawn in the weaker colour if not.
    pub is_certain: bool,
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

const CAMERA: RGBColor = RGBColor(31, 98, 178);
const UNCERTAIN: RGBColor = RGBColor(150, 150, 150);
const TARGET: RGBColor = RGBColor(230, 110, 20);
const INK: RGBColor = RGBColor(50, 50, 50);
const GRID: RGBColor = RGBColor(225, 225, 225);
const FONT: &str = "sans-serif";

// All in pixels.
const HEAD: u32 = 76;
const X_LABELS: u32 = 46;
const Y_LABELS: u32 = 64;
const LEFT: u32 = 12;
const RIGHT: u32 = 28;
const TICK_DISTANCE: f64 = 85.0;
const ARROW: f64 = 24.0;

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
    cameras.sort_by_key(|camera| camera.is_certain);
    let drawing = Drawing {
        map,
        cameras,
        targets,
        view,
    };
    let mut text = String::new();
    drawing
        .draw(&mut text)
        .map_err(|error| PlotError::Drawing(error.to_string()))?;
    Ok(text)
}

type Drawn = Result<(), Box<dyn Error>>;

/// What is on the map in the end.
struct Drawing<'a> {
    map: &'a Map,
    cameras: Vec<&'a MapCamera>,
    targets: Vec<Point2<f64>>,
    view: View,
}

impl Drawing<'_> {
    fn draw(&self, text: &mut String) -> Drawn {
        let view = &self.view;
        let (width, height) = (view.pixels.x as u32, view.pixels.y as u32);
        let size = (
            width + LEFT + Y_LABELS + RIGHT,
            height + HEAD + X_LABELS + LEFT,
        );
        let root = SVGBackend::with_string(text, size).into_drawing_area();
        root.fill(&WHITE)?;
        self.draw_head(&root)?;

        let mut chart = ChartBuilder::on(&root)
            .margin_top(HEAD)
            .margin_right(RIGHT)
            .margin_left(LEFT)
            .margin_bottom(LEFT)
            .x_label_area_size(X_LABELS)
            .y_label_area_size(Y_LABELS)
            .build_cartesian_2d(view.low.x..view.high.x, view.low.y..view.high.y)?;
        let digits = (1.0 - (TICK_DISTANCE / view.scale).log10()).clamp(1.0, 12.0) as usize;
        let tick = |value: &f64| {
            let text = format!("{value:.digits$}");
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        };
        chart
            .configure_mesh()
            .x_desc(format!("x [{}]", self.map.unit))
            .y_desc(format!("y [{}]", self.map.unit))
            .axis_desc_style((FONT, 16).into_font().color(&INK))
            .label_style((FONT, 14).into_font().color(&INK))
            .x_labels((view.pixels.x / TICK_DISTANCE) as usize + 1)
            .y_labels((view.pixels.y / TICK_DISTANCE) as usize + 1)
            .x_label_formatter(&tick)
            .y_label_formatter(&tick)
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .axis_style(INK)
            .draw()?;

        let area = chart.plotting_area();
        let to_pair = |p: Point2<f64>| (p.x, p.y);
        for camera in &self.cameras {
            let outline: Vec<_> = view
                .clip(ellipse(&camera.pose))
                .into_iter()
                .map(to_pair)
                .collect();
            let colour = camera.colour();
            area.draw(&Polygon::new(
                outline.clone(),
                colour.mix(if camera.is_certain { 0.1 } else { 0.05 }),
            ))?;
            area.draw(&PathElement::new(closed(outline), colour.mix(0.5)))?;
        }
        for &target in &self.targets {
            area.draw(&Circle::new(to_pair(target), 5, TARGET.filled()))?;
        }
        for camera in &self.cameras {
            let turn = Rotation2::new(camera.pose.heading);
            let place = |along: f64, left: f64| {
                to_pair(camera.pose.position + turn * Vector2::new(along, left) / view.scale)
            };
            let colour = camera.colour();
            area.draw(&PathElement::new(
                [place(0.0, 0.0), place(ARROW - 6.0, 0.0)],
                colour.stroke_width(2),
            ))?;
            area.draw(&Polygon::new(
                [
                    place(ARROW, 0.0),
                    place(ARROW - 9.0, 4.0),
                    place(ARROW - 9.0, -4.0),
                ],
                colour,
            ))?;
            area.draw(&Circle::new(place(0.0, 0.0), 3, colour.filled()))?;
            if self.cameras.len() <= MOST_NAMES {
                // Behind the camera, where its arrow is not.
                let style = TextStyle::from((FONT, 13).into_font())
                    .color(&INK)
                    .pos(Pos::new(HPos::Center, VPos::Center));
                area.draw(&Text::new(camera.name.as_str(), place(-13.0, 0.0), style))?;
            }
        }
        root.present()?;
        Ok(())
    }

    /// Title and legend, above the map where they hide nothing.
    fn draw_head(&self, root: &DrawingArea<SVGBackend<'_>, Shift>) -> Drawn {
        let left = (LEFT + Y_LABELS) as i32;
        let title = (FONT, 20).into_font().color(&INK);
        root.draw(&Text::new(self.map.title.as_str(), (left, 14), title))?;

        let (certain, uncertain): (Vec<&MapCamera>, Vec<&MapCamera>) =
            self.cameras.iter().partition(|camera| camera.is_certain);
        let outside = self.map.cameras.len() - self.cameras.len();
        let entries = [
            (
                certain.len(),
                "cameras, heading, 95 % ellipse",
                Some(CAMERA),
            ),
            (uncertain.len(), "uncertain", Some(UNCERTAIN)),
            (self.targets.len(), "targets", Some(TARGET)),
            (outside, "far outside", None),
        ];
        let (mut x, y) = (left, 52);
        for (count, name, colour) in entries.into_iter().filter(|(count, ..)| *count > 0) {
            if let Some(colour) = colour {
                root.draw(&Circle::new((x + 5, y), 5, colour.filled()))?;
                x += 16;
            }
            let text = format!("{count} {name}");
            let style = (FONT, 14).into_font().color(&INK);
            root.draw(&Text::new(text.as_str(), (x, y - 6), style))?;
            // Text is not measured: about seven pixels a letter at this size.
            x += text.len() as i32 * 7 + 22;
        }
        Ok(())
    }
}

impl MapCamera {
    fn colour(&self) -> RGBColor {
        if self.is_certain { CAMERA } else { UNCERTAIN }
    }
}

fn ellipse(pose: &Pose<f64>) -> Vec<Point2<f64>> {
    const CORNERS: u8 = 48;
    let ellipse = pose.ellipse(0.95);
    let turn = Rotation2::new(ellipse.angle);
    (0..CORNERS)
        .map(|k| {
            let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / f64::from(CORNERS)).sin_cos();
            pose.position + turn * Vector2::new(cos * ellipse.semi_major, sin * ellipse.semi_minor)
        })
        .collect()
}

/// The outline with its first corner again at the end.
fn closed(mut outline: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    outline.extend(outline.first().copied());
    outline
}
