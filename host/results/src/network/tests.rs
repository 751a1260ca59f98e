//! Walks that were made elsewhere, against the batch optimum and the truth.

use calib_core::{Status, angle::wrap_signed};
use nalgebra::{Point2, Vector2};
use test_support::{
    batch::Batch,
    chi_squared_band, generator, normal, turn,
    walk::{CarrierErrors, Visited, Walk},
};

use super::*;
use crate::record::sightings::{Bearing, Carrier as Known, Leg, Lens, Range, Visit};

const SIGMA: f64 = 0.0024;
const TARGET: u16 = 20;

/// Measurements of a walk: camera `n` has number `n + 1`, stop `n` number `n + 1`.
fn measured(walk: &Walk) -> Sightings {
    let bearings = walk.bearings.iter().map(|seen| Bearing {
        target: TARGET,
        stop: seen.stop as u32 + 1,
        camera: seen.camera as u16 + 1,
        bearing_deg: seen.bearing.to_degrees(),
        sigma_deg: seen.sigma.to_degrees(),
        elevation_deg: None,
    });
    let legs = (2..).zip(&walk.legs).map(|(stop, leg)| {
        let c = leg.covariance;
        Leg {
            target: TARGET,
            stop,
            dx: leg.displacement.x,
            dy: leg.displacement.y,
            covariance: [c.m11, c.m12, c.m22],
        }
    });
    Sightings {
        tilt_sigma_deg: 0.0,
        network: 1,
        references: Some(References {
            cameras: [1, 2],
            baseline: Some(walk.cameras[1].x),
        }),
        survey: None,
        frame_heading_deg: Some(0.0),
        carriers: vec![Known {
            target: TARGET,
            systematic_scale: walk.errors.scale,
            systematic_heading_deg: walk.errors.compass.to_degrees(),
            standing_sigma: 0.0,
        }],
        bearings: bearings.collect(),
        legs: legs.collect(),
        ranges: { walk.ranges.iter() }
            .map(|far| Range {
                target: TARGET,
                stop: far.stop as u32 + 1,
                camera: far.camera as u16 + 1,
                range: far.range,
                sigma: far.sigma,
            })
            .collect(),
        visits: { walk.visits.iter() }
            .map(|on| Visit {
                target: TARGET,
                stop: on.stop as u32 + 1,
                mark: on.mark as u32 + 70,
                sigma: on.sigma,
            })
            .collect(),
        lens: (walk.lens_sigma > 0.0).then_some(Lens {
            sigma: walk.lens_sigma,
            fov_deg: Some(60.0),
            principal_deg: 0.0,
        }),
    }
}

fn solved(sightings: &Sightings) -> NetworkSolution {
    let mut all = solve(sightings, &Settings::default()).unwrap();
    assert_eq!(all.len(), 1);
    all.remove(0)
}

fn walk(seed: u64) -> Walk {
    Walk::random(&mut generator(seed), 9, 20, CarrierErrors::UNKNOWN, SIGMA)
}

/// Walked back to places of before, with distances to cameras, through lenses as they are sold.
fn walk_with_more(seed: u64) -> Walk {
    const LENSES: f64 = 0.02;
    let mut rng = generator(seed);
    let there = walk(seed);
    let back = there.places.iter().rev().skip(1).step_by(4);
    let places: Vec<_> = there.places.iter().chain(back).copied().collect();
    let on_mark = |mark: usize| {
        let (stops, own_place) = (places.iter().enumerate(), there.places[mark]);
        let own = stops.filter(move |(_, place)| **place == own_place);
        own.map(move |(stop, _)| Visited {
            stop,
            mark: mark / 4,
            sigma: 0.01,
        })
    };
    let mut visits: Vec<_> = (2..19).step_by(4).flat_map(on_mark).collect();
    visits.sort_by_key(|on| on.stop);
    assert!(visits.len() > 8, "{visits:?}");
    let cameras = there.cameras.clone();
    let mut walk = Walk::measured(&mut rng, cameras, places, CarrierErrors::UNKNOWN, SIGMA);
    walk.visits = visits;
    walk.range(&mut rng, 0.03);
    for camera in 0..walk.cameras.len() {
        walk.look_through(camera, 1.0 + LENSES * normal(&mut rng), 0.0);
    }
    walk.lens_sigma = LENSES;
    walk
}

