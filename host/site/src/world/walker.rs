//! A target that walks from stop to stop.

use nalgebra::{Point2, Vector2};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, UnitDisc};

use super::Time;

const SECOND: f64 = 1e9;

/// Gait of a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gait {
    /// Units per second.
    pub speed: f64,
    /// It moves on in steps of this time (Euler's method), nanoseconds.
    pub tick: Time,
    /// Most that it may come to stand off a stop: anywhere on the disc of this radius about it, evenly.
    pub arrive_within: f64,
    /// Standard deviation of the height at which its ball is carried, drawn anew for each stop.
    pub bob: f64,
    /// Length of one step of its step sensor.
    pub step_length: f64,
    /// It walks on, told or not, after it stood as long as this, nanoseconds.
    pub patience: Time,
}

impl Gait {
    /// Standing sigma: standard deviation of each axis of its place about its stops; the mean is zero. Half the
    /// radius of the disc, for points that lie evenly on it.
    pub fn standing_sigma(&self) -> f64 {
        self.arrive_within / 2.0
    }
}

impl Default for Gait {
    /// The thesis's simulation (section 4.3, in Stage): 0.2 units a second every 100 ms, to within
    /// 0.02 units. Steps of 0.1 units, ten minutes' patience. Where the thesis's robot stops as soon
    /// as it is so near, always short of its goal, this one stands as far off on any side.
    fn default() -> Self {
        Self {
            speed: 0.2,
            tick: 100_000_000,
            arrive_within: 0.02,
            bob: 0.0,
            step_length: 0.1,
            patience: 600_000_000_000,
        }
    }
}

/// One step, as it was meant and as it was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stride {
    /// Number of the leg that it belongs to: 0 from stop 0 to stop 1.
    pub leg: usize,
    /// Number of steps of that leg.
    pub of: usize,
    /// Its share of the way from goal to goal.
    pub planned: Vector2<f64>,
    /// Where it led.
    pub walked: Vector2<f64>,
}

/// Event on the way of a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// It left a stop.
    Left {
        /// Number of the stop.
        stop: usize,
        /// It was not told to.
        impatient: bool,
    },
    /// It made a step.
    Step(Stride),
    /// It stands at a stop.
    Arrived {
        /// Number of the stop.
        stop: usize,
    },
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Standing {
        since: Time,
        /// When it was told to walk on.
        leave_at: Option<Time>,
    },
    Walking {
        next_tick: Time,
        /// Where it will stand.
        goal: Point2<f64>,
        /// Steps made on this leg.
        made: usize,
        of: usize,
        /// Where the last step ended.
        step_from: Point2<f64>,
        /// Distance of the goal at first.
        length: f64,
    },
}

/// A target's carrier: it walks straight from stop to stop, and stands at each until it is told to
/// walk on. The first stop is where it begins.
///
/// It stands a little off every stop, the first one too, by an error of its own each time that is
/// even on a disc (see [`Gait::arrive_within`]): there it goes, exactly.
///
/// Like the emulator it has no clock: [`Walker::next_at`] says when [`Walker::advance`] has
/// something to do.
#[derive(Clone, Debug)]
pub struct Walker {
    gait: Gait,
    stops: Vec<Point2<f64>>,
    place: Point2<f64>,
    /// Where it stands, or left.
    stop: usize,
    state: State,
    told: bool,
    mood: Mood,
    random: ChaCha8Rng,
    /// Height of its ball above that told, at the stop where it stands or stood.
    above: f64,
    heights: ChaCha8Rng,
}

/// Carrier's response to the lamp.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Mood {
    /// It waits for it, as long as its patience lasts.
    #[default]
    Heeds,
    /// It walks on after it stood as long as this at most, nanoseconds.
    Ignores(Time),
    /// It stays where it stands.
    Rests,
}

impl Walker {
    /// It stands at the first of its stops from time 0 on. Without any it stands at the origin.
    pub fn new(gait: Gait, stops: Vec<Point2<f64>>, mut random: ChaCha8Rng) -> Self {
        let first = stops.first().copied().unwrap_or_default();
        let mut heights = random.clone();
        heights.set_stream(!heights.get_stream());
        Self {
            above: height(&gait, &mut heights),
            heights,
            gait,
            place: near(first, &gait, &mut random),
            stops,
            random,
            stop: 0,
            state: State::Standing {
                since: 0,
                leave_at: None,
            },
            told: false,
            mood: Mood::default(),
        }
    }

    /// Where it is.
    pub fn place(&self) -> Point2<f64> {
        self.place
    }

    /// Height of its ball above the one told.
    pub fn above(&self) -> f64 {
        self.above
    }

    /// The stop at which it stands.
    pub fn standing_at(&self) -> Option<usize> {
        matches!(self.state, State::Standing { .. }).then_some(self.stop)
    }

    /// The stop at which it stands, a little off it.
    pub fn mark(&self) -> Option<Point2<f64>> {
        self.stops.get(self.standing_at()?).copied()
    }

