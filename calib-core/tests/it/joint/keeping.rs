//! Stops that make room, and measurements that are taken up again.

use calib_core::joint::{JointError, JointSettings, Prior, RestoredLeg, StopTag};
use rand::RngExt;
use test_support::{
    generator,
    walk::{CarrierErrors, Walk},
};

use crate::joint::support::{CAMERAS, Joint, WIDE, filled, memory};

fn walk(seed: u64) -> Walk {
    Walk::random(&mut generator(seed), 8, 18, CarrierErrors::UNKNOWN, 0.0024)
}

fn tag(number: u16, slot: usize) -> StopTag {
    StopTag {
        number,
        slot: slot as u8,
    }
}

/// Largest difference of poses, carrier and headings, and of their sigmas, in sigmas.
fn difference(a: &mut Joint<f64>, b: &mut Joint<f64>) -> f64 {
    let mut worst = 0.0_f64;
    let mut compare = |a: f64, b: f64, [va, vb]: [f64; 2]| {
        worst = worst.max((a - b).abs() / va.sqrt());
        worst = worst.max((va / vb).sqrt().max((vb / va).sqrt()) - 1.0);
    };
    for camera in 2..8 {
        let (a, b) = (a.pose(camera), b.pose(camera));
        assert_eq!(a.is_ok(), b.is_ok(), "camera {camera}");
        let (Ok(a), Ok(b)) = (a, b) else { continue };
        let variances = [a, b].map(|pose| pose.covariance);
        for axis in 0..2 {
            let of = [variances[0][(axis, axis)], variances[1][(axis, axis)]];
            compare(a.position[axis], b.position[axis], of);
        }
        compare(a.heading, b.heading, [variances[0].m33, variances[1].m33]);
    }
    let [ca, cb] = [a.carrier().unwrap(), b.carrier().unwrap()];
    compare(ca.scale, cb.scale, [ca.covariance.m11, cb.covariance.m11]);
    compare(
        ca.compass,
        cb.compass,
        [ca.covariance.m22, cb.covariance.m22],
    );
    let [ha, hb] = [a, b].map(|joint| joint.reference_headings().unwrap());
    compare(
        ha.headings[1],
        hb.headings[1],
        [ha.covariance.m22, hb.covariance.m22],
    );
    worst
}

/// Without its bearings a stop tells nothing that the sum of its legs does not tell.
#[test]
fn a_stop_taken_out_costs_its_bearings_and_nothing_else() {
    for seed in 0..6 {
        let walk = walk(seed);
        for removed in [0, 5, 9, 16] {
            let mut blind = walk.clone();
            blind.bearings.retain(|seen| seen.stop != removed);
            let mut expected = filled::<f64>(&blind, WIDE);
            expected.solve().unwrap();

            for is_solved in [false, true] {
                let mut joint = filled::<f64>(&walk, WIDE);
                if is_solved {
                    joint.solve().unwrap();
                }
                let before = joint.bearings();
                joint.remove_stop(removed, |_| {}).unwrap();
                assert_eq!(joint.stops(), 17);
                let of_it = walk.bearings.iter().filter(|seen| seen.stop == removed);
                assert_eq!(joint.bearings() + of_it.count(), before);
                joint.solve().unwrap();
                let off = difference(&mut expected, &mut joint);
                assert!(off < 1e-4, "{seed} {removed} {is_solved}: {off:e}");
            }
        }
    }
}

