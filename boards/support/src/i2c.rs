//! A bus that a sensor holds.

use embassy_time::{Duration, block_for};
use embedded_hal::digital::{InputPin, OutputPin};

/// Half a clock of the release, slow enough for any pull-up.
const HALF_CLOCK: Duration = Duration::from_micros(50);
/// Clocks until any byte and its acknowledgement are over.
const CLOCKS: usize = 9;

/// Clocks out the bits that a sensor still wants to say, as long as it holds the data line. Then the clock stays
/// high: another one might make the sensor say its next bit, and hold the line again. A start and a stop end any
/// transfer under way (I2C-bus specification UM10204, "Bus clear", "START and STOP conditions").
///
/// Both pins are open drains, and high. The pins of a chip never fail.
pub fn release(clock: &mut impl OutputPin, data: &mut (impl InputPin + OutputPin)) {
    block_for(HALF_CLOCK);
    for _ in 0..CLOCKS {
        if data.is_high().unwrap_or(true) {
            break;
        }
        let _ = clock.set_low();
        block_for(HALF_CLOCK);
        let _ = clock.set_high();
        block_for(HALF_CLOCK);
    }
    let _ = data.set_low();
    block_for(HALF_CLOCK);
    let _ = data.set_high();
    block_for(HALF_CLOCK);
}

#[cfg(test)]
mod tests {
    use core::convert::Infallible;
    use std::{cell::RefCell, rc::Rc, vec::Vec};

    use embedded_hal::digital::ErrorType;

    use super::*;

    /// Bits that a sensor has still to say, the next one last: it says one after each falling clock
    /// until a start or a stop comes.
    struct Bus {
        bits: Vec<bool>,
        clock: bool,
        data: bool,
        stops: usize,
    }

    impl Bus {
        fn is_high(&self) -> bool {
            self.data && self.bits.last().is_none_or(|&bit| bit)
        }
    }

    struct Line(Rc<RefCell<Bus>>, fn(&mut Bus, bool));

    impl ErrorType for Line {
        type Error = Infallible;
    }

    impl OutputPin for Line {
        fn set_low(&mut self) -> Result<(), Infallible> {
            self.1(&mut self.0.borrow_mut(), false);
            Ok(())
        }

        fn set_high(&mut self) -> Result<(), Infallible> {
            self.1(&mut self.0.borrow_mut(), true);
            Ok(())
        }
    }

    impl InputPin for Line {
        fn is_high(&mut self) -> Result<bool, Infallible> {
            Ok(self.0.borrow().is_high())
        }

        fn is_low(&mut self) -> Result<bool, Infallible> {
            self.is_high().map(|high| !high)
        }
    }

    fn set_clock(bus: &mut Bus, high: bool) {
        if bus.clock && !high {
            bus.bits.pop();
        }
        bus.clock = high;
    }

    fn set_data(bus: &mut Bus, high: bool) {
        let was = bus.is_high();
        bus.data = high;
        if bus.clock && was != bus.is_high() {
            // A start or a stop.
            bus.bits.clear();
            bus.stops += usize::from(high);
        }
    }

    /// With any rest of a byte in which the node was reset.
    #[test]
    fn a_held_bus_is_clocked_free_and_stopped() {
        for byte in 0..=u8::MAX {
            for left in 0..=8 {
                let bus = Rc::new(RefCell::new(Bus {
                    bits: (0..left).map(|bit| byte >> bit & 1 == 1).collect(),
                    clock: true,
                    data: true,
                    stops: 0,
                }));
                release(
                    &mut Line(bus.clone(), set_clock),
                    &mut Line(bus.clone(), set_data),
                );
                let bus = bus.borrow();
                assert!(bus.is_high() && bus.clock, "{byte:08b}, {left} bits left");
                assert_eq!((bus.stops, bus.bits.len()), (1, 0));
            }
        }
    }
}
