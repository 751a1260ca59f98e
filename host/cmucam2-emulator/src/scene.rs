//! Objects and background before the camera.
//!
//! A scene is painted from back to front: first the background, then each [`Object`] over those before it, so an
//! occluder is an object that comes later. The picture is described in fractions of its width and height, so that
//! the same scene serves every sensor and resolution. A caller that knows bearings converts them with a [`Lens`];
//! a simulation of a network sets the [`Place::At`] of each object before a frame is due.

use std::sync::Arc;

use serde::Deserialize;

use super::{
    lens::{Lens, Pose},
    picture::Picture,
};

/// Red, green and blue, as the sensor would measure them at unit gain in white light.
pub type Rgb = [u8; 3];

/// A part of the picture: 0 is its left or upper edge, 1 its right or lower one. It may reach
/// beyond the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Left edge.
    pub left: f64,
    /// Upper edge.
    pub top: f64,
    /// Right edge.
    pub right: f64,
    /// Lower edge.
    pub bottom: f64,
}

impl Extent {
    /// From the middle and the full width and height.
    pub fn centred(x: f64, y: f64, width: f64, height: f64) -> Self {
        Self {
            left: x - width / 2.0,
            top: y - height / 2.0,
            right: x + width / 2.0,
            bottom: y + height / 2.0,
        }
    }

    /// From the first and last columns and rows, counted from 0 and both inside, of a frame of
    /// that size.
    pub fn of_pixels(columns: [f64; 2], rows: [f64; 2], width: f64, height: f64) -> Self {
        Self {
            left: columns[0] / width,
            top: rows[0] / height,
            right: (columns[1] + 1.0) / width,
            bottom: (rows[1] + 1.0) / height,
        }
    }

    /// The same, moved.
    #[must_use]
    pub fn moved(self, right: f64, down: f64) -> Self {
        Self {
            left: self.left + right,
            top: self.top + down,
            right: self.right + right,
            bottom: self.bottom + down,
        }
    }
}

/// Outline of an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// The ellipse that fills its extent.
    #[default]
    Disc,
    /// All of its extent.
    Box,
    /// A tag of this number that fills its extent. To a camera that looks for colours: a box.
    Tag(u16),
}

/// Meaning of the numbers of a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// Middle x and y, width, height, in fractions of the picture.
    Picture,
    /// Bearing (positive to the left), elevation, full width and height as seen; radians.
    Angles(Lens),
    /// x, y, height above the ground, radius; in the units of the pose.
    World(Lens, Pose),
}

impl Form {
    /// Extent of that place in the picture; `None` behind the camera.
    pub fn extent(&self, numbers: [f64; 4]) -> Option<Extent> {
        let [a, b, c, d] = numbers;
        match self {
            Self::Picture => Some(Extent::centred(a, b, c, d)),
            Self::Angles(lens) => lens.extent(a, b, c, d),
            Self::World(lens, pose) => lens.extent_of_ball(pose, [a, b, c], d),
        }
    }
}

/// A way through places at times.
#[derive(Clone, Debug, PartialEq)]
pub struct Way {
    /// Meaning of the numbers.
    pub form: Form,
    /// Seconds since the start, ascending, and the place at that time. Between two, the object
    /// moves uniformly; before the first and after the last it stands.
    pub stops: Vec<(f64, [f64; 4])>,
    /// After the last stop it begins anew with the first.
    pub repeat: bool,
}

impl Way {
    fn extent(&self, at: f64) -> Option<Extent> {
        let (first, last) = (self.stops.first()?, self.stops.last()?);
        let at = if self.repeat && last.0 > 0.0 {
            at % last.0
        } else {
            at
        };
        let next = self.stops.partition_point(|stop| stop.0 <= at);
        let numbers = match next
            .checked_sub(1)
            .and_then(|before| self.stops.get(before))
        {
            None => first.1,
            Some(before) => match self.stops.get(next) {
                None => last.1,
                Some(after) => {
                    let share = (at - before.0) / (after.0 - before.0);
                    std::array::from_fn(|i| before.1[i] + share * (after.1[i] - before.1[i]))
                }
            },
        };
        self.form.extent(numbers)
    }
}

