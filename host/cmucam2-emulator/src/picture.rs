//! Pictures of other cameras, scaled to what a sensor would have seen.

use super::scene::Rgb;

/// Darkest and brightest luminance of ordinary video.
const LUMINANCE: [f64; 2] = [16.0, 235.0];
/// Span of its chrominance about its middle.
const CHROMINANCE_SPAN: f64 = 224.0;
const CHROMINANCE_MIDDLE: f64 = 128.0;

/// Most samples of a plane: sums of all of them fit 32 bits.
const SAMPLES_MAX: usize = 1 << 24;

/// One of the three components of a picture, row by row from the upper left corner.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plane {
    width: usize,
    height: usize,
    samples: Vec<u8>,
}

impl Plane {
    /// `None` unless there are `width` times `height` samples, and from 1 to 2^24 of them.
    pub fn new(width: usize, height: usize, samples: Vec<u8>) -> Option<Self> {
        let count = width.checked_mul(height)?;
        ((1..=SAMPLES_MAX).contains(&count) && samples.len() == count).then_some(Self {
            width,
            height,
            samples,
        })
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All of them.
    pub fn samples(&self) -> &[u8] {
        &self.samples
    }

    /// At a place in fractions of width and height.
    fn at(&self, x: f64, y: f64) -> f64 {
        // Saturating casts.
        let place = |share: f64, count: usize| ((share * count as f64) as usize).min(count - 1);
        let index = place(y, self.height) * self.width + place(x, self.width);
        self.samples.get(index).copied().map_or(0.0, f64::from)
    }

    /// The same with other numbers of columns and rows, at least one of each: every sample is the mean
    /// of what it covers.
    #[must_use]
    pub fn scaled(&self, width: u16, height: u16) -> Self {
        let [columns, rows] = [width, height].map(|count| usize::from(count.max(1)));
        if (columns, rows) == (self.width, self.height) {
            return self.clone();
        }
        let across = shares(self.width, columns);
        let mut sums = vec![0_u64; columns * rows];
        let mut line = vec![0_u32; columns];
        let down = shares(self.height, rows);
        let mut row_of = vec![Vec::new(); self.height];
        for (row, share) in down.iter().enumerate() {
            for (from, weight) in share.weights() {
                row_of[from].push((row, u64::from(weight)));
            }
        }
        for (samples, to) in self.samples.chunks_exact(self.width).zip(&row_of) {
            for (sum, share) in line.iter_mut().zip(&across) {
                *sum = share.sum(samples);
            }
            for &(row, weight) in to {
                let sums = &mut sums[row * columns..][..columns];
                for (sum, &part) in sums.iter_mut().zip(&line) {
                    *sum += weight * u64::from(part);
                }
            }
        }
        let all = (self.width * self.height) as u64;
        let samples = sums.iter().map(|sum| ((sum + all / 2) / all) as u8);
        Self {
            width: columns,
            height: rows,
            samples: samples.collect(),
        }
    }
}

/// Part of `from` samples that one of `to` samples covers. The weights of all that it covers are `from`.
struct Share {
    /// The first and the last sample that are touched, which may be the same one.
    first: usize,
    last: usize,
    first_weight: u32,
    last_weight: u32,
    /// Weight of those between.
    weight: u32,
}

fn shares(from: usize, to: usize) -> Vec<Share> {
    // In units of which a sample of the source has `to`, and one of the result `from`.
    let of = |index: usize| {
        let (begin, end) = (index * from, (index + 1) * from);
        let (first, last) = (begin / to, (end - 1) / to);
        let first_end = ((first + 1) * to).min(end);
        Share {
            first,
            last,
            first_weight: (first_end - begin) as u32,
            last_weight: if last > first { end - last * to } else { 0 } as u32,
            weight: to as u32,
        }
    };
    (0..to).map(of).collect()
}

impl Share {
    fn sum(&self, samples: &[u8]) -> u32 {
        let one = |index: usize| samples.get(index).copied().map_or(0, u32::from);
        let between = samples.get(self.first + 1..self.last).unwrap_or_default();
        let between: u32 = between.iter().copied().map(u32::from).sum();
        one(self.first) * self.first_weight
            + between * self.weight
            + one(self.last) * self.last_weight
    }

    fn weights(&self) -> impl Iterator<Item = (usize, u32)> {
        let inner = (self.first + 1..self.last).map(|index| (index, self.weight));
        let last = (self.last > self.first).then_some((self.last, self.last_weight));
        std::iter::once((self.first, self.first_weight))
            .chain(inner)
            .chain(last)
    }
}

/// A picture as video has it: luminance, and chrominance unless it is grey. All planes show the same view, with
/// any numbers of columns and rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Y.
    pub luminance: Plane,
    /// Cb and Cr.
    pub chrominance: Option<[Plane; 2]>,
    /// Levels are 0 to 255 instead of 16 to 235 (luminance) and 16 to 240 (chrominance).
    pub full_range: bool,
}

impl Picture {
    /// From a colour for each pixel, row by row from the upper left corner; full range. `None` where
    /// [`Plane::new`] has none.
    pub fn from_rgb(width: usize, height: usize, pixels: &[Rgb]) -> Option<Self> {
        let mut planes = [(); 3].map(|()| Vec::with_capacity(pixels.len()));
        // Neighbours are often alike.
        let (mut last, mut same) = (Rgb::default(), components(Rgb::default()));
        for &pixel in pixels {
            if pixel != last {
                (last, same) = (pixel, components(pixel));
            }
            for (plane, level) in planes.iter_mut().zip(same) {
                plane.push(level);
            }
        }
        let [luminance, blue, red] = planes.map(|samples| Plane::new(width, height, samples));
        Some(Self {
            luminance: luminance?,
            chrominance: Some([blue?, red?]),
            full_range: true,
        })
    }

