//! Planted faults are found and named; without one nothing is thrown out.

use calib_core::{
    Limits,
    angle::wrap_signed,
    joint::{Finding, JointError, Progress, Round, Standing},
};
use nalgebra::Point2;
use test_support::{
    Random, generator,
    walk::{CarrierErrors, Visited, Walk},
};

use crate::joint::support::{CAMERAS, Joint, add, filled, filled_without_legs};

const LIMITS: Limits<f64> = Limits {
    position: 0.5,
    heading: 0.087,
};
const WALKS: u64 = 40;

/// There and back, so that every leg is checked by something.
fn walk(seed: u64) -> Walk {
    let errors = CarrierErrors::UNKNOWN;
    let there = Walk::random(&mut generator(seed), 8, 14, errors, 0.0024);
    let mut places = there.places.clone();
    places.extend(there.places.iter().rev().skip(1));
    let mut rng: Random = generator(seed ^ 0xbacc);
    Walk::measured(&mut rng, there.cameras, places, errors, 0.0024)
}

/// A camera that is seen often before and after the middle of the walk.
fn often_seen(walk: &Walk) -> Option<usize> {
    let middle = walk.places.len() / 2;
    (2..walk.cameras.len()).find(|&camera| {
        let stops = { walk.bearings.iter() }.filter(|seen| seen.camera == camera);
        let before = stops.clone().filter(|seen| seen.stop < middle).count();
        before >= 5 && stops.count() >= before + 5
    })
}

/// All that is found, one after the other.
fn check(joint: &mut Joint<f32>) -> Vec<Finding<f32>> {
    let mut found = Vec::new();
    while let Some(finding) = joint.check().unwrap() {
        found.push(finding);
        assert!(found.len() < 40, "{found:?}");
    }
    joint.solve().unwrap();
    found
}

/// Cameras, but for one, that are more than five sigmas off.
fn wrong(joint: &mut Joint<f32>, walk: &Walk, but: usize) -> usize {
    let cameras = walk.cameras.iter().enumerate().skip(2);
    let wrong = cameras.filter(|(n, truth)| {
        let Ok(pose) = joint.pose(*n) else {
            return false;
        };
        let nees = pose.normalised_error(truth.position().cast(), truth.heading as f32);
        *n != but && nees.unwrap() > 30.0
    });
    wrong.count()
}

#[test]
fn nothing_is_thrown_out_without_reason() {
    let mut findings = 0;
    for seed in 0..WALKS {
        let walk = walk(seed);
        let mut joint = filled::<f32>(&walk, LIMITS);
        joint.solve().unwrap();
        findings += check(&mut joint).len();
        assert_eq!(wrong(&mut joint, &walk, 0), 0, "{seed}");
    }
    // Some 80 bearings a walk, tested once in 100,000 each.
    assert!(findings <= 1, "{findings}");
}

#[test]
fn a_wrong_bearing_is_found() {
    let mut found = 0;
    for seed in 0..WALKS {
        let mut walk = walk(seed);
        let Some(camera) = often_seen(&walk) else {
            continue;
        };
        let n = walk
            .bearings
            .iter()
            .rposition(|seen| seen.camera == camera)
            .unwrap();
        walk.bearings[n].bearing += 0.1;
        let stop = walk.bearings[n].stop;
        let mut joint = filled::<f32>(&walk, LIMITS);
        joint.solve().unwrap();
        // By the consensus with which the camera was let in, or by the test.
        for finding in check(&mut joint) {
            assert!(
                matches!(finding, Finding::Bearing { camera: c, stop: s, .. } if (c, s) == (camera, stop)),
                "{seed}: {finding:?}"
            );
        }
        for other in 0..walk.bearings.len() {
            let Ok(residual) = joint.bearing_residual(other) else {
                continue;
            };
            let counts = residual.standing == Standing::Counts;
            let wrong = (residual.camera, residual.stop) == (camera, stop);
            assert!(counts != wrong, "{seed}: {residual:?}");
        }
        assert_eq!(wrong(&mut joint, &walk, 0), 0, "{seed}");
        found += 1;
    }
    assert!(found > 10);
}

/// Camera that stands for the first one that was moved.
const SPARE: usize = 8;

