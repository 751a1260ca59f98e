//! Scenario files: their content, and their messages when something is wrong.

use calib_core::camera::Projection;
use nalgebra::Point2;
use node_firmware::{
    config::{CameraConfig, Config, RoleConfig, SiteKey},
    limits::REFERENCE_STOPS,
};
use site::world::Variant;
use site::{BUILT_IN, NetworkConfigs, Overrides, ScatterTable, Scenario, SensorTable, Site};

fn load(name: &str, changes: &Overrides) -> Site {
    Scenario::load(name, changes).unwrap().put_up().unwrap()
}

fn configs(scenario: &Scenario) -> Vec<NetworkConfigs> {
    site::configs(scenario, SiteKey::new(1, *b"0123456789abcdef")).unwrap()
}

fn camera(config: &Config) -> &CameraConfig {
    match &config.role {
        RoleConfig::Camera(camera) => camera,
        other => panic!("node {} is {other:?}", config.id),
    }
}

fn rehearsed(name: &str, changes: &Overrides) -> Site {
    let scenario = Scenario::load(name, changes).unwrap();
    scenario.rehearsed().unwrap().1
}

/// A network of three cameras, with some more lines.
fn small(head: &str, tail: &str) -> String {
    format!(
        "name = \"small\"\n{head}\n\
         [[network]]\nreferences = {{ cameras = [1, 2] }}\ncamera = [\n\
         {{ id = 1, x = 0.0, y = 0.0, heading_deg = 45.0 }},\n\
         {{ id = 2, x = 10.0, y = 0.0, heading_deg = 145.0 }},\n\
         {{ id = 3, x = 5.0, y = 10.0, heading_deg = 270.0 }},\n]\n{tail}"
    )
}

const TARGET: &str = "target = [{ id = 20 }]\n";

fn error(text: &str) -> String {
    let scenario = Scenario::from_toml(text, &Overrides::default());
    let key = SiteKey::new(1, *b"0123456789abcdef");
    let put_up = |scenario: Scenario| {
        scenario.put_up()?;
        site::configs(&scenario, key)
    };
    match scenario.and_then(put_up) {
        Ok(_) => panic!("nothing is wrong with\n{text}"),
        Err(error) => error.to_string(),
    }
}

/// They are about planned stops.
#[test]
fn changes_of_a_plan_are_refused_where_nothing_is_planned() {
    let own = "target = [{ id = 20, stops = [[4.0, 4.0], [6.0, 4.0], [5.0, 6.0]] }]";
    let text = small("", own);
    let path = Overrides {
        path: Some(2),
        ..Overrides::default()
    };
    let stops = Overrides {
        stops: Some(4),
        ..Overrides::default()
    };
    for (changes, name) in [(path, "`path`"), (stops, "`stops`")] {
        let message = Scenario::from_toml(&text, &changes)
            .unwrap_err()
            .to_string();
        assert!(
            message.contains(name) && message.contains("left out"),
            "{message}"
        );
        assert!(Scenario::from_toml(&small("", TARGET), &changes).is_ok());
    }
}

/// Table 4.1, as the file that the other figures use has it.
#[test]
fn thesis_13_has_the_cameras_of_table_4_1() {
    let truth = include_str!("../../../../tests/data/thesis/table_4_1_truth.csv");
    let site = load("thesis-13", &Overrides::default());
    let network = &site.networks[0];
    let mut compared = 0;
    for line in truth.lines().skip(1).filter(|line| !line.is_empty()) {
        let numbers: Vec<f64> = line.split(',').map(|n| n.parse().unwrap()).collect();
        let node = network
            .cameras
            .iter()
            .find(|node| f64::from(node.id) == numbers[0]);
        let camera = &site.world.cameras()[node.unwrap().index];
        assert_eq!([camera.place.x, camera.place.y], [numbers[1], numbers[2]]);
        compared += 1;
    }
    assert!(compared >= 11, "{compared}");
    assert_eq!(network.cameras.len(), 13);
    assert_eq!(
        network.frame.place(Point2::new(3.0, 4.0)),
        Point2::new(3.0, 4.0)
    );
}

