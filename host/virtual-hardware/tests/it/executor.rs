//! Virtual time.

use std::{
    cell::{Cell, RefCell},
    future::{pending, poll_fn},
    rc::{Rc, Weak},
    task::Poll,
};

use embassy_futures::{
    join::join,
    select::{Either, select},
    yield_now,
};
use virtual_hardware::executor::{Clock, Ended, Executor, Handler, Outside, Time};
use zigbee_link::{Instant, runner::Clock as _};

use crate::support::{MICROSECOND, MILLISECOND, SECOND};

/// Tasks run in the order in which they were spawned or woken; sleeps end at their time; at equal
/// times the one that was planned first comes first.
#[test]
fn order_and_times() {
    let mut executor = Executor::new();
    let log = Rc::new(RefCell::new(Vec::new()));
    for (name, naps) in [('a', [3, 3]), ('b', [1, 5]), ('c', [2, 4])] {
        let (clock, log) = (executor.clock(), log.clone());
        executor.spawn(async move {
            for nap in naps {
                log.borrow_mut().push((clock.time(), name));
                clock.sleep(nap).await;
            }
            log.borrow_mut().push((clock.time(), name));
        });
    }
    assert_eq!(executor.run_until(100), Ended::TimeUp);
    let expected = [
        (0, 'a'),
        (0, 'b'),
        (0, 'c'),
        (1, 'b'),
        (2, 'c'),
        (3, 'a'),
        (6, 'b'),
        (6, 'c'),
        (6, 'a'),
    ];
    assert_eq!(*log.borrow(), expected);
    assert_eq!((executor.clock().time(), executor.tasks()), (100, 0));
    assert_eq!(executor.effort().events, 6);
}

#[test]
fn timers_that_are_dropped_leave_nothing() {
    let mut executor = Executor::new();
    let clock = executor.clock();
    let rounds = Rc::new(Cell::new(0));
    let count = rounds.clone();
    executor.spawn(async move {
        loop {
            let first = select(clock.sleep(MICROSECOND), clock.sleep(SECOND)).await;
            assert!(matches!(first, Either::First(())));
            count.set(count.get() + 1);
        }
    });
    assert_eq!(executor.run_until(100 * MILLISECOND), Ended::TimeUp);
    assert_eq!(rounds.get(), 100_000);
    assert_eq!(executor.clock().planned(), 2);
    assert_eq!(executor.effort().events, 100_000);
}

struct OnDrop(Rc<Cell<Option<Time>>>, virtual_hardware::executor::Clock);

impl Drop for OnDrop {
    fn drop(&mut self) {
        self.0.set(Some(self.1.time()));
    }
}

/// A killed task is dropped at that moment with its timers; its place serves its successor, and its
/// number does not.
#[test]
fn a_power_cut_and_a_successor() {
    let mut executor = Executor::new();
    let (clock, spawner) = (executor.clock(), executor.spawner());
    let dropped = Rc::new(Cell::new(None));
    let guard = OnDrop(dropped.clone(), clock.clone());
    let sleeper = clock.clone();
    let victim = executor.spawn(async move {
        sleeper.sleep(SECOND).await;
        drop(guard);
    });
    let successor = Rc::new(Cell::new(None));
    let (handle, started) = (successor.clone(), clock.clone());
    executor.spawn(async move {
        clock.sleep(5 * MILLISECOND).await;
        spawner.kill(victim);
        assert!(!spawner.is_alive(victim));
        clock.sleep(5 * MILLISECOND).await;
        let task = spawner.spawn(async move {
            assert_eq!(started.time(), 10 * MILLISECOND);
            pending::<()>().await;
        });
        handle.set(task);
    });
    assert_eq!(executor.run_until(20 * MILLISECOND), Ended::TimeUp);
    assert_eq!(dropped.get(), Some(5 * MILLISECOND));
    let successor = successor.get().unwrap();
    assert!(executor.is_alive(successor) && successor != victim);
    executor.kill(victim);
    assert_eq!((executor.tasks(), executor.clock().planned()), (1, 0));
}

#[test]
fn a_task_may_kill_itself() {
    let mut executor = Executor::new();
    let spawner = executor.spawner();
    let own = Rc::new(Cell::new(None));
    let name = own.clone();
    let task = executor.spawn(async move {
        if let Some(task) = name.get() {
            spawner.kill(task);
        }
        yield_now().await;
        unreachable!("it has been killed");
    });
    own.set(Some(task));
    assert_eq!(executor.run_until(1), Ended::TimeUp);
    assert_eq!(executor.tasks(), 0);
}

#[test]
fn a_loop_without_end_is_noticed() {
    let mut executor = Executor::new();
    let busy = executor.spawn(poll_fn(|context| {
        context.waker().wake_by_ref();
        Poll::Pending
    }));
    assert_eq!(executor.run_until(SECOND), Ended::Stuck(busy));
}

