//! Parts that a board or a simulation gives a node: [`Peripherals`] holds the drivers, [`Hardware`] names their types.
//!
//! Steps, lamps and buttons are traits of this module; the other traits are those that drivers have anyway. Every node
//! needs a radio, a clock and a flash ([`Peripherals::new`]). Which of the rest it needs is a matter of its role, and
//! what is not given is not there:
//!
//! | role | uses |
//! |---|---|
//! | camera | UART to the camera; lamps and buttons, if there are any |
//! | coordinator | UART to a PC, lamps and buttons, if there are any |
//! | target | step sensor; lamps, if there are any |

use core::{
    convert::Infallible,
    future::{Future, pending},
    marker::PhantomData,
    ops::Range,
    pin::Pin,
    task::{Context, Poll},
};

use calib_core::dead_reckoning::Step;
use embedded_io_async::{ErrorType, Read, Write};
use embedded_storage_async::nor_flash::NorFlash;
use serde::{Deserialize, Serialize};
use zigbee_link::wire::ShortAddress;
pub use zigbee_link::{
    radio::Radio,
    runner::{Clock, Delay},
};

use crate::{facts::Fact, message::Message, steps::SensorError};

/// A future whose value is there already. [`core::future::ready`] has a branch to a panic.
#[derive(Debug)]
pub struct Done<T>(Option<T>);

impl<T> Done<T> {
    /// With this value.
    pub const fn new(value: T) -> Self {
        Self(Some(value))
    }
}

/// Its value is not pinned.
impl<T> Unpin for Done<T> {}

impl<T> Future for Done<T> {
    type Output = T;

