//! A target that estimates, as on a board.

use calib_core::joint::{BearingStorage, StopStorage, UnknownStorage};
use node_firmware::{
    config::TargetConfig,
    limits::{ESTIMATED_STOPS, WALK_BEARINGS},
    role::moving_target::{CAMERAS, EstimateMemory, TargetEvent, TargetRole, WORKSPACE},
    steps::{Chip, SensorFault},
};

/// Its step sensor fails.
pub const BROKEN: TargetEvent = TargetEvent::Sensor(Some(Chip::Compass.is(SensorFault::Absent)));

/// Its step sensor works again.
pub const WORKS: TargetEvent = TargetEvent::Sensor(None);

/// A target with memory that the test keeps to its end.
pub fn target_role(id: u16, config: TargetConfig, first_stop: u16) -> TargetRole<'static> {
    let mut role = TargetRole::new(id, config, first_stop);
    role.estimate_in(EstimateMemory {
        cameras: Box::leak(Box::new([UnknownStorage::default(); CAMERAS])),
        stops: Box::leak(Box::new([StopStorage::default(); ESTIMATED_STOPS])),
        bearings: Box::leak(Box::new([BearingStorage::default(); WALK_BEARINGS])),
        workspace: Box::leak(Box::new([0.0; WORKSPACE])),
        told: Box::leak(Box::new([None; CAMERAS])),
    });
    role
}
