//! The two image sensors and their frames.

/// The image sensor on the camera board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensor {
    /// Camera type 0: 88 x 143, or 176 x 255 in high resolution.
    Ov6620,
    /// Camera type 1: 160 x 239.
    Ov7620,
}

/// Columns and rows of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Columns, 1 to 176.
    pub width: u8,
    /// Rows, 1 to 255.
    pub height: u8,
}

impl Size {
    pub(super) const fn new(width: u8, height: u8) -> Self {
        Self { width, height }
    }

    /// The frame of a sensor. Only the OV6620 has a high resolution.
    pub const fn of(sensor: Sensor, high_resolution: bool) -> Self {
        match (sensor, high_resolution) {
            (Sensor::Ov6620, false) => Self::new(88, 143),
            (Sensor::Ov6620, true) => Self::new(176, 255),
            (Sensor::Ov7620, _) => Self::new(160, 239),
        }
    }
}
