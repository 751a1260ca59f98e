//! When a blob stands still, and where.

use std::{collections::VecDeque, fmt};

use cmucam2_driver::packet::Tracking;

use super::View;

/// Packets that may be without a usable blob: one in this many.
const UNUSABLE: usize = 10;

/// How far the columns of most packets may be apart.
const SPREAD: u8 = 2;

/// Variance of rounding to whole columns.
const ROUNDING: f64 = 1.0 / 12.0;

/// Waits until a blob is steady, then tells its column.
#[derive(Clone, Debug)]
pub struct Steadiness {
    view: View,
    packets: usize,
    window: VecDeque<Tracking>,
}

/// A blob that stood still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Median of its columns, counted from 0.
    pub column: f64,
    /// Standard deviation of `column`.
    pub column_sigma: f64,
    /// Packets with it.
    pub packets: usize,
    /// The median packet's pixels, see [`Tracking::pixels`].
    pub pixels: u8,
    /// The median packet's confidence, see [`Tracking::confidence`].
    pub confidence: u8,
}

/// Why there is no sighting yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unsteady {
    /// Not enough packets came.
    #[error("too few packets came")]
    Few,
    /// Nothing was tracked.
    #[error(
        "nothing is tracked: is the object in view and lit as when its colour was learnt? \
         ({lost} of {packets} packets were empty)"
    )]
    Lost {
        /// Empty packets.
        lost: usize,
        /// Of so many.
        packets: usize,
    },
    /// The blob reaches the left or right border.
    #[error(
        "the object is cut off by the left or right border, so its middle is not to be seen: move \
         it or the camera, or take a smaller object"
    )]
    Clipped,
    /// The columns are too far apart.
    #[error("the object moves: its middle goes from column {from} to {to}")]
    Moving {
        /// Smallest of most columns, counted from 0.
        from: i16,
        /// Greatest of most columns.
        to: i16,
    },
}

impl Steadiness {
    /// Of a blob in so many packets in a row, at least 2.
    pub fn new(packets: usize, view: View) -> Self {
        let packets = packets.max(2);
        Self {
            view,
            packets,
            window: VecDeque::with_capacity(packets),
        }
    }

    /// Takes a packet, and judges the last ones.
    ///
    /// # Errors
    /// Why the blob is not steady yet.
    pub fn push(&mut self, tracking: Tracking) -> Result<Sighting, Unsteady> {
        if self.window.len() >= self.packets {
            self.window.pop_front();
        }
        self.window.push_back(tracking);
        self.judge()
    }

    fn judge(&self) -> Result<Sighting, Unsteady> {
        let packets = self.window.len();
        if packets < self.packets {
            return Err(Unsteady::Few);
        }
        let allowed = packets / UNUSABLE;
        let seen: Vec<&Tracking> = self.window.iter().filter(|t| !t.is_lost()).collect();
        let lost = packets - seen.len();
        if lost > allowed {
            return Err(Unsteady::Lost { lost, packets });
        }
        let whole: Vec<&Tracking> = seen
            .into_iter()
            .filter(|t| !self.view.is_clipped(t))
            .collect();
        if packets - lost - whole.len() > allowed {
            return Err(Unsteady::Clipped);
        }
        let columns: Vec<u8> = whole.iter().filter_map(|t| Some(t.centroid()?.0)).collect();
        self.moving(&columns)?;
        let sorted = |of: &dyn Fn(&Tracking) -> Option<u8>| {
            let mut values: Vec<u8> = whole.iter().filter_map(|t| of(t)).collect();
            values.sort_unstable();
            values
        };
        let in_packets = median(&sorted(&|t| Some(t.centroid()?.0)));
        Ok(Sighting {
            column: in_packets - f64::from(-self.view.from_0(0)),
            column_sigma: median_sigma(&columns),
            packets: columns.len(),
            pixels: median(&sorted(&Tracking::pixels)) as u8,
            confidence: median(&sorted(&Tracking::confidence)) as u8,
        })
    }

    /// Whether most columns are far apart, or the later ones are elsewhere than the earlier ones.
    fn moving(&self, columns: &[u8]) -> Result<(), Unsteady> {
        let range = |columns: &[u8], cut: usize| {
            let mut sorted = columns.to_vec();
            sorted.sort_unstable();
            let most = sorted.get(cut..sorted.len().saturating_sub(cut))?;
            Some((*most.first()?, *most.last()?))
        };
        let Some((from, to)) = range(columns, columns.len() / UNUSABLE) else {
            return Err(Unsteady::Few);
        };
        let (earlier, later) = columns.split_at(columns.len() / 2);
        let drift = match (
            range(earlier, earlier.len() / 2),
            range(later, later.len() / 2),
        ) {
            (Some((a, _)), Some((b, _))) => a.abs_diff(b),
            _ => 0,
        };
        if to - from > SPREAD || drift >= SPREAD {
            return Err(Unsteady::Moving {
                from: self.view.from_0(from),
                to: self.view.from_0(to),
            });
        }
        Ok(())
    }
}

