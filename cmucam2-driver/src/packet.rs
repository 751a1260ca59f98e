//! The camera's packets as types: decoded with checks by the [`parser`](crate::parser), encoded here.

use core::fmt;

use crate::{
    colour::Colour,
    command::StatisticsMask,
    geometry::{Sensor, Size},
    servo::ServoMask,
    text::Line,
    uncertain,
};

/// The most bins of a histogram.
pub const BINS_MAX: usize = 28;

/// `H` with all its bins: letter, 28 times a space and three digits, carriage return.
const LINE_MAX: usize = 1 + 4 * BINS_MAX + 1;

/// Kind of a stream of packets. It decides the possible values of its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum PacketKind {
    /// T packets of colour tracking, in pixels.
    Tracking,
    /// T packets of frame differencing, on a grid of 8 x 8 or 16 x 16 blocks.
    Difference,
    /// S packets of `GM`, levels.
    Statistics,
    /// H packets of `GH`, scaled counts.
    Histogram,
}

/// A packet of any of the three letters.
///
/// Not exhaustive, because a feature adds one: a crate that does without it goes on to compile beside one that does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Packet {
    /// `T`: the place of the target.
    Tracking(Tracking),
    /// `S`: the mean colour and its deviation.
    Statistics(Statistics),
    /// `H`: a histogram. With the feature `full`.
    #[cfg(feature = "full")]
    Histogram(Histogram),
}

/// Reason why the numbers of a packet cannot be what the camera meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum PacketError {
    /// Another number of fields than masks and servo reports ask for.
    FieldCount,
    /// The middle of mass is outside the bounding box, or the box is turned inside out.
    Order,
    /// A coordinate outside the frame.
    Geometry,
    /// Pixels and confidence contradict the size of the box.
    Arithmetic,
}

impl fmt::Display for PacketError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::FieldCount => "another number of fields than asked for",
            Self::Order => "the coordinates are out of order",
            Self::Geometry => "a coordinate is outside the frame",
            Self::Arithmetic => "pixels and confidence contradict the bounding box",
        })
    }
}

impl core::error::Error for PacketError {}

/// A bounding box, both corners inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BoundingBox {
    /// Leftmost column, from 0 or 1: see [`uncertain::last_coordinate`].
    pub x1: u8,
    /// Uppermost row, counted as the columns are.
    pub y1: u8,
    /// Rightmost column, at least `x1`.
    pub x2: u8,
    /// Lowermost row, at least `y1`.
    pub y2: u8,
}

impl BoundingBox {
    /// Pixels inside, both corners included.
    pub const fn area(self) -> u32 {
        (self.x2.saturating_sub(self.x1) as u32 + 1) * (self.y2.saturating_sub(self.y1) as u32 + 1)
    }
}

/// The numbers of a packet of which a mask selects some, the first in its lowest bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
struct Fields<const N: usize> {
    /// Zero where masked.
    values: [u8; N],
    mask: u8,
}

impl<const N: usize> Fields<N> {
    /// Those that were sent, in their places.
    fn placed(mask: u8, sent: &mut impl Iterator<Item = u8>) -> Self {
        let mut values = [0; N];
        for (bit, value) in values.iter_mut().enumerate() {
            if mask >> bit & 1 != 0 {
                *value = sent.next().unwrap_or(0);
            }
        }
        Self { values, mask }
    }

    fn masked(self, mask: u8) -> Self {
        let selected = self.values.iter().enumerate();
        let selected = selected.filter(|(bit, _)| mask >> bit & 1 != 0);
        Self::placed(mask, &mut selected.map(|(_, &value)| value))
    }

    fn has(&self, bits: u8) -> bool {
        self.mask & bits == bits
    }

    fn get(&self, bit: u8) -> Option<u8> {
        if !self.has(1 << bit) {
            return None;
        }
        self.values.get(usize::from(bit)).copied()
    }

