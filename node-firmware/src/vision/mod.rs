//! Requirements of a camera role on its camera: is the target in view, in which direction, and how sure is
//! that.
//!
//! | module | job |
//! |---|---|
//! | here | [`BlobCamera`]: the seam that other blob cameras can fill, and [`Blob`]s as it gives them |
//! | [`cmucam2`], [`pixy`] | The CMUcam2 and the Pixy family behind that seam |
//! | [`either`] | The one of them that a node has |
//! | [`background`] | Share of the background that has a colour that was learnt |
//! | [`learning`] | Search for the colour that holds a whole object |
//! | [`steady`] | When a blob stands still, where its edges are, and how sure that is |
//! | [`mod@look`] | One look at a standing target: several frames to a direction, or why not |
//! | [`lens`] | Directions of columns |
//!
//! [`steady`] and [`look::Judge`] are sans-IO: blobs go in, a judgement comes out.
//! [`look()`] connects them to a camera.
//!
//! # Columns
//! Columns count as in [`calib_core::camera`] and thesis Appendix B: 0 to W-1, whole numbers at the
//! middle of a column, the middles of the first and the last one on the edges of the field of view.
//! A blob whose leftmost pixels are in column 20 and whose rightmost in column 27 has its edges at
//! 19.5 and 27.5.

pub mod background;
pub mod cmucam2;
pub mod either;
pub mod learning;
pub mod lens;
pub mod look;
pub mod pixy;
pub mod steady;

mod blob;
mod fault;
mod subject;

use core::{
    convert::Infallible,
    future::{Future, pending},
};

pub use self::{
    background::BackgroundShare,
    blob::{Blob, Grid, Rows},
    cmucam2::Cmucam2BlobCamera,
    either::EitherCamera,
    fault::VisionError,
    learning::Learning,
    lens::{Lens, LensError},
    look::{Judge, Look, Patience, look},
    pixy::PixyBlobCamera,
    steady::Shape,
    subject::{CameraKind, ColourWindow, LearntColour, Subject},
};

/// A camera that finds the blob of a subject in each of its frames.
///
/// A call that is dropped before its end leaves the camera in a state that the next call clears
/// up.
pub trait BlobCamera {
    /// Starts the camera anew: reset, adapt to the light for some seconds, then fix gain and white balance,
    /// so that a colour stays the same colour (thesis Appendix A, "Initialize"). A learnt background is lost,
    /// a search that was begun is ended.
    ///
    /// To be called first, and whenever [`VisionError::wants_start_up`].
    ///
    /// # Errors
    /// [`VisionError`].
    fn start_up(&mut self) -> impl Future<Output = Result<(), VisionError>>;

    /// Learns the colour of the object in the middle of the view (thesis Appendix A, "Object kept"), as far as
    /// that shows the whole object, and looks how much of the background has it. A search that was begun is ended.
    ///
    /// # Errors
    /// [`VisionError`]; [`VisionError::CommonColour`] where too much of the background has it,
    /// [`VisionError::PartOfObject`] where the object is not seen whole;
    /// [`VisionError::Unable`] of a camera that was taught its colours beforehand.
    fn learn_colour(&mut self) -> impl Future<Output = Result<LearntColour, VisionError>>;

    /// Takes the present view as the background of [`Subject::Motion`] (thesis 2.5). To be repeated from time
    /// to time while the target is out of view. A search that was begun is ended.
    ///
    /// # Errors
    /// [`VisionError`].
    fn learn_background(&mut self) -> impl Future<Output = Result<(), VisionError>>;

    /// Begins to look for a subject (thesis Appendix A, "Start to track").
    ///
    /// # Errors
    /// [`VisionError`]; [`VisionError::NoBackground`] for [`Subject::Motion`] before
    /// [`BlobCamera::learn_background`].
    fn begin(&mut self, subject: Subject) -> impl Future<Output = Result<(), VisionError>>;

    /// The blob of the next frame, or `None` when nothing of the subject is in view.
    ///
    /// # Errors
    /// [`VisionError`]; [`VisionError::NotBegun`] before [`BlobCamera::begin`].
    fn next(&mut self) -> impl Future<Output = Result<Option<Blob>, VisionError>>;

    /// Ends it (thesis Appendix A, "Stop tracking"). The camera is then silent.
    ///
    /// # Errors
    /// [`VisionError`].
    fn end(&mut self) -> impl Future<Output = Result<(), VisionError>>;

    /// Has the camera sleep, if it can. It is then to be [started up](Self::start_up) before anything else.
    fn sleep(&mut self) -> impl Future<Output = ()> {
        async {}
    }

    /// Reads what a camera tells that is not asked, until the call is dropped: the line must not overflow.
    fn rest(&mut self) -> impl Future<Output = Infallible> {
        pending()
    }
}