/// Place of an object.
#[derive(Clone, Debug, PartialEq)]
pub enum Place {
    /// Nowhere in view.
    Hidden,
    /// Here, until it is moved.
    At(Extent),
    /// On its way.
    Moving(Way),
}

/// Something with a colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Its colour.
    pub colour: Rgb,
    /// Its outline.
    pub shape: Shape,
    /// Its place.
    pub place: Place,
}

/// Background, behind all objects.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Background {
    /// One colour.
    Plain(Rgb),
    /// From the upper edge to the lower one.
    Gradient {
        /// At the upper edge.
        top: Rgb,
        /// At the lower edge.
        bottom: Rgb,
    },
    /// Blocks in columns; row by row their colours, which begin anew when they are used up.
    Blocks {
        /// Number of blocks side by side.
        columns: u16,
        /// Number of blocks above one another.
        rows: u16,
        /// Their colours.
        colours: Vec<Rgb>,
    },
    /// Picture of another camera, all of it.
    #[serde(skip)]
    Picture(Arc<Picture>),
}

impl Default for Background {
    /// A grey wall.
    fn default() -> Self {
        Self::Plain([110, 110, 110])
    }
}

impl Background {
    /// The colour at a place of the picture, in fractions of its width and height.
    pub fn colour(&self, x: f64, y: f64) -> [f64; 3] {
        match self {
            Self::Plain(colour) => colour.map(f64::from),
            Self::Gradient { top, bottom } => std::array::from_fn(|channel| {
                let (top, bottom) = (f64::from(top[channel]), f64::from(bottom[channel]));
                top + (bottom - top) * y.clamp(0.0, 1.0)
            }),
            Self::Blocks {
                columns,
                rows,
                colours,
            } => {
                let place = |share: f64, count: u16| {
                    ((share * f64::from(count)) as usize).min(usize::from(count.max(1)) - 1)
                };
                let index = place(y, *rows) * usize::from(*columns) + place(x, *columns);
                match colours.len() {
                    0 => [0.0; 3],
                    len => colours[index % len].map(f64::from),
                }
            }
            Self::Picture(picture) => picture.colour(x, y),
        }
    }

    /// Returns true if the colour changes along a row.
    pub(super) fn varies_along_rows(&self) -> bool {
        matches!(self, Self::Blocks { .. } | Self::Picture(_))
    }
}

/// Everything before the camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Behind all objects.
    pub background: Background,
    /// From back to front.
    pub objects: Vec<Object>,
    /// Colour of the light: each channel of everything is multiplied by it.
    pub light: [f64; 3],
    /// Standard deviation of each pixel's noise, levels. Three times that is the greatest.
    pub noise: f64,
    /// Change of the light from frame to frame, as a fraction of itself.
    pub flicker: f64,
    /// Part of its width by which the picture moves when the pan servo makes a step; 0 for a camera that is not
    /// mounted on the servos.
    pub servo_step: f64,
}

impl Default for Scene {
    /// A grey wall in white light, no noise.
    fn default() -> Self {
        Self {
            background: Background::default(),
            objects: Vec::new(),
            light: [1.0; 3],
            noise: 0.0,
            flicker: 0.0,
            servo_step: 0.0,
        }
    }
}

/// An object as it is seen in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Its place.
    pub extent: Extent,
    /// Its outline.
    pub shape: Shape,
    /// Its colour in white light.
    pub colour: Rgb,
}

impl Patch {
    /// Left and right end of the object at a height, but for rounding.
    pub(super) fn span(&self, y: f64) -> Option<[f64; 2]> {
        let Extent {
            left,
            top,
            right,
            bottom,
        } = self.extent;
        if y < top || y >= bottom {
            return None;
        }
        match self.shape {
            Shape::Box | Shape::Tag(_) => Some([left, right]),
            Shape::Disc => {
                let down = (2.0 * y - top - bottom) / (bottom - top);
                let share = (1.0 - down * down).max(0.0).sqrt();
                let (middle, half) = (f64::midpoint(left, right), (right - left) / 2.0);
                Some([middle - half * share, middle + half * share])
            }
        }
    }