    /// Those that are sent.
    fn sent(&self) -> impl Iterator<Item = u8> + '_ {
        (0..N as u8).filter_map(|bit| self.get(bit))
    }
}

/// A T packet: the place of the target. Coordinates are pixels after down-sampling, or blocks of the
/// frame-difference grid, from the upper left corner.
///
/// Fields that the output mask leaves out are `None`. When nothing is tracked every field of the
/// target is zero: see [`Tracking::is_lost`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tracking {
    /// mx, my, x1, y1, x2, y2, pixels, confidence.
    fields: Fields<8>,
    pan: Option<u8>,
    tilt: Option<u8>,
}

impl Tracking {
    /// A packet of all eight fields: mx, my, x1, y1, x2, y2, pixels, confidence. Not checked.
    pub const fn new(values: [u8; 8]) -> Self {
        let fields = Fields { values, mask: 0xFF };
        Self {
            fields,
            pan: None,
            tilt: None,
        }
    }

    /// The packet of a camera that does not see its target.
    pub const LOST: Self = Self::new([0; 8]);

    /// The same packet as a camera with these masks sends it.
    #[must_use]
    pub fn masked(self, mask: u8, pan: Option<u8>, tilt: Option<u8>) -> Self {
        let fields = self.fields.masked(mask);
        Self { fields, pan, tilt }
    }

    /// Number of fields of a packet under these masks.
    pub(crate) const fn fields(mask: u8, servos: ServoMask) -> u8 {
        mask.count_ones() as u8 + servos.reports_pan() as u8 + servos.reports_tilt() as u8
    }

    /// From the numbers of a packet under an output mask, of which bit 0 is mx and bit 7 the confidence, and with the
    /// positions that a servo mask adds; checked against the frame they must lie in.
    ///
    /// # Errors
    /// [`PacketError`], except [`PacketError::Arithmetic`]: for that see
    /// [`Tracking::is_consistent`].
    pub fn from_fields(
        numbers: &[u8],
        mask: u8,
        servos: ServoMask,
        frame: Size,
    ) -> Result<Self, PacketError> {
        let (pan, tilt) = (servos.reports_pan(), servos.reports_tilt());
        // The usual packet, without looking at masks.
        if let (0xFF, false, false, Ok(values)) = (mask, pan, tilt, numbers.try_into()) {
            let tracking = Self::new(values);
            return tracking.check(frame).map(|()| tracking);
        }
        if numbers.len() != usize::from(Self::fields(mask, servos)) {
            return Err(PacketError::FieldCount);
        }
        let mut numbers = numbers.iter().copied();
        let tracking = Self {
            fields: Fields::placed(mask, &mut numbers),
            pan: if pan { numbers.next() } else { None },
            tilt: if tilt { numbers.next() } else { None },
        };
        tracking.check(frame)?;
        Ok(tracking)
    }

    #[inline]
    fn check(&self, frame: Size) -> Result<(), PacketError> {
        let [mx, my, x1, y1, x2, y2, ..] = self.fields.values;
        let last = uncertain::last_coordinate(frame);
        if mx.max(x1).max(x2) > last.width || my.max(y1).max(y2) > last.height {
            return Err(PacketError::Geometry);
        }
        let has = |bits: u8| self.fields.has(bits);
        let ordered = (!has(0b00_0101) || x1 <= mx)
            && (!has(0b01_0001) || mx <= x2)
            && (!has(0b01_0100) || x1 <= x2)
            && (!has(0b00_1010) || y1 <= my)
            && (!has(0b10_0010) || my <= y2)
            && (!has(0b10_1000) || y1 <= y2);
        if !ordered {
            return Err(PacketError::Order);
        }
        Ok(())
    }

    /// Returns true if the camera says that it tracks nothing: every field of the target is zero.
    ///
    /// A target of fewer than four pixels may have a pixel count of zero, but not its coordinates.
    pub fn is_lost(&self) -> bool {
        self.fields.values == [0; 8]
    }

