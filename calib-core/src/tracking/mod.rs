//! Tracking: where are the objects that cameras of known pose see, one bearing at a time?
//!
//! No source tells which object a bearing belongs to, when the next one comes, or from where. Each
//! object has a place and a velocity in a Kalman filter that is linearised about them (Bar-Shalom, Li,
//! Kirubarajan: Estimation with Applications to Tracking and Navigation, 2001, chapters 6 and 10).
//!
//! # Which object
//! A look lies within the gates of one object or of some. It corrects each of these by the probability that
//! it is of this one, and the doubt about that adds to the covariance: joint probabilistic data association
//! (Fortmann, Bar-Shalom, Scheffe: Sonar tracking of multiple targets, IEEE J. Oceanic
//! Engineering 8, 1983), which for one bearing at a time is as short as this. Looks with an equal share in
//! two objects that pass each other do little to both, and their velocities carry them past.
//!
//! Some cameras make *one* box of all that has the colour. Such a camera sees two objects as a box with both.
//! Its middle is nowhere, but each of its edges is that of the object there, beyond its middle by half its
//! width. The width comes from the looks that showed it alone, if it is not known
//! [beforehand](Settings::radius); until then the box serves none. A box whose width contradicts the distance
//! of the object, if the width is told as a [range](StationBearing::range), serves none either.
//!
//! # New objects
//! A look that no object explains is kept for half a second. Where the looks of two cameras meet, or where a
//! range ends, a *candidate* begins. From two cameras that see two objects each, four candidates come,
//! two of them ghosts. A candidate becomes an object once it explained enough looks, which are those of
//! three cameras or more, or have a range, or were explained by no other candidate. From then on its looks
//! are its own, and the ghosts that had a part in them get no more. Two cameras alone that see two objects
//! without their sizes never tell which of the four are real, and then none becomes one.
//!
//! An object that no camera sees is carried on by its velocity, until its place is too unsure. A new one is
//! taken for it and has its number again, if it began after the old one was seen last, and where that one can
//! have gone since.
//!
//! # Uncertainty
//! An unsure pose of a camera makes all its bearings err alike: it is a bias, and no number of looks takes it
//! away. The filter of Schmidt (Application of State-Space Methods to Navigation Problems, 1966) remembers
//! the common errors of an object's place and the poses of eight cameras.

mod filter;

use heapless::{Deque, Vec};
use nalgebra::{Matrix2, Point2, Vector2};

use self::filter::{Agreement, State, seconds};
use crate::{Ray, Real, intersection::StationBearing, numerics::real::lit};

/// Objects at a time, at most.
pub const OBJECTS: usize = 4;
/// Candidates at a time, at most.
const CANDIDATES: usize = 8;
/// Looks that wait for one of another camera, at most.
const WAITING: usize = 12;
/// A look is this old at most when it comes, microseconds.
pub const LATEST: u64 = 500_000;
/// So long a look waits for one of another camera, microseconds.
const WAITS: u64 = 500_000;
/// An object, and a candidate, that no look showed for so long is gone, microseconds.
const GONE: [u64; 2] = [3_000_000, 1_500_000];
/// Only one in a thousand of an object's bearings lies outside, without and with a range: chi squared of
/// one and two degrees of freedom.
const GATE: [f64; 2] = [10.83, 13.82];
/// Looks that tell how wide an object is.
const MEASURED: u8 = 8;
/// A look with at least this probability is of one object.
const CLEAR: f64 = 0.95;
/// A bearing, or a camera's heading, that is less sure says nothing, radians.
const LARGEST_SIGMA: f64 = 0.2;
/// Looks that a candidate needs, of three cameras; and of less.
const NEEDED: [u8; 2] = [6, 12];
/// An object that is gone is known again when it comes back within this time, microseconds.
const RETURNS: u64 = 10_000_000;
/// A candidate takes so long at least, microseconds.
const SHORTEST: u64 = 500_000;

/// Knowledge about the objects beforehand. Lengths in the unit of the cameras' places.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Settings<T> {
    /// Speed of their changes of velocity: density of the white noise of acceleration in each direction,
    /// squared length over cubed seconds.
    pub agility: T,
    /// Standard deviation of their velocity in each direction.
    pub speed_sigma: T,
    /// No object begins whose place is less sure, standard deviation.
    pub start_sigma: T,
    /// An object whose place is less sure is gone.
    pub lost_sigma: T,
    /// Their radius, if it is known. If not, looks tell it.
    pub radius: Option<T>,
}

