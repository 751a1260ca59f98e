//! A frame of the camera as PNG.

use cmucam2_driver::{
    Cmucam2, Command, Error,
    parser::{ImageHeader, ImageKind},
    session::{Answer, Fault},
};
use embedded_hal::delay::DelayNs;
use embedded_io::{Read, ReadReady, Write};

/// Bytes of the longest row: 176 pixels of three.
const ROW: usize = 176 * 3;

/// Bytes of a pixel.
const CHANNELS: usize = 3;

/// Number of times that a pixel stands in its row of the PNG, because it is twice as wide as tall.
const WIDTH_OF_PIXEL: usize = 2;

/// A frame as it came.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    width: usize,
    height: usize,
    /// Row by row; missing pixels are black.
    rgb: Vec<u8>,
    rows: usize,
    damaged: usize,
}

impl Picture {
    fn new(header: ImageHeader) -> Self {
        let (width, height) = (usize::from(header.width), usize::from(header.height));
        Self {
            width,
            height,
            rgb: vec![0; width * height * CHANNELS],
            rows: 0,
            damaged: 0,
        }
    }

    fn add(&mut self, row: &[u8], intact: bool) {
        let length = self.width * CHANNELS;
        let place = self.rgb.chunks_exact_mut(length).nth(self.rows);
        if let Some(place) = place {
            for (pixel, &byte) in place.iter_mut().zip(row) {
                *pixel = byte;
            }
        }
        self.rows += 1;
        self.damaged += usize::from(!intact);
    }

    /// Columns and rows of the camera.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Rows that are not as the camera sent them, or did not come.
    pub fn damaged(&self) -> usize {
        self.damaged + self.height.saturating_sub(self.rows)
    }

    /// As PNG of 8 bits in RGB, with the camera's own levels, 16 to 240. Every pixel is there twice,
    /// side by side, because the camera's pixels are twice as wide as tall.
    ///
    /// # Errors
    /// Those of the encoder; a frame of the camera gives none.
    pub fn png(&self) -> Result<Vec<u8>, png::EncodingError> {
        let doubled: Vec<u8> = self
            .rgb
            .as_chunks::<CHANNELS>()
            .0
            .iter()
            .flat_map(|pixel| [pixel; WIDTH_OF_PIXEL])
            .flatten()
            .copied()
            .collect();
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(
            &mut file,
            (self.width * WIDTH_OF_PIXEL) as u32,
            self.height as u32,
        );
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&doubled)?;
        writer.finish()?;
        Ok(file)
    }
}

/// Takes a colour frame. `progress` is told the rows so far and all of them.
///
/// # Errors
/// Those of the driver. Damaged and missing rows are none: see [`Picture::damaged`].
pub fn take<U, D>(
    camera: &mut Cmucam2<U, D>,
    mut progress: impl FnMut(usize, usize),
) -> Result<Picture, Error<U::Error>>
where
    U: Read + Write + ReadReady,
    D: DelayNs,
{
    camera.stream(Command::SendFrame(None)).wait()?;
    let mut picture = None;
    let mut row = [0; ROW];
    loop {
        match camera.next_part(&mut row).wait()? {
            Answer::Header(header) if header.kind == ImageKind::Frame(CHANNELS as u8) => {
                progress(0, usize::from(header.height));
                picture = Some(Picture::new(header));
            }
            Answer::Row { bytes, intact } => {
                if let Some(picture) = &mut picture {
                    let bytes = row.get(..usize::from(bytes)).unwrap_or(&row);
                    picture.add(bytes, intact);
                    progress(picture.rows, picture.height);
                }
            }
            Answer::End { intact, .. } => {
                let mut picture = picture.ok_or(Error::Camera(Fault::Garbage))?;
                // Bytes too many: the row where they came is not known.
                picture.damaged += usize::from(!intact && picture.damaged() == 0);
                return Ok(picture);
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(file: &[u8]) -> (u32, u32, Vec<u8>) {
        let mut reader = png::Decoder::new(std::io::Cursor::new(file))
            .read_info()
            .unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!(info.color_type, png::ColorType::Rgb);
        (info.width, info.height, pixels)
    }

    fn of(width: u8, height: u8) -> Picture {
        Picture::new(ImageHeader {
            kind: ImageKind::Frame(3),
            width,
            height,
            row_bytes: u16::from(width) * 3,
        })
    }

    #[test]
    fn pixels_are_twice_as_wide_as_tall() {
        let mut picture = of(2, 2);
        picture.add(&[16, 17, 18, 100, 101, 102], true);
        picture.add(&[240, 239, 238, 50, 51, 52], true);
        assert_eq!(picture.damaged(), 0);
        let (width, height, pixels) = decoded(&picture.png().unwrap());
        assert_eq!((width, height), (4, 2));
        assert_eq!(
            pixels,
            [
                16, 17, 18, 16, 17, 18, 100, 101, 102, 100, 101, 102, //
                240, 239, 238, 240, 239, 238, 50, 51, 52, 50, 51, 52
            ]
        );
    }

    #[test]
    fn what_did_not_come_is_black_and_counted() {
        let mut picture = of(2, 4);
        picture.add(&[100; 6], true);
        picture.add(&[100; 2], false);
        assert_eq!(picture.damaged(), 3);
        let (.., pixels) = decoded(&picture.png().unwrap());
        assert_eq!(pixels[12..18], [100, 100, 0, 100, 100, 0]);
        assert!(pixels[18..].iter().all(|&level| level == 0));
        // More rows than announced are not drawn.
        for _ in 0..9 {
            picture.add(&[200; 6], true);
        }
        assert_eq!(decoded(&picture.png().unwrap()).1, 4);
    }
}
