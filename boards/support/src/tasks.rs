//! The tasks of a board.

use embassy_executor::{SpawnError, SpawnToken, Spawner};

/// Spawns a task that is spawned once, so that there is room for it.
pub fn spawn<S>(spawner: Spawner, task: Result<SpawnToken<S>, SpawnError>) {
    match task {
        Ok(task) => spawner.spawn(task),
        Err(_) => defmt::error!("a task was spawned twice"),
    }
}
