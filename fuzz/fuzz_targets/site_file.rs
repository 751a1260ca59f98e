//! A site, scenario or scene file of any text is refused or read; what is read can be written, and is then
//! read as the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use site::{Overrides, Scenario};

/// A site of many thousands of cameras is possible, and takes long.
const LONGEST: usize = 4_000;

fuzz_target!(|text: &str| {
    // Cells of a grid are put up before anything is checked.
    if text.len() > LONGEST || text.contains("grid") {
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
});
