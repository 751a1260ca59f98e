//! A target's carrier: walks from stop to stop when the lamp says so.

use std::{
    cell::RefCell,
    future::poll_fn,
    rc::Rc,
    task::{Poll, Waker},
};

use embassy_futures::select::{Either, select};
use nalgebra::Point2;

use super::{
    SECOND, SharedWorld, Simulation, console::Console, journal::SharedJournal, node::Node,
};
use node_firmware::{
    console::FromPc,
    message::{SitePlace, TargetLocation},
};
use site::TargetNode;
use site::world::{Event, StepSensor, Walker};
use virtual_hardware::{
    executor::{Clock, Time},
    medium::Medium,
    random::Root,
};

/// Longest time that the carrier waits for nodes that do not appear.
const SET_UP_LIMIT: Time = 120 * SECOND;

/// Length of the moves in which a target's radio follows while it walks: much less than the reach of a
/// radio, and often enough.
const ANTENNA_MOVES: f64 = 1.0;

/// Time after which a carrier tells its place once more where it was not heard, or learns of a fault.
const SAID_AGAIN: Time = 2 * SECOND;

/// Places to which a target is to go once it has walked its way.
#[derive(Default)]
pub(super) struct Orders {
    stops: RefCell<Vec<Point2<f64>>>,
    waiting: RefCell<Option<Waker>>,
}

impl Orders {
    /// Leads it on to these places.
    pub(super) fn give(&self, stops: impl IntoIterator<Item = Point2<f64>>) {
        self.stops.borrow_mut().extend(stops);
        if let Some(waker) = self.waiting.borrow_mut().take() {
            waker.wake();
        }
    }

    /// The next places. There may never be any.
    async fn taken(&self) -> Vec<Point2<f64>> {
        poll_fn(|context| {
            let stops = self.stops.take();
            if !stops.is_empty() {
                return Poll::Ready(stops);
            }
            *self.waiting.borrow_mut() = Some(context.waker().clone());
            Poll::Pending
        })
        .await
    }
}

/// The walk of one target.
pub(super) struct Walk {
    walker: Walker,
    sensor: StepSensor,
    clock: Clock,
    world: SharedWorld,
    index: usize,
    node: Rc<Node>,
    medium: Medium,
    antenna_at: Point2<f64>,
    /// The PC of its network.
    console: Console,
    orders: Rc<Orders>,
    journal: SharedJournal,
    /// The way in which places of the file are told to the target.
    told_as: ToldAs,
    /// The stop of which it told the place last, and the time.
    told: Option<(usize, Time)>,
    /// The lamp went out since it arrived.
    was_dark: bool,
}

/// A place of the file in the frame of a network.
pub(super) type ToldAs = Box<dyn Fn(Point2<f64>) -> Option<SitePlace>>;

impl Walk {
    pub(super) fn new(
        simulation: &Simulation,
        target: &TargetNode,
        node: &Rc<Node>,
        (console, told_as): (Console, ToldAs),
        orders: Rc<Orders>,
        root: Root,
    ) -> Self {
        let id = target.id.into();
        let walker = Walker::new(target.gait, target.stops.clone(), root.stream("walk", id));
        let sensor = StepSensor::new(target.errors, target.axis, root.stream("sensor", id));
        Self {
            walker,
            sensor,
            clock: simulation.executor.clock(),
            world: simulation.world.clone(),
            index: target.index,
            node: node.clone(),
            medium: simulation.medium.clone(),
            antenna_at: Point2::origin(),
            console,
            orders,
            journal: simulation.journal.clone(),
            told_as,
            told: None,
            was_dark: false,
        }
    }

    fn move_there(&mut self) {
        let place = self.walker.place();
        let mut world = self.world.borrow_mut();
        world.move_target(self.index, place);
        world.raise_target(self.index, self.walker.above());
        drop(world);
        // Every move costs the renewal of all its links.
        let moved = (place - self.antenna_at).norm();
        let stands = self.walker.standing_at().is_some();
        if moved >= ANTENNA_MOVES || stands && moved > 0.0 {
            self.antenna_at = place;
            self.medium
                .move_to(self.node.antenna, super::antenna(place));
        }
    }

    /// Has the PC told the stop where it stands, if the PC shows that the target's steps are not known. Returns when
    /// to look again.
    fn tell_place(&mut self, now: Time) -> Option<Time> {
        let (stop, mark) = self.walker.standing_at().zip(self.walker.mark())?;
        let view = self.console.view();
        let member = view.member(self.node.id());
        let asks = member.filter(|target| target.health.steps.is_some());
        if asks.is_none() && !self.node.has_no_sensor() {
            return None;
        }
        let is_due = |(told, at): (usize, Time)| told != stop || now >= at + SAID_AGAIN;
        if let Some(target) = asks
            && self.told.is_none_or(is_due)
            && let Some(place) = (self.told_as)(mark)
        {
            let address = target.address;
            self.told = Some((stop, now));
            let located = TargetLocation::of_place(place);
            self.console.say(FromPc::Located { address, located });
        }
        Some(now + SAID_AGAIN)
    }

    pub(super) async fn run(mut self) {
        self.move_there();
        let place = self.walker.place();
        self.journal.borrow_mut().arrived(self.node.id(), place);
        // A target is switched on when all cameras have shown up on the coordinator's list.
        let limit = self.clock.sleep(SET_UP_LIMIT);
        select(self.console.roll_call().completed(), limit).await;
        self.node.switch_on();
        loop {
            self.walk().await;
            {
                let mut journal = self.journal.borrow_mut();
                journal.stops_ended += 1;
                journal.walked += 1;
            }
            let stops = self.orders.taken().await;
            self.walker.go_on(stops, self.clock.time());
            // The target goes on from the last of them.
            let mut journal = self.journal.borrow_mut();
            journal.stops_ended -= 1;
            journal.walked -= 1;
        }
    }

    /// Walks to the last of its stops.
    async fn walk(&mut self) {
        let mut events = Vec::new();
        loop {
            let now = self.clock.time();
            let lamp = self.node.panel.shown.get().may_walk;
            self.was_dark |= !lamp;
            // Without steps the target shows the lamp of its last stop until it is told of this one.
            let lamp = lamp && (self.was_dark || !self.node.has_no_sensor());
            if self.walker.is_done() {
                if lamp {
                    break;
                }
                let asks_again = self.tell_place(now);
                let patience = asks_again.unwrap_or(now + 60 * SECOND);
                let patience = self.clock.sleep_until_time(patience);
                let ended = select(self.node.panel.changed.wait(), patience).await;
                if let (Either::Second(()), None) = (ended, asks_again) {
                    break;
                }
                continue;
            }
            self.walker.set_mood(self.node.mood(), now);
            self.walker.may_walk(lamp, now);
            self.walker.advance(now, &mut events);
            for (_, event) in events.drain(..) {
                match event {
                    Event::Step(stride) => {
                        self.node.step(self.sensor.measure(&stride));
                    }
                    Event::Left { .. } => self.journal.borrow_mut().left(self.node.id()),
                    Event::Arrived { .. } => {
                        self.was_dark = false;
                        let place = self.walker.place();
                        self.journal.borrow_mut().arrived(self.node.id(), place);
                    }
                }
            }
            self.move_there();
            let asks_again = self.tell_place(now);
            let next = self.walker.next_at();
            match next.into_iter().chain(asks_again).min() {
                Some(at) => {
                    let next = self.clock.sleep_until_time(at);
                    select(self.node.panel.changed.wait(), next).await;
                }
                None if self.walker.is_done() => continue,
                None => self.node.panel.changed.wait().await,
            }
        }
    }
}
