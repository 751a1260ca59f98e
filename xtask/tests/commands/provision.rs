//! Keys and configuration pages, as the commands make them.

use std::{
    fs,
    os::unix::fs::PermissionsExt,
    path::Path,
    time::{SystemTime, UNIX_EPOCH},
};

use crate::place::Place;
use node_firmware::{
    config::{
        CameraConfig, Config, CoordinatorConfig, Duty, Reference, Role, SensorConfig, Sigmas,
        SiteKey, Subjects, TargetConfig, page,
    },
    sight::{ColourWindow, Lens},
};
use zigbee_link::security::Protection;

const KEY: &str = "--site-key=site.sitekey";
const ALL_CHANNELS: u32 = 0x07FF_F800;

fn decode(place: &Place, name: &str) -> Config {
    page::decode(&fs::read(place.path(name)).unwrap()).unwrap()
}

fn mode(path: &Path) -> u32 {
    fs::metadata(path).unwrap().permissions().mode() & 0o777
}

#[test]
fn a_key_is_drawn_once_for_its_owner() {
    let place = Place::new();
    place.run(&["keygen"]).ok();
    let path = place.path("site.sitekey");
    assert_eq!(mode(&path), 0o600);
    let first = fs::read_to_string(&path).unwrap();
    assert_eq!(first.lines().count(), 1);
    assert!(first.starts_with("site-key 1 1 ") && first.is_ascii());

    place.run(&["keygen"]).fails(1, "is not overwritten");
    assert_eq!(fs::read_to_string(&path).unwrap(), first);
    place.run(&["keygen", "next.sitekey", "--index=2"]).ok();
    let next = fs::read_to_string(place.path("next.sitekey")).unwrap();
    assert!(next.starts_with("site-key 1 2 "));
    assert_ne!(first[13..45], next[13..45]);
    place.run(&["keygen", "other", "--index=0"]).fails(2, "0");
    place
        .run(&["keygen", "other", "--index=256"])
        .fails(2, "256");
    place.run(&["keygen", "no/such/folder"]).fails(1, "no/such");
    assert!(!place.path("other").exists());
}

#[test]
fn a_key_that_others_may_read_or_that_was_damaged_is_refused() {
    let place = Place::with_key();
    let make = || place.run(&["provision", KEY, "--role=target", "--id=3", "--overwrite"]);
    make().ok();
    let path = place.path("site.sitekey");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
    make().fails(1, "chmod 600");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o400)).unwrap();
    make().ok();

    fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    let digit = if &text[20..21] == "0" { "1" } else { "0" };
    for (damaged, error) in [
        (format!("{}{digit}{}", &text[..20], &text[21..]), "checksum"),
        (text[..40].to_owned(), "not whole"),
        (text.replace("site-key 1", "site-key 2"), "does not begin"),
        (String::new(), "does not begin"),
    ] {
        fs::write(&path, damaged).unwrap();
        make().fails(1, error);
    }
    fs::remove_file(&path).unwrap();
    make().fails(1, "cargo xtask keygen");
}

#[test]
fn options_make_a_page() {
    let place = Place::with_key();
    place
        .run(&[
            "provision",
            KEY,
            "--first-counter=70000",
            "--role=camera",
            "--id=3",
            "--extended=f4-ce-36-00-00-00-00-03",
            "--channels=11,26",
            "--tx-power=-4",
            "--columns=160",
            "--field-of-view=50",
            "--baud=115200",
            "--reference=second",
            "--position=-1.5,2",
            "--baseline=4",
            "--stops=5",
            "--colour=1-2,3-4,5-6",
            "--colour=17-18,19-20,21-22",
            "--out=page.bin",
        ])
        .ok();
    let window = |n: u8| ColourWindow {
        red: [n, n + 1],
        green: [n + 2, n + 3],
        blue: [n + 4, n + 5],
    };
    let expected = Config {
        id: 3,
        extended: Some([0xF4, 0xCE, 0x36, 0, 0, 0, 0, 3]),
        site_key: place.key(),
        first_counter: 70_000,
        channels: 1 << 11 | 1 << 26,
        tx_power: -4,
        protection: Protection::EncMic64,
        role: Role::Camera(CameraConfig {
            baud: 115_200,
            reference: Some(Reference {
                duty: Duty::Second,
                position: Some([-1.5, 2.0]),
            }),
            baseline: Some(4.0),
            stops: 5,
            ..CameraConfig::new(
                Lens::pin_hole(160, 50.0),
                Subjects::Colours([window(1), window(17)].into_iter().collect()),
            )
        }),
    };
    assert_eq!(decode(&place, "page.bin"), expected);
    let page = fs::read(place.path("page.bin")).unwrap();
    assert_eq!(page.len(), page::PAGE_MAX);
    assert_eq!(mode(&place.path("page.bin")), 0o600);
}

