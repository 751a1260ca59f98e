//! YUV4MPEG2 streams, which ffmpeg makes of any video, as pictures with times.

use std::{
    fs::File,
    io::{self, BufRead, BufReader, Read},
    num::IntErrorKind,
    path::Path,
    str,
    sync::Arc,
};

use cmucam2_emulator::{Picture, Plane};
use y4m::{Colorspace, Decoder, Limits};

/// A frame has at most so many bytes: 4:4:4 with as many pixels as a [`Plane`] may have.
const FRAME_MAX: usize = 3 << 24;

/// Pictures have at most so many columns, and rows: the decoder multiplies without looking.
const SIDE_MAX: u32 = 1 << 16;

/// A header has at most so many bytes, for the decoder too.
const HEADER_MAX: u64 = 1024;

/// Word of the header for the full range of levels, as ffmpeg writes it.
const FULL_RANGE: &[u8] = b"XCOLORRANGE=FULL";

/// Reason why there is no video, or no more of it.
#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    /// It begins with other bytes.
    #[error(
        "this is no YUV4MPEG2 stream: `ffmpeg -i INPUT -pix_fmt yuv420p -f yuv4mpegpipe -` makes one"
    )]
    OtherFormat,
    /// Samples of more than 8 bits, or planes of another kind.
    #[error("pixels of this kind are not understood: give ffmpeg `-pix_fmt yuv420p`")]
    OtherPixels,
    /// A header without a rate or with an impossible one.
    #[error("{0} frames a second are no rate: give ffmpeg `-r 25`, for example")]
    Rate(String),
    /// More than 16 million pixels.
    #[error("the pictures are too large: give ffmpeg `-vf scale=1280:-2`")]
    TooLarge,
    /// There is no picture.
    #[error("there is no picture in it")]
    Empty,
    /// Bytes after some frames are no frame.
    #[error("after {0} pictures comes something that is none")]
    Damaged(u64),
    /// The operating system's answer.
    #[error("it cannot be read")]
    Io(#[from] io::Error),
}

/// A video that is read from its beginning to its end.
pub struct Video {
    decoder: Decoder<Box<dyn Read + Send>>,
    full_range: bool,
    /// Frames a second.
    rate: f64,
    /// Pictures that were read.
    read: u64,
    /// The last one of them, for [`Video::at`].
    shown: Option<Arc<Picture>>,
}

impl Video {
    /// A file.
    ///
    /// # Errors
    /// It cannot be opened, or [`Video::new`] fails.
    pub fn open(path: &Path) -> Result<Self, VideoError> {
        Self::new(BufReader::with_capacity(1 << 16, File::open(path)?))
    }

    /// A video from any reader; its header is read.
    ///
    /// # Errors
    /// The stream is no video, or of a kind that is not supported.
    pub fn new(mut reader: impl BufRead + Send + 'static) -> Result<Self, VideoError> {
        let header = header(&mut reader)?;
        if !header.split(u8::is_ascii_whitespace).all(is_reasonable) {
            return Err(VideoError::TooLarge);
        }
        let reader: Box<dyn Read + Send> = Box::new(io::Cursor::new(header).chain(reader));
        let limits = Limits { bytes: FRAME_MAX };
        let decoder = Decoder::new_with_limits(reader, limits).map_err(|error| match error {
            y4m::Error::UnknownColorspace => VideoError::OtherPixels,
            y4m::Error::OutOfMemory => VideoError::TooLarge,
            y4m::Error::IoError(error) => error.into(),
            _ => VideoError::OtherFormat,
        })?;
        if decoder.get_bytes_per_sample() != 1 {
            return Err(VideoError::OtherPixels);
        }
        let ratio = decoder.get_framerate();
        let rate = ratio.num as f64 / ratio.den as f64;
        if !(rate.is_finite() && rate > 0.0) {
            return Err(VideoError::Rate(ratio.to_string()));
        }
        let parameters = decoder.get_raw_params();
        Ok(Self {
            full_range: parameters
                .split(|&byte| byte == b' ')
                .any(|word| word == FULL_RANGE),
            rate,
            decoder,
            read: 0,
            shown: None,
        })
    }

    /// Columns and rows of its pictures.
    pub fn size(&self) -> (usize, usize) {
        (self.decoder.get_width(), self.decoder.get_height())
    }

    /// Pictures a second.
    pub fn rate(&self) -> f64 {
        self.rate
    }

    /// Time at which the next picture is due, seconds after the first.
    pub fn next_at(&self) -> f64 {
        self.read as f64 / self.rate
    }

