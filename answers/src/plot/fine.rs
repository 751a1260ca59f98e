//! Drawing on a grid finer than pixels: the drawing library knows whole numbers only, and small
//! ellipses with corners at whole pixels are lumpy.
//!
//! Places are on the fine grid, as are lengths that the library computes with: [`fine`] makes them.
//! Radii, widths of strokes and sizes of letters are in pixels and made finer here.

use plotters::prelude::{DrawingBackend, SVGBackend};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingErrorKind, FontFamily,
    FontStyle, FontTransform, text_anchor,
};

/// Grid lines per pixel.
const FINENESS: u32 = 8;

/// So many pixels on the grid.
pub(super) const fn fine(pixels: u32) -> u32 {
    pixels * FINENESS
}

/// An SVG drawing on the fine grid.
pub(super) struct Fine<'a>(SVGBackend<'a>);

impl<'a> Fine<'a> {
    /// A drawing of a size in pixels, into this text; [`sized`] makes it complete.
    pub(super) fn new(text: &'a mut String, (width, height): (u32, u32)) -> Self {
        Self(SVGBackend::with_string(text, (fine(width), fine(height))))
    }
}

/// Gives a drawing its size in pixels; its view box remains that of the grid.
pub(super) fn sized(text: &str, (width, height): (u32, u32)) -> String {
    let attributes = |width, height| format!("width=\"{width}\" height=\"{height}\"");
    let grid = attributes(fine(width), fine(height));
    text.replacen(&grid, &attributes(width, height), 1)
}

/// A style whose lengths are on the fine grid.
struct Finer<'s, S>(&'s S);

impl<S: BackendStyle> BackendStyle for Finer<'_, S> {
    fn color(&self) -> BackendColor {
        self.0.color()
    }

    fn stroke_width(&self) -> u32 {
        fine(self.0.stroke_width())
    }
}

impl<S: BackendTextStyle> BackendTextStyle for Finer<'_, S> {
    type FontError = S::FontError;

    fn color(&self) -> BackendColor {
        self.0.color()
    }

    fn size(&self) -> f64 {
        self.0.size() * f64::from(FINENESS)
    }

    fn transform(&self) -> FontTransform {
        self.0.transform()
    }

    fn style(&self) -> FontStyle {
        self.0.style()
    }

    fn anchor(&self) -> text_anchor::Pos {
        self.0.anchor()
    }

    fn family(&self) -> FontFamily<'_> {
        self.0.family()
    }

    fn layout_box(&self, text: &str) -> Result<((i32, i32), (i32, i32)), Self::FontError> {
        let finer = |(x, y)| (x * FINENESS as i32, y * FINENESS as i32);
        let (low, high) = self.0.layout_box(text)?;
        Ok((finer(low), finer(high)))
    }

    fn draw<E, D>(
        &self,
        text: &str,
        at: BackendCoord,
        draw: D,
    ) -> Result<Result<(), E>, S::FontError>
    where
        D: FnMut(i32, i32, BackendColor) -> Result<(), E>,
    {
        self.0.draw(text, at, draw)
    }
}

type Drawn<'a> = Result<(), DrawingErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

impl<'a> DrawingBackend for Fine<'a> {
    type ErrorType = <SVGBackend<'a> as DrawingBackend>::ErrorType;

    fn get_size(&self) -> (u32, u32) {
        self.0.get_size()
    }

    fn ensure_prepared(&mut self) -> Drawn<'a> {
        self.0.ensure_prepared()
    }

    fn present(&mut self) -> Drawn<'a> {
        self.0.present()
    }

    fn draw_pixel(&mut self, point: BackendCoord, color: BackendColor) -> Drawn<'a> {
        self.0.draw_pixel(point, color)
    }

    fn draw_line<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
    ) -> Drawn<'a> {
        self.0.draw_line(from, to, &Finer(style))
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        upper_left: BackendCoord,
        bottom_right: BackendCoord,
        style: &S,
        fill: bool,
    ) -> Drawn<'a> {
        self.0
            .draw_rect(upper_left, bottom_right, &Finer(style), fill)
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Drawn<'a> {
        self.0.draw_path(path, &Finer(style))
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        center: BackendCoord,
        radius: u32,
        style: &S,
        fill: bool,
    ) -> Drawn<'a> {
        self.0
            .draw_circle(center, fine(radius), &Finer(style), fill)
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> Drawn<'a> {
        self.0.fill_polygon(corners, &Finer(style))
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        at: BackendCoord,
    ) -> Drawn<'a> {
        self.0.draw_text(text, &Finer(style), at)
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Self::ErrorType>> {
        self.0.estimate_text_size(text, &Finer(style))
    }
}
