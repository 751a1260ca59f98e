//! Cameras in space: against a forward model that is written anew here, on rooms drawn from a seed.

use calib_core::{
    Limits, Refusal, Status,
    camera::Projection,
    space::{self, Lens, Pose, Priors, Sighting, Told},
};
use nalgebra::{Matrix6, Point3, Rotation3, Vector2, Vector3, Vector6};
use rand::RngExt;
use test_support::{Random, amount, generator, normal};

const ANY: Limits<f64> = Limits {
    position: f64::INFINITY,
    heading: f64::INFINITY,
};

fn lens(projection: Projection) -> Lens<f64> {
    Lens {
        projection,
        focal: Vector2::new(270.0, 280.0),
        principal: Vector2::new(157.0, 104.0),
        distortion: Vector2::new(-0.12, 0.02),
        sigmas: Vector3::zeros(),
    }
}

/// The pixel of a target, with rotations of the linear algebra library and angles of the lens.
fn seen(pose: &Pose<f64>, lens: &Lens<f64>, target: Point3<f64>) -> Option<Vector2<f64>> {
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), pose.heading)
        * Rotation3::from_axis_angle(&Vector3::y_axis(), pose.pitch)
        * Rotation3::from_axis_angle(&Vector3::x_axis(), pose.roll);
    let own = turn.inverse() * (target - pose.position);
    let angle = own.normalize().x.acos();
    let q = match lens.projection {
        Projection::PinHole if own.x <= 0.0 => return None,
        Projection::PinHole => angle.tan(),
        Projection::EqualAngle => angle,
    };
    let k = lens.distortion;
    if 1.0 + 3.0 * k.x * q.powi(2) + 5.0 * k.y * q.powi(4) < 0.1 {
        return None;
    }
    let radius = q + k.x * q.powi(3) + k.y * q.powi(5);
    let around = own.z.atan2(own.y);
    Some(Vector2::new(
        lens.principal.x - lens.focal.x * radius * around.cos(),
        lens.principal.y - lens.focal.y * radius * around.sin(),
    ))
}

struct Room {
    pose: Pose<f64>,
    sightings: Vec<Sighting<f64>>,
}

const PIXEL_SIGMA: f64 = 0.4;
const PLACE_SIGMA: f64 = 0.01;

/// A camera and targets in its picture at about one height, with noise as it is told.
fn room(random: &mut Random, lens: &Lens<f64>, count: usize, roll_sigma: f64) -> Room {
    loop {
        let mut draw = |low: f64, high: f64| random.random_range(low..high);
        let pose = Pose {
            position: Point3::new(draw(-1.0, 1.0), draw(-1.0, 1.0), draw(-1.0, 4.0)),
            heading: draw(-3.1, 3.1),
            pitch: draw(-5.0, 60.0).to_radians(),
            roll: 0.0,
        };
        let roll = roll_sigma * normal(random);
        let pose = Pose { roll, ..pose };
        let mut sightings = Vec::new();
        for _ in 0..200 * count {
            let (away, side) = (
                random.random_range(1.0..8.0),
                random.random_range(-0.7..0.7),
            );
            let towards: f64 = pose.heading + side;
            let target = Point3::new(
                pose.position.x + away * towards.cos(),
                pose.position.y + away * towards.sin(),
                0.0,
            );
            let inside = |pixel: &Vector2<f64>| {
                (3.0..312.0).contains(&pixel.x) && (3.0..204.0).contains(&pixel.y)
            };
            let Some(_) = seen(&pose, lens, target).filter(inside) else {
                continue;
            };
            let shift = Vector3::from_fn(|_, _| PLACE_SIGMA * normal(random));
            let Some(pixel) = seen(&pose, lens, target + shift) else {
                continue;
            };
            sightings.push(Sighting {
                target,
                target_sigma: Vector3::repeat(PLACE_SIGMA),
                pixel: pixel + Vector2::from_fn(|_, _| PIXEL_SIGMA * normal(random)),
                pixel_sigma: PIXEL_SIGMA,
            });
            if sightings.len() == count {
                return Room { pose, sightings };
            }
        }
    }
}

fn single(lens: &Lens<f64>) -> Lens<f32> {
    Lens {
        projection: lens.projection,
        focal: lens.focal.cast(),
        principal: lens.principal.cast(),
        distortion: lens.distortion.cast(),
        sigmas: lens.sigmas.cast(),
    }
}

fn singles(sightings: &[Sighting<f64>]) -> Vec<Sighting<f32>> {
    let one = |sighting: &Sighting<f64>| Sighting {
        target: sighting.target.cast(),
        target_sigma: sighting.target_sigma.cast(),
        pixel: sighting.pixel.cast(),
        pixel_sigma: sighting.pixel_sigma as f32,
    };
    sightings.iter().map(one).collect()
}

