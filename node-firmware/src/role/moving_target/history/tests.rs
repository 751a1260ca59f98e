use std::{boxed::Box, collections::BTreeMap, vec::Vec};

use calib_core::{
    dead_reckoning::Step,
    joint::{BearingStorage, Finding, StopStorage, UnknownStorage},
};
use nalgebra::Point2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::{
    message::Seen,
    role::moving_target::estimate::{CAMERAS, EstimateMemory, WORKSPACE},
};

pub(in crate::role::moving_target) fn estimate() -> Estimate<'static> {
    let memory = EstimateMemory {
        cameras: Box::leak(Box::new([UnknownStorage::default(); CAMERAS])),
        stops: Box::leak(Box::new([StopStorage::default(); ESTIMATED_STOPS])),
        bearings: Box::leak(Box::new([BearingStorage::default(); WALK_BEARINGS])),
        workspace: Box::leak(Box::new([0.0; WORKSPACE])),
        told: Box::leak(Box::new([None; CAMERAS])),
    };
    Estimate::new(memory).unwrap()
}

/// Record under each key.
type Flash = BTreeMap<u8, Fact>;

/// Writes the records that are due, up to so many, then the power fails.
fn write(
    estimate: &Estimate<'_>,
    unsaved: &mut Unsaved,
    flash: &mut Flash,
    most: usize,
) -> Option<usize> {
    for count in 0..most {
        let Some(key) = unsaved.take() else {
            return Some(count);
        };
        let fact = match key {
            FactKey::WalkStops(record) => estimate.stops_fact(record),
            FactKey::WalkBearings(record) => estimate.bearings_fact(record),
            other => panic!("{other:?}"),
        };
        flash.insert(key.record(), fact);
    }
    None
}

/// The estimate after a restart, and the rest that is written then.
fn restored(flash: &mut Flash, last: StopNumber, stands: bool) -> Estimate<'static> {
    let mut estimate = estimate();
    let mut unsaved = Unsaved::new();
    estimate.resume(stands);
    for fact in flash.values() {
        match fact {
            Fact::WalkStops(record, stops) => {
                estimate.restore_stops(*record, stops, &mut unsaved);
            }
            Fact::WalkBearings(record, bearings) => {
                estimate.sort_restored(last, &mut unsaved);
                estimate.restore_bearings(*record, bearings, &mut unsaved);
            }
            other => panic!("{other:?}"),
        }
    }
    estimate.sort_restored(last, &mut unsaved);
    write(&estimate, &mut unsaved, flash, usize::MAX);
    estimate
}

fn place(stop: StopNumber) -> Point2<f32> {
    let turn = f32::from(stop) * 0.37;
    Point2::new(turn.sin() * 4.0, turn.cos() * 3.0 + f32::from(stop) * 0.01)
}

/// No two are the same.
fn seen(stop: StopNumber, camera: MemberAddress) -> Seen {
    let bearing = f32::from(stop) * 1e-3 + f32::from(camera) * 1e-5;
    Seen::direction(bearing, 0.01)
}

fn step(from: StopNumber, to: StopNumber) -> Step<f32> {
    let way = place(to) - place(from);
    Step {
        distance: way.norm(),
        heading: way.y.atan2(way.x),
        distance_sigma: 0.01,
        heading_sigma: 0.01,
    }
}

fn bearings(estimate: &Estimate<'_>) -> Vec<WalkBearing> {
    (0..).map_while(|n| estimate.bearing(n)).collect()
}

/// Every leg ends where it says, and every bearing is of its stop.
#[track_caller]
fn check(estimate: &Estimate<'_>, last: StopNumber) -> usize {
    let stops: Vec<_> = estimate.estimator.tags().map(|tag| tag.number).collect();
    assert!(
        stops.is_sorted() && stops.iter().all(|stop| *stop <= last),
        "{stops:?}"
    );
    let slots: std::collections::BTreeSet<_> =
        estimate.estimator.tags().map(|tag| tag.slot).collect();
    assert_eq!(slots.len(), stops.len());
    let mut legs = 0;
    for (index, pair) in (1..).zip(stops.windows(2)) {
        if let Some(leg) = estimate.estimator.leg(index) {
            let off = leg.displacement - (place(pair[1]) - place(pair[0]));
            assert!(off.norm() < 1e-3, "{pair:?}: {off}");
            legs += 1;
        }
    }
    let bearings = bearings(estimate);
    for bearing in &bearings {
        assert_eq!(bearing.value, seen(bearing.stop, bearing.camera).bearing);
        let is_it = |b: &&WalkBearing| (b.stop, b.camera) == (bearing.stop, bearing.camera);
        assert_eq!(bearings.iter().filter(is_it).count(), 1);
    }
    legs
}

