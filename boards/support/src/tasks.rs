//! The tasks of a board.

use embassy_executor::{SpawnError, SpawnToken, Spawner};
use embassy_time::{Duration, Timer};
use node_firmware::config::{Config, Role, SensorConfig, page::PageError};

use crate::last_words::LastWords;

/// Spawns a task that is spawned once, so that there is room for it.
pub fn spawn<S>(spawner: Spawner, task: Result<SpawnToken<S>, SpawnError>) {
    match task {
        Ok(task) => spawner.spawn(task),
        Err(_) => defmt::error!("a task was spawned twice"),
    }
}

/// Tells why the board started, and what was said before that.
pub fn tell_start(cause: &str, before: &LastWords) {
    defmt::info!("started: {=str}", cause);
    if let Some(words) = before.text() {
        defmt::error!("before that: {=str}", words);
    }
}

/// Of a target its own; of others, who have no sensor, any.
pub const fn sensor_config(config: &Config) -> &SensorConfig {
    match &config.role {
        Role::Target(target) => &target.sensor,
        Role::Coordinator(_) | Role::Camera(_) => &SensorConfig::UNCALIBRATED,
    }
}

/// Without a configuration there is nothing to do, and a restart would not help.
pub async fn stop(error: PageError) -> ! {
    loop {
        defmt::error!("no configuration: {}", error);
        Timer::after(Duration::from_secs(10)).await;
    }
}