#[test]
fn a_walk_is_solved_as_the_batch_does() {
    let walks = (0..6).map(walk).chain((0..6).map(walk_with_more));
    for (seed, walk) in walks.enumerate() {
        let solution = solved(&measured(&walk));
        assert_eq!(solution.status, Status::Calibrated, "{seed}");
        let posed = |n: usize| solution.cameras[n].estimate.is_some();
        let prior = [walk.errors.scale, walk.errors.compass];
        let batch = Batch::solve(&walk, prior, posed).unwrap();
        for (n, camera) in solution.cameras.iter().enumerate().skip(2) {
            let Some(estimate) = camera.estimate else {
                continue;
            };
            let (expected, covariance) = batch.camera(n).unwrap();
            let pose = estimate.pose();
            let off = [
                pose.position.x - expected.x,
                pose.position.y - expected.y,
                turn(pose.heading, expected.z),
            ];
            for (i, off) in off.into_iter().enumerate() {
                let sigma = covariance[(i, i)].sqrt();
                assert!(
                    off.abs() < 1e-2 * sigma,
                    "{seed}, camera {n}: {off} of {sigma}"
                );
                let own = pose.covariance[(i, i)].sqrt();
                assert!(
                    (own / sigma - 1.0).abs() < 1e-2,
                    "{seed}, camera {n}: {own}, {sigma}"
                );
            }
        }
        for (n, stop) in solution.stops.iter().enumerate() {
            let (expected, covariance) = batch.stop(n);
            let off = (stop.x - expected.x).hypot(stop.y - expected.y);
            assert!(
                off < 1e-2 * covariance.trace().sqrt(),
                "{seed}, stop {n}: {off}"
            );
        }
        assert_eq!(
            solution.bearings.len(),
            { walk.bearings.iter() }
                .filter(|seen| posed(seen.camera))
                .count()
        );
        assert_eq!(solution.legs.len(), walk.legs.len());
        let ranges = walk.ranges.iter().filter(|far| posed(far.camera));
        assert_eq!(solution.ranges.len(), ranges.count());
        for (n, camera) in solution.cameras.iter().enumerate() {
            // Where a bearing is its own judge, an error of it may be of any size.
            let blind = camera.redundancy.is_some_and(|share| share < 1e-3);
            assert!(!(camera.checked && blind), "{seed}, {n}: {camera:?}");
            assert!(walk.lens_sigma > 0.0 || camera.lens.is_none());
            if let Some(lens) = camera.lens.filter(|_| posed(n)) {
                let (scale, variance) = batch.lens(n);
                let sigma = variance.sqrt();
                assert!((lens.factor - scale).abs() < 1e-2 * sigma, "{seed}, {n}");
                assert!((lens.sigma / sigma - 1.0).abs() < 1e-2, "{seed}, {n}");
                let view = 2.0 * (scale * 30_f64.to_radians().tan()).atan();
                assert!((lens.fov_deg.unwrap() - view.to_degrees()).abs() < 0.01);
            }
        }
    }
}

/// A lens that is a fifth off the given one is named, others are not.
#[test]
fn another_lens_is_named_and_its_width_told() {
    let (mut named, mut others, mut all) = (0, 0, 0);
    for seed in 0..12 {
        let mut walk = walk_with_more(seed);
        let camera = (2..9).max_by_key(|&camera| walk.seen_by(camera)).unwrap();
        walk.look_through(camera, 1.2, 0.0);
        let solution = solved(&measured(&walk));
        for (n, told) in solution.cameras.iter().enumerate() {
            let is_wrong = told.lens.is_some_and(|lens| lens.wrong);
            if n == camera {
                all += 1;
                named += usize::from(is_wrong && told.status != Status::Calibrated);
            } else {
                others += usize::from(is_wrong);
            }
        }
    }
    assert!(10 * named >= 9 * all, "{named} of {all}");
    assert!(others <= 1, "{others} others");
}