#[test]
fn every_role_has_usual_values() {
    let place = Place::with_key();
    let make = |role: &str, more: &str| {
        let role = format!("--role={role}");
        let mut run = vec!["provision", KEY, &role, "--id=7", "--overwrite"];
        run.extend(more.split(' '));
        place.run(&run).ok();
        decode(&place, "node-7.page.bin")
    };
    let camera = make("camera", "--motion=12");
    assert_eq!(
        camera.role,
        Role::Camera(CameraConfig::new(
            Lens::pin_hole(88, 45.0),
            Subjects::Motion { threshold: 12 }
        ))
    );
    assert_eq!((camera.extended, camera.channels), (None, ALL_CHANNELS));
    let target = make("target", "--target-colour=1");
    assert_eq!(
        target.role,
        Role::Target(TargetConfig {
            colour: 1,
            ..TargetConfig::default()
        })
    );
    let worn = make(
        "target",
        "--hard-iron=12.5,-40,3 --step-length=0.5 --systematic-heading=3 --systematic-scale=0.03",
    );
    assert_eq!(
        worn.role,
        Role::Target(TargetConfig {
            systematic_heading_deg: 3.0,
            systematic_scale: 0.03,
            sensor: SensorConfig {
                hard_iron: [12.5, -40.0, 3.0],
                step_length: 0.5,
            },
            ..TargetConfig::default()
        })
    );
    let half = make("target", "--step-length=0.5");
    let Role::Target(half) = half.role else {
        panic!("{half:?}");
    };
    assert_eq!(half.sensor.hard_iron, [0.0; 3]);
    let coordinator = make("coordinator", "--join-window=60");
    assert_eq!(
        coordinator.role,
        Role::Coordinator(CoordinatorConfig {
            allow: heapless::Vec::new(),
            join_window_s: 60,
        })
    );
}

#[test]
fn a_file_sets_everything_and_options_stand_over_it() {
    let place = Place::with_key();
    place.write(
        "node.toml",
        r#"
        role = "camera"
        id = 9
        extended = "02:00:00:00:00:00:00:09"
        channels = [15]
        tx-power = 8
        protection = 5
        baud = 57600
        first-column = 0
        round = false
        may-be-elected = false
        baseline = 6
        frame-heading-deg = -12.5
        reference-stops = 2
        stops = 6
        refine = false
        good-enough = { heading-deg = 0.5 }
        weak = { position = 0.75 }
        sigma-floor-px = 0.25
        [lens]
        projection = "equal-angle"
        principal-column = 40.5
        [reference]
        duty = "first"
        [subjects.motion]
        threshold = 20
        "#,
    );
    let run = ["provision", KEY, "--config=node.toml", "--id=10"];
    place.run(&run).ok();
    let config = decode(&place, "node-10.page.bin");
    let Role::Camera(camera) = &config.role else {
        panic!("{config:?}");
    };
    assert_eq!(config.id, 10);
    assert_eq!(config.extended, Some([2, 0, 0, 0, 0, 0, 0, 9]));
    assert_eq!((config.channels, config.tx_power), (1 << 15, 8));
    assert_eq!(config.protection, Protection::EncMic32);
    let expected = CameraConfig {
        lens: Lens {
            columns: 88,
            field_of_view_deg: 45.0,
            projection: calib_core::camera::Projection::EqualAngle,
            principal_column: Some(40.5),
        },
        baud: 57_600,
        first_column: 0,
        subjects: Subjects::Motion { threshold: 20 },
        round: false,
        reference: Some(Reference {
            duty: Duty::First,
            position: None,
        }),
        may_be_elected: false,
        baseline: Some(6.0),
        frame_heading_deg: Some(-12.5),
        reference_stops: 2,
        stops: 6,
        refine: false,
        good_enough: Sigmas {
            position: 0.02,
            heading_deg: 0.5,
        },
        weak: Sigmas {
            position: 0.75,
            heading_deg: 10.0,
        },
        sigma_floor_px: 0.25,
    };
    assert_eq!(*camera, expected);
}

