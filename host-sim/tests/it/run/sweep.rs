//! Statistics over many runs.

use std::collections::BTreeMap;

use results::record::sweep::{Group, Quantity, Sweep, SweepReport};
use results::report::sweep::sweep_report;

use super::sample::Sample;

fn sweep(seeds: impl Iterator<Item = u64>, blind: &'static [u16]) -> SweepReport {
    let mut sweep = Sweep::default();
    for seed in seeds {
        let sample = Sample {
            seed,
            blind,
            ..Sample::default()
        };
        sweep.add(&sample.run()).unwrap();
    }
    sweep.finish().unwrap()
}

#[test]
fn the_order_of_runs_makes_no_difference() {
    assert_eq!(sweep(0..20, &[]), sweep((0..20).rev(), &[]));
}

/// Quantiles of three known errors, by hand.
#[test]
fn quantiles_are_of_absolute_errors() {
    let mut sweep = Sweep::default();
    for error in [-3.0, 1.0, 2.0] {
        let mut record = Sample::default().run();
        let camera = record.nodes.iter_mut().find(|n| n.id == 3).unwrap();
        camera.error.as_mut().unwrap().x = error;
        camera.estimate.as_mut().unwrap().sigma_x = 2.0;
        sweep.add(&record).unwrap();
    }
    let report = sweep.finish().unwrap();
    let x = report.find(Group::Camera(3), Quantity::X).unwrap();
    assert_eq!((x.expected, x.calibrated), (3, 3));
    assert_eq!((x.p50, x.p75, x.max), (Some(2.0), Some(2.5), Some(3.0)));
    assert!((x.rms.unwrap() - (14.0_f64 / 3.0).sqrt()).abs() < 1e-12);
    assert_eq!(x.sigma_rms, Some(2.0));
    let third = 1.0 / 3.0;
    assert!((x.within_1.unwrap() - 2.0 * third).abs() < 1e-12);
    assert_eq!(x.within_2, Some(1.0));
}

/// The sample's noise has the size of its sigmas, so most errors are within two of them.
#[test]
fn shares_within_sigmas_are_about_what_is_foretold() {
    let report = sweep(0..60, &[]);
    assert_eq!((report.runs, report.complete), (60, 60));
    for quantity in [Quantity::X, Quantity::Y, Quantity::HeadingDeg] {
        let row = report.find(Group::Cameras, quantity).unwrap();
        assert_eq!(row.calibrated, 660);
        let shares = [row.within_1, row.within_2, row.within_3].map(Option::unwrap);
        for (share, foretold) in shares.iter().zip(results::accuracy::GAUSSIAN) {
            assert!((share - foretold).abs() < 0.08, "{quantity:?} {shares:?}");
        }
    }
    let stop = Group::Stop {
        target: 20,
        stop: 5,
    };
    let row = report.find(stop, Quantity::Position).unwrap();
    // Two components of 0.01 each.
    assert!((row.rms.unwrap() / row.sigma_rms.unwrap() - 1.0).abs() < 0.3);
    assert!(report.find(stop, Quantity::HeadingDeg).is_none());
}

#[test]
fn csv_has_all_groups_and_leaves_unknown_values_empty() {
    let report = sweep(0..5, &[4]);
    assert_eq!(report.complete, 0);
    let text = report.to_csv().unwrap();
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let rows: Vec<BTreeMap<String, String>> =
        reader.deserialize().collect::<Result<_, _>>().unwrap();
    // All, cameras and 13 single ones with four quantities, 39 stops with three.
    assert_eq!(rows.len(), 15 * 4 + 39 * 3);
    let find = |group: &str, quantity: &str| {
        let mut rows = rows.iter();
        rows.find(|row| row["group"] == group && row["quantity"] == quantity)
            .unwrap()
    };
    let blind = find("camera 4", "heading_deg");
    assert_eq!(
        (blind["expected"].as_str(), blind["calibrated"].as_str()),
        ("5", "0")
    );
    assert_eq!(
        (blind["rms"].as_str(), blind["within_1"].as_str()),
        ("", "")
    );
    assert_eq!(find("all", "position")["within_1"], "");
    assert_eq!(find("target 20 stop 38", "x")["calibrated"], "5");
    let table = sweep_report(&report);
    assert!(table.contains("5 runs, 0 of them with every camera calibrated"));
    assert!(table.contains("| camera 13 |"));
}

#[test]
fn a_sweep_is_over_one_scenario() {
    let mut sweep = Sweep::default();
    let mut record = Sample::default().run();
    sweep.add(&record).unwrap();
    record.scenario = "grid".to_owned();
    assert!(sweep.add(&record).is_err());
    assert_eq!(sweep.finish().unwrap().runs, 1);
    assert!(Sweep::default().finish().is_none());
}