/// Nothing but a mark ties the second half of a walk to the first.
#[test]
fn a_mark_that_is_visited_again_ties_a_walk_together() {
    let mut tied = 0;
    for seed in 0..8 {
        let mut walk = walk(seed);
        walk.bearings.retain(|seen| seen.stop < 11);
        walk.places[11] = walk.places[4];
        walk.visits = [4, 11]
            .map(|stop| Visited {
                stop,
                mark: 0,
                sigma: 0.01,
            })
            .to_vec();
        walk.carry(&mut generator(seed));
        let mut sightings = measured(&walk);
        sightings.legs.retain(|leg| leg.stop != 12);
        let solution = solved(&sightings);
        let Some(last) = solution.stops.iter().find(|stop| stop.stop == 20) else {
            continue;
        };
        tied += 1;
        let truth = walk.places[19];
        let off = (last.x - truth.x).hypot(last.y - truth.y);
        assert!(
            off < 5.0 * last.sigma_x.hypot(last.sigma_y),
            "{seed}: {off}"
        );
        sightings.visits.remove(0);
        let loose = solved(&sightings);
        assert!(loose.left_out.contains(&20), "{seed}");
    }
    assert!(tied >= 7, "{tied} of 8");
}

/// Squared errors of all poses over the predicted ones, and the number of values.
fn nees(walk: &Walk, solution: &NetworkSolution) -> (f64, usize) {
    let (mut sum, mut count) = (0.0, 0);
    for (camera, truth) in solution.cameras.iter().zip(&walk.cameras) {
        if let Some(estimate) = camera.estimate.filter(|_| !camera.reference) {
            let pose = estimate.pose();
            sum += pose
                .normalised_error(truth.position(), truth.heading)
                .unwrap();
            count += 3;
        }
    }
    (sum, count)
}

#[test]
fn without_a_baseline_the_carrier_sets_the_scale() {
    let (mut poses, mut numbers) = (0.0, 0);
    let (mut baselines, mut stops, mut runs) = (0.0, 0.0, 0);
    for seed in 0..40 {
        let walk = walk(seed);
        let mut sightings = measured(&walk);
        sightings.references.as_mut().unwrap().baseline = None;
        let solution = solved(&sightings);
        assert_eq!(solution.scale_from, ScaleFrom::Carrier);
        assert_eq!(solution.status, Status::Calibrated, "{seed}");
        let (own, count) = nees(&walk, &solution);
        poses += own;
        numbers += count;
        let off = solution.baseline.unwrap() - walk.cameras[1].x;
        baselines += (off / solution.sigma_baseline.unwrap()).powi(2);
        let (last, truth) = (solution.stops.last().unwrap(), walk.places.last().unwrap());
        let off = Vector2::new(last.x - truth.x, last.y - truth.y);
        let [xx, xy, yy] = last.covariance;
        let information = nalgebra::Matrix2::new(xx, xy, xy, yy)
            .try_inverse()
            .unwrap();
        stops += off.dot(&(information * off));
        runs += 1;
        // The carrier's scale cannot be known then.
        let carrier = solution.carrier.unwrap();
        assert_eq!((carrier.scale, carrier.sigma_scale), (1.0, 0.05));
    }
    let runs = f64::from(runs);
    assert!(
        chi_squared_band(runs).contains(&baselines),
        "{baselines} of {runs}"
    );
    assert!(
        chi_squared_band(2.0 * runs).contains(&stops),
        "{stops} of {runs} stops"
    );
    // Cameras of a walk share its scale: a third of the numbers is independent.
    let band = chi_squared_band(numbers as f64 / 3.0);
    assert!(band.contains(&(poses / 3.0)), "{poses} of {numbers}");
}

/// It is not known how the target came to a stop in the middle; its carrier may have been anywhere.
#[test]
fn a_walk_goes_on_after_a_gap() {
    let (mut sum, mut count, mut after) = (0.0, 0, 0);
    for seed in 0..20 {
        let walk = walk(seed);
        let whole = solved(&measured(&walk));
        let mut sightings = measured(&walk);
        sightings.legs.retain(|leg| leg.stop != 11);
        let solution = solved(&sightings);
        assert_eq!(solution.status, Status::Calibrated, "{seed}");
        after += usize::from(solution.left_out.is_empty());
        let (own, numbers) = nees(&walk, &solution);
        sum += own;
        count += numbers;
        if solution.left_out.is_empty() {
            // Two numbers were not measured.
            assert!(solution.degrees_of_freedom <= whole.degrees_of_freedom - 2);
            assert_eq!(solution.legs.len(), whole.legs.len() - 1);
        }
    }
    assert!(after >= 16, "{after} of 20 went on");
    assert!(sum / (count as f64) < 1.5, "{sum} of {count}");
}

