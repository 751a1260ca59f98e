//! Cameras of the Pixy family as a [`BlobCamera`].
//!
//! # The Pixy2 and the original Pixy
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
//! A Pixy2's blobs are told in 316 columns, but found in 158 units of two; the original's in 320 and 160. By the
//! maker's firmware (`charmedlabs/pixy2`, `rls_m0.c` and `blobs.cpp`), a row's blob begins with the first unit of
//! its colour, and is noticed to go on every fourth unit only. It is told to end with the unit after the last noticed
//! one. Rows of a round object begin and end at different units, and the widest counts, so that its right
//! edge is told up to some units too far left, and never too far right. Over balls of 10 to 50 columns before
//! an emulated camera that does the same (`tests/pixy.rs`), the left edge errs by 0.6 columns (one sigma:
//! that of a unit), the right one by 1.65 too little on average and by 1.5 about that, the middle by 0.7. So
//! the average loss is added, and both edges count as known to 3.5 columns. Balls of less than 10 columns are
//! told by up to a column too far left.
//!
//! # The OpenMV Cam
//! Its script for blobs tells the middle of their mass and the size of their box, both whole; the edges are half a
//! width beside the middle. So the shape tells whether a ball is narrower than tall, and no more. Over balls before an
//! emulated camera (`tests/pixy.rs`) the middle errs by 0.4 columns at most. Its script for tags tells the middle of
//! a tag, found to a fraction of a column and then rounded to a whole one, and which tag it is. A tag that is not whole
//! in view is not found. Seen at an angle it is narrower than tall, so its shape tells nothing.

use core::{
    convert::Infallible,
    future::{Future, pending},
};

use embassy_futures::yield_now;
use embedded_hal_async::delay::DelayNs;
use embedded_io_async::{Read, Write};
use pixy_driver::{
    Block, Error, Model, Pixy,
    packet::{Request, Signatures},
    session::{Answer, Fault},
};

use super::{Blob, BlobCamera, LearntColour, Rows, Subject, VisionError};
use crate::{hardware::Done, log::warning, message::TrackedBlob};

/// Columns by which a Pixy tells the right edge of a round object too far left, on average.
const LATE: f32 = 1.65;

/// Width, columns, of the unit whose rounding is as uncertain as both edges are.
const fn unit(model: Model) -> f32 {
    match model {
        Model::Pixy2 | Model::Pixy => 3.5,
        Model::OpenMv | Model::OpenMvTags => 1.5,
    }
}

/// A second blob counts if it has this share of the area of the first one.
const RIVAL: f32 = 0.25;

/// Questions for its identity, or for anything, before it is called silent: for more than it takes to start.
const fn patience(model: Model) -> u8 {
    match model {
        Model::Pixy2 => 20,
        Model::Pixy => 10,
        Model::OpenMv | Model::OpenMvTags => 4,
    }
}

/// A camera on a UART. See the [module](self).
#[derive(Debug)]
pub struct PixyBlobCamera<U, D> {
    camera: Pixy<U, D>,
    /// Columns of the lens.
    columns: u16,
    ready: bool,
    /// Signatures that it looks for.
    of: Option<Signatures>,
}

impl<U, D> PixyBlobCamera<U, D> {
    /// A camera of which nothing is known, behind a lens of so many columns. Nothing is sent before the
    /// first call.
    pub fn new(camera: Pixy<U, D>, columns: u16) -> Self {
        Self {
            camera,
            columns,
            ready: false,
            of: None,
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
            _ => VisionError::Refused,
        },
    };
    warning!("camera: {}", error);
    error
}

impl<U, D> PixyBlobCamera<U, D> {
    /// The line to it, if nothing comes that it was not asked for.
    pub fn quiet_line(&mut self) -> Option<&mut U> {
        let streams = self.camera.model().streams();
        (!streams).then(|| self.camera.uart())
    }

    fn look_for(&mut self, subject: Subject) -> Result<(), VisionError> {
        if !self.ready {
            return Err(VisionError::NotStarted);
        }
        self.of = Some(match (subject, self.camera.model()) {
            (Subject::Tag(number), Model::OpenMvTags) => Signatures::tag(number.into()),
            (_, Model::OpenMvTags) => return Err(VisionError::Unable),
            (Subject::Signature(signature @ 1..=7), _) => Signatures::one(signature),
            _ => return Err(VisionError::Unable),
        });
        Ok(())
    }
}

