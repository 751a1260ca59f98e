//! Parts common to all drawings: paper, colours, shapes, a title with a legend, axes. All in pixels, y
//! downwards; [`Plane`] tells where values are.

use std::fmt::Display;

use nalgebra::{Point2, Vector2};
use svg::{
    Document,
    node::{
        Node, Text, Value,
        element::{Element, SVG},
    },
};

use super::PlotError;

pub(super) type Colour = &'static str;

pub(super) const CAMERA: Colour = "#0068A8";
pub(super) const TARGET: Colour = "#E66E14";
pub(super) const BAD: Colour = "#C81E32";
pub(super) const INK: Colour = "#323232";
pub(super) const GREY: Colour = "#969696";
const GRID: Colour = "#E1E1E1";

/// Room above a plane for title and legend, and on its other sides.
pub(super) const HEAD: f64 = 76.0;
pub(super) const LEFT: f64 = 76.0;
pub(super) const RIGHT: f64 = 28.0;
pub(super) const BELOW: f64 = 58.0;

/// Larger numbers than these are not seen anyway, and not every viewer takes them.
const FAR: f64 = 1e5;

/// A length or coordinate as it stands in the file.
fn px(value: f64) -> f64 {
    (value.clamp(-FAR, FAR) * 100.0).round() / 100.0 + 0.0
}

/// Shape that marks a thing: neither colour nor shape alone has to tell.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Mark {
    Dot,
    Ring,
    Diamond,
    Triangle,
    Cross,
}

impl Mark {
    pub(super) fn draw(self, at: Point2<f64>, radius: f64, colour: Colour) -> Shape {
        let corners = |places: &[[f64; 2]]| -> Vec<Point2<f64>> {
            let corners = places
                .iter()
                .map(|&place| at + Vector2::from(place) * radius);
            corners.collect()
        };
        match self {
            Self::Dot => dot(at, radius, colour),
            Self::Ring => ring(at, radius, colour).set("fill", "white"),
            Self::Diamond => {
                let rhomb = [[0.0, -1.4], [1.4, 0.0], [0.0, 1.4], [-1.4, 0.0]];
                area(&corners(&rhomb), colour, [1.0, 0.0])
            }
            Self::Triangle => {
                let triangle = [[0.0, -1.6], [1.5, 1.0], [-1.5, 1.0]];
                area(&corners(&triangle), colour, [1.0, 0.0])
            }
            Self::Cross => {
                let strokes = [
                    [-1.0, -1.0],
                    [1.0, 1.0],
                    [0.0, 0.0],
                    [1.0, -1.0],
                    [-1.0, 1.0],
                ];
                line(&corners(&strokes), colour, 2.0)
            }
        }
    }
}

/// A part of a drawing.
pub(super) struct Shape(Element);

impl Shape {
    fn new(name: &str, numbers: &[(&str, f64)]) -> Self {
        let numbers = numbers.iter();
        numbers.fold(Self(Element::new(name)), |shape, &(name, value)| {
            shape.set(name, px(value))
        })
    }

    pub(super) fn set(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.0.assign(name, value);
        self
    }

    fn turn(self, degrees: f64, about: Point2<f64>) -> Self {
        let turn = [degrees, about.x, about.y].map(|v| px(v).to_string());
        self.set("transform", format!("rotate({})", turn.join(" ")))
    }

    fn opaque(self, colour: Colour, [inside, border]: [f64; 2]) -> Self {
        self.set("fill", colour)
            .set("fill-opacity", inside)
            .set("stroke", colour)
            .set("stroke-opacity", border)
    }
}

pub(super) fn dot(at: Point2<f64>, radius: f64, colour: Colour) -> Shape {
    Shape::new("circle", &[("cx", at.x), ("cy", at.y), ("r", radius)]).set("fill", colour)
}

pub(super) fn ring(at: Point2<f64>, radius: f64, colour: Colour) -> Shape {
    let ring = dot(at, radius, "none").set("stroke", colour);
    ring.set("stroke-width", 1.5)
}

fn through(name: &str, corners: &[Point2<f64>]) -> Shape {
    let corners = corners.iter();
    let corners = corners.map(|corner| format!("{},{}", px(corner.x), px(corner.y)));
    Shape::new(name, &[]).set("points", corners.collect::<Vec<_>>())
}

pub(super) fn line(corners: &[Point2<f64>], colour: Colour, width: f64) -> Shape {
    let line = through("polyline", corners).set("fill", "none");
    line.set("stroke", colour).set("stroke-width", width)
}

