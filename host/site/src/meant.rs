//! Names that were probably meant.

/// Likeness from which on a name was probably meant.
const LIKE: f64 = 0.7;

/// The name that was probably meant by another one, if any is like it.
#[must_use]
pub fn nearest<'a>(name: &str, among: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let likeness = |known: &str| strsim::jaro_winkler(known, name);
    let best = { among.into_iter() }.max_by(|a, b| likeness(a).total_cmp(&likeness(b)))?;
    (likeness(best) > LIKE).then_some(best)
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
    }
}