/// Other stops are planned for scattered cameras, by the seed: even a camera that hardly moved would
/// otherwise see the target in the same columns for every seed.
#[test]
fn the_way_is_another_for_every_seed() {
    let first_stops = |seed| {
        let changes = Overrides {
            seed: Some(seed),
            scatter: Some(ScatterTable {
                position: 1e-6,
                heading_deg: 1e-6,
            }),
            ..Overrides::default()
        };
        let site = rehearsed("thesis-13", &changes);
        site.networks[0].targets[0].stops[..3].to_vec()
    };
    let [one, two, again] = [1, 2, 1].map(first_stops);
    assert_eq!(one, again);
    let nearest = |stop: &Point2<f64>| {
        let ways = two.iter().map(|other| (stop - other).norm());
        ways.fold(f64::INFINITY, f64::min)
    };
    assert!(
        one.iter().any(|stop| nearest(stop) > 0.1),
        "{one:?} {two:?}"
    );
}

/// No camera is moved through a wall.
#[test]
fn a_scattered_camera_stays_in_its_room() {
    let walls = "[[world.obstacle]]\nwall = [[-1.0, 10.2], [11.0, 10.2]]\n\
                 [scatter]\nposition = 0.5\nheading_deg = 1.0\n";
    let text = small("", &format!("{TARGET}{walls}"));
    let mut places = Vec::new();
    for seed in 1..=20 {
        let changes = Overrides {
            seed: Some(seed),
            ..Overrides::default()
        };
        let scenario = Scenario::from_toml(&text, &changes).unwrap();
        let (_, site) = scenario.rehearsed().unwrap();
        places.push(site.world.cameras()[2].place.y);
    }
    assert!(places.iter().all(|&y| y < 10.2), "{places:?}");
    assert!(places.iter().any(|&y| y > 10.0), "{places:?}");
}

/// A walk that was planned for more stops than nodes count would be left in its middle.
#[test]
fn nodes_count_as_many_stops_as_are_planned() {
    for stops in [3, 8, 9, 12, 16] {
        let changes = Overrides {
            stops: Some(stops),
            ..Overrides::default()
        };
        let scenario = Scenario::load("thesis-13", &changes).unwrap();
        let plan = scenario.put_up().unwrap().networks[0].targets[0]
            .plan
            .clone()
            .unwrap();
        let planned = plan.stops.iter().filter(|stop| stop.for_references).count();
        for config in &configs(&scenario).remove(0).cameras {
            let camera = camera(config.settings());
            assert_eq!(
                usize::from(camera.reference_stops),
                planned,
                "{stops} stops"
            );
            assert_eq!(usize::from(camera.stops), stops);
        }
    }
}

/// A target's own numbers of its stops have 16 bits; the record tells stops apart by them.
#[test]
fn a_target_has_no_more_stops_than_it_can_count() {
    let with = |count: usize| {
        let stops = vec!["[1.0, 1.0]"; count].join(", ");
        let text = small("", &format!("target = [{{ id = 20, stops = [{stops}] }}]"));
        Scenario::from_toml(&text, &Overrides::default())
    };
    assert!(with(65_535).is_ok());
    let error = with(65_536).unwrap_err().to_string();
    assert!(
        error.contains("`network 1.target 1.stops` is 65536 places"),
        "{error}"
    );
    assert!(error.contains("65535 places or fewer"), "{error}");
}

