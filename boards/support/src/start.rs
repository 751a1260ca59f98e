//! The start of a board on which a node runs, and the node's task.

use board_facts::{Board, regions::Regions};
use embassy_time::{Duration, Timer};
use embedded_hal_async::i2c::I2c;
use embedded_storage::nor_flash::ReadNorFlash;
use node_firmware::{
    config::{CheckedConfig, ConfigError, page::PageError},
    hardware::FlashLayout,
    liveness::Liveness,
    message::Restart,
    run::Failure,
    steps::InertialSteps,
};
use static_cell::StaticCell;
use zigbee_link::runner::RunnerError;

use crate::{
    clock::EmbassyClock, failure::describe, last_words::LastWords, memory::read_config, retained,
};

/// Parts that [`begin`] makes.
pub type Begun<B> = (
    &'static CheckedConfig,
    InertialSteps<B, EmbassyClock>,
    &'static Liveness,
);

/// The parts of a board's flash that its node writes.
pub const fn layout(board: &Board) -> FlashLayout {
    let Regions { facts, link, .. } = &board.regions;
    FlashLayout {
        facts: facts.start..facts.end,
        link: link.start..link.end,
    }
}

/// The updates of a board whose image has this stamp. `None`: it cannot be updated by radio.
#[cfg(feature = "update")]
pub fn updates<F: ReadNorFlash>(
    flash: &mut F,
    board: &Board,
    stamp: &[u8; radio_update::stamp::STAMP],
) -> Option<node_firmware::hardware::Updates> {
    let parts = board.updated.as_ref()?;
    let stamp = radio_update::stamp::Stamp::read(stamp)?;
    let mut record = [0; radio_update::package::KEY_RECORD];
    let place = board.regions.config.start + board_facts::KEY_BEHIND_CONFIG;
    let read = flash.read(place, &mut record);
    Some(node_firmware::hardware::Updates {
        state: parts.state.clone(),
        header: parts.header.clone(),
        spare: parts.spare.clone(),
        board: stamp.board,
        version: stamp.version,
        roles: stamp.roles,
        key: read
            .ok()
            .and_then(|()| radio_update::package::read_key(&record)),
    })
}

/// Returns true if the image runs on trial: without the node's confirmation the next start goes back to the one before.
#[cfg(feature = "update")]
pub fn is_on_trial<F: ReadNorFlash>(flash: &mut F, board: &Board) -> bool {
    let mut word = [0; 4];
    let state = { board.updated.as_ref() }.map(|parts| parts.state.start);
    state.is_some_and(|at| flash.read(at, &mut word).is_ok())
        && radio_update::receiver::is_on_trial(&word)
}

/// Cause of a start, as the chip tells it.
#[derive(Clone, Copy)]
pub struct Cause {
    words: &'static str,
    is_watchdog: bool,
}

impl Cause {
    /// The watchdog.
    pub const WATCHDOG: Self = Self {
        words: "watchdog",
        is_watchdog: true,
    };

    /// Another cause, in words.
    pub const fn other(words: &'static str) -> Self {
        Self {
            words,
            is_watchdog: false,
        }
    }
}

/// Logs why the board started, and the words from before that. Returns the node's configuration, the step sensor
/// on a bus, if there is one, and the place where radio and camera report. Once.
///
/// # Errors
/// There is no configuration: [`stop`].
pub fn begin<F: ReadNorFlash, B: I2c>(
    cause: Cause,
    (flash, board): (&mut F, &Board),
    bus: B,
) -> Result<Begun<B>, PageError> {
    static NODE: StaticCell<(CheckedConfig, Liveness)> = StaticCell::new();
    let before = retained::take();
    tell_start(cause.words, &before);
    let config = read_config(flash, board.regions.config.start)?;
    let liveness = Liveness::new(before.reason(cause.is_watchdog));
    let (config, liveness): &(CheckedConfig, Liveness) = NODE.init((config, liveness));
    // The sensor may know more of its settings than the check of configurations.
    let steps = InertialSteps::new(bus, EmbassyClock, config.sensor());
    let steps = steps.map_err(|_| PageError::Value(ConfigError::Sensor))?;
    Ok((config, steps, liveness))
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

/// Logs why the node cannot go on, now and after the restart. Nothing reports any more then: the watchdog restarts
/// it.
pub fn tell_failure<R, F>(failure: &Failure<R, F>) {
    #[cfg(feature = "update")]
    if matches!(failure, Failure::Update) {
        // Now, not when the watchdog does.
        retained::say_and_restart(LastWords::restart(Restart::Ordinary));
    }
    let why = match failure {
        Failure::Link(RunnerError::Radio(_)) => Restart::RadioStuck,
        _ => Restart::Program,
    };
    retained::say(LastWords::restart(why));
    defmt::error!("stopped: {=str}", describe(failure));
}
