//! Keys and configuration pages, as the commands make them.

use std::{fs, os::unix::fs::PermissionsExt, path::Path};

use super::place::{CARRIER, Place};
use node_firmware::{
    config::{
        CameraConfig, Config, CoordinatorConfig, RoleConfig, Sigmas, SiteKey, Subjects,
        TargetConfig, page,
    },
    message::{Duty, Reference},
    vision::{ColourWindow, Lens},
};
use pixy_driver::Model;
use zigbee_link::security::Protection;

const KEY: &str = "--site-key=site.sitekey";
const ALL_CHANNELS: u32 = 0x07FF_F800;

fn decode(place: &Place, name: &str) -> Config {
    let page = page::decode(&fs::read(place.path(name)).unwrap()).unwrap();
    page.settings().clone()
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

    place.run(&["keygen"]).fails("is not overwritten");
    assert_eq!(fs::read_to_string(&path).unwrap(), first);
    place.run(&["keygen", "next.sitekey", "--index=2"]).ok();
    let next = fs::read_to_string(place.path("next.sitekey")).unwrap();
    assert!(next.starts_with("site-key 1 2 "));
    assert_ne!(first[13..45], next[13..45]);
    place.run(&["keygen", "other", "--index=0"]).fails("0");
    place.run(&["keygen", "other", "--index=256"]).fails("256");
    place.run(&["keygen", "no/such/folder"]).fails("no/such");
    assert!(!place.path("other").exists());
}

#[test]
fn a_key_that_others_may_read_or_that_was_damaged_is_refused() {
    let place = Place::with_key();
    let make = || {
        let words = ["provision", KEY, "--role=target", "--id=3", "--overwrite"];
        place.run(&[&words[..], &CARRIER].concat())
    };
    make().ok();
    let path = place.path("site.sitekey");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
    make().fails("chmod 600");
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
        make().fails(error);
    }
    fs::remove_file(&path).unwrap();
    make().fails("host-sim keygen");
}

