//! A target that walks from stop to stop.

use std::f64::consts::TAU;

use nalgebra::{Point2, Vector2};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::Time;

const SECOND: f64 = 1e9;

/// How a target walks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gait {
    /// Units per second.
    pub speed: f64,
    /// It moves on in steps of this time (Euler's method), nanoseconds.
    pub tick: Time,
    /// A leg ends as soon as the goal is as near as this.
    pub arrive_within: f64,
    /// How far it goes for one step of its step sensor.
    pub step_length: f64,
    /// It walks on, told or not, after it stood as long as this, nanoseconds.
    pub patience: Time,
}

impl Default for Gait {
    /// The thesis's simulation (section 4.3, in Stage): 0.2 units a second every 100 ms, to within
    /// 0.02 units. Steps of 0.1 units, ten minutes' patience.
    fn default() -> Self {
        Self {
            speed: 0.2,
            tick: 100_000_000,
            arrive_within: 0.02,
            step_length: 0.1,
            patience: 600_000_000_000,
        }
    }
}

/// One step, as it was meant and as it was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stride {
    /// Which leg it belongs to: 0 from stop 0 to stop 1.
    pub leg: usize,
    /// How many steps that leg has.
    pub of: usize,
    /// Its share of the way from goal to goal.
    pub planned: Vector2<f64>,
    /// Where it led.
    pub walked: Vector2<f64>,
}

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// It left a stop.
    Left {
        /// Which.
        stop: usize,
        /// Nobody told it to.
        impatient: bool,
    },
    /// It made a step.
    Step(Stride),
    /// It stands at a stop.
    Arrived {
        /// Which.
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
        /// How much of the next tick it walks.
        share: f64,
        /// Steps made on this leg.
        made: usize,
        of: usize,
        /// Where the last step ended.
        step_from: Point2<f64>,
        /// How far the goal was at first.
        length: f64,
    },
}

/// A target's carrier: it walks straight from stop to stop, and stands at each until it is told to
/// walk on. The first stop is where it begins.
///
/// It leaves at a random moment between two ticks, so that it ends each leg anywhere within the last
/// stride before its goal. Where it begins, it stands as if it had come from somewhere.
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
    random: ChaCha8Rng,
}

impl Walker {
    /// It stands at the first of its stops from time 0 on. Without any it stands at the origin.
    pub fn new(gait: Gait, stops: Vec<Point2<f64>>, mut random: ChaCha8Rng) -> Self {
        let short = gait.arrive_within * random.random_range(0.0..1.0);
        let (sin, cos) = random.random_range(0.0..TAU).sin_cos();
        let first = stops.first().copied().unwrap_or_default();
        Self {
            gait,
            place: first + Vector2::new(cos, sin) * short,
            stops,
            random,
            stop: 0,
            state: State::Standing {
                since: 0,
                leave_at: None,
            },
            told: false,
        }
    }

    /// Where it is.
    pub fn place(&self) -> Point2<f64> {
        self.place
    }

    /// The stop at which it stands.
    pub fn standing_at(&self) -> Option<usize> {
        matches!(self.state, State::Standing { .. }).then_some(self.stop)
    }

    /// Whether it stands at its last stop, for good.
    pub fn is_done(&self) -> bool {
        self.standing_at().is_some() && self.stop + 1 >= self.stops.len()
    }

    /// What the lamp says that the carrier watches. Going on counts, being on does not: it may
    /// still be on for the stop before.
    pub fn may_walk(&mut self, lamp: bool, now: Time) {
        if let State::Standing { leave_at, .. } = &mut self.state
            && lamp
            && !self.told
        {
            leave_at.get_or_insert(now);
        }
        self.told = lamp;
    }

    /// When it does something next. `None` at the last stop.
    pub fn next_at(&self) -> Option<Time> {
        match self.state {
            _ if self.is_done() => None,
            State::Standing { since, leave_at } => {
                let patience_ends = since.saturating_add(self.gait.patience);
                Some(leave_at.map_or(patience_ends, |at| at.min(patience_ends)))
            }
            State::Walking { next_tick, .. } => Some(next_tick),
        }
    }

    /// Does what is due until now, and tells it with its times.
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

    fn goal(&self) -> Point2<f64> {
        self.stops[self.stop + 1]
    }

    /// From goal to goal.
    fn planned(&self) -> Vector2<f64> {
        self.goal() - self.stops[self.stop]
    }

    fn leave(&mut self, now: Time) {
        let steps = (self.planned().norm() / self.gait.step_length).ceil();
        self.state = State::Walking {
            next_tick: now + self.gait.tick,
            share: self.random.random_range(0.0..1.0),
            made: 0,
            of: steps.max(1.0) as usize,
            step_from: self.place,
            length: (self.goal() - self.place).norm(),
        };
    }

    fn walk(&mut self, now: Time, events: &mut Vec<(Time, Event)>) {
        let (goal, planned, leg) = (self.goal(), self.planned(), self.stop);
        let State::Walking {
            next_tick,
            share,
            made,
            of,
            step_from,
            length,
        } = &mut self.state
        else {
            return;
        };
        let stride = self.gait.speed * self.gait.tick as f64 / SECOND * *share;
        *share = 1.0;
        let to_goal = goal - self.place;
        let distance = to_goal.norm();
        if distance > self.gait.arrive_within {
            self.place += to_goal * (stride / distance).min(1.0);
        }
        let left = (goal - self.place).norm();
        let arrived = left <= self.gait.arrive_within;
        let done = if arrived { 1.0 } else { 1.0 - left / *length };
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
            self.state = State::Standing {
                since: now,
                leave_at: None,
            };
            events.push((now, Event::Arrived { stop: self.stop }));
        }
    }
}
