//! One file, two uses: what nodes are configured to, and what a file must say for that.

use nalgebra::Point2;
use node_firmware::{
    config::{
        CameraConfig, Config, CoordinatorConfig, LensSigma, RoleConfig, SiteKey, Subjects,
        TargetConfig,
    },
    message::Duty,
    vision::{ColourWindow, Lens},
};
use site::{Overrides, Purpose, ScatterTable, Scenario, ScenarioError};

const SITE: &str = r#"
name = "small"
unit = "m"
[camera]
projection = "pin-hole"
field_of_view_deg = 47.0
[firmware]
systematic_heading_deg = 3.0
systematic_scale = 0.08
[[network]]
references = { cameras = [1, 2] }
camera = [
  { id = 1, x = 3.0, y = 4.0 },
  { id = 2, x = 3.0, y = 14.0 },
  { id = 3 },
]
target = [{ id = 20 }]
"#;

fn key() -> SiteKey {
    SiteKey::new(1, *b"0123456789abcdef")
}

fn scenario(text: &str) -> Scenario {
    Scenario::from_toml(text, &Overrides::default()).unwrap_or_else(|error| panic!("{error}"))
}

fn refused(text: &str) -> String {
    let scenario = Scenario::from_toml(text, &Overrides::default());
    match scenario.and_then(|scenario| site::configs(&scenario, key())) {
        Ok(_) => panic!("nothing is wrong with\n{text}"),
        Err(error) => error.to_string(),
    }
}

fn camera(config: &Config) -> &CameraConfig {
    match &config.role {
        RoleConfig::Camera(camera) => camera,
        other => panic!("{other:?}"),
    }
}

fn target(config: &Config) -> &TargetConfig {
    match &config.role {
        RoleConfig::Target(target) => target,
        other => panic!("{other:?}"),
    }
}

/// Values that a file does not say are the firmware's: there are no other defaults.
#[test]
fn defaults_are_those_of_the_firmware() {
    let silent = SITE
        .replace("systematic_heading_deg = 3.0\n", "")
        .replace("systematic_scale = 0.08\n", "");
    let networks = site::configs(&scenario(&silent), key()).unwrap();
    let [network] = &networks[..] else {
        panic!("{networks:?}");
    };
    let orange = ColourWindow {
        red: [185, 240],
        green: [60, 150],
        blue: [16, 80],
    };
    let subjects = Subjects::Colours([orange].into_iter().collect());
    // Two columns of such a lens.
    let mut lens_sigma = LensSigma::UNMEASURED;
    lens_sigma.principal_deg =
        (2.0 * (2.0 * 23.5_f64.to_radians().tan() / 87.0)).to_degrees() as f32;
    let mut told = CameraConfig::new(Lens::pin_hole(88, 47.0), subjects);
    told.lens_sigma = lens_sigma;
    told.may_be_elected = false;
    told.baseline = Some(10.0);
    told.frame_heading_deg = Some(0.0);
    assert_eq!(camera(network.cameras[2].settings()), &told);
    let mut told = TargetConfig::default();
    told.lens_sigma = lens_sigma;
    assert_eq!(target(network.targets[0].settings()), &told);
    let RoleConfig::Coordinator(coordinator) = &network.coordinator.settings().role else {
        panic!("{network:?}");
    };
    assert_eq!(
        coordinator.join_window_s,
        CoordinatorConfig::default().join_window_s
    );
    let members: Vec<_> = network.iter().skip(1).collect();
    assert_eq!(members.len(), 4);
    for member in members {
        assert!(coordinator.allow.contains(&member.settings().id));
        assert_eq!(member.settings().site_key, key());
        assert_eq!(member.settings().channels, 1 << 15);
    }
    assert_eq!(network.coordinator.settings().id, site::coordinator_id(0));
    for (config, duty, x) in [
        (&network.cameras[0], Duty::First, 0.0),
        (&network.cameras[1], Duty::Second, 10.0),
    ] {
        let reference = camera(config.settings()).reference.unwrap();
        assert_eq!((reference.duty, reference.position), (duty, Some([x, 0.0])));
    }
}