/// Each record that changed is named, so that no other one has to be written anew.
#[test]
fn what_moved_is_told() {
    for seed in 0..6 {
        let mut joint = filled::<f64>(&walk(seed), WIDE);
        for stop in 0..18 {
            joint.tag_stop(stop, tag(100 + stop as u16, stop)).unwrap();
        }
        let list = |joint: &Joint<f64>| -> Vec<_> {
            let stops: Vec<_> = joint.tags().map(|tag| tag.number).collect();
            let all = (0..).map_while(|n| joint.measured(n));
            all.map(|m| (stops[m.stop], m.camera, m.value)).collect()
        };
        let mut written = list(&joint);
        for _ in 0..8 {
            let stop = joint.least_missed().unwrap();
            let mut moved = Vec::new();
            joint.remove_stop(stop, |n| moved.push(n)).unwrap();
            let now = list(&joint);
            for n in moved {
                if let Some(written) = written.get_mut(n)
                    && let Some(now) = now.get(n)
                {
                    *written = *now;
                }
            }
            written.truncate(now.len());
            assert_eq!(written, now);
        }
        assert!(
            joint
                .tags()
                .all(|tag| usize::from(tag.number) == 100 + usize::from(tag.slot))
        );
    }
}

/// A target that stands where it stood is known by the sightings of all cameras, and by nothing less.
#[test]
fn a_stop_that_repeats_the_one_before_is_known() {
    let mut known = 0;
    for seed in 0..6 {
        let walk = walk(seed);
        let last = || walk.bearings.iter().filter(|seen| seen.stop == 17);
        let repeated = |turned: usize, by: f64, alone: bool| {
            let mut joint = filled::<f64>(&walk, WIDE);
            assert!(!joint.repeats(17, 3.0), "it walked");
            let stop = joint.add_stop(None).unwrap();
            for (n, seen) in last().enumerate() {
                let value = seen.bearing + if n == turned { by } else { 0.0 };
                let added = joint.add_bearing(stop, seen.camera, value, seen.sigma);
                added.unwrap();
            }
            let is_new = |camera: &usize| last().all(|seen| seen.camera != *camera);
            if let (true, Some(other)) = (alone, (0..8).find(is_new)) {
                joint.add_bearing(stop, other, 0.1, 0.002).unwrap();
            }
            joint.repeats(stop, 3.0)
        };
        let sigma = last().next().map_or(0.0, |seen| seen.sigma);
        if last().count() < 2 {
            // One direction is not a place.
            assert!(!repeated(0, 0.0, false));
            continue;
        }
        known += 1;
        assert!(repeated(0, 0.0, false));
        assert!(repeated(1, 3.0 * sigma, false));
        assert!(!repeated(1, 6.0 * sigma, false));
        assert!(!repeated(0, 0.0, true), "news of another camera");
    }
    assert!(known > 2);
    assert!(!filled::<f64>(&walk(0), WIDE).repeats(0, 3.0));
}

/// However long the walk, cameras that were seen early stay, and so does the frame.
#[test]
fn the_stop_that_is_missed_least_makes_room() {
    for seed in 0..6 {
        let mut joint = filled::<f64>(&walk(seed), WIDE);
        joint.solve().unwrap();
        let known: Vec<_> = (0..8).map(|camera| joint.pose(camera).is_ok()).collect();
        while joint.stops() > 12 {
            let counts: Vec<_> = (0..8).map(|c| joint.bearings_of(c)[0]).collect();
            let stop = joint.least_missed().unwrap();
            assert!(stop + 1 < joint.stops());
            joint.remove_stop(stop, |_| {}).unwrap();
            let rarest = counts.iter().filter(|n| **n > 0).min().unwrap();
            // The camera that was seen least loses nothing while others have more.
            if counts.iter().any(|n| n > rarest) {
                let left = (0..8).map(|c| joint.bearings_of(c)[0]).filter(|n| *n > 0);
                assert!(left.min().unwrap() + 1 >= *rarest, "{seed}");
            }
        }
        joint.solve().unwrap();
        for (camera, was_known) in known.into_iter().enumerate() {
            assert!(!was_known || joint.pose(camera).is_ok(), "{seed} {camera}");
        }
    }
    let mut joint = filled::<f64>(&walk(1), WIDE);
    joint.clear();
    assert_eq!(joint.least_missed(), None);
    assert_eq!(joint.remove_stop(0, |_| {}), Err(JointError::Unknown));
}