/// As a node sees it, stop after stop: the findings, and their stops. A camera that was moved is
/// another one from then on.
fn walked(walk: &Walk) -> (Joint<f32>, Vec<(usize, Finding<f32>)>) {
    let mut spare = SPARE;
    let nowhere = Walk {
        places: Vec::new(),
        ..walk.clone()
    };
    let mut joint = filled::<f32>(&nowhere, LIMITS);
    let mut found = Vec::new();
    for stop in 0..walk.places.len() {
        add(&mut joint, walk, stop);
        if let Err(JointError::Start(_)) = joint.solve() {
            continue;
        }
        for _ in 0..10 {
            let Some(finding) = joint.check().unwrap() else {
                break;
            };
            found.push((stop, finding));
            if let Finding::Camera { camera, from, .. } = finding {
                if joint.split(camera, from, spare).is_err() {
                    std::println!("{found:?}");
                }
                spare += 1;
            }
        }
    }
    let _settled = joint.solve();
    (joint, found)
}

/// Result of a fault campaign.
#[derive(Debug, Default)]
struct Campaign {
    walks: usize,
    /// Walks on which the faulty one was named.
    named: usize,
    /// Walks on which anything else was named too.
    slandered: usize,
    /// Other cameras with a pose, and those more than five sigmas off.
    others: usize,
    wrong: usize,
    /// Faulty cameras whose old pose is more than five sigmas off.
    spoiled: usize,
    /// Walks on which it was named at the second sighting after the fault, or at the first.
    within_two: usize,
    /// Cameras that stand for the faulty one since: the number with a pose, and the number of these that are
    /// more than five sigmas off.
    again: usize,
    again_wrong: usize,
}

/// Changes what `camera` sees from the middle on, as if it was turned, and walks.
fn campaign(turn: f64, fault: impl Fn(&mut Walk, usize, usize)) -> Campaign {
    let mut campaign = Campaign::default();
    for seed in 0..WALKS {
        let mut walk = walk(seed);
        let Some(camera) = often_seen(&walk) else {
            continue;
        };
        let middle = walk.places.len() / 2;
        fault(&mut walk, camera, middle);
        let (mut joint, found) = walked(&walk);
        campaign.walks += 1;
        // The last good bearing may go too.
        let before = { walk.bearings.iter() }
            .filter(|seen| seen.camera == camera && seen.stop < middle)
            .map(|seen| seen.stop);
        let least = before.max().unwrap();
        let named = found.iter().find(|(_, finding)| {
            matches!(finding, Finding::Camera { camera: c, from, .. } if *c == camera && *from >= least)
        });
        if let Some((stop, _)) = named {
            campaign.named += 1;
            let seen = walk
                .bearings
                .iter()
                .filter(|seen| seen.camera == camera && (middle..=*stop).contains(&seen.stop));
            campaign.within_two += usize::from(seen.count() <= 2);
        }
        let is_other = |finding: &Finding<f32>| match finding {
            Finding::Bearing { camera: c, .. }
            | Finding::Range { camera: c, .. }
            | Finding::Camera { camera: c, .. } => *c != camera,
            Finding::Leg { .. } => true,
        };
        campaign.slandered += usize::from(found.iter().any(|(_, finding)| is_other(finding)));
        campaign.others += (2..8)
            .filter(|&n| n != camera && joint.pose(n).is_ok())
            .count();
        campaign.wrong += wrong(&mut joint, &walk, camera);
        let truth = walk.cameras[camera];
        let mut nees = |camera: usize, heading: f64| {
            let pose = joint.pose(camera).ok()?;
            pose.normalised_error(truth.position().cast(), heading as f32)
        };
        campaign.spoiled += usize::from(nees(camera, truth.heading).is_some_and(|n| n > 30.0));
        for spare in SPARE..CAMERAS {
            if let Some(nees) = nees(spare, truth.heading + turn) {
                campaign.again += 1;
                campaign.again_wrong += usize::from(nees > 30.0);
            }
        }
    }
    campaign
}

/// Bumped by some degrees half way: named at once, and calibrated again from its later sightings.
#[test]
fn a_bumped_camera_is_named() {
    for degrees in [3.0_f64, 15.0] {
        let turn = degrees.to_radians();
        let campaign = campaign(turn, |walk, camera, middle| {
            for seen in &mut walk.bearings {
                if seen.camera == camera && seen.stop >= middle {
                    seen.bearing -= turn;
                }
            }
        });
        campaign.judge(0.95, 0.05);
        assert!(
            campaign.within_two * 10 >= campaign.walks * 9,
            "{campaign:?}"
        );
        assert!(campaign.again * 10 >= campaign.walks * 9, "{campaign:?}");
        assert!(campaign.again_wrong <= 1, "{campaign:?}");
    }
}

