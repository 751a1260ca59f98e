//! The start of a board on which a node runs, and the node's task.

use core::pin::pin;

use embassy_time::{Duration, Timer};
use embedded_hal_async::i2c::I2c;
use embedded_storage::nor_flash::ReadNorFlash;
use node_firmware::{
    config::{CheckedConfig, ConfigError, page::PageError},
    hardware::{Hardware, Peripherals},
    run::run,
    steps::InertialSteps,
};
use static_cell::StaticCell;

use crate::{
    clock::EmbassyClock, failure::describe, flash::Regions, last_words::LastWords,
    liveness::Liveness, memory::read_config, retained,
};

/// Tells why the board started, and what was said before that; then what the node is told to be.
/// Without a configuration it never returns: there is nothing to do, and a restart would not help.
pub async fn configuration<F: ReadNorFlash>(
    cause: &str,
    flash: &mut F,
    regions: &Regions,
) -> &'static CheckedConfig {
    static CONFIG: StaticCell<CheckedConfig> = StaticCell::new();
    tell_start(cause, &retained::take());
    match read_config(flash, regions.config) {
        Ok(config) => CONFIG.init(config),
        Err(error) => stop(error).await,
    }
}

fn tell_start(cause: &str, before: &LastWords) {
    defmt::info!("started: {=str}", cause);
    if let Some(words) = before.text() {
        defmt::error!("before that: {=str}", words);
    }
}

async fn stop(error: PageError) -> ! {
    loop {
        defmt::error!("no configuration: {}", error);
        Timer::after(Duration::from_secs(10)).await;
    }
}

/// The step sensor on a bus, if there is one.
pub async fn step_sensor<B: I2c>(bus: B, config: &CheckedConfig) -> InertialSteps<B, EmbassyClock> {
    match InertialSteps::new(bus, EmbassyClock, config.sensor()) {
        Ok(sensor) => sensor,
        // It may know more of its settings than the check of configurations.
        Err(_) => stop(PageError::Value(ConfigError::Sensor)).await,
    }
}

/// Runs the node, and reports that it runs. When it cannot go on nothing reports any more, and the
/// watchdog restarts it.
///
/// The peripherals are not passed by value: the whole future of the node would be copied on the stack
/// with them.
pub async fn run_node<H: Hardware>(
    config: &'static CheckedConfig,
    peripherals: &'static mut Option<Peripherals<H>>,
    (liveness, task): (&'static Liveness, u32),
) {
    let Some(peripherals) = peripherals.take() else {
        return;
    };
    let node = pin!(run(config, peripherals));
    let failure = liveness.watch(task, node).await;
    defmt::error!("stopped: {=str}", describe(&failure));
}