impl<U: Read + Write, D: DelayNs> BlobCamera for PixyBlobCamera<U, D> {
    /// Waits for one that is starting; a Pixy takes about two seconds.
    async fn start_up(&mut self) -> Result<(), VisionError> {
        self.ready = false;
        self.of = None;
        let model = self.camera.model();
        let mut request = if model.streams() {
            ANYTHING
        } else {
            Request::Version
        };
        let mut tries = 0;
        loop {
            match self.camera.request(request).run().await {
                Ok(Answer::Version(_)) => request = Request::Resolution,
                Ok(Answer::Resolution(columns, _)) if columns != self.columns => {
                    return Err(VisionError::Columns {
                        camera: columns,
                        lens: self.columns,
                    });
                }
                Ok(_) => break,
                Err(error) => {
                    let is_silent = matches!(error, Error::Camera(Fault::Silence | Fault::Garbled));
                    tries += 1;
                    if !is_silent || tries >= patience(model) {
                        return Err(failed(error));
                    }
                    yield_now().await;
                }
            }
        }
        self.ready = true;
        Ok(())
    }

    fn learn_colour(&mut self) -> impl Future<Output = Result<LearntColour, VisionError>> {
        Done::new(Err(VisionError::Unable))
    }

    fn learn_background(&mut self) -> impl Future<Output = Result<(), VisionError>> {
        Done::new(Err(VisionError::Unable))
    }

    fn begin(&mut self, subject: Subject) -> impl Future<Output = Result<(), VisionError>> {
        Done::new(self.look_for(subject))
    }

    async fn next(&mut self) -> Result<Option<Blob>, VisionError> {
        let of = self.of.ok_or(VisionError::NotBegun)?;
        let model = self.camera.model();
        let request = Request::Blocks { of, most: 2 };
        let answered = self.camera.request(request).run().await;
        answered.map_err(failed)?;
        let mut blocks = self.camera.session().blocks();
        let largest = blocks.next();
        Ok(largest.map(|largest| blob(model, &largest, blocks.next().as_ref())))
    }

    fn end(&mut self) -> impl Future<Output = Result<(), VisionError>> {
        self.of = None;
        Done::new(Ok(()))
    }

    async fn rest(&mut self) -> Infallible {
        while self.camera.model().streams() {
            // A camera that is silent, or cannot be understood, has taken its time.
            if !matches!(
                self.camera.request(ANYTHING).run().await,
                Ok(_) | Err(Error::Camera(_))
            ) {
                break;
            }
        }
        pending().await
    }
}

/// Asks for the next picture, whatever is in it.
const ANYTHING: Request = Request::Blocks {
    of: Signatures::ALL,
    most: 0,
};

/// The blob of the largest block, and of the next one.
pub fn blob(model: Model, largest: &Block, next: Option<&Block>) -> Blob {
    let area = |block: &Block| f32::from(block.width) * f32::from(block.height);
    let box_of = |block: &Block| {
        let [width, height] = [block.width, block.height].map(f32::from);
        if matches!(model, Model::OpenMv | Model::OpenMvTags) {
            let [x, y] = [block.x, block.y].map(f32::from);
            let [half, tall] = [width * 0.5, height * 0.5];
            return [x - half, y - tall, x + half, y + tall];
        }
        let [left, top] = [block.left(), block.top()].map(|edge| f32::from(edge) - 0.5);
        // Its last row is not counted.
        [left, top, left + width + LATE, top + height + 1.0]
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
    let [_, rows] = model.size();
    let ends = |from: u16, length: u16| from.saturating_add(length);
    Blob {
        left,
        right,
        top,
        bottom,
        centroid,
        pixels: 0,
        confidence: 0,
        cell_width: unit(model),
        rows: Some(Rows {
            count: rows,
            per_column: 1.0,
        }),
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
        let camera = Lens::pin_hole(316, 60.0).camera().unwrap();
        let shape = Shape::Round {
            rows_per_column: 1.0,
            optics: None,
        };
        let mut judge = Judge::new(camera, Patience::default(), shape);
        let mut looks = (0..40).map(|_| judge.push(Some(blob(Model::Pixy2, largest, next))));
        looks.find_map(|look| look).unwrap()
    }

    #[test]
    fn a_block_is_a_box_in_columns() {
        let blob = blob(Model::Pixy2, &block(110, 20, 19), None);
        assert_eq!((blob.left, blob.top, blob.bottom), (99.5, 90.5, 110.5));
        assert_eq!(blob.right, 99.5 + 20.0 + LATE);
        assert_eq!(blob.told.edges, [100, 91, 120, 110]);
        assert_eq!(blob.centroid[0], blob.middle());
        assert!(!blob.is_clipped(316));
        // OpenMV tells the middle of the mass.
        let openmv = super::blob(Model::OpenMv, &block(110, 21, 20), None);
        assert_eq!((openmv.left, openmv.right), (99.5, 120.5));
        assert_eq!((openmv.top, openmv.bottom), (90.0, 110.0));
        // A blob that reaches the first or the last unit is cut off.
        assert!(super::blob(Model::Pixy2, &block(10, 20, 19), None).is_clipped(316));
        assert!(super::blob(Model::Pixy2, &block(306, 20, 19), None).is_clipped(316));
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