/// The middle of sorted values, or of the two in the middle.
fn median(sorted: &[u8]) -> f64 {
    let at = |place: usize| sorted.get(place).copied().map_or(0.0, f64::from);
    let half = sorted.len() / 2;
    if sorted.len().is_multiple_of(2) {
        (at(half.saturating_sub(1)) + at(half)) / 2.0
    } else {
        at(half)
    }
}

/// Standard deviation of the median of columns: that of rounding, which a blob that stands still
/// does not average out, and that of the median of noise, `sqrt(pi / 2n)` times the noise's.
fn median_sigma(columns: &[u8]) -> f64 {
    let count = columns.len().max(1) as f64;
    let values = || columns.iter().copied().map(f64::from);
    let mean = values().sum::<f64>() / count;
    let variance =
        values().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    (ROUNDING + std::f64::consts::FRAC_PI_2 * variance / count).sqrt()
}

impl fmt::Display for Sighting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "column {} +/- {:.2} ({} packets, pixels {}, confidence {})",
            self.column, self.column_sigma, self.packets, self.pixels, self.confidence
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view() -> View {
        View::new(88, 1, None)
    }

    fn at(column: u8) -> Tracking {
        Tracking::new([column, 70, column - 4, 60, column + 4, 80, 20, 201])
    }

    fn last(columns: impl IntoIterator<Item = Tracking>) -> Result<Sighting, Unsteady> {
        let mut steadiness = Steadiness::new(10, view());
        let mut judged = Err(Unsteady::Few);
        for tracking in columns {
            judged = steadiness.push(tracking);
        }
        judged
    }

    #[test]
    fn a_blob_that_stands_still_is_known_to_its_rounding() {
        let sighting = last([at(44); 10]).unwrap();
        assert_eq!(sighting.column, 43.0);
        assert!((sighting.column_sigma - 12_f64.sqrt().recip()).abs() < 1e-12);
        assert_eq!((sighting.packets, sighting.pixels), (10, 20));
        assert_eq!(last([at(44); 9]), Err(Unsteady::Few));
    }

    /// Five of 44 and five of 45: the median between them, the variance 10/36.
    #[test]
    fn noise_widens_the_sigma() {
        let sighting = last([44, 45, 44, 45, 44, 45, 44, 45, 44, 45].map(at)).unwrap();
        assert_eq!(sighting.column, 43.5);
        let expected = (1.0 / 12.0 + std::f64::consts::PI / 2.0 / 36.0).sqrt();
        assert!((sighting.column_sigma - expected).abs() < 1e-12);
    }

    #[test]
    fn one_wrong_packet_of_ten_does_no_harm() {
        let one = |wrong| {
            let mut packets = [at(44); 10];
            packets[3] = wrong;
            last(packets)
        };
        assert_eq!(one(at(80)).unwrap().column, 43.0);
        assert_eq!(one(Tracking::LOST).unwrap().packets, 9);
        let cut = Tracking::new([44, 70, 1, 60, 48, 80, 20, 201]);
        assert_eq!(one(cut).unwrap().packets, 9);
    }

    #[test]
    fn what_is_lost_cut_off_or_moving_is_refused() {
        let mut packets = [at(44); 10];
        packets[3] = Tracking::LOST;
        packets[7] = Tracking::LOST;
        assert_eq!(
            last(packets),
            Err(Unsteady::Lost {
                lost: 2,
                packets: 10
            })
        );
        for (x1, x2) in [(1, 9), (80, 88), (81, 87)] {
            let cut = Tracking::new([x1 + 4, 70, x1, 60, x2, 80, 20, 201]);
            assert_eq!(last([cut; 10]), Err(Unsteady::Clipped));
        }
        let slowly = last((0..10).map(|step| at(44 + step / 5 * 2)));
        assert_eq!(slowly, Err(Unsteady::Moving { from: 43, to: 45 }));
        assert!(matches!(
            last((0..10).map(|step| at(30 + step))),
            Err(Unsteady::Moving { .. })
        ));
    }

    #[test]
    fn the_last_packets_count() {
        let moved_in = (20..40).map(at).chain([at(40); 10]);
        assert_eq!(last(moved_in).unwrap().column, 39.0);
    }
}