/// The ways to all later stops were not measured, and a camera was put up only then: other cameras tell where the
/// target stood when it came into view.
#[test]
fn a_camera_that_was_put_up_after_the_last_measured_way_has_a_pose() {
    let (mut sum, mut count, mut posed) = (0.0, 0, 0);
    for seed in 0..10 {
        let walk = walk(seed);
        let mut sightings = measured(&walk);
        let late = |camera: u16| {
            let of = sightings.bearings.iter();
            of.filter(|seen| seen.camera == camera && seen.stop > 8)
                .count()
        };
        let camera = (3..=9).max_by_key(|camera| late(*camera)).unwrap();
        sightings.legs.retain(|leg| leg.stop <= 8);
        let is_there = |stop: u32, of: u16| of != camera || stop > 8;
        sightings
            .bearings
            .retain(|seen| is_there(seen.stop, seen.camera));
        let solution = solved(&sightings);
        let (own, numbers) = nees(&walk, &solution);
        sum += own;
        count += numbers;
        let found = solution.cameras.iter().find(|found| found.camera == camera);
        posed += usize::from(found.unwrap().estimate.is_some());
    }
    assert!(posed >= 8, "{posed} of 10");
    assert!(sum / (count as f64) < 1.5, "{sum} of {count}");
}

#[test]
fn what_contradicts_is_named_and_left_out() {
    for seed in 0..6 {
        let walk = walk(seed);
        let sightings = measured(&walk);
        let whole = solved(&sightings);
        let checked = |left: &&BearingResidual| left.redundancy > 0.5 && left.camera > 2;
        let Some(wrong) = whole.bearings.iter().find(checked).copied() else {
            panic!("{seed}: nothing is checked");
        };
        let mut sightings = sightings;
        for seen in &mut sightings.bearings {
            if (seen.stop, seen.camera) == (wrong.stop, wrong.camera) {
                seen.bearing_deg += 5.0;
            }
        }
        let solution = solved(&sightings);
        let names = |finding: &Finding| match *finding {
            Finding::Bearing {
                stop, camera, off, ..
            } => (stop, camera) == (wrong.stop, wrong.camera) && off.abs() > 4.0,
            Finding::Camera { camera, .. } => camera == wrong.camera,
            Finding::Range { .. } | Finding::Leg { .. } => false,
        };
        let excluded = { solution.bearings.iter() }.any(|left| {
            (left.stop, left.camera) == (wrong.stop, wrong.camera) && left.standing != "counts"
        });
        assert!(
            solution.findings.iter().any(names) || excluded,
            "{seed}: {:?}",
            solution.findings
        );
        assert!(solution.is_good(), "{seed}: {:?}", solution.reason);
    }
}

