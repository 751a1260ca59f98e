//! All chance comes from the seed.

use std::thread;

use host_sim::network::run_all;
use results::record::sweep::Sweep;
use site::{Overrides, Scenario, ScenarioError};

use crate::network::yard::{Yard, run, written};

#[test]
fn a_seed_gives_the_same_record_and_log_on_any_thread() {
    let loss = "[radio]\nmedium = \"unit-disk\"\nrange = 45.0\nloss = 0.1";
    let yard = || {
        let yard = Yard {
            tables: loss,
            ..Yard::default()
        };
        written(yard.scenario(7))
    };
    let first = yard();
    assert_eq!(first, yard());
    let threads: Vec<_> = (0..3).map(|_| thread::spawn(yard)).collect();
    for other in threads {
        assert!(other.join().unwrap() == first);
    }
}

#[test]
fn another_seed_gives_another_run() {
    let log = |seed| written(Yard::default().scenario(seed)).1;
    assert_ne!(log(1), log(2));
}

#[test]
fn a_sweep_is_the_same_with_any_number_of_jobs() {
    let scenarios: Vec<_> = (1..=6).map(|seed| Yard::default().scenario(seed)).collect();
    let csv = |jobs: usize| {
        let mut sweep = Sweep::default();
        let mut seeds = Vec::new();
        run_all::<ScenarioError>(&scenarios, jobs.try_into().unwrap(), |record| {
            seeds.push(record.seed);
            sweep.add(&record).unwrap();
            Ok(())
        })
        .unwrap();
        assert_eq!(seeds, [1, 2, 3, 4, 5, 6].map(Some));
        sweep.finish().unwrap().to_csv().unwrap()
    };
    assert_eq!(csv(1), csv(4));
}

/// Another network is on another channel, and changes nothing for the first.
#[test]
fn a_network_does_not_notice_its_neighbour() {
    let first = |nodes| {
        let changes = Overrides {
            nodes: Some(nodes),
            ..Overrides::default()
        };
        let mut record = run(Scenario::load("grid", &changes).unwrap());
        assert_eq!(record.networks.len(), nodes / 13);
        record.nodes.retain(|node| node.network == 1);
        record.targets.retain(|target| target.network == 1);
        (record.nodes, record.targets)
    };
    assert_eq!(first(13), first(26));
}

#[test]
fn built_in_scenarios_run_the_same_twice() {
    for name in ["lab", "grid"] {
        let changes = Overrides {
            nodes: (name == "grid").then_some(26),
            ..Overrides::default()
        };
        let load = || Scenario::load(name, &changes).unwrap();
        assert!(written(load()) == written(load()), "{name}");
    }
}