    /// The next picture; `None` after the last one. A picture that is cut off by the end does not count.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn next_picture(&mut self) -> Result<Option<Picture>, VideoError> {
        let (width, height) = self.size();
        let [across, down] = match self.decoder.get_colorspace() {
            Colorspace::Cmono => [0, 0],
            Colorspace::C444 => [1, 1],
            Colorspace::C422 => [2, 1],
            _ => [2, 2],
        };
        let frame = match self.decoder.read_frame() {
            Ok(frame) => frame,
            Err(y4m::Error::EOF) => return Ok(None),
            Err(y4m::Error::IoError(error)) => return Err(error.into()),
            Err(_) => return Err(VideoError::Damaged(self.read)),
        };
        let plane = |width: usize, height: usize, samples: &[u8]| {
            Plane::new(width, height, samples.to_vec()).ok_or(VideoError::TooLarge)
        };
        let chroma = |samples| plane(width.div_ceil(across), height.div_ceil(down), samples);
        let chrominance = match across {
            0 => None,
            _ => Some([chroma(frame.get_u_plane())?, chroma(frame.get_v_plane())?]),
        };
        self.read += 1;
        Ok(Some(Picture {
            luminance: plane(width, height, frame.get_y_plane())?,
            chrominance,
            full_range: self.full_range,
        }))
    }

    /// The picture that is shown so many seconds after the first: never an earlier one than at the last
    /// call, and the last one for ever.
    ///
    /// # Errors
    /// A picture up to then cannot be read, or there is none at all.
    pub fn at(&mut self, seconds: f64) -> Result<Arc<Picture>, VideoError> {
        while self.shown.is_none() || self.next_at() <= seconds {
            match self.next_picture()? {
                Some(picture) => self.shown = Some(Arc::new(picture)),
                None => break,
            }
        }
        self.shown.clone().ok_or(VideoError::Empty)
    }
}

/// The first line, or as much of it as a header may have.
fn header(reader: &mut impl BufRead) -> io::Result<Vec<u8>> {
    let mut header = Vec::new();
    reader.take(HEADER_MAX).read_until(b'\n', &mut header)?;
    Ok(header)
}

/// Returns false if a word of the header is a width or height that no picture has. The decoder refuses
/// a word that is no number.
fn is_reasonable(word: &[u8]) -> bool {
    let [b'W' | b'H', digits @ ..] = word else {
        return true;
    };
    match str::from_utf8(digits).map(str::parse::<u32>) {
        Ok(Ok(side)) => side <= SIDE_MAX,
        Ok(Err(error)) => *error.kind() != IntErrorKind::PosOverflow,
        Err(_) => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn video(bytes: &[u8]) -> Result<Video, VideoError> {
        Video::new(io::Cursor::new(bytes.to_vec()))
    }

    #[test]
    fn pictures_and_their_times() {
        let mut bytes = b"YUV4MPEG2 W3 H1 F5:2 Ip A1:1 C420jpeg\n".to_vec();
        for level in [10, 20, 30] {
            bytes.extend(b"FRAME\n");
            bytes.extend([level; 3 + 2 + 2]);
        }
        let mut film = video(&bytes).unwrap();
        assert_eq!((film.size(), film.rate()), ((3, 1), 2.5));
        for (at, level) in [(0.0, 10), (0.39, 10), (0.41, 20), (0.2, 20), (9.0, 30)] {
            let picture = film.at(at).unwrap();
            assert_eq!(picture.luminance.samples(), [level; 3], "at {at}");
            let [blue, red] = picture.chrominance.as_ref().unwrap();
            assert_eq!((blue.width(), blue.height(), red), (2, 1, blue));
        }
        // The last picture is cut off: it is none.
        bytes.pop();
        let mut film = video(&bytes).unwrap();
        assert_eq!(film.at(9.0).unwrap().luminance.samples(), [20; 3]);
    }

    #[test]
    fn the_range_is_what_the_stream_says() {
        for (words, full) in [
            ("", false),
            (" XCOLORRANGE=FULL", true),
            (" XCOLORRANGE=LIMITED", false),
        ] {
            let bytes = format!("YUV4MPEG2 W1 H1 F1:1 Cmono{words}\nFRAME\nx");
            let picture = video(bytes.as_bytes()).unwrap().at(0.0).unwrap();
            assert_eq!((picture.full_range, &picture.chrominance), (full, &None));
        }
    }

    #[test]
    fn what_is_wrong_is_told_with_what_to_do() {
        for (bytes, word) in [
            (&b"RIFF....AVI LIST"[..], "yuv4mpegpipe"),
            (b"", "yuv4mpegpipe"),
            (b"YUV4MPEG2 W4 H4 F25:1 C420p10\n", "yuv420p"),
            (b"YUV4MPEG2 W4 H4 F25:1 C411\n", "yuv420p"),
            (b"YUV4MPEG2 W4 H4 F0:0\n", "0:0 frames"),
            (b"YUV4MPEG2 W90000 H4000 F25:1\n", "scale="),
            (b"YUV4MPEG2 W60000 H60000 F25:1\n", "scale="),
            (b"YUV4MPEG2 W65536 H65536 F25:1 C444\n", "scale="),
            (b"YUV4MPEG2 W4294967296 H4294967296\n", "scale="),
            (b"YUV4MPEG2 W+4294967296 H1 W1\n", "scale="),
            (b"YUV4MPEG2 W18446744073709551616 H1\n", "scale="),
            (b"YUV4MPEG2 W1 H18446744073709551615\n", "scale="),
            (b"YUV4MPEG2 Wide Height\n", "yuv4mpegpipe"),
            (b"YUV4MPEG2 W4 H4 F25:1\n", "no picture"),
            (
                b"YUV4MPEG2 W1 H1 F25:1\nFRAME\nxyzFRANE\nxyz",
                "after 1 pictures",
            ),
        ] {
            let error = video(bytes)
                .and_then(|mut video| video.at(9.0))
                .unwrap_err();
            assert!(error.to_string().contains(word), "{error}");
        }
    }
}
