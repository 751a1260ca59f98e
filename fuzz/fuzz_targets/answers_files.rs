//! Records of runs and tables of sightings of any text are refused or read, without a panic.
#![no_main]

use answers::{
    record::RunRecord,
    recorded::sightings::{self, Assumptions},
    report::run::run_report,
};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    if let Ok(record) = RunRecord::from_json(text) {
        let _ = run_report(&record);
        let written = record.to_json(true);
        assert!(written.is_ok_and(|text| RunRecord::from_json(&text).is_ok()));
    }
    let _ = sightings::read(text.as_bytes(), &Assumptions::default(), |_| ());
});
