//! Views of cameras, walks of targets and reports of their sensors.

use std::f64::consts::PI;

use calib_core::camera::Projection;
use cmucam2_emulator::{Configuration, Emulator, Lens, Scene};
use nalgebra::{Point2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use site::world::{
    Camera, Event, Gait, Mount, Obstacle, ObstacleShape, SensorErrors, StepSensor, Stride, Target,
    Time, Variant, Walker, World,
};

const SECOND: Time = 1_000_000_000;

fn random(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

fn p(x: f64, y: f64) -> Point2<f64> {
    Point2::new(x, y)
}

fn camera(x: f64, y: f64, degrees: f64, variant: Variant) -> Camera {
    let projection = match variant {
        Variant::Cmucam2 => Projection::PinHole,
        Variant::Stage => Projection::EqualAngle,
    };
    Camera {
        place: p(x, y),
        heading: degrees.to_radians(),
        mount: Mount::LEVEL,
        lens: Lens::with_projection(projection, 60_f64.to_radians(), 88, 143).unwrap(),
        range: 8.0,
        variant,
    }
}

fn ball(x: f64, y: f64) -> Target {
    Target {
        place: p(x, y),
        above: 0.0,
        radius: 0.15,
        colour: [230, 105, 35],
    }
}

/// First and last column, from 0, in the first T packet of an emulated camera before this world.
fn packet(world: &World, camera: usize) -> Option<[f64; 2]> {
    let mut scene = Scene::default();
    world
        .look(camera)
        .paint([110, 110, 110], &mut scene.objects);
    let mut emulator = Emulator::new(Configuration::default(), scene);
    emulator.advance(SECOND);
    for byte in *b"CR 18 40 19 32\rTC 170 240 60 150 16 90\r" {
        emulator.receive(byte, SECOND);
    }
    let mut heard = Vec::new();
    while let Some(now) = emulator.next_deadline().filter(|&now| now < 2 * SECOND) {
        heard.extend(emulator.transmit(now).map(|(_, byte)| byte));
    }
    let text = String::from_utf8_lossy(&heard).into_owned();
    let line = text.split('\r').find(|line| line.starts_with("T "))?;
    let numbers: Vec<f64> = line[2..].split(' ').map(|n| n.parse().unwrap()).collect();
    // T mx my x1 y1 x2 y2 pixels confidence; columns count from 1.
    (numbers[6] > 0.0).then(|| [numbers[2] - 1.0, numbers[4] - 1.0])
}

/// The camera's packet has the columns whose middles are between the two edges of the ball, which
/// are `asin(r / d)` off its bearing; a round ball may miss its last one.
#[test]
fn a_packet_shows_the_ball_where_its_bearing_is() {
    let mut world = World::new(
        vec![camera(1.0, 2.0, 40.0, Variant::Cmucam2)],
        vec![],
        vec![ball(0.0, 0.0)],
    );
    let focal = 43.5 / 30_f64.to_radians().tan();
    let mut random = random(1);
    for _ in 0..40 {
        let bearing: f64 = random.random_range(-0.45..0.45);
        let distance: f64 = random.random_range(1.2..7.5);
        let direction = 40_f64.to_radians() + bearing;
        let offset = Vector2::new(direction.cos(), direction.sin()) * distance;
        world.move_target(0, p(1.0, 2.0) + offset);
        let half = (0.15 / distance).asin();
        let edges = [bearing + half, bearing - half].map(|edge| 43.5 - focal * edge.tan());
        let [first, last] = packet(&world, 0).unwrap();
        assert!(
            (0.0..1.5).contains(&(first - edges[0])),
            "{first} {edges:?}"
        );
        assert!((0.0..1.5).contains(&(edges[1] - last)), "{last} {edges:?}");
    }
}

/// The emulator, given the boxes of a ray scan, reports exactly the scan's columns.
#[test]
fn a_packet_of_the_ray_scan_has_its_columns() {
    let mut world = World::new(
        vec![camera(0.0, 0.0, 0.0, Variant::Stage)],
        vec![],
        vec![ball(0.0, 0.0)],
    );
    let step = 60_f64.to_radians() / 87.0;
    let mut random = random(2);
    for _ in 0..40 {
        let bearing: f64 = random.random_range(-0.45..0.45);
        let distance: f64 = random.random_range(1.2..7.5);
        world.move_target(0, p(distance * bearing.cos(), distance * bearing.sin()));
        let half = (0.15 / distance).asin();
        // Rays at 30 degrees - s 60 / 87. The picture is one column narrower.
        let first = ((30_f64.to_radians() - bearing - half) / step).ceil();
        let last = ((30_f64.to_radians() - bearing + half) / step).floor();
        assert_eq!(packet(&world, 0), Some([first.max(0.0), last.min(86.0)]));
    }
}

#[test]
fn nothing_is_seen_beyond_the_range_behind_or_beside() {
    for variant in [Variant::Cmucam2, Variant::Stage] {
        let mut world = World::new(
            vec![camera(0.0, 0.0, 0.0, variant)],
            vec![],
            vec![ball(7.5, 0.0)],
        );
        assert!(world.look(0).of(0).is_some());
        for place in [p(8.3, 0.0), p(-3.0, 0.0), p(0.0, 3.0), p(2.0, 2.0)] {
            world.move_target(0, place);
            assert_eq!(packet(&world, 0), None, "{place}");
        }
    }
}

/// A wall up to the middle of the ball hides one half of it, in the sight and in the packet.
#[test]
fn obstacles_clip() {
    for variant in [Variant::Cmucam2, Variant::Stage] {
        let look = |obstacles: Vec<Obstacle>| {
            let cameras = vec![camera(0.0, 0.0, 0.0, variant)];
            let world = World::new(cameras, obstacles, vec![ball(2.0, 0.0)]);
            let sight = world.look(0).of(0).cloned();
            (sight, packet(&world, 0))
        };
        let (whole, all) = look(vec![]);
        let wall = |from: f64, to: f64, x: f64| {
            Obstacle::from(ObstacleShape::Segment([p(x, from), p(x, to)]))
        };
        let (half, part) = look(vec![wall(0.0, 3.0, 1.0)]);
        let (all, part) = (all.unwrap(), part.unwrap());
        assert_eq!(all[0] + all[1], 87.0, "the ball is in the middle");
        assert_eq!(part, [44.0, all[1]], "the left half is hidden");
        let (whole, half) = (whole.unwrap(), half.unwrap());
        assert!((half.visible_share() / whole.visible_share() - 0.5).abs() < 0.01);
        assert!(!half.is_whole());
        // All of it, none of it.
        assert_eq!(look(vec![wall(-3.0, 3.0, 1.0)]), (None, None));
        assert_eq!(look(vec![wall(-3.0, 3.0, 2.5)]).1, Some(all));
        let pillar = ObstacleShape::Disc {
            centre: p(1.0, 0.0),
            radius: 0.2,
        };
        assert_eq!(look(vec![pillar.into()]), (None, None));
    }
}

/// A camera sees a ball over a wall if the straight line to the ball's lowest point passes above the wall's top; of a ball
/// that is seen in part it sees the upper part.
#[test]
fn a_camera_looks_over_what_is_low() {
    // From 1.5 above the ball, 4 before it, a wall 3 away. The line to the ball's lowest point passes 0.225 above its middle.
    const TALLEST: f64 = 1.5 - (1.5 + 0.2) * 3.0 / 4.0;
    let lens = Lens::new(60_f64.to_radians(), 88, 143).unwrap();
    for roll in [0.0_f64, 30.0, 180.0] {
        let camera = Camera {
            place: p(0.0, 0.0),
            heading: 0.0,
            mount: Mount {
                height: 1.5,
                pitch: 20_f64.to_radians(),
                roll: roll.to_radians(),
            },
            lens,
            range: 9.0,
            variant: Variant::Cmucam2,
        };
        let ball = Target {
            place: p(4.0, 0.0),
            above: 0.0,
            radius: 0.2,
            colour: [230, 105, 35],
        };
        let over = |top: f64, shape: ObstacleShape| {
            let obstacle = Obstacle { shape, top };
            let world = World::new(vec![camera], vec![obstacle], vec![ball]);
            let view = world.look(0);
            let covers = view.patches().iter().filter(|patch| patch.target.is_none());
            (view.of(0).cloned(), covers.count(), world)
        };
        let wall = || ObstacleShape::Segment([p(3.0, -2.0), p(3.0, 2.0)]);
        let (sight, covers, _) = over(TALLEST - 0.01, wall());
        assert!(
            sight.as_ref().unwrap().is_whole() && covers == 0,
            "{roll}: {sight:?}"
        );
        // Its lower part is hidden.
        let (sight, covers, world) = over(TALLEST + 0.03, wall());
        let sight = sight.unwrap();
        assert!(!sight.is_whole() && covers > 0, "{roll}");
        assert!((sight.visible_share() - 1.0).abs() < 1e-9);
        let view = world.look(0);
        let [ball, cover, ..] = view.patches() else {
            panic!("{:?}", view.patches());
        };
        let (top, bottom) = (ball.extent.top, ball.extent.bottom);
        if roll == 180.0 {
            assert!(cover.extent.top < top && (top..bottom).contains(&cover.extent.bottom));
        } else {
            assert!(cover.extent.bottom > bottom && (top..bottom).contains(&cover.extent.top));
        }
        // All but a cap is hidden, and all.
        assert_eq!(over(TALLEST + 0.2, wall()).0, None);
        assert_eq!(over(f64::INFINITY, wall()).0, None);
        // The far edge of a cupboard hides what its near edge would not.
        let block = |depth: f64| {
            let [near, far] = [2.9, 2.9 + depth];
            ObstacleShape::Polygon(vec![p(near, -2.0), p(far, -2.0), p(far, 2.0), p(near, 2.0)])
        };
        assert!(over(TALLEST, block(0.05)).0.unwrap().is_whole());
        assert!(!over(TALLEST, block(0.3)).0.unwrap().is_whole());
        let pillar = |x: f64| ObstacleShape::Disc {
            centre: p(x, 0.0),
            radius: 0.3,
        };
        assert!(over(TALLEST, pillar(2.6)).0.unwrap().is_whole());
        assert!(!over(TALLEST, pillar(2.9)).0.unwrap().is_whole());
    }
    // A camera at the height of the ball sees nothing of what a wall of that height hides, and over a lower one all.
    for (top, share) in [(-0.3, Some(1.0)), (0.25, None)] {
        let camera = Camera {
            place: p(0.0, 0.0),
            heading: 0.0,
            mount: Mount::LEVEL,
            lens,
            range: 9.0,
            variant: Variant::Stage,
        };
        for variant in [Variant::Cmucam2, Variant::Stage] {
            let wall = Obstacle {
                shape: ObstacleShape::Segment([p(1.0, -2.0), p(1.0, 2.0)]),
                top,
            };
            let camera = Camera { variant, ..camera };
            let world = World::new(vec![camera], vec![wall], vec![self::ball(2.0, 0.0)]);
            let seen = world
                .look(0)
                .of(0)
                .map(|sight| sight.visible_share().round());
            assert_eq!(seen, share, "{variant:?}");
        }
    }
}

/// A nearer ball of another colour hides the things behind it.
#[test]
fn nearer_targets_clip() {
    for variant in [Variant::Cmucam2, Variant::Stage] {
        let blue = Target {
            colour: [40, 70, 220],
            ..ball(1.5, 0.15)
        };
        let world = World::new(
            vec![camera(0.0, 0.0, 0.0, variant)],
            vec![],
            vec![ball(3.0, 0.0), blue],
        );
        // The blue ball's right edge is at the bearing 0.
        let view = world.look(0);
        let sight = view.of(0).unwrap();
        let [[right, left]] = sight.visible[..] else {
            panic!("{sight:?}");
        };
        assert!(right < -0.03 && left.abs() < 0.02, "{sight:?}");
        let [first, last] = packet(&world, 0).unwrap();
        assert!(
            (43.0..=44.0).contains(&first) && last > 46.0,
            "{first} {last}"
        );
    }
}

/// The index finds those cameras that a look through each one finds, wherever targets moved before.
#[test]
fn the_index_finds_what_a_search_finds() {
    let mut random = random(3);
    let cameras: Vec<_> = (0..200)
        .map(|_| {
            let [x, y] = [(); 2].map(|()| random.random_range(0.0..60.0));
            camera(x, y, random.random_range(0.0..360.0), Variant::Cmucam2)
        })
        .collect();
    let walls = (0..40).map(|_| {
        let [x, y] = [(); 2].map(|()| random.random_range(0.0..60.0));
        Obstacle::from(ObstacleShape::Segment([p(x, y), p(x + 1.0, y + 1.0)]))
    });
    let walls: Vec<_> = walls.collect();
    let mut world = World::new(cameras.clone(), walls.clone(), vec![ball(0.0, 0.0); 3]);
    let mut seen = 0;
    for _ in 0..100 {
        let place = p(
            random.random_range(0.0..60.0),
            random.random_range(0.0..60.0),
        );
        world.move_target(random.random_range(0..3), place);
        let found = world.cameras_that_see(place, 0.15);
        let searched: Vec<_> = (0..cameras.len())
            .filter(|&index| {
                let alone = World::new(vec![cameras[index]], walls.clone(), vec![]);
                alone.sight(0, place, 0.15).is_some()
            })
            .collect();
        assert_eq!(found, searched);
        seen += found.len();
    }
    assert!(seen > 100, "{seen}");
}

fn walk(walker: &mut Walker, mut told: impl FnMut(&Walker) -> bool) -> Vec<(Time, Event)> {
    let mut events = Vec::new();
    while let Some(at) = walker.next_at() {
        let lamp = told(walker);
        walker.may_walk(lamp, at.saturating_sub(10 * SECOND));
        walker.advance(at, &mut events);
    }
    events
}

/// It stands within 0.02 units of every goal, gets there at 0.2 units a second, and its steps add up
/// to where it is and to what was planned.
#[test]
fn a_walk_goes_as_the_thesis_has_it() {
    let stops = vec![
        p(0.0, 0.0),
        p(3.0, 4.0),
        p(3.0, 3.95),
        p(3.0, 3.95),
        p(-1.0, 0.5),
    ];
    for seed in 0..20 {
        let mut walker = Walker::new(Gait::default(), stops.clone(), random(seed));
        let begin = walker.place();
        assert!((begin - stops[0]).norm() <= 0.02);
        let mut place = begin;
        let mut planned = Vector2::zeros();
        let mut left_at = 0;
        let mut arrivals = 0;
        for (at, event) in walk(&mut walker, |_| false) {
            match event {
                Event::Left { impatient, .. } => {
                    assert!(impatient);
                    left_at = at;
                }
                Event::Step(stride) => {
                    place += stride.walked;
                    planned += stride.planned;
                    assert!(stride.planned.norm() <= 0.1 + 1e-12);
                }
                Event::Arrived { stop } => {
                    arrivals += 1;
                    assert_eq!(stop, arrivals);
                    assert!((place - stops[stop]).norm() <= 0.02 + 1e-12);
                    assert!((stops[0] + planned - stops[stop]).norm() < 1e-9);
                    let way = (stops[stop] - stops[stop - 1]).norm();
                    let seconds = (at - left_at) as f64 / SECOND as f64;
                    assert!((seconds - way / 0.2).abs() < 0.5, "{seconds} s for {way}");
                }
            }
        }
        assert_eq!(arrivals, 4);
        assert!(walker.is_done() && (walker.place() - place).norm() < 1e-9);
    }
}

/// The places that a target tells of its stops have no systematic error. It stands off them by zero on average,
/// along the way that it came and across it, with the sigma that the gait says, and anew at each stop.
#[test]
fn it_stands_off_its_stops_on_any_side() {
    let gait = Gait::default();
    let stops = vec![p(0.0, 0.0), p(1.0, 0.0), p(1.5, 0.0), p(1.6, 0.0)];
    let sigma = gait.standing_sigma();
    assert_eq!(sigma, 0.01);
    let walks = 2000_u32;
    let (mut sum, mut squares, mut repeats) = ([0.0; 2], [0.0; 2], [0.0; 2]);
    for seed in 0..u64::from(walks) {
        let mut walker = Walker::new(gait, stops.clone(), random(seed));
        let mut before = walker.place() - stops[0];
        let mut events = Vec::new();
        while let Some(at) = walker.next_at() {
            walker.advance(at, &mut events);
            let Some((_, Event::Arrived { stop })) = events.pop() else {
                continue;
            };
            let off = walker.place() - stops[stop];
            for axis in 0..2 {
                sum[axis] += off[axis] / sigma;
                squares[axis] += (off[axis] / sigma).powi(2);
                repeats[axis] += off[axis] * before[axis] / sigma.powi(2);
            }
            before = off;
        }
    }
    let n = f64::from(3 * walks);
    // In units of sigma: the mean of n offsets, of their squares and of the products of neighbours
    // each have the standard error 1 / sqrt(n) on an even disc. Four of them.
    for (axis, name) in ["along", "across"].into_iter().enumerate() {
        for (what, found, right) in [
            ("mean", sum[axis] / n, 0.0),
            ("square", squares[axis] / n, 1.0),
            ("repeats", repeats[axis] / n, 0.0),
        ] {
            assert!(
                (found - right).abs() < 4.0 / n.sqrt(),
                "{what} {name}: {found}"
            );
        }
    }
}

/// The lamp must go on while it stands: that it is still on for the stop before does not count.
#[test]
fn it_walks_on_when_it_is_told() {
    let gait = Gait::default();
    let stops = vec![p(0.0, 0.0), p(1.0, 0.0), p(2.0, 0.0)];
    let mut walker = Walker::new(gait, stops, random(1));
    let mut events = Vec::new();
    assert_eq!(walker.next_at(), Some(gait.patience));
    walker.may_walk(true, 5 * SECOND);
    assert_eq!(walker.next_at(), Some(5 * SECOND));
    walker.advance(60 * SECOND, &mut events);
    assert_eq!(
        events[0],
        (
            5 * SECOND,
            Event::Left {
                stop: 0,
                impatient: false
            }
        )
    );
    let (arrived, Event::Arrived { stop: 1 }) = events[events.len() - 1] else {
        panic!("{events:?}");
    };
    walker.may_walk(true, 61 * SECOND);
    assert_eq!(
        walker.next_at(),
        Some(arrived + gait.patience),
        "it was on already"
    );
    walker.may_walk(false, 62 * SECOND);
    walker.may_walk(true, 63 * SECOND);
    assert_eq!(walker.next_at(), Some(63 * SECOND));
}

fn strides(leg: usize, of: usize) -> Vec<Stride> {
    let planned = Vector2::new(0.06, 0.08);
    let walked = Vector2::new(0.061, 0.079);
    vec![
        Stride {
            leg,
            of,
            planned,
            walked
        };
        of
    ]
}

#[test]
fn a_faultless_sensor_reports_the_plan() {
    let mut sensor = StepSensor::new(SensorErrors::default(), PI / 2.0, random(1));
    for stride in strides(0, 30) {
        let step = sensor.measure(&stride);
        assert!((f64::from(step.distance) - 0.1).abs() < 1e-7);
        // Seen from an axis that is turned by a quarter.
        let heading = 0.8_f64.atan2(0.6) - PI / 2.0 + 2.0 * PI;
        assert!((f64::from(step.heading) - heading).abs() < 1e-6);
        assert_eq!((step.distance_sigma, step.heading_sigma), (0.0, 0.0));
    }
}

/// Over many legs, the error of a whole leg is as large as asked for, and as its steps' sigmas say
/// when they are added as independent.
#[test]
fn drift_is_as_large_as_it_says() {
    let errors = SensorErrors {
        measures: true,
        leg_distance: 0.01,
        leg_heading: 0.5_f64.to_radians(),
        step_distance: 0.05,
        ..SensorErrors::default()
    };
    let mut sensor = StepSensor::new(errors, 0.0, random(4));
    let walked = Vector2::new(0.061, 0.079) * 40.0;
    let (mut along, mut across, mut predicted) = (0.0, 0.0, [0.0, 0.0]);
    let legs = 4000;
    for leg in 0..legs {
        let mut sum = Vector2::zeros();
        predicted = [0.0, 0.0];
        for stride in strides(leg, 40) {
            let step = sensor.measure(&stride);
            let step = calib_core::dead_reckoning::Step {
                distance: f64::from(step.distance),
                heading: f64::from(step.heading),
                distance_sigma: f64::from(step.distance_sigma),
                heading_sigma: f64::from(step.heading_sigma),
            };
            sum += step.displacement();
            predicted[0] += step.distance_sigma.powi(2);
            predicted[1] += (step.distance * step.heading_sigma).powi(2);
        }
        let error = sum - walked;
        along += error.dot(&walked.normalize()).powi(2) / f64::from(legs as u32);
        across += walked.normalize().perp(&error).powi(2) / f64::from(legs as u32);
    }
    let length = walked.norm();
    let expected = [
        (0.01 * length).powi(2) + 40.0 * (0.05 * length / 40.0).powi(2),
        (0.5_f64.to_radians() * length).powi(2),
    ];
    for (what, [a, b]) in [
        ("along", [along, expected[0]]),
        ("across", [across, expected[1]]),
        ("along, predicted", [predicted[0], expected[0]]),
        ("across, predicted", [predicted[1], expected[1]]),
    ] {
        assert!((a / b - 1.0).abs() < 0.12, "{what}: {a} {b}");
    }
}

/// Undeclared errors are in the steps, and not in the sigmas that they tell.
#[test]
fn undeclared_errors_are_in_no_sigma() {
    let declared = SensorErrors {
        measures: true,
        leg_distance: 0.05,
        ..SensorErrors::default()
    };
    let undeclared = SensorErrors {
        leg_distance: 0.0,
        undeclared_distance: 0.05,
        undeclared_heading: 0.02,
        ..declared
    };
    let [mut known, mut hidden] =
        [declared, undeclared].map(|errors| StepSensor::new(errors, 0.0, random(5)));
    let mut turned = 0.0;
    let legs = 4000;
    for leg in 0..legs {
        let stride = strides(leg, 1)[0];
        let [known, hidden] = [&mut known, &mut hidden].map(|sensor| sensor.measure(&stride));
        assert_eq!(hidden.distance, known.distance);
        assert!(known.distance_sigma > 0.0);
        assert_eq!((hidden.distance_sigma, hidden.heading_sigma), (0.0, 0.0));
        turned += f64::from(hidden.heading - known.heading).powi(2) / legs as f64;
    }
    assert!((turned.sqrt() / 0.02 - 1.0).abs() < 0.05, "{turned}");
}

/// A camera that is moved and turned sees from where it then stands.
#[test]
fn a_moved_camera_sees_from_its_new_place() {
    let there = camera(1.0, -2.0, 40.0, Variant::Cmucam2);
    let before = camera(0.0, 0.0, 0.0, Variant::Cmucam2);
    let mut moved = World::new(vec![before], vec![], vec![]);
    let before = moved.revision();
    moved.move_camera(0, there.place, there.heading);
    assert_ne!(moved.revision(), before);
    let put_there = World::new(vec![there], vec![], vec![]);
    for place in [p(3.0, 0.0), p(2.0, -2.5), p(-3.0, 0.0)] {
        assert_eq!(moved.sight(0, place, 0.15), put_there.sight(0, place, 0.15));
        assert_eq!(
            moved.cameras_that_see(place, 0.15),
            put_there.cameras_that_see(place, 0.15)
        );
    }
}