/// One that repeats its bearing from the middle on.
#[test]
fn a_stuck_camera_is_named() {
    let campaign = campaign(0.0, |walk, camera, middle| {
        let mut stuck = 0.0;
        for seen in { walk.bearings.iter_mut() }.filter(|seen| seen.camera == camera) {
            if seen.stop < middle {
                stuck = seen.bearing;
            } else {
                seen.bearing = stuck;
            }
        }
    });
    campaign.judge(0.95, 0.05);
    assert_eq!(campaign.again, 0, "{campaign:?}");
}

impl Campaign {
    fn judge(&self, named: f64, slandered: f64) {
        let share = |count: usize| count as f64 / self.walks as f64;
        std::println!("{self:?}");
        assert!(self.walks > 30, "{self:?}");
        assert!(share(self.named) >= named, "{self:?}");
        assert!(share(self.slandered) <= slandered, "{self:?}");
        assert!(share(self.spoiled) <= 0.1, "{self:?}");
        assert!(self.wrong * 100 <= self.others, "{self:?}");
    }
}

/// A step that was not counted, or twice: a leg half as long again as it was.
#[test]
fn a_slipped_leg_is_named() {
    let (mut named, mut slipped, mut bad, mut cameras) = (0, 0, 0, 0);
    for seed in 0..WALKS {
        let mut walk = walk(seed);
        let leg = 8 + seed as usize % 12;
        walk.legs[leg].displacement *= 1.5;
        let (mut joint, found) = walked(&walk);
        slipped += 1;
        named +=
            usize::from(found.iter().any(
                |(_, finding)| matches!(finding, Finding::Leg { stop, .. } if *stop == leg + 1),
            ));
        bad += wrong(&mut joint, &walk, 0);
        cameras += (2..8).filter(|&n| joint.pose(n).is_ok()).count();
    }
    assert!(named * 10 >= slipped * 9, "{named} of {slipped}");
    assert!(bad * 100 <= cameras, "{bad} of {cameras} cameras wrong");
}

/// The error that one fault leaves, noticed or not, is within the protection level.
#[test]
fn protection_levels_hold() {
    let (mut beyond, mut cameras, mut protected) = (0, 0, 0);
    for seed in 0..WALKS {
        for size in [0.0, 0.004, 0.008, 0.012, 0.02] {
            let mut walk = walk(seed);
            let n = (7 * seed as usize + (size * 1e4) as usize) % walk.bearings.len();
            walk.bearings[n].bearing += size;
            let mut joint = filled::<f32>(&walk, LIMITS);
            if joint.solve().is_err() {
                continue;
            }
            check(&mut joint);
            joint.protect().unwrap();
            for (n, truth) in walk.cameras.iter().enumerate().skip(2) {
                let Ok(pose) = joint.pose(n) else { continue };
                let level = joint.protection(n).unwrap();
                let off = (pose.position.cast::<f64>() - truth.position()).norm();
                assert!(f64::from(level.position_bearing) > 3.0 * f64::from(pose.sigma_position()));
                cameras += 1;
                protected += usize::from(level.position_bearing < 1.5);
                beyond += usize::from(off > f64::from(level.position_bearing));
            }
        }
    }
    assert_eq!(beyond, 0, "of {cameras}");
    assert!(
        protected * 2 > cameras,
        "{protected} of {cameras} have a level that means something"
    );
}

/// Legs that err twice as much as they claim are noticed.
#[test]
fn the_noise_of_legs_is_told_by_their_residuals() {
    for times in [1.0, 2.0] {
        let (mut sum, mut started) = (0.0, 0.0);
        for seed in 0..24 {
            let mut walk = walk(seed);
            walk.errors.length *= times;
            walk.errors.direction *= times;
            walk.carry(&mut generator(seed));
            for leg in &mut walk.legs {
                leg.covariance /= times * times;
            }
            let mut joint = filled::<f32>(&walk, LIMITS);
            if joint.solve().is_err() {
                continue;
            }
            sum += f64::from(joint.fit_leg_noise().unwrap()).ln();
            started += 1.0;
        }
        let mean = (sum / started).exp();
        assert!(started >= 24.0, "{times}: {started}");
        assert!((0.85..1.1).contains(&(mean / times)), "{times}: {mean}");
    }
}

