//! Parts that a board or a simulation gives a node: [`Hardware`] names the drivers, [`Peripherals`] holds
//! them.
//!
//! Steps, lamps and buttons are traits of this module; the other traits are those that drivers have
//! anyway.

use core::{
    future::{Future, pending},
    ops::Range,
};

use calib_core::dead_reckoning::Step;
use embedded_io_async::{Read, Write};
use embedded_storage_async::nor_flash::NorFlash;
use serde::{Deserialize, Serialize};
use zigbee_link::{radio::Radio, runner::Clock, wire::ShortAddress};

use crate::{facts::Fact, message::Message, steps::SensorError};

/// The drivers that a node runs on. Implemented by a type that stands for the board; it needs no value.
pub trait Hardware {
    /// The line to a camera's CMUcam2, or to a coordinator's PC; unused by a target. Reads must be
    /// cancel-safe.
    type Uart: Read + Write;
    /// The radio for frames of IEEE 802.15.4, on the chip or on a co-processor.
    type Radio: Radio;
    /// Time since any one moment, and waiting for a time.
    type Clock: Clock;
    /// The flash for facts that the node must not forget.
    type Flash: NorFlash;
    /// A target's step sensor; `()` for none.
    type Steps: StepSensor;
    /// Lamps; `()` for none.
    type Indicator: Indicator;
    /// Buttons; `()` for none.
    type Buttons: Buttons;
    /// The observer; `()` for none.
    type Observer: Observer;
}

/// The drivers of a [`Hardware`], and values that differ from board to board and from start to start.
pub struct Peripherals<H: Hardware> {
    /// See [`Hardware::Uart`].
    pub uart: H::Uart,
    /// As it starts: not yet configured.
    pub radio: H::Radio,
    /// The time since the start.
    pub clock: H::Clock,
    /// The flash of `layout`.
    pub flash: H::Flash,
    /// Use of the parts of the flash.
    pub layout: FlashLayout,
    /// A target's step sensor.
    pub steps: H::Steps,
    /// Dark so far.
    pub indicator: H::Indicator,
    /// See [`Button`] for the request of each.
    pub buttons: H::Buttons,
    /// Called in the middle of the node's work: it must not wait.
    pub observer: H::Observer,
    /// Random, another one at each start. A node that remembers nothing draws its extended address from it,
    /// so a value that comes twice may repeat nonces: on a board, 64 bits of a true random number generator.
    pub seed: u64,
}

/// Parts of a flash, bytes from its start. Each is an even number of erase units, aligned.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FlashLayout {
    /// For the radio link: two pages are enough.
    pub link: Range<u32>,
    /// For the role: [`BYTES`](crate::facts::BYTES).
    pub facts: Range<u32>,
}

/// The sensor that tells a target its movements.
pub trait StepSensor {
    /// The next step; `None` when the sensor works again after it failed. While the target stands there is none.
    /// Cancel-safe.
    ///
    /// # Errors
    /// The sensor failed. The target's place is lost then.
    fn next(&mut self) -> impl Future<Output = Result<Option<Step<f32>>, SensorError>>;
}

impl<S: StepSensor> StepSensor for &mut S {
    fn next(&mut self) -> impl Future<Output = Result<Option<Step<f32>>, SensorError>> {
        S::next(self)
    }
}

/// No step sensor: coordinators and cameras do not walk.
impl StepSensor for () {
    async fn next(&mut self) -> Result<Option<Step<f32>>, SensorError> {
        pending().await
    }
}

/// Lamps, or another display of the state for people.
pub trait Indicator {
    /// Shows this from now on.
    fn show(&mut self, indication: Indication);
}

/// No lamps.
impl Indicator for () {
    fn show(&mut self, _: Indication) {}
}

/// State to show to people.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Indication {
    /// The node belongs to a network.
    pub joined: bool,
    /// A camera saw the target at the last stop; a target was seen at it.
    pub target_seen: bool,
    /// A camera is [calibrated](calib_core::Status::Calibrated); for a coordinator, one or more are; a target
    /// knows its place.
    pub calibrated: bool,
    /// A target may walk on: all cameras have looked.
    pub may_walk: bool,
}

/// An observer of a node that takes no part: a simulation, a debugger. `()` does not look.
pub trait Observer {
    /// The node hands a message to its link.
    fn sends(&mut self, _to: ShortAddress, _message: &Message) {}

    /// The node writes something down.
    fn learns(&mut self, _fact: &Fact) {}
}

impl Observer for () {}

/// Buttons that people press.
pub trait Buttons {
    /// The next press. Cancel-safe.
    fn pressed(&mut self) -> impl Future<Output = Button>;
}

/// No buttons.
impl Buttons for () {
    async fn pressed(&mut self) -> Button {
        pending().await
    }
}

/// Request of a button.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Button {
    /// Coordinator: let new devices join for a while.
    JoinWindow,
    /// Camera: learn the colour of the object in the middle of the view.
    LearnColour,
}
