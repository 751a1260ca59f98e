//! Automatic gain and white balance of the sensor.
//!
//! While on, the gain drifts until the picture is of middle brightness, and the white balance
//! until the picture as a whole is grey, each with its time constant. Both therefore change with
//! whatever is in view: a colour learned before they are frozen is not that colour afterwards.

/// Levels: the brightness that automatic gain aims at.
const MIDDLE: f64 = 128.0;
/// How long the gain takes for most of the way, seconds.
const GAIN_SECONDS: f64 = 0.7;
/// How long the white balance takes for most of the way, seconds.
const WHITE_SECONDS: f64 = 1.5;
/// The limits of all factors.
const FACTORS: std::ops::RangeInclusive<f64> = 0.25..=4.0;

/// What the sensor multiplies each channel by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    gain: f64,
    white: [f64; 3],
    at: u64,
}

impl Light {
    /// After power-up or reset: nothing is adapted.
    pub(super) fn new(now: u64) -> Self {
        Self {
            gain: 1.0,
            white: [1.0; 3],
            at: now,
        }
    }

    /// The factors of red, green and blue.
    pub fn factors(&self) -> [f64; 3] {
        self.white.map(|white| white * self.gain)
    }

    /// Time passes before a scene whose mean is asked for only when it is needed.
    pub(super) fn adapt(
        &mut self,
        now: u64,
        auto_gain: bool,
        auto_white: bool,
        mean: impl FnOnce() -> [f64; 3],
    ) {
        let seconds = now.saturating_sub(self.at) as f64 * 1e-9;
        self.at = now;
        if seconds <= 0.0 || !(auto_gain || auto_white) {
            return;
        }
        let mean = mean().map(|level| level.max(1.0));
        if auto_white {
            let grey = mean.iter().sum::<f64>() / 3.0;
            for (white, level) in self.white.iter_mut().zip(mean) {
                approach(white, grey / level, seconds / WHITE_SECONDS);
            }
        }
        if auto_gain {
            let seen: f64 = mean.iter().zip(self.white).map(|(m, w)| m * w).sum::<f64>() / 3.0;
            approach(&mut self.gain, MIDDLE / seen, seconds / GAIN_SECONDS);
        }
    }
}

fn approach(factor: &mut f64, aim: f64, times: f64) {
    let aim = aim.clamp(*FACTORS.start(), *FACTORS.end());
    *factor += (aim - *factor) * (1.0 - (-times).exp());
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    #[test]
    fn a_dark_yellow_room_becomes_grey_and_bright_only_while_it_may() {
        let room = [80.0, 60.0, 40.0];
        let seen = |light: &Light| -> [f64; 3] {
            let factors = light.factors();
            std::array::from_fn(|channel| room[channel] * factors[channel])
        };
        let mut light = Light::new(0);
        light.adapt(10 * SECOND, false, false, || room);
        assert_eq!(seen(&light), room);
        light.adapt(40 * SECOND, true, true, || room);
        for level in seen(&light) {
            assert!((level - 128.0).abs() < 1.0, "{level}");
        }
        let adapted = light.factors();
        light.adapt(90 * SECOND, false, false, || [200.0; 3]);
        assert_eq!(light.factors(), adapted);
    }

    #[test]
    fn gain_alone_keeps_the_colour() {
        let mut light = Light::new(0);
        light.adapt(SECOND, true, false, || [40.0, 60.0, 80.0]);
        let [red, green, blue] = light.factors();
        assert!(red == green && green == blue && red > 1.0);
    }
}
