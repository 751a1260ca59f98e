//! The I2C bus of the step sensor.
//!
//! A transaction keeps the program waiting: the longest one takes 2 ms, in which the UARTs go on.

use board_support::i2c::release;
use embassy_stm32::{
    Peri,
    gpio::{Flex, Pull, Speed},
    i2c::{Config, Error, I2c as Peripheral},
    peripherals,
    time::Hertz,
};
use embassy_time::Duration;
use embedded_hal_async::i2c::{ErrorType, I2c, Operation};

const LIMIT: Duration = Duration::from_millis(20);

/// The bus, with its pins.
pub(crate) struct SensorBus {
    pub(crate) peripheral: Peri<'static, peripherals::I2C1>,
    pub(crate) data: Peri<'static, peripherals::PB9>,
    pub(crate) clock: Peri<'static, peripherals::PB8>,
    /// The last transaction came to its end. False at first: the chip may have started in the middle
    /// of one.
    pub(crate) idle: bool,
}

impl SensorBus {
    fn release(&mut self) {
        let mut clock = Flex::new(self.clock.reborrow());
        let mut data = Flex::new(self.data.reborrow());
        for pin in [&mut clock, &mut data] {
            pin.set_high();
            pin.set_as_input_output_pull(Speed::Low, Pull::Up);
        }
        release(&mut clock, &mut data);
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
        let mut config = Config::default();
        config.frequency = Hertz::khz(250);
        config.sda_pullup = true;
        config.scl_pullup = true;
        config.timeout = LIMIT;
        let mut bus = Peripheral::new_blocking(
            self.peripheral.reborrow(),
            self.clock.reborrow(),
            self.data.reborrow(),
            config,
        );
        let result = bus.blocking_transaction(address, operations);
        self.idle = result.is_ok();
        result
    }
}