/// A round that looks for findings and estimates the legs' noise. Returns true if it comes to an end.
fn ends(joint: &mut Joint<f32>) -> bool {
    joint.begin(Round {
        findings: 4,
        leg_noise: true,
        protection: false,
    });
    loop {
        match joint.step() {
            Ok(Progress::Over(_)) => return true,
            Ok(_) => {}
            Err(_) => return false,
        }
    }
}

/// A leg that was not measured cuts a walk in two, and the references do not see the second part. Both are placed all the
/// same, and all poses are right.
#[test]
fn a_walk_in_two_parts_has_a_start() {
    let (mut tried, mut placed, mut poses, mut off) = (0, 0, [0, 0], 0);
    for seed in 0..24 {
        for lost in (6..24).step_by(3) {
            tried += 1;
            let mut walk = walk(seed);
            walk.bearings
                .retain(|seen| seen.stop < lost || seen.camera >= 2);
            let mut joint = filled_without_legs::<f32>(&walk, LIMITS, &[lost]);
            if !ends(&mut joint) {
                continue;
            }
            let last = walk.places.len() - 1;
            if let Ok(place) = joint.place(last) {
                placed += 1;
                let error = (place.position.map(f64::from) - walk.places[last]).norm();
                off += usize::from(error > 5.0 * f64::from(place.sigma()));
            }
            poses[0] += right_poses(&mut joint, &walk, &mut off);
            let mut whole = filled::<f32>(&walk, LIMITS);
            assert!(ends(&mut whole), "{seed}, {lost}");
            poses[1] += right_poses(&mut whole, &walk, &mut off);
        }
    }
    assert_eq!(off, 0);
    assert!(placed >= tried - 2, "{placed} of {tried}");
    assert!(10 * poses[0] >= 9 * poses[1], "{poses:?}");
}

/// Two legs were not measured. A mark ties the last part to the one before it, which has its place only since the same
/// look.
#[test]
fn a_mark_ties_a_part_to_one_that_was_just_placed() {
    let mut off = 0;
    for seed in 0..24 {
        let mut walk = walk(seed);
        let (first, again) = (12, 20);
        walk.places[again] = walk.places[first];
        let mut rng: Random = generator(seed);
        walk = Walk::measured(&mut rng, walk.cameras, walk.places, walk.errors, 0.0024);
        for stop in [first, again] {
            let (mark, sigma) = (0, 0.01);
            walk.visits.push(Visited { stop, mark, sigma });
        }
        // References see the first part alone.
        walk.bearings
            .retain(|seen| seen.stop < 9 || seen.camera >= 2);
        let poses = [&[9, 18][..], &[]].map(|lost| {
            let mut joint = filled_without_legs::<f32>(&walk, LIMITS, lost);
            assert!(ends(&mut joint), "{seed}, {lost:?}");
            right_poses(&mut joint, &walk, &mut off)
        });
        assert!(poses[0] >= poses[1], "{seed}: {poses:?}");
    }
    assert_eq!(off, 0);
}

/// Number of cameras with a pose; adds those that err by more than 5 sigmas.
fn right_poses(joint: &mut Joint<f32>, walk: &Walk, off: &mut usize) -> usize {
    let found = (2..walk.cameras.len()).filter_map(|camera| {
        let pose = joint.pose(camera).ok()?;
        let truth = &walk.cameras[camera];
        let error = pose.position.map(f64::from) - Point2::new(truth.x, truth.y);
        *off += usize::from(error.norm() > 5.0 * f64::from(pose.sigma_position()));
        Some(())
    });
    found.count()
}

