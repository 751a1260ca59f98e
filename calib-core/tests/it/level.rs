//! Rows tell whether a camera is level: rooms drawn from a seed, with a forward model in space that is written anew here.

use calib_core::{
    Limits, Pose, Ray, Sighting,
    angle::wrap_signed,
    level::{self, Elevation, Hanging, Levelness, Mounting, Row, Tolerance},
    resection::{self, Solution},
};
use nalgebra::{Matrix3, Matrix6, Matrix6x3, Point2, Rotation3, Vector3, Vector6};
use rand::RngExt;
use test_support::{Random, amount, generator, normal};

const LIMITS: Limits<f64> = Limits {
    position: 0.5,
    heading: 0.087,
};
const TOLERANCE: Tolerance<f64> = Tolerance {
    tilt: 0.034_906_585,
    bob: 0.02,
};
const PLACE_SIGMA: f64 = 0.02;

/// Columns, rows, columns for a tangent of one, rows for one.
const CMUCAM2: [f64; 4] = [88.0, 143.0, 75.344_2, 150.688_4];
const PIXY2: [f64; 4] = [316.0, 208.0, 272.797_9, 272.797_9];

struct Room {
    truth: Pose<f64>,
    /// Height above the ball, pitch and roll.
    hung: Vector3<f64>,
    places: Vec<Point2<f64>>,
    /// Tangents of column and row.
    tangents: Vec<[f64; 2]>,
}

/// A camera on a wall and stops in its picture, whole pixels, a ball that bobs. Angles in degrees.
fn room(
    random: &mut Random,
    frame: [f64; 4],
    height: f64,
    tilt: f64,
    stops: usize,
) -> Option<Room> {
    let [columns, rows, across, down] = frame;
    let truth = Pose {
        position: Point2::new(random.random_range(1.0..7.0), 0.1),
        heading: (90.0_f64 + random.random_range(-30.0..30.0)).to_radians(),
        covariance: Matrix3::zeros(),
    };
    let [pitch, roll] = [tilt, 0.0].map(|mean| (mean + normal(random)).to_radians());
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), truth.heading)
        * Rotation3::from_axis_angle(&Vector3::y_axis(), pitch)
        * Rotation3::from_axis_angle(&Vector3::x_axis(), roll);
    // The picture's middle row is not that of the lens: a pitch is told of the former.
    let off = normal(random).to_radians();
    let horizon = off * down;
    let (mut places, mut tangents) = (Vec::new(), Vec::new());
    for _ in 0..400 {
        let place = Point2::new(random.random_range(0.4..9.0), random.random_range(0.4..9.0));
        let away = place - truth.position;
        if !(1.0..9.0).contains(&away.norm()) {
            continue;
        }
        let own = turn.inverse() * Vector3::new(away.x, away.y, 0.02 * normal(random) - height);
        if own.x < 0.2 {
            continue;
        }
        let pixel = [
            ((columns - 1.0) / 2.0 - across * own.y / own.x).round(),
            ((rows - 1.0) / 2.0 - down * own.z / own.x + horizon).round(),
        ];
        let [right, bottom] = [columns - 3.0, rows - 5.0];
        if !(2.0..right).contains(&pixel[0]) || !(4.0..bottom).contains(&pixel[1]) {
            continue;
        }
        let told = |_: usize| PLACE_SIGMA * normal(random);
        let [x, y] = [0, 1].map(told);
        places.push(Point2::new(place.x + x, place.y + y));
        tangents.push([
            ((columns - 1.0) / 2.0 - pixel[0]) / across,
            ((rows - 1.0) / 2.0 - pixel[1]) / down,
        ]);
        if places.len() == stops {
            return Some(Room {
                truth,
                hung: Vector3::new(height, pitch - off, roll),
                places,
                tangents,
            });
        }
    }
    None
}

/// A pose that a node would tell, with its mounting.
struct Found {
    pose: Pose<f64>,
    levelness: Levelness<f64>,
    hanging: Hanging<f64>,
}

impl Room {
    /// The pose in the plane of directions that are turned upright.
    fn in_plane(&self, across: f64, mounting: Mounting<f64>) -> Option<Solution<f64>> {
        let sightings = self
            .places
            .iter()
            .zip(&self.tangents)
            .map(|(place, [a, b])| {
                let seen = mounting.upright(1.0, *a, *b);
                // Of the column, and of a row that errs by a bob of 2 cm.
                let above = mounting.upright(1.0, *a, b + 1e-4);
                let by_row = (above.azimuth() - seen.azimuth()) / 1e-4;
                let away = (place - self.truth.position).norm();
                let own = a.atan().cos().powi(2) / across / 12_f64.sqrt();
                let sigma = own.hypot(by_row * (0.02 / away).hypot(own));
                Sighting::new(*place, Ray::from_bearing(seen.azimuth()), sigma)
                    .with_target_sigma(PLACE_SIGMA)
            });
        resection::solve(&sightings.collect::<Vec<_>>()).ok()
    }

