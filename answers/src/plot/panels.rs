//! Panels below each other, with one place per camera from left to right.

use std::{error::Error, ops::Range};

use plotters::{
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

use super::{
    fine::fine,
    frame::{FONT, GRID, HEAD, INK, LEFT, Plane, RIGHT, Root, TICK, Y_LABELS, short},
};

/// Height of a panel and of the names below it, pixels.
const HEIGHT: u32 = 230;
const NAMES: u32 = 34;
/// What a name needs at least, pixels.
const NAME_WIDTH: f64 = 26.0;
const NARROWEST: u32 = 640;
const WIDEST: u32 = 1100;

/// A row of panels: how many things they show side by side.
pub(super) struct Panels {
    pub(super) count: u32,
    names: Vec<String>,
    width: u32,
}

impl Panels {
    /// So many panels over these names.
    pub(super) fn new(count: u32, names: Vec<String>) -> Self {
        let wanted = names.len().min(1000) as u32 * 44;
        Self {
            count,
            names,
            width: wanted.clamp(NARROWEST, WIDEST),
        }
    }

    /// Size of the drawing, pixels.
    pub(super) fn size(&self) -> (u32, u32) {
        (
            self.width + LEFT + Y_LABELS + RIGHT,
            HEAD + self.count * (HEIGHT + NAMES) + LEFT,
        )
    }

    /// How wide one thing is, pixels.
    pub(super) fn pitch(&self) -> f64 {
        f64::from(self.width) / self.names.len().max(1) as f64
    }

    fn area<'a>(&self, root: &Root<'a>, place: u32) -> Root<'a> {
        let (_, height) = self.size();
        let top = HEAD + place * (HEIGHT + NAMES);
        root.clone()
            .margin(fine(top), fine(height - top - HEIGHT - NAMES), 0, 0)
    }

    /// The panel at a place from above, x being 0, 1, 2 for the things by name.
    pub(super) fn panel<'a>(
        &self,
        root: &Root<'a>,
        place: u32,
        y_desc: &str,
        y: Range<f64>,
    ) -> Result<Plane<'a>, Box<dyn Error>> {
        let last = self.names.len().max(1) as f64 - 0.5;
        let plane = axes(
            &self.area(root, place),
            "",
            -0.5..last,
            (y_desc, y.clone()),
            0,
        )?;
        let every = (NAME_WIDTH / self.pitch()).ceil().max(1.0) as usize;
        let style = TextStyle::from((FONT, 13).into_font())
            .color(&INK)
            .pos(Pos::new(HPos::Center, VPos::Top));
        let (_, y_pixels) = plane.get_pixel_range();
        for (place, name) in self.names.iter().enumerate().step_by(every) {
            let (x, _) = plane.map_coordinate(&(place as f64, y.start));
            root.draw(&Text::new(
                name.as_str(),
                (x, y_pixels.end + fine(6) as i32),
                style.clone(),
            ))?;
        }
        Ok(plane)
    }

    /// A panel with an axis of its own.
    pub(super) fn free_panel<'a>(
        &self,
        root: &Root<'a>,
        place: u32,
        (x_desc, x): (&str, Range<f64>),
        y: (&str, Range<f64>),
    ) -> Result<Plane<'a>, Box<dyn Error>> {
        axes(&self.area(root, place), x_desc, x, y, 11)
    }
}

fn axes<'a>(
    area: &Root<'a>,
    x_desc: &str,
    x: Range<f64>,
    (y_desc, y): (&str, Range<f64>),
    x_labels: usize,
) -> Result<Plane<'a>, Box<dyn Error>> {
    let mut chart = ChartBuilder::on(area)
        .margin_right(fine(RIGHT))
        .margin_left(fine(LEFT))
        .margin_top(fine(8))
        .x_label_area_size(fine(NAMES + 2))
        .y_label_area_size(fine(Y_LABELS))
        .build_cartesian_2d(x, y.clone())?;
    let digits = (2.0 - (y.end - y.start).log10()).clamp(0.0, 12.0) as usize;
    let mut mesh = chart.configure_mesh();
    let tick = |value: &f64| short(*value, digits);
    let x_tick = |value: &f64| short(*value, 1);
    mesh.set_all_tick_mark_size(fine(TICK))
        .y_desc(y_desc)
        .x_desc(x_desc)
        .axis_desc_style((FONT, 14).into_font().color(&INK))
        .label_style((FONT, 12).into_font().color(&INK))
        .x_labels(x_labels)
        .y_labels(7)
        .y_label_formatter(&tick)
        .x_label_formatter(&x_tick)
        .bold_line_style(GRID)
        .light_line_style(TRANSPARENT)
        .axis_style(INK);
    if x_labels == 0 {
        mesh.disable_x_mesh();
    }
    mesh.draw()?;
    Ok(chart.plotting_area().clone())
}

/// A horizontal line.
pub(super) fn level(plane: &Plane<'_>, y: f64, colour: RGBColor) -> Result<(), Box<dyn Error>> {
    let range = plane.get_x_range();
    plane.draw(&PathElement::new(
        [(range.start, y), (range.end, y)],
        colour,
    ))?;
    Ok(())
}

/// A filled box.
pub(super) fn bar(
    plane: &Plane<'_>,
    x: f64,
    half_width: f64,
    (low, high): (f64, f64),
    style: impl Into<ShapeStyle>,
) -> Result<(), Box<dyn Error>> {
    let corners = [(x - half_width, low), (x + half_width, high)];
    plane.draw(&Rectangle::new(corners, style))?;
    Ok(())
}
