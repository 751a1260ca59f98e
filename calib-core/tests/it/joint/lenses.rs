//! Focal lengths as unknowns.

use calib_core::{
    Refusal,
    joint::{Capacity, JointError, JointMemory, JointSettings},
};
use test_support::{
    generator,
    walk::{CarrierErrors, Walk},
};

use crate::joint::support::{Joint, WIDE, filled, memory, through_lenses};

const PRIOR: f64 = 0.02;

/// True tangents over measured ones of a lens of 47 degrees that is said to have 45.
fn forty_seven() -> f64 {
    23.5_f64.to_radians().tan() / 22.5_f64.to_radians().tan()
}

fn seen_through(seed: u64, camera: usize, scale: f64) -> Walk {
    let mut walk = Walk::random(&mut generator(seed), 8, 24, CarrierErrors::DRIFT, 0.0024);
    walk.look_through(camera, scale, 0.0);
    walk.lens_sigma = PRIOR;
    walk
}

fn nees(joint: &mut Joint<f32>, walk: &Walk, camera: usize) -> f64 {
    let truth = walk.cameras[camera];
    let pose = joint.pose(camera).unwrap();
    let nees = pose.normalised_error(truth.position().cast(), truth.heading as f32);
    nees.unwrap().into()
}

/// For a reference or another camera. The prior, 2.5 of whose sigmas the lens is off, pulls as far as the
/// sightings leave it open; the pose is right, and wrong where the lens is believed.
#[test]
fn a_lens_of_other_width_is_found() {
    let (mut squares, mut expected) = (0.0, 0.0);
    let (mut spread, mut within) = (0.0, 0.0);
    let (mut poses, mut right, mut believed) = (0.0, 0.0, 0.0);
    let off = (forty_seven() - 1.0) / PRIOR;
    for seed in 0..16 {
        for camera in 0..4 {
            let walk = seen_through(seed, camera, forty_seven());
            if walk.seen_by(camera) < 6 {
                continue;
            }
            let mut joint = filled::<f32>(&walk, WIDE);
            joint.solve().unwrap();
            assert_eq!(joint.check(), Ok(None), "nothing contradicts");
            let lens = joint.lens(camera).unwrap();
            let sigma = f64::from(lens.sigma);
            let error = f64::from(lens.scale) - forty_seven();
            let left_open = (sigma / PRIOR).powi(2);
            squares += (error / sigma).powi(2);
            expected += 1.0 - left_open + off * off * left_open;
            if left_open < 0.25 {
                spread += 1.0;
                within += f64::from(error.abs() < 2.0 * sigma);
            }
            if camera < 2 {
                continue;
            }
            poses += 3.0;
            right += nees(&mut joint, &walk, camera);
            let mut walk = walk;
            walk.lens_sigma = 0.0;
            let mut joint = filled::<f32>(&walk, WIDE);
            if joint.solve().is_ok() && joint.pose(camera).is_ok() {
                believed += nees(&mut joint, &walk, camera);
            }
        }
    }
    let text =
        format!("{squares} of {expected}; {within} of {spread}; {right} or {believed} of {poses}");
    assert!((0.75..1.25).contains(&(squares / expected)), "{text}");
    assert!(spread > 20.0 && within > 0.8 * spread, "{text}");
    // The pull on the lens is one on the pose.
    assert!(right < 1.6 * poses && believed > 5.0 * poses, "{text}");
}

/// Three bearings carry no fourth unknown: the lens stays the stated one, and the pose is
/// the less certain for that.
#[test]
fn three_bearings_leave_the_lens_to_its_prior() {
    let mut cameras = 0;
    for seed in 0..24 {
        let mut walk = seen_through(seed, 2, 1.0);
        let mut left = 3;
        walk.bearings.retain(|seen| {
            let keeps = seen.camera != 2 || left > 0;
            left -= usize::from(seen.camera == 2 && left > 0);
            keeps
        });
        let mut joint = filled::<f64>(&walk, WIDE);
        joint.solve().unwrap();
        walk.lens_sigma = 0.0;
        let mut believed = filled::<f64>(&walk, WIDE);
        believed.solve().unwrap();
        let (Ok(pose), Ok(sure)) = (joint.pose(2), believed.pose(2)) else {
            continue;
        };
        let lens = joint.lens(2).unwrap();
        assert!((lens.sigma / PRIOR - 1.0).abs() < 0.01, "{lens:?}");
        assert!((lens.scale - 1.0).abs() < 0.1 * PRIOR, "{lens:?}");
        assert!(pose.sigma_position() > sure.sigma_position());
        cameras += 1;
    }
    assert!(cameras > 15, "{cameras}");
}

/// A lens other than the stated one, and the ordinary spread of lenses.
#[test]
fn a_lens_that_is_another_one_is_named() {
    let (mut named, mut others, mut cameras) = (0, 0, 0);
    for seed in 0..24 {
        let ordinary = Walk::random(&mut generator(seed), 8, 24, CarrierErrors::DRIFT, 0.0024);
        let mut walk = through_lenses(ordinary, seed, 0.0);
        let camera = (2..8).max_by_key(|&camera| walk.seen_by(camera)).unwrap();
        walk.look_through(camera, 1.15, 0.0);
        let mut joint = filled::<f32>(&walk, WIDE);
        joint.solve().unwrap();
        while joint.check().unwrap().is_some() {}
        for other in 0..8 {
            let Ok(lens) = joint.lens(other) else {
                continue;
            };
            let is_named = usize::from(lens.is_wrong());
            if other == camera {
                cameras += 1;
                named += is_named;
            } else {
                others += is_named;
            }
        }
    }
    // The worst of its bearings are left out at first, and the rest may say too little.
    assert!(
        cameras > 20 && named * 10 >= cameras * 6,
        "{named} of {cameras}"
    );
    assert_eq!(others, 0);
}

#[test]
fn lenses_take_room() {
    let room = Capacity {
        cameras: 3,
        stops: 4,
        bearings: 8,
        marks: 0,
    };
    let narrow = || JointMemory {
        workspace: vec![0.0; room.workspace()].leak(),
        ..memory(3, 4, 8, 0)
    };
    let wide = || memory::<f64>(3, 4, 8, 0);
    let with = |lens| {
        let mut settings = JointSettings::default();
        settings.lens = lens;
        settings
    };
    assert_eq!(
        Joint::new(narrow(), 1.0, with(Some(0.02))).err(),
        Some(JointError::Memory)
    );
    assert!(Joint::new(narrow(), 1.0, with(Some(0.0))).is_ok());
    assert_eq!(
        Joint::new(wide(), 1.0, with(Some(-0.02))).err(),
        Some(JointError::NotFinite)
    );
    assert!(Joint::new(wide(), 1.0, with(Some(0.02))).is_ok());
    let least = room.workspace();
    let short = || JointMemory {
        workspace: vec![0.0; least - 1].leak(),
        ..memory(3, 4, 8, 0)
    };
    assert_eq!(
        Joint::new(short(), 1.0, with(None)).err(),
        Some(JointError::Memory)
    );

    let walk = Walk::random(&mut generator(1), 8, 12, CarrierErrors::UNKNOWN, 0.0024);
    let mut joint = filled::<f64>(&walk, WIDE);
    joint.solve().unwrap();
    assert_eq!(joint.lens(0), Err(Refusal::TooFew));
}
