//! Virtual time, and the tasks that live in it.
//!
//! Tasks are futures, polled on one thread in the order in which they were woken. Time stands
//! still while a task is ready, then jumps to the next event. Nothing depends on the wall clock,
//! on addresses or on hash order: the same tasks give the same run.
//!
//! A task that is [killed](Executor::kill) is dropped where it waits, as a processor that loses its power. Things
//! that outlast that (flash, antenna, line) are not in the task.

mod clock;
mod pace;
mod timers;

use std::{
    cell::{Cell, RefCell},
    collections::VecDeque,
    future::Future,
    pin::Pin,
    rc::{Rc, Weak},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    task::{Context, Wake, Waker},
};

use slab::Slab;

pub use clock::{Clock, Sleep};
pub use pace::times_real_time;
pub use timers::{EventId, Handler};

use clock::Timing;
use timers::Action;

/// Nanoseconds since the start of the simulation.
pub type Time = u64;

/// Polls per task within one instant from which on it counts as a loop without end.
const STUCK: u64 = 10_000;

type Boxed = Pin<Box<dyn Future<Output = ()>>>;

/// A task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TaskId {
    slot: usize,
    /// Number among all tasks that there ever were: a place serves many.
    number: u64,
}

/// Reason why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub enum Ended {
    /// The time has come.
    TimeUp,
    /// The condition holds.
    ConditionMet,
    /// Tasks wake one another without time passing; this one was polled last.
    Stuck(TaskId),
}

/// Cost of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effort {
    /// Timers and calls that came.
    pub events: u64,
    /// Polls of tasks.
    pub polls: u64,
}

/// Tasks that were woken, in order.
#[derive(Default)]
struct Ready(Mutex<VecDeque<TaskId>>);

impl Ready {
    fn queue(&self) -> MutexGuard<'_, VecDeque<TaskId>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

struct TaskWaker {
    task: TaskId,
    queued: AtomicBool,
    ready: Arc<Ready>,
}

impl Wake for TaskWaker {
    fn wake(self: Arc<Self>) {
        self.wake_by_ref();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        if !self.queued.swap(true, Ordering::Relaxed) {
            self.ready.queue().push_back(self.task);
        }
    }
}

struct Body {
    future: Boxed,
    shared: Arc<TaskWaker>,
    waker: Waker,
}

struct Task {
    id: TaskId,
    /// Absent while it is polled.
    body: Option<Body>,
}

#[derive(Default)]
struct Tasks {
    all: RefCell<Slab<Task>>,
    ready: Arc<Ready>,
    spawned: Cell<u64>,
}

impl Tasks {
    fn spawn(&self, future: Boxed) -> TaskId {
        let mut all = self.all.borrow_mut();
        let place = all.vacant_entry();
        let id = TaskId {
            slot: place.key(),
            number: self.spawned.replace(self.spawned.get() + 1),
        };
        let shared = Arc::new(TaskWaker {
            task: id,
            queued: AtomicBool::new(false),
            ready: self.ready.clone(),
        });
        shared.wake_by_ref();
        let body = Body {
            future,
            waker: shared.clone().into(),
            shared,
        };
        let body = Some(body);
        place.insert(Task { id, body });
        id
    }

    /// Does something to a task, while it is alive.
    fn with<T>(&self, id: TaskId, act: impl FnOnce(&mut Task) -> T) -> Option<T> {
        let mut all = self.all.borrow_mut();
        all.get_mut(id.slot).filter(|task| task.id == id).map(act)
    }

    fn is_alive(&self, id: TaskId) -> bool {
        self.with(id, |_| ()).is_some()
    }

    fn kill(&self, id: TaskId) {
        if self.is_alive(id) {
            let task = self.all.borrow_mut().remove(id.slot);
            // The future's drop may spawn and kill.
            drop(task);
        }
    }

    /// Polls a task. Returns true if there was something to poll.
    fn poll(&self, id: TaskId) -> bool {
        let Some(mut body) = self.with(id, |task| task.body.take()).flatten() else {
            return false;
        };
        body.shared.queued.store(false, Ordering::Relaxed);
        let mut context = Context::from_waker(&body.waker);
        if body.future.as_mut().poll(&mut context).is_ready() {
            drop(body);
            self.kill(id);
            return true;
        }
        // One that killed itself is dropped here.
        let mut body = Some(body);
        self.with(id, |task| task.body = body.take());
        true
    }
}

/// Spawns and kills tasks from within tasks.
#[derive(Clone)]
pub struct Spawner(Weak<Tasks>);

impl Spawner {
    /// Starts a task. `None` when the executor is gone.
    pub fn spawn(&self, future: impl Future<Output = ()> + 'static) -> Option<TaskId> {
        Some(self.0.upgrade()?.spawn(Box::pin(future)))
    }

    /// Drops a task where it waits. One that kills itself ends at its next await.
    pub fn kill(&self, task: TaskId) {
        if let Some(tasks) = self.0.upgrade() {
            tasks.kill(task);
        }
    }