/// 20,454 days lie between 1970 and 2026, 14 of them 29 February.
#[test]
fn the_first_counter_is_the_time() {
    let place = Place::with_key();
    let now = || {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
        unix.as_secs() - (56 * 365 + 14) * 86_400
    };
    let before = now();
    place
        .run(&["provision", KEY, "--role=target", "--id=1"])
        .ok();
    let counter = u64::from(decode(&place, "node-1.page.bin").first_counter);
    assert!((before..=now()).contains(&counter));
}

#[test]
fn what_is_wrong_is_told() {
    let place = Place::with_key();
    place.write("typo.toml", "role = 'camera'\nid = 1\n[lens]\nview = 3");
    place.write("key.toml", "role = 'target'\nid = 1\nsite-key = 'x'");
    place.write("syntax.toml", "role = ");
    place.write("zero.toml", "role = 'target'\nid = 0");
    place.write("large.toml", "role = 'target'\nid = 70000");
    for (status, error, arguments) in [
        (2, "--site-key", "--role=camera --id=1"),
        (2, "possible values", "KEY --role=lamp --id=1"),
        (2, "cannot be used with", "KEY --show=x"),
        (2, "--out", "KEY --site=x.toml"),
        (
            2,
            "cannot be used with",
            "KEY --colour=1-2,3-4,5-6 --motion=3",
        ),
        (2, "--reference", "KEY --role=camera --id=1 --position=1,2"),
        (2, "1..=65535", "KEY --role=target --id=0"),
        (2, "1..=65535", "KEY --role=target --id=65536"),
        (1, "id must be 1 to 65535, not 0", "KEY --config=zero.toml"),
        (1, "not 70000", "KEY --config=large.toml"),
        (
            1,
            "none.sitekey cannot be read",
            "--site-key=none.sitekey --role=target --id=1",
        ),
        (1, "use --role", "KEY --id=1"),
        (1, "use --id", "KEY --role=camera"),
        (
            1,
            "a target has no parameter `baud`",
            "KEY --role=target --id=1 --baud=9600",
        ),
        (
            1,
            "a camera has no parameter `lens.view`",
            "KEY --config=typo.toml",
        ),
        (1, "does not belong into a file", "KEY --config=key.toml"),
        (1, "syntax.toml is not TOML", "KEY --config=syntax.toml"),
        (1, "none.toml cannot be read", "KEY --config=none.toml"),
        (
            1,
            "is no EUI-64",
            "KEY --role=target --id=1 --extended=F4:CE",
        ),
        (
            1,
            "all zeros",
            "KEY --role=target --id=1 --extended=0000000000000000",
        ),
        (
            1,
            "no channel 27",
            "KEY --role=target --id=1 --channels=11,27",
        ),
        (
            1,
            "tx-power must be",
            "KEY --role=target --id=1 --tx-power=-41",
        ),
        (1, "baud must be", "KEY --role=camera --id=1 --baud=9601"),
        (1, "lens:", "KEY --role=camera --id=1 --field-of-view=180"),
        (
            1,
            "two numbers",
            "KEY --role=camera --id=1 --reference=first --position=1",
        ),
        (
            1,
            "three numbers",
            "KEY --role=target --id=1 --hard-iron=1,2",
        ),
        (
            1,
            "-400 to 400 uT",
            "KEY --role=target --id=1 --hard-iron=1,2,500",
        ),
        (1, "third", "KEY --role=camera --id=1 --reference=third"),
        (
            1,
            "three ranges",
            "KEY --role=camera --id=1 --colour=1-2,3-4",
        ),
        (
            1,
            "lowest level",
            "KEY --role=camera --id=1 --colour=2-1,3-4,5-6",
        ),
        (
            1,
            "join-window-s must be",
            "KEY --role=coordinator --id=1 --join-window=601",
        ),
        (
            1,
            "colour must be",
            "KEY --role=target --id=1 --target-colour=4",
        ),
        (
            1,
            "first-counter must be",
            "KEY --role=target --id=1 --first-counter=4294967295",
        ),
        (1, "is a folder", "KEY --role=target --id=1 --out=."),
        (1, "is no page", "--show=typo.toml"),
        (1, "none.bin cannot be read", "--show=none.bin"),
    ] {
        let mut words = vec!["provision"];
        words.extend(arguments.split(' ').map(|word| match word {
            "KEY" => KEY,
            word => word,
        }));
        place.run(&words).fails(status, error);
    }
    assert!(!place.path("node-1.page.bin").exists());
}