    /// With so many columns and rows in all planes.
    #[must_use]
    pub fn scaled(&self, width: u16, height: u16) -> Self {
        let scaled = |plane: &Plane| plane.scaled(width, height);
        Self {
            luminance: scaled(&self.luminance),
            chrominance: self
                .chrominance
                .as_ref()
                .map(|planes| planes.each_ref().map(scaled)),
            full_range: self.full_range,
        }
    }

    /// The colour at a place in fractions of width and height, red, green and blue from 0 to 255
    /// (ITU-R BT.601).
    pub(super) fn colour(&self, x: f64, y: f64) -> [f64; 3] {
        let luminance = self.luminance.at(x, y);
        let chrominance = self.chrominance.as_ref();
        let [blue, red] = chrominance.map_or([CHROMINANCE_MIDDLE; 2], |planes| {
            planes.each_ref().map(|plane| plane.at(x, y))
        });
        let (from, contrast, colour) = match self.full_range {
            true => (0.0, 1.0, 1.0),
            false => {
                let [black, white] = LUMINANCE;
                (black, 255.0 / (white - black), 255.0 / CHROMINANCE_SPAN)
            }
        };
        let luminance = (luminance - from) * contrast;
        let [blue, red] = [blue, red].map(|level| (level - CHROMINANCE_MIDDLE) * colour);
        [
            luminance + 1.402 * red,
            luminance - 0.344_136 * blue - 0.714_136 * red,
            luminance + 1.772 * blue,
        ]
        .map(|level| level.clamp(0.0, 255.0))
    }
}

/// Y, Cb and Cr in full range.
fn components(colour: Rgb) -> [u8; 3] {
    let [red, green, blue] = colour.map(f64::from);
    let luminance = 0.299 * red + 0.587 * green + 0.114 * blue;
    [
        luminance,
        (blue - luminance) / 1.772 + CHROMINANCE_MIDDLE,
        (red - luminance) / 1.402 + CHROMINANCE_MIDDLE,
    ]
    .map(|level| level.round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(width: usize, height: usize, samples: &[u8]) -> Plane {
        Plane::new(width, height, samples.to_vec()).unwrap()
    }

    /// By hand: three samples to two, each of which covers one and a half.
    #[test]
    fn a_sample_is_the_mean_of_what_it_covers() {
        let scaled = plane(3, 1, &[0, 90, 240]).scaled(2, 1);
        assert_eq!(scaled.samples(), [30, 190]);
        let scaled = plane(1, 3, &[0, 90, 240]).scaled(1, 2);
        assert_eq!(scaled.samples(), [30, 190]);
        assert_eq!(plane(2, 2, &[1, 2, 3, 10]).scaled(1, 1).samples(), [4]);
        // More than there are: each shows what it lies in.
        let scaled = plane(2, 1, &[10, 20]).scaled(3, 1);
        assert_eq!(scaled.samples(), [10, 15, 20]);
    }

    /// The mean of everything is kept, and so is the place of an edge, to a tenth of a sample.
    #[test]
    fn an_edge_stays_where_it_is() {
        for (from, to, edge) in [
            (1280, 88, 601),
            (720, 143, 333),
            (640, 160, 17),
            (100, 176, 51),
        ] {
            let samples: Vec<u8> = (0..from).map(|x| if x < edge { 200 } else { 0 }).collect();
            let scaled = plane(from, 1, &samples).scaled(to, 1);
            let sum: f64 = scaled.samples().iter().copied().map(f64::from).sum();
            let found = sum / 200.0 / f64::from(to);
            let is = edge as f64 / from as f64;
            assert!((found - is).abs() * f64::from(to) < 0.1, "{found} {is}");
        }
    }

    #[test]
    fn colours_come_back() {
        for colour in [[220, 110, 40], [0, 0, 0], [255, 255, 255], [30, 60, 200]] {
            let picture = Picture::from_rgb(1, 1, &[colour]).unwrap();
            for (is, was) in picture.colour(0.5, 0.5).into_iter().zip(colour) {
                assert!((is - f64::from(was)).abs() < 2.0, "{is} {was}");
            }
        }
        // By the standard: the white and the red of 75 % colour bars, limited range.
        for (levels, colour) in [
            ([180, 128, 128], [191.0; 3]),
            ([65, 100, 212], [191.0, 0.0, 0.0]),
        ] {
            let [luminance, blue, red] = levels.map(|level| plane(1, 1, &[level]));
            let picture = Picture {
                luminance,
                chrominance: Some([blue, red]),
                full_range: false,
            };
            for (is, should) in picture.colour(0.0, 1.0).into_iter().zip(colour) {
                assert!((is - should).abs() < 1.5, "{is} {should}");
            }
        }
    }

    #[test]
    fn no_plane_without_its_samples() {
        assert_eq!(Plane::new(2, 2, vec![0; 3]), None);
        assert_eq!(Plane::new(0, 2, Vec::new()), None);
        assert_eq!(Plane::new(usize::MAX, 2, vec![0; 4]), None);
    }
}