/// Every parameter of the firmware that a file can have, off its default, arrives; a node's own
/// stands over that of all.
#[test]
fn every_parameter_arrives() {
    let site = scenario(include_str!("every_key.toml"));
    let network = site::configs(&site, key()).unwrap().remove(0);
    let all = camera(network.cameras[1].settings());
    assert_eq!((all.stops, all.reference_stops, all.refine), (5, 4, false));
    assert_eq!((all.round, all.first_column), (false, 0));
    let good = all.good_enough;
    assert_eq!((good.position, good.heading_deg), (0.03, 0.2));
    assert_eq!((all.sigma_floor_px, all.baud), (0.1, 115_200));
    assert_eq!(all.baseline, Some(9.9));
    assert_eq!(all.frame_heading_deg, Some(20.0));
    assert_eq!(all.lens.principal_column, Some(43.0));
    assert_eq!(all.lens.field_of_view_deg, 58.0);
    let own = camera(network.cameras[0].settings());
    assert_eq!((own.weak.position, all.weak.position), (0.8, 0.7));
    assert_eq!(own.weak.heading_deg, 9.0);
    assert_eq!((own.lens.columns, own.baud), (160, 57_600));
    assert_eq!(own.lens.field_of_view_deg, 61.5);
    let mut expected = TargetConfig::default();
    expected.still_after_ms = 1_600;
    expected.systematic_heading_deg = 2.0;
    expected.systematic_scale = 0.05;
    expected.standing_sigma = 0.03;
    expected.ball_radius = 0.16;
    expected.dwell_least_ms = 1_500;
    expected.dwell_most_ms = 90_000;
    // Of the lens of 160 columns and 61.5 degrees, of which one column is least; the other has 58 degrees
    // and 88 columns of equal angles.
    expected.lens_sigma.focal = 0.03;
    expected.lens_sigma.principal_deg = 1.0;
    expected.lens_sigma.tilt_deg = 1.5;
    expected.survey_sigma.baseline = 0.02;
    expected.survey_sigma.position = 0.04;
    expected.sensor.hard_iron = [1.0, 2.0, -3.0];
    expected.sensor.step_length = 1.5;
    assert_eq!(target(network.targets[0].settings()), &expected);
    let coordinator = &network.coordinator;
    assert_eq!(coordinator.settings().channels, 1 << 15 | 1 << 20);
    assert_eq!(coordinator.settings().tx_power, 4);
    let RoleConfig::Coordinator(parameters) = &coordinator.settings().role else {
        panic!("{coordinator:?}");
    };
    assert_eq!(parameters.join_window_s, 60);
    assert!(parameters.allow.contains(&9));
    assert_eq!(parameters.allow.len(), 5);
}

/// The rehearsed configuration is the one that is deployed.
#[test]
fn built_in_files_configure_nodes_too() {
    for (name, _) in site::BUILT_IN {
        let scenario = Scenario::load(name, &Overrides::default()).unwrap();
        assert_eq!(scenario.assumptions(Purpose::Rehearsal), [], "{name}");
        let deployed = site::provision(&scenario, key());
        // In inches, and no target walks there.
        if name != "lab" {
            let rehearsed = site::configs(&scenario, key()).unwrap();
            assert_eq!(deployed.unwrap(), rehearsed, "{name}");
        }
    }
}

/// Values that matter and are not said.
#[test]
fn what_is_left_open_is_asked_for() {
    assert!(site::provision(&scenario(SITE), key()).is_ok());
    let open = |text: &str| {
        let error = site::provision(&scenario(text), key()).unwrap_err();
        assert!(matches!(error, ScenarioError::Open(_)));
        error.to_string()
    };
    for (line, asked) in [
        ("field_of_view_deg = 47.0", "field of view of 3 cameras"),
        ("projection = \"pin-hole\"", "the lens of 3 cameras"),
        ("systematic_heading_deg = 3.0", "compass of target 20"),
        ("systematic_scale = 0.08", "step length of target 20"),
    ] {
        let said = open(&SITE.replace(line, ""));
        let key = line.split(' ').next().unwrap();
        assert!(said.contains(asked) && said.contains(key), "{said}");
    }
    // In inches no target has steps of 0.45.
    let inches = SITE.replace("unit = \"m\"", "unit = \"inches\"\nunit_metres = 0.0254");
    let said = open(&inches);
    assert!(said.contains("`step_length` into `[firmware]`"), "{said}");
    // One of the cameras may say it for itself.
    let own = SITE
        .replace("field_of_view_deg = 47.0", "")
        .replace("id = 3 }", "id = 3, field_of_view_deg = 50.0 }");
    let said = open(&own);
    assert!(said.contains("cameras 1 and 2"), "{said}");
    // A rehearsal also asks for how the step sensor really errs.
    let notes = scenario(SITE).assumptions(Purpose::Rehearsal);
    assert_eq!(notes.len(), 1);
    assert!(notes[0].to_string().contains("`[sensor]`"), "{}", notes[0]);
}

