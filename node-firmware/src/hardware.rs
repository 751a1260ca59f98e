//! The seams of a node that no other crate defines: steps, lamps, buttons.
//!
//! The others are `embedded_io_async::{Read, Write}` (the camera, or the coordinator's console),
//! [`zigbee_link::radio::Radio`], [`zigbee_link::runner::Clock`] and
//! `embedded_storage_async::nor_flash::NorFlash`.

use core::{
    fmt::Debug,
    future::{Future, pending},
};

use calib_core::dead_reckoning::Step;
use zigbee_link::wire::ShortAddress;

use crate::{memory::Fact, message::Message};

/// The sensor that tells a target how it moves.
pub trait StepSensor {
    /// What can go wrong.
    type Error: Debug;

    /// The next step. While the target stands there is none. Cancel-safe.
    ///
    /// # Errors
    /// The sensor failed. The target's place is lost then.
    fn next(&mut self) -> impl Future<Output = Result<Step<f32>, Self::Error>>;
}

impl<S: StepSensor> StepSensor for &mut S {
    type Error = S::Error;

    fn next(&mut self) -> impl Future<Output = Result<Step<f32>, Self::Error>> {
        S::next(self)
    }
}

/// Lamps, or whatever shows people how it goes.
pub trait Indicator {
    /// Shows this from now on.
    fn show(&mut self, indication: Indication);
}

/// No lamps.
impl Indicator for () {
    fn show(&mut self, _: Indication) {}
}

/// What people should know.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Indication {
    /// The node belongs to a network.
    pub joined: bool,
    /// A camera saw the target at the last stop; a target was seen at it.
    pub target_seen: bool,
    /// A camera is [calibrated](calib_core::Status::Calibrated), of a coordinator's one or more; a
    /// target knows its place.
    pub calibrated: bool,
    /// A target may walk on: everybody has looked.
    pub may_walk: bool,
}

/// Somebody who watches a node without taking part: a simulation, a debugger. `()` does not look.
pub trait Observer {
    /// The node hands a message to its link.
    fn sends(&mut self, to: ShortAddress, message: &Message) {
        let _ = (to, message);
    }

    /// The node writes something down.
    fn learns(&mut self, fact: &Fact) {
        let _ = fact;
    }
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

/// What a button asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Button {
    /// Coordinator: let new devices join for a while.
    JoinWindow,
    /// Camera: learn the colour of what is in the middle of the view.
    LearnColour,
}
