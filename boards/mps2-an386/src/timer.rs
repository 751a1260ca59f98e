//! The time for `embassy-time`, in microseconds, from two CMSDK timers (ARM DDI 0479).
//!
//! Timer 0 counts down for ever, 32 bits at 25 MHz; its interrupt, every 172 s, counts the upper
//! bits. Timer 1 is the alarm.

use core::{
    cell::{Cell, RefCell},
    task::Waker,
};

use critical_section::{CriticalSection, Mutex};
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;

use crate::register::{TIMER0, TIMER1};

const CTRL: u16 = 0x00;
const VALUE: u16 = 0x04;
const RELOAD: u16 = 0x08;
/// Reads whether the interrupt is due; writing 1 takes it back.
const INTERRUPT: u16 = 0x0c;

const ENABLE: u32 = 1;
const WITH_INTERRUPT: u32 = 1 << 3;

/// ARM application note 386: the system clock.
const TICKS_PER_MICROSECOND: u64 = 25;

struct Timers {
    /// How often timer 0 has begun anew.
    carries: Mutex<Cell<u32>>,
    queue: Mutex<RefCell<Queue>>,
}

embassy_time_driver::time_driver_impl!(static TIMERS: Timers = Timers {
    carries: Mutex::new(Cell::new(0)),
    queue: Mutex::new(RefCell::new(Queue::new())),
});

/// Starts the time.
pub(crate) fn start() {
    TIMER0.write(RELOAD, u32::MAX);
    TIMER0.write(VALUE, u32::MAX);
    TIMER0.write(CTRL, ENABLE | WITH_INTERRUPT);
}

/// Interrupt of timer 0.
pub(crate) extern "C" fn carry() {
    critical_section::with(|cs| TIMERS.count_carry(cs));
}

/// Interrupt of timer 1.
pub(crate) extern "C" fn alarm() {
    TIMER1.write(CTRL, 0);
    TIMER1.write(INTERRUPT, 1);
    critical_section::with(|cs| TIMERS.set_alarm(cs));
}

impl Timers {
    fn count_carry(&self, cs: CriticalSection<'_>) {
        if TIMER0.read(INTERRUPT) & 1 != 0 {
            TIMER0.write(INTERRUPT, 1);
            let carries = self.carries.borrow(cs);
            carries.set(carries.get().wrapping_add(1));
        }
    }

    fn ticks(&self, cs: CriticalSection<'_>) -> u64 {
        // A carry between the two readings shows in the second look, and the value is read again.
        self.count_carry(cs);
        let mut value = TIMER0.read(VALUE);
        let before = self.carries.borrow(cs).get();
        self.count_carry(cs);
        let carries = self.carries.borrow(cs).get();
        if carries != before {
            value = TIMER0.read(VALUE);
        }
        u64::from(carries) << 32 | u64::from(u32::MAX - value)
    }

    fn microseconds(&self, cs: CriticalSection<'_>) -> u64 {
        self.ticks(cs) / TICKS_PER_MICROSECOND
    }

    /// Wakes what is due, and sets the alarm for what comes next.
    fn set_alarm(&self, cs: CriticalSection<'_>) {
        let Ok(mut queue) = self.queue.borrow(cs).try_borrow_mut() else {
            return; // never: nothing below comes back here
        };
        let now = self.microseconds(cs);
        let next = queue.next_expiration(now);
        if next == u64::MAX {
            return TIMER1.write(CTRL, 0);
        }
        // Farther than the timer goes: it then looks again. Not before the time, so one more.
        let ticks = (next - now).saturating_mul(TICKS_PER_MICROSECOND);
        let ticks = u32::try_from(ticks).unwrap_or(u32::MAX).saturating_add(1);
        TIMER1.write(CTRL, 0);
        TIMER1.write(INTERRUPT, 1);
        TIMER1.write(RELOAD, ticks);
        TIMER1.write(VALUE, ticks);
        TIMER1.write(CTRL, ENABLE | WITH_INTERRUPT);
    }
}

impl Driver for Timers {
    fn now(&self) -> u64 {
        critical_section::with(|cs| self.microseconds(cs))
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|cs| {
            let queue = self.queue.borrow(cs).try_borrow_mut();
            if queue.is_ok_and(|mut queue| queue.schedule_wake(at, waker)) {
                self.set_alarm(cs);
            }
        });
    }
}