/// A value unlike any that may be written suggests none.
#[test]
fn no_value_is_suggested_for_another_one() {
    for other in ["\"zzz\"", "7"] {
        let said = refused(&SITE.replace("\"pin-hole\"", other));
        assert!(said.contains("or `\"equal-angle\"`"), "{said}");
        assert!(!said.contains("did you mean"), "{said}");
    }
}

/// A target stands as still in inches as in metres.
#[test]
fn targets_stand_within_two_centimetres_in_any_unit() {
    for (unit, metres) in [
        ("unit = \"m\"", 1.0),
        ("unit = \"inches\"\nunit_metres = 0.0254", 0.0254),
        ("unit = \"km\"\nunit_metres = 1000", 1000.0),
    ] {
        let site = scenario(&SITE.replace("unit = \"m\"", unit));
        let configs = site::configs(&site, key()).unwrap();
        let sigma = f64::from(target(configs[0].targets[0].settings()).standing_sigma) * metres;
        assert!((sigma - 0.02).abs() < 1e-6, "{unit}: {sigma}");
    }
}

/// A rehearsal needs to know where cameras stand; nodes do not.
#[test]
fn a_rehearsal_needs_places() {
    let error = scenario(SITE).put_up().unwrap_err().to_string();
    let expected = "line 13: `network 1.camera 1.heading_deg` is missing";
    assert!(error.starts_with(expected), "{error}");
}

#[test]
fn frames_in_the_building() {
    let network = |text: &str| scenario(text).networks.remove(0);
    let frame = network(SITE).building_frame().unwrap();
    assert_eq!(frame.origin, Point2::new(3.0, 4.0));
    assert!((frame.heading.to_degrees() - 90.0).abs() < 1e-9);
    let moved = SITE
        .replace(", x = 3.0, y = 4.0", "")
        .replace(", x = 3.0, y = 14.0", "");
    let said = refused(&moved);
    assert!(said.contains("references.baseline` is missing"), "{said}");
    assert!(said.starts_with("line 11: "), "{said}");
    let measured = moved.replace("[1, 2] }", "[1, 2], baseline = 9.7 }");
    assert_eq!(network(&measured).building_frame(), None);
    let placed = measured.replace(
        "[[network]]",
        "[[network]]\nframe = { x = 1.0, y = 2.0, heading_deg = 30.0 }",
    );
    let frame = network(&placed).building_frame().unwrap();
    assert_eq!(frame.origin, Point2::new(1.0, 2.0));
    let configs = site::configs(&scenario(&placed), key()).unwrap();
    assert_eq!(camera(configs[0].cameras[2].settings()).baseline, Some(9.7));
    // A compass that shows the building's x axis is 90 degrees off in the frame.
    let compass = SITE.replace("[1, 2] }", "[1, 2], compass_deg = 0.0 }");
    let configs = site::configs(&scenario(&compass), key()).unwrap();
    let heading = camera(configs[0].cameras[2].settings())
        .frame_heading_deg
        .unwrap();
    assert!((heading + 90.0).abs() < 1e-4, "{heading}");
}

#[test]
fn cameras_scatter_by_the_seed_and_all_else_follows() {
    let with = |seed, scatter| {
        let changes = Overrides {
            seed: Some(seed),
            scatter: Some(scatter),
            ..Overrides::default()
        };
        Scenario::load("thesis-13", &changes).unwrap()
    };
    let scatter = ScatterTable {
        position: 0.3,
        heading_deg: 3.0,
    };
    let plain = with(1, ScatterTable::default());
    let (one, other) = (with(1, scatter), with(2, scatter));
    let scattered = |scenario: &Scenario| scenario.rehearsed().unwrap().0;
    assert_eq!(scattered(&plain), plain);
    assert_eq!(scattered(&one), scattered(&one));
    assert_ne!(scattered(&one).networks, scattered(&other).networks);
    let baseline = |scenario: &Scenario| {
        let configs = site::configs(scenario, key()).unwrap();
        f64::from(camera(configs[0].cameras[5].settings()).baseline.unwrap())
    };
    // Nothing is drawn for nodes that are deployed.
    assert_eq!(baseline(&one), baseline(&plain));
    let (mut squares, mut turns, mut count) = (0.0, 0.0, 0.0);
    for seed in 1..=60 {
        let moved = scattered(&with(seed, scatter));
        let [first, second] = [0, 1].map(|n| moved.networks[0].cameras[n].place().unwrap());
        assert!((baseline(&moved) - (second - first).norm()).abs() < 1e-5);
        let cameras = plain.networks[0].cameras.iter();
        for (was, is) in cameras.zip(&moved.networks[0].cameras) {
            squares += (is.place().unwrap() - was.place().unwrap()).norm_squared();
            turns += (is.heading_deg.unwrap() - was.heading_deg.unwrap()).powi(2);
            count += 1.0;
        }
    }
    // A distance that the file tells is as wrong as before.
    let mut told = with(3, scatter);
    told.networks[0].references.baseline = plain.networks[0].baseline().map(|right| 1.02 * right);
    let moved = scattered(&told);
    let right = baseline(&scattered(&with(3, scatter)));
    assert_ne!(right, baseline(&plain));
    assert!((baseline(&moved) / right - 1.02).abs() < 1e-5);
    let (place, turn) = ((squares / count / 2.0_f64).sqrt(), f64::sqrt(turns / count));
    assert!((0.28..0.32).contains(&place), "{place}");
    assert!((2.8..3.2).contains(&turn), "{turn}");
}

