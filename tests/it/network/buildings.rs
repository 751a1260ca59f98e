//! A building of several networks in one frame: a target takes it from one to the next.

use host_sim::network::{Options, Simulation};
use site::{Overrides, Scenario};

use results::record::RunRecord;

/// Cells of 13 to 20 cameras, of which only the first has references.
fn building(cameras: usize, cell_cameras: usize, seed: u64) -> RunRecord {
    let changes = Overrides {
        seed: Some(seed),
        ..Overrides::default()
    };
    let scenario =
        Scenario::from_toml(&test_support::building(cameras, cell_cameras), &changes).unwrap();
    let mut simulation = Simulation::new(scenario, Options::default()).unwrap();
    simulation.run(|_| ())
}

/// Every camera is calibrated in the frame of the first network, within five of its sigmas. The only
/// references are the two of the first network.
fn assert_one_frame(record: &RunRecord, cameras: usize, networks: usize) {
    assert_eq!(record.networks.len(), networks);
    for network in &record.networks {
        let frame = network.frame;
        assert_eq!((frame.x, frame.y, frame.heading_deg), (0.0, 0.0, 0.0));
    }
    let references = record.cameras().filter(|camera| camera.reference);
    assert_eq!(references.count(), 2);
    let summary = &record.summary;
    assert_eq!((summary.calibrated, summary.expected), (cameras, cameras));
    let verdict = results::record::verdict::Verdict::of(record);
    assert!(!verdict.deceives, "{verdict}");
}

#[test]
fn sixty_cameras_in_three_networks_end_in_one_frame() {
    for seed in [1, 2, 3] {
        assert_one_frame(&building(60, 20, seed), 60, 3);
    }
}