    /// Returns true if a place of the picture, in fractions of its width and height, is within its outline.
    pub fn covers(&self, x: f64, y: f64) -> bool {
        let Extent {
            left,
            top,
            right,
            bottom,
        } = self.extent;
        if x < left || x >= right || y < top || y >= bottom {
            return false;
        }
        match self.shape {
            Shape::Box | Shape::Tag(_) => true,
            Shape::Disc => {
                let across = (2.0 * x - left - right) / (right - left);
                let down = (2.0 * y - top - bottom) / (bottom - top);
                across * across + down * down <= 1.0
            }
        }
    }
}

impl Scene {
    /// A grey wall with one object before it.
    pub fn with_object(colour: Rgb, shape: Shape, extent: Extent) -> Self {
        Self {
            objects: vec![Object {
                colour,
                shape,
                place: Place::At(extent),
            }],
            ..Self::default()
        }
    }

    /// The scene as a picture of so many pixels at a time, seconds since the start, in its own light:
    /// no sensor adapts, and there is neither noise nor flicker. `None` without pixels, or with more
    /// than 2^24.
    pub fn picture(&self, at: f64, width: usize, height: usize) -> Option<Picture> {
        let patches: Vec<Patch> = self.patches(at).collect();
        let place = |index: usize, count: usize| (index as f64 + 0.5) / count as f64;
        let mut pixels = Vec::new();
        // Neighbours are often alike.
        let mut last = ([0.0; 3], Rgb::default());
        for y in 0..height {
            let y = place(y, height);
            for x in 0..width {
                let x = place(x, width);
                let patch = patches.iter().rev().find(|patch| patch.covers(x, y));
                let colour = patch.map_or_else(
                    || self.background.colour(x, y),
                    |patch| patch.colour.map(f64::from),
                );
                if colour != last.0 {
                    // Saturating casts.
                    let lit =
                        |channel: usize| (colour[channel] * self.light[channel]).round() as u8;
                    last = (colour, std::array::from_fn(lit));
                }
                pixels.push(last.1);
            }
        }
        Picture::from_rgb(width, height, &pixels)
    }

    /// Objects in view at a time, seconds since the start, from back to front.
    pub fn patches(&self, at: f64) -> impl Iterator<Item = Patch> + '_ {
        self.objects.iter().filter_map(move |object| {
            let extent = match &object.place {
                Place::Hidden => None,
                Place::At(extent) => Some(*extent),
                Place::Moving(way) => way.extent(at),
            }?;
            let in_view =
                extent.right > 0.0 && extent.left < 1.0 && extent.bottom > 0.0 && extent.top < 1.0;
            in_view.then_some(Patch {
                extent,
                shape: object.shape,
                colour: object.colour,
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_is_walked_uniformly_and_again() {
        let way = Way {
            form: Form::Picture,
            stops: vec![(1.0, [0.0, 0.5, 0.1, 0.1]), (3.0, [1.0, 0.5, 0.1, 0.1])],
            repeat: true,
        };
        let middle = |at| {
            let extent = way.extent(at).unwrap();
            f64::midpoint(extent.left, extent.right)
        };
        for (at, x) in [(0.0, 0.0), (1.0, 0.0), (2.0, 0.5), (2.5, 0.75), (5.5, 0.75)] {
            assert!((middle(at) - x).abs() < 1e-12, "at {at}");
        }
    }

    #[test]
    fn blocks_follow_one_another_along_the_rows() {
        let blocks = Background::Blocks {
            columns: 2,
            rows: 2,
            colours: vec![[1; 3], [2; 3], [3; 3]],
        };
        let level = |x, y| blocks.colour(x, y)[0];
        assert_eq!(
            [
                level(0.0, 0.0),
                level(0.9, 0.1),
                level(0.2, 0.7),
                level(1.0, 1.0)
            ],
            [1.0, 2.0, 3.0, 1.0]
        );
    }
}
