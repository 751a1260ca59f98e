//! EGU: events that the program triggers, so that they interrupt or start tasks of others.

use super::{Call, Model};

/// Its channels: task n makes event n (Product Specification, "EGU").
const CHANNELS: u16 = 16;

/// An event generator.
#[derive(Debug, Default)]
pub struct Egu;

impl Model for Egu {
    fn task(&mut self, number: u16, call: &mut Call<'_, '_>) {
        if number < CHANNELS {
            call.event(number);
        } else {
            call.forbid("TASKS", "there are 16 channels (\"EGU\")");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peripheral::{INTENSET, bench::Bench};

    #[test]
    fn each_task_makes_its_event() {
        let mut bench = Bench::new(Egu);
        bench.set(INTENSET, 1 << 15);
        bench.task(0);
        assert!(!bench.chip.model.is_pending());
        bench.task(15);
        assert!(bench.chip.model.is_pending());
        let took: Vec<_> = (0..CHANNELS).filter(|event| bench.took(*event)).collect();
        assert_eq!(took, [0, 15]);
        assert!(!bench.chip.model.is_pending());
        bench.task(16);
        assert_eq!(bench.forbidden(), ["TASKS"]);
    }
}
