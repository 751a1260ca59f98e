//! Rounds in slices: the same answers as at one stretch, whatever comes in between.

use calib_core::{
    Refusal,
    joint::{Finding, JointError, JointSolution, Progress, Round},
};
use test_support::{
    generator,
    walk::{CarrierErrors, Walk},
};

use crate::joint::support::{Joint, WIDE, add, filled};

const ALL: Round = Round {
    findings: 8,
    leg_noise: true,
    protection: true,
};

/// Lengths of walks of which a pass is one slice, and several.
const LENGTHS: [usize; 2] = [20, 60];

/// With a bearing that is wrong by six degrees.
fn walk(seed: u64, stops: usize) -> Walk {
    let mut walk = Walk::random(
        &mut generator(seed),
        9,
        stops,
        CarrierErrors::UNKNOWN,
        0.0024,
    );
    let seen = walk.bearings.iter_mut().rev().find(|seen| seen.camera >= 2);
    seen.unwrap().bearing += 0.1;
    walk
}

fn begun(walk: &Walk, stops: usize) -> Joint<f64> {
    let mut part = walk.clone();
    part.places.truncate(stops);
    filled(&part, WIDE)
}

fn finish(joint: &mut Joint<f64>) -> (Vec<Finding<f64>>, JointSolution<f64>, usize) {
    let mut found = Vec::new();
    for slices in 1..4000 {
        match joint.step().unwrap() {
            Progress::Working => {}
            Progress::Found(finding) => found.push(finding),
            Progress::Over(solution) => return (found, solution, slices),
        }
    }
    panic!("no end");
}

/// Largest difference of a pose, in sigmas of `a`, and of a protection level, relative.
fn difference(a: &mut Joint<f64>, b: &mut Joint<f64>) -> f64 {
    let mut worst = 0.0_f64;
    for camera in 0..9 {
        let (a_pose, b_pose) = (a.pose(camera), b.pose(camera));
        assert_eq!(a_pose.is_ok(), b_pose.is_ok(), "camera {camera}");
        let (Ok(a_pose), Ok(b_pose)) = (a_pose, b_pose) else {
            continue;
        };
        if camera >= 2 {
            let off = (a_pose.position - b_pose.position).norm();
            worst = worst.max(off / a_pose.sigma_position());
            let [a, b] = [&*a, &*b].map(|joint| joint.protection(camera).unwrap());
            for (a, b) in [
                (a.position_bearing, b.position_bearing),
                (a.heading_leg, b.heading_leg),
            ] {
                worst = worst.max((a / b - 1.0).abs());
            }
        }
    }
    worst
}

#[test]
fn slices_are_the_same_as_one_stretch() {
    for (seed, stops) in (0..8).flat_map(|seed| LENGTHS.map(|stops| (seed, stops))) {
        let walk = walk(seed, stops);
        let (mut sliced, mut whole) = (begun(&walk, stops), begun(&walk, stops));
        sliced.begin(ALL);
        let (found, solution, slices) = finish(&mut sliced);
        // Each stop is looked at once more for each finding, and passes are one by one, or each in three slices at least.
        let of_pass = if stops == LENGTHS[0] { 1 } else { 3 };
        let least = of_pass * solution.passes + 20 * (1 + found.len());
        assert!(slices > least, "{seed} {stops}: {slices} of {least}");

        whole.solve().unwrap();
        let mut found_whole = Vec::new();
        while let Some(finding) = whole.check().unwrap() {
            found_whole.push(finding);
        }
        whole.fit_leg_noise().unwrap();
        whole.protect().unwrap();
        assert_eq!(found.len(), found_whole.len(), "{seed}");
        let off = difference(&mut sliced, &mut whole);
        assert!(off < 1e-2, "{seed}: {off:e}");
        // And again.
        assert_eq!(sliced.step(), Ok(Progress::Over(solution)));
    }
}

/// As on a node: stops and bearings come while a round is under way, and count from the next one on.
#[test]
fn what_comes_in_between_counts_later() {
    for (seed, stops) in [0, 1, 2, 3, 4, 5, 0, 1]
        .into_iter()
        .zip([20, 20, 20, 20, 20, 20, 60, 60])
    {
        let walk = walk(seed, stops);
        let begins_with = stops - 10;
        let mut whole = begun(&walk, stops);
        whole.begin(ALL);
        finish(&mut whole);

        for every in [1, 7, 40] {
            let (mut first, mut joint) = (begun(&walk, begins_with), begun(&walk, begins_with));
            joint.begin(ALL);
            first.begin(ALL);
            let mut next = begins_with;
            for slice in 0..4000 {
                if slice % every == 0 && next < stops {
                    add(&mut joint, &walk, next);
                    next += 1;
                }
                if let Progress::Over(_) = joint.step().unwrap() {
                    break;
                }
            }
            assert!(!joint.is_under_way());
            finish(&mut first);
            assert_eq!(difference(&mut first, &mut joint), 0.0, "{seed} {every}");
            assert_eq!(joint.place(next - 1).is_ok(), next == begins_with);
            for stop in next..stops {
                add(&mut joint, &walk, stop);
            }
            joint.begin(ALL);
            finish(&mut joint);
            let off = difference(&mut whole, &mut joint);
            assert!(off < 2e-2, "{seed} {every}: {off:e}");
        }
    }
}

/// A round that is given up leaves nothing behind.
#[test]
fn a_round_may_begin_again_at_any_time() {
    for stops in LENGTHS {
        let walk = walk(3, stops);
        let mut whole = begun(&walk, stops);
        whole.begin(ALL);
        let (_, _, slices) = finish(&mut whole);
        for after in (1..slices).step_by(stops / 4) {
            // The last stop comes meanwhile.
            let mut joint = begun(&walk, stops - 1);
            joint.begin(ALL);
            for _ in 0..after {
                joint.step().unwrap();
                if !joint.is_under_way() {
                    break;
                }
                assert_eq!(joint.pose(2), Err(Refusal::DidNotConverge));
                assert_eq!(joint.carrier(), Err(Refusal::DidNotConverge));
                assert_eq!(
                    joint.check(),
                    Err(JointError::Solve(Refusal::DidNotConverge))
                );
            }
            add(&mut joint, &walk, stops - 1);
            joint.begin(ALL);
            finish(&mut joint);
            let off = difference(&mut whole, &mut joint);
            assert!(off < 2e-2, "after {after} of {stops}: {off:e}");
        }
    }
}

#[test]
fn a_round_without_a_frame_ends_with_why() {
    let walk = walk(1, 20);
    let mut joint = begun(&walk, 2);
    assert_eq!(joint.step(), Err(JointError::Solve(Refusal::TooFew)));
    joint.begin(ALL);
    let mut ended = Ok(Progress::Working);
    for _ in 0..20 {
        ended = joint.step();
        if ended.is_err() {
            break;
        }
    }
    assert_eq!(ended, Err(JointError::Start(Refusal::TooFew)));
    assert!(!joint.is_under_way());
    // More stops, and it has one.
    for stop in 2..8 {
        add(&mut joint, &walk, stop);
    }
    joint.begin(Round::default());
    finish(&mut joint);
    assert!(joint.carrier().is_ok());
}