/// Every camera of every built-in scenario has its stops in view, all of the ball, away from the
/// border; so have the references theirs.
#[test]
fn planned_stops_are_in_view() {
    for (name, _) in BUILT_IN {
        for (path, stops) in [(1, 3), (2, 3), (3, 3), (1, 10)] {
            let changes = Overrides {
                path: Some(path),
                stops: Some(stops),
                ..Overrides::default()
            };
            let site = load(name, &changes);
            for network in &site.networks {
                let target = &network.targets[0];
                let radius = site.world.targets()[target.index].radius;
                let plan = target.plan.as_ref().unwrap();
                for (node, camera) in network.cameras.iter().enumerate() {
                    let is_reference = network.references.contains(&node);
                    let seen = plan.stops.iter().filter(|stop| {
                        let sight = site.world.sight(camera.index, stop.place, radius);
                        (stop.for_references || !is_reference)
                            && sight.is_some_and(|sight| sight.is_whole())
                    });
                    let least = match is_reference {
                        true => stops.min(REFERENCE_STOPS),
                        false => stops,
                    };
                    assert!(seen.count() >= least, "{name}, camera {}", camera.id);
                }
                let first: Vec<_> = plan.stops.iter().map(|stop| stop.for_references).collect();
                assert!(
                    first.is_sorted_by(|a, b| a >= b),
                    "the references' stops come first"
                );
                // The budget of the figures, with a margin (lab: in inches; office: cameras that see
                // farther, of a larger place).
                let limit = match name {
                    "lab" => 0.3,
                    "office" => 0.1,
                    _ => 0.05,
                };
                for (camera, bound) in &plan.cameras {
                    let bound = bound.unwrap();
                    let place = (bound.m11 + bound.m22).sqrt();
                    let heading = bound.m33.sqrt().to_degrees();
                    assert!(
                        place < limit && heading < 0.5,
                        "{name} {camera}: {place} {heading}"
                    );
                }
            }
        }
    }
}

#[test]
fn paths_differ_and_seeds_do_not_matter() {
    let stops = |path, seed| {
        let changes = Overrides {
            path: Some(path),
            seed: Some(seed),
            ..Overrides::default()
        };
        load("thesis-13", &changes)
            .networks
            .remove(0)
            .targets
            .remove(0)
            .stops
    };
    assert_eq!(stops(1, 1), stops(1, 2));
    for (a, b) in [(1, 2), (2, 3), (1, 3)] {
        let (a, b) = (stops(a, 1), stops(b, 1));
        let common = a.iter().filter(|place| b.contains(place)).count();
        assert_eq!(common, 0);
    }
}

#[test]
fn a_larger_grid_contains_the_smaller_one() {
    let cameras = |nodes| {
        let changes = Overrides {
            nodes: Some(nodes),
            ..Overrides::default()
        };
        let scenario = Scenario::load("grid", &changes).unwrap();
        scenario.networks
    };
    let (small, large) = (cameras(20), cameras(120));
    assert_eq!(small.len(), 2);
    assert_eq!(small[1].cameras.len(), 7);
    assert_eq!(
        large
            .iter()
            .map(|network| network.cameras.len())
            .sum::<usize>(),
        120
    );
    // The first cell stands in the corner whatever comes after it.
    assert_eq!(small[0], large[0]);
    for pair in large.windows(2) {
        assert_ne!(pair[0].channel, pair[1].channel);
        assert_ne!(pair[0].targets[0].colour, pair[1].targets[0].colour);
    }
}

#[test]
fn the_command_line_changes_a_scenario() {
    let changes = Overrides {
        variant: Some(Variant::Stage),
        model: Some(Projection::PinHole),
        drift: true,
        ..Overrides::default()
    };
    let scenario = Scenario::load("thesis-13", &changes).unwrap();
    assert_eq!(scenario.sensor, Some(SensorTable::DRIFT));
    let site = scenario.put_up().unwrap();
    let node = &site.networks[0].cameras[4];
    let camera = &site.world.cameras()[node.index];
    assert_eq!(camera.lens.projection(), Projection::EqualAngle);
    assert_eq!(node.model.projection(), Projection::PinHole);
    let nodes = Overrides {
        nodes: Some(5),
        ..Overrides::default()
    };
    let refused = Scenario::load("thesis-13", &nodes).unwrap_err().to_string();
    assert!(
        refused.contains("only scenarios with a `grid`"),
        "{refused}"
    );
}

