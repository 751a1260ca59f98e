//! Lines to rows to cells.

use std::{
    borrow::Cow,
    io::{BufRead, Cursor, Read, SeekFrom},
};

use csv::{ByteRecord, Position, Reader, ReaderBuilder, Terminator};

use super::{Complaint, ReadError};

/// Longer lines are not rows: keeps a file without line ends out of memory.
const LINE_LIMIT: usize = 1 << 16;

/// The rows of a CSV file below its line of column names.
///
/// Lines are found first and split afterwards, so that a stray quote cannot swallow other rows,
/// and line numbers are those of an editor.
pub(super) struct Rows<R> {
    input: R,
    names: Vec<String>,
    line: u64,
    /// Of the line that is read.
    splitter: Reader<Cursor<Vec<u8>>>,
    cells: ByteRecord,
}

/// One row.
#[derive(Clone, Copy)]
pub(super) struct Row<'a> {
    line: u64,
    names: &'a [String],
    cells: &'a ByteRecord,
}

/// A column that was asked for: where it is in a row.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Column(usize);

impl<R: BufRead> Rows<R> {
    /// Reads the column names.
    pub(super) fn new(input: R) -> Result<Self, ReadError> {
        let splitter = ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .terminator(Terminator::Any(b'\n'))
            .buffer_capacity(1 << 10)
            .from_reader(Cursor::default());
        let mut rows = Self {
            input,
            names: Vec::new(),
            line: 0,
            splitter,
            cells: ByteRecord::new(),
        };
        let names: Vec<_> = match rows.next()? {
            Some(first) => first.all().map(Cow::into_owned).collect(),
            None => return Err(ReadError::Empty),
        };
        if names.iter().any(|name| name.contains(char::is_control)) {
            return Err(ReadError::NoText);
        }
        rows.names = names;
        Ok(rows)
    }

    /// The column of that name, if there is one.
    pub(super) fn find(&self, name: &str) -> Result<Option<Column>, ReadError> {
        let mut places = (0..).zip(&self.names).filter(|(_, n)| *n == name);
        match (places.next(), places.next()) {
            (Some(_), Some(_)) => Err(ReadError::TwoColumns(name.to_owned())),
            (first, _) => Ok(first.map(|(place, _)| Column(place))),
        }
    }

    /// The column of that name, which must be there.
    pub(super) fn need(&self, name: &str) -> Result<Column, ReadError> {
        self.find(name)?.ok_or_else(|| self.no_column(name))
    }

    /// The error that says which columns there are instead.
    pub(super) fn no_column(&self, missing: &str) -> ReadError {
        let found: Vec<String> = self.names.iter().map(|n| shortened(n)).collect();
        ReadError::NoColumn {
            missing: missing.to_owned(),
            found: found.join(", "),
        }
    }

    /// The next row that is not blank.
    pub(super) fn next(&mut self) -> Result<Option<Row<'_>>, ReadError> {
        loop {
            let line = self.splitter.get_mut().get_mut();
            line.clear();
            let limit = LINE_LIMIT as u64 + 1;
            let read = Read::by_ref(&mut self.input)
                .take(limit)
                .read_until(b'\n', line)?;
            if read == 0 {
                return Ok(None);
            }
            self.line += 1;
            if read > LINE_LIMIT {
                return Err(ReadError::LongLine {
                    line: self.line,
                    limit: LINE_LIMIT,
                });
            }
            if line
                .iter()
                .any(|b| !matches!(b, b',' | b' ' | b'\t' | b'\r' | b'\n'))
            {
                line.truncate(line.trim_ascii_end().len());
                break;
            }
        }
        let split = self.splitter.seek_raw(SeekFrom::Start(0), Position::new());
        split
            .and_then(|()| self.splitter.read_byte_record(&mut self.cells))
            .map_err(std::io::Error::from)?;
        Ok(Some(Row {
            line: self.line,
            names: &self.names,
            cells: &self.cells,
        }))
    }
}