/// A camera that hangs upside down has bearings of the other sign. A pose of some of them is found by chance.
#[test]
fn a_camera_upside_down_is_not_believed_and_named() {
    let (mut cameras, mut named, mut deceived) = (0, 0, 0);
    let (mut others, mut doubted) = (0, 0);
    for seed in 0..40 {
        let walk = Walk::random(
            &mut generator(seed),
            7,
            if seed % 2 == 0 { 8 } else { 14 },
            CarrierErrors::DRIFT,
            0.004,
        );
        let Some(turned) = (2..7).find(|&camera| walk.seen_by(camera) >= 5) else {
            continue;
        };
        let mut sightings = measured(&walk);
        let id = turned as u16 + 1;
        for seen in sightings
            .bearings
            .iter_mut()
            .filter(|seen| seen.camera == id)
        {
            seen.bearing_deg = -seen.bearing_deg;
        }
        let solution = solved(&sightings);
        let told = { solution.cameras.iter() }.find(|camera| camera.camera == id);
        let told = told.unwrap();
        cameras += 1;
        named += usize::from(told.mirrored);
        if let Some(estimate) = told.estimate
            && told.status != Status::Doubtful
        {
            let off = estimate.pose().position - walk.cameras[turned].position();
            let sigma = estimate.pose().sigma_position();
            deceived += usize::from(off.norm() > 5.0 * sigma);
        }
        for other in solution.cameras.iter().filter(|other| other.camera != id) {
            assert!(!other.mirrored, "{seed}");
            others += 1;
            doubted += usize::from(other.reason == Some(NetworkSolution::AMBIGUOUS));
        }
    }
    println!("{doubted} of {others} others fit as well exchanged");
    println!("{named} of {cameras} are named, {deceived} are believed");
    // Few bearings of a camera fit some pose exchanged or not, and such a pose is doubtful.
    assert_eq!(deceived, 0, "of {cameras}");
    assert!(doubted * 50 <= others, "{doubted} of {others} others");
    assert!(
        cameras > 30 && named * 10 >= cameras * 7,
        "{named} of {cameras}"
    );
}

/// Directions that nothing ties to the baseline turn the carrier, not the cameras.
#[test]
fn a_frame_heading_that_is_not_known_is_found() {
    for seed in 0..4 {
        let walk = walk(seed);
        let mut sightings = measured(&walk);
        let angle = 0.4_f64;
        for leg in &mut sightings.legs {
            let way = nalgebra::Rotation2::new(-angle) * Vector2::new(leg.dx, leg.dy);
            (leg.dx, leg.dy) = (way.x, way.y);
            let spread = leg.covariance[0].max(leg.covariance[2]);
            leg.covariance = [spread, 0.0, spread];
        }
        for known in [None, Some(angle.to_degrees())] {
            sightings.frame_heading_deg = known;
            let solution = solved(&sightings);
            assert!(solution.is_good(), "{seed}: {:?}", solution.advice);
            let carrier = solution.carrier.unwrap();
            let off = wrap_signed(carrier.compass_deg.to_radians() + angle - walk.carrier[1]);
            let sigma = carrier.sigma_compass_deg.to_radians();
            assert!(off.abs() < 5.0 * sigma, "{seed}: {off} of {sigma}");
        }
    }
}

#[test]
fn each_target_has_its_own_answer() {
    let (first, second) = (walk(1), walk(1));
    let mut sightings = measured(&first);
    let mut other = measured(&second);
    for seen in &mut other.bearings {
        seen.target = 21;
    }
    for leg in &mut other.legs {
        leg.target = 21;
    }
    sightings.bearings.extend(other.bearings);
    sightings.legs.extend(other.legs);
    let all = solve(&sightings, &Settings::default()).unwrap();
    assert_eq!(
        all.iter().map(|one| one.target).collect::<Vec<_>>(),
        [Some(20), Some(21)]
    );
    // Nothing was told of the second carrier: he is as vague as targets assume.
    let [ours, theirs] = [&all[0], &all[1]].map(|one| one.carrier.unwrap().sigma_scale);
    assert!(theirs > ours);
}

fn range(range: f64) -> Range {
    Range {
        target: TARGET,
        stop: 1,
        camera: 3,
        range,
        sigma: 0.1,
    }
}

/// A file that is in it twice is as good as once.
/// A baseline of another unit: all fits, in a frame that the steps contradict.
#[test]
fn a_baseline_that_the_steps_contradict_is_doubted() {
    for seed in 0..4 {
        for (factor, is_doubted) in [(1.0, false), (10.0, true), (0.1, true)] {
            let mut sightings = measured(&walk(seed));
            *sightings
                .references
                .as_mut()
                .unwrap()
                .baseline
                .as_mut()
                .unwrap() *= factor;
            let solution = solved(&sightings);
            let is_its = solution.reason == Some(NetworkSolution::BASELINE);
            assert_eq!(
                is_its, is_doubted,
                "{seed}, {factor}: {:?}",
                solution.reason
            );
            let cameras = solution.cameras.iter();
            let good = cameras.filter(|camera| camera.status == Status::Calibrated);
            assert_eq!(good.count() == 0, is_doubted, "{seed}, {factor}");
        }
    }
}

