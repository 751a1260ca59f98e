//! The reference solve on the first reference camera (thesis 2.6.1).

use calib_core::{
    Pose, Ray, Refusal, angle,
    dead_reckoning::Place,
    fit::Fit,
    level::{self, Mounting, Row, Tolerance},
    reference::{self, Known, ReferenceOutcome, ReferenceSettings, ReferenceSolution, Stop},
};
use nalgebra::{Matrix2, Point2, RealField};

use super::kept::{Kept, OfStop};
use crate::{
    arithmetic::{root, sort},
    config::CameraConfig,
    facts::ReferenceStop,
    limits::REFERENCE_STOPS,
    message::{
        MemberAddress, Mount, PoseParts, References, Seen, StopNumber, TargetLocation, triangle,
    },
};

/// Greatest distance in numbers of a stop that is told late. Numbers farther back are those of a target that began
/// anew.
const LATE: StopNumber = 64;

/// Typical bearing of a target aside of the axis, radians. An error of the focal length turns a camera by its share of
/// this.
const ASIDE: f32 = 0.3;

/// Largest sigma of the headings of an answer, radians.
const HEADING_LIMIT: f32 = 0.1;

/// Stops that leave a degree of freedom, whatever is known.
const ENOUGH: usize = 4;

/// Stops that give an answer even if they contradict each other.
const LAST_RESORT: usize = 10;

/// Known parts of the frame of the site before the reference solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ReferenceFrame {
    /// Position of the first reference camera.
    first: [f32; 2],
    /// Direction of the second one from there, radians.
    direction: f32,
    /// Distance of the second one, if known.
    baseline: Option<f32>,
    /// Direction of the step sensor's x axis against the baseline, if known.
    sensor_heading: Option<f32>,
    /// Standard deviation of the pitch and roll of level cameras, radians.
    tilt: f32,
    /// Variance of a heading because of errors of the lens, square radians.
    by_lens: f32,
}

impl ReferenceFrame {
    pub(super) fn new(references: &References, config: &CameraConfig) -> Self {
        let sensor_heading = config.frame_heading_deg.map(f32::to_radians);
        let tilt = config.lens_sigma.tilt_deg.to_radians();
        let [focal, principal] = config.lens_sigma.of_tangent();
        let turn = focal * ASIDE;
        let by_lens = principal * principal + turn * turn;
        match references.positions {
            Some([first, second]) => {
                let between = Point2::from(second) - Point2::from(first);
                Self {
                    first,
                    direction: RealField::atan2(between.y, between.x),
                    baseline: Some(root(between.norm_squared())),
                    sensor_heading,
                    tilt,
                    by_lens,
                }
            }
            None => Self {
                first: [0.0; 2],
                direction: 0.0,
                baseline: config.baseline,
                sensor_heading,
                tilt,
                by_lens,
            },
        }
    }
}

impl ReferenceFrame {
    /// Stops that leave a degree of freedom: two equations each, and 4 to 6 unknowns.
    fn fewest_to_check(&self) -> usize {
        match (self.baseline, self.sensor_heading) {
            (None, None) => ENOUGH,
            _ => 3,
        }
    }
}

/// Stops that both references saw, or only one so far.
#[derive(Clone, Debug)]
pub(super) struct ReferenceStops {
    stops: Kept<ReferenceStop, REFERENCE_STOPS>,
    /// Pitch and roll of both, by which what they see is turned upright.
    mountings: [Mounting<f32>; 2],
}

/// Mountings as planned.
const LEVEL: [Mounting<f32>; 2] = [Mounting {
    pitch: 0.0,
    roll: 0.0,
}; 2];

/// Reasons why there is no answer although the stops have a solution.
const DECIDED: [NotYet; 2] = [
    NotYet::Refused(Refusal::Inconsistent),
    NotYet::Refused(Refusal::Undetermined),
];

/// Input of the solve: stops, and what both saw there.
#[derive(Default)]
struct WalkOfBoth {
    stops: heapless::Vec<Stop<f32>, REFERENCE_STOPS>,
    seen: heapless::Vec<[Seen; 2], REFERENCE_STOPS>,
    /// Standing sigma of the target.
    standing: f32,
}

