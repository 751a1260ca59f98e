//! RNG: random bytes.

use rigless::time::EventId;

use super::{Call, Model, US};

const SHORTS: u16 = 0x200;
const CONFIG: u16 = 0x504;
const VALUE: u16 = 0x508;
/// Product Specification, "RNG": of a byte, without and with the correction of bias.
const BYTE: [u64; 2] = [30 * US, 120 * US];
/// "RNG", `t_RNG,START`.
const START: u64 = 128 * US;

/// The same bytes from the same seed.
#[derive(Debug)]
pub struct Rng {
    state: u64,
    next: Option<EventId>,
}

/// The first half of `SplitMix64` (Steele, Lea and Flood, 2014), whose upper bits are random.
pub(super) fn draw(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let word = (*state ^ *state >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (word ^ word >> 27).wrapping_mul(0x94d0_49bb_1331_11eb)
}

impl Rng {
    /// Bytes of this seed.
    pub fn new(seed: u64) -> Self {
        Self {
            state: seed,
            next: None,
        }
    }

    fn byte(&mut self) -> u8 {
        (draw(&mut self.state) >> 56) as u8
    }

    fn plan(&mut self, begin: u64, call: &mut Call<'_, '_>) {
        let time = BYTE[(call.get(CONFIG) & 1) as usize];
        self.next = Some(call.after(begin + time));
    }
}

impl Model for Rng {
    fn task(&mut self, number: u16, call: &mut Call<'_, '_>) {
        match number {
            0 if self.next.is_none() => self.plan(START, call),
            1 => self.next = None,
            _ => {}
        }
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        if self.next == Some(id) {
            let byte = self.byte();
            call.set(VALUE, byte.into());
            self.plan(0, call);
            call.event(0);
        }
    }

    fn shortcut(&mut self, _: u16, call: &mut Call<'_, '_>) {
        if call.get(SHORTS) & 1 != 0 {
            self.next = None;
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
    fn bytes_differ_and_take_time() {
        let mut bench = Bench::new(Rng::new(1));
        bench.set(CONFIG, 1);
        bench.task(0);
        bench.pass(START);
        let mut seen = std::collections::BTreeSet::new();
        for _ in 0..64 {
            bench.pass(120 * US - 1);
            assert!(!bench.took(0));
            bench.pass(1);
            assert!(bench.took(0));
            seen.insert(bench.get(VALUE));
        }
        assert!(seen.len() > 48, "{}", seen.len());
        bench.task(1);
        bench.pass(1_000 * US);
        assert!(!bench.took(0));
    }
}