    fn rows(&self, down: f64) -> Vec<Row<f64>> {
        let seen = self.places.iter().zip(&self.tangents);
        let row = |(place, [a, b]): (&Point2<f64>, &[f64; 2])| {
            let elevation = (b / a.hypot(1.0)).atan() as f32;
            Row {
                target: *place,
                target_variance: PLACE_SIGMA * PLACE_SIGMA,
                bearing: a.atan(),
                elevation: Elevation::from_radians(elevation).radians().unwrap(),
                sigma: 1.0 / down / 12_f64.sqrt(),
            }
        };
        seen.map(row).collect()
    }

    /// As nodes solve it: in the plane, then with the mounting that the rows tell, until that stays.
    fn solved(&self, frame: [f64; 4], is_told_level: bool) -> Option<Found> {
        let rows = self.rows(frame[3]);
        let mut mounting = Mounting::level();
        for _ in 0..8 {
            let pose = self.in_plane(frame[2], mounting)?.pose;
            match level::improved(&pose, &rows, mounting, &TOLERANCE) {
                Some(better) if !is_told_level => mounting = better,
                _ => break,
            }
        }
        let solution = self.in_plane(frame[2], mounting)?;
        let mut pose = solution.pose;
        let levelness = level::judge(&pose, &rows, mounting, &TOLERANCE)?;
        let hanging = level::hanging(&pose, &rows, mounting, &TOLERANCE)?;
        pose.covariance += levelness.widening;
        let is_good = !levelness.is_refused() && LIMITS.allow(&pose) || is_told_level;
        (is_good && !solution.fit().is_bad()).then_some(Found {
            pose,
            levelness,
            hanging,
        })
    }

    fn error(&self, pose: &Pose<f64>) -> Vector3<f64> {
        let turned = wrap_signed(pose.heading - self.truth.heading);
        (pose.position - self.truth.position).push(turned)
    }

    /// Squared error of all six over their covariance.
    fn nees_in_space(&self, found: &Found) -> f64 {
        let Found { pose, hanging, .. } = found;
        let Mounting { pitch, roll } = hanging.mounting;
        let off = Vector3::new(hanging.height, pitch, roll) - self.hung;
        let error = Vector6::from_fn(|i, _| match i {
            0..3 => self.error(pose)[i],
            _ => off[i - 3],
        });
        let mut covariance = Matrix6::zeros();
        covariance
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&pose.covariance);
        covariance
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&hanging.covariance);
        covariance
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&hanging.with_pose);
        covariance
            .fixed_view_mut::<3, 3>(3, 0)
            .copy_from(&hanging.with_pose.transpose());
        let factor = covariance.cholesky().expect("a covariance");
        error.dot(&factor.solve(&error))
    }

    /// Errors of a pose over its sigmas, the larger of place and heading.
    fn sigmas_off(&self, pose: &Pose<f64>) -> f64 {
        let error = self.error(pose);
        let off = error.xy().norm() / pose.sigma_position();
        off.max(error.z.abs() / pose.covariance.m33.sqrt())
    }
}

#[derive(Debug, Default)]
struct Tally {
    rooms: usize,
    calibrated: usize,
    /// Of those taken for level whatever rows say.
    deceived_before: usize,
    level: usize,
    deceived: usize,
    /// Sums of squared errors over their covariance, of (x, y, heading), and of pitches, degrees.
    nees: f64,
    pitch: f64,
    /// The same of (x, y, heading, height, pitch, roll).
    nees_in_space: f64,
}

fn tally(frame: [f64; 4], height: f64, tilt: f64, stops: usize) -> Tally {
    let seed = 7 + (height * 10.0) as u64 + 100 * tilt as u64 + 10_000 * stops as u64;
    let mut random = generator(seed);
    let mut tally = Tally::default();
    for _ in 0..rooms() {
        let Some(room) = room(&mut random, frame, height, tilt, stops) else {
            continue;
        };
        tally.rooms += 1;
        if let Some(Found {
            pose, levelness, ..
        }) = room.solved(frame, true)
        {
            let mut alone = pose;
            alone.covariance -= levelness.widening;
            let is_told = LIMITS.allow(&alone) && room.sigmas_off(&alone) > 5.0;
            tally.deceived_before += usize::from(is_told);
        }
        let Some(found) = room.solved(frame, false) else {
            continue;
        };
        let Found {
            pose, levelness, ..
        } = found;
        tally.calibrated += 1;
        tally.nees_in_space += room.nees_in_space(&found);
        tally.level += usize::from(levelness.mounting.is_level());
        if room.sigmas_off(&pose) > 5.0 {
            tally.deceived += 1;
        }
        let error = room.error(&pose);
        tally.nees += error.dot(&(pose.covariance.try_inverse().unwrap() * error));
        tally.pitch += (levelness.mounting.pitch.to_degrees() - tilt).powi(2);
    }
    let calibrated = tally.calibrated.max(1) as f64;
    println!(
        "{height} m, {tilt} deg, {stops} stops: {} rooms, {} deceived as level; {} calibrated, {} of them as level, {} \
         deceived, NEES {:.1}, in space {:.1}, pitch off by {:.1} deg",
        tally.rooms,
        tally.deceived_before,
        tally.calibrated,
        tally.level,
        tally.deceived,
        tally.nees / calibrated,
        tally.nees_in_space / calibrated,
        (tally.pitch / calibrated).sqrt()
    );
    tally
}

