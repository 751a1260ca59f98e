//! Objects without a radio that walk about after the calibration, while all cameras track.

use std::{collections::BTreeMap, f64::consts::SQRT_2, sync::atomic::Ordering, time::Duration};

use calib_core::angle::wrap_signed;
use nalgebra::{Point2, Vector2};
use node_firmware::{
    console::{ToPc, TrackedObject},
    message::{CameraCommand, Tracked},
};
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use results::record::RunRecord;

use super::{SECOND, Simulation, journal::Moment, outcome};
use crate::tracking::{Causes, Leg, Score, Sight};
use site::{
    CameraNode, MovingObject,
    world::{Camera, Target, World},
};
use virtual_hardware::{executor::Time, random::Root};

/// Period with which objects move: less than a frame of any camera.
const MOVES: Time = SECOND / 50;
/// Period with which tracks are compared with the truth.
const SAMPLES: Time = SECOND / 10;
/// Time between the orders to track of two cameras.
const ORDERS: Time = SECOND / 5;
/// Time from the last order until objects are known.
const SETTLES: Time = 5 * SECOND;
/// Place of carriers after they have gone.
const AWAY: Point2<f64> = Point2::new(1e6, 1e6);
/// Silence after which a camera is told again.
const SILENCE: Duration = Duration::from_secs(5);
/// Number of objects that are drawn where the scenario has none.
const DRAWN: u64 = 2;
/// Distance that they keep from walls, besides their radius, metres.
const CLEARANCE: f64 = 0.3;
/// Number of tries to find a place to go to.
const TRIES: usize = 1_000;
/// The colour that all cameras have learnt.
const COLOUR: u8 = 0;

/// An object that walks about.
struct Walker {
    index: usize,
    place: Point2<f64>,
    goal: Point2<f64>,
    /// Speed, units a second.
    speed: f64,
    next: Next,
}

/// Its next goal.
enum Next {
    /// Along these places, to and fro.
    Path(Vec<Point2<f64>>, usize),
    /// Straight to a place in view of two cameras, with this distance from walls on the way.
    Anywhere(f64, Box<ChaCha8Rng>),
}

impl Walker {
    /// An object of the scenario.
    fn on_path(object: &MovingObject) -> Option<Self> {
        let place = *object.path.first()?;
        Some(Self {
            index: object.index,
            place,
            goal: place,
            speed: object.speed,
            next: Next::Path(object.path.clone(), 0),
        })
    }

    /// An object like the first target. It begins in view of two cameras, if there is such a place.
    fn drawn(
        world: &mut World,
        speed: f64,
        clearance: f64,
        mut random: ChaCha8Rng,
    ) -> Option<Self> {
        let like = *world.targets().first()?;
        let place = (0..TRIES)
            .map(|_| somewhere(world, &mut random))
            .find(|&place| is_seen(world, place, like.radius))?;
        let index = world.add_target(Target { place, ..like });
        Some(Self {
            index,
            place,
            goal: place,
            speed,
            next: Next::Anywhere(clearance, Box::new(random)),
        })
    }

    /// Goes on for so long. Returns the new leg if the object has changed its direction.
    fn walk(&mut self, world: &mut World, now: Time, seconds: f64) -> Option<Leg> {
        let mut far = self.speed * seconds;
        let mut leg = None;
        // A path of one place, or a place without a way out, has no next one.
        for _ in 0..2 {
            let way = self.goal - self.place;
            let left = way.norm();
            if left > far {
                self.place += way * (far / left);
                break;
            }
            self.place = self.goal;
            far -= left;
            self.goal = self.next_goal(world).unwrap_or(self.goal);
            let way = self.goal - self.place;
            let direction = way.try_normalize(0.0).unwrap_or_else(Vector2::zeros);
            let spent = seconds - far / self.speed;
            leg = Some(Leg {
                begin: Duration::from_nanos(now) + Duration::from_secs_f64(spent),
                place: self.place,
                velocity: direction * self.speed,
            });
        }
        world.move_target(self.index, self.place);
        leg
    }

    fn next_goal(&mut self, world: &World) -> Option<Point2<f64>> {
        let radius = world.targets()[self.index].radius;
        let here = self.place;
        match &mut self.next {
            Next::Path(path, step) => {
                let last = path.len() - 1;
                *step = (*step + 1) % (2 * last).max(1);
                path.get(last - last.abs_diff(*step)).copied()
            }
            Next::Anywhere(clearance, random) => {
                (0..TRIES).map(|_| somewhere(world, random)).find(|&goal| {
                    // The cheap question first: one who stands in a corner asks at every move.
                    let blocked = world.obstacle_on_way(here, goal, radius + *clearance);
                    blocked.is_none() && is_seen(world, goal, radius)
                })
            }
        }
    }
}

