//! Chance from one root seed.
//!
//! Every user of chance asks for a stream by name and number. A stream depends on the root seed, the name and the
//! number only, so one more consumer changes nothing for the others.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// The root of all chance in a simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Root(pub u64);

impl Root {
    /// A seed for a generator elsewhere.
    pub fn seed(self, name: &str, number: u64) -> u64 {
        let start = mix(self.0);
        let named = name
            .bytes()
            .fold(start, |hash, byte| mix(hash ^ u64::from(byte)));
        // The length keeps names apart whose bytes end in different places.
        mix(mix(named ^ name.len() as u64) ^ number)
    }

    /// A stream of random numbers.
    pub fn stream(self, name: &str, number: u64) -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(self.seed(name, number))
    }
}

/// A bijection of 64 bits without visible order (the finaliser of `SplitMix64`).
pub fn mix(value: u64) -> u64 {
    let value = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let value = (value ^ value >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let value = (value ^ value >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    value ^ value >> 31
}

/// A hash as a number from 0 (inside) to 1 (outside).
pub(super) fn share(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1_u64 << 53) as f64
}

/// A hash as a number that is normally distributed, with mean 0 and standard deviation 1
/// (Box and Muller 1958).
pub(super) fn normal(hash: u64) -> f64 {
    let radius = libm::sqrt(-2.0 * libm::log(1.0 - share(mix(hash))));
    let angle = std::f64::consts::TAU * share(mix(hash ^ 1 << 63));
    radius * libm::cos(angle)
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;

    #[test]
    fn streams_differ_in_seed_name_and_number() {
        let first = |root: u64, name: &str, number| Root(root).stream(name, number).next_u64();
        let all = [
            first(1, "radio", 0),
            first(2, "radio", 0),
            first(1, "radio", 1),
            first(1, "radi", 0),
            first(1, "camera", 0),
            first(1, "", 0),
        ];
        for (n, value) in all.iter().enumerate() {
            assert!(!all[..n].contains(value));
        }
        assert_eq!(first(1, "radio", 0), all[0]);
    }

    #[test]
    fn hashes_are_normally_distributed() {
        let count = 20_000;
        let numbers: Vec<f64> = (0..count).map(|n| normal(mix(n))).collect();
        let mean = numbers.iter().sum::<f64>() / count as f64;
        let variance = numbers.iter().map(|x| x * x).sum::<f64>() / count as f64;
        let within = numbers.iter().filter(|x| x.abs() < 1.0).count() as f64 / count as f64;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.04);
        assert!((within - 0.6827).abs() < 0.012);
    }
}