/// A filled outline: how opaque its inside and its border are.
pub(super) fn area(corners: &[Point2<f64>], colour: Colour, opaque: [f64; 2]) -> Shape {
    through("polygon", corners).opaque(colour, opaque)
}

/// An ellipse by its half axes, the first one so many degrees clockwise of x.
pub(super) fn ellipse(
    at: Point2<f64>,
    half: [f64; 2],
    degrees: f64,
    colour: Colour,
    inside: f64,
) -> Shape {
    let numbers = [("cx", at.x), ("cy", at.y), ("rx", half[0]), ("ry", half[1])];
    let ellipse = Shape::new("ellipse", &numbers).turn(degrees, at);
    ellipse.opaque(colour, [inside, 0.8])
}

/// A filled box between two corners.
pub(super) fn bar(a: Point2<f64>, b: Point2<f64>, colour: Colour, opaque: f64) -> Shape {
    let (low, size) = (a.inf(&b), (b - a).abs());
    let numbers = [
        ("x", low.x),
        ("y", low.y),
        ("width", size.x),
        ("height", size.y),
    ];
    let bar = Shape::new("rect", &numbers).set("fill", colour);
    bar.set("fill-opacity", opaque)
}

/// Text with its middle at a place.
pub(super) fn text(content: impl Display, at: Point2<f64>, size: f64) -> Shape {
    // No XML may contain control characters; names come from records, and those from anywhere.
    let mut content = content.to_string();
    content.retain(|c| !(c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}')));
    let mut text = Shape::new("text", &[("x", at.x), ("y", at.y), ("font-size", size)]);
    text.0.append(Text::new(content));
    text.set("dy", "0.35em")
        .set("text-anchor", "middle")
        .set("fill", INK)
}

/// One entry of a legend, without a mark for a remark.
pub(super) struct Entry {
    text: String,
    mark: Option<(Mark, Colour)>,
}

impl Entry {
    pub(super) fn new(text: impl Display, mark: Mark, colour: Colour) -> Self {
        Self {
            text: text.to_string(),
            mark: Some((mark, colour)),
        }
    }

    pub(super) fn dot(text: impl Display, colour: Colour) -> Self {
        Self::new(text, Mark::Dot, colour)
    }

    pub(super) fn remark(text: impl Display) -> Self {
        Self {
            text: text.to_string(),
            mark: None,
        }
    }
}

/// A drawing in the making.
pub(super) struct Canvas(Document);

impl Canvas {
    /// White paper with a title and a legend above everything else, where they hide nothing.
    pub(super) fn new([width, height]: [f64; 2], title: &str, legend: &[Entry]) -> Self {
        let mut canvas = Self(
            Document::new()
                .set("width", width)
                .set("height", height)
                .set("viewBox", (0.0, 0.0, width, height))
                .set("font-family", "sans-serif"),
        );
        let corners = [Point2::origin(), Point2::new(width, height)];
        canvas.add(bar(corners[0], corners[1], "white", 1.0));
        canvas.add(text(title, Point2::new(LEFT, 24.0), 20.0).set("text-anchor", "start"));
        // Text is not measured: so many pixels a letter, about, at this size.
        let wide = |entry: &Entry| {
            let mark = if entry.mark.is_some() { 16.0 } else { 0.0 };
            mark + entry.text.chars().count() as f64 * 6.7
        };
        let mut at = Point2::new(LEFT, 45.0);
        for entry in legend {
            if at.x > LEFT && at.x + wide(entry) > width {
                at = Point2::new(LEFT, at.y + 19.0);
            }
            let mut start = at;
            if let Some((mark, colour)) = entry.mark {
                canvas.add(mark.draw(at + Vector2::new(5.0, 0.0), 4.5, colour));
                start.x += 16.0;
            }
            canvas.add(text(&entry.text, start, 13.0).set("text-anchor", "start"));
            at.x += wide(entry) + 18.0;
        }
        canvas
    }

    pub(super) fn add(&mut self, part: Shape) {
        self.0.append(part.0);
    }

    /// Axes with their grid, and the plane that they span from its upper left corner.
    pub(super) fn plane(
        &mut self,
        corner: Point2<f64>,
        size: Vector2<f64>,
        [x, y]: [Axis<'_>; 2],
    ) -> Result<Plane, PlotError> {
        if ![x, y].iter().all(|axis| axis.span().is_normal()) {
            return Err(PlotError::Span);
        }
        let plane = Plane {
            corner,
            size,
            low: Point2::new(x.low, y.low),
            high: Point2::new(x.high, y.high),
            // With places as on the paper, it cuts off what is beyond its borders.
            parts: [
                ("x", corner.x),
                ("y", corner.y),
                ("width", size.x),
                ("height", size.y),
            ]
            .into_iter()
            .fold(SVG::new(), |svg, (name, value)| svg.set(name, px(value)))
            .set(
                "viewBox",
                [corner.x, corner.y, size.x, size.y].map(px).to_vec(),
            ),
        };
        let end = corner + size;
        for (value, number) in x.ticks() {
            let place = plane.at(value, y.low);
            let top = Point2::new(place.x, corner.y);
            self.add(line(&[top, place], GRID, 1.0));
            self.add(text(number, place + Vector2::new(0.0, 14.0), 13.0));
        }
        for (value, number) in y.ticks() {
            let place = plane.at(x.low, value);
            self.add(line(&[place, Point2::new(end.x, place.y)], GRID, 1.0));
            let number = text(number, place - Vector2::new(7.0, 0.0), 13.0);
            self.add(number.set("text-anchor", "end"));
        }
        let middle = corner + size / 2.0;
        self.add(text(x.name, Point2::new(middle.x, end.y + 36.0), 14.0));
        let beside = Point2::new(corner.x - 58.0, middle.y);
        self.add(text(y.name, beside, 14.0).turn(-90.0, beside));
        let lower_left = Point2::new(corner.x, end.y);
        self.add(line(&[corner, lower_left, end], INK, 1.0));
        Ok(plane)
    }

    /// The drawing with these planes on it.
    pub(super) fn finish(mut self, planes: impl IntoIterator<Item = Plane>) -> String {
        for plane in planes {
            self.0.append(plane.parts);
        }
        self.0.to_string()
    }
}

/// One axis of a plane.
#[derive(Clone, Copy)]
pub(super) struct Axis<'a> {
    pub(super) name: &'a str,
    pub(super) low: f64,
    pub(super) high: f64,
    /// About how many numbers stand beside it.
    pub(super) ticks: f64,
}

impl Axis<'_> {
    fn span(&self) -> f64 {
        self.high - self.low
    }

    /// Round values with their texts.
    fn ticks(&self) -> impl Iterator<Item = (f64, String)> + use<> {
        let wanted = self.span() / self.ticks;
        let power = wanted.log10().floor();
        let step = [1.0, 2.0, 5.0, 10.0].map(|step| step * 10_f64.powf(power));
        let step = step.into_iter().find(|step| *step >= wanted * 0.999);
        let step = step.unwrap_or(wanted);
        let digits = (-(step * 1.001).log10().floor()).clamp(0.0, 12.0) as usize;
        let (first, last) = ((self.low / step).ceil(), (self.high / step).floor());
        let count = if self.ticks > 0.0 {
            last - first + 1.0
        } else {
            0.0
        };
        (0..count as u32).map(move |k| {
            let value = (first + f64::from(k)) * step;
            let text = if value.abs() < 1e7 {
                format!("{value:.digits$}")
            } else {
                format!("{value:e}")
            };
            (value, text)
        })
    }
}