/// A row of the coordinators' messages about objects while they were tracked, beside the truth.
#[derive(Clone, Copy, Debug)]
pub struct TrackRow {
    /// Time of the message.
    pub seconds: f64,
    /// Number of the network, from 1, in whose frame places are.
    pub network: u16,
    /// The number of the track.
    pub track: u16,
    /// The object as it was told; `None`: it is gone.
    pub told: Option<TrackedObject>,
    /// Number of the object, from 1, and its true place.
    pub truth: Option<(usize, Point2<f64>)>,
}

/// Result of tracking.
#[derive(Debug)]
pub struct TrackingRun {
    /// The record, with each network's tracking.
    pub record: RunRecord,
    /// All messages.
    pub rows: Vec<TrackRow>,
    /// Reasons why it did not go better, by network.
    pub causes: Vec<Causes>,
}

/// The objects that walk about, and the messages about them.
struct Course {
    walkers: Vec<Walker>,
    scores: Vec<Score>,
    rows: Vec<TrackRow>,
    /// Time at which each camera was told to track.
    asked: BTreeMap<u16, Duration>,
}

impl Course {
    /// All objects go on.
    fn walk(&mut self, world: &mut World, now: Time) {
        for (object, walker) in self.walkers.iter_mut().enumerate() {
            if let Some(leg) = walker.walk(world, now, MOVES as f64 * 1e-9) {
                for score in &mut self.scores {
                    score.leg(object, leg);
                }
            }
        }
    }
}

/// A random place between the cameras.
fn somewhere(world: &World, random: &mut impl Rng) -> Point2<f64> {
    let (mut low, mut high) = (Point2::origin(), Point2::origin());
    for (number, camera) in world.cameras().iter().enumerate() {
        let (a, b) = match number {
            0 => (camera.place, camera.place),
            _ => (low, high),
        };
        (low, high) = (a.inf(&camera.place), b.sup(&camera.place));
    }
    let mut share = || random.random_range(0.0..1.0);
    Point2::new(
        low.x + (high.x - low.x) * share(),
        low.y + (high.y - low.y) * share(),
    )
}

fn is_seen(world: &World, place: Point2<f64>, radius: f64) -> bool {
    world.cameras_that_see(place, radius).len() >= 2
}

impl Simulation {
    /// Tracks objects after a run that [takes orders](Self::take_orders): all carriers go away with their targets,
    /// the objects of the scenario walk about, or two drawn ones like its first target, and all cameras are told
    /// to track. From then on the record has the quality of tracking. `look` as in
    /// [`run_watched`](Self::run_watched). `None`: no object has a place to be at.
    pub fn track(
        &mut self,
        seconds: f64,
        every: Time,
        mut look: impl FnMut(&mut Self),
    ) -> Option<TrackingRun> {
        let walkers = self.walkers()?;
        let metres = self.scenario.metres_per_unit();
        let score = Score::new(walkers.len(), metres);
        let mut course = Course {
            scores: vec![score; self.consoles.len()],
            walkers,
            rows: Vec::new(),
            asked: BTreeMap::new(),
        };
        for node in self.nodes.iter().filter(|node| node.is_target()) {
            node.lose_power();
        }
        let now = self.executor.clock().time();
        let cameras = self.world.borrow().cameras().len() as Time;
        let begin = now + ORDERS * cameras + SETTLES;
        let end = begin + (seconds * 1e9) as Time;
        let (mut next_order, mut next_sample) = (now, begin);
        let stop = self.stop.clone();
        let is_over = move || stop.load(Ordering::Relaxed);
        while self.executor.clock().time() < end && !is_over() {
            let now = self.executor.clock().time();
            if now >= next_order {
                next_order = now + ORDERS;
                self.order_one(&mut course.asked);
            }
            course.walk(&mut self.world.borrow_mut(), now);
            self.run_looking(now + MOVES, every, &is_over, &mut look);
            let is_due = self.executor.clock().time() >= next_sample;
            if is_due {
                next_sample += SAMPLES;
            }
            self.compare(&mut course, begin, is_due);
        }
        let tracked = self.executor.clock().time().saturating_sub(begin) as f64 * 1e-9;
        let scores = (1..).zip(&course.scores);
        self.tracking = scores.map(|(n, score)| score.end(n, tracked)).collect();
        Some(TrackingRun {
            record: outcome::record(self, 0.0, true),
            rows: course.rows,
            causes: course.scores.iter().map(Score::causes).collect(),
        })
    }

    fn walkers(&self) -> Option<Vec<Walker>> {
        let mut world = self.world.borrow_mut();
        let clearance = CLEARANCE / self.scenario.metres_per_unit();
        let speed = self.scenario.walk.speed;
        let root = Root(self.scenario.seed);
        let walkers: Option<Vec<_>> = match &self.site.objects[..] {
            [] => (0..DRAWN)
                .map(|n| Walker::drawn(&mut world, speed, clearance, root.stream("object", n)))
                .collect(),
            objects => objects.iter().map(Walker::on_path).collect(),
        };
        for target in self.site.networks.iter().flat_map(|n| &n.targets) {
            world.move_target(target.index, AWAY);
        }
        walkers
    }