/// A written file reads the same again.
#[test]
fn scenarios_can_be_written() {
    let faults = "[camera.faults]\ncorrupt_line = 0.05\n\
                  [[event]]\nat_s = 60.0\naction = { restart = { node = 3 } }\n\
                  [[event]]\nat_s = 70.0\naction = { jam = { for_s = 5.0, channel = 15 } }\n\
                  [[world.obstacle]]\npillar = { x = 20.0, y = 20.0, radius = 1.0 }\n";
    let texts = BUILT_IN.map(|(_, text)| text.to_owned());
    for text in texts.into_iter().chain([small(faults, TARGET)]) {
        let scenario = Scenario::from_toml(&text, &Overrides::default()).unwrap();
        let written = toml::to_string(&scenario).unwrap();
        let again = Scenario::from_toml(&written, &Overrides::default()).unwrap();
        assert_eq!(again, scenario);
    }
}

/// So many targets, no two of one colour.
fn colours(count: u16) -> String {
    let targets =
        (0..count).map(|n| format!("{{ id = {}, colour = [{}, 90, 200] }},", 20 + n, 40 * n));
    targets.collect()
}

/// Four colours are what a camera can tell apart, and two cameras may stand in one place.
#[test]
fn what_is_only_unusual_is_possible() {
    for text in [
        small("", &format!("target = [{}]", colours(4))),
        small("", TARGET).replace("x = 5.0, y = 10.0", "x = 10.0, y = 0.0"),
        small("", "target = [{ id = 59999 }]"),
    ] {
        let scenario = Scenario::from_toml(&text, &Overrides::default()).unwrap();
        assert!(scenario.put_up().is_ok(), "{text}");
        assert!(!configs(&scenario).is_empty(), "{text}");
    }
}

