//! Strength with which one radio hears another.

use super::Place;
use crate::random::{mix, normal};

/// Shadowing is cut off at so many standard deviations, so that range has an end.
const SHADOWING_CUT: f64 = 3.0;
/// The greatest power that a radio may send with, dBm (nRF52840).
const POWER_MAX: f64 = 8.0;
/// Margin below the weakest frame that is received within which a carrier still disturbs, dB.
const DISTURBANCE: f64 = 10.0;
/// In a disk: at its centre, and at its edge, dBm.
const DISK: [f64; 2] = [-40.0, -90.0];

/// A model of the links between nodes. All are reciprocal.
#[derive(Clone, Debug, PartialEq)]
pub enum Propagation {
    /// Every node within a distance is heard, less a share of the frames.
    UnitDisk {
        /// The distance, in the units of the places.
        range: f64,
        /// The share of frames lost on each link, 0 to 1.
        loss: f64,
    },
    /// Path loss with the logarithm of the distance, and shadowing.
    LogDistance(LogDistance),
}

/// Log-distance path loss with log-normal shadowing (Rappaport, Wireless Communications, 4.9):
/// `PL(d) = PL(1) + 10 n log10(d) + X`, with `X` fixed for each link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogDistance {
    /// Path loss at a distance of one unit, dB.
    pub loss_at_one: f64,
    /// `n`, 2 in free space.
    pub exponent: f64,
    /// Standard deviation of `X`, dB; cut off at three times that.
    pub shadowing: f64,
    /// The weakest frame that is received, dBm.
    pub sensitivity: f64,
    /// The weakest carrier that makes the channel busy, dBm: as weak as frames are received where radios sense
    /// carriers, as those of the boards do (IEEE 802.15.4, "CCA", mode 3); -75 dBm where they sense energy alone.
    pub clear_channel: f64,
    /// Margin by which a frame must be stronger than all others together to survive them, dB.
    pub capture: f64,
    /// The share of frames lost on each link besides, 0 to 1.
    pub loss: f64,
}

impl Default for LogDistance {
    /// Indoors at 2.4 GHz in metres: free space up to one metre, exponent 3, 4 dB of shadowing; the
    /// receiver of an nRF52840, which needs 3 dB (IEEE 802.15.4-2006, E.4.1.8, rounded up).
    fn default() -> Self {
        Self {
            loss_at_one: 40.2,
            exponent: 3.0,
            shadowing: 4.0,
            sensitivity: -95.0,
            clear_channel: -95.0,
            capture: 3.0,
            loss: 0.0,
        }
    }
}

/// Limits of a receiver for carriers, dBm.
#[derive(Clone, Copy, Debug)]
pub(super) struct Thresholds {
    pub(super) sensitivity: f32,
    pub(super) clear_channel: f32,
    /// Below this a carrier is not even a disturbance.
    pub(super) floor: f32,
    /// dB.
    pub(super) capture: Option<f32>,
}

/// A link as it is kept for its ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Link {
    pub(super) to: u32,
    /// Strength of a sender of 0 dBm as it is received.
    pub(super) gain: f32,
    pub(super) loss: f32,
}

impl Propagation {
    pub(super) fn thresholds(&self) -> Thresholds {
        match self {
            Self::UnitDisk { .. } => Thresholds {
                sensitivity: f32::NEG_INFINITY,
                clear_channel: f32::NEG_INFINITY,
                floor: f32::NEG_INFINITY,
                capture: None,
            },
            Self::LogDistance(model) => Thresholds {
                sensitivity: model.sensitivity as f32,
                clear_channel: model.clear_channel as f32,
                floor: (model.sensitivity - DISTURBANCE) as f32,
                capture: Some(model.capture as f32),
            },
        }
    }

    /// Strength at a receiver, dBm.
    pub(super) fn received(&self, link: Link, power: i8) -> f32 {
        match self {
            Self::LogDistance(_) => link.gain + f32::from(power).min(POWER_MAX as f32),
            Self::UnitDisk { .. } => link.gain,
        }
    }

    /// Distance beyond which no node hears anything.
    pub(super) fn reach(&self) -> f64 {
        match self {
            Self::UnitDisk { range, .. } => *range,
            Self::LogDistance(model) => {
                let floor = model.sensitivity - DISTURBANCE;
                let spread = SHADOWING_CUT * model.shadowing;
                let db = POWER_MAX - floor - model.loss_at_one + spread;
                libm::pow(10.0, db / (10.0 * model.exponent))
            }
        }
    }

    /// The link between two places, if there is any.
    pub(super) fn link(&self, seed: u64, a: (u32, Place), b: (u32, Place)) -> Option<Link> {
        let distance = libm::hypot(a.1[0] - b.1[0], a.1[1] - b.1[1]);
        let (gain, loss) = match self {
            Self::UnitDisk { range, loss } => {
                let [near, far] = DISK;
                let gain = near + (far - near) * distance / range;
                (distance <= *range).then_some((gain, *loss))
            }
            Self::LogDistance(model) => {
                let ends = [a.0.min(b.0), a.0.max(b.0)].map(u64::from);
                let shadow = normal(mix(seed ^ ends[0] << 32 ^ ends[1]))
                    .clamp(-SHADOWING_CUT, SHADOWING_CUT);
                let far = 10.0 * model.exponent * libm::log10(distance.max(1e-3));
                let gain = shadow * model.shadowing - model.loss_at_one - far;
                let floor = model.sensitivity - DISTURBANCE;
                (gain + POWER_MAX >= floor).then_some((gain, model.loss))
            }
        }?;
        Some(Link {
            to: b.0,
            gain: gain as f32,
            loss: loss as f32,
        })
    }
}