#[test]
fn no_page_is_written_over() {
    let place = Place::with_key();
    place.write("page.bin", "something else");
    let make = [
        "provision",
        KEY,
        "--role=target",
        "--id=1",
        "--out=page.bin",
    ];
    place.run(&make).fails(1, "page.bin exists");
    assert_eq!(
        fs::read_to_string(place.path("page.bin")).unwrap(),
        "something else"
    );
    place.run(&[&make[..], &["--overwrite"]].concat()).ok();
    assert_eq!(decode(&place, "page.bin").id, 1);
    // Of a site all pages are written, or none.
    place.write("site.toml", SITE);
    fs::create_dir(place.path("pages")).unwrap();
    place.write("pages/node-4.page.bin", "");
    let site = ["provision", KEY, "--site=site.toml", "--out=pages"];
    place.run(&site).fails(1, "node-4.page.bin exists");
    assert_eq!(fs::read_dir(place.path("pages")).unwrap().count(), 1);
    place.run(&[&site[..], &["--overwrite"]].concat()).ok();
    assert_eq!(fs::read_dir(place.path("pages")).unwrap().count(), 4);
}

/// A page has 512 bytes: what is shorter was cut off, what is longer does not fit its place.
#[test]
fn a_page_of_another_length_is_refused() {
    let place = Place::with_key();
    place
        .run(&[
            "provision",
            KEY,
            "--role=target",
            "--id=1",
            "--out=page.bin",
        ])
        .ok();
    let page = fs::read(place.path("page.bin")).unwrap();
    let show = ["provision", "--show=page.bin"];
    place.run(&show).ok();
    for (bytes, error) in [
        (page[..10].to_vec(), "cut off"),
        (page[..511].to_vec(), "511 bytes, a page has 512"),
        ([page.as_slice(), &[0xFF]].concat(), "513 bytes"),
        (Vec::new(), "blank"),
    ] {
        fs::write(place.path("page.bin"), bytes).unwrap();
        place.run(&show).fails(1, error);
    }
}

#[test]
fn a_page_is_shown_without_its_key() {
    let place = Place::new();
    let config = Config {
        id: 3,
        extended: Some([0xF4, 0xCE, 0x36, 0, 0, 0, 0, 0xAB]),
        site_key: SiteKey::new(9, *b"0123456789abcdef"),
        first_counter: 70_000,
        channels: 0x0210_8800,
        tx_power: -4,
        protection: Protection::EncMic64,
        role: Role::Camera(CameraConfig {
            reference: Some(Reference {
                duty: Duty::Second,
                position: Some([10.0, -0.5]),
            }),
            weak: Sigmas {
                position: 0.3,
                heading_deg: 7.5,
            },
            ..CameraConfig::new(Lens::pin_hole(88, 47.5), Subjects::Motion { threshold: 8 })
        }),
    };
    let mut bytes = [0; page::PAGE_MAX];
    page::encode(&config, &mut bytes).unwrap();
    fs::write(place.path("page.bin"), bytes).unwrap();
    let shown = place.run(&["provision", "--show=page.bin"]).ok();
    assert_eq!(shown, include_str!("data/shown.txt"));
    for secret in ["0123456789abcdef", "30313233", "48, 49"] {
        assert!(!shown.contains(secret));
    }
    bytes[20] ^= 1;
    fs::write(place.path("page.bin"), bytes).unwrap();
    place
        .run(&["provision", "--show=page.bin"])
        .fails(1, "damaged");
    fs::write(place.path("page.bin"), [0xFF; 512]).unwrap();
    place
        .run(&["provision", "--show=page.bin"])
        .fails(1, "blank");
}