#[test]
fn what_is_wrong_is_named() {
    let stops = |places: &str| format!("target = [{{ id = 20, stops = [{places}] }}]\n");
    let wall = "[[world.obstacle]]\nwall = [[5.0, 0.0], [5.0, 6.0]]\n";
    for (text, parts) in [
        (
            small("sed = 1", TARGET),
            [
                "line 2: there is no key `sed` at the top",
                "did you mean `seed`?",
            ],
        ),
        (
            small("unit = \"feet\"", TARGET),
            ["`unit_metres` is missing", "as `unit` is \"feet\""],
        ),
        (
            small("unit_metres = 0.0", TARGET),
            ["`unit_metres` is 0", "0.0001 to 100000 metres"],
        ),
        (
            small("stops = 2", TARGET),
            [
                "`stops` is 2",
                "3 to 16: a pose needs three sightings, and a camera keeps 16",
            ],
        ),
        (
            small("[camera]\nrange = -1.0", TARGET),
            ["`camera.range` is -1", "0.001"],
        ),
        (
            small("[camera]\nfield_of_view_deg = 180.0", TARGET),
            ["`camera.field_of_view_deg` is 180", "1 to 170"],
        ),
        (
            small("[camera]\ndistortion = [-2.0, 0.0]", TARGET),
            [
                "`camera.distortion` is [-2, 0]",
                "does not fold the corners",
            ],
        ),
        (
            small("[camera]\ndistortion = [-0.9, 0.0]", TARGET),
            [
                "`camera.distortion` is [-0.9, 0]",
                "does not fold the corners",
            ],
        ),
        (
            small("[camera.model]\ndistortion = [-2.0, 0.0]", TARGET),
            [
                "`camera.model.distortion` is [-2, 0]",
                "does not fold the corners",
            ],
        ),
        (
            small("[[event]]\nat_s = 1.0\naction = {}", TARGET),
            ["line 4", "exactly one key is needed in this table"],
        ),
        (
            small("[camera]\nbaud = 1", TARGET),
            ["camera.baud", "38400"],
        ),
        (
            small(
                "[camera]\nkind = \"pixy2\"\n[camera.faults]\nslow = 0.1",
                TARGET,
            ),
            [
                "faults.slow",
                "`corrupt_line` alone for this kind of camera",
            ],
        ),
        (
            small("[[world.obstacle]]\nheight = 1.0", TARGET),
            ["one `wall`, one `pillar` or one `block`", "line 2"],
        ),
        (
            small("[camera.faults]\ncorupt_line = 0.1", TARGET),
            ["camera.faults.corupt_line", "corrupt_line"],
        ),
        (
            small("[radio]\nmedium = \"unit-disk\"", TARGET),
            ["the key `range` is missing here: add it", "line 2"],
        ),
        (
            small(
                "[radio]\nmedium = \"unit-disk\"\nrange = 9.0\nloss = 1.5",
                TARGET,
            ),
            ["`radio.loss` is 1.5", "0 to 1"],
        ),
        (
            small("", "target = [{ id = 3 }]"),
            ["target 1.id` is 3", "no other node"],
        ),
        (
            small("", "target = []"),
            ["network 1.target", "at least once"],
        ),
        (
            small("", &stops("[0.0, 1.0]")),
            ["target 1.stops` is 1 place", "3 places"],
        ),
        (
            small("", &stops("[0.0, 1.0], [50.0, 1.0], [1.0, 1.0]")),
            ["place 2` is (50, 1)", "world.high"],
        ),
        (
            small(wall, &stops("[0.0, 1.0], [3.0, 1.0], [8.0, 1.0]")),
            ["obstacle 1", "stops 2 and 3"],
        ),
        (
            small(
                wall,
                "target = [{ id = 20, stops = [[0.0, 7.0], [4.95, 7.0], [4.95, 6.1]] }]",
            ),
            ["obstacle 1", "stops 2 and 3"],
        ),
        (
            small("[[object]]\npath = [[1.0, 1.0], [1.0, 500.0]]", TARGET),
            ["`object 1.path, place 2` is (1, 500)", "world.high"],
        ),
        (
            small(
                &format!("{wall}\n[[object]]\npath = [[3.0, 1.0], [8.0, 1.0]]"),
                "target = [{ id = 20, stops = [[0.0, 7.0], [4.0, 7.0], [9.0, 7.0]] }]",
            ),
            ["object 1 would go through obstacle 1", "stops 1 and 2"],
        ),
        (
            small(
                "[[world.obstacle]]\npillar = { x = 5.0, y = 9.8, radius = 0.5 }",
                TARGET,
            ),
            ["camera 3 (x, y)` is (5, 10)", "outside of obstacle 1"],
        ),
        (
            // Blinkers for camera 3.
            small(
                "[[world.obstacle]]\nwall = [[4.0, 9.5], [6.0, 9.5]]",
                TARGET,
            ),
            ["camera 3", "3 stops"],
        ),
        (
            small(
                "[world]\nlow = [-2.0, -2.0]\nhigh = [28.0, 28.0]\n[[event]]\nat_s = 1.0\naction = { restart = { node = 9 } }",
                TARGET,
            ),
            ["event 1.node` is 9", "the `id` of a camera"],
        ),
        (
            small(
                "[[event]]\nat_s = 1.0\naction = { unplug-camera = { node = 20, for_s = 1.0 } }",
                TARGET,
            ),
            ["event 1.node` is 20", "of a camera"],
        ),
        (
            small("", "target = [{ id = 60000 }]"),
            [
                "target 1.id` is 60000",
                "1 to 59999: larger numbers are those of coordinators",
            ],
        ),
        (
            small("", "target = [{ id = 0 }]"),
            ["target 1.id` is 0", "1 to 59999"],
        ),
        (
            small(
                "",
                "area = [[9.0, 0.0], [0.0, 9.0]]\ntarget = [{ id = 20 }]",
            ),
            ["network 1.area", "the lowest corner"],
        ),
        (
            small("", &format!("target = [{}]", colours(5))),
            ["different colours)` is 5", "1 to 4"],
        ),
        (
            small("[firmware]\nstops = 17", TARGET),
            ["`firmware.stops` is 17", "3 to 16"],
        ),
        (
            small(
                "[firmware]\nweak_sigma = 0.1\ngood_enough_position = 0.2",
                TARGET,
            ),
            [
                "node 1 cannot be configured",
                "weak: both sigmas must be at least the good-enough",
            ],
        ),
        (small("path = 0", TARGET), ["`path` is 0", "1 to"]),
        (small("stops = 0", TARGET), ["`stops` is 0", "3 to 16"]),
        (small("stops = 17", TARGET), ["`stops` is 17", "3 to 16"]),
        (
            small("[walk]\nspeed = nan", TARGET),
            ["`walk.speed` is NaN", "0.001 to"],
        ),
        (
            small("", TARGET).replace("x = 5.0", "x = nan"),
            ["camera 3.x` is NaN", "-100000 to 100000"],
        ),
        (
            small("", TARGET).replace("x = 5.0", "x = inf"),
            ["camera 3.x` is inf", "-100000 to 100000"],
        ),
        (
            small("", TARGET).replace("x = 10.0", "x = 0.0"),
            ["network 1.references", "two cameras at one place"],
        ),
        (
            "name = \"x\"\n[[network]]\nreferences = { cameras = [1, 2] }\ncamera = []\n\
             target = [{ id = 20 }]"
                .into(),
            [
                "network 1 (cameras and targets)` is 1",
                "at least two cameras",
            ],
        ),
        (
            "name = \"x\"\n[camera]\nrange = nan\n[grid]\n".into(),
            ["`camera.range` is NaN", "0.001"],
        ),
        (
            "name = \"x\"\n[grid]\nnodes = 20000\ncell_nodes = 2\n".into(),
            ["network (how many)` is 10000", "1 to 5536"],
        ),
        ("name = \"x\"".into(), ["`network` is missing", "grid"]),
        (
            "name = \"x\"\n[grid]\nnodes = 1\n".into(),
            ["`grid.nodes` is 1", "2 to 20000"],
        ),
    ] {
        let said = error(&text);
        for part in parts {
            assert!(said.contains(part), "`{part}` is not in: {said}");
        }
    }
    let unknown = Scenario::load("thesis", &Overrides::default())
        .unwrap_err()
        .to_string();
    assert!(
        unknown.contains("thesis-13, lab, grid, office"),
        "{unknown}"
    );
}