fn event(at: f64, action: &str) -> String {
    format!("[[event]]\nat_s = {at}\naction = {{ {action} }}\n")
}

fn head(lines: &str) -> String {
    SITE.replace("[camera]", &format!("{lines}\n[camera]"))
}

fn network(old: &str, new: &str) -> String {
    assert!(SITE.contains(old), "{old}");
    SITE.replace(old, new)
}

fn says(cases: &[(String, [&str; 2])]) {
    for (text, parts) in cases {
        let said = refused(text);
        for part in parts {
            assert!(said.contains(part), "`{part}` is not in: {said}");
        }
    }
}

/// Arrays have neither too many elements nor too few.
#[test]
fn arrays_have_their_length() {
    let wall = "[[world.obstacle]]\nwall = ";
    let target = |keys: &str| network("{ id = 20 }", &format!("{{ id = 20, {keys} }}"));
    says(&[
        (
            head("[world]\nlow = [1, 2, 3]"),
            ["line 5: `world.low` is [1, 2, 3]", "2 numbers"],
        ),
        (
            head("[world]\nlow = [1]"),
            ["line 5: `world.low` is [1]", "2 numbers"],
        ),
        (
            head(&format!("{wall}[[1, 2]]")),
            ["line 5: `world.obstacle 1.wall` is 1 place", "2 places"],
        ),
        (
            head(&format!("{wall}[[1, 2], [3, 4, 5]]")),
            ["wall, place 2` is [3, 4, 5]", "a place `[x, y]`"],
        ),
        (
            head("[[world.obstacle]]\nblock = [[1, 2], [3, 4]]"),
            ["obstacle 1.block` is 2 places", "two make a `wall`"],
        ),
        (
            target("colour = [1, 2, 3, 4]"),
            [
                "line 17: `network 1.target 1.colour` is [1, 2, 3, 4]",
                "3 whole",
            ],
        ),
        (target("colour = [1, 2, 300]"), ["colour", "0 to 255"]),
        (
            target("stops = [[1, 2], [3, 4], [5, 6, 7]]"),
            ["target 1.stops, place 3", "two numbers"],
        ),
        (
            network(
                "[[network]]",
                "[[network]]\narea = [[1, 2], [3, 4], [5, 6]]",
            ),
            ["network 1.area", "2 places"],
        ),
        (
            network("[1, 2]", "[1, 2, 3]"),
            ["references.cameras` is [1, 2, 3]", "2 whole numbers"],
        ),
    ]);
}