/// What is shown says all: it makes the same page.
#[test]
fn what_is_shown_can_be_provisioned() {
    let place = Place::with_key();
    for options in [
        "--role=camera --reference=first --position=0.1,-2.7 --baseline=3.3",
        "--role=coordinator --allow=0200000000000001 --allow=0200000000000002 --join-window=9",
        "--role=target --target-colour=3 --extended=0200000000000003 --tx-power=-20",
    ] {
        let first = [
            "provision",
            KEY,
            "--id=5",
            "--first-counter=8",
            "--out=a",
            "--overwrite",
        ];
        let words: Vec<_> = first.into_iter().chain(options.split(' ')).collect();
        place.run(&words).ok();
        let shown = place.run(&["provision", "--show=a"]).ok();
        place.write("shown.toml", &shown);
        let again = [
            "--config=shown.toml",
            "--first-counter=8",
            "--out=b",
            "--overwrite",
        ];
        place
            .run(&[&["provision", KEY], again.as_slice()].concat())
            .ok();
        let pages = ["a", "b"].map(|name| fs::read(place.path(name)).unwrap());
        assert_eq!(pages[0], pages[1], "{options}");
    }
}

const SITE: &str = r#"
channels = [15, 20]
[camera]
stops = 4
lens = { field-of-view-deg = 47.0 }
[[node]]
role = "coordinator"
id = 1
[[node]]
role = "camera"
id = 258
reference = { duty = "first" }
lens = { columns = 160 }
[[node]]
role = "camera"
id = 3
extended = "F4:CE:36:00:00:00:00:03"
reference = { duty = "second" }
stops = 5
[[node]]
role = "target"
id = 4
channels = [15]
"#;

#[test]
fn a_site_has_all_its_nodes() {
    let place = Place::with_key();
    place.write("site.toml", SITE);
    place
        .run(&["provision", KEY, "--site=site.toml", "--out=pages"])
        .ok();
    let node = |id: u16| decode(&place, &format!("pages/node-{id}.page.bin"));
    let [coordinator, first, second, target] = [1, 258, 3, 4].map(node);
    let Role::Coordinator(own) = &coordinator.role else {
        panic!("{coordinator:?}");
    };
    let others = [&first, &second, &target].map(|config| config.extended.unwrap());
    assert_eq!(own.allow, others);
    assert_eq!(others[0], [2, 0, 0, 0, 0, 0, 1, 2]);
    assert_eq!(others[1], [0xF4, 0xCE, 0x36, 0, 0, 0, 0, 3]);
    let lens_and_stops = [&first, &second].map(|config| match &config.role {
        Role::Camera(camera) => (
            camera.lens.columns,
            camera.lens.field_of_view_deg,
            camera.stops,
        ),
        role => panic!("{role:?}"),
    });
    assert_eq!(lens_and_stops, [(160, 47.0, 4), (88, 47.0, 5)]);
    assert_eq!(first.channels, 1 << 15 | 1 << 20);
    assert_eq!(target.channels, 1 << 15);
    for config in [&coordinator, &first, &second, &target] {
        assert_eq!(config.site_key, place.key());
        assert_eq!(config.first_counter, coordinator.first_counter);
    }
}

#[test]
fn nodes_that_do_not_fit_together_are_refused() {
    let place = Place::with_key();
    let more: String = (100..130)
        .map(|id| format!("[[node]]\nrole = 'camera'\nid = {id}\n"))
        .collect();
    for (site, error) in [
        (SITE.replace("id = 3", "id = 4"), "two nodes have the id 4"),
        (
            SITE.replace("F4:CE:36:00:00:00:00:03", "02:00:00:00:00:00:00:04"),
            "nodes 3 and 4 both have the address",
        ),
        (
            SITE.replace("\"coordinator\"", "\"target\""),
            "one coordinator, not 0",
        ),
        (SITE.replace("\"second\"", "\"first\""), "not 2 and 0"),
        (
            format!("{SITE}colour = 1"),
            "does not know colour 1 of target 4",
        ),
        (format!("{SITE}{more}"), "at most 32 other nodes, not 33"),
        (
            format!("{SITE}speed = 1"),
            "1: a target has no parameter `speed`",
        ),
        (SITE.replace("id = 3\n", ""), "node number 3 of the file"),
        ("[camera]".to_owned(), "no `[[node]]`"),
        (SITE.replace("stops = 5", "stops = 2"), "stops must be"),
    ] {
        place.write("site.toml", &site);
        place
            .run(&["provision", KEY, "--site=site.toml", "--out=pages"])
            .fails(1, error);
    }
    place
        .run(&["provision", KEY, "--site=site.toml", "--out=p", "--id=3"])
        .fails(1, "not in options");
    assert!(!place.path("pages").exists());
}
