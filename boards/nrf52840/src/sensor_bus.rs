//! The I2C bus of the step sensor.
//!
//! The peripheral is switched on for each transaction and off after it, however that ends: one that
//! is given up, because the time is over or nobody waits for it any more, must not go on writing to
//! memory.

use embassy_futures::select::{Either, select};
use embassy_nrf::{
    Peri, bind_interrupts,
    gpio::{Flex, Level, Output, OutputDrive, Pull},
    peripherals,
    twim::{self, Error, Frequency, Twim},
};
use embassy_time::{Duration, Timer, block_for};
use embedded_hal_async::i2c::{ErrorType, I2c, Operation};

bind_interrupts!(struct Irqs {
    TWISPI0 => twim::InterruptHandler<peripherals::TWISPI0>;
});

/// The longest transaction takes 2 ms.
const LIMIT: Duration = Duration::from_millis(20);
/// Half a clock of the release, slow enough for any pull-up.
const HALF_CLOCK: Duration = Duration::from_micros(50);
/// Clocks until any byte and its acknowledgement are over.
const CLOCKS: usize = 9;

/// The bus, with its pins.
pub(crate) struct SensorBus {
    pub(crate) peripheral: Peri<'static, peripherals::TWISPI0>,
    pub(crate) data: Peri<'static, peripherals::P0_26>,
    pub(crate) clock: Peri<'static, peripherals::P0_27>,
    /// The last transaction came to its end. False at first: the chip may have started in the middle
    /// of one.
    pub(crate) idle: bool,
}

impl SensorBus {
    /// Clocks out what a sensor still wants to say, as long as it holds the data line, and ends
    /// whatever was going on (I2C-bus specification UM10204, "Bus clear" and "STOP condition").
    fn release(&mut self) {
        let drive = OutputDrive::Standard0Disconnect1;
        let mut clock = Output::new(self.clock.reborrow(), Level::High, drive);
        let mut data = Flex::new(self.data.reborrow());
        data.set_high();
        data.set_as_input_output(Pull::Up, drive);
        block_for(HALF_CLOCK);
        for _ in 0..CLOCKS {
            if data.is_high() {
                break;
            }
            clock.set_low();
            block_for(HALF_CLOCK);
            clock.set_high();
            block_for(HALF_CLOCK);
        }
        clock.set_low();
        data.set_low();
        block_for(HALF_CLOCK);
        clock.set_high();
        block_for(HALF_CLOCK);
        data.set_high();
        block_for(HALF_CLOCK);
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
        // For what a caller has in flash, which its memory access cannot reach.
        let mut copy = [0; 2];
        let mut twim = Twim::new(
            self.peripheral.reborrow(),
            Irqs,
            self.data.reborrow(),
            self.clock.reborrow(),
            config,
            &mut copy,
        );
        let transaction = twim.transaction(address, operations);
        match select(transaction, Timer::after(LIMIT)).await {
            Either::First(result) => {
                self.idle = result.is_ok();
                result
            }
            Either::Second(()) => Err(Error::Timeout),
        }
    }
}