impl OfStop for ReferenceStop {
    fn key(&self) -> (MemberAddress, StopNumber) {
        (self.target, self.stop)
    }
}

/// Reason why there is no answer yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NotYet {
    /// Both saw too few stops.
    Waiting,
    /// The stops give no answer.
    Refused(Refusal),
}

/// Stops of a walk that an attempt uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Attempt {
    /// All stops.
    All,
    /// The last ones, if these are not all.
    Last(usize),
    /// All, although they contradict each other, if there are [`LAST_RESORT`] or more.
    LastResort,
}

/// Both poses and the place of the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Answer {
    pub(super) poses: [PoseParts; 2],
    pub(super) mounts: [Option<Mount>; 2],
    pub(super) target: MemberAddress,
    pub(super) located: TargetLocation,
    pub(super) stops: usize,
    pub(super) fit: Fit<f32>,
}

impl ReferenceStops {
    pub(super) const fn new() -> Self {
        Self {
            stops: Kept::new(),
            mountings: LEVEL,
        }
    }

    pub(super) fn clear(&mut self) {
        self.stops.clear();
    }

    /// Number of stops that are kept.
    pub(super) fn len(&self) -> usize {
        self.stops.len()
    }

    /// Forgets the sightings of the other reference, since it is another camera now. Returns the number of entries that
    /// may have moved up.
    pub(super) fn forget_other(&mut self) -> usize {
        if self.stops.iter().all(|kept| kept.other.is_none()) {
            return 0;
        }
        let before = self.stops.len();
        self.stops.retain(|kept| kept.own.is_some());
        for kept in self.stops.iter_mut() {
            kept.other = None;
        }
        before
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &ReferenceStop> {
        self.stops.iter()
    }

    /// Takes a stop of a former run, and returns its index.
    pub(super) fn restore(&mut self, stop: ReferenceStop) -> Option<usize> {
        let (index, kept) = self.entry(stop.target, stop.stop)?;
        *kept = stop;
        self.stops.find_first();
        Some(index)
    }

    /// Returns the entry of a stop, new if it is not known, and its index. A full list drops stops that are told late.
    fn entry(
        &mut self,
        target: MemberAddress,
        stop: StopNumber,
    ) -> Option<(usize, &mut ReferenceStop)> {
        let index = match self.stops.find((target, stop)) {
            Some(index) => index,
            None if self.stops.is_full() && self.is_late(target, stop) => return None,
            None => self.stops.add(ReferenceStop {
                target,
                stop,
                place: None,
                own: None,
                other: None,
            })?,
        };
        Some((index, self.stops.get_mut(index)?))
    }

    /// Returns true if all kept stops of its target are later.
    fn is_late(&self, target: MemberAddress, stop: StopNumber) -> bool {
        let of_target = self.stops.iter().filter(|kept| kept.target == target);
        let mut ahead = of_target
            .map(|kept| kept.stop.wrapping_sub(stop))
            .peekable();
        ahead.peek().is_some() && ahead.all(|ahead| ahead <= LATE)
    }

    /// Adds a sighting of this camera. Returns the index of the entry.
    pub(super) fn own(
        &mut self,
        target: MemberAddress,
        stop: StopNumber,
        place: Place<f32>,
        seen: Seen,
    ) -> Option<usize> {
        let (index, kept) = self.entry(target, stop)?;
        kept.place = Some(place);
        kept.own = Some(seen);
        Some(index)
    }

    /// Adds a sighting of the other reference.
    pub(super) fn other(
        &mut self,
        target: MemberAddress,
        stop: StopNumber,
        seen: Seen,
    ) -> Option<usize> {
        let (index, kept) = self.entry(target, stop)?;
        kept.other = Some(seen);
        Some(index)
    }

    /// Finds the walk of which both saw most stops, since there may be several targets. Returns its target and its last
    /// stop, and fills `of_both` with the stops that the attempt uses.
    // for less stack
    #[inline(never)]
    fn walk(
        &self,
        wanted: usize,
        attempt: Attempt,
        of_both: &mut WalkOfBoth,
    ) -> Result<(MemberAddress, StopNumber), NotYet> {
        let complete = |kept: &ReferenceStop| {
            let place = kept.place?;
            let walk = (kept.target, place.parts().fix);
            Some((walk, kept.stop, place, [kept.own?, kept.other?]))
        };
        let of_walk = |walk: (MemberAddress, u32)| {
            let all = self.stops.iter().filter_map(complete);
            all.filter(move |(of, ..)| *of == walk)
        };
        let walks = self.stops.iter().filter_map(complete);
        let longest = walks.max_by_key(|(walk, ..)| of_walk(*walk).count());
        let (walk, any, ..) = longest.ok_or(NotYet::Waiting)?;
        let mut seen: heapless::Vec<(StopNumber, Place<f32>, [Seen; 2]), REFERENCE_STOPS> =
            heapless::Vec::new();
        for (_, stop, place, rays) in of_walk(walk) {
            let has_room = seen.push((stop, place, rays)).is_ok();
            debug_assert!(has_room, "as many as there are stops");
        }
        // If one camera alone saw the other stops, a full list has room for no more.
        let wanted = if self.stops.is_full() {
            wanted.min(ENOUGH)
        } else {
            wanted
        };
        if seen.len() < wanted {
            return Err(NotYet::Waiting);
        }
        let most = match attempt {
            Attempt::All => seen.len(),
            Attempt::Last(most) if most < seen.len() => most,
            Attempt::LastResort if seen.len() >= LAST_RESORT => seen.len(),
            // The same stop again, or one that comes too early.
            _ => return Err(NotYet::Refused(Refusal::Inconsistent)),
        };
        // Their numbers may have begun again from zero.
        let order = |stop: StopNumber| stop.wrapping_sub(any).cast_signed();
        sort(&mut seen, |(a, ..), (b, ..)| order(*a) < order(*b));
        let last = seen.last().map_or(any, |(stop, ..)| *stop);
        let seen = seen.get(seen.len().saturating_sub(most)..);
        debug_assert!(seen.is_some(), "it begins within the list");
        let seen = seen.unwrap_or_default();

        // The solve adds the covariances of displacements up. The part that comes from standing beside the
        // place does not grow, so each one is the excess over the way from the first stop.
        let (first_stop, first, _) = seen.first().ok_or(NotYet::Waiting)?;
        let mut before = (first.position(), Matrix2::zeros());
        for (stop, place, seen) in seen {
            let from_first = if stop == first_stop {
                Matrix2::zeros()
            } else {
                let common = place.covariance_with(first);
                place.covariance() + first.covariance() - common - common.transpose()
            };
            let (from, covariance) =
                core::mem::replace(&mut before, (place.position(), from_first));
            let [first, second] = *seen;
            let [one, other] = self.mountings;
            let has_seen = of_both.seen.push(*seen).is_ok();
            debug_assert!(has_seen, "as many as there are stops");
            of_both.standing = place.parts().standing_sigma;
            let has_room = of_both.stops.push(Stop {
                rays: [upright(&first, one), upright(&second, other)],
                bearing_sigmas: [
                    first.sigma * widened(&first, one),
                    second.sigma * widened(&second, other),
                ],
                displacement: place.position() - from,
                displacement_covariance: from_first - covariance,
            });
            debug_assert!(has_room.is_ok(), "as many as there are stops");
        }
        Ok((walk.0, last))
    }

    /// Answer of the walk of which both saw most stops.
    ///
    /// An answer that its own residuals [contradict](Fit::is_bad) is none: the target was
    /// carried on between two stops, or a camera saw something else at one. Then the last stops
    /// decide alone, now or when more have come: as many as are wanted, and as leave a degree of
    /// freedom, without which anything fits. Where all of [`LAST_RESORT`] stops or more and the last
    /// of them contradict each other, it is rather a lens or a sigma that is wrong, as it is at every
    /// stop: the answer is taken with sigmas as large as the residuals say.
    pub(super) fn solve(
        &mut self,
        frame: &ReferenceFrame,
        wanted: usize,
    ) -> Result<Answer, NotYet> {
        let mut why = NotYet::Waiting;
        for pitch in level::PITCHES {
            let pitch = pitch as f32;
            self.mountings = [Mounting { pitch, roll: 0.0 }; 2];
            match self.settled(frame, wanted) {
                Err(NotYet::Refused(refusal)) if why == NotYet::Waiting => {
                    why = NotYet::Refused(refusal);
                }
                Err(NotYet::Refused(_)) => {}
                over => return over,
            }
            if self.mountings == LEVEL && DECIDED.contains(&why) {
                // The rows agree with these mountings.
                break;
            }
        }
        self.mountings = LEVEL;
        if why != NotYet::Refused(Refusal::Inconsistent) {
            return Err(why);
        }
        let few = wanted.max(frame.fewest_to_check());
        for attempt in [Attempt::Last(few), Attempt::LastResort] {
            // The contradiction is reported to people.
            let attempted = self.attempt(frame, wanted, attempt);
            if let Ok(Attempted {
                answer: Ok(answer), ..
            }) = attempted
            {
                return Ok(answer);
            }
        }
        Err(why)
    }

    /// Answer of all stops, with the mountings that agree with the rows. The search begins at the present mountings.
    fn settled(&mut self, frame: &ReferenceFrame, wanted: usize) -> Result<Answer, NotYet> {
        let mut changes = [0.0; 2];
        for _ in 0..level::MOUNTING_ROUNDS {
            let Attempted { answer, better } = self.attempt(frame, wanted, Attempt::All)?;
            let Some(better) = better else {
                return answer;
            };
            for ((mounting, better), before) in
                { self.mountings.iter_mut().zip(better) }.zip(&mut changes)
            {
                let change = better.pitch - mounting.pitch;
                // A step back would overshoot, farther each time.
                *mounting = if change * *before < 0.0 {
                    mounting.towards(&better)
                } else {
                    better
                };
                *before = change;
            }
        }
        Err(NotYet::Refused(Refusal::DidNotConverge))
    }

    /// # Errors
    /// There are too few stops, or they have no solution.
    // for less stack
    #[inline(never)]
    fn attempt(
        &self,
        frame: &ReferenceFrame,
        wanted: usize,
        attempt: Attempt,
    ) -> Result<Attempted, NotYet> {
        let mut of_both = WalkOfBoth::default();
        let (target, last) = self.walk(wanted, attempt, &mut of_both)?;
        // By reference: large, and moved it would be on the stack twice.
        let mut solved = reference::solve(
            &of_both.stops,
            &frame.known(),
            &ReferenceSettings::default(),
        );
        let outcome = match &mut solved {
            Ok(outcome) => outcome,
            Err(why) => return Err(NotYet::Refused(*why)),
        };
        let hung = of_both.hung(&outcome.best, self.mountings, frame);
        let [first, second] = &hung;
        let is_better = first.is_better || second.is_better;
        let better = is_better.then_some([first.mounting, second.mounting]);
        let answer = decided(outcome, frame, attempt, &hung).and_then(|best| {
            let (poses, located) = in_frame_of_site(best, &of_both.stops, last, frame)?;
            Ok(Answer {
                poses,
                mounts: [first.mount, second.mount],
                target,
                located,
                stops: of_both.stops.len(),
                fit: best.fit(),
            })
        });
        Ok(Attempted { answer, better })
    }
}

/// Result of an attempt.
struct Attempted {
    answer: Result<Answer, NotYet>,
    /// Better mountings of both, if the rows tell any, even if the stops contradict the answer.
    better: Option<[Mounting<f32>; 2]>,
}

/// Mounting of a reference, by its rows.
#[derive(Clone, Copy, Default)]
struct Hung {
    /// Mounting of this attempt, which is told with the answer.
    mount: Option<Mount>,
    /// True if the rows contradict it.
    is_refused: bool,
    /// Mounting of the next attempt.
    mounting: Mounting<f32>,
    is_better: bool,
    /// Variance of its heading by its mounting.
    turned: f32,
    /// Variance by its mounting of its place along the baseline.
    shifted: f32,
}

/// Mounting of a reference by its rows, close to this one.
#[inline(never)] // once, for less flash
fn hung(
    (pose, rows): (&Pose<f32>, &[Row<f32>]),
    mounting: Mounting<f32>,
    tolerance: &Tolerance<f32>,
) -> Hung {
    let better = level::improved(pose, rows, mounting, tolerance);
    let mut hung = Hung {
        mounting: better.unwrap_or(mounting),
        is_better: better.is_some(),
        ..Hung::default()
    };
    if let Some(judged) = level::judge(pose, rows, mounting, tolerance) {
        hung.mount = Mount::of(mounting, judged.height);
        hung.is_refused = judged.is_refused();
        hung.turned = judged.widening.m33;
        hung.shifted = judged.widening.m11;
    }
    hung
}

impl WalkOfBoth {
    /// Mountings of both by their rows, close to these.
    // for less stack
    #[inline(never)]
    fn hung(
        &self,
        best: &ReferenceSolution<f32>,
        mountings: [Mounting<f32>; 2],
        frame: &ReferenceFrame,
    ) -> [Hung; 2] {
        let tolerance = Tolerance {
            tilt: frame.tilt,
            bob: self.standing,
        };
        let [one, other] = &best.poses(Point2::origin(), 0.0);
        let [of_one, of_other] = &self.rows(best);
        let [first, second] = mountings;
        [
            hung((one, of_one), first, &tolerance),
            hung((other, of_other), second, &tolerance),
        ]
    }

