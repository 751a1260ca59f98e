//! Sightings at known places, appended to a file for `host-sim solve`.

use std::{
    fs::{File, OpenOptions},
    io::{self, BufRead, BufReader, Read, Write},
    path::{Path, PathBuf},
};

use node_firmware::vision::steady::Steady;
use serde::Serialize;

use super::Bearing;

/// Reads a place that a person types: two numbers with a comma, a semicolon or blanks between.
///
/// # Errors
/// The expected form.
pub fn place(text: &str) -> Result<(f64, f64), String> {
    let parts: Vec<&str> = text
        .split(|c: char| c == ',' || c == ';' || c.is_whitespace())
        .filter(|part| !part.is_empty())
        .collect();
    let number = |text: &str| text.parse::<f64>().ok().filter(|value| value.is_finite());
    match parts.as_slice() {
        [x, y] => number(x).zip(number(y)),
        _ => None,
    }
    .ok_or_else(|| "two numbers are needed: X,Y, such as 1.5,-2".to_owned())
}

/// One row of a recording. As JSON this is an interface: names and meaning stay.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Row<'a> {
    /// Name of the camera: sightings of the same case belong together.
    pub case: &'a str,
    /// Place where the object stood.
    pub target_x: f64,
    /// As `target_x`.
    pub target_y: f64,
    /// Column in which it was seen, counted from 0 on the left.
    pub column: f64,
    /// Standard deviation of the direction, radians; `None` without a camera.
    pub sigma_rad: Option<f64>,
}

/// A sighting that was recorded. As JSON this is an interface: names and meaning stay.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SightingLine<'a> {
    /// The row that was written to the file.
    #[serde(flatten)]
    pub row: Row<'a>,
    /// Standard deviation of `column`.
    pub column_sigma: f64,
    /// The direction, radians, positive to the left; `None` without a camera.
    pub bearing_rad: Option<f64>,
    /// See [`Steady::frames`].
    pub packets: u16,
    /// See [`Steady`]; `None` for a camera that does not tell them.
    pub pixels: Option<u8>,
    /// As `pixels`.
    pub confidence: Option<u8>,
}

impl<'a> SightingLine<'a> {
    /// The row with the data from which it was made; `tells_pixels`: the camera tells pixels and confidence.
    pub fn new(
        row: Row<'a>,
        steady: &Steady,
        bearing: Option<Bearing>,
        tells_pixels: bool,
    ) -> Self {
        Self {
            row,
            column_sigma: f64::from(steady.column_sigma),
            bearing_rad: bearing.map(|b| b.bearing),
            packets: steady.frames,
            pixels: tells_pixels.then_some(steady.pixels),
            confidence: tells_pixels.then_some(steady.confidence),
        }
    }
}

/// Columns of a recording; the last one only where the camera's field of view is known.
const COLUMNS: [&str; 5] = ["case", "target_x", "target_y", "column", "sigma_rad"];

/// Reason why a sighting cannot be recorded.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file cannot be opened, read or written.
    #[error("{} cannot be written: {error}", path.display())]
    Io {
        /// Path of the recording.
        path: PathBuf,
        /// The operating system's answer.
        error: io::Error,
    },
    /// The file has other columns.
    #[error(
        "{} has the columns `{found}`, but these sightings have `{wanted}`: name another file{}",
        path.display(), hint(found, wanted)
    )]
    Columns {
        /// Path of the recording.
        path: PathBuf,
        /// Its first line.
        found: String,
        /// The first line that it must have.
        wanted: String,
    },
    /// A name that does not fit into one line.
    #[error("the name of a case must be one line of text and not empty")]
    Case,
}

fn hint(found: &str, wanted: &str) -> &'static str {
    let [.., sigma] = COLUMNS;
    match (found.contains(sigma), wanted.contains(sigma)) {
        (true, false) => ", or give --fov-deg",
        (false, true) => ", or leave --fov-deg away",
        _ => "",
    }
}

/// A file to which sightings are appended, one line each, so that its contents stay whatever
/// happens.
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    /// `None`: it is made for the first sighting, so that no empty one is left where there is none.
    file: Option<File>,
    with_sigma: bool,
    /// The line to begin with, if the file is empty; or the end of a line that was cut off.
    before: String,
}

