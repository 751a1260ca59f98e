//! TEMP: the temperature of the chip.

use rigless::time::EventId;

use super::{Call, Model, US};

const TEMP: u16 = 0x508;
const DATARDY: u16 = 0;
/// Product Specification, "TEMP", `t_TEMP`.
const TAKES: u64 = 36 * US;
/// 25 degrees, in quarters of a degree: the temperature of all figures of the specification.
const USUAL: i32 = 100;

/// A thermometer, whose registers hold trim values too, which start-up code copies.
#[derive(Debug)]
pub struct Temp {
    /// Quarters of a degree.
    pub degrees: i32,
    next: Option<EventId>,
}

impl Default for Temp {
    fn default() -> Self {
        Self {
            degrees: USUAL,
            next: None,
        }
    }
}

impl Model for Temp {
    fn task(&mut self, number: u16, call: &mut Call<'_, '_>) {
        self.next = (number == 0).then(|| call.after(TAKES));
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        if self.next.take_if(|next| *next == id).is_some() {
            call.set(TEMP, self.degrees as u32);
            call.event(DATARDY);
        }
    }

    fn reset(&mut self) {
        self.next = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peripheral::bench::Bench;

    #[test]
    fn it_is_told_after_a_while() {
        let mut bench = Bench::new(Temp {
            degrees: -6,
            ..Temp::default()
        });
        bench.task(0);
        bench.pass(TAKES - 1);
        assert!(!bench.took(DATARDY));
        bench.pass(1);
        assert!(bench.took(DATARDY));
        assert_eq!(bench.get(TEMP) as i32, -6);
        // One that is stopped tells nothing.
        bench.task(0);
        bench.task(1);
        bench.pass(2 * TAKES);
        assert!(!bench.took(DATARDY));
    }
}
