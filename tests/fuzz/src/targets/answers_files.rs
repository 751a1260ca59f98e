//! Records of runs and tables of sightings of any text are refused or read, without a panic.

use results::{
    record::RunRecord,
    recorded::sightings::{self, Assumptions},
    report::run::run_report,
};

/// Tries one input.
pub(crate) fn run(text: &[u8]) {
    let Ok(text) = str::from_utf8(text) else {
        return;
    };
    if let Ok(record) = RunRecord::from_json(text) {
        let _ = run_report(&record);
        let written = record.to_json(true);
        assert!(written.is_ok_and(|text| RunRecord::from_json(&text).is_ok()));
    }
    let _ = sightings::read(text.as_bytes(), &Assumptions::default(), |_| ());
}