fn turn(angle: f64) -> f64 {
    (angle + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI
}

fn difference(a: &Pose<f64>, b: &Pose<f64>) -> Vector6<f64> {
    let place = a.position - b.position;
    Vector6::new(
        place.x,
        place.y,
        place.z,
        turn(a.heading - b.heading),
        turn(a.pitch - b.pitch),
        turn(a.roll - b.roll),
    )
}

/// Error squared over its covariance.
fn normalised(error: &Vector6<f64>, covariance: &Matrix6<f64>) -> f64 {
    let solved = covariance.cholesky().unwrap().solve(error);
    error.dot(&solved)
}

fn rolled(degrees: f64) -> Priors<f64> {
    Priors {
        roll: Some(Told {
            value: 0.0,
            sigma: degrees.to_radians(),
        }),
        ..Priors::default()
    }
}

#[test]
fn random_rooms_are_right_or_ambiguous() {
    let mut random = generator(35);
    let (mut right, mut ambiguous, mut wrong, mut refused) = (0, 0, 0, 0);
    let (mut sum, mut counted) = (0.0, 0);
    let rooms = amount(500, 2000);
    for n in 0..rooms {
        let lens = lens([Projection::PinHole, Projection::EqualAngle][n % 2]);
        let count = 3 + n % 14;
        let room = room(&mut random, &lens, count, 6_f64.to_radians());
        let Ok(solution) = space::solve(&room.sightings, &lens, &rolled(6.0)) else {
            refused += 1;
            continue;
        };
        if solution.rival.is_some() {
            ambiguous += 1;
            continue;
        }
        let error = difference(&solution.pose, &room.pose);
        let squared = normalised(&error, &solution.covariance);
        let sigmas = Vector6::from(solution.sigmas());
        let worst = error.component_div(&sigmas).amax();
        if worst > 5.0 && solution.status(&ANY) == Status::Calibrated {
            wrong += 1;
        } else if worst <= 5.0 {
            right += 1;
        }
        if count > 4 {
            sum += squared;
            counted += 1;
        }
    }
    let mean = sum / f64::from(counted);
    let told = format!(
        "{right} right, {ambiguous} ambiguous, {wrong} wrong, {refused} refused, NEES {mean:.2}"
    );
    assert!(right + ambiguous >= rooms * 99 / 100, "{told}");
    assert!(ambiguous < rooms / 20, "{told}");
    // The aim is none.
    assert!(wrong * 1000 <= rooms, "{told}");
    assert!((5.4..6.6).contains(&mean), "{told}");
}

#[test]
fn single_precision_does_as_well() {
    let mut random = generator(36);
    let mut worst = 0.0_f64;
    for n in 0..300 {
        let lens = lens([Projection::PinHole, Projection::EqualAngle][n % 2]);
        let room = room(&mut random, &lens, 5 + n % 12, 0.03);
        let double = space::solve(&room.sightings, &lens, &rolled(2.0)).unwrap();
        let priors = Priors {
            roll: Some(Told {
                value: 0.0_f32,
                sigma: 2_f32.to_radians(),
            }),
            ..Priors::default()
        };
        let node = space::solve(&singles(&room.sightings), &single(&lens), &priors).unwrap();
        if double.rival.is_some() || node.rival.is_some() {
            continue;
        }
        let pose = Pose {
            position: node.pose.position.cast(),
            heading: node.pose.heading.into(),
            pitch: node.pose.pitch.into(),
            roll: node.pose.roll.into(),
        };
        let error = difference(&pose, &double.pose);
        worst = worst.max(normalised(&error, &double.covariance).sqrt());
    }
    assert!(worst < 0.1, "{worst} sigmas apart");
}

#[test]
fn a_camera_of_any_roll_needs_no_prior() {
    let mut random = generator(37);
    let (mut right, mut ambiguous) = (0, 0);
    for _ in 0..100 {
        let lens = lens(Projection::PinHole);
        let room = room(&mut random, &lens, 8, 1.2);
        let Ok(solution) = space::solve(&room.sightings, &lens, &Priors::default()) else {
            continue;
        };
        let error = difference(&solution.pose, &room.pose);
        let sigmas = Vector6::from(solution.sigmas());
        let is_right = error.component_div(&sigmas).amax() < 5.0;
        ambiguous += u32::from(solution.rival.is_some());
        right += u32::from(solution.rival.is_none() && is_right);
    }
    assert!(
        right >= 97 && right + ambiguous >= 99,
        "{right} right, {ambiguous} ambiguous"
    );
}

#[test]
fn a_wrong_focal_length_told_as_exact_is_noticed() {
    let mut random = generator(38);
    let (mut tried, mut noticed, mut alarms) = (0, 0, 0);
    for _ in 0..100 {
        let lens = lens(Projection::PinHole);
        let room = room(&mut random, &lens, 12, 0.03);
        let solve = |lens| space::solve(&room.sightings, &lens, &rolled(2.0));
        alarms += u32::from(solve(lens).is_ok_and(|s| s.fitting_focal.is_some()));
        let off = lens.with(&Vector3::new(1.3, lens.distortion.x, lens.distortion.y));
        // As far as these sightings can tell a focal length at all.
        let mut freed = off;
        freed.sigmas.x = 0.3;
        let Ok(known) = solve(freed) else { continue };
        if known.rival.is_some() || 0.23 < 6.0 * known.lens_sigmas.x {
            continue;
        }
        tried += 1;
        let Ok(solution) = solve(off) else { continue };
        noticed += u32::from(solution.status(&ANY) == Status::Doubtful);
        if let Some(factor) = solution.fitting_focal {
            let sigma = known.lens_sigmas.x;
            assert!((factor - 1.0 / 1.3).abs() < 5.0 * sigma, "{factor} {sigma}");
        }
    }
    let told = format!("{noticed} of {tried} noticed, {alarms} false alarms");
    assert!(tried > 50 && noticed == tried && alarms <= 1, "{told}");
}

#[test]
fn a_focal_length_with_its_sigma_is_found() {
    let mut random = generator(39);
    let mut sum = 0.0;
    for _ in 0..200 {
        let mut lens = lens(Projection::PinHole);
        let room = room(&mut random, &lens, 12, 0.03);
        let factor = 1.0 + 0.05 * normal(&mut random);
        lens.focal /= factor;
        lens.sigmas.x = 0.05;
        let solution = space::solve(&room.sightings, &lens, &rolled(2.0)).unwrap();
        sum += ((solution.lens.x - factor) / solution.lens_sigmas.x).powi(2);
        assert!(solution.lens_sigmas.x < 0.05 && solution.lens_sigmas.y == 0.0);
    }
    let mean = sum / 200.0;
    assert!((0.7..1.35).contains(&mean), "{mean}");
}

#[test]
fn what_cannot_be_answered_is_refused() {
    let mut random = generator(40);
    let lens = lens(Projection::PinHole);
    let room = room(&mut random, &lens, 6, 0.03);
    let solve = |sightings: &[Sighting<f64>]| space::solve(sightings, &lens, &Priors::default());
    assert_eq!(solve(&room.sightings[..2]), Err(Refusal::TooFew));
    let mut broken = room.sightings.clone();
    broken[3].pixel.x = f64::NAN;
    assert_eq!(solve(&broken), Err(Refusal::NotFinite));
    broken[3].pixel.x = 100.0;
    broken[3].pixel_sigma = 0.0;
    assert_eq!(solve(&broken), Err(Refusal::NotFinite));
    let mut line = room.sightings.clone();
    for (n, sighting) in line.iter_mut().enumerate() {
        sighting.target = Point3::new(1.0, 2.0, 0.5) + Vector3::new(0.3, 0.4, 0.0) * n as f64;
    }
    assert_eq!(solve(&line), Err(Refusal::DangerLine));
    let same = vec![room.sightings[0]; 5];
    assert_eq!(solve(&same), Err(Refusal::DangerLine));
    let mut mixed = room.sightings.clone();
    mixed[0].pixel = mixed[5].pixel + Vector2::new(40.0, -30.0);
    assert!(solve(&mixed).map_or(true, |s| s.status(&ANY) == Status::Doubtful));
}

#[test]
fn lenses_see_where_they_look() {
    let mut random = generator(41);
    for projection in [Projection::PinHole, Projection::EqualAngle] {
        let lens = lens(projection);
        for _ in 0..1000 {
            let pixel = Vector2::new(
                random.random_range(0.0..315.0),
                random.random_range(0.0..208.0),
            );
            let direction = lens.direction(&pixel).unwrap();
            assert!((lens.pixel(&direction).unwrap() - pixel).norm() < 1e-9);
            let level = Pose {
                position: Point3::origin(),
                heading: 0.0,
                pitch: 0.0,
                roll: 0.0,
            };
            let again = seen(&level, &lens, Point3::origin() + direction).unwrap();
            assert!((again - pixel).norm() < 1e-5, "{again} {pixel}");
        }
    }
}
