//! Two runs against each other.

use results::record::difference::{CompareError, Difference};

use super::sample::Sample;

#[test]
fn a_run_agrees_with_itself_however_long_it_took() {
    let one = Sample::default().run();
    let mut other = one.clone();
    other.wall_seconds = None;
    let difference = Difference::between(&one, &other, 0.0).unwrap();
    assert!(difference.is_none());
    assert_eq!(difference.exit_code(), 0);
    assert!(difference.compared > 500);
}

#[test]
fn what_differs_is_named() {
    let one = Sample::default().run();
    let mut other = one.clone();
    other.nodes[3].estimate.as_mut().unwrap().x += 0.001;
    other.nodes[5].estimate.as_mut().unwrap().x += 0.25;
    other.nodes[6].reason = Some(calib_core::Refusal::TooFew);
    other.targets[0].stops.pop();
    let difference = Difference::between(&one, &other, 0.0).unwrap();
    assert_eq!(difference.exit_code(), 1);
    assert_eq!(difference.numbers.len(), 1);
    let x = &difference.numbers["nodes[*].estimate.x"];
    assert_eq!((x.count, x.place.as_str()), (2, "nodes[5].estimate.x"));
    assert!((x.largest - 0.25).abs() < 1e-12);
    assert_eq!(
        difference.others,
        [
            "nodes[6].reason: null and \"too_few\"",
            "targets[20].stops has 39 and 38 entries"
        ]
    );
    // Both are far from 1 / 20 of 21 units; one is within it.
    let tolerant = Difference::between(&one, &other, 0.001).unwrap();
    assert_eq!(tolerant.numbers["nodes[*].estimate.x"].count, 1);
}

#[test]
fn large_whole_numbers_differ_too() {
    let one = Sample::default().run();
    let mut other = one.clone();
    other.seed = Some(u64::MAX - 1);
    let mut third = one.clone();
    third.seed = Some(u64::MAX);
    let difference = Difference::between(&other, &third, 0.0).unwrap();
    assert!(!difference.is_none());
}

#[test]
fn runs_of_different_scenarios_are_not_compared() {
    let one = Sample::default().run();
    let mut other = one.clone();
    other.path = Some(2);
    assert!(matches!(
        Difference::between(&one, &other, 0.0),
        Err(CompareError::Scenario(..))
    ));
}
