//! A building of many networks, of which only the first has references: a target takes its frame to the others.
//!
//! Poses are one frame's if errors are what sigmas foretell in all networks. `weak_sigma` is 1.0 units, as in
//! `office`: places get less sure with each network.

use anyhow::Context;
use host_sim::network::{Options, Simulation};
use results::record::verdict::Verdict;
use site::{Overrides, Scenario};
use test_support::building;

use crate::figure::{Goal, Sheet};

pub(crate) fn run(sheet: &mut Sheet) -> anyhow::Result<()> {
    for (cameras, cell) in [(250, 25), (1000, 25)] {
        let networks = cameras / cell;
        sheet.heading(&format!(
            "Building: {cameras} cameras in {networks} networks, one frame"
        ));
        let changes = Overrides {
            seed: Some(1),
            ..Overrides::default()
        };
        let scenario = Scenario::from_toml(&building(cameras, cell), &changes)?;
        let record = Simulation::new(scenario, Options::default())?.run(|_| ());
        let summary = &record.summary;
        let errors = summary
            .cameras
            .as_ref()
            .context("no camera was calibrated")?;
        let share = summary.calibrated as f64 / summary.expected as f64;
        // Others have poses too, and say that these are weak.
        sheet.figure(
            "cameras called calibrated",
            share * 100.0,
            "%",
            &Goal::AtLeast(99.5),
        );
        sheet.figure("position, rms", errors.position.rms, "units", &Goal::None);
        // Of three numbers; above, if sigmas were too small.
        sheet.figure(
            "squared error over covariance, mean",
            errors.mean_nees.unwrap_or(f64::NAN),
            "",
            &Goal::AtMost(3.0),
        );
        let deceives = Verdict::of(&record).deceives;
        sheet.figure(
            "a camera deceives",
            f64::from(u8::from(deceives)),
            "",
            &Goal::AtMost(0.0),
        );
        sheet.figure("simulated", record.sim_seconds / 3600.0, "h", &Goal::None);
    }
    Ok(())
}
