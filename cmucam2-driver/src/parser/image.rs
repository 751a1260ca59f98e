//! Binary rows: frames and line modes.

use super::{Expectation, Token};
use crate::{
    colour::{LEVEL_MAX, LEVEL_MIN},
    packet::BANNER,
    uncertain,
};

/// Meaning of the bytes of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ImageKind {
    /// `01 w h`, rows with or without `02` between them, `03`: pixels of so many bytes, 16 to 240.
    Frame(u8),
    /// `AA w h`, one bit for each pixel with the leftmost in the highest bit, `AA AA`.
    Bitmap,
    /// `FE h`, five bytes for each row (mean, least and greatest column, count, confidence), `FD`.
    Rows,
    /// `FE`, perhaps the number of rows, so many bytes for each row, three (means) or six (means and deviations),
    /// `FD`.
    Means(u8),
}

/// The beginning of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ImageHeader {
    /// Meaning of the bytes.
    pub kind: ImageKind,
    /// Columns; 0 where the protocol does not say it.
    pub width: u8,
    /// Rows; 0 where the protocol does not say it.
    pub height: u8,
    /// Bytes of one row.
    pub row_bytes: u16,
}

/// State of a row after a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RowState {
    /// The row goes on.
    Open,
    /// The row is full and every byte was possible.
    Full,
    /// The row is full, but a byte of it cannot have been sent.
    Damaged,
}

fn is_level(byte: u8) -> bool {
    (LEVEL_MIN..=LEVEL_MAX).contains(&byte)
}

pub(super) enum Step {
    Nothing,
    Token(Token),
    /// The image ended although its mark is missing; the byte belongs to the next token.
    EndBefore(Token),
    /// This is no image.
    Refuse,
    /// The camera restarted within the image: its banner has come as far as the version.
    Banner,
}

const FRAME_LEAD: u8 = 0x01;
const ROW_LEAD: u8 = 0x02;
const FRAME_END: u8 = 0x03;
const BITMAP_MARK: u8 = 0xAA;
const LINES_LEAD: u8 = 0xFE;
const LINES_END: u8 = 0xFD;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    Width,
    Height,
    /// The first byte of means: a level, or the number of rows.
    FirstMean,
    Row,
    /// A frame's row is full: a mark may follow, and must if the frame has them.
    RowFull,
    /// Marks that are missing after the last row of a bitmap or of row statistics.
    End(u8),
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Image {
    kind: ImageKind,
    place: Place,
    width: u8,
    height: u8,
    row_bytes: u16,
    rows: u16,
    /// Bytes of the row so far.
    at: u16,
    row_intact: bool,
    intact: bool,
    /// Number of the last bytes that match a banner.
    banner: u8,
    /// True if the number of rows comes first in means; `None` if that is not known.
    counted: Option<bool>,
    /// True if rows of the frame have marks, as far as it has shown.
    marked: Option<bool>,
}

impl Image {
    pub(super) const NONE: Self = Self {
        kind: ImageKind::Bitmap,
        place: Place::Width,
        width: 0,
        height: 0,
        row_bytes: 0,
        rows: 0,
        at: 0,
        row_intact: true,
        intact: true,
        banner: 0,
        counted: None,
        marked: None,
    };

    /// The image that begins with this byte, if one is expected.
    pub(super) fn begin(
        byte: u8,
        expectation: &Expectation,
        counted: Option<bool>,
    ) -> Option<Self> {
        let kind = expectation.image?;
        let (lead, place, row_bytes) = match kind {
            ImageKind::Frame(_) => (FRAME_LEAD, Place::Width, 0),
            ImageKind::Bitmap => (BITMAP_MARK, Place::Width, 0),
            ImageKind::Rows => (LINES_LEAD, Place::Height, 5),
            ImageKind::Means(bytes) => (LINES_LEAD, Place::FirstMean, bytes),
        };
        (byte == lead).then_some(Self {
            kind,
            place,
            row_bytes: row_bytes.into(),
            counted,
            ..Self::NONE
        })
    }

    pub(super) fn push(&mut self, byte: u8, expectation: &Expectation) -> Step {
        if self.saw_banner(byte) {
            return Step::Banner;
        }
        match self.place {
            Place::Width => {
                if byte == 0 || byte > expectation.frame.width {
                    return Step::Refuse;
                }
                self.width = byte;
                self.place = Place::Height;
                Step::Nothing
            }
            Place::Height => self.height(byte, expectation),
            Place::FirstMean => {
                self.place = Place::Row;
                let counted = uncertain::means_are_counted(byte, expectation.frame, self.counted);
                self.counted = Some(counted);
                if counted {
                    return Step::Nothing;
                }
                self.means(byte)
            }
            Place::Row => match self.kind {
                ImageKind::Frame(_) => self.frame(byte),
                ImageKind::Means(_) => self.means(byte),
                ImageKind::Bitmap | ImageKind::Rows => self.counted(byte),
            },
            Place::RowFull => self.frame(byte),
            Place::End(missing) => self.end(missing, byte),
        }
    }