#[test]
fn options_make_a_page() {
    let place = Place::with_key();
    place
        .run(&[
            "provision",
            KEY,
            "--role=camera",
            "--id=3",
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
    let subjects = Subjects::Colours([window(1), window(17)].into_iter().collect());
    let mut camera = CameraConfig::new(Lens::pin_hole(160, 50.0), subjects);
    camera.baud = 115_200;
    camera.reference = Some(Reference {
        duty: Duty::Second,
        position: Some([-1.5, 2.0]),
    });
    camera.baseline = Some(4.0);
    camera.stops = 5;
    let mut expected = Config::new(3, place.key(), RoleConfig::Camera(camera));
    expected.channels = 1 << 11 | 1 << 26;
    expected.tx_power = -4;
    assert_eq!(decode(&place, "page.bin"), expected);
    let page = fs::read(place.path("page.bin")).unwrap();
    assert_eq!(page.len(), page::PAGE_MAX);
    assert_eq!(mode(&place.path("page.bin")), 0o600);
}

/// Its lens, rate and signatures have usual values of their own.
#[test]
fn a_node_with_a_pixy2() {
    let place = Place::with_key();
    let make = |more: &[&str]| {
        let all = ["provision", KEY, "--role=camera", "--id=3", "--kind=pixy2"];
        let rest = ["--field-of-view=60", "--out=page.bin", "--overwrite"];
        place.run(&[&all[..], &rest, more].concat())
    };
    make(&[]).ok();
    let camera = |config: Config| match config.role {
        RoleConfig::Camera(camera) => camera,
        other => panic!("{other:?}"),
    };
    assert_eq!(
        camera(decode(&place, "page.bin")),
        CameraConfig::pixy(Model::Pixy2, 1)
    );
    make(&["--signatures=2", "--baud=115200"]).ok();
    let mut expected = CameraConfig::pixy(Model::Pixy2, 2);
    expected.baud = 115_200;
    assert_eq!(camera(decode(&place, "page.bin")), expected);
    make(&["--columns=88"]).fails("a Pixy2 has 316");
    make(&["--motion=12"]).fails("only a Pixy2");
}

/// Each kind has its own picture and lens; tags need no colours.
#[test]
fn a_node_with_a_camera_that_streams() {
    for (kind, model) in [
        ("pixy", Model::Pixy),
        ("openmv", Model::OpenMv),
        ("openmv-tags", Model::OpenMvTags),
    ] {
        let place = Place::with_key();
        let kind = format!("--kind={kind}");
        let view = format!("--field-of-view={}", model.field_of_view_deg());
        let all = ["provision", KEY, "--role=camera", "--id=3", &kind, &view];
        place.run(&[&all[..], &["--out=page.bin"]].concat()).ok();
        let role = decode(&place, "page.bin").role;
        assert_eq!(role, RoleConfig::Camera(CameraConfig::pixy(model, 1)));
    }
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
    let camera = make("camera", "--motion=12 --field-of-view=45");
    assert_eq!(
        camera.role,
        RoleConfig::Camera(CameraConfig::new(
            Lens::pin_hole(88, 45.0),
            Subjects::Motion { threshold: 12 }
        ))
    );
    assert_eq!(camera.channels, ALL_CHANNELS);
    let target = make(
        "target",
        &format!("--target-colour=1 {}", CARRIER.join(" ")),
    );
    let usual = TargetConfig::default();
    assert_eq!(
        (usual.systematic_heading_deg, usual.systematic_scale),
        (3.0, 0.08)
    );
    let mut expected = usual;
    expected.colour = 1;
    assert_eq!(target.role, RoleConfig::Target(expected));
    let worn = make(
        "target",
        "--hard-iron=12.5,-40,3 --step-length=0.5 --systematic-heading=3 --systematic-scale=0.03",
    );
    let mut expected = usual;
    expected.systematic_heading_deg = 3.0;
    expected.systematic_scale = 0.03;
    expected.sensor.hard_iron = [12.5, -40.0, 3.0];
    expected.sensor.step_length = 0.5;
    assert_eq!(worn.role, RoleConfig::Target(expected));
    let half = make(
        "target",
        &format!("--step-length=0.5 {}", CARRIER.join(" ")),
    );
    let RoleConfig::Target(half) = half.role else {
        panic!("{half:?}");
    };
    assert_eq!(half.sensor.hard_iron, [0.0; 3]);
    let coordinator = make("coordinator", "--join-window=60");
    let mut expected = CoordinatorConfig::default();
    expected.join_window_s = 60;
    assert_eq!(coordinator.role, RoleConfig::Coordinator(expected));
}

#[test]
fn a_file_sets_everything_and_options_stand_over_it() {
    let place = Place::with_key();
    place.write(
        "node.toml",
        r#"
        role = "camera"
        id = 9
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
        field-of-view-deg = 45
        projection = "equal-angle"
        principal-column = 40.5
        distortion = [-0.125, 0.5]
        [reference]
        duty = "first"
        [subjects.motion]
        threshold = 20
        "#,
    );
    let run = ["provision", KEY, "--config=node.toml", "--id=10"];
    place.run(&run).ok();
    let config = decode(&place, "node-10.page.bin");
    let RoleConfig::Camera(camera) = &config.role else {
        panic!("{config:?}");
    };
    let shown = place.run(&["provision", "--show=node-10.page.bin"]).ok();
    let lines = ["page, version 12", "[lens]\ndistortion = [-0.125, 0.5]\n"];
    assert!(lines.iter().all(|line| shown.contains(line)), "{shown}");
    assert_eq!(config.id, 10);
    assert_eq!((config.channels, config.tx_power), (1 << 15, 8));
    assert_eq!(config.protection, Protection::EncMic32);
    let lens = Lens {
        columns: 88,
        field_of_view_deg: 45.0,
        projection: calib_core::camera::Projection::EqualAngle,
        principal_column: Some(40.5),
        distortion: [-0.125, 0.5],
    };
    let mut expected = CameraConfig::new(lens, Subjects::Motion { threshold: 20 });
    expected.baud = 57_600;
    expected.first_column = 0;
    expected.round = false;
    expected.reference = Some(Reference {
        duty: Duty::First,
        position: None,
    });
    expected.may_be_elected = false;
    expected.baseline = Some(6.0);
    expected.frame_heading_deg = Some(-12.5);
    expected.reference_stops = 2;
    expected.stops = 6;
    expected.refine = false;
    expected.good_enough = Sigmas {
        position: 0.02,
        heading_deg: 0.5,
    };
    expected.weak = Sigmas {
        position: 0.75,
        heading_deg: 10.0,
    };
    expected.sigma_floor_px = 0.25;
    assert_eq!(*camera, expected);
}

#[test]
fn what_is_wrong_is_told() {
    let place = Place::with_key();
    place.write(
        "typo.toml",
        "role = 'camera'\nid = 1\n[lens]\nview = 3\nfield-of-view-deg = 45",
    );
    place.write("key.toml", "role = 'target'\nid = 1\nsite-key = 'x'");
    place.write("syntax.toml", "role = ");
    place.write("zero.toml", "role = 'target'\nid = 0");
    place.write("large.toml", "role = 'target'\nid = 70000");
    for (error, arguments) in [
        ("--site-key", "--role=camera --id=1"),
        ("possible values", "KEY --role=lamp --id=1"),
        ("cannot be used with", "KEY --show=x"),
        ("cannot be used with", "KEY --colour=1-2,3-4,5-6 --motion=3"),
        ("--reference", "KEY CAMERA --id=1 --position=1,2"),
        ("1 to 65535", "KEY TARGET --id=0"),
        ("1 to 65535", "KEY TARGET --id=65536"),
        ("id must be 1 to 65535, not 0", "KEY --config=zero.toml"),
        ("not 70000", "KEY --config=large.toml"),
        (
            "none.sitekey: it cannot be read",
            "--site-key=none.sitekey TARGET --id=1",
        ),
        ("use --role", "KEY --id=1"),
        ("Say --site FILE.toml --out FOLDER", "--id=1"),
        ("not in options", "--site=room.toml --id=1"),
        ("Say --out FOLDER", "--site=room.toml"),
        ("a camera must be 1 to 59999", "KEY CAMERA --id=60000"),
        ("88 columns, or 160", "KEY CAMERA --id=1 --columns=100"),
        ("", "KEY CAMERA --id=1 --baseline=-1"),
        ("use --id", "KEY --role=camera"),
        (
            "a camera needs `lens.field-of-view-deg`: use --field-of-view",
            "KEY --role=camera --id=1 --columns=160",
        ),
        (
            "a target needs `systematic-heading-deg`: use --systematic-heading",
            "KEY --role=target --id=1",
        ),
        (
            "a target needs `systematic-scale`: use --systematic-scale",
            "KEY --role=target --id=1 --systematic-heading=3",
        ),
        (
            "a target has no parameter `baud`",
            "KEY TARGET --id=1 --baud=9600",
        ),
        (
            "a camera has no parameter `lens.view`",
            "KEY --config=typo.toml",
        ),
        ("does not belong into a file", "KEY --config=key.toml"),
        ("syntax.toml is not TOML", "KEY --config=syntax.toml"),
        ("none.toml cannot be read", "KEY --config=none.toml"),
        ("no channel 27", "KEY TARGET --id=1 --channels=11,27"),
        (
            "numbers of nodes, from 1, none of them twice",
            "KEY --role=coordinator --id=1 --allow=4 --allow=4",
        ),
        ("tx-power must be", "KEY TARGET --id=1 --tx-power=-41"),
        ("baud must be", "KEY CAMERA --id=1 --baud=9601"),
        ("lens:", "KEY --role=camera --id=1 --field-of-view=180"),
        (
            "two numbers",
            "KEY CAMERA --id=1 --reference=first --position=1",
        ),
        ("three numbers", "KEY TARGET --id=1 --hard-iron=1,2"),
        ("-400 to 400 uT", "KEY TARGET --id=1 --hard-iron=1,2,500"),
        ("third", "KEY CAMERA --id=1 --reference=third"),
        ("three ranges", "KEY CAMERA --id=1 --colour=1-2,3-4"),
        ("lowest level", "KEY CAMERA --id=1 --colour=2-1,3-4,5-6"),
        (
            "join-window-s must be",
            "KEY --role=coordinator --id=1 --join-window=601",
        ),
        ("colour must be", "KEY TARGET --id=1 --target-colour=4"),
        ("is a folder", "KEY TARGET --id=1 --out=."),
        ("is no page for a node", "--show=typo.toml"),
        ("none.bin: it cannot be read", "--show=none.bin"),
    ] {
        let mut words = vec!["provision"];
        for word in arguments.split(' ') {
            match word {
                "KEY" => words.push(KEY),
                "TARGET" => words.extend(["--role=target"].iter().chain(&CARRIER)),
                "CAMERA" => words.extend(["--role=camera", "--field-of-view=45"]),
                word => words.push(word),
            }
        }
        place.run(&words).fails(error);
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
    let make = [&make[..], &CARRIER].concat();
    place.run(&make).fails("page.bin exists");
    assert_eq!(
        fs::read_to_string(place.path("page.bin")).unwrap(),
        "something else"
    );
    place.run(&[&make[..], &["--overwrite"]].concat()).ok();
    assert_eq!(decode(&place, "page.bin").id, 1);
}

/// A page has 512 bytes: a shorter file was cut off, a longer one does not fit its place.
#[test]
fn a_page_of_another_length_is_refused() {
    let place = Place::with_key();
    let make = [
        "provision",
        KEY,
        "--role=target",
        "--id=1",
        "--out=page.bin",
    ];
    place.run(&[&make[..], &CARRIER].concat()).ok();
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
        place.run(&show).fails(error);
    }
}

#[test]
fn a_page_is_shown_without_its_key() {
    let place = Place::new();
    let subjects = Subjects::Motion { threshold: 8 };
    let mut camera = CameraConfig::new(Lens::pin_hole(88, 47.5), subjects);
    camera.reference = Some(Reference {
        duty: Duty::Second,
        position: Some([10.0, -0.5]),
    });
    camera.weak = Sigmas {
        position: 0.3,
        heading_deg: 7.5,
    };
    let key = SiteKey::new(9, *b"0123456789abcdef");
    let mut config = Config::new(3, key, RoleConfig::Camera(camera));
    config.channels = 0x0210_8800;
    config.tx_power = -4;
    let mut bytes = [0; page::PAGE_MAX];
    page::encode(&config.check().unwrap(), &mut bytes).unwrap();
    fs::write(place.path("page.bin"), bytes).unwrap();
    #[cfg(unix)]
    {
        place
            .run(&["provision", "--show=page.bin"])
            .fails("others may read it");
        let private = std::os::unix::fs::PermissionsExt::from_mode(0o600);
        fs::set_permissions(place.path("page.bin"), private).unwrap();
    }
    let shown = place.run(&["provision", "--show=page.bin"]).ok();
    assert_eq!(shown, include_str!("data/shown.txt"));
    for secret in ["0123456789abcdef", "30313233", "48, 49"] {
        assert!(!shown.contains(secret));
    }
    bytes[20] ^= 1;
    fs::write(place.path("page.bin"), bytes).unwrap();
    place
        .run(&["provision", "--show=page.bin"])
        .fails("damaged");
    fs::write(place.path("page.bin"), [0xFF; 512]).unwrap();
    place.run(&["provision", "--show=page.bin"]).fails("blank");
}

/// The output of `--show` is complete: it makes the same page.
#[test]
fn what_is_shown_can_be_provisioned() {
    let place = Place::with_key();
    for options in [
        "--role=camera --field-of-view=50 --reference=first --position=0.1,-2.7 --baseline=3.3",
        "--role=coordinator --allow=1 --allow=2 --join-window=9",
        "--role=target --systematic-heading=2 --systematic-scale=0.03 --target-colour=3 --tx-power=-20",
    ] {
        let first = ["provision", KEY, "--id=5", "--out=a", "--overwrite"];
        let words: Vec<_> = first.into_iter().chain(options.split(' ')).collect();
        place.run(&words).ok();
        let shown = place.run(&["provision", "--show=a"]).ok();
        place.write("shown.toml", &shown);
        let again = ["--config=shown.toml", "--out=b", "--overwrite"];
        place
            .run(&[&["provision", KEY], again.as_slice()].concat())
            .ok();
        let pages = ["a", "b"].map(|name| fs::read(place.path(name)).unwrap());
        assert_eq!(pages[0], pages[1], "{options}");
    }
}

/// Files that are read stay, by whatever name they are called.
#[test]
fn a_page_never_replaces_what_it_was_made_of() {
    let place = Place::with_key();
    let node = "role = 'coordinator'\nid = 1\n";
    place.write("node.toml", node);
    let key = fs::read_to_string(place.path("site.sitekey")).unwrap();
    std::os::unix::fs::symlink("node.toml", place.path("link")).unwrap();
    fs::hard_link(place.path("site.sitekey"), place.path("other-name")).unwrap();
    for out in [
        "node.toml",
        "./node.toml",
        "link",
        "site.sitekey",
        "other-name",
    ] {
        let out = format!("--out={out}");
        place
            .run(&["provision", KEY, "--config=node.toml", &out, "--overwrite"])
            .fails("would be replaced by a result");
    }
    assert_eq!(fs::read_to_string(place.path("node.toml")).unwrap(), node);
    assert_eq!(fs::read_to_string(place.path("site.sitekey")).unwrap(), key);
}
