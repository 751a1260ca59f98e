//! Files of recorded measurements.
//!
//! CSV as spreadsheets and scripts write it: a first line that names the columns, in any order,
//! then one row per line. Columns that are not asked for are ignored, as are blank lines, blanks
//! around a cell and a UTF-8 byte order mark. Cells may be quoted, but a row is always one line:
//! a quote that is never closed spoils its own row only.
//!
//! Errors of a *file* are a [`ReadError`]. Errors of a *row* are a [`Complaint`] with its line number, and
//! reading goes on.

use std::{
    fmt,
    fs::{File, Metadata},
    io::{self, BufRead, BufReader},
    path::Path,
};

mod directions;
pub mod network;
mod rows;
pub mod sightings;
pub mod space;
pub mod stops;
pub mod truth;

pub use directions::USUAL_BEARING_SIGMA;

/// Why a file as a whole cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// It cannot be opened or read.
    #[error("cannot be read")]
    Io(#[from] io::Error),
    /// Its first line has control characters.
    #[error("is no text: its first line has control characters. Give a CSV file, in UTF-8")]
    NoText,
    /// It has no line that names the columns.
    #[error("is empty: its first line must name the columns")]
    Empty,
    /// It has a line of column names and nothing else.
    #[error("has column names but no rows")]
    NoRows,
    /// The first line does not name a column that is needed.
    #[error(
        "has no column `{missing}`: its first line must name the columns, separated by commas; \
         it names {found}"
    )]
    NoColumn {
        /// Columns that are needed.
        missing: String,
        /// Columns that are there instead.
        found: String,
    },
    /// The first line names a column twice.
    #[error("names the column `{0}` twice: rename or remove one of them")]
    TwoColumns(String),
    /// The sightings are pixel columns, and nothing says what camera they are of.
    #[error(
        "gives pixel columns (`{0}`): say which camera they are of with --fov-deg \
         (and --columns, --projection, --principal)"
    )]
    NeedsCamera(String),
    /// A line is so long that this is not a CSV file.
    #[error("has more than {limit} bytes in line {line}: it is not a CSV file")]
    LongLine {
        /// Counted from 1.
        line: u64,
        /// The longest line there may be, bytes.
        limit: usize,
    },
    /// Bearings beyond what radians can be.
    #[error(
        "gives bearings as `{radians}` that are no radians, which go from -3.14 to 3.14 (or to 6.28): \
         are they degrees? Then call the column `{degrees}`"
    )]
    Degrees {
        /// Name of the column.
        radians: &'static str,
        /// Name that it may have to have.
        degrees: &'static str,
    },
    /// One row is wrong, in a file whose rows depend on each other.
    #[error("cannot be used: {0}")]
    Row(Complaint),
}

/// Description of an error in one row, with advice.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Complaint {
    /// Counted from 1.
    pub line: u64,
    /// A sentence.
    pub text: String,
}

impl fmt::Display for Complaint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: {}", self.line, self.text)
    }
}

/// Opens a file, or the standard input for `-`.
///
/// `watch` gets the file and its length in bytes, if that is known, and returns what to read from
/// instead: the place for a progress bar.
///
/// # Errors
/// [`ReadError::Io`]
pub fn open<W, R>(path: &Path, watch: W) -> Result<Box<dyn BufRead>, ReadError>
where
    W: FnOnce(Box<dyn io::Read>, Option<u64>) -> R,
    R: io::Read + 'static,
{
    const BUFFER: usize = 1 << 16;
    let (input, length): (Box<dyn io::Read>, _) = if path == Path::new("-") {
        (Box::new(io::stdin()), None)
    } else {
        let file = File::open(path)?;
        let length = file.metadata().ok().filter(Metadata::is_file);
        (Box::new(file), length.map(|m| m.len()))
    };
    Ok(Box::new(BufReader::with_capacity(
        BUFFER,
        watch(input, length),
    )))
}