/// Plane on which things are drawn at places in the world, or at values. Things beyond its borders are not
/// seen.
pub(super) struct Plane {
    corner: Point2<f64>,
    size: Vector2<f64>,
    low: Point2<f64>,
    high: Point2<f64>,
    parts: SVG,
}

impl Plane {
    pub(super) fn at(&self, x: f64, y: f64) -> Point2<f64> {
        let share = (Point2::new(x, y) - self.low).component_div(&(self.high - self.low));
        let down = Vector2::new(share.x, 1.0 - share.y).component_mul(&self.size);
        self.corner + down
    }

    pub(super) fn place(&self, place: Point2<f64>) -> Point2<f64> {
        self.at(place.x, place.y)
    }

    pub(super) fn add(&mut self, part: Shape) {
        self.parts.append(part.0);
    }

    /// A line from the left to the right.
    pub(super) fn level(&mut self, y: f64, colour: Colour) {
        let ends = [self.at(self.low.x, y), self.at(self.high.x, y)];
        self.add(line(&ends, colour, 1.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        for (low, high, expected) in [
            (-0.3, 10.2, vec!["0", "2", "4", "6", "8", "10"]),
            (
                0.0,
                0.1,
                vec!["0.00", "0.02", "0.04", "0.06", "0.08", "0.10"],
            ),
            (995.0, 1005.5, vec!["996", "998", "1000", "1002", "1004"]),
        ] {
            let axis = Axis {
                name: "",
                low,
                high,
                ticks: 6.0,
            };
            let texts: Vec<String> = axis.ticks().map(|(_, text)| text).collect();
            assert_eq!(texts, expected);
        }
    }
}
