//! The camera that a node is configured to have.

use core::convert::Infallible;

use cmucam2_driver::Cmucam2;
use embedded_hal_async::delay::DelayNs;
use pixy_driver::Pixy;

use super::{
    Blob, BlobCamera, Cmucam2BlobCamera, LearntColour, PixyBlobCamera, Subject, VisionError,
};
use crate::{config::CameraConfig, hardware::Line};

/// A CMUcam2, or a camera of the Pixy family, on a UART.
#[derive(Debug)]
pub enum EitherCamera<U, D> {
    /// [`CameraKind::Cmucam2`](super::CameraKind::Cmucam2)
    Cmucam2(Cmucam2BlobCamera<U, D>),
    /// All others.
    Pixy(PixyBlobCamera<U, D>),
}

impl<U, D> EitherCamera<U, D> {
    /// The one that is configured. Nothing is sent before the first call.
    pub fn new(config: &CameraConfig, uart: U, delay: D) -> Self {
        match config.kind.model() {
            None => {
                let camera = Cmucam2::new(uart, delay);
                Self::Cmucam2(Cmucam2BlobCamera::new(camera, config.cmucam2()))
            }
            Some(model) => {
                let camera = Pixy::new(model, uart, delay);
                Self::Pixy(PixyBlobCamera::new(camera, config.lens.columns))
            }
        }
    }
}

impl<U: Line, D: DelayNs> BlobCamera for EitherCamera<U, D> {
    async fn start_up(&mut self) -> Result<(), VisionError> {
        match self {
            Self::Cmucam2(camera) => camera.start_up().await,
            Self::Pixy(camera) => camera.start_up().await,
        }
    }

    async fn learn_colour(&mut self) -> Result<LearntColour, VisionError> {
        match self {
            Self::Cmucam2(camera) => camera.learn_colour().await,
            Self::Pixy(camera) => camera.learn_colour().await,
        }
    }

    async fn learn_background(&mut self) -> Result<(), VisionError> {
        match self {
            Self::Cmucam2(camera) => camera.learn_background().await,
            Self::Pixy(camera) => camera.learn_background().await,
        }
    }

    async fn begin(&mut self, subject: Subject) -> Result<(), VisionError> {
        match self {
            Self::Cmucam2(camera) => camera.begin(subject).await,
            Self::Pixy(camera) => camera.begin(subject).await,
        }
    }

    async fn next(&mut self) -> Result<Option<Blob>, VisionError> {
        match self {
            Self::Cmucam2(camera) => camera.next().await,
            Self::Pixy(camera) => camera.next().await,
        }
    }

    async fn end(&mut self) -> Result<(), VisionError> {
        match self {
            Self::Cmucam2(camera) => camera.end().await,
            Self::Pixy(camera) => camera.end().await,
        }
    }

    async fn sleep(&mut self) {
        let line = match self {
            Self::Cmucam2(camera) => {
                camera.sleep().await;
                Some(camera.line())
            }
            // It cannot sleep.
            Self::Pixy(camera) => camera.quiet_line(),
        };
        if let Some(line) = line {
            line.rest();
        }
    }

    async fn rest(&mut self) -> Infallible {
        match self {
            Self::Cmucam2(camera) => camera.rest().await,
            Self::Pixy(camera) => camera.rest().await,
        }
    }
}
