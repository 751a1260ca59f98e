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
    /// The frame of a sensor. Only the OV6620 has a high resolution.
    pub const fn of(sensor: Sensor, high_resolution: bool) -> Self {
        let (width, height) = match (sensor, high_resolution) {
            (Sensor::Ov6620, false) => (88, 143),
            (Sensor::Ov6620, true) => (176, 255),
            (Sensor::Ov7620, _) => (160, 239),
        };
        Self { width, height }
    }
}
