//! Lamps and buttons.

use embassy_futures::select::{Either, select};
use embassy_nrf::gpio::{Input, Level, Output};
use embassy_time::{Duration, Timer};
use node_firmware::hardware::{Button, Buttons, Indication, Indicator};

/// Contacts bounce for some milliseconds.
const BOUNCE: Duration = Duration::from_millis(20);

/// Lamps between the supply and their pins.
pub(crate) struct Lamps {
    /// Dark while joining.
    pub(crate) joined: Output<'static>,
    pub(crate) target_seen: Output<'static>,
    pub(crate) calibrated: Output<'static>,
    pub(crate) may_walk: Output<'static>,
}

impl Indicator for Lamps {
    fn show(&mut self, indication: Indication) {
        let set = |lamp: &mut Output<'static>, lit: bool| lamp.set_level(Level::from(!lit));
        set(&mut self.joined, indication.joined);
        set(&mut self.target_seen, indication.target_seen);
        set(&mut self.calibrated, indication.calibrated);
        set(&mut self.may_walk, indication.may_walk);
    }
}

/// Push buttons to ground.
pub(crate) struct PushButtons {
    pub(crate) join_window: Input<'static>,
    pub(crate) learn_colour: Input<'static>,
}

impl Buttons for PushButtons {
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
                Either::First(()) => (Button::JoinWindow, join_window),
                Either::Second(()) => (Button::LearnColour, learn_colour),
            };
            Timer::after(BOUNCE).await;
            if input.is_low() {
                return button;
            }
        }
    }
}
