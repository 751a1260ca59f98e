//! The driver's time: its own delays, or a clock.

use crate::common;

use std::cell::Cell;

use cmucam2_driver::{Cmucam2, Command, device::Call, session::Policy};
use common::{MockDelay, MockUart, Script};

const HERE: &str = "T 44 60 30 50 58 70 25 90\r";

#[test]
fn packets_are_stamped_with_the_time_of_the_clock_and_that_runs_between_calls() {
    // A clock that others set.
    let clock = Cell::new(0);
    let script = Script::idle().on("TC\r", format!("ACK\r{HERE}{HERE}"));
    let (uart, delay) = script.open();
    let mut camera = Cmucam2::with_clock(
        uart,
        Ticking(delay, &clock),
        || clock.get(),
        Policy::default(),
    );
    camera.stream(Command::TrackColour(None)).wait().unwrap();
    assert_eq!(camera.session().packet_at(), None);
    clock.set(5_000_000);
    assert!(camera.next_tracking().wait().unwrap().is_some());
    assert_eq!(camera.session().packet_at(), Some(5_000_000));
    clock.set(7_000_000);
    assert!(camera.next_tracking().wait().unwrap().is_some());
    assert_eq!(camera.session().packet_at(), Some(7_000_000));
}

/// The delay of the mock, which the clock follows.
struct Ticking<'a>(MockDelay, &'a Cell<u64>);

impl embedded_hal::delay::DelayNs for Ticking<'_> {
    fn delay_ns(&mut self, ns: u32) {
        self.0.delay_ns(ns);
        self.1.set(self.1.get() + u64::from(ns / 1_000));
    }
}

#[test]
fn without_a_clock_the_time_is_that_of_the_delays() {
    let script = Script::idle().on("TC\r", format!("ACK\r{HERE}"));
    let (mut camera, line) = script.camera();
    let call: Call<'_, MockUart, MockDelay, ()> = camera.stream(Command::TrackColour(None));
    call.wait().unwrap();
    camera.next_tracking().wait().unwrap();
    let at = camera.session().packet_at().unwrap();
    assert!(
        at > 0 && at.abs_diff(line.now()) < 1_000,
        "{at} {}",
        line.now()
    );
}