/// A walk far beyond the room that there is. Whatever was written last when the power failed, nothing is
/// taken for anything else; where all was written, everything is there again.
#[test]
fn the_power_fails_at_any_write() {
    for seed in 0..12 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (mut flash, mut unsaved) = (Flash::new(), Unsaved::new());
        let mut estimate = estimate();
        let mut stop: StopNumber = 100;
        let cameras = [3, 7, 13, 24][seed as usize % 4];
        let mut unmeasured = 0;
        let mut is_lost = true;
        for _ in 0..200 {
            let from = stop;
            stop += 1;
            if !is_lost {
                estimate.on_step(&step(from, stop));
            }
            unmeasured += usize::from(is_lost);
            is_lost = false;
            estimate.on_stop(stop, &mut unsaved);
            for camera in 1..=cameras {
                if rng.random_bool(0.6) {
                    estimate.on_seen(camera, stop, &seen(stop, camera), 0.0, &mut unsaved);
                }
            }
            estimate.save_bearings(true, &mut unsaved);
            check(&estimate, stop);
            let most = match rng.random_range(0..4) {
                0 => rng.random_range(0..8),
                _ => usize::MAX,
            };
            let written = write(&estimate, &mut unsaved, &mut flash, most);
            let is_first = estimate.estimator.stops() == 1;
            if written.is_none() {
                // In the middle of it: the stop may be told again, or no camera heard of it.
                let stands = rng.random_bool(0.5);
                estimate = restored(&mut flash, stop, stands);
                unsaved = Unsaved::new();
                is_lost = !stands;
                check(&estimate, stop);
                // At most the leg here, and those of two stops whose records are of two times.
                unmeasured += 3;
                continue;
            }
            let again = restored(&mut flash.clone(), stop, true);
            let tags = |of: &Estimate<'_>| of.estimator.tags().collect::<Vec<_>>();
            assert_eq!(tags(&again), tags(&estimate));
            assert_eq!(bearings(&again), bearings(&estimate));
            let legs = check(&again, stop);
            assert_eq!(legs, check(&estimate, stop));
            assert!(is_first || legs + unmeasured + 1 >= tags(&again).len());
        }
        assert!(estimate.estimator.stops() <= ESTIMATED_STOPS);
        assert!(estimate.estimator.bearings() <= WALK_BEARINGS);
        let is_full = estimate.estimator.stops() == ESTIMATED_STOPS
            || estimate.estimator.bearings() + usize::from(cameras) > WALK_BEARINGS;
        assert!(is_full, "{seed}");
    }
}

/// A stop costs few writes, also where another one has to make room.
#[test]
fn writes_are_few() {
    for (cameras, most) in [(3, 4.5), (13, 14.0), (24, 20.0)] {
        let (mut flash, mut unsaved) = (Flash::new(), Unsaved::new());
        let mut estimate = estimate();
        let mut written = 0;
        for stop in 1..=200 {
            estimate.on_step(&step(stop - 1, stop));
            estimate.on_stop(stop, &mut unsaved);
            written += write(&estimate, &mut unsaved, &mut flash, usize::MAX).unwrap();
            for camera in 1..=cameras {
                estimate.on_seen(camera, stop, &seen(stop, camera), 0.0, &mut unsaved);
                written += write(&estimate, &mut unsaved, &mut flash, usize::MAX).unwrap();
            }
            estimate.save_bearings(true, &mut unsaved);
            written += write(&estimate, &mut unsaved, &mut flash, usize::MAX).unwrap();
        }
        let a_stop = written as f32 / 200.0;
        assert!(a_stop < most, "{cameras}: {a_stop}");
    }
}

/// Measurements among other cameras are written over.
#[test]
fn what_is_forgotten_is_not_restored() {
    let (mut flash, mut unsaved) = (Flash::new(), Unsaved::new());
    let mut estimate = estimate();
    for stop in 1..=20 {
        estimate.on_step(&step(stop - 1, stop));
        estimate.on_stop(stop, &mut unsaved);
        for camera in 1..=4 {
            estimate.on_seen(camera, stop, &seen(stop, camera), 0.0, &mut unsaved);
        }
    }
    estimate.save_bearings(true, &mut unsaved);
    write(&estimate, &mut unsaved, &mut flash, usize::MAX).unwrap();
    assert_eq!(restored(&mut flash.clone(), 20, true).estimator.stops(), 20);
    estimate.clear(&mut unsaved);
    write(&estimate, &mut unsaved, &mut flash, usize::MAX).unwrap();
    let after = restored(&mut flash.clone(), 20, false);
    assert_eq!(
        (after.estimator.stops(), after.estimator.bearings()),
        (0, 0)
    );
    // A target that stands counts the stop at which it does.
    let after = restored(&mut flash, 20, true);
    assert_eq!((after.estimator.stops(), after.index(20)), (1, Some(0)));
}

/// Bearings of a moved camera from its former place are written over, and a camera may be moved often.
#[test]
fn a_former_place_is_not_restored() {
    let (mut flash, mut unsaved) = (Flash::new(), Unsaved::new());
    let mut estimate = estimate();
    for round in 0..2 * CAMERAS as StopNumber {
        // It was moved before the fifth of ten stops.
        for stop in 10 * round + 1..=10 * round + 10 {
            estimate.on_step(&step(stop - 1, stop));
            estimate.on_stop(stop, &mut unsaved);
            for camera in 1..=4 {
                estimate.on_seen(camera, stop, &seen(stop, camera), 0.0, &mut unsaved);
            }
        }
        let from = 10 * round + 5;
        let (moved, first) = (3, estimate.index(from).unwrap());
        let number = estimate.number(moved).unwrap();
        let mut found = |camera| {
            estimate.on_found(&Finding::Camera {
                camera,
                from: first,
                chi_squared: 100.0,
            });
            estimate.estimator.moved(number)?.successor
        };
        let successor = found(number).unwrap();
        // Once more, before it has a pose there: then only the former place goes.
        assert_eq!(found(successor), Some(successor), "{round}");
        estimate.forget_past(&mut unsaved);
        assert_eq!(estimate.estimator.moved(number), None);
        let bearings = bearings(&estimate);
        let of = |camera| {
            bearings
                .iter()
                .filter(move |bearing| bearing.camera == camera)
        };
        assert!(of(moved).all(|bearing| bearing.stop >= from));
        assert_eq!(of(moved).count(), 6);
        assert!(of(4).count() > 6 || round == 0);
        estimate.save_bearings(true, &mut unsaved);
        write(&estimate, &mut unsaved, &mut flash, usize::MAX).unwrap();
        let again = restored(&mut flash.clone(), 10 * round + 10, true);
        assert_eq!(self::bearings(&again), bearings);
    }
}