#[test]
fn a_run_may_end_with_a_condition() {
    let mut executor = Executor::new();
    let (clock, reached) = (executor.clock(), Rc::new(Cell::new(false)));
    let flag = reached.clone();
    executor.spawn(async move {
        clock.sleep(7).await;
        flag.set(true);
        clock.sleep(7).await;
    });
    let ended = executor.run_until_time_or(100, || reached.get());
    assert_eq!((ended, executor.clock().time()), (Ended::ConditionMet, 7));
    assert_eq!(executor.run_until(100), Ended::TimeUp);
}

/// By hand: a clock that is 100 ppm fast shows one second after 1 s / 1.0001.
#[test]
fn drifting_clocks() {
    let mut executor = Executor::new();
    let clock = executor.clock();
    let fast = clock.drifting(100_000);
    executor.spawn(async move {
        fast.sleep_until(Instant(1_000_000)).await;
        assert_eq!(clock.time(), 999_900_010);
        assert_eq!(fast.now(), Instant(1_000_000));
        let same = clock.drifting(0);
        same.sleep_until(Instant(1_000_000)).await;
        assert_eq!(clock.time(), SECOND);
    });
    assert_eq!(executor.run_until(2 * SECOND), Ended::TimeUp);
    assert_eq!(executor.tasks(), 0);
}

struct Bell(RefCell<Vec<u64>>);

impl Handler for Bell {
    fn event(&self, token: u64) {
        self.0.borrow_mut().push(token);
    }
}

#[test]
fn handlers_are_called_unless_cancelled_or_gone() {
    let mut executor = Executor::new();
    let clock = executor.clock();
    let bell = Rc::new(Bell(RefCell::default()));
    let weak: Weak<Bell> = Rc::downgrade(&bell);
    let plan = |at, token| clock.call_at(at, weak.clone(), token);
    plan(30, 3);
    let cancelled = plan(20, 2);
    plan(10, 1);
    plan(50, 5);
    clock.cancel(cancelled);
    assert_eq!(executor.run_until(40), Ended::TimeUp);
    clock.cancel(cancelled);
    assert_eq!(*bell.0.borrow(), [1, 3]);
    drop(bell);
    assert_eq!(executor.run_until(60), Ended::TimeUp);
}

#[test]
fn the_pace_is_told_every_step() {
    let mut executor = Executor::new();
    let clock = executor.clock();
    let steps = Rc::new(RefCell::new(Vec::new()));
    let list = steps.clone();
    executor.set_pace(move |at| list.borrow_mut().push(at));
    executor.spawn(async move {
        join(clock.sleep(4), clock.sleep(4)).await;
        clock.sleep(3).await;
    });
    assert_eq!(executor.run_until(9), Ended::TimeUp);
    assert_eq!(*steps.borrow(), [4, 7, 9]);
}

/// Something that happens every 30 ns, and looks 45 ns ahead.
struct Ticks {
    clock: Clock,
    ahead: Time,
    next: Time,
    log: Rc<RefCell<Vec<(Time, char)>>>,
    asked: Rc<Cell<u32>>,
}

impl Outside for Ticks {
    fn run_until(&mut self, until: Time) -> Time {
        if self.ahead < until {
            self.asked.set(self.asked.get() + 1);
            self.ahead = until.min(self.ahead + 45);
        }
        if self.next <= until { self.next } else { until }
    }

    fn happens(&mut self) -> bool {
        let is_due = self.next <= self.clock.time();
        if is_due {
            self.log.borrow_mut().push((self.clock.time(), 'o'));
            self.next += 30;
        }
        is_due
    }
}

/// Events outside come at their time, before those planned here for that time.
#[test]
fn the_outside_keeps_the_time() {
    let mut executor = Executor::new();
    let (log, asked) = (Rc::default(), Rc::new(Cell::new(0)));
    let (clock, list) = (executor.clock(), Rc::clone(&log));
    executor.set_outside(Ticks {
        clock: clock.clone(),
        ahead: 0,
        next: 30,
        log: Rc::clone(&log),
        asked: asked.clone(),
    });
    executor.spawn(async move {
        for _ in 0..5 {
            clock.sleep(20).await;
            list.borrow_mut().push((clock.time(), 't'));
        }
    });
    assert_eq!(executor.run_until(100), Ended::TimeUp);
    let expected = [
        (20, 't'),
        (30, 'o'),
        (40, 't'),
        (60, 'o'),
        (60, 't'),
        (80, 't'),
        (90, 'o'),
        (100, 't'),
    ];
    assert_eq!(*log.borrow(), expected);
    assert_eq!(executor.clock().time(), 100);
    assert!(asked.get() >= 3);
}
