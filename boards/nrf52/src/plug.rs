//! The USB plug of the chip: a serial port of a coordinator's PC (USB CDC 1.2, "Abstract Control Model").

use board_facts::Board as Facts;
use board_support::{lost::Lost, tasks::spawn};
use embassy_executor::Spawner;
use embassy_nrf::{
    Peri, bind_interrupts,
    pac::FICR,
    peripherals,
    usb::{
        self, Driver,
        vbus_detect::{self, HardwareVbusDetect},
    },
};
use embassy_time::{Duration, with_timeout};
use embassy_usb::{
    Builder, Config, UsbDevice,
    class::cdc_acm::{BufferedReceiver, CdcAcmClass, Sender, State},
};
use embedded_io_async::{ErrorType, Read, Write};
use node_firmware::{
    config::{CheckedConfig, RoleConfig},
    hardware,
};
use static_cell::StaticCell;

use crate::{
    guarded::Guarded,
    line::{Line, Uart},
};

bind_interrupts!(struct Irqs {
    USBD => usb::InterruptHandler<peripherals::USBD>;
    CLOCK_POWER => vbus_detect::InterruptHandler;
});

type Usb = Guarded<Driver<'static, HardwareVbusDetect>>;
/// The device, which answers to the PC.
type Device = UsbDevice<'static, Usb>;

/// The pair that Objective Development shares with all CDC ACM devices, which are told apart by their names
/// (`USB-IDs-for-free.txt`). Who sells boards needs one of their own.
const VENDOR: u16 = 0x16c0;
/// See [`VENDOR`].
const PRODUCT: u16 = 0x05e1;
const MANUFACTURER: &str = "Self-calibrating cameras";

/// Bytes of the longest packet of a full-speed bulk endpoint (USB 2.0, 5.8.3).
const PACKET: u16 = 64;
/// A shorter packet ends a transfer, so that the PC sees its bytes at once.
const SENT: usize = PACKET as usize - 1;
/// A PC that takes no packet for so long does not read.
const PATIENCE: Duration = Duration::from_millis(200);

/// Longest answer to a question of the PC: a name, of which each character takes two bytes, behind two more.
const CONTROL: usize = 128;
/// Characters of the longest name.
const NAME: usize = CONTROL / 2 - 2;

/// Memory of the device.
struct Memory {
    configuration: [u8; 128],
    objects: [u8; 32],
    vendor: [u8; 0],
    control: [u8; CONTROL],
    packet: [u8; PACKET as usize],
    serial: [u8; 16],
    state: State<'static>,
}

/// The chip's own number, as hexadecimal digits: the PC knows a board by it.
fn serial(digits: &'static mut [u8; 16]) -> &'static str {
    let [high, low] = [FICR.deviceid(0).read(), FICR.deviceid(1).read()].map(u64::from);
    let mut number = high << 32 | low;
    for digit in digits.iter_mut() {
        number = number.rotate_left(4);
        *digit = match (number & 0xf) as u8 {
            nibble @ 0..=9 => b'0' + nibble,
            nibble => b'a' + nibble - 10,
        };
    }
    core::str::from_utf8(digits).unwrap_or_default()
}

/// The serial port at the plug. Bytes are lost while no program on the PC has it open, or reads it.
pub struct Plug {
    receiver: BufferedReceiver<'static, Usb>,
    sender: Sender<'static, Usb>,
    /// The PC did not take the last packet.
    is_stuck: bool,
}

/// The line of a node: the plug for a coordinator, wires for the others.
pub(crate) fn open(
    spawner: Spawner,
    node: &CheckedConfig,
    (usb, board): (Peri<'static, peripherals::USBD>, &'static Facts),
    wires: Line,
) -> Port {
    let is_coordinator = matches!(node.settings().role, RoleConfig::Coordinator(_));
    if !(cfg!(feature = "coordinator") && is_coordinator) {
        return Port::Wires(wires.open(node));
    }
    let (plug, device) = Plug::new(usb, board);
    spawn(spawner, run_device(device));
    Port::Plug(plug)
}

/// Answers to the PC.
#[embassy_executor::task]
async fn run_device(mut device: Device) {
    device.run().await;
}

/// The line of a node.
pub enum Port {
    /// The UART.
    Wires(Uart),
    /// The USB plug of the chip.
    Plug(Plug),
}

impl hardware::Line for Port {
    fn rest(&mut self) {
        if let Self::Wires(wires) = self {
            wires.rest();
        }
    }
}

impl ErrorType for Port {
    type Error = Lost;
}

impl Read for Port {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Lost> {
        match self {
            Self::Wires(wires) => wires.read(buffer).await,
            Self::Plug(plug) => plug.read(buffer).await,
        }
    }
}

impl Write for Port {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Lost> {
        match self {
            Self::Wires(wires) => wires.write(bytes).await,
            Self::Plug(plug) => plug.write(bytes).await,
        }
    }

    async fn flush(&mut self) -> Result<(), Lost> {
        match self {
            Self::Wires(wires) => wires.flush().await,
            Self::Plug(plug) => plug.flush().await,
        }
    }
}

impl Plug {
    /// The serial port at the plug, and the device, which has to run.
    fn new(usb: Peri<'static, peripherals::USBD>, board: &'static Facts) -> (Self, Device) {
        static MEMORY: StaticCell<Memory> = StaticCell::new();
        let memory = MEMORY.init_with(|| Memory {
            configuration: [0; 128],
            objects: [0; 32],
            vendor: [],
            control: [0; CONTROL],
            packet: [0; PACKET as usize],
            serial: [0; 16],
            state: State::new(),
        });
        let mut config = Config::new(VENDOR, PRODUCT);
        config.manufacturer = Some(MANUFACTURER);
        // A longer one would be more than the answer has room for.
        config.product = Some(board.title).filter(|title| title.len() <= NAME);
        config.serial_number = Some(serial(&mut memory.serial));
        let driver = Guarded(Driver::new(usb, Irqs, HardwareVbusDetect::new(Irqs)));
        let mut builder = Builder::new(
            driver,
            config,
            &mut memory.configuration,
            &mut memory.objects,
            &mut memory.vendor,
            &mut memory.control,
        );
        let class = CdcAcmClass::new(&mut builder, &mut memory.state, PACKET);
        let (sender, receiver) = class.split();
        let plug = Self {
            receiver: receiver.into_buffered(&mut memory.packet),
            sender,
            is_stuck: false,
        };
        (plug, builder.build())
    }
}

impl ErrorType for Plug {
    type Error = Lost;
}

impl Read for Plug {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Lost> {
        loop {
            match self.receiver.read(buffer).await {
                Ok(count) => return Ok(count),
                // No PC, or not any more.
                Err(_) => self.receiver.wait_connection().await,
            }
        }
    }
}

impl Write for Plug {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Lost> {
        if !self.sender.dtr() {
            return Ok(bytes.len());
        }
        let packet = bytes.get(..SENT).unwrap_or(bytes);
        // One attempt is made in any case: the PC may read again.
        let patience = match self.is_stuck {
            true => Duration::MIN,
            false => PATIENCE,
        };
        let sent = with_timeout(patience, self.sender.write_packet(packet)).await;
        self.is_stuck = sent.is_err();
        Ok(packet.len())
    }

    async fn flush(&mut self) -> Result<(), Lost> {
        Ok(())
    }
}