/// Rooms of a row of the tables below; ten times as many at night.
fn rooms() -> usize {
    amount(200, 2_000)
}

/// A level camera is taken for level at any height, though its bracket is a degree off.
#[test]
fn level_cameras_pass() {
    let (mut level, mut all) = (0, 0);
    for frame in [CMUCAM2, PIXY2] {
        for stops in [3, 10] {
            for height in [0.0, 0.5, 1.5, 2.5] {
                let tally = tally(frame, height, 0.0, stops);
                assert_eq!(tally.deceived, 0, "{tally:?}");
                level += tally.level;
                all += tally.calibrated;
            }
        }
    }
    println!("{level} of {all} as level");
    assert!(10 * (all - level) <= all && all > 10 * rooms());
}

/// Tilted cameras find their pose, pitch and roll; taken for level, a quarter of them would deceive.
#[test]
fn tilted_cameras_are_found() {
    let (mut all, mut calibrated, mut before) = (0, 0, 0);
    let (mut found, mut deceived) = (0, 0);
    for frame in [CMUCAM2, PIXY2] {
        for stops in [3, 5, 10] {
            for (height, tilt) in [
                (0.5, 10.0),
                (1.5, 5.0),
                (1.5, 10.0),
                (2.5, 10.0),
                (1.5, 20.0),
                (2.5, 20.0),
                (1.5, 30.0),
                (2.5, 30.0),
                (2.5, 45.0),
            ] {
                let tally = tally(frame, height, tilt, stops);
                deceived += tally.deceived;
                found += tally.calibrated;
                if stops == 10 {
                    all += tally.rooms;
                    calibrated += tally.calibrated;
                    before += tally.deceived_before;
                    let nees = tally.nees / tally.calibrated as f64;
                    assert!((1.0..4.5).contains(&nees), "{tally:?}");
                    let in_space = tally.nees_in_space / tally.calibrated as f64;
                    assert!((4.0..10.0).contains(&in_space), "{tally:?}");
                }
            }
        }
    }
    println!("{calibrated} of {all} calibrated from ten stops, {before} deceived as level");
    // Three stops may leave a second pose.
    assert!(10_000 * deceived <= found, "{deceived} of {found}");
    assert!(10 * calibrated > 9 * all && 4 * before > all);
}

