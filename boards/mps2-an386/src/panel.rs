//! Steps, lamps and buttons, on a line.

use core::convert::Infallible;

use board_support::panel::{Deframer, FRAME_MAX, FromNode, PERIOD_MS, ToNode, frame};
use calib_core::dead_reckoning::Step;
use embassy_sync::{
    blocking_mutex::raw::CriticalSectionRawMutex, channel::Channel, signal::Signal,
};
use embassy_time::{Duration, with_timeout};
use embedded_io_async::{Read as _, Write as _};
use node_firmware::hardware::{Button, Buttons, Indication, Indicator, StepSensor};

use crate::uart::Uart;

/// Steps that wait. When a node does not ask for them the line waits too.
const STEPS: usize = 8;
const PRESSES: usize = 4;
/// Lamps that do not change are told again after this.
const AGAIN: Duration = Duration::from_millis(PERIOD_MS as u64);

static STEPPED: Channel<CriticalSectionRawMutex, Step<f32>, STEPS> = Channel::new();
static PRESSED: Channel<CriticalSectionRawMutex, Button, PRESSES> = Channel::new();
/// Only the latest counts.
static SHOWN: Signal<CriticalSectionRawMutex, Indication> = Signal::new();

/// Takes messages from the line.
#[embassy_executor::task]
pub(crate) async fn listen(mut line: Uart) {
    let mut deframer = Deframer::new();
    let mut bytes = [0; 32];
    loop {
        let Ok(len) = line.read(&mut bytes).await;
        for &byte in bytes.iter().take(len) {
            match deframer.push(byte) {
                None => {}
                Some(ToNode::Step(step)) => STEPPED.send(step).await,
                // A button that nobody looks at.
                Some(ToNode::JoinWindow) => {
                    let _ = PRESSED.try_send(Button::JoinWindow);
                }
                Some(ToNode::LearnColour) => {
                    let _ = PRESSED.try_send(Button::LearnColour);
                }
            }
        }
    }
}

/// Puts lamps on the line: when they change, and again before anybody thinks that the board stalls.
#[embassy_executor::task]
pub(crate) async fn tell(mut line: Uart) {
    let mut buffer = [0; FRAME_MAX];
    let mut lamps = FromNode::from(Indication::default());
    loop {
        if let Ok(changed) = with_timeout(AGAIN, SHOWN.wait()).await {
            lamps = changed.into();
        }
        let Ok(()) = line.write_all(frame(&lamps, &mut buffer)).await;
    }
}

/// Steps from the line.
pub(crate) struct Steps;

impl StepSensor for Steps {
    type Error = Infallible;

    async fn next(&mut self) -> Result<Step<f32>, Infallible> {
        Ok(STEPPED.receive().await)
    }
}

/// Lamps on the line.
pub(crate) struct Lamps;

impl Indicator for Lamps {
    fn show(&mut self, indication: Indication) {
        SHOWN.signal(indication);
    }
}

/// Buttons on the line.
pub(crate) struct PushButtons;

impl Buttons for PushButtons {
    async fn pressed(&mut self) -> Button {
        PRESSED.receive().await
    }
}
