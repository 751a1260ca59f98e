//! The sensors of a simulated person, as the reckoner takes them.

use std::time::Duration;

use calib_core::dead_reckoning::Step;
use pedestrian::{ImuSample, Pedestrian, PedestrianSettings};
pub(crate) use test_support::walker::{Act, Reading, Walker};

/// A reading as a sample.
pub(crate) fn sample(reading: &Reading) -> ImuSample<f64> {
    ImuSample {
        acceleration: reading.acceleration,
        angular_rate: reading.angular_rate,
        magnetic_field: reading.magnetic_field,
    }
}

pub(crate) fn settings(walker: &Walker) -> PedestrianSettings<f64> {
    let mut settings = PedestrianSettings::default();
    settings.heading.magnetic_north = walker.north;
    settings
}

pub(crate) fn reckon(walker: &Walker, settings: PedestrianSettings<f64>) -> Vec<Step<f64>> {
    let mut person = Pedestrian::new(settings).unwrap();
    let mut steps = Vec::new();
    for (i, reading) in walker.readings.iter().enumerate() {
        steps.extend(person.update(moment(i), &sample(reading)).unwrap());
    }
    steps
}

/// The time of a reading.
pub(crate) fn moment(i: usize) -> Duration {
    Duration::from_millis(10 * i as u64)
}
