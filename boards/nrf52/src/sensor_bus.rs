//! The I2C bus of the step sensor.
//!
//! The peripheral is switched on for each transaction and off after it, however that ends: one that is given up,
//! because the time is over or its future is dropped, is stopped first, and must not go on writing to memory.

use board_support::i2c::release;
use embassy_futures::select::{Either, select};
use embassy_nrf::{
    Peri, bind_interrupts,
    gpio::{AnyPin, Flex, OutputDrive, Pull},
    pac, peripherals,
    twim::{self, Error, Frequency, Twim},
};
use embassy_time::{Duration, Instant, Timer};
use embedded_hal_async::i2c::{ErrorType, I2c, Operation};

bind_interrupts!(struct Irqs {
    TWISPI0 => twim::InterruptHandler<peripherals::TWISPI0>;
});

/// The longest transaction takes 2 ms.
const LIMIT: Duration = Duration::from_millis(20);
/// A transfer that is stopped takes its byte and a bit; one whose clock is held low never ends.
const STOP_LIMIT: Duration = Duration::from_millis(1);

/// The bus, with its pins.
pub struct SensorBus {
    pub(crate) peripheral: Peri<'static, peripherals::TWISPI0>,
    pub(crate) data: Peri<'static, AnyPin>,
    pub(crate) clock: Peri<'static, AnyPin>,
    /// The last transaction came to its end. False at first: the chip may have started in the middle
    /// of one.
    pub(crate) idle: bool,
}

impl SensorBus {
    fn release(&mut self) {
        let drive = OutputDrive::Standard0Disconnect1;
        let mut clock = Flex::new(self.clock.reborrow());
        let mut data = Flex::new(self.data.reborrow());
        for line in [&mut clock, &mut data] {
            line.set_high();
            line.set_as_input_output(Pull::Up, drive);
        }
        release(&mut clock, &mut data);
    }
}

/// Before the peripheral is switched off, a transfer under way comes to its end.
struct Ending {
    /// The driver has asked for it already, as it does after an error.
    is_asked_for: bool,
}

impl Drop for Ending {
    fn drop(&mut self) {
        let twim = pac::TWIM0;
        if !self.is_asked_for {
            twim.tasks_stop().write_value(1);
        }
        let until = Instant::now() + STOP_LIMIT;
        while twim.events_stopped().read() == 0 && Instant::now() < until {}
        twim.shorts().write(|_| {});
    }
}

impl ErrorType for SensorBus {
    type Error = Error;
}

impl I2c for SensorBus {
    async fn transaction(
        &mut self,
        address: u8,
        operations: &mut [Operation<'_>],
    ) -> Result<(), Error> {
        if !self.idle {
            self.release();
        }
        self.idle = false;
        let mut config = twim::Config::default();
        // Not 400 kHz, of which the chip makes too short a clock (Errata, 219).
        config.frequency = Frequency::K250;
        config.sda_pullup = true;
        config.scl_pullup = true;
        // For bytes that a caller has in flash, which its memory access cannot reach.
        let mut copy = [0; 2];
        let mut twim = Twim::new(
            self.peripheral.reborrow(),
            Irqs,
            self.data.reborrow(),
            self.clock.reborrow(),
            config,
            &mut copy,
        );
        // Dropped before the driver is, also where the future of the transaction is dropped.
        let mut ending = Ending {
            is_asked_for: false,
        };
        let transaction = twim.transaction(address, operations);
        let result = match select(transaction, Timer::after(LIMIT)).await {
            Either::First(result) => {
                ending.is_asked_for = true;
                result
            }
            Either::Second(()) => Err(Error::Timeout),
        };
        if result.is_ok() {
            // It ended by itself.
            core::mem::forget(ending);
            self.idle = true;
        }
        result
    }
}