    /// The middle of mass `(mx, my)`. `None` when lost or not sent.
    pub fn centroid(&self) -> Option<(u8, u8)> {
        if self.is_lost() {
            return None;
        }
        Some((self.fields.get(0)?, self.fields.get(1)?))
    }

    /// The box around all tracked pixels. `None` when lost or not sent.
    pub fn bounding_box(&self) -> Option<BoundingBox> {
        if self.is_lost() {
            return None;
        }
        Some(BoundingBox {
            x1: self.fields.get(2)?,
            y1: self.fields.get(3)?,
            x2: self.fields.get(4)?,
            y2: self.fields.get(5)?,
        })
    }

    /// `min(255, (n + 4) / 8)` of `n` tracked pixels. `None` when not sent.
    pub fn pixels(&self) -> Option<u8> {
        self.fields.get(6)
    }

    /// `min(255, 256 n / area of the box)`. `None` when not sent.
    pub fn confidence(&self) -> Option<u8> {
        self.fields.get(7)
    }

    /// Position of the pan servo, if reported.
    pub fn pan(&self) -> Option<u8> {
        self.pan
    }

    /// Position of the tilt servo, if reported.
    pub fn tilt(&self) -> Option<u8> {
        self.tilt
    }

    /// Returns true if pixels and confidence can both come from one count of pixels in this box, by the
    /// formulas of [`Tracking::pixels`] and [`Tracking::confidence`], give or take a rounding.
    /// Also true where a field is missing.
    pub fn is_consistent(&self) -> bool {
        let (Some(area), Some(pixels), Some(confidence)) = (
            self.bounding_box().map(BoundingBox::area),
            self.pixels().map(u32::from),
            self.confidence().map(u32::from),
        ) else {
            return true;
        };
        let least = (8 * pixels).saturating_sub(8);
        let most = if pixels == 255 {
            area
        } else {
            area.min(8 * pixels + 8)
        };
        let of = |count: u32| 256 * count / area;
        least <= area
            && of(least).saturating_sub(2).min(255) <= confidence
            && confidence <= of(most) + 2
    }

    fn numbers(&self) -> impl Iterator<Item = u8> + '_ {
        self.fields.sent().chain(self.pan).chain(self.tilt)
    }
}

/// An S packet: the mean colour of the window and its mean absolute deviation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Statistics {
    /// Rm, Gm, Bm, Rd, Gd, Bd.
    fields: Fields<6>,
}

impl Statistics {
    /// A packet of all six fields.
    pub const fn new(mean: Colour, deviation: Colour) -> Self {
        let [a, b, c] = mean.levels();
        let [d, e, f] = deviation.levels();
        let fields = Fields {
            values: [a, b, c, d, e, f],
            mask: StatisticsMask::ALL.bits(),
        };
        Self { fields }
    }

    /// The same packet as a camera with this mask sends it.
    #[must_use]
    pub fn masked(self, mask: StatisticsMask) -> Self {
        let fields = self.fields.masked(mask.bits());
        Self { fields }
    }

    /// From the numbers of a packet.
    ///
    /// # Errors
    /// [`PacketError::FieldCount`].
    pub fn from_fields(numbers: &[u8], mask: StatisticsMask) -> Result<Self, PacketError> {
        if numbers.len() != mask.bits().count_ones() as usize {
            return Err(PacketError::FieldCount);
        }
        let fields = Fields::placed(mask.bits(), &mut numbers.iter().copied());
        Ok(Self { fields })
    }

    /// The mean colour, if all its channels were sent.
    pub fn mean(&self) -> Option<Colour> {
        let [red, green, blue, ..] = self.fields.values;
        let mean = Colour::new(red, green, blue);
        self.fields.has(0b00_0111).then_some(mean)
    }

    /// The deviation from the mean, if all its channels were sent.
    pub fn deviation(&self) -> Option<Colour> {
        let [.., red, green, blue] = self.fields.values;
        let deviation = Colour::new(red, green, blue);
        self.fields.has(0b11_1000).then_some(deviation)
    }
}