/// The dense covariance of all rows, inverted by the linear algebra library, gives the same chi squared.
#[test]
fn chi_squared_is_that_of_the_dense_covariance() {
    let mut random = generator(3);
    let mut compared = 0;
    for (height, tilt) in [(0.0, 0.0), (1.5, 0.0), (1.5, 10.0), (2.5, 20.0)] {
        for _ in 0..20 {
            let Some(room) = room(&mut random, CMUCAM2, height, tilt, 6) else {
                continue;
            };
            let Some(solution) = room.in_plane(CMUCAM2[2], Mounting::level()) else {
                continue;
            };
            let pose = solution.pose;
            let rows = room.rows(CMUCAM2[3]);
            let found = judged(&pose, &rows, &TOLERANCE).unwrap();
            let h = found.height;
            let (sin, cos) = pose.heading.sin_cos();
            let own = |i: usize| {
                let d = rows[i].target - pose.position;
                (d.x * cos + d.y * sin, d.y * cos - d.x * sin)
            };
            let tangent = |i: usize| {
                let row = &rows[i];
                [row.bearing.tan(), row.elevation.tan() / row.bearing.cos()]
            };
            let u = Vector6::<f64>::from_fn(|i, _| 1.0 / own(i).0);
            let a = Vector6::<f64>::from_fn(|i, _| tangent(i)[0]);
            let b = Vector6::<f64>::from_fn(|i, _| tangent(i)[1]);
            let q = b.map(|b| 1.0 + b * b);
            let j = Matrix6x3::from_fn(|i, k| u[i].powi(2) * [cos, sin, -own(i).1][k]);
            let farthest: f64 = u.map(f64::recip).max();
            let t = TOLERANCE.tilt;
            let noise = Vector6::<f64>::from_fn(|i, _| {
                (rows[i].sigma * q[i]).powi(2)
                    + (TOLERANCE.bob * u[i]).powi(2)
                    + (h * u[i].powi(2) * PLACE_SIGMA).powi(2)
            });
            // The pose moves with pitch and roll: solved anew, turned by a little.
            let moved = |pitch: f64, roll: f64| {
                let turned = room
                    .in_plane(CMUCAM2[2], Mounting { pitch, roll })
                    .unwrap()
                    .pose;
                let turn = wrap_signed(turned.heading - pose.heading);
                (turned.position - pose.position).push(turn) / (pitch + roll)
            };
            let pitch = q - j * moved(1e-3, 0.0) * h;
            let roll = a + j * moved(0.0, 1e-3) * h;
            let covariance = Matrix6::from_diagonal(&noise)
                + u * u.transpose() * (4.0 * farthest).powi(2)
                + (pitch * pitch.transpose() + roll * roll.transpose()) * t * t
                + j * pose.covariance * j.transpose() * h * h;
            let oracle = b.dot(&(covariance.try_inverse().unwrap() * b));
            let chi_squared = found.fit.chi_squared;
            assert!(
                (chi_squared - oracle).abs() < 0.02 * (1.0 + oracle),
                "{chi_squared} {oracle}"
            );
            let single: Vec<_> = rows.iter().map(single).collect();
            let pose = Pose {
                position: pose.position.cast(),
                heading: pose.heading as f32,
                covariance: pose.covariance.cast(),
            };
            let tolerance = Tolerance {
                tilt: TOLERANCE.tilt as f32,
                bob: 0.02,
            };
            let on_node = level::judge(&pose, &single, Mounting::level(), &tolerance).unwrap();
            let off = f64::from(on_node.fit.chi_squared) - chi_squared;
            assert!(
                off.abs() < 0.02 * (1.0 + chi_squared),
                "{off} of {chi_squared}"
            );
            compared += 1;
        }
    }
    assert!(compared > 40, "{compared}");
}

fn judged(
    pose: &Pose<f64>,
    rows: &[Row<f64>],
    tolerance: &Tolerance<f64>,
) -> Option<Levelness<f64>> {
    level::judge(pose, rows, Mounting::level(), tolerance)
}

fn single(row: &Row<f64>) -> Row<f32> {
    Row {
        target: row.target.cast(),
        target_variance: row.target_variance as f32,
        bearing: row.bearing as f32,
        elevation: row.elevation as f32,
        sigma: row.sigma as f32,
    }
}

/// Without a tolerance nothing is tested; one row tells a height and tests nothing; rows behind the camera do not count.
#[test]
fn what_cannot_be_tested_is_not() {
    let pose = Pose {
        position: Point2::new(0.0, 0.0),
        heading: 0.0,
        covariance: Matrix3::from_diagonal_element(1e-4),
    };
    let row = |x: f64| Row {
        target: Point2::new(x, 0.0),
        target_variance: 0.0,
        bearing: 0.0,
        elevation: -0.5_f64.atan(),
        sigma: 0.002,
    };
    let test = |rows: &[Row<f64>], tilt| judged(&pose, rows, &Tolerance { tilt, bob: 0.0 });
    assert_eq!(test(&[row(2.0), row(4.0)], 0.0), None);
    assert_eq!(test(&[], 0.03), None);
    assert_eq!(test(&[row(-2.0)], 0.03), None);
    let one = test(&[row(2.0)], 0.03).unwrap();
    assert!(
        !one.is_refused() && (one.height - 1.0).abs() < 0.05,
        "{one:?}"
    );
    // The same row at twice the distance is that of a camera twice as high.
    assert!(test(&[row(2.0), row(4.0)], 0.03).unwrap().is_refused());
    let broken = Row {
        sigma: f64::NAN,
        ..row(2.0)
    };
    assert_eq!(test(&[broken, row(3.0)], 0.03), None);
}

#[test]
fn elevations_travel_as_tenths_of_a_milliradian() {
    for (radians, told) in [
        (0.0, 0.0),
        (0.123_44, 0.1234),
        (-0.123_46, -0.1235),
        (1.560_7, 1.5607),
    ] {
        let elevation = Elevation::from_radians(radians).radians::<f64>().unwrap();
        assert!((elevation - told).abs() < 1e-9, "{elevation}");
    }
    for unknown in [1.6, -2.0, f32::NAN, f32::INFINITY] {
        assert_eq!(Elevation::from_radians(unknown), Elevation::UNKNOWN);
    }
    assert_eq!(Elevation::UNKNOWN.radians::<f32>(), None);
}