#[test]
fn repeated_bearings_count_once() {
    let once = measured(&walk(3));
    let mut twice = once.clone();
    twice.bearings.extend(once.bearings.clone());
    assert_eq!(leave_out_repeated(&mut twice), once.bearings.len());
    assert_eq!(solved(&twice), solved(&once));
    // Another value is another look.
    let mut again = once.bearings[0];
    again.bearing_deg += 0.1;
    twice.bearings.push(again);
    assert_eq!(leave_out_repeated(&mut twice), 0);
}

#[test]
fn measurements_without_an_answer_say_why() {
    let whole = measured(&walk(3));
    let cut = |most: u32| {
        let mut sightings = whole.clone();
        sightings.bearings.retain(|seen| seen.stop <= most);
        sightings.legs.retain(|leg| leg.stop <= most);
        sightings
    };
    let solution = solved(&cut(2));
    assert_eq!(solution.status, Status::Waiting);
    assert!(solution.advice.unwrap().contains("three places"));
    // The walk falls apart before both references saw enough of it.
    let mut apart = cut(4);
    apart.legs.retain(|leg| leg.stop != 2 && leg.stop != 4);
    let advice = solved(&apart).advice.unwrap();
    assert!(
        advice.ends_with("stops before it and after it") && advice.contains("stop 2, 4"),
        "{advice}"
    );
    let mut blind = whole.clone();
    blind.bearings.retain(|seen| seen.camera != 2);
    let advice = solved(&blind).advice.unwrap();
    assert!(
        advice.ends_with("camera 2, a reference, has no bearing"),
        "{advice}"
    );
    let refused = |change: fn(&mut Sightings)| {
        let mut sightings = whole.clone();
        change(&mut sightings);
        solve(&sightings, &Settings::default())
            .unwrap_err()
            .to_string()
    };
    for (message, expected) in [
        (refused(|s| s.bearings.clear()), "has no bearings"),
        (refused(|s| s.references = None), "--references"),
        (
            refused(|s| s.references.as_mut().unwrap().cameras = [2, 2]),
            "camera 2 as both",
        ),
        (
            refused(|s| s.bearings[0].sigma_deg = 0.0),
            "its sigma above 0",
        ),
        (
            refused(|s| s.legs[0].covariance = [1.0, 2.0, 1.0]),
            "covariance",
        ),
        (
            refused(|s| s.legs.push(s.legs[0])),
            "has two displacements: correct it",
        ),
        (
            refused(|s| s.references.as_mut().unwrap().baseline = Some(-1.0)),
            "baseline",
        ),
        (
            refused(|s| {
                s.ranges = vec![range(4.0)];
                s.legs.clear();
            }),
            "has ranges and no displacements",
        ),
        (
            refused(|s| {
                s.ranges = vec![range(4.0)];
                s.references.as_mut().unwrap().baseline = None;
            }),
            "--baseline",
        ),
        (
            refused(|s| s.ranges = vec![range(-4.0)]),
            "its range and its sigma",
        ),
        (
            refused(|s| {
                s.visits = vec![Visit {
                    target: TARGET,
                    stop: 1,
                    mark: 1,
                    sigma: 0.0,
                }];
            }),
            "to mark 1 at stop 1: its sigma",
        ),
        (
            refused(|s| {
                s.lens = Some(Lens {
                    sigma: 0.02,
                    fov_deg: Some(190.0),
                    principal_deg: 0.0,
                });
            }),
            "field of view",
        ),
    ] {
        assert!(message.contains(expected), "{message}");
    }
}

/// More than the smallest estimator takes.
#[test]
fn a_long_walk_finds_room() {
    let mut rng = generator(5);
    let walk = Walk::random(&mut rng, 9, 20, CarrierErrors::UNKNOWN, SIGMA);
    let places: Vec<Point2<f64>> = (0..80).map(|n| walk.places[n % 20]).collect();
    let long = Walk::measured(
        &mut rng,
        walk.cameras,
        places,
        CarrierErrors::UNKNOWN,
        SIGMA,
    );
    let solution = solved(&measured(&long));
    assert!(solution.is_good(), "{:?}", solution.reason);
    assert_eq!(solution.stops.len(), 80);
}
