//! What every drawing has: colours, a title with a legend, axes.

use std::{error::Error, fmt::Display};

use calib_core::Pose;
use nalgebra::{Point2, Rotation2, Vector2};
use plotters::{
    coord::{Shift, types::RangedCoordf64},
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

use super::{
    PlotError,
    fine::{Fine, fine, sized},
    view::View,
};

pub(super) const CAMERA: RGBColor = RGBColor(31, 98, 178);
pub(super) const UNCERTAIN: RGBColor = RGBColor(150, 150, 150);
pub(super) const TARGET: RGBColor = RGBColor(230, 110, 20);
pub(super) const DOUBT: RGBColor = RGBColor(160, 60, 170);
pub(super) const BAD: RGBColor = RGBColor(200, 30, 50);
pub(super) const INK: RGBColor = RGBColor(50, 50, 50);
pub(super) const GRID: RGBColor = RGBColor(225, 225, 225);
pub(super) const FONT: &str = "sans-serif";

// All in pixels.
pub(super) const HEAD: u32 = 76;
pub(super) const X_LABELS: u32 = 46;
pub(super) const Y_LABELS: u32 = 64;
pub(super) const LEFT: u32 = 12;
pub(super) const RIGHT: u32 = 28;
pub(super) const TICK: u32 = 5;
const TICK_DISTANCE: f64 = 85.0;
pub(super) const ARROW: f64 = 24.0;

pub(super) type Drawn = Result<(), Box<dyn Error>>;
pub(super) type Root<'a> = DrawingArea<Fine<'a>, Shift>;
/// Where things are drawn at places in the world, or at values.
pub(super) type Plane<'a> = DrawingArea<Fine<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// One entry of a legend, without colour for a remark.
pub(super) struct Entry {
    pub(super) text: String,
    pub(super) colour: Option<RGBColor>,
}

impl Entry {
    pub(super) fn new(text: impl Display, colour: RGBColor) -> Self {
        Self {
            text: text.to_string(),
            colour: Some(colour),
        }
    }

    pub(super) fn remark(text: impl Display) -> Self {
        Self {
            text: text.to_string(),
            colour: None,
        }
    }
}

/// Makes a drawing of a size in pixels.
pub(super) fn drawing(
    size: (u32, u32),
    draw: impl FnOnce(&Root<'_>) -> Drawn,
) -> Result<String, PlotError> {
    let mut text = String::new();
    let failed = |error: Box<dyn Error>| PlotError::Drawing(error.to_string());
    {
        let root = Fine::new(&mut text, size).into_drawing_area();
        root.fill(&WHITE).map_err(|error| failed(error.into()))?;
        draw(&root).map_err(failed)?;
        root.present().map_err(|error| failed(error.into()))?;
    }
    // No XML may contain them; names come from records, and those from anywhere.
    text.retain(|c| c == '\n' || !(c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}')));
    Ok(sized(&text, size))
}

/// A place on a drawing, in pixels.
fn at(x: i32, y: i32) -> (i32, i32) {
    let pixel = fine(1) as i32;
    (x * pixel, y * pixel)
}

/// Title and legend, above the drawing where they hide nothing.
pub(super) fn draw_head(root: &Root<'_>, title: &str, legend: &[Entry]) -> Drawn {
    let left = (LEFT + Y_LABELS) as i32;
    let style = (FONT, 20).into_font().color(&INK);
    root.draw(&Text::new(title, at(left, 14), style))?;
    // Text is not measured: about seven pixels a letter at this size.
    let width = |entry: &Entry| {
        let dot = if entry.colour.is_some() { 16 } else { 0 };
        dot + entry.text.chars().count() as i32 * 7
    };
    let right = (root.dim_in_pixel().0 / fine(1)) as i32;
    let (mut x, mut line, mut places) = (left, 0, Vec::new());
    for entry in legend {
        if x > left && x + width(entry) > right {
            (x, line) = (left, line + 1);
        }
        places.push((entry, x, line));
        x += width(entry) + 22;
    }
    let first = if line > 0 { 45 } else { 52 };
    for (Entry { text, colour }, mut x, line) in places {
        let y = first + 19 * line;
        if let Some(colour) = colour {
            root.draw(&Circle::new(at(x + 5, y), 5, colour.filled()))?;
            x += 16;
        }
        let style = (FONT, 14).into_font().color(&INK);
        root.draw(&Text::new(text.as_str(), at(x, y - 6), style))?;
    }
    Ok(())
}

/// Size of a drawing that shows a view.
pub(super) fn map_size(view: &View) -> (u32, u32) {
    let (width, height) = (view.pixels.x as u32, view.pixels.y as u32);
    (
        width + LEFT + Y_LABELS + RIGHT,
        height + HEAD + X_LABELS + LEFT,
    )
}

/// Axes and grid of a map, below its head.
pub(super) fn map_plane<'a>(
    root: &Root<'a>,
    view: &View,
    unit: &str,
) -> Result<Plane<'a>, Box<dyn Error>> {
    let mut chart = ChartBuilder::on(root)
        .margin_top(fine(HEAD))
        .margin_right(fine(RIGHT))
        .margin_left(fine(LEFT))
        .margin_bottom(fine(LEFT))
        .x_label_area_size(fine(X_LABELS))
        .y_label_area_size(fine(Y_LABELS))
        .build_cartesian_2d(view.low.x..view.high.x, view.low.y..view.high.y)?;
    let digits = (1.0 - (TICK_DISTANCE / view.scale).log10()).clamp(1.0, 12.0) as usize;
    let tick = |value: &f64| short(*value, digits);
    chart
        .configure_mesh()
        .set_all_tick_mark_size(fine(TICK))
        .x_desc(format!("x [{unit}]"))
        .y_desc(format!("y [{unit}]"))
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
    Ok(chart.plotting_area().clone())
}

/// A number without zeros that say nothing.
pub(super) fn short(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    match text.trim_end_matches('0').trim_end_matches('.') {
        "-0" => "0".to_owned(),
        text => text.to_owned(),
    }
}

/// An arrow in the direction of a pose, from its place: the shaft, and the head.
pub(super) fn draw_arrow(
    plane: &Plane<'_>,
    pose: &Pose<f64>,
    view: &View,
    colour: RGBColor,
) -> Drawn {
    let turn = Rotation2::new(pose.heading);
    let place = |along: f64, left: f64| {
        to_pair(pose.position + turn * Vector2::new(along, left) / view.scale)
    };
    plane.draw(&PathElement::new(
        [place(0.0, 0.0), place(ARROW - 6.0, 0.0)],
        colour.stroke_width(2),
    ))?;
    plane.draw(&Polygon::new(
        [
            place(ARROW, 0.0),
            place(ARROW - 9.0, 4.0),
            place(ARROW - 9.0, -4.0),
        ],
        colour,
    ))?;
    Ok(())
}

/// A filled outline with a stronger border, as far as it is inside.
pub(super) fn draw_outline(
    plane: &Plane<'_>,
    view: &View,
    outline: Vec<Point2<f64>>,
    colour: RGBColor,
    [inside, border]: [f64; 2],
) -> Drawn {
    let mut outline: Vec<_> = view.clip(outline).into_iter().map(to_pair).collect();
    plane.draw(&Polygon::new(outline.clone(), colour.mix(inside)))?;
    // The first corner again at the end.
    outline.extend(outline.first().copied());
    plane.draw(&PathElement::new(outline, colour.mix(border)))?;
    Ok(())
}

/// Text with its middle at a place.
pub(super) fn draw_name(plane: &Plane<'_>, name: &str, place: Point2<f64>) -> Drawn {
    let style = TextStyle::from((FONT, 13).into_font())
        .color(&INK)
        .pos(Pos::new(HPos::Center, VPos::Center));
    plane.draw(&Text::new(name, to_pair(place), style))?;
    Ok(())
}

pub(super) fn to_pair(p: Point2<f64>) -> (f64, f64) {
    (p.x, p.y)
}

/// The outline of the ellipse of 95 %, so many times larger than it is.
pub(super) fn ellipse(pose: &Pose<f64>, times: f64) -> Vec<Point2<f64>> {
    const CORNERS: u8 = 48;
    let ellipse = pose.ellipse(0.95);
    let turn = Rotation2::new(ellipse.angle);
    (0..CORNERS)
        .map(|k| {
            let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / f64::from(CORNERS)).sin_cos();
            let corner = Vector2::new(cos * ellipse.semi_major, sin * ellipse.semi_minor);
            pose.position + turn * corner * times
        })
        .collect()
}