    /// Returns true if a task has neither ended nor been killed.
    pub fn is_alive(&self, task: TaskId) -> bool {
        self.0.upgrade().is_some_and(|tasks| tasks.is_alive(task))
    }
}

/// Something that has its own course in the same virtual time, such as another program. Before time
/// passes, it goes ahead: tasks do nothing meanwhile.
pub trait Outside {
    /// Goes on until a time, or until it does something that concerns tasks. Returns the time of that: not before
    /// the time now, and `until` if it is nothing, or later.
    fn run_until(&mut self, until: Time) -> Time;

    /// Its next event happens now. Returns true if there was any.
    fn happens(&mut self) -> bool;
}

/// Runs tasks in virtual time. See the [module](self).
///
/// # Example
/// ```
/// use virtual_hardware::executor::{Ended, Executor};
///
/// let mut executor = Executor::new();
/// let clock = executor.clock();
/// executor.spawn(async move { clock.sleep(3_600_000_000_000).await });
/// assert_eq!(executor.run_until(7_200_000_000_000), Ended::TimeUp);
/// assert_eq!(executor.tasks(), 0);
/// ```
pub struct Executor {
    tasks: Rc<Tasks>,
    clock: Clock,
    effort: Effort,
    pace: Option<Box<dyn FnMut(Time)>>,
    outside: Option<Box<dyn Outside>>,
    batch: VecDeque<TaskId>,
}

impl Default for Executor {
    fn default() -> Self {
        Self::new()
    }
}

impl Executor {
    /// Without tasks, at time 0.
    pub fn new() -> Self {
        Self {
            tasks: Rc::new(Tasks::default()),
            clock: Clock::new(Rc::new(Timing::default())),
            effort: Effort::default(),
            pace: None,
            outside: None,
            batch: VecDeque::new(),
        }
    }

    /// The time.
    pub fn clock(&self) -> Clock {
        self.clock.clone()
    }

    /// For tasks that spawn tasks.
    pub fn spawner(&self) -> Spawner {
        Spawner(Rc::downgrade(&self.tasks))
    }

    /// Starts a task: it is polled when the executor runs.
    pub fn spawn(&mut self, future: impl Future<Output = ()> + 'static) -> TaskId {
        self.tasks.spawn(Box::pin(future))
    }

    /// Drops a task where it waits.
    pub fn kill(&mut self, task: TaskId) {
        self.tasks.kill(task);
    }

    /// Returns true if a task has neither ended nor been killed.
    pub fn is_alive(&self, task: TaskId) -> bool {
        self.tasks.is_alive(task)
    }

    /// Number of tasks.
    pub fn tasks(&self) -> usize {
        self.tasks.all.borrow().len()
    }

    /// Returns the cost so far.
    pub fn effort(&self) -> Effort {
        self.effort
    }

    /// Is called with the time of the next event before time jumps there, and may wait. Without
    /// one, time passes as fast as it can. See [`times_real_time`].
    pub fn set_pace(&mut self, pace: impl FnMut(Time) + 'static) {
        self.pace = Some(Box::new(pace));
    }

    /// Time passes here as it does there.
    pub fn set_outside(&mut self, outside: impl Outside + 'static) {
        self.outside = Some(Box::new(outside));
    }

    /// Runs until a time, which is the time afterwards.
    pub fn run_until(&mut self, end: Time) -> Ended {
        self.run_until_time_or(end, || false)
    }

    /// Runs until a time or, if that is earlier, until a condition holds. It is asked in each
    /// instant when nothing is ready any more.
    pub fn run_until_time_or(&mut self, end: Time, mut condition: impl FnMut() -> bool) -> Ended {
        loop {
            if let Some(task) = self.settle() {
                return Ended::Stuck(task);
            }
            if condition() {
                return Ended::ConditionMet;
            }
            let next = self.clock.timing.timers.borrow_mut().next_at();
            let is_due = next.is_some_and(|at| at <= end);
            let planned = if is_due { next.unwrap_or(end) } else { end };
            let at = match &mut self.outside {
                Some(outside) => outside.run_until(planned).min(planned),
                None => planned,
            };
            if at > self.clock.time() {
                if let Some(pace) = &mut self.pace {
                    pace(at);
                }
                self.clock.timing.now.set(at);
            }
            let happened = self.outside.as_mut().is_some_and(|it| it.happens());
            if happened || at < planned {
                continue;
            }
            if !is_due {
                return Ended::TimeUp;
            }
            let event = self.clock.timing.timers.borrow_mut().pop();
            self.effort.events += 1;
            match event {
                Some(Action::Wake(waker)) => waker.wake(),
                Some(Action::Call(handler, token)) => {
                    if let Some(handler) = handler.upgrade() {
                        handler.event(token);
                    }
                }
                None => {}
            }
        }
    }

    /// Polls until nothing is ready, or returns the task that was polled last.
    fn settle(&mut self) -> Option<TaskId> {
        let limit = STUCK * (self.tasks() as u64 + 1);
        let mut polls = 0;
        loop {
            std::mem::swap(&mut self.batch, &mut *self.tasks.ready.queue());
            if self.batch.is_empty() {
                self.effort.polls += polls;
                return None;
            }
            while let Some(task) = self.batch.pop_front() {
                polls += u64::from(self.tasks.poll(task));
                if polls > limit {
                    self.effort.polls += polls;
                    return Some(task);
                }
            }
        }
    }
}