/// A restart: measurements are taken up in whatever order they are found.
#[test]
fn a_walk_is_taken_up_again() {
    for seed in 0..8 {
        let walk = walk(seed);
        let mut rng = generator(seed);
        let mut joint = filled::<f64>(&walk, WIDE);
        // Over the end of the numbers.
        for stop in 0..18 {
            let number = 65_530_u16.wrapping_add(stop as u16);
            joint.tag_stop(stop, tag(number, stop)).unwrap();
        }
        joint.remove_stop(7, |_| {}).unwrap();
        joint.solve().unwrap();

        let mut settings = JointSettings::default();
        settings.scale = Prior {
            mean: 1.0,
            sigma: walk.errors.scale,
        };
        settings.compass = Prior {
            mean: 0.0,
            sigma: walk.errors.compass,
        };
        settings.limits = WIDE;
        let mut restored =
            Joint::new(memory(CAMERAS, 64, 800, 0), walk.cameras[1].x, settings).unwrap();
        let tags: Vec<_> = joint.tags().collect();
        let mut order: Vec<_> = (0..tags.len()).collect();
        for n in (1..order.len()).rev() {
            order.swap(n, rng.random_range(0..=n));
        }
        for stop in order {
            let leg = joint.leg(stop).map(|leg| RestoredLeg {
                from: tags[stop - 1].number,
                leg,
            });
            restored.restore_stop(tags[stop], leg).unwrap();
            assert_eq!(
                restored.restore_stop(tags[stop], leg),
                Err(JointError::Taken)
            );
        }
        // One that was being written when the power failed.
        let late = tag(tags[16].number.wrapping_add(1), 40);
        restored.restore_stop(late, None).unwrap();
        restored.sort_restored(tags[16].number);
        assert!(restored.tags().eq(tags));
        for measured in (0..).map_while(|n| joint.measured(n)) {
            let calib_core::joint::Measured {
                stop,
                camera,
                value,
                sigma,
                ..
            } = measured;
            restored.add_bearing(stop, camera, value, sigma).unwrap();
        }
        restored.solve().unwrap();
        let off = difference(&mut joint, &mut restored);
        assert!(off < 1e-4, "{seed}: {off:e}");
        assert_eq!(
            restored.restore_stop(tag(1, 1), None),
            Err(JointError::Taken)
        );
    }
}

/// The power failed while a stop was taken out: the records of it, and of the one after it, are of two times.
/// A leg that began elsewhere is none, and never one from a wrong place.
#[test]
fn a_leg_from_elsewhere_is_none() {
    let walk = walk(2);
    let mut joint = filled::<f64>(&walk, WIDE);
    for stop in 0..18 {
        joint.tag_stop(stop, tag(stop as u16, stop)).unwrap();
    }
    let before: Vec<_> = (0..18).map(|stop| joint.leg(stop)).collect();
    joint.remove_stop(6, |_| {}).unwrap();
    let joined = joint.leg(6).unwrap();
    assert_eq!(
        joined.displacement,
        before[6].unwrap().displacement + before[7].unwrap().displacement
    );
    // The record of the removed one is gone, or still there; that of the next one is new, or old.
    for is_there in [false, true] {
        for is_new in [false, true] {
            let mut restored = filled::<f64>(&walk, WIDE);
            restored.clear();
            for stop in (0..18).filter(|stop| *stop != 6 || is_there) {
                let leg = match stop {
                    7 if is_new => Some(RestoredLeg {
                        from: 5,
                        leg: joined,
                    }),
                    _ => before[stop].map(|leg| RestoredLeg {
                        from: stop as u16 - 1,
                        leg,
                    }),
                };
                restored.restore_stop(tag(stop as u16, stop), leg).unwrap();
            }
            restored.sort_restored(17);
            let next = restored.tags().position(|tag| tag.number == 7).unwrap();
            assert_eq!(restored.leg(next).is_some(), is_there != is_new);
            assert!((0..next).skip(1).all(|stop| restored.leg(stop).is_some()));
        }
    }
}
