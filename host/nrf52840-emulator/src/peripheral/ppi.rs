//! PPI: events of peripherals start tasks of others.

use rigless::soc::Width;

use super::{Call, DONE, EVENTS, Model};

const CHEN: u16 = 0x500;
const CHENSET: u16 = 0x504;
const CHENCLR: u16 = 0x508;
const EVENT_END: u16 = 0x510;
const TASK_END: u16 = 0x514;
const GROUPS: u16 = 0x800;
const FORK: u16 = 0x910;
/// The others are wired once and for all.
const CHANNELS: u16 = 20;

/// Its channels (Product Specification, "PPI"). Of the pre-programmed ones there is none here.
#[derive(Debug)]
pub struct Ppi {
    /// Addresses of the peripherals.
    bases: Vec<(&'static str, u64)>,
}

impl Ppi {
    /// Between peripherals at these addresses.
    pub fn new(bases: Vec<(&'static str, u64)>) -> Self {
        Self { bases }
    }
}

impl Model for Ppi {
    fn task(&mut self, number: u16, call: &mut Call<'_, '_>) {
        let (on, group) = (call.get(CHEN), call.get(GROUPS + 4 * (number / 2)));
        let on = if number.is_multiple_of(2) {
            on | group
        } else {
            on & !group
        };
        call.set(CHEN, on);
    }

    fn write(&mut self, offset: u16, value: u32, call: &mut Call<'_, '_>) {
        let on = call.get(CHEN);
        match offset {
            CHENSET => call.set(CHEN, on | value),
            CHENCLR => call.set(CHEN, on & !value),
            _ => {}
        }
        if call.get(CHEN) >> CHANNELS != 0 {
            call.forbid("CHEN", "a pre-programmed channel: it is not modelled");
        }
    }

    fn read(&mut self, offset: u16, call: &mut Call<'_, '_>) -> Option<u32> {
        matches!(offset, CHENSET | CHENCLR).then(|| call.get(CHEN))
    }

    fn hear(&mut self, instance: &str, event: u16, call: &mut Call<'_, '_>) {
        let on = call.get(CHEN);
        let base = self.bases.iter().find(|(name, _)| *name == instance);
        let Some(&(_, base)) = base.filter(|_| on != 0) else {
            return;
        };
        let event = (base + u64::from(EVENTS + 4 * event)) as u32;
        for channel in (0..CHANNELS).filter(|channel| on >> channel & 1 != 0) {
            if call.get(EVENT_END + 8 * channel) != event {
                continue;
            }
            for task in [
                call.get(TASK_END + 8 * channel),
                call.get(FORK + 4 * channel),
            ] {
                if task != 0 {
                    call.context.write_to(task.into(), Width::W32, 1, DONE);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peripheral::bench::{BASE, Bench};

    #[test]
    fn channels_are_switched_one_by_one_and_in_groups() {
        let mut bench = Bench::new(Ppi::new(vec![("it", BASE)]));
        bench.set(CHENSET, 0b101);
        bench.set(CHENCLR, 0b001);
        assert_eq!(bench.get(CHEN), 0b100);
        bench.set(GROUPS + 4, 0b110);
        bench.task(2);
        assert_eq!(bench.get(CHENSET), 0b110);
        bench.task(3);
        assert_eq!(bench.get(CHENCLR), 0);
        assert_eq!(bench.forbidden(), [""; 0]);
        bench.set(CHENSET, 1 << 27);
        assert_eq!(bench.forbidden(), ["CHEN"]);
    }
}