    /// Returns true if it stands at its last stop, for good.
    pub fn is_done(&self) -> bool {
        self.standing_at().is_some() && self.stop + 1 >= self.stops.len()
    }

    /// Takes the state of the lamp that the carrier watches. Going on counts, being on does not: it may still be
    /// on for the stop before.
    pub fn may_walk(&mut self, lamp: bool, now: Time) {
        if let State::Standing { leave_at, .. } = &mut self.state
            && lamp
            && !self.told
        {
            leave_at.get_or_insert(now);
        }
        self.told = lamp;
    }

    /// Has it heed the lamp or not. Its patience begins anew after a rest.
    pub fn set_mood(&mut self, mood: Mood, now: Time) {
        if let State::Standing { since, leave_at } = &mut self.state
            && self.mood == Mood::Rests
            && mood != Mood::Rests
        {
            *since = now;
            *leave_at = leave_at.map(|at| at.max(now));
        }
        self.mood = mood;
    }

    /// Gives it more stops after the last one. If it stands there it sets out, told or not.
    pub fn go_on(&mut self, stops: impl IntoIterator<Item = Point2<f64>>, now: Time) {
        let stands = self.is_done();
        self.stops.extend(stops);
        if let State::Standing { since, leave_at } = &mut self.state
            && stands
        {
            // Not when the lamp went on for the last stop.
            *since = now;
            *leave_at = Some(now);
        }
    }

    /// When it does something next. `None` at the last stop, and where it rests.
    pub fn next_at(&self) -> Option<Time> {
        match self.state {
            _ if self.is_done() => None,
            State::Standing { .. } if self.mood == Mood::Rests => None,
            State::Standing { since, leave_at } => {
                let patience = match self.mood {
                    Mood::Ignores(stand) => stand.min(self.gait.patience),
                    _ => self.gait.patience,
                };
                let patience_ends = since.saturating_add(patience);
                Some(leave_at.map_or(patience_ends, |at| at.min(patience_ends)))
            }
            State::Walking { next_tick, .. } => Some(next_tick),
        }
    }

    /// Makes all steps and events that are due until now, with their times.
    pub fn advance(&mut self, now: Time, events: &mut Vec<(Time, Event)>) {
        while let Some(at) = self.next_at().filter(|&at| at <= now) {
            match self.state {
                State::Standing { leave_at, .. } => {
                    let impatient = leave_at.is_none_or(|told| told > at);
                    let stop = self.stop;
                    events.push((at, Event::Left { stop, impatient }));
                    self.leave(at);
                }
                State::Walking { .. } => self.walk(at, events),
            }
        }
    }

    /// From stop to stop.
    fn planned(&self) -> Vector2<f64> {
        self.stops[self.stop + 1] - self.stops[self.stop]
    }

    fn leave(&mut self, now: Time) {
        let steps = (self.planned().norm() / self.gait.step_length).ceil();
        let goal = near(self.stops[self.stop + 1], &self.gait, &mut self.random);
        self.state = State::Walking {
            next_tick: now + self.gait.tick,
            goal,
            made: 0,
            of: steps.max(1.0) as usize,
            step_from: self.place,
            length: (goal - self.place).norm(),
        };
    }

    fn walk(&mut self, now: Time, events: &mut Vec<(Time, Event)>) {
        let (planned, leg) = (self.planned(), self.stop);
        let State::Walking {
            next_tick,
            goal,
            made,
            of,
            step_from,
            length,
        } = &mut self.state
        else {
            return;
        };
        let stride = self.gait.speed * self.gait.tick as f64 / SECOND;
        let to_goal = *goal - self.place;
        let distance = to_goal.norm();
        let arrived = distance <= stride;
        let done = if arrived {
            self.place = *goal;
            1.0
        } else {
            self.place += to_goal * (stride / distance);
            1.0 - (distance - stride) / *length
        };
        while *made < *of && (*made + 1) as f64 <= done * *of as f64 {
            let walked = self.place - *step_from;
            *step_from = self.place;
            *made += 1;
            let step = Stride {
                leg,
                of: *of,
                planned: planned / *of as f64,
                walked,
            };
            events.push((now, Event::Step(step)));
        }
        *next_tick = now + self.gait.tick;
        if arrived {
            self.stop += 1;
            self.above = height(&self.gait, &mut self.heights);
            self.state = State::Standing {
                since: now,
                leave_at: None,
            };
            events.push((now, Event::Arrived { stop: self.stop }));
        }
    }
}

/// Where it comes to stand for a stop.
fn near(stop: Point2<f64>, gait: &Gait, random: &mut ChaCha8Rng) -> Point2<f64> {
    stop + Vector2::from(UnitDisc.sample(random)) * gait.arrive_within
}

/// Height of the ball at a stop, above the one told.
fn height(gait: &Gait, random: &mut ChaCha8Rng) -> f64 {
    let drawn: f64 = StandardNormal.sample(random);
    drawn * gait.bob
}
