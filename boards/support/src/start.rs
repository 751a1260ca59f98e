//! The start of a board on which a node runs, and the node's task.

use embassy_time::{Duration, Timer};
use embedded_hal_async::i2c::I2c;
use embedded_storage::nor_flash::ReadNorFlash;
use node_firmware::{
    config::{CheckedConfig, ConfigError, page::PageError},
    run::Failure,
    steps::InertialSteps,
};
use static_cell::StaticCell;

use crate::{
    clock::EmbassyClock, failure::describe, flash::Regions, last_words::LastWords,
    memory::read_config, retained,
};

/// Tells why the board started, and what was said before that; then what the node is told to be, and
/// the step sensor on a bus, if there is one. Once.
///
/// # Errors
/// There is no configuration: [`stop`].
pub fn begin<F: ReadNorFlash, B: I2c>(
    cause: &str,
    (flash, regions): (&mut F, &Regions),
    bus: B,
) -> Result<(&'static CheckedConfig, InertialSteps<B, EmbassyClock>), PageError> {
    static CONFIG: StaticCell<CheckedConfig> = StaticCell::new();
    tell_start(cause, &retained::take());
    let config: &CheckedConfig = CONFIG.init(read_config(flash, regions.config)?);
    // The sensor may know more of its settings than the check of configurations.
    let steps = InertialSteps::new(bus, EmbassyClock, config.sensor());
    let steps = steps.map_err(|_| PageError::Value(ConfigError::Sensor))?;
    Ok((config, steps))
}

fn tell_start(cause: &str, before: &LastWords) {
    defmt::info!("started: {=str}", cause);
    if let Some(words) = before.text() {
        defmt::error!("before that: {=str}", words);
    }
}

/// Without a configuration there is nothing to do, and a restart would not help.
pub async fn stop(error: PageError) -> ! {
    loop {
        defmt::error!("no configuration: {}", error);
        Timer::after(Duration::from_secs(10)).await;
    }
}

/// Tells why the node cannot go on. Nothing reports any more then: the watchdog restarts it.
pub fn tell_failure<R, F>(failure: &Failure<R, F>) {
    defmt::error!("stopped: {=str}", describe(failure));
}
