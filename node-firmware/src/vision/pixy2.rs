//! The Pixy2 as a [`BlobCamera`].
//!
//! It is taught its colours beforehand, with its button or in `PixyMon`: no request of its serial line
//! does that. It adapts to the light by itself, and that cannot be stopped; a signature is a colour
//! without its brightness, so that little is lost. It knows no frame differencing.
//!
//! # Which blob
//! The CMUcam2 puts one box around everything of a colour, the Pixy2 tells connected blobs apart, the
//! largest first. The largest one is the target; specks are nothing. If the next one has a quarter of
//! its area or more, it may as well be the target, or a part of it behind a post: then the
//! [middle of mass](Blob::centroid) is that of both, and the look is
//! [lopsided](super::Look::Lopsided).
//!
//! # Its columns
//! Blobs are told in 316 columns, but found in 158 units of two. By the maker's firmware
//! (`charmedlabs/pixy2`, `rls_m0.c` and `blobs.cpp`), a row's blob begins with the first unit of its colour,
//! and is noticed to go on every fourth unit only. It is told to end with the unit after the last noticed
//! one. Rows of a round object begin and end at different units, and the widest counts, so that its right
//! edge is told up to some units too far left, and never too far right. Over balls of 10 to 50 columns before
//! an emulated camera that does the same (`tests/pixy2.rs`), the left edge errs by 0.6 columns (one sigma:
//! that of a unit), the right one by 1.65 too little on average and by 1.5 about that, the middle by 0.7. So
//! the average loss is added, and both edges count as known to 3.5 columns. Balls of less than 10 columns are
//! told by up to a column too far left.

use embassy_futures::yield_now;
use embedded_hal_async::delay::DelayNs;
use embedded_io_async::{Read, Write};
use pixy2_driver::{Block, Error, Pixy2, packet::Signatures, session::Fault};

use super::{Blob, BlobCamera, LearntColour, Subject, VisionError};
use crate::{log::warning, message::TrackedBlob};

/// Columns of its frames.
pub const COLUMNS: u16 = 316;

/// Its rate as it is shipped, bits per second.
pub const BAUD: u32 = 19_200;

/// Columns by which the right edge of a round object is told too far left, on average.
const LATE: f32 = 1.65;

/// Width, columns, of the unit whose rounding is as uncertain as both edges are.
const UNIT: f32 = 3.5;

/// A second blob counts if it has this share of the area of the first one.
const RIVAL: f32 = 0.25;

/// Questions for its identity before it is called silent: for more than it takes to start.
const PATIENCE: u8 = 20;

/// A Pixy2 on a UART. See the [module](self).
#[derive(Debug)]
pub struct Pixy2BlobCamera<U, D> {
    camera: Pixy2<U, D>,
    /// Columns of the lens.
    columns: u16,
    ready: bool,
    /// The signature that it looks for.
    signature: Option<u8>,
}

impl<U, D> Pixy2BlobCamera<U, D> {
    /// A camera of which nothing is known, behind a lens of so many columns. Nothing is sent before the
    /// first call.
    pub fn new(camera: Pixy2<U, D>, columns: u16) -> Self {
        Self {
            camera,
            columns,
            ready: false,
            signature: None,
        }
    }
}

fn failed<E: embedded_io::Error>(error: Error<E>) -> VisionError {
    let error = match error {
        Error::Uart(error) => VisionError::Line(error.kind()),
        Error::Closed => VisionError::Closed,
        Error::Camera(fault) => match fault {
            Fault::Silence => VisionError::Silent,
            Fault::Garbled => VisionError::Garbled,
            Fault::Busy => VisionError::Busy,
            Fault::Refused(_) => VisionError::Refused,
        },
    };
    warning!("camera: {}", error);
    error
}

impl<U: Read + Write, D: DelayNs> BlobCamera for Pixy2BlobCamera<U, D> {
    /// Waits for one that is starting; it takes about two seconds.
    async fn start_up(&mut self) -> Result<(), VisionError> {
        self.ready = false;
        self.signature = None;
        let mut tries = 0;
        while let Err(error) = self.camera.version().await {
            let is_silent = matches!(error, Error::Camera(Fault::Silence | Fault::Garbled));
            tries += 1;
            if !is_silent || tries >= PATIENCE {
                return Err(failed(error));
            }
            yield_now().await;
        }
        let (columns, _) = self.camera.resolution().await.map_err(failed)?;
        if columns != self.columns {
            return Err(VisionError::Columns {
                camera: columns,
                lens: self.columns,
            });
        }
        self.ready = true;
        Ok(())
    }

    async fn learn_colour(&mut self) -> Result<LearntColour, VisionError> {
        Err(VisionError::Unable)
    }