/// Legs that claim a fortieth of their errors have a start all the same. Their noise is told as far larger than they claim,
/// though not as large as it is: the claim counts, too.
#[test]
fn a_start_is_found_where_all_legs_err_by_far() {
    let (mut started, mut off_frame, mut sum) = (0, 0, 0.0);
    for seed in 0..24 {
        let mut walk = walk(seed);
        walk.errors.length *= 4.0;
        walk.errors.direction *= 4.0;
        walk.carry(&mut generator(seed));
        for leg in &mut walk.legs {
            leg.covariance /= 40.0 * 40.0;
        }
        let mut joint = filled::<f32>(&walk, LIMITS);
        if !ends(&mut joint) {
            continue;
        }
        started += 1;
        sum += f64::from(joint.leg_noise()).ln();
        let told = joint.reference_headings().unwrap();
        for (n, heading) in told.headings.into_iter().enumerate() {
            let off = wrap_signed(f64::from(heading) - walk.cameras[n].heading);
            off_frame += usize::from(off.abs() > 5.0 * f64::from(told.sigmas()[n]));
        }
    }
    assert!(started >= 22, "{started} of 24");
    assert_eq!(off_frame, 0);
    let noise = (sum / f64::from(started)).exp();
    assert!((8.0..44.0).contains(&noise), "{noise}");
}

/// A carrier who errs by far more than he claims is no reason to leave out what cameras saw.
#[test]
fn bearings_stay_where_all_legs_err() {
    let (mut left_out, mut all, mut started, mut coherent) = (0, 0, 0, 0);
    for seed in 0..24 {
        let mut walk = walk(seed);
        walk.errors.length *= 4.0;
        walk.errors.direction *= 4.0;
        walk.carry(&mut generator(seed));
        for leg in &mut walk.legs {
            leg.covariance /= 16.0;
        }
        let mut joint = filled::<f32>(&walk, LIMITS);
        if !ends(&mut joint) {
            continue;
        }
        started += 1;
        coherent += usize::from(!joint.is_selective(0));
        for camera in 0..walk.cameras.len() {
            let [came, counting] = joint.bearings_of(camera);
            all += came;
            left_out += came - counting;
        }
        // What the references saw contradicts the claim of the legs, and a frame is found all the same.
        let told = joint.reference_headings().unwrap();
        for (n, heading) in told.headings.into_iter().enumerate() {
            let off = wrap_signed(f64::from(heading) - walk.cameras[n].heading);
            let sigma = f64::from(told.sigmas()[n]);
            assert!(off.abs() < 5.0 * sigma, "{seed}: {off} of {sigma}");
        }
    }
    assert!(started >= 18, "{started}");
    assert_eq!(coherent, started);
    assert!(left_out * 100 < all, "{left_out} of {all}");
}

/// A camera of which the last two bearings are wrong, each in its own way: it may have been moved.
#[test]
fn a_camera_whose_last_bearings_are_left_out_may_have_been_moved() {
    let (mut told, mut walks) = (0, 0);
    for seed in 0..WALKS {
        let mut walk = walk(seed);
        let Some(camera) = often_seen(&walk) else {
            continue;
        };
        let mut joint = filled::<f32>(&walk, LIMITS);
        joint.solve().unwrap();
        check(&mut joint);
        assert!(!joint.is_selective(camera), "{seed}");
        let own = { walk.bearings.iter_mut() }.filter(|seen| seen.camera == camera);
        for (seen, off) in own.rev().zip([0.2, -0.15]) {
            seen.bearing += off;
        }
        let mut joint = filled::<f32>(&walk, LIMITS);
        joint.solve().unwrap();
        check(&mut joint);
        walks += 1;
        told += usize::from(joint.is_selective(camera) || joint.moved(camera).is_some());
    }
    assert!(walks > 30, "{walks}");
    assert!(told * 20 >= walks * 19, "{told} of {walks}");
}

/// Where a quarter of all bearings are wrong, what is left does not agree: it is few.
#[test]
fn too_much_that_is_left_out_is_told() {
    for (every, is_coherent) in [(usize::MAX, true), (12, true), (3, false)] {
        let mut walk = walk(1);
        for (n, seen) in walk.bearings.iter_mut().enumerate() {
            if seen.camera >= 2 && n % every == every - 1 {
                seen.bearing += if n % 2 == 0 { 0.3 } else { -0.4 };
            }
        }
        let mut joint = filled::<f32>(&walk, LIMITS);
        joint.solve().unwrap();
        check(&mut joint);
        assert_eq!(!joint.is_selective(0), is_coherent, "{every}");
        assert_eq!(joint.left_out() == [0, 0], every == usize::MAX);
    }
}