    /// The rows of both cameras, in the frame between them.
    fn rows(&self, best: &ReferenceSolution<f32>) -> [heapless::Vec<Row<f32>, REFERENCE_STOPS>; 2] {
        let mut all = [heapless::Vec::new(), heapless::Vec::new()];
        for ((target, covariance), seen) in best.places(&self.stops).zip(&self.seen) {
            for (rows, seen) in all.iter_mut().zip(seen) {
                if let Some(elevation) = seen.elevation.radians() {
                    let has_room = rows.push(Row {
                        target,
                        target_variance: covariance.trace() * 0.5,
                        bearing: seen.bearing,
                        elevation,
                        sigma: seen.sigma,
                    });
                    debug_assert!(has_room.is_ok(), "as many as there are stops");
                }
            }
        }
        all
    }
}

impl ReferenceFrame {
    fn known(&self) -> Known<f32> {
        Known {
            baseline: self.baseline,
            frame_heading: self.sensor_heading,
        }
    }
}

/// Factor by which an upright direction errs more than the one that was seen: the row errs too.
fn widened(seen: &Seen, mounting: Mounting<f32>) -> f32 {
    let elevation = seen.elevation.radians().filter(|_| !mounting.is_level());
    let by_row = elevation.map_or(0.0, |elevation| {
        mounting.by_elevation(seen.bearing, elevation)
    });
    root(1.0 + by_row * by_row)
}

/// Direction in which a level camera would see what a camera of this mounting sees. Without a row it stays the same.
fn upright(seen: &Seen, mounting: Mounting<f32>) -> Ray<f32> {
    let Some(elevation) = seen.elevation.radians().filter(|_| !mounting.is_level()) else {
        return seen.ray();
    };
    let upright = mounting.seen(seen.bearing, elevation);
    Ray {
        forward: upright.ahead,
        left: upright.left,
    }
}

/// The single answer of these stops, with the uncertainty of the stops and of the mountings. In the last resort the
/// stops may contradict each other.
fn decided<'a>(
    outcome: &'a mut ReferenceOutcome<f32>,
    frame: &ReferenceFrame,
    attempt: Attempt,
    hung: &[Hung; 2],
) -> Result<&'a ReferenceSolution<f32>, NotYet> {
    let best = &mut outcome.best;
    let fit = best.fit();
    let [first, second] = hung;
    let is_refused = first.is_refused || second.is_refused;
    if is_refused || fit.is_bad() && attempt != Attempt::LastResort {
        return Err(NotYet::Refused(Refusal::Inconsistent));
    }
    best.covariance *= fit.inflation();
    let sure = best.heading_sigmas().iter().all(|&s| s < HEADING_LIMIT);
    if outcome.alternative.is_some() || !sure {
        return Err(NotYet::Refused(Refusal::Undetermined));
    }
    let c = &mut best.covariance;
    c.m11 += first.turned + frame.by_lens;
    c.m22 += second.turned + frame.by_lens;
    if c.m66 > 0.0 {
        c.m66 += second.shifted;
    }
    Ok(best)
}

