//! Arithmetic that is the same on every machine, and sorting in little flash.

use nalgebra::ComplexField;

/// The square root of a variance, which may come out a rounding error below zero.
pub(crate) fn root(variance: f32) -> f32 {
    // `max` would make zero, the best of all sigmas, of a value that is not a number.
    let variance = if variance < 0.0 { 0.0 } else { variance };
    // Not the machine's own: `libm`, through nalgebra, everywhere.
    ComplexField::sqrt(variance)
}

/// Sorts a short list; equals keep their order. The library's sort is made for long lists, and takes six
/// kilobytes of flash.
pub(crate) fn sort<T>(values: &mut [T], is_before: impl Fn(&T, &T) -> bool) {
    for end in 1..values.len() {
        for place in (1..=end).rev() {
            match values.get_mut(place - 1..=place) {
                Some([left, right]) if is_before(right, left) => core::mem::swap(left, right),
                _ => break,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn as_the_library_sorts(values: Vec<(u8, u8)>) {
            let (mut own, mut library) = (values.clone(), values);
            sort(&mut own, |a, b| a.0 < b.0);
            library.sort_by_key(|value| value.0);
            prop_assert_eq!(own, library);
        }
    }
}
