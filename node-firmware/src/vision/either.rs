//! The camera that a node is configured to have.

use cmucam2_driver::Cmucam2;
use embedded_hal_async::delay::DelayNs;
use embedded_io_async::{Read, Write};
use pixy2_driver::Pixy2;

use super::{
    Blob, BlobCamera, CameraKind, Cmucam2BlobCamera, LearntColour, Pixy2BlobCamera, Subject,
    VisionError,
};
use crate::config::CameraConfig;

/// A CMUcam2 or a Pixy2 on a UART.
#[derive(Debug)]
pub enum EitherCamera<U, D> {
    /// [`CameraKind::Cmucam2`]
    Cmucam2(Cmucam2BlobCamera<U, D>),
    /// [`CameraKind::Pixy2`]
    Pixy2(Pixy2BlobCamera<U, D>),
}

impl<U, D> EitherCamera<U, D> {
    /// The one that is configured. Nothing is sent before the first call.
    pub fn new(config: &CameraConfig, uart: U, delay: D) -> Self {
        match config.kind {
            CameraKind::Cmucam2 => {
                let camera = Cmucam2::new(uart, delay);
                Self::Cmucam2(Cmucam2BlobCamera::new(camera, config.cmucam2()))
            }
            CameraKind::Pixy2 => {
                let camera = Pixy2::new(uart, delay);
                Self::Pixy2(Pixy2BlobCamera::new(camera, config.lens.columns))
            }
        }
    }
}

impl<U: Read + Write, D: DelayNs> BlobCamera for EitherCamera<U, D> {
    async fn start_up(&mut self) -> Result<(), VisionError> {
        match self {
            Self::Cmucam2(camera) => camera.start_up().await,
            Self::Pixy2(camera) => camera.start_up().await,
        }
    }

    async fn learn_colour(&mut self) -> Result<LearntColour, VisionError> {
        match self {
            Self::Cmucam2(camera) => camera.learn_colour().await,
            Self::Pixy2(camera) => camera.learn_colour().await,
        }
    }

    async fn learn_background(&mut self) -> Result<(), VisionError> {
        match self {
            Self::Cmucam2(camera) => camera.learn_background().await,
            Self::Pixy2(camera) => camera.learn_background().await,
        }
    }

    async fn begin(&mut self, subject: Subject) -> Result<(), VisionError> {
        match self {
            Self::Cmucam2(camera) => camera.begin(subject).await,
            Self::Pixy2(camera) => camera.begin(subject).await,
        }
    }

    async fn next(&mut self) -> Result<Option<Blob>, VisionError> {
        match self {
            Self::Cmucam2(camera) => camera.next().await,
            Self::Pixy2(camera) => camera.next().await,
        }
    }

    async fn end(&mut self) -> Result<(), VisionError> {
        match self {
            Self::Cmucam2(camera) => camera.end().await,
            Self::Pixy2(camera) => camera.end().await,
        }
    }
}