impl Settings<f32> {
    /// People who walk about in a building, in metres.
    pub const WALKING: Self = Self {
        agility: 0.5,
        speed_sigma: 1.0,
        start_sigma: 0.7,
        lost_sigma: 3.0,
        radius: None,
    };
}

impl<T: Real> Settings<T> {
    /// From lengths in metres, the same in units of so many metres. The radius is not changed.
    #[must_use]
    pub fn in_units(self, metres_per_unit: T) -> Self {
        Self {
            agility: self.agility / (metres_per_unit * metres_per_unit),
            speed_sigma: self.speed_sigma / metres_per_unit,
            start_sigma: self.start_sigma / metres_per_unit,
            lost_sigma: self.lost_sigma / metres_per_unit,
            radius: self.radius,
        }
    }

    /// [`WALKING`](Settings::WALKING) in any precision.
    pub fn walking() -> Self {
        let Settings {
            agility,
            speed_sigma,
            start_sigma,
            lost_sigma,
            radius,
        } = Settings::WALKING;
        let real = |value: f32| lit(f64::from(value));
        Self {
            agility: real(agility),
            speed_sigma: real(speed_sigma),
            start_sigma: real(start_sigma),
            lost_sigma: real(lost_sigma),
            radius: radius.map(real),
        }
    }
}

/// One look of one camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look<T: Real> {
    /// The camera's number.
    pub camera: u16,
    /// Time of the look, microseconds since whatever all looks count from.
    pub at: u64,
    /// Direction, and distance if the size tells it.
    pub bearing: StationBearing<T>,
    /// Half the angle that the box is wide, radians; 0 if it is not known.
    pub half_width: T,
    /// The box is wider than an object of its height: there may be several in it.
    pub is_wide: bool,
}

/// Effect of a look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Outcome {
    /// It corrected this object.
    Object(u16),
    /// It made this object out of a candidate.
    New(u16),
    /// It could be of more than one object, and corrected each by its share.
    Ambiguous,
    /// It shows several objects in one box, and corrected at most those at the edges.
    Several,
    /// It lies in the direction of an object and contradicts its distance.
    Contradicts,
    /// It corrected candidates, or waits for other cameras.
    Candidate,
    /// A number of it is not usable, or it is too old.
    Unusable,
}

/// An object.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Object<T: Real> {
    /// Its number. The next one to come has the next number, unless it was there before.
    pub id: u16,
    /// Where it is.
    #[cfg_attr(feature = "defmt", defmt(Debug2Format))]
    pub position: Point2<T>,
    /// Its rate, per second.
    #[cfg_attr(feature = "defmt", defmt(Debug2Format))]
    pub velocity: Vector2<T>,
    /// Covariance of the position, that of the cameras' poses included.
    #[cfg_attr(feature = "defmt", defmt(Debug2Format))]
    pub covariance: Matrix2<T>,
    /// When a look last showed it, microseconds.
    pub seen: u64,
}

#[derive(Clone, Copy, Debug)]
struct Tracked<T: Real> {
    id: u16,
    state: State<T>,
    seen: u64,
    /// As told by the looks that showed it alone, and the number of these.
    radius: T,
    measured: u8,
}

impl<T: Real> Tracked<T> {
    /// Bearing of the object by a look; `edge`: this edge of the box, radians from its middle, is that of the
    /// object. `None` if its width is not known.
    fn bearing_of(
        &self,
        look: &Look<T>,
        edge: Option<T>,
        settings: &Settings<T>,
    ) -> Option<StationBearing<T>> {
        let mut bearing = look.bearing;
        let Some(edge) = edge else {
            return Some(bearing);
        };
        let measured = (self.measured >= MEASURED).then_some(self.radius);
        let half = settings.radius.or(measured)? / self.distance(look);
        let half = half.min(edge.abs());
        bearing.ray = Ray::from_bearing(bearing.ray.bearing() + edge - half.copysign(edge));
        // One edge is less sure than the mean of two.
        bearing.bearing_sigma *= lit(core::f64::consts::SQRT_2);
        bearing.range = None;
        Some(bearing)
    }

    fn distance(&self, look: &Look<T>) -> T {
        (self.state.place() - look.bearing.pose.position).norm()
    }