    fn saw_banner(&mut self, byte: u8) -> bool {
        if BANNER.get(usize::from(self.banner)) == Some(&byte) {
            self.banner += 1;
            return usize::from(self.banner) == BANNER.len();
        }
        self.banner = u8::from(byte == BANNER[0]);
        false
    }

    fn height(&mut self, byte: u8, expectation: &Expectation) -> Step {
        self.place = Place::Row;
        if byte == 0 || byte > expectation.frame.height {
            return Step::Refuse;
        }
        self.height = byte;
        self.row_bytes = match self.kind {
            ImageKind::Frame(bytes) => u16::from(self.width) * u16::from(bytes),
            ImageKind::Bitmap => u16::from(self.width.div_ceil(8)),
            ImageKind::Rows | ImageKind::Means(_) => self.row_bytes,
        };
        Step::Token(Token::Header(self.header()))
    }

    /// The header of an image that announces nothing, right after its lead.
    pub(super) fn header_without_sizes(&self) -> Option<ImageHeader> {
        matches!(self.kind, ImageKind::Means(_)).then(|| self.header())
    }

    fn header(&self) -> ImageHeader {
        ImageHeader {
            kind: self.kind,
            width: self.width,
            height: self.height,
            row_bytes: self.row_bytes,
        }
    }

    /// The end of the image. `as_announced`: nothing is missing.
    fn over(&self, as_announced: bool) -> Token {
        Token::ImageEnd {
            rows: self.rows,
            intact: self.intact && as_announced,
        }
    }

    /// The bytes of the row so far were none. Returns their number.
    fn give_up_row(&mut self) -> u16 {
        self.intact = false;
        self.row_intact = true;
        core::mem::take(&mut self.at)
    }

    /// One byte of the row, known to have room.
    fn pixel(&mut self, byte: u8, possible: bool) -> Step {
        self.row_intact &= possible;
        self.at += 1;
        if self.at < self.row_bytes {
            return Step::Token(Token::Pixel(byte, RowState::Open));
        }
        let state = if self.row_intact {
            RowState::Full
        } else {
            RowState::Damaged
        };
        self.intact &= self.row_intact;
        self.row_intact = true;
        self.rows += 1;
        self.at = 0;
        Step::Token(Token::Pixel(byte, state))
    }

    fn frame(&mut self, byte: u8) -> Step {
        let complete = self.rows >= u16::from(self.height);
        match (byte, self.place) {
            (ROW_LEAD, _) if self.marked != Some(false) => {
                self.marked = Some(true);
                self.place = Place::Row;
                if self.at == 0 {
                    return Step::Nothing;
                }
                self.rows += 1;
                Step::Token(Token::RowCut(self.give_up_row()))
            }
            (FRAME_END, _) => Step::Token(self.over(self.at == 0 && complete)),
            (_, _) if complete => Step::EndBefore(self.over(false)),
            // What seemed to begin a row without a mark was a byte too many of the one before.
            (ROW_LEAD, _) if self.rows == 1 && self.at == 1 => {
                self.marked = Some(true);
                self.give_up_row();
                Step::Token(Token::RowAgain)
            }
            (_, Place::RowFull) if self.marked == Some(true) || !is_level(byte) => {
                self.intact = false;
                Step::Nothing
            }
            _ => {
                if self.place == Place::RowFull {
                    self.marked = Some(false);
                    self.place = Place::Row;
                }
                let step = self.pixel(byte, is_level(byte));
                if self.at == 0 && self.marked != Some(false) {
                    self.place = Place::RowFull;
                }
                step
            }
        }
    }

    /// Rows by count; any byte may be data.
    fn counted(&mut self, byte: u8) -> Step {
        let step = self.pixel(byte, true);
        if self.rows == u16::from(self.height) {
            self.place = Place::End(if self.kind == ImageKind::Bitmap { 2 } else { 1 });
        }
        step
    }

    fn end(&mut self, missing: u8, byte: u8) -> Step {
        let mark = if self.kind == ImageKind::Bitmap {
            BITMAP_MARK
        } else {
            LINES_END
        };
        if byte != mark {
            return Step::EndBefore(self.over(false));
        }
        if missing > 1 {
            self.place = Place::End(missing - 1);
            return Step::Nothing;
        }
        Step::Token(self.over(true))
    }

    /// Returns true if the number of rows comes first, as far as the images so far have shown.
    pub(super) const fn is_counted(&self) -> Option<bool> {
        self.counted
    }

    /// One byte too many or too few shows that the first one was misunderstood.
    fn recount(&mut self) {
        if self.counted == Some(false) && self.at == 1 {
            self.counted = Some(true);
        } else if self.counted == Some(true) && self.at + 1 == self.row_bytes {
            self.counted = Some(false);
        } else if self.at != 0 {
            self.counted = None;
        }
    }

    /// Rows until the mark: no level reaches it.
    fn means(&mut self, byte: u8) -> Step {
        if byte == LINES_END {
            self.recount();
            return Step::Token(self.over(self.at == 0));
        }
        if self.rows > u16::from(u8::MAX) {
            return Step::EndBefore(self.over(false));
        }
        self.pixel(byte, byte <= LEVEL_MAX)
    }
}
