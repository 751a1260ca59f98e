//! Any node may restart or lose its power at any moment: the facts that it has learnt are in its flash.

use site::{Action, Scenario};

use crate::network::yard::{
    COORDINATOR, OTHERS, TARGET, Yard, assert_all_calibrated, assert_nothing_forgotten, logged,
    moments, node, run, with,
};

fn yard() -> Scenario {
    Yard::default().scenario(11)
}

fn survives(scenario: Scenario, what: &str) {
    let (record, log) = logged(scenario);
    assert_all_calibrated(&record, what);
    assert_nothing_forgotten(&log, what);
}

/// One run for each moment.
fn each_moment(what: &str, action: impl Fn() -> Action) {
    for at in moments(&run(yard())) {
        survives(with(yard(), at, action()), &format!("{what} at {at}"));
    }
}

fn restarts(node: u16) {
    each_moment(&format!("restart of node {node}"), || Action::Restart {
        node,
    });
}

#[test]
fn the_coordinator_restarts() {
    restarts(COORDINATOR);
}

#[test]
fn the_first_reference_restarts() {
    restarts(1);
}

#[test]
fn the_second_reference_restarts() {
    restarts(2);
}

#[test]
fn a_camera_restarts() {
    restarts(3);
}

/// If it stands, it goes on from its place. If it walks, it is lost, and found again by calibrated
/// cameras, or the references begin anew.
#[test]
fn the_target_restarts() {
    restarts(TARGET);
}

#[test]
fn a_target_without_power_for_a_while() {
    each_moment("power cut of the target", || Action::PowerCut {
        node: TARGET,
        for_s: 7.0,
        in_flash_write: false,
    });
}

#[test]
fn everybody_restarts_at_once() {
    for at in moments(&run(yard())) {
        let all = [COORDINATOR, 1, 2, 3, 4, 5, TARGET];
        let scenario = all.into_iter().fold(yard(), |scenario, node| {
            with(scenario, at, Action::Restart { node })
        });
        survives(scenario, &format!("restart of all at {at}"));
    }
}

/// The word or page under way keeps some of its bits.
#[test]
fn power_cuts_in_the_middle_of_flash_writes() {
    for node in [COORDINATOR, 1, 2, TARGET].into_iter().chain(OTHERS) {
        let moments = moments(&run(yard()));
        for at in std::iter::once(&0.0).chain(moments.iter().step_by(3)) {
            let cut = Action::PowerCut {
                node,
                for_s: 2.0,
                in_flash_write: true,
            };
            let what = format!("torn write of node {node} at {at}");
            survives(with(yard(), *at, cut), &what);
        }
    }
}

/// Nothing is known about its carrier, so that poses are as good as all measurements together. After a
/// restart at a stop or on the way, the target goes on from all of them: cameras become as sure as
/// without a restart, except for the one leg that was not measured.
#[test]
fn the_joint_estimate_goes_on_after_a_restart_of_the_target() {
    let yard = Yard {
        systematic: ("2.0", "0.05"),
        ..Yard::default()
    };
    let calm = run(yard.scenario(11));
    let (mut ratios, mut count) = (0.0, 0);
    for at in moments(&calm).into_iter().skip(3) {
        let record = run(with(
            yard.scenario(11),
            at,
            Action::Restart { node: TARGET },
        ));
        let what = format!("restart at {at}");
        assert_all_calibrated(&record, &what);
        for id in OTHERS {
            let sigma = |record| node(record, id).estimate.as_ref().unwrap().sigma_position();
            let ratio = sigma(&record) / sigma(&calm);
            println!("{what}: camera {id}: {ratio:.3} of {:.4}", sigma(&calm));
            assert!(ratio < 1.2, "{what}: camera {id}: {ratio}");
            ratios += ratio;
            count += 1;
        }
    }
    let mean = ratios / f64::from(count);
    assert!(mean < 1.05, "{mean}");
}

/// A target that lost its place goes on counting stops, and cameras find it.
#[test]
fn a_lost_target_is_found_by_calibrated_cameras() {
    let calm = run(yard());
    let stops = &calm.targets[0].stops;
    // On the way from the sixth stop to the seventh: all are calibrated.
    let at = f64::midpoint(stops[5].seconds.unwrap(), stops[6].seconds.unwrap());
    let record = run(with(yard(), at, Action::Restart { node: TARGET }));
    assert_all_calibrated(&record, "restart on the way");
    let last = record.targets[0].stops.last().unwrap();
    let believed = last.believed.expect("it was found again");
    let error = (believed.x - last.x).hypot(believed.y - last.y);
    assert!(error <= 4.0 * believed.sigma_x.hypot(believed.sigma_y));
    assert_eq!(record.targets[0].stops.len(), stops.len());
}
