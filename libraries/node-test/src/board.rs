//! The hardware of a node.

use std::{
    cell::{Cell, RefCell},
    future::{Future, pending},
    pin::Pin,
    rc::Rc,
};

use calib_core::dead_reckoning::Step;
use embassy_sync::{blocking_mutex::raw::NoopRawMutex, channel::Channel};
use embedded_io_async::{ErrorType, Read, Write};
use node_firmware::{
    config::Config,
    facts,
    hardware::{
        self, FlashLayout, Hardware, Indication, Indicator, Observer, Peripherals, StepSensor,
        Updates,
    },
    liveness::Liveness,
    message::{Message, Restart, Sight},
    run::{Devices, run},
    steps::SensorError,
};
use rand_chacha::ChaCha8Rng;
use virtual_hardware::{
    executor::Clock,
    flash::Flash,
    line::{Line, Port, PortError, Side},
    medium::{NRF52840, NodeId, Radio},
    worn::{Faults, Worn},
};
use zigbee_link::{radio::Csma, wire::ShortAddress};

use crate::{Bench, Pc};

/// Bytes that a board's flash erases at once: so few that its logs are often full.
pub const PAGE: usize = 256;

/// End of the link's part of the flash, which begins at 0.
pub const LINK: u32 = 32 * PAGE as u32;

/// End of the role's part, which follows.
pub const FACTS: u32 = LINK + facts::BYTES;

/// The flash of a board, whose operations take no time.
pub type FlashOfBoard = Flash<PAGE>;

/// A node's end of its line. The device at the other end may take nothing.
pub struct NodeUart {
    port: Port,
    is_stalled: Rc<Cell<bool>>,
    rests: Rc<Cell<bool>>,
}

impl NodeUart {
    /// Switches it on. Bytes that came while it was off were not heard.
    fn wake(&mut self) {
        if self.rests.replace(false) {
            self.port.received();
        }
    }
}

impl hardware::Line for NodeUart {
    fn rest(&mut self) {
        self.rests.set(true);
    }
}

impl ErrorType for NodeUart {
    type Error = PortError;
}

impl Write for NodeUart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, PortError> {
        if self.is_stalled.get() {
            pending::<()>().await;
        }
        self.wake();
        self.port.write(bytes).await
    }

    async fn flush(&mut self) -> Result<(), PortError> {
        self.port.flush().await
    }
}

impl Read for NodeUart {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, PortError> {
        self.wake();
        self.port.read(buffer).await
    }
}

/// Steps that wait for the node, at most.
const STEPS: usize = 16;

/// A step sensor that tells what a test says.
#[derive(Clone)]
pub struct Steps(Rc<Channel<NoopRawMutex, Step<f32>, STEPS>>);

impl StepSensor for Steps {
    async fn next(&mut self) -> Result<Option<Step<f32>>, SensorError> {
        Ok(Some(self.0.receive().await))
    }
}

/// Lamps that a test looks at.
#[derive(Clone, Default)]
pub struct Lamps(pub Rc<Cell<Indication>>);

impl Indicator for Lamps {
    fn show(&mut self, indication: Indication) {
        self.0.set(indication);
    }
}

/// Messages that a node has handed to its link, oldest first.
#[derive(Clone, Default)]
pub struct Sent(pub Rc<RefCell<Vec<Message>>>);

impl Observer for Sent {
    fn sends(&mut self, _: ShortAddress, message: &Message) {
        self.0.borrow_mut().push(message.clone());
    }
}

/// A node without its firmware: what outlasts its starts. [`Bench::switch_on`] lets the firmware run on it.
pub struct Board {
    /// Its page: a change counts from the next start.
    pub config: Config,
    pub(crate) antenna: NodeId,
    /// To its camera or PC.
    pub line: Line,
    /// The device on its line takes nothing.
    pub is_stalled: Rc<Cell<bool>>,
    /// Its own end of the line is switched off.
    pub rests: Rc<Cell<bool>>,
    /// Its flash: [`LINK`] bytes for the link, and the rest up to [`FACTS`] for the role.
    pub flash: FlashOfBoard,
    /// Wear of its flash.
    pub faults: Faults,
    /// Its own view of its health since the last start.
    pub liveness: Rc<RefCell<Rc<Liveness>>>,
    /// Its step sensor, with steps on their way.
    pub steps: Steps,
    /// Its lamps.
    pub lamps: Lamps,
    /// Messages that it has sent.
    pub sent: Sent,
    /// Parts of its flash for updates by radio; none by default.
    pub updates: Option<Updates>,
}