/// An H packet: the number of pixels with a level in each bin, scaled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Histogram {
    bins: [u8; BINS_MAX],
    len: u8,
}

impl Histogram {
    /// From the counts of 1 to [`BINS_MAX`] bins.
    ///
    /// # Errors
    /// [`PacketError::FieldCount`].
    pub fn new(counts: &[u8]) -> Result<Self, PacketError> {
        let mut bins = [0; BINS_MAX];
        let (true, Some(filled), Ok(len)) = (
            !counts.is_empty(),
            bins.get_mut(..counts.len()),
            u8::try_from(counts.len()),
        ) else {
            return Err(PacketError::FieldCount);
        };
        filled.copy_from_slice(counts);
        Ok(Self { bins, len })
    }

    /// The counts, the darkest bin first.
    pub fn bins(&self) -> &[u8] {
        self.bins.get(..usize::from(self.len)).unwrap_or(&[])
    }
}

/// A packet as it goes over the line.
pub type PacketLine = Line<LINE_MAX>;

impl Packet {
    /// As text, with its carriage return.
    pub fn line(&self) -> PacketLine {
        let mut line = Line::EMPTY;
        line.push(self.letter());
        self.each_number(|value| line.numbers(&[value]));
        line.push(b'\r');
        line
    }

    /// As raw output: 255, the letter and the numbers as bytes. A number of 255 becomes 254.
    pub fn raw(&self) -> PacketLine {
        let mut line = Line::EMPTY;
        line.text(&[0xFF, self.letter()]);
        self.each_number(|value| line.push(value.min(254)));
        line
    }

    /// Returns true if a stream of this kind carries such a packet.
    pub fn is_of(&self, kind: PacketKind) -> bool {
        match self {
            Self::Tracking(_) => matches!(kind, PacketKind::Tracking | PacketKind::Difference),
            Self::Statistics(_) => kind == PacketKind::Statistics,
            #[cfg(feature = "full")]
            Self::Histogram(_) => kind == PacketKind::Histogram,
        }
    }

    const fn letter(&self) -> u8 {
        match self {
            Self::Tracking(_) => b'T',
            Self::Statistics(_) => b'S',
            #[cfg(feature = "full")]
            Self::Histogram(_) => b'H',
        }
    }

    fn each_number(&self, write: impl FnMut(u8)) {
        match self {
            Self::Tracking(packet) => packet.numbers().for_each(write),
            Self::Statistics(packet) => packet.fields.sent().for_each(write),
            #[cfg(feature = "full")]
            Self::Histogram(packet) => packet.bins().iter().copied().for_each(write),
        }
    }
}

/// Contents of the banner: `CMUcam2 v1.00 c6`. Banners of kindred firmware, `CMUcam2+ v1.00 c6`,
/// `CMUcam2 v2.0+ c6` and `CMUcam3 v1.0`, are taken as well; their differences are not kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FirmwareVersion {
    /// Before the point.
    pub major: u8,
    /// After the point, in hundredths: 1 for `1.01`, 10 for `1.1`.
    pub minor: u8,
    /// The number after `c`, which names the sensor.
    pub module: Option<u8>,
}

impl FirmwareVersion {
    /// The sensor, if the banner names a known one.
    pub fn sensor(self) -> Option<Sensor> {
        self.module.and_then(uncertain::sensor_of_module)
    }

    /// The banner without a carriage return.
    pub fn banner(self) -> Banner {
        let mut line = Line::EMPTY;
        line.text(BANNER);
        line.number(self.major);
        line.push(b'.');
        line.push(b'0' + self.minor / 10 % 10);
        line.push(b'0' + self.minor % 10);
        if let Some(module) = self.module {
            line.text(b" c");
            line.number(module);
        }
        line
    }
}

/// Beginning of every banner.
pub(crate) const BANNER: &[u8; 9] = b"CMUcam2 v";

/// A banner as it goes over the line.
pub type Banner = Line<24>;
