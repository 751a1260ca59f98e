//! Knowledge of the target's carrier, and the carrier's errors.

use node_firmware::config::TargetConfig;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};
use site::{Scenario, SensorTable};

use super::{between, happens, short};

/// Constant errors are drawn from the sigmas that nodes believe, and no further out than this.
const MOST_SIGMAS: f64 = 2.5;

/// The largest undeclared errors: of distances as a share, and of headings as an angle of the same size.
const UNDECLARED: f64 = 0.1;

/// Sigmas of its constant errors that nodes believe: of distances as a share, of headings in degrees.
pub(super) fn believed(scenario: &Scenario) -> [f64; 2] {
    let firmware = &scenario.firmware;
    let unsaid = TargetConfig::default();
    [
        firmware
            .systematic_scale
            .unwrap_or(unsaid.systematic_scale.into()),
        firmware
            .systematic_heading_deg
            .unwrap_or(unsaid.systematic_heading_deg.into()),
    ]
}

/// Draws them; errors that nodes do not know only where something may come and go.
pub(super) fn draw(random: &mut impl Rng, scenario: &mut Scenario, errs_unsaid: bool) {
    // The installer has measured the carrier, or has not.
    if happens(random, 0.5) {
        scenario.firmware.systematic_scale = Some(between(random, 0.01, 0.06));
        scenario.firmware.systematic_heading_deg = Some(between(random, 0.5, 3.0));
    }
    let believed = believed(scenario);
    let mut sensor = SensorTable {
        measures: happens(random, 0.7),
        ..SensorTable::default()
    };
    if sensor.measures {
        sensor.leg_distance = between(random, 0.0, 0.02);
        sensor.leg_heading_deg = between(random, 0.0, 1.0);
    }
    let [scale, heading] = believed.map(|sigma| {
        let drawn: f64 = StandardNormal.sample(random);
        short(sigma * drawn.clamp(-MOST_SIGMAS, MOST_SIGMAS))
    });
    (sensor.scale_bias, sensor.heading_bias_deg) = (scale, heading);
    let degrees = UNDECLARED.to_degrees();
    // Errors that nodes do not know, one or the other.
    if happens(random, 0.25) && errs_unsaid {
        match random.random_range(0..3) {
            0 => sensor.scale_bias = between(random, -UNDECLARED, UNDECLARED),
            1 => sensor.heading_bias_deg = between(random, -degrees, degrees),
            _ => {
                sensor.undeclared_distance = between(random, 0.0, UNDECLARED);
                sensor.undeclared_heading_deg = between(random, 0.0, degrees);
            }
        }
    }
    scenario.sensor = Some(sensor);
}