    /// Tells the next camera that does not track to do so.
    fn order_one(&self, asked: &mut BTreeMap<u16, Duration>) {
        let now = Duration::from_nanos(self.executor.clock().time());
        let is_quiet = |at: &Duration| now.saturating_sub(*at) >= SILENCE;
        let mut networks = self.site.networks.iter().zip(&self.consoles);
        let quiet = networks.find_map(|(network, console)| {
            let heard = console.heard();
            let mut cameras = network.cameras.iter().map(|camera| camera.id);
            cameras
                .find(|id| heard.get(id).is_none_or(is_quiet) && asked.get(id).is_none_or(is_quiet))
        });
        if let Some(camera) = quiet {
            asked.insert(camera, now);
            self.order(camera, CameraCommand::Track { colour: COLOUR });
        }
    }

    /// Takes in the messages of each network, with the truth.
    fn compare(&self, course: &mut Course, begin: Time, is_due: bool) {
        let now = Duration::from_nanos(self.executor.clock().time());
        let begin = Duration::from_nanos(begin);
        let world = self.world.borrow();
        let mut journal = self.journal.borrow_mut();
        let is_radius_told = self.scenario.firmware.ball_radius() > 0.0;
        let networks = self.site.networks.iter().zip(&self.consoles);
        for ((number, (network, console)), score) in (1..).zip(networks).zip(&mut course.scores) {
            let frame = outcome::frame(self, network, console);
            let places = course
                .walkers
                .iter()
                .map(|walker| frame.place(walker.place));
            let places: Vec<_> = places.collect();
            for (at, message) in console.tracking() {
                match message {
                    ToPc::Tracked { address, tracked } => {
                        let id = console.view().id_of(address);
                        let of = |camera: &&CameraNode| Some(camera.id) == id;
                        let Some(node) = network.cameras.iter().find(of) else {
                            continue;
                        };
                        let camera = &world.cameras()[node.index];
                        let age = Duration::from_millis(tracked.age_ms.into());
                        let look = at.saturating_sub(age);
                        let sights = sights(camera, &tracked, &course.walkers);
                        for (object, sight) in sights.into_iter().enumerate() {
                            let Some(mut sight) = sight else { continue };
                            let radius = world.targets()[course.walkers[object].index].radius;
                            sight.radius = is_radius_told.then_some(radius);
                            match look {
                                look if look >= begin => score.look(look, object, sight),
                                look => score.look_before(look, object, sight),
                            }
                        }
                    }
                    ToPc::Object { id, object } => {
                        if at >= begin {
                            score.told(at, id, object.as_ref(), &places);
                        }
                        let truth = score.object_of(id);
                        course.rows.push(TrackRow {
                            seconds: at.as_secs_f64(),
                            network: number,
                            track: id,
                            told: object,
                            truth: truth.map(|truth| (truth + 1, places[truth])),
                        });
                    }
                    _ => {}
                }
            }
            if is_due {
                let are_seen: Vec<_> = { course.walkers.iter() }
                    .map(|walker| {
                        let radius = world.targets()[walker.index].radius;
                        let seen = world.cameras_that_see(walker.place, radius);
                        let own = |index: &&usize| {
                            network.cameras.iter().any(|camera| camera.index == **index)
                        };
                        seen.iter().filter(own).count() >= 2
                    })
                    .collect();
                score.sample(now, &places, &are_seen);
                for (object, place) in (1..).zip(&places) {
                    journal.moment(console.id(), || Moment::Truth(object, *place));
                }
            }
        }
    }
}

/// Information of a camera's look about each object, in the world. For the object nearest to the direction seen:
/// that direction, unless several are in the box. For all others in the box: as much as an edge of it tells.
fn sights(camera: &Camera, tracked: &Tracked, walkers: &[Walker]) -> Vec<Option<Sight>> {
    let Some(seen) = tracked.seen else {
        return Vec::new();
    };
    let direction = camera.heading + f64::from(seen.bearing);
    let off = walkers.iter().map(|walker| {
        let to = walker.place - camera.place;
        wrap_signed(to.y.atan2(to.x) - direction).abs()
    });
    let off: Vec<f64> = off.collect();
    let nearest = off.iter().copied().fold(f64::MAX, f64::min);
    let sigma = f64::from(seen.sigma);
    let reach = f64::from(seen.half_angle()) + 4.0 * sigma;
    let sight = |off: f64| {
        let is_shown = off == nearest && !tracked.is_wide;
        (is_shown || off < reach).then_some(Sight {
            camera: camera.place,
            direction: is_shown.then_some(direction),
            sigma: if is_shown { sigma } else { sigma * SQRT_2 },
            radius: None,
        })
    };
    off.into_iter().map(sight).collect()
}
