//! The reference solve on the first reference camera (thesis 2.6.1).

use calib_core::{
    Pose, Refusal, angle,
    dead_reckoning::Place,
    reference::{self, Known, Settings, Solution, Stop},
};
use nalgebra::{Matrix2, Matrix3, Point2, RealField, Rotation2, Vector2};

use crate::{
    arithmetic::{root, sort},
    config::CameraConfig,
    memory::ReferenceStop,
    message::{Address, Located, PoseParts, References, Seen, StopNumber, triangle},
};

/// Stops a reference camera keeps while the target's place is not known. Full, the oldest goes.
pub const REFERENCE_STOPS: usize = 12;

/// Headings that are not known to this, radians, are no answer yet.
const HEADING_LIMIT: f32 = 0.1;

/// What is known of the frame of the site before the reference solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ReferenceFrame {
    /// Where the first reference camera is.
    first: [f32; 2],
    /// The direction of the second from there, radians.
    direction: f32,
    /// How far it is, if that is known.
    baseline: Option<f32>,
    /// Direction of the step sensor's x axis against the baseline, if known.
    sensor_heading: Option<f32>,
}

impl ReferenceFrame {
    pub(super) fn new(references: &References, config: &CameraConfig) -> Self {
        let sensor_heading = config.frame_heading_deg.map(f32::to_radians);
        match references.positions {
            Some([first, second]) => {
                let between = Point2::from(second) - Point2::from(first);
                Self {
                    first,
                    direction: RealField::atan2(between.y, between.x),
                    baseline: Some(root(between.norm_squared())),
                    sensor_heading,
                }
            }
            None => Self {
                first: [0.0; 2],
                direction: 0.0,
                baseline: config.baseline,
                sensor_heading,
            },
        }
    }
}

/// Stops that both references saw, or one of them so far.
#[derive(Clone, Debug)]
pub(super) struct ReferenceStops {
    stops: heapless::Vec<ReferenceStop, REFERENCE_STOPS>,
}

/// Why there is no answer yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NotYet {
    /// Fewer stops than wanted were seen by both.
    Waiting,
    /// They give no answer.
    Refused(Refusal),
}

/// Both poses and the place of the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Answer {
    pub(super) poses: [PoseParts; 2],
    pub(super) target: Address,
    pub(super) located: Located,
    pub(super) stops: usize,
    pub(super) chi_squared: f32,
}

impl ReferenceStops {
    pub(super) const fn new() -> Self {
        Self {
            stops: heapless::Vec::new(),
        }
    }