impl Hardware for Board {
    type Uart = NodeUart;
    type Radio = Csma<Radio, Clock>;
    type Clock = Clock;
    type Flash = Worn<PAGE>;
    type Steps = Steps;
    type Indicator = Lamps;
    type Buttons = ();
    type Observer = Sent;
}

impl Board {
    pub(crate) fn new(config: Config, antenna: NodeId, line: Line, random: ChaCha8Rng) -> Self {
        Self {
            config,
            antenna,
            line,
            is_stalled: Rc::default(),
            rests: Rc::default(),
            flash: Flash::without_time(FACTS as usize / PAGE, random),
            faults: Faults::default(),
            liveness: Rc::new(RefCell::new(Rc::new(Liveness::new(Restart::Ordinary)))),
            steps: Steps(Rc::new(Channel::new())),
            lamps: Lamps::default(),
            sent: Sent::default(),
            updates: None,
        }
    }

    /// Its place on the air.
    pub fn antenna(&self) -> NodeId {
        self.antenna
    }

    fn uart(&self) -> NodeUart {
        self.rests.set(false);
        NodeUart {
            port: self.line.open(Side::Node),
            is_stalled: self.is_stalled.clone(),
            rests: self.rests.clone(),
        }
    }

    /// All but radio and flash, for [`run_over`](node_firmware::run::run_over) and a network of another kind.
    pub fn devices<'a>(
        &self,
        clock: &'a Clock,
        liveness: &'a Liveness,
        seed: u64,
    ) -> Devices<'a, Self> {
        Devices {
            uart: self.uart(),
            clock,
            steps: self.steps.clone(),
            indicator: self.lamps.clone(),
            buttons: (),
            observer: self.sent.clone(),
            seed,
            liveness,
        }
    }

    /// The firmware from its start, with the present contents of the flash. It ends with the reason why it cannot go
    /// on.
    ///
    /// # Panics
    /// The configuration is refused.
    pub fn firmware(&self, bench: &Bench, seed: u64) -> Pin<Box<dyn Future<Output = String>>> {
        let clock = bench.clock.clone();
        let radio = bench.medium.radio(self.antenna, NRF52840);
        let peripherals = Peripherals::<Self> {
            uart: self.uart(),
            radio: Csma::new(radio, clock.clone(), seed),
            clock,
            flash: Worn::new(self.flash.clone(), self.faults.clone()),
            layout: FlashLayout {
                link: 0..LINK,
                facts: LINK..FACTS,
            },
            steps: self.steps.clone(),
            indicator: self.lamps.clone(),
            buttons: (),
            observer: self.sent.clone(),
            seed,
            update: self.updates.clone(),
        };
        let config = self.config.clone().check();
        let config = config.unwrap_or_else(|error| panic!("node {}: {error}", self.config.id));
        let liveness = Rc::new(Liveness::new(Restart::Ordinary));
        self.liveness.replace(liveness.clone());
        Box::pin(async move { run(&config, peripherals, &liveness).await.to_string() })
    }

    /// The PC at the far end of a coordinator's line. One at a time.
    pub fn pc(&self) -> Pc {
        Pc::new(self.line.open(Side::Far))
    }

    /// State of its lamps.
    pub fn lamps(&self) -> Indication {
        self.lamps.0.get()
    }

    /// Its answers to stops, oldest first.
    pub fn looks(&self) -> Vec<Sight> {
        let sent = self.sent.0.borrow();
        let looks = sent.iter().filter_map(|message| match message {
            Message::Look(look) => Some(look.sight),
            _ => None,
        });
        looks.collect()
    }

    /// Its carrier goes so far, in that direction (radians), and the step sensor tells it to 1 cm and 0.01 rad.
    ///
    /// # Panics
    /// More steps wait than a sensor keeps.
    pub fn step(&self, distance: f32, heading: f32) {
        let step = Step {
            distance,
            heading,
            distance_sigma: 0.01,
            heading_sigma: 0.01,
        };
        let taken = self.steps.0.try_send(step);
        assert!(taken.is_ok(), "{STEPS} steps wait already");
    }
}
