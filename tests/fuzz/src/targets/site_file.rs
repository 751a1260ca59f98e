//! A site, scenario or scene file of any text is refused or read; a file that is read can be written, and is then
//! read as the same.

use site::{Overrides, Scenario};

/// A site of many thousands of cameras is possible, and takes long.
const LONGEST: usize = 4_000;

/// Tries one input.
pub(crate) fn run(text: &[u8]) {
    let Ok(text) = str::from_utf8(text) else {
        return;
    };
    // Cells of a grid are put up before anything is checked.
    let has_grid = || toml::from_str::<toml::Table>(text).is_ok_and(|file| file.contains_key("grid"));
    if text.len() > LONGEST || has_grid() {
        return;
    }
    let Ok(scenario) = Scenario::from_toml(text, &Overrides::default()) else {
        return;
    };
    let Ok(written) = toml::to_string(&scenario) else {
        panic!("it cannot be written");
    };
    let again = Scenario::from_toml(&written, &Overrides::default());
    assert!(again.is_ok(), "{again:?}");
}