    fn poll(mut self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<T> {
        self.0.take().map_or(Poll::Pending, Poll::Ready)
    }
}

/// The types of the drivers that a node runs on, as one name. [`Parts`] is it for any drivers; a board whose tasks have
/// to name the type of their [`Peripherals`] implements it for a type that stands for the board and needs no value.
pub trait Hardware {
    /// The line to a camera, or to a coordinator's PC; [`NoUart`] for none, as of a target.
    type Uart: Line;
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

/// The drivers of a node, and values that differ from board to board and from start to start.
///
/// A board of one's own gives what its node uses; the rest is not there. Its target, with lamps:
///
/// ```
/// use node_firmware::{
///     config::CheckedConfig,
///     embedded_storage_async::nor_flash::NorFlash,
///     facts,
///     hardware::{Clock, FlashLayout, Indicator, Peripherals, Radio, StepSensor},
///     liveness::Liveness,
///     run::run,
/// };
///
/// async fn target(
///     config: &CheckedConfig,
///     radio: impl Radio,
///     clock: impl Clock,
///     flash: impl NorFlash,
///     steps: impl StepSensor,
///     lamps: impl Indicator,
///     random: u64,
///     liveness: &Liveness,
/// ) {
///     // The flash has pages of 4 KiB.
///     let layout = FlashLayout {
///         link: 0..8192,
///         facts: 8192..8192 + facts::BYTES,
///     };
///     let peripherals = Peripherals::new(radio, clock, flash, layout, random)
///         .with_steps(steps)
///         .with_indicator(lamps);
///     // Only when the radio or the flash fails for good. Then the board restarts.
///     let _reason = run(config, peripherals, liveness).await;
/// }
/// ```
///
/// Fields are public so that a board can also write it down as a whole: then a seam more, if one ever comes, is
/// something that it must decide on.
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
    /// The link's waiting times and a target's first stop number come from it, too; none of these is a secret. A
    /// radio that draws waiting times itself ([`Csma`](zigbee_link::radio::Csma)) takes another number.
    pub seed: u64,
    /// Updates by radio, where the board has a boot loader that changes images, and the feature `update` is on.
    pub update: Option<Updates>,
}

/// The [`Hardware`] of any drivers: [`Peripherals::new`] and its like make it, and nothing needs to name it.
#[allow(clippy::type_complexity, reason = "a parameter for each driver")]
pub struct Parts<R, C, F, U = NoUart, S = (), I = (), B = (), O = ()>(
    PhantomData<(R, C, F, U, S, I, B, O)>,
);

impl<R, C, F, U, S, I, B, O> Hardware for Parts<R, C, F, U, S, I, B, O>
where
    R: Radio,
    C: Clock,
    F: NorFlash,
    U: Line,
    S: StepSensor,
    I: Indicator,
    B: Buttons,
    O: Observer,
{
    type Uart = U;
    type Radio = R;
    type Clock = C;
    type Flash = F;
    type Steps = S;
    type Indicator = I;
    type Buttons = B;
    type Observer = O;
}

impl<R: Radio, C: Clock, F: NorFlash> Peripherals<Parts<R, C, F>> {
    /// The drivers that every node needs, and nothing else. See the fields for each.
    pub fn new(radio: R, clock: C, flash: F, layout: FlashLayout, seed: u64) -> Self {
        Self {
            uart: NoUart,
            radio,
            clock,
            flash,
            layout,
            steps: (),
            indicator: (),
            buttons: (),
            observer: (),
            seed,
            update: None,
        }
    }
}

/// A method that replaces one driver, and with it the type of the whole.
macro_rules! replace {
    ($(#[$doc:meta])+ $method:ident($field:ident: $($bound:ident)+) -> $parts:ty, keeps $($kept:ident)+) => {
        $(#[$doc])+
        pub fn $method<New: $($bound +)+>(self, $field: New) -> Peripherals<$parts> {
            let Self { radio, clock, flash, layout, seed, update, $($kept,)+ .. } = self;
            Peripherals { radio, clock, flash, layout, seed, update, $($kept,)+ $field }
        }
    };
}

impl<R, C, F, U, S, I, B, O> Peripherals<Parts<R, C, F, U, S, I, B, O>>
where
    R: Radio,
    C: Clock,
    F: NorFlash,
    U: Line,
    S: StepSensor,
    I: Indicator,
    B: Buttons,
    O: Observer,
{
    replace! {
        /// The same with a line to a camera or a PC, see [`Hardware::Uart`].
        with_uart(uart: Line) -> Parts<R, C, F, New, S, I, B, O>, keeps steps indicator buttons observer
    }
    replace! {
        /// The same with a target's step sensor.
        with_steps(steps: StepSensor) -> Parts<R, C, F, U, New, I, B, O>, keeps uart indicator buttons observer
    }
    replace! {
        /// The same with lamps.
        with_indicator(indicator: Indicator) -> Parts<R, C, F, U, S, New, B, O>, keeps uart steps buttons observer
    }
    replace! {
        /// The same with buttons.
        with_buttons(buttons: Buttons) -> Parts<R, C, F, U, S, I, New, O>, keeps uart steps indicator observer
    }
    replace! {
        /// The same with an observer.
        with_observer(observer: Observer) -> Parts<R, C, F, U, S, I, B, New>, keeps uart steps indicator buttons
    }
}

impl<H: Hardware> Peripherals<H> {
    /// The same with updates by radio.
    #[must_use]
    pub fn with_updates(mut self, updates: Updates) -> Self {
        self.update = Some(updates);
        self
    }
}

/// A line to a camera or a PC. Reads must be cancel-safe.
pub trait Line: Read + Write {
    /// Switches off what waits for bytes, until the next read or write: the node sleeps, and what is at the other end
    /// sleeps as well, or is silent unless it is asked. Bytes that come until then may be lost. By default all stays on.
    fn rest(&mut self) {}
}

/// No line: a target has none, nor needs a coordinator one that no PC is ever connected to. Nothing is heard on it, and
/// what is written is lost.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoUart;

impl Line for NoUart {}

impl ErrorType for NoUart {
    type Error = Infallible;
}

impl Read for NoUart {
    async fn read(&mut self, _: &mut [u8]) -> Result<usize, Infallible> {
        pending().await
    }
}

impl Write for NoUart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// Parts of a flash, bytes from its start. Each is an even number of erase units, aligned.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FlashLayout {
    /// For the radio link: two pages are enough.
    pub link: Range<u32>,
    /// For the role: [`BYTES`](crate::facts::BYTES).
    pub facts: Range<u32>,
}

/// Parts of a flash for updates by radio, and the image that runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Updates {
    /// State of the boot loader.
    pub state: Range<u32>,
    /// Header of an image that is taken: one erase unit.
    pub header: Range<u32>,
    /// Place of an image that is taken, one erase unit longer than the place of the one that runs.
    pub spare: Range<u32>,
    /// Number of the board.
    pub board: u32,
    /// Version of the image that runs.
    pub version: u32,
    /// Roles of the image that runs: [`RoleConfig::bit`](crate::config::RoleConfig::bit) of each.
    pub roles: u8,
    /// Public key with which images are checked, if the node was given one.
    pub key: Option<[u8; 32]>,
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
#[non_exhaustive]
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
