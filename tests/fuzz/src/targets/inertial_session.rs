//! Readings of worn sensors of any values at any times: no panic, and every step is one that a person can
//! have made, with sigmas.
//!
//! Records of 20 bytes: pause in units of 2.5 ms, contents (1 a compass, 2 any numbers, 4 the heading is known),
//! and nine numbers of two bytes.

use std::time::Duration;

use nalgebra::Vector3;
use pedestrian::{ImuSample, Pedestrian, PedestrianSettings};

const RECORD: usize = 20;

/// Tries one input.
pub(crate) fn run(bytes: &[u8]) {
    let settings = PedestrianSettings::<f32>::default();
    let mut walker = Pedestrian::new(settings).expect("the defaults are possible");
    let mut time = Duration::ZERO;
    for record in bytes.as_chunks::<RECORD>().0 {
        let (pause, kind) = (record[0], record[1]);
        time += Duration::from_micros(2_500) * pause.into();
        let is_any = kind & 2 != 0;
        let vector = |place: usize, scale: f32| {
            Vector3::from_fn(|axis, _| {
                let at = 2 + 6 * place + 2 * axis;
                let bits = [record[at], record[at + 1]];
                if is_any {
                    // The upper half of a number: all sizes, NaN and infinity.
                    f32::from_bits(u32::from(u16::from_le_bytes(bits)) << 16)
                } else {
                    f32::from(i16::from_le_bytes(bits)) * scale
                }
            })
        };
        if kind & 4 != 0 {
            walker.align(f32::from(record[2]) * 0.02, 0.05);
        }
        let sample = ImuSample {
            acceleration: vector(0, 1e-3),
            angular_rate: vector(1, 1e-3),
            magnetic_field: (kind & 1 != 0).then(|| vector(2, 1e-2)),
        };
        let Ok(Some(step)) = walker.update(time, &sample) else {
            continue;
        };
        assert!(step.distance.is_finite() && step.distance > 0.0, "{step:?}");
        assert!(
            (0.0..=std::f32::consts::TAU).contains(&step.heading),
            "{step:?}"
        );
        for sigma in [step.distance_sigma, step.heading_sigma] {
            assert!(sigma.is_finite() && sigma >= 0.0, "{step:?}");
        }
    }
}
