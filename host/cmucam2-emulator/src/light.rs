//! Automatic gain and white balance of the sensor.
//!
//! While on, the gain drifts until the picture is of middle brightness, and the white balance until the picture as
//! a whole is grey, each with its time constant. Both therefore change with the objects in view: a colour learned
//! before they are frozen is not that colour afterwards.

/// Levels: the brightness that automatic gain aims at.
const MIDDLE: f64 = 128.0;
/// Time that the gain takes for most of the way, seconds.
const GAIN_SECONDS: f64 = 0.7;
/// Time that the white balance takes for most of the way, seconds.
const WHITE_SECONDS: f64 = 1.5;
/// The limits of all factors.
const FACTORS: std::ops::RangeInclusive<f64> = 0.25..=4.0;

/// Colour temperature of the light in which a [`Scene`](crate::Scene) has its colours, kelvin.
const WHITE_KELVIN: f64 = 6_504.0;

/// The [`Scene::light`](crate::Scene::light) of a black body's colour, such as lamps and daylight have
/// nearly.
///
/// `level` is the brightness of a grey wall against the scene in white light, from 0; `kelvin` the colour
/// temperature: 2,700 is a lamp, 6,504 white daylight, 10,000 the blue sky; it is cut to 1,667 to 25,000. To be
/// set at any time: a sensor that adapts follows it, one that was frozen does not.
///
/// Chromaticities by the cubic splines of Kim et al. (US patent 7,024,034), as linear sRGB (IEC
/// 61966-2-1).
///
/// ```
/// use cmucam2_emulator::{Configuration, Emulator, Scene, daylight};
/// let mut camera = Emulator::new(Configuration::default(), Scene::default());
/// camera.scene_mut().light = daylight(0.4, 3_200.0);
/// ```
pub fn daylight(level: f64, kelvin: f64) -> [f64; 3] {
    let white = linear_srgb(WHITE_KELVIN);
    let colour = linear_srgb(kelvin);
    let light: [f64; 3] = std::array::from_fn(|channel| colour[channel] / white[channel]);
    let mean = light.iter().sum::<f64>() / 3.0;
    light.map(|channel| channel * level / mean)
}

/// Red, green and blue of a black body of luminance 1.
fn linear_srgb(kelvin: f64) -> [f64; 3] {
    let kelvin = kelvin.clamp(1_667.0, 25_000.0);
    let polynomial = |of: f64, c: [f64; 4]| ((c[0] * of + c[1]) * of + c[2]) * of + c[3];
    let x = polynomial(
        1_000.0 / kelvin,
        if kelvin <= 4_000.0 {
            [-0.266_123_9, -0.234_358_9, 0.877_695_6, 0.179_910]
        } else {
            [-3.025_846_9, 2.107_037_9, 0.222_634_7, 0.240_390]
        },
    );
    let y = polynomial(
        x,
        if kelvin <= 2_222.0 {
            [-1.106_381_4, -1.348_110_20, 2.185_558_32, -0.202_196_83]
        } else if kelvin <= 4_000.0 {
            [-0.954_947_6, -1.374_185_93, 2.091_370_15, -0.167_488_67]
        } else {
            [3.081_758_0, -5.873_386_70, 3.751_129_97, -0.370_014_83]
        },
    );
    let (x, z) = (x / y, (1.0 - x - y) / y);
    [
        3.2406 * x - 1.5372 - 0.4986 * z,
        -0.9689 * x + 1.8758 + 0.0415 * z,
        0.0557 * x - 0.2040 + 1.0570 * z,
    ]
    .map(|channel| channel.max(0.0))
}

/// Factor by which the sensor multiplies each channel.
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

    /// Lets time pass before a scene, whose mean is asked for only when it is needed.
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
    fn lamps_are_red_and_the_sky_is_blue() {
        for channel in daylight(0.7, 6_504.0) {
            assert!((channel - 0.7).abs() < 1e-12, "{channel}");
        }
        let [red, green, blue] = daylight(1.0, 2_856.0);
        // Ratio for CIE illuminant A (x 0.4476, y 0.4074) against the black body of 6,504 K (0.3135, 0.3237).
        assert!((red / green - 2.11).abs() < 0.03, "{red} {green}");
        assert!((blue / green - 0.269).abs() < 0.02, "{blue} {green}");
        let mut before = f64::INFINITY;
        for kelvin in [
            1_700.0, 2_221.0, 2_223.0, 3_999.0, 4_001.0, 6_504.0, 24_000.0,
        ] {
            let [red, green, blue] = daylight(2.0, kelvin);
            assert!((red + green + blue - 6.0).abs() < 1e-9);
            let warmth = red - blue;
            assert!(warmth <= before + 1e-3, "{kelvin}");
            before = warmth;
        }
    }

    #[test]
    fn gain_alone_keeps_the_colour() {
        let mut light = Light::new(0);
        light.adapt(SECOND, true, false, || [40.0, 60.0, 80.0]);
        let [red, green, blue] = light.factors();
        assert!(red == green && green == blue && red > 1.0);
    }
}