/// Both poses, and the place of the target at the last stop.
// for less stack
#[inline(never)]
fn in_frame_of_site(
    best: &ReferenceSolution<f32>,
    stops: &[Stop<f32>],
    last: StopNumber,
    frame: &ReferenceFrame,
) -> Result<([PoseParts; 2], TargetLocation), NotYet> {
    let (position, covariance) = best
        .places(stops)
        .last()
        .ok_or(NotYet::Refused(Refusal::TooFew))?;
    let turn = angle::rotation(frame.direction);
    let origin = Point2::from(frame.first);
    let position = origin + turn * position.coords;
    let covariance = angle::turned(&covariance, &turn);
    let poses = best.poses(origin, frame.direction).map(PoseParts::from);
    let located = TargetLocation {
        stop: last,
        position: position.coords.into(),
        covariance: triangle(&covariance),
        frame_heading: angle::wrap_signed(frame.direction + best.frame_heading),
        frame_heading_sigma: best.frame_heading_sigma(),
    };
    // Unbelievable numbers are not told.
    let is_sound = poses.iter().all(PoseParts::is_usable)
        && located.is_usable()
        && best.chi_squared.is_finite();
    if !is_sound {
        return Err(NotYet::Refused(Refusal::Undetermined));
    }
    Ok((poses, located))
}