/// A pillar on the site: no leg comes near it, and no stop is behind it.
#[test]
fn planned_ways_go_around_obstacles() {
    let pillar = "[[world.obstacle]]\npillar = { x = 5.0, y = 5.0, radius = 0.4 }\n";
    let scenario = Scenario::from_toml(&small(pillar, TARGET), &Overrides::default()).unwrap();
    let site = scenario.put_up().unwrap();
    let stops = &site.networks[0].targets[0].stops;
    for leg in stops.windows(2) {
        let (a, along) = (leg[0], leg[1] - leg[0]);
        for step in 0..=100 {
            let place = a + along * (f64::from(step) / 100.0);
            assert!((place - Point2::new(5.0, 5.0)).norm() >= 0.4 + 0.15 - 1e-9);
        }
    }
}

/// Stops from which the references also learn their distance and how the compass is turned.
#[test]
fn what_the_references_do_not_know_is_planned_for() {
    let unknown = "references = { cameras = [1, 2], baseline_known = false, \
                   frame_heading_known = false, compass_deg = 30.0 }";
    let text = small("", TARGET).replace("references = { cameras = [1, 2] }", unknown);
    for path in 1..=3 {
        let changes = Overrides {
            path: Some(path),
            ..Overrides::default()
        };
        let site = Scenario::from_toml(&text, &changes)
            .unwrap()
            .put_up()
            .unwrap();
        let target = &site.networks[0].targets[0];
        assert!((target.axis.to_degrees() - 30.0).abs() < 1e-9);
        let bound = target.plan.as_ref().unwrap().references;
        let known = load("thesis-13", &changes)
            .networks
            .remove(0)
            .targets
            .remove(0);
        let known = known.plan.unwrap().references;
        // It is learnt, and costs something.
        assert!(bound.m55.sqrt() < 0.05 && bound.m66.sqrt() < 1.0, "{bound}");
        assert!(bound.m55 > known.m55 && bound.m66 > known.m66);
    }
}
