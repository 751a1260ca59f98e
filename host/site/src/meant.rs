//! Names that were probably meant.

/// Likeness from which on a name was probably meant.
const LIKE: f64 = 0.7;

/// Shorter names are one slip apart though nothing was mistyped.
const SLIP_LENGTH: usize = 3;

/// The name that was probably meant by another one, if any is like it or is abbreviated by it.
#[must_use]
pub fn nearest<'a>(name: &str, among: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let is_slip =
        |known: &str| name.len() >= SLIP_LENGTH && strsim::damerau_levenshtein(known, name) == 1;
    let likeness = |known: &str| match abbreviates(name, known) || is_slip(known) {
        true => 1.0,
        false => strsim::jaro_winkler(known, name),
    };
    let best = { among.into_iter() }.max_by(|a, b| likeness(a).total_cmp(&likeness(b)))?;
    (likeness(best) > LIKE).then_some(best)
}

/// Returns true if a name begins with the first letters of three words or more of another one, and goes on as that does or
/// ends: `fov_deg` and `fov` abbreviate `field_of_view_deg`.
fn abbreviates(name: &str, known: &str) -> bool {
    let words: Vec<&str> = known.split('_').collect();
    (3..=words.len()).any(|count| {
        let (first, rest) = words.split_at(count);
        let letters: String = first
            .iter()
            .filter_map(|word| word.chars().next())
            .collect();
        name == letters || name == [&[letters.as_str()], rest].concat().join("_")
    })
}

/// `: did you mean ...?`, or nothing.
pub(crate) fn question(nearest: Option<impl AsRef<str>>) -> String {
    let words = |name: &str| format!(": did you mean `{name}`?");
    nearest.map_or_else(String::new, |name| words(name.as_ref()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_is_recognised_and_another_name_is_not() {
        let known = ["thesis-13", "lab", "grid", "office"];
        assert_eq!(nearest("thesis", known), Some("thesis-13"));
        assert_eq!(nearest("ofice", known), Some("office"));
        assert_eq!(nearest("kitchen", known), None);
        assert_eq!(nearest("rnu", ["live", "run", "report"]), Some("run"));
        let keys = ["field_of_view_deg", "flicker", "projection", "height"];
        for abbreviated in ["fov", "fov_deg", "fovd"] {
            assert_eq!(nearest(abbreviated, keys), Some("field_of_view_deg"));
        }
        for other in ["fo", "fov_rad", "fd", "_", ""] {
            assert!(!abbreviates(other, "field_of_view_deg"), "{other}");
        }
    }
}