#[cfg(test)]
mod tests {
    use calib_core::dead_reckoning::Track;

    use super::*;

    fn nowhere() -> Place<f32> {
        Track::default().place(0.0).unwrap()
    }

    const SEEN: Seen = Seen::direction(0.1, 0.01);

    fn kept(stops: &ReferenceStops) -> std::vec::Vec<(MemberAddress, StopNumber)> {
        stops.iter().map(OfStop::key).collect()
    }

    /// The second camera was away, and sends all its sightings: none of them counts any more.
    #[test]
    fn what_is_told_late_takes_no_room() {
        let mut stops = ReferenceStops::new();
        let first = StopNumber::MAX - 3;
        let numbers = (0..20).map(|n| first.wrapping_add(n));
        for stop in numbers.clone() {
            assert!(stops.own(1, stop, nowhere(), SEEN).is_some());
        }
        let before = kept(&stops);
        for stop in numbers {
            let is_kept = before.contains(&(1, stop));
            assert_eq!(stops.other(1, stop, SEEN).is_some(), is_kept, "{stop}");
        }
        assert_eq!(kept(&stops), before);
        assert!(stops.iter().all(|stop| stop.other.is_some()));
        // A new stop may be told by the other one first; and a target may begin anew.
        for stop in [first.wrapping_add(20), 30_000, 1_000] {
            assert!(stops.other(1, stop, SEEN).is_some());
        }
    }

    /// The order of two targets' numbers is chance.
    #[test]
    fn the_newest_stops_of_two_targets_are_kept() {
        for second in [0, 20_000, 40_000, 60_000] {
            let mut stops = ReferenceStops::new();
            let mut told = std::vec::Vec::new();
            for n in 0..20 {
                for (target, stop) in [(1, 100 + n), (2, second + n)] {
                    stops.own(target, stop, nowhere(), SEEN);
                    told.push((target, stop));
                }
            }
            let mut kept = kept(&stops);
            kept.sort_by_key(|key| told.iter().position(|told| told == key));
            assert_eq!(kept, told[told.len() - REFERENCE_STOPS..]);
        }
    }
}
