//! Cameras of the family: pictures, lenses and rates.

/// Model of a camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Model {
    /// Answers requests.
    #[default]
    Pixy2,
    /// The first Pixy (`CMUcam5`): streams blobs of the colours that it was taught.
    Pixy,
    /// An OpenMV Cam with its script `pixy_uart_emulation.py`: streams blobs.
    OpenMv,
    /// An OpenMV Cam with its script `apriltags_pixy_uart_emulation.py`: streams tags.
    OpenMvTags,
}

impl Model {
    /// Rate of all of them as they are shipped, bits per second.
    pub const BAUD: u32 = 19_200;

    /// Columns and rows of the picture in which it tells places.
    pub const fn size(self) -> [u16; 2] {
        match self {
            Self::Pixy2 => [316, 208],
            Self::Pixy => [320, 200],
            Self::OpenMv => [320, 240],
            Self::OpenMvTags => [160, 120],
        }
    }

    /// Field of view across of the lens with which it is sold, degrees.
    pub const fn field_of_view_deg(self) -> f32 {
        match self {
            Self::Pixy2 => 60.0,
            Self::Pixy => 75.0,
            Self::OpenMv | Self::OpenMvTags => 70.8,
        }
    }

    /// Pictures a second that are usual.
    pub const fn pictures_per_second(self) -> u8 {
        match self {
            Self::Pixy2 => 60,
            Self::Pixy => 50,
            Self::OpenMv => 30,
            Self::OpenMvTags => 15,
        }
    }

    /// Returns true if it tells blobs without being asked.
    pub const fn streams(self) -> bool {
        !matches!(self, Self::Pixy2)
    }

    /// Time in which a camera that streams tells something, microseconds.
    pub(crate) const fn tells_within_us(self) -> u32 {
        match self {
            Self::Pixy2 | Self::Pixy => 80_000,
            Self::OpenMv => 400_000,
            Self::OpenMvTags => 1_000_000,
        }
    }

    /// Returns true if a zero word for itself is a picture in which nothing is seen. The Pixy sends as many as it
    /// has time for.
    pub(crate) const fn zero_is_picture(self) -> bool {
        matches!(self, Self::OpenMv | Self::OpenMvTags)
    }
}