impl<'a> Row<'a> {
    fn bytes(&self, place: usize) -> Option<&'a [u8]> {
        self.cells.get(place).map(<[u8]>::trim_ascii)
    }

    fn all(&self) -> impl Iterator<Item = Cow<'a, str>> + use<'a> {
        let cells = self.cells.iter();
        cells.map(|cell| String::from_utf8_lossy(cell.trim_ascii()))
    }

    /// A cell's text, empty if the row ends before it.
    pub(super) fn text(&self, column: Column) -> Cow<'a, str> {
        String::from_utf8_lossy(self.bytes(column.0).unwrap_or_default())
    }

    /// A cell as a number, NaN and infinities included.
    pub(super) fn number(&self, column: Column) -> Result<f64, String> {
        let cell = self.bytes(column.0);
        let number = cell
            .and_then(|cell| std::str::from_utf8(cell).ok())
            .and_then(|text| text.parse().ok());
        number.ok_or_else(|| {
            let name = self.names.get(column.0).map_or("", String::as_str);
            match cell {
                None => format!(
                    "the row ends before `{name}`: every row needs {} cells, this one has {}",
                    self.names.len(),
                    self.cells.len()
                ),
                Some([]) => format!("`{name}` is empty: a number belongs there"),
                Some(text) => format!(
                    "`{name}` is {}: a number belongs there",
                    shortened(&String::from_utf8_lossy(text))
                ),
            }
        })
    }

    /// Complaint about this row.
    pub(super) fn complaint(&self, text: String) -> Complaint {
        Complaint {
            line: self.line,
            text,
        }
    }
}

/// Foreign text, fit to stand in a message of one line.
pub(super) fn shortened(text: &str) -> String {
    const LONGEST: usize = 40;
    if text.chars().count() > LONGEST {
        let start: String = text.chars().take(LONGEST).collect();
        format!("{:?}", start + "...")
    } else {
        format!("{text:?}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(text: &str) -> Vec<Vec<String>> {
        let mut rows = Rows::new(text.as_bytes()).unwrap();
        let mut all = vec![rows.names.clone()];
        while let Some(row) = rows.next().unwrap() {
            all.push(row.all().map(Cow::into_owned).collect());
        }
        all
    }

    #[test]
    fn marks_line_ends_blanks_and_quotes_are_no_data() {
        let text =
            "\u{feff} a , b\r\n\r\n1,2\r\n , \n\"x, y\" ,\"say \"\"so\"\"\"\n3,\n4\n\n,,\n5,6";
        assert_eq!(
            cells(text),
            [
                vec!["a", "b"],
                vec!["1", "2"],
                vec!["x, y", "say \"so\""],
                vec!["3", ""],
                vec!["4"],
                vec!["5", "6"],
            ]
        );
    }

    #[test]
    fn an_open_quote_spoils_its_own_line_only() {
        let mut rows = Rows::new("a,b\n\"1,2\n3,4\n".as_bytes()).unwrap();
        let column = rows.need("b").unwrap();
        let spoilt = rows.next().unwrap().unwrap();
        assert_eq!(spoilt.line, 2);
        assert!(spoilt.number(column).unwrap_err().contains("ends before"));
        let next = rows.next().unwrap().unwrap();
        assert_eq!((next.line, next.number(column)), (3, Ok(4.0)));
    }

    #[test]
    fn a_file_without_line_ends_is_given_up() {
        let endless = std::io::BufReader::new(std::io::repeat(b'x'));
        assert!(matches!(
            Rows::new(endless),
            Err(ReadError::LongLine { line: 1, .. })
        ));
    }

    #[test]
    fn not_a_number_is_a_number_and_text_is_not() {
        let mut rows = Rows::new("a\nNaN\n-inf\n1e3\n1 2\n0x10\n\"\"\n".as_bytes()).unwrap();
        let column = rows.need("a").unwrap();
        let mut next = || rows.next().unwrap().unwrap().number(column);
        assert!(next().unwrap().is_nan());
        assert_eq!(next(), Ok(f64::NEG_INFINITY));
        assert_eq!(next(), Ok(1000.0));
        assert!(next().unwrap_err().contains("\"1 2\""));
        assert!(next().is_err());
        assert!(next().unwrap_err().contains("empty"));
    }
}