impl Recording {
    /// Opens a recording, if it is there. Nothing is written yet.
    ///
    /// # Errors
    /// [`RecordError::Io`], [`RecordError::Columns`]
    pub fn open(path: &Path, with_sigma: bool) -> Result<Self, RecordError> {
        Self::opened(path, with_sigma, false)
    }

    /// Opens a recording; one that is not there is made, if that is said.
    fn opened(path: &Path, with_sigma: bool, make: bool) -> Result<Self, RecordError> {
        let of_file = |error| RecordError::Io {
            path: path.to_owned(),
            error,
        };
        let file = OpenOptions::new()
            .read(true)
            .append(true)
            .create(make)
            .open(path)
            .and_then(|file| match file.metadata()?.is_file() {
                true => Ok(file),
                // Such a file may have no end, and its first line cannot be read again.
                false => Err(io::Error::other("it is no regular file")),
            });
        let file = match file {
            Err(error) if error.kind() == io::ErrorKind::NotFound && !make => {
                return Ok(Self {
                    path: path.to_owned(),
                    file: None,
                    with_sigma,
                    before: String::new(),
                });
            }
            file => file.map_err(of_file)?,
        };
        let (first, ends_open) = first_line(&file).map_err(of_file)?;
        let wanted = columns(with_sigma).join(",");
        let names: Vec<&str> = first
            .trim_start_matches('\u{feff}')
            .split(',')
            .map(|name| name.trim().trim_matches('"'))
            .collect();
        let found = names.join(",");
        let before = match (found.is_empty(), ends_open) {
            (true, _) => format!("{wanted}\n"),
            (false, true) => "\n".to_owned(),
            (false, false) => String::new(),
        };
        if !found.is_empty() && found != wanted {
            return Err(RecordError::Columns {
                path: path.to_owned(),
                found,
                wanted,
            });
        }
        Ok(Self {
            path: path.to_owned(),
            file: Some(file),
            with_sigma,
            before,
        })
    }

    /// Appends a row in one piece, and waits until it is on the disk. A file that is not there is made.
    ///
    /// # Errors
    /// [`RecordError`]
    pub fn append(&mut self, row: &Row<'_>) -> Result<(), RecordError> {
        if row.case.trim().is_empty() || row.case.contains(['\n', '\r']) {
            return Err(RecordError::Case);
        }
        if self.file.is_none() {
            // Another program may have begun it meanwhile.
            *self = Self::opened(&self.path, self.with_sigma, true)?;
        }
        let text = self
            .line(row)
            .and_then(|line| {
                let mut file = self.file.as_ref().ok_or(io::ErrorKind::NotFound)?;
                file.write_all(line.as_bytes())?;
                file.sync_data()
            })
            .map_err(|error| RecordError::Io {
                path: self.path.clone(),
                error,
            });
        if text.is_ok() {
            self.before.clear();
        }
        text
    }

    fn line(&self, row: &Row<'_>) -> io::Result<String> {
        let mut cells = vec![
            row.case.to_owned(),
            row.target_x.to_string(),
            row.target_y.to_string(),
            row.column.to_string(),
        ];
        if self.with_sigma {
            cells.push(row.sigma_rad.map_or(String::new(), |s| format!("{s:.6}")));
        }
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(&cells)?;
        let bytes = writer
            .into_inner()
            .map_err(csv::IntoInnerError::into_error)?;
        Ok(format!(
            "{}{}",
            self.before,
            String::from_utf8_lossy(&bytes)
        ))
    }
}

fn columns(with_sigma: bool) -> &'static [&'static str] {
    if with_sigma { &COLUMNS } else { &COLUMNS[..4] }
}