    async fn learn_background(&mut self) -> Result<(), VisionError> {
        Err(VisionError::Unable)
    }

    async fn begin(&mut self, subject: Subject) -> Result<(), VisionError> {
        if !self.ready {
            return Err(VisionError::NotStarted);
        }
        let Subject::Signature(signature @ 1..=7) = subject else {
            return Err(VisionError::Unable);
        };
        self.signature = Some(signature);
        Ok(())
    }

    async fn next(&mut self) -> Result<Option<Blob>, VisionError> {
        let signature = self.signature.ok_or(VisionError::NotBegun)?;
        let of = Signatures::one(signature);
        let mut blocks = self.camera.blocks(of, 2).await.map_err(failed)?;
        let largest = blocks.next();
        Ok(largest.map(|largest| blob(&largest, blocks.next().as_ref())))
    }

    async fn end(&mut self) -> Result<(), VisionError> {
        self.signature = None;
        Ok(())
    }
}

/// The blob of the largest block, and of the next one.
pub fn blob(largest: &Block, next: Option<&Block>) -> Blob {
    let area = |block: &Block| f32::from(block.width) * f32::from(block.height);
    let box_of = |block: &Block| {
        let [left, top] = [block.left(), block.top()].map(|edge| f32::from(edge) - 0.5);
        let right = left + f32::from(block.width) + LATE;
        // Its last row is not counted.
        [left, top, right, top + f32::from(block.height) + 1.0]
    };
    let middle =
        |[left, top, right, bottom]: [f32; 4]| [(left + right) * 0.5, (top + bottom) * 0.5];
    let found = box_of(largest);
    let mut centroid = middle(found);
    if let Some(next) = next {
        let share = area(next) / area(largest).max(1.0);
        if share >= RIVAL {
            let other = middle(box_of(next));
            let mean = |at: f32, other: f32| (at + share * other) / (1.0 + share);
            let ([x, y], [other_x, other_y]) = (centroid, other);
            centroid = [mean(x, other_x), mean(y, other_y)];
        }
    }
    let [left, top, right, bottom] = found;
    let ends = |from: u16, length: u16| from.saturating_add(length);
    Blob {
        left,
        right,
        top,
        bottom,
        centroid,
        pixels: 0,
        confidence: 0,
        cell_width: UNIT,
        told: TrackedBlob {
            middle: [largest.x, largest.y],
            edges: [
                largest.left(),
                largest.top(),
                ends(largest.left(), largest.width),
                ends(largest.top(), largest.height),
            ],
            pixels: 0,
            confidence: 0,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::{Judge, Lens, Look, Patience, Shape};

    const fn block(x: u16, width: u16, height: u16) -> Block {
        Block {
            signature: 1,
            x,
            y: 100,
            width,
            height,
            angle: 0,
            index: 0,
            age: 9,
        }
    }

    fn look(largest: &Block, next: Option<&Block>) -> Look {
        let camera = Lens::pin_hole(COLUMNS, 60.0).camera().unwrap();
        let shape = Shape::Round {
            rows_per_column: 1.0,
        };
        let mut judge = Judge::new(camera, Patience::default(), shape);
        let mut looks = (0..40).map(|_| judge.push(Some(blob(largest, next))));
        looks.find_map(|look| look).unwrap()
    }

    #[test]
    fn a_block_is_a_box_in_columns() {
        let blob = blob(&block(110, 20, 19), None);
        assert_eq!((blob.left, blob.top, blob.bottom), (99.5, 90.5, 110.5));
        assert_eq!(blob.right, 99.5 + 20.0 + LATE);
        assert_eq!(blob.told.edges, [100, 91, 120, 110]);
        assert_eq!(blob.centroid[0], blob.middle());
        assert!(!blob.is_clipped(COLUMNS));
        // A blob that reaches the first or the last unit is cut off.
        assert!(super::blob(&block(10, 20, 19), None).is_clipped(COLUMNS));
        assert!(super::blob(&block(306, 20, 19), None).is_clipped(COLUMNS));
    }

    /// Specks are nothing, and a rival is too much.
    #[test]
    fn the_largest_is_the_target_unless_another_may_be() {
        let ball = block(110, 20, 19);
        assert!(matches!(look(&ball, None), Look::Steady(_)));
        assert_eq!(look(&ball, Some(&block(250, 6, 7))), look(&ball, None));
        assert_eq!(look(&ball, Some(&block(250, 14, 13))), Look::Lopsided);
        // Half of a ball behind a post, with nothing of the other half.
        assert_eq!(look(&block(110, 10, 19), None), Look::Lopsided);
    }
}