    pub(super) fn clear(&mut self) {
        self.stops.clear();
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &ReferenceStop> {
        self.stops.iter()
    }

    pub(super) fn restore(&mut self, index: usize, stop: ReferenceStop) {
        if let Some(kept) = self.stops.get_mut(index) {
            *kept = stop;
        } else {
            let _ = self.stops.push(stop);
        }
    }

    /// What is known of a stop, to be completed, and its index.
    fn entry(&mut self, target: Address, stop: StopNumber) -> Option<(usize, &mut ReferenceStop)> {
        let known = |kept: &ReferenceStop| kept.target == target && kept.stop == stop;
        let index = match self.stops.iter().position(known) {
            Some(index) => index,
            None => {
                let new = ReferenceStop {
                    target,
                    stop,
                    place: None,
                    own: None,
                    other: None,
                };
                if self.stops.is_full() {
                    let age = |kept: &ReferenceStop| stop.wrapping_sub(kept.stop);
                    let oldest = self.stops.iter().enumerate().max_by_key(|(_, s)| age(s));
                    let index = oldest.map(|(index, _)| index)?;
                    *self.stops.get_mut(index)? = new;
                    index
                } else {
                    let _ = self.stops.push(new);
                    self.stops.len() - 1
                }
            }
        };
        Some((index, self.stops.get_mut(index)?))
    }

    /// This camera saw the target there. Tells the index of what changed.
    pub(super) fn own(
        &mut self,
        target: Address,
        stop: StopNumber,
        place: Place<f32>,
        seen: Seen,
    ) -> Option<usize> {
        let (index, kept) = self.entry(target, stop)?;
        kept.place = Some(place);
        kept.own = Some(seen);
        Some(index)
    }

    /// The other reference camera saw it.
    pub(super) fn other(&mut self, target: Address, stop: StopNumber, seen: Seen) -> Option<usize> {
        let (index, kept) = self.entry(target, stop)?;
        kept.other = Some(seen);
        Some(index)
    }

    /// The walk of which both saw most stops: there may be several targets. Its target, its last
    /// stop, and the stops as the solve takes them.
    // Not inlined: the solve needs the stack.
    #[inline(never)]
    fn walk(
        &self,
        wanted: usize,
    ) -> Result<
        (
            Address,
            StopNumber,
            heapless::Vec<Stop<f32>, REFERENCE_STOPS>,
        ),
        NotYet,
    > {
        let complete = |kept: &ReferenceStop| {
            let place = kept.place?;
            let walk = (kept.target, place.parts().fix);
            Some((walk, kept.stop, place, [kept.own?, kept.other?]))
        };
        let of_walk = |walk: (Address, u32)| {
            let all = self.stops.iter().filter_map(complete);
            all.filter(move |(of, ..)| *of == walk)
        };
        let walks = self.stops.iter().filter_map(complete);
        let longest = walks.max_by_key(|(walk, ..)| of_walk(*walk).count());
        let (walk, any, ..) = longest.ok_or(NotYet::Waiting)?;
        let mut seen: heapless::Vec<(StopNumber, Place<f32>, [Seen; 2]), REFERENCE_STOPS> =
            heapless::Vec::new();
        for (_, stop, place, rays) in of_walk(walk) {
            // As many as there are stops.
            let _ = seen.push((stop, place, rays));
        }
        if seen.len() < wanted.min(REFERENCE_STOPS) {
            return Err(NotYet::Waiting);
        }
        // Their numbers may have begun again from zero.
        let order = |stop: StopNumber| stop.wrapping_sub(any).cast_signed();
        sort(&mut seen, |(a, ..), (b, ..)| order(*a) < order(*b));
        let last = seen.last().map_or(any, |(stop, ..)| *stop);

        // The solve adds the covariances of displacements up. What comes of standing beside the
        // place does not grow, so each one is what the way from the first stop has more.
        let (first_stop, first, _) = seen.first().ok_or(NotYet::Waiting)?;
        let mut before = (first.position(), Matrix2::zeros());
        let mut stops = heapless::Vec::new();
        for (stop, place, seen) in &seen {
            let from_first = if stop == first_stop {
                Matrix2::zeros()
            } else {
                let common = place.covariance_with(first);
                place.covariance() + first.covariance() - common - common.transpose()
            };
            let (from, covariance) =
                core::mem::replace(&mut before, (place.position(), from_first));
            let _ = stops.push(Stop {
                rays: seen.map(|seen| seen.ray()),
                bearing_sigmas: seen.map(|seen| seen.sigma),
                displacement: place.position() - from,
                displacement_covariance: from_first - covariance,
            });
        }
        Ok((walk.0, last, stops))
    }

    /// The answer of the walk of which both saw most stops.
    // Not inlined, for the sake of the stack.
    #[inline(never)]
    pub(super) fn solve(&self, frame: &ReferenceFrame, wanted: usize) -> Result<Answer, NotYet> {
        let (target, last, stops) = self.walk(wanted)?;
        let known = Known {
            baseline: frame.baseline,
            frame_heading: frame.sensor_heading,
        };
        let outcome =
            reference::solve(&stops, &known, &Settings::default()).map_err(NotYet::Refused)?;
        let best = outcome.best;
        let sure = best.heading_sigmas().iter().all(|&s| s < HEADING_LIMIT);
        if outcome.alternative.is_some() || !sure {
            return Err(NotYet::Refused(Refusal::Undetermined));
        }
        let (position, covariance) = best
            .places(&stops)
            .last()
            .ok_or(NotYet::Refused(Refusal::TooFew))?;
        let turn = Rotation2::new(frame.direction);
        let origin = Point2::from(frame.first);
        let position = origin + turn * position.coords;
        let covariance = turn * covariance * turn.transpose();
        let poses = poses(&best, frame);
        // What nobody would accept is not told.
        let located = Located {
            stop: last,
            position: position.coords.into(),
            covariance: triangle(&covariance),
            frame_heading: angle::wrap_signed(frame.direction + best.frame_heading),
            frame_heading_sigma: best.frame_heading_sigma(),
        };
        let is_sound = poses.iter().all(PoseParts::is_usable)
            && located.is_usable()
            && best.chi_squared.is_finite();
        if !is_sound {
            return Err(NotYet::Refused(Refusal::Undetermined));
        }
        Ok(Answer {
            poses,
            target,
            located,
            stops: stops.len(),
            chi_squared: best.chi_squared,
        })
    }
}

/// Both poses in the frame of the site. The first camera is its origin, so only its heading errs;
/// the second is on the baseline, the length of which errs if it was not known.
fn poses(solution: &Solution<f32>, frame: &ReferenceFrame) -> [PoseParts; 2] {
    let along = Rotation2::new(frame.direction) * Vector2::x();
    let origin = Point2::from(frame.first);
    let c = &solution.covariance;
    let first = Matrix3::from_diagonal(&[0.0, 0.0, c.m11].into());
    let mut second = Matrix3::zeros();
    let place: Matrix2<f32> = along * along.transpose() * c.m66;
    second.fixed_view_mut::<2, 2>(0, 0).copy_from(&place);
    second
        .fixed_view_mut::<2, 1>(0, 2)
        .copy_from(&(along * c.m26));
    second
        .fixed_view_mut::<1, 2>(2, 0)
        .copy_from(&(along * c.m26).transpose());
    second.m33 = c.m22;
    let pose = |position, heading: f32, covariance| {
        PoseParts::from(Pose {
            position,
            heading: angle::wrap_positive(frame.direction + heading),
            covariance,
        })
    };
    [
        pose(origin, solution.headings[0], first),
        pose(
            origin + along * solution.baseline,
            solution.headings[1],
            second,
        ),
    ]
}
