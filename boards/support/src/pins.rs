//! Lamps and buttons on pins.

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Timer};
use embedded_hal::digital::{InputPin, OutputPin, PinState};
use embedded_hal_async::digital::Wait;
use node_firmware::hardware::{Button, Buttons, Indication, Indicator};

/// Contacts bounce for some milliseconds.
const BOUNCE: Duration = Duration::from_millis(20);

/// Lamps, all wired in the same way.
#[derive(Debug)]
pub struct Lamps<O> {
    /// The level that lights them: low (false) between the supply and their pins, high (true) between their pins and
    /// ground.
    pub lit: bool,
    /// Dark while joining.
    pub joined: O,
    /// See [`Indication::target_seen`].
    pub target_seen: O,
    /// See [`Indication::calibrated`].
    pub calibrated: O,
    /// See [`Indication::may_walk`].
    pub may_walk: O,
}

impl<O: OutputPin> Indicator for Lamps<O> {
    fn show(&mut self, indication: Indication) {
        let lit = self.lit;
        let set = |lamp: &mut O, shines: bool| {
            // A pin of the chip never fails.
            let _ = lamp.set_state(PinState::from(shines == lit));
        };
        set(&mut self.joined, indication.joined);
        set(&mut self.target_seen, indication.target_seen);
        set(&mut self.calibrated, indication.calibrated);
        set(&mut self.may_walk, indication.may_walk);
    }
}

/// Push buttons to ground.
#[derive(Debug)]
pub struct PushButtons<I> {
    /// [`Button::JoinWindow`].
    pub join_window: I,
    /// [`Button::LearnColour`].
    pub learn_colour: I,
}

impl<I: InputPin + Wait> Buttons for PushButtons<I> {
    async fn pressed(&mut self) -> Button {
        loop {
            let Self {
                join_window,
                learn_colour,
            } = self;
            let pressed = select(
                join_window.wait_for_falling_edge(),
                learn_colour.wait_for_falling_edge(),
            );
            let (button, input) = match pressed.await {
                Either::First(_) => (Button::JoinWindow, join_window),
                Either::Second(_) => (Button::LearnColour, learn_colour),
            };
            Timer::after(BOUNCE).await;
            if input.is_low().unwrap_or(false) {
                return button;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use core::convert::Infallible;
    use std::{cell::Cell, rc::Rc};

    use embedded_hal::digital::ErrorType;

    use super::*;

    #[derive(Clone, Default)]
    struct Pin(Rc<Cell<bool>>);

    impl ErrorType for Pin {
        type Error = Infallible;
    }

    impl OutputPin for Pin {
        fn set_low(&mut self) -> Result<(), Infallible> {
            self.0.set(false);
            Ok(())
        }

        fn set_high(&mut self) -> Result<(), Infallible> {
            self.0.set(true);
            Ok(())
        }
    }

    fn each_lamp_shows_its_own(lit: bool) {
        let pins: [Pin; 4] = Default::default();
        let [joined, target_seen, calibrated, may_walk] = pins.clone();
        let mut lamps = Lamps {
            lit,
            joined,
            target_seen,
            calibrated,
            may_walk,
        };
        for number in 0..16 {
            let bit = |bit: u32| number >> bit & 1 != 0;
            let mut shown = Indication::default();
            shown.joined = bit(0);
            shown.target_seen = bit(1);
            shown.calibrated = bit(2);
            shown.may_walk = bit(3);
            lamps.show(shown);
            for (at, pin) in (0..).zip(&pins) {
                assert_eq!(pin.0.get() == lit, bit(at), "{at} of {number}");
            }
        }
    }

    #[test]
    fn to_the_supply_and_to_ground() {
        each_lamp_shows_its_own(false);
        each_lamp_shows_its_own(true);
    }
}