/// Each error names the key and its line.
#[test]
fn errors_name_key_and_line() {
    let many: String = (3..=122).map(|id| format!("{{ id = {id} }},")).collect();
    let references = |keys: &str| network("[1, 2] }", &format!("[1, 2], {keys} }}"));
    says(&[
        (
            network("{ id = 3 }", "{ id = 3, feild_of_view_deg = 4 }"),
            [
                "line 15: there is no key `feild_of_view_deg` in `network 1.camera 3`",
                "did you mean `field_of_view_deg`?",
            ],
        ),
        (
            head("stps = 4"),
            ["no key `stps` at the top", "did you mean `stops`?"],
        ),
        (
            SITE.replace("id = 3 }", "id = 3, firmware = { sleep = true } }"),
            ["camera 3.firmware.sleep` is true", "the same for all nodes"],
        ),
        (
            SITE.replace("\"pin-hole\"", "\"pinnhole\""),
            [
                "line 5: `camera.projection` is pinnhole: it must be `\"pin-hole\"` or",
                "did you mean `\"pin-hole\"`?",
            ],
        ),
        (
            head("weak_sigma = 4"),
            ["no key `weak_sigma`", "`firmware.weak_sigma`?"],
        ),
        (
            network("id = 3", "id = 1"),
            ["line 15: `network 1.camera 3.id` is 1", "no other node"],
        ),
        (
            network("[1, 2]", "[1, 9]"),
            ["line 11: `network 1.references.cameras` is 9", "of this"],
        ),
        (
            network("[1, 2]", "[1, 1]"),
            ["the same camera twice", "two cameras"],
        ),
        (
            network("y = 4.0 }", "y = 4.0, heading_deg = 180.0 }")
                .replace("y = 14.0 }", "y = 14.0, heading_deg = 0.0 }"),
            ["two cameras whose views never meet", "turn them"],
        ),
        (
            references("elected = true, baseline_known = true"),
            ["baseline_known` is true", "references are `elected`"],
        ),
        (
            references("elected = true, frame_heading_known = true"),
            ["frame_heading_known` is true", "it is not known"],
        ),
        (
            references("elected = true, baseline = 4"),
            ["references.baseline` is given", "left out"],
        ),
        (
            network("  { id = 3 },\n", &many),
            ["(cameras and targets)` is 123", "make two networks"],
        ),
        (
            network("[[network]]", "[[network]]\nchannel = 27"),
            ["line 11: `network 1.channel` is 27", "11 to 26"],
        ),
        (
            references("baseline = 140.0"),
            [
                "references.baseline` is 140",
                "by `x` and `y` of cameras 1 and 2 that is 10.000",
            ],
        ),
        (
            head("unit_metres = 2.0"),
            ["`unit_metres` is 2", "1, as `unit` is"],
        ),
        (
            head("key_file = 3"),
            ["line 4: `key_file` is 3", "text of one line"],
        ),
        (
            network("systematic_scale = 0.08", "weak_sigma = 0.001"),
            ["line 13: node 1 cannot be configured", "good-enough"],
        ),
    ]);
}

/// Events that can never happen.
#[test]
fn impossible_events_are_refused() {
    let tail = |at: f64, action: &str| format!("{SITE}{}", event(at, action));
    says(&[
        (
            tail(-1.0, "restart = { node = 3 }"),
            ["line 19: `event 1.at_s` is -1", "0 to"],
        ),
        (
            tail(1.0, "restart = { node = 4 }"),
            ["line 20: `event 1.node` is 4", "the `id` of a camera"],
        ),
        (
            tail(1.0, "jam = { for_s = 1, channel = 20 }"),
            ["event 1.channel` is 20", "that a network uses: 15"],
        ),
        (
            tail(1.0, "jam = { for_s = 1, at = [1, 2, 3], reach = 2 }"),
            ["jam.at", "2 numbers"],
        ),
        (
            tail(1.0, "jam = { for_s = 1, reach = 2 }"),
            ["event 1.jam", "or neither"],
        ),
        (
            tail(1.0, "partition = { nodes = [], for_s = 1 }"),
            ["partition.nodes` is []", "some nodes"],
        ),
        (
            tail(1.0, "partition = { nodes = [0, 1, 2, 3, 20], for_s = 1 }"),
            ["event 1.nodes` is everybody", "the other side"],
        ),
        (
            tail(0.0, "replay = { node = 3, last_s = 5 }"),
            ["event 1.at_s` is 0", "after something was sent"],
        ),
        (
            tail(1.0, "loss = { share = 0.5, for_s = 0 }"),
            ["event 1.action.loss.for_s` is 0", "0.001 to"],
        ),
        (
            tail(1.0, "bump-camera = { node = 20 }"),
            ["event 1.node` is 20", "the `id` of a camera"],
        ),
        (
            tail(1.0, "slip = { node = 3, for_s = 1 }"),
            ["event 1.node` is 3", "the `id` of a target"],
        ),
    ]);
}

/// A press on the button of a board without power, or the pull of a plug that is out, changes nothing.
#[test]
fn things_that_go_wrong_may_overlap() {
    let dark = |at| event(at, "power-cut = { node = 3, for_s = 5 }");
    let text = format!("{SITE}{}{}", dark(10.0), dark(12.0));
    scenario(&(text + &event(12.0, "restart = { node = 3 }")));
}

/// A value from the command line is not in the file.
#[test]
fn what_the_command_line_says_has_no_line() {
    let changes = Overrides {
        stops: Some(17),
        ..Overrides::default()
    };
    let said = Scenario::from_toml(&format!("stops = 4\n{SITE}"), &changes)
        .unwrap_err()
        .to_string();
    assert!(said.starts_with("`stops` is 17"), "{said}");
}
