//! The time, for firmware and for the machinery.

use std::{
    cell::{Cell, RefCell},
    future::Future,
    pin::Pin,
    rc::{Rc, Weak},
    task::{Context, Poll},
};

use embedded_hal_async::delay::DelayNs;
use zigbee_link::Instant;

use super::{
    EventId, Handler, Time,
    timers::{Action, Timers},
};

const MICROSECOND: Time = 1_000;
const BILLION: u128 = 1_000_000_000;

/// The time now, and the planned events.
#[derive(Default)]
pub(super) struct Timing {
    pub(super) now: Cell<Time>,
    pub(super) timers: RefCell<Timers>,
}

/// A handle to the virtual time.
///
/// Firmware sees it as [`zigbee_link::runner::Clock`], in microseconds, and as [`DelayNs`], both
/// with the drift of this handle; everything else here is in true nanoseconds.
#[derive(Clone)]
pub struct Clock {
    pub(super) timing: Rc<Timing>,
    /// Error of the clock, 1e-9, positive if it is fast.
    drift_ppb: i32,
}

impl Clock {
    pub(super) fn new(timing: Rc<Timing>) -> Self {
        Self {
            timing,
            drift_ppb: 0,
        }
    }

    /// The clock of a node whose oscillator is so many billionths too fast.
    #[must_use]
    pub fn drifting(&self, ppb: i32) -> Self {
        Self {
            timing: self.timing.clone(),
            drift_ppb: ppb,
        }
    }

    /// Nanoseconds since the start.
    pub fn time(&self) -> Time {
        self.timing.now.get()
    }

    /// Returns at that time; at once if it has passed. Dropped before, it leaves nothing behind.
    pub fn sleep_until_time(&self, at: Time) -> Sleep {
        Sleep {
            timing: self.timing.clone(),
            at,
            planned: None,
        }
    }

    /// Returns after so many nanoseconds.
    pub fn sleep(&self, duration: Time) -> Sleep {
        self.sleep_until_time(self.time().saturating_add(duration))
    }

    /// Calls a handler at a time, as soon as possible if it has passed. A handler that is gone by
    /// then is not called.
    pub fn call_at(&self, at: Time, handler: Weak<dyn Handler>, token: u64) -> EventId {
        let at = at.max(self.time());
        let action = Action::Call(handler, token);
        self.timing.timers.borrow_mut().insert(at, action)
    }

    /// Takes an event off the plan, if it has not happened.
    pub fn cancel(&self, event: EventId) {
        let action = self.timing.timers.borrow_mut().remove(event);
        drop(action);
    }

    /// Number of planned events.
    pub fn planned(&self) -> usize {
        self.timing.timers.borrow().len()
    }

    fn local(&self, time: Time) -> u64 {
        if self.drift_ppb == 0 {
            return time / MICROSECOND;
        }
        let rate = BILLION.saturating_add_signed(self.drift_ppb.into());
        (u128::from(time) * rate / (BILLION * u128::from(MICROSECOND))) as u64
    }

    /// The first nanosecond at which this clock shows that time.
    fn truth(&self, local: u64) -> Time {
        if self.drift_ppb == 0 {
            return local.saturating_mul(MICROSECOND);
        }
        let rate = BILLION.saturating_add_signed(self.drift_ppb.into());
        let time = (u128::from(local) * BILLION * u128::from(MICROSECOND)).div_ceil(rate);
        time.try_into().unwrap_or(Time::MAX)
    }
}

impl zigbee_link::runner::Clock for Clock {
    fn now(&self) -> Instant {
        Instant(self.local(self.time()))
    }

    fn sleep_until(&self, time: Instant) -> impl Future<Output = ()> {
        self.sleep_until_time(self.truth(time.0))
    }
}

impl DelayNs for Clock {
    async fn delay_ns(&mut self, ns: u32) {
        let ns = Time::from(ns);
        let drift = ns as i64 * i64::from(self.drift_ppb) / BILLION as i64;
        self.sleep(ns.saturating_add_signed(-drift)).await;
    }
}

/// Waits for a time.
#[must_use = "a sleep does nothing until it is awaited"]
pub struct Sleep {
    timing: Rc<Timing>,
    at: Time,
    planned: Option<EventId>,
}

impl Future for Sleep {
    type Output = ();

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<()> {
        if self.timing.now.get() >= self.at {
            return Poll::Ready(());
        }
        let mut timers = self.timing.timers.borrow_mut();
        match self.planned {
            Some(id) => timers.rewire(id, context.waker()),
            None => {
                let id = timers.insert(self.at, Action::Wake(context.waker().clone()));
                drop(timers);
                self.planned = Some(id);
            }
        }
        Poll::Pending
    }
}

impl Drop for Sleep {
    fn drop(&mut self) {
        if let Some(id) = self.planned {
            let action = self.timing.timers.borrow_mut().remove(id);
            drop(action);
        }
    }
}