    /// A look showed it alone.
    fn measure(&mut self, look: &Look<T>) {
        if look.half_width > T::zero() {
            self.measured = self.measured.saturating_add(1).min(MEASURED * 4);
            let radius = self.distance(look) * look.half_width;
            self.radius += (radius - self.radius) / lit(f64::from(self.measured));
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Candidate<T: Real> {
    state: State<T>,
    began: u64,
    seen: u64,
    looks: u8,
    /// The first cameras that saw it.
    cameras: [Option<u16>; 3],
    /// Looks in a row that no other candidate explained.
    alone: u8,
    has_range: bool,
}

impl<T: Real> Candidate<T> {
    fn is_real(&self) -> bool {
        let [few, many] = NEEDED;
        let by_three = self.cameras.iter().all(Option::is_some) && self.looks >= few;
        let otherwise = self.looks >= many && (self.has_range || self.alone >= many);
        self.seen.saturating_sub(self.began) >= SHORTEST && (by_three || otherwise)
    }

    fn was_seen(&mut self, look: &Look<T>) {
        self.seen = self.seen.max(look.at);
        self.looks = self.looks.saturating_add(1);
        self.has_range |= look.bearing.range.is_some();
        for camera in &mut self.cameras {
            if *camera.get_or_insert(look.camera) == look.camera {
                break;
            }
        }
    }
}

/// An object that is gone, and where it was when it was seen last.
#[derive(Clone, Copy, Debug)]
struct Former<T: Real> {
    id: u16,
    place: Point2<T>,
    seen: u64,
}

impl<T: Real> Former<T> {
    fn of(object: &Tracked<T>) -> Self {
        let Tracked {
            id, state, seen, ..
        } = object;
        let since = seconds::<T>(state.at.saturating_sub(*seen));
        Self {
            id: *id,
            place: state.place() - state.rate() * since,
            seen: *seen,
        }
    }

    /// Distance to this candidate, squared, if it can have gone there since.
    fn distance(&self, candidate: &Candidate<T>, settings: &Settings<T>) -> Option<T> {
        let since = candidate.began.checked_sub(self.seen)?;
        let way = candidate.state.place() - self.place;
        let reach = settings.speed_sigma * (seconds::<T>(since) + T::one()) * lit(2.0);
        let distance = way.x * way.x + way.y * way.y;
        (since <= RETURNS && distance <= reach * reach).then_some(distance)
    }
}

/// Up to [`OBJECTS`] objects.
#[derive(Clone, Debug)]
pub struct Tracker<T: Real> {
    settings: Settings<T>,
    now: u64,
    next: u16,
    objects: Vec<Tracked<T>, OBJECTS>,
    /// Those that are gone and may come back.
    former: [Option<Former<T>>; OBJECTS],
    candidates: Vec<Candidate<T>, CANDIDATES>,
    /// The oldest first.
    waiting: Deque<Look<T>, WAITING>,
}

impl<T: Real> Tracker<T> {
    /// Nothing is known yet.
    pub const fn new(settings: Settings<T>) -> Self {
        Self {
            settings,
            now: 0,
            next: 1,
            objects: Vec::new(),
            former: [None; OBJECTS],
            candidates: Vec::new(),
            waiting: Deque::new(),
        }
    }

    /// From now on objects are of this kind.
    pub fn follow(&mut self, settings: Settings<T>) {
        self.settings = settings;
    }

    /// The objects there are, by the time that was [told](Self::go_to) last.
    pub fn objects(&self) -> impl Iterator<Item = Object<T>> {
        self.objects.iter().map(|object| Object {
            id: object.id,
            position: object.state.place(),
            velocity: object.state.rate(),
            covariance: object.state.place_covariance(),
            seen: object.seen,
        })
    }

    /// Carries the objects on by their velocities. Objects that were not seen for too long are gone. Time
    /// that goes back changes nothing.
    pub fn go_to(&mut self, now: u64) {
        self.now = self.now.max(now);
        let (now, settings) = (self.now, self.settings);
        let is_gone = |state: &mut State<T>, seen: u64, gone: u64| {
            state.go_to(now, settings.agility);
            let variance = state.place_covariance().trace();
            now.saturating_sub(seen) > gone
                || !(variance < settings.lost_sigma * settings.lost_sigma)
        };
        let former = &mut self.former;
        self.objects.retain_mut(|object| {
            let is_gone = is_gone(&mut object.state, object.seen, GONE[0]);
            if is_gone {
                // Instead of the one that was seen the longest ago.
                let age = |slot: &&mut Option<Former<T>>| slot.map_or(0, |slot| slot.seen);
                if let Some(slot) = former.iter_mut().min_by_key(age) {
                    *slot = Some(Former::of(object));
                }
            }
            !is_gone
        });
        self.candidates
            .retain_mut(|candidate| !is_gone(&mut candidate.state, candidate.seen, GONE[1]));
        let is_late = |look: &Look<T>| now.saturating_sub(look.at) > WAITS;
        while self.waiting.front().is_some_and(is_late) {
            self.waiting.pop_front();
        }
    }

    /// Takes a look, which must not be from later than `now`.
    pub fn take(&mut self, now: u64, look: &Look<T>) -> Outcome {
        self.go_to(now);
        let is_usable = look.bearing.is_usable()
            && look.bearing.bearing_sigma < lit(LARGEST_SIGMA)
            && look.bearing.pose.sigma_heading() < lit(LARGEST_SIGMA)
            && look.bearing.pose.sigma_position() < self.settings.start_sigma
            && look.half_width >= T::zero()
            && look.half_width < T::frac_pi_2();
        let is_timely = look.at <= self.now && self.now.saturating_sub(look.at) <= LATEST;
        if !(is_usable && is_timely) {
            return Outcome::Unusable;
        }
        if let Some(outcome) = self.offer(look) {
            return outcome;
        }
        self.offer_to_candidates(look);
        self.settle().map_or(Outcome::Candidate, Outcome::New)
    }

    /// To the objects. `None` if the look has nothing to do with any.
    fn offer(&mut self, look: &Look<T>) -> Option<Outcome> {
        let (mut inside, mut towards) = (0_u8, 0_u8);
        for object in &self.objects {
            let told = (object.state).agreement(look.at, look.camera, &look.bearing);
            if let Some(Agreement { off, .. }) = told {
                let (off, sigma) = off;
                inside += u8::from(off < look.half_width);
                towards += u8::from(off < look.half_width + sigma * lit(3.0));
            }
        }
        if look.is_wide || inside > 1 {
            let _ = self.assign(look, Some(look.half_width));
            let _ = self.assign(look, Some(-look.half_width));
            return Some(Outcome::Several);
        }
        let contradicts = (towards > 0).then_some(Outcome::Contradicts);
        self.assign(look, None).or(contradicts)
    }

    /// Corrects each object by the probability that the look is of it; `edge`: this edge of the box, radians
    /// from its middle, is that of the object. `None` if it is of none.
    fn assign(&mut self, look: &Look<T>, edge: Option<T>) -> Option<Outcome> {
        let settings = self.settings;
        let mut scores = [None; OBJECTS];
        for (object, score) in self.objects.iter().zip(&mut scores) {
            let Some(bearing) = object.bearing_of(look, edge, &settings) else {
                continue;
            };
            let agreement = object.state.agreement(look.at, look.camera, &bearing);
            *score = agreement
                .filter(|agreement| agreement.squared <= gate(&bearing))
                .map(|agreement| agreement.score);
        }
        let known = || scores.iter().flatten().copied();
        let best = known().reduce(T::min)?;
        let likelihood = |score: T| ((best - score) * lit(0.5)).exp();
        let all = known().map(likelihood);
        let all = all.fold(T::zero(), |sum, one| sum + one);
        let mut outcome = Outcome::Ambiguous;
        for (object, score) in self.objects.iter_mut().zip(scores) {
            let bearing = object.bearing_of(look, edge, &settings);
            let (Some(score), Some(bearing)) = (score, bearing) else {
                continue;
            };
            let share = likelihood(score) / all;
            (object.state).take_share(look.at, look.camera, &bearing, share);
            if share > lit(0.5) {
                object.seen = object.seen.max(look.at);
            }
            if share > lit(CLEAR) {
                if edge.is_none() {
                    object.measure(look);
                }
                outcome = Outcome::Object(object.id);
            }
        }
        Some(outcome)
    }

    /// To all candidates that it may belong to, and to the new ones that it makes.
    fn offer_to_candidates(&mut self, look: &Look<T>) {
        let mut explained = 0_u8;
        let mut hit = [false; CANDIDATES];
        for (candidate, hit) in self.candidates.iter_mut().zip(&mut hit) {
            let agreement = (candidate.state).agreement(look.at, look.camera, &look.bearing);
            if agreement.is_some_and(|agreement| agreement.squared <= gate(&look.bearing)) {
                (candidate.state).take_share(look.at, look.camera, &look.bearing, T::one());
                candidate.was_seen(look);
                explained += 1;
                *hit = true;
            }
        }
        for (candidate, hit) in self.candidates.iter_mut().zip(hit) {
            if hit {
                candidate.alone = match explained {
                    1 => candidate.alone.saturating_add(1),
                    _ => 0,
                };
            }
        }
        for n in 0..WAITING {
            if let Some(other) = self.waiting.iter().nth(n).copied()
                && other.camera != look.camera
            {
                self.begin(&other, Some(look));
            }
        }
        if explained == 0 && look.bearing.range.is_some() {
            self.begin(look, None);
        }
        self.wait(look);
    }

    /// A candidate where looks meet, or where the range of one ends, unless there is one.
    #[inline(never)] // for less stack
    fn begin(&mut self, one: &Look<T>, other: Option<&Look<T>>) {
        if self.candidates.is_full() {
            return;
        }
        // The earliest first.
        let (first, last) = match other {
            Some(other) if other.at < one.at => (other, Some(one)),
            other => (one, other),
        };
        let Some(mut state) = State::start(first, last, &self.settings) else {
            return;
        };
        state.go_to(self.now, self.settings.agility);
        let mut others = self.candidates.iter().map(|c| &c.state);
        if others.any(|other| is_same(other, &state)) {
            return;
        }
        let mut candidate = Candidate {
            state,
            began: first.at,
            seen: first.at,
            looks: 0,
            cameras: [None; 3],
            alone: 0,
            has_range: false,
        };
        for look in [Some(first), last].into_iter().flatten() {
            candidate.was_seen(look);
        }
        // There is room, as was seen.
        let _ = self.candidates.push(candidate);
    }

    /// Keeps a look for others, instead of the oldest one if there are too many.
    fn wait(&mut self, look: &Look<T>) {
        if self.waiting.is_full() {
            self.waiting.pop_front();
        }
        let _ = self.waiting.push_back(*look);
    }

    /// Candidates that are one and the same become one, and one that is real becomes an object.
    fn settle(&mut self) -> Option<u16> {
        let mut goes = [false; CANDIDATES];
        for (n, (one, goes)) in self.candidates.iter().zip(&mut goes).enumerate() {
            let mut objects = self.objects.iter();
            let is_known = objects.any(|object| is_same(&object.state, &one.state));
            let mut others = self.candidates.iter().enumerate();
            let is_double = others.any(|(m, other)| {
                let is_older = (other.looks, n) > (one.looks, m);
                m != n && is_older && is_same(&other.state, &one.state)
            });
            *goes = is_known || is_double;
        }
        let mut goes = goes.into_iter();
        self.candidates.retain(|_| goes.next() != Some(true));
        let (real, candidate, known) = (0..self.candidates.len()).find_map(|place| {
            let candidate = *self.candidates.get(place)?;
            let known = candidate.is_real().then(|| self.known_as(&candidate))?;
            let has_room = known.is_some() || !self.objects.is_full();
            has_room.then_some((place, candidate, known))
        })?;
        let mut place = 0..;
        self.candidates.retain(|_| place.next() != Some(real));
        let id = known.unwrap_or(self.next);
        if known.is_none() {
            self.next = self.next.checked_add(1).unwrap_or(1);
        }
        let Candidate { state, seen, .. } = candidate;
        self.objects.retain(|object| object.id != id);
        // There is room, as was seen.
        let _ = self.objects.push(Tracked {
            id,
            state,
            seen,
            radius: T::zero(),
            measured: 0,
        });
        Some(id)
    }

    /// The number of the object that a candidate was before: the nearest that no camera saw since the
    /// candidate began and that can have gone there.
    fn known_as(&mut self, candidate: &Candidate<T>) -> Option<u16> {
        let mut best: Option<(T, u16)> = None;
        let stale = self.objects.iter().map(Former::of);
        // One that is gone can come back only where there is room.
        let most = if self.objects.is_full() { 0 } else { OBJECTS };
        let gone = self.former.iter().take(most).flatten().copied();
        for former in stale.chain(gone) {
            if let Some(distance) = former.distance(candidate, &self.settings)
                && best.is_none_or(|(least, _)| distance < least)
            {
                best = Some((distance, former.id));
            }
        }
        let (_, id) = best?;
        for slot in &mut self.former {
            if slot.is_some_and(|former| former.id == id) {
                *slot = None;
            }
        }
        Some(id)
    }
}

fn gate<T: Real>(look: &StationBearing<T>) -> T {
    let [bearing, both] = GATE;
    lit(if look.range.is_some() { both } else { bearing })
}

/// Returns true if two places are one, as far as can be told: chi squared of two degrees of freedom.
fn is_same<T: Real>(one: &State<T>, other: &State<T>) -> bool {
    one.distance(other).is_none_or(|squared| squared < lit(6.0))
}