/// The first line that is not blank, and whether the last line lacks its end.
fn first_line(file: &File) -> io::Result<(String, bool)> {
    // Longer first lines are no line of column names.
    const LIMIT: u64 = 4096;
    let mut input = BufReader::new(file);
    let mut first = Vec::new();
    while first.trim_ascii().is_empty() {
        first.clear();
        if input.by_ref().take(LIMIT).read_until(b'\n', &mut first)? == 0 {
            break;
        }
    }
    let mut last = first.last().copied();
    loop {
        let buffer = input.fill_buf()?;
        let Some(&byte) = buffer.last() else { break };
        last = Some(byte);
        let length = buffer.len();
        input.consume(length);
    }
    let text = String::from_utf8_lossy(first.trim_ascii()).into_owned();
    Ok((text, last.is_some_and(|byte| byte != b'\n')))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn places_as_people_type_them() {
        for text in [
            "1.5,-2",
            "1.5 -2",
            " 1.5 ,  -2 ",
            "1.5;-2\t",
            "1.5\t-2.0\r\n",
        ] {
            assert_eq!(place(text), Ok((1.5, -2.0)), "{text:?}");
        }
        for text in ["", "1", "1,2,3", "1,x", "nan,1", "1,inf"] {
            assert!(place(text).is_err(), "{text:?}");
        }
    }

    const ROW: Row<'_> = Row {
        case: "camera",
        target_x: 1.0,
        target_y: -2.5,
        column: 43.5,
        sigma_rad: Some(0.002_710_001),
    };

    struct Scratch(tempfile::TempDir);

    impl Scratch {
        fn new(content: Option<&str>) -> Self {
            let scratch = Self(tempfile::tempdir().unwrap());
            if let Some(content) = content {
                fs::write(scratch.path(), content).unwrap();
            }
            scratch
        }

        fn path(&self) -> PathBuf {
            self.0.path().join("s.csv")
        }

        fn content(&self) -> String {
            fs::read_to_string(self.path()).unwrap()
        }
    }

    fn append(scratch: &Scratch, with_sigma: bool) -> Result<(), RecordError> {
        Recording::open(&scratch.path(), with_sigma)?.append(&ROW)
    }

    #[test]
    fn names_once_then_one_line_for_each_sighting() {
        let scratch = Scratch::new(None);
        append(&scratch, true).unwrap();
        let mut recording = Recording::open(&scratch.path(), true).unwrap();
        let quoted = Row {
            case: "north, \"upper\"",
            ..ROW
        };
        recording.append(&quoted).unwrap();
        recording.append(&ROW).unwrap();
        assert_eq!(
            scratch.content(),
            "case,target_x,target_y,column,sigma_rad\n\
             camera,1,-2.5,43.5,0.002710\n\
             \"north, \"\"upper\"\"\",1,-2.5,43.5,0.002710\n\
             camera,1,-2.5,43.5,0.002710\n"
        );
    }

    #[test]
    fn without_a_camera_there_is_no_sigma() {
        let scratch = Scratch::new(Some(" \n\n"));
        append(&scratch, false).unwrap();
        let text = "case,target_x,target_y,column\ncamera,1,-2.5,43.5\n";
        assert!(scratch.content().ends_with(text));
        let error = append(&scratch, true).unwrap_err().to_string();
        assert!(error.contains("leave --fov-deg away"), "{error}");
    }

    #[test]
    fn a_line_that_was_cut_off_spoils_itself_only() {
        let names = "\u{feff}case, target_x ,\"target_y\",column,sigma_rad\r\n";
        let scratch = Scratch::new(Some(&format!("{names}camera,1,2,43")));
        append(&scratch, true).unwrap();
        assert_eq!(
            scratch.content(),
            format!("{names}camera,1,2,43\ncamera,1,-2.5,43.5,0.002710\n")
        );
    }

    #[test]
    fn files_with_other_columns_stay_as_they_are() {
        let long = "x".repeat(1 << 20);
        for content in ["case,x,y\n1,2,3\n", "no table at all", &long] {
            let scratch = Scratch::new(Some(content));
            assert!(matches!(
                append(&scratch, true),
                Err(RecordError::Columns { .. })
            ));
            assert_eq!(scratch.content(), content);
        }
    }

    #[test]
    fn a_case_is_one_line() {
        let scratch = Scratch::new(None);
        let mut recording = Recording::open(&scratch.path(), true).unwrap();
        for case in ["", " ", "a\nb"] {
            let row = Row { case, ..ROW };
            assert!(matches!(recording.append(&row), Err(RecordError::Case)));
        }
        // No file is left of what was never recorded.
        assert!(!scratch.path().exists());
    }

    #[test]
    fn two_that_begin_a_file_share_its_names() {
        let scratch = Scratch::new(None);
        let mut both = [0, 1].map(|_| Recording::open(&scratch.path(), true).unwrap());
        both.iter_mut().for_each(|one| one.append(&ROW).unwrap());
        assert_eq!(scratch.content().lines().count(), 3);
        let other = Scratch::new(None);
        let mut late = Recording::open(&other.path(), true).unwrap();
        append(&other, false).unwrap();
        assert!(matches!(
            late.append(&ROW),
            Err(RecordError::Columns { .. })
        ));
    }
}
