//! The CMUcam2 behind its seam, byte by byte.

// The driver's own scripted UART.
#[path = "../../../cmucam2-driver/tests/it/common/mod.rs"]
mod common;

use std::{
    future::Future,
    pin::pin,
    task::{Context, Poll, Waker},
};

use common::{MockDelay, MockUart, Script};
use node_firmware::vision::{
    BackgroundShare, BlobCamera, Cmucam2BlobCamera, ColourWindow, Judge, LearntColour, Lens, Look,
    Patience, Shape, Subject, VisionError, cmucam2::Cmucam2Settings, look,
};

type Sight = Cmucam2BlobCamera<MockUart, MockDelay>;

const BANNER: &str = "CMUcam2 v1.00 c6\r:";
const ORANGE: ColourWindow = ColourWindow {
    red: [170, 255],
    green: [60, 140],
    blue: [0, 80],
};
const MOTION: Subject = Subject::Motion { threshold: 12 };

fn wait<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    loop {
        if let Poll::Ready(done) = future.as_mut().poll(&mut context) {
            return done;
        }
    }
}

fn sight(script: Script, columns: u16) -> (Sight, MockUart) {
    let (camera, line) = script.camera();
    (Sight::new(camera, Cmucam2Settings::new(columns)), line)
}

/// All that start-up sends, to an idle camera.
fn started() -> Script {
    set_up(
        Script::idle().on("GV\r", format!("ACK\r{BANNER}")),
        &["NF 0\r", "HD 1\r", "PM 1\r"],
    )
}

fn set_up(script: Script, settings: &[&str]) -> Script {
    let script = script
        .on("RS\r", format!("ACK\r{BANNER}"))
        .on("CR 18 44 19 33\r", "ACK\r:")
        .on("CR 18 40 19 32\r", "ACK\r:");
    settings
        .iter()
        .fold(script, |script, command| script.on(command, "ACK\r:"))
}

#[test]
fn starting_up() {
    let (mut sight, line) = sight(started(), 88);
    assert_eq!(wait(sight.start_up()), Ok(()));
    assert!(line.now() >= 5_000_000);
    line.assert_finished();
}

#[test]
fn many_columns_are_the_high_resolution() {
    let script = set_up(
        Script::idle().on("GV\r", format!("ACK\r{BANNER}")),
        &["HR 1\r", "NF 0\r", "HD 1\r", "PM 1\r"],
    );
    let (mut sight, line) = sight(script, 176);
    assert_eq!(wait(sight.start_up()), Ok(()));
    line.assert_finished();
}

/// The sensor is told by the banner; a frame may be one column narrower.
#[test]
fn a_lens_of_another_camera_is_refused() {
    for (columns, banner, expected) in [
        (88, "c7", Some(160)),
        (100, "c6", Some(88)),
        (160, "c6", Some(88)),
        (176, "c7", Some(160)),
    ] {
        let banner = format!("ACK\rCMUcam2 v1.00 {banner}\r:");
        let (mut sight, line) = sight(Script::idle().on("GV\r", banner), columns);
        let error = expected.map(|camera| VisionError::Columns {
            camera,
            lens: columns,
        });
        assert_eq!(wait(sight.start_up()).err(), error);
        line.assert_finished();
    }
    let (mut sight, line) = sight(started(), 87);
    assert_eq!(wait(sight.start_up()), Ok(()));
    line.assert_finished();
}

/// Levels beyond the camera's are cut; each packet is asked for; nothing is left to be stopped.
#[test]
fn a_colour_is_polled() {
    let script = started()
        .on("ST 170 240 60 140 16 80\r", "ACK\r:")
        .on("TC\r", "ACK\rT 23 50 21 41 28 56 15 200\r:")
        .on("TC\r", "ACK\rT 0 0 0 0 0 0 0 0\r:");
    let (mut sight, line) = sight(script, 88);
    wait(sight.start_up()).unwrap();
    wait(sight.begin(Subject::Colour(ORANGE))).unwrap();
    let blob = wait(sight.next()).unwrap().unwrap();
    assert_eq!((blob.left, blob.right), (19.5, 27.5));
    assert_eq!(blob.told.edges, [21, 41, 28, 56]);
    assert_eq!(wait(sight.next()), Ok(None));
    assert_eq!(wait(sight.end()), Ok(()));
    assert_eq!(wait(sight.next()), Err(VisionError::NotBegun));
    line.assert_finished();
}

#[test]
fn motion_needs_a_background() {
    let script = started()
        .on("LF\r", "ACK\r:")
        .on("FD 12\r", "ACK\rT 6 8 5 7 6 9 6 255\r:");
    let (mut sight, line) = sight(script, 88);
    wait(sight.start_up()).unwrap();
    assert_eq!(wait(sight.begin(MOTION)), Err(VisionError::NoBackground));
    wait(sight.learn_background()).unwrap();
    wait(sight.begin(MOTION)).unwrap();
    let blob = wait(sight.next()).unwrap().unwrap();
    // Blocks 5 and 6 of 16, each 5.5 columns wide.
    assert_eq!((blob.left, blob.right), (21.5, 32.5));
    line.assert_finished();
}

/// A ball in the middle of the view, and nothing.
const BALL: &str = "44 70 34 52 53 91 78 200";
const NONE: &str = "0 0 0 0 0 0 0 0";

/// The bounds with which a learnt colour is tried: itself, wider ones.
const TRIED: [&str; 6] = [
    "170 230 70 130 16 76",
    "154 246 54 146 0 92",
    "138 255 38 162 0 108",
    "122 255 22 178 0 124",
    "106 255 6 194 0 140",
    "90 255 0 210 0 156",
];

/// The parts of the view around its middle, and the middle.
const PARTS: [&str; 5] = [
    "VW 1 1 11 143\r",
    "VW 78 1 88 143\r",
    "VW 12 1 77 17\r",
    "VW 12 127 77 143\r",
    "VW 12 18 77 126\r",
];

/// A colour is learnt, and tried on the view, which shows this each time: as a whole, or in its parts where these
/// are given.
fn learn(seen: &[(&str, Option<[&str; 5]>)]) -> Result<LearntColour, VisionError> {
    let mut script = started()
        .on("TW\r", format!("ACK\rS 200 100 46 3 3 3\rT {BALL}\r:"))
        .on("GT\r", "ACK\r170 230 70 130 16 76\r:")
        .on("ST 170 230 70 130 16 76\r", "ACK\r:");
    let told = |seen: &str| format!("ACK\rT {seen}\r:");
    for (bounds, (whole, parts)) in TRIED.into_iter().zip(seen) {
        script = script
            .on(&format!("ST {bounds}\r"), "ACK\r:")
            .on("TC\r", told(whole));
        if let Some(parts) = parts {
            script = PARTS
                .into_iter()
                .zip(parts)
                .fold(script, |script, (part, seen)| {
                    script.on(part, "ACK\r:").on("TC\r", told(seen))
                });
            script = script.on("VW\r", "ACK\r:").on("TC\r", told(whole));
        }
    }
    let (mut sight, line) = sight(script, 88);
    wait(sight.start_up()).unwrap();
    let learnt = wait(sight.learn_colour());
    line.assert_finished();
    learnt
}

#[test]
fn a_colour_is_learnt_that_holds_the_object() {
    let learnt = |red, green, blue| LearntColour {
        window: ColourWindow { red, green, blue },
        background: BackgroundShare::NONE,
    };
    let as_it_is = learnt([170, 230], [70, 130], [16, 76]);
    assert_eq!(learn(&[(BALL, None); 6]), Ok(as_it_is));
    // A crescent is not the ball: its edges move, until wider bounds hold it.
    let lit = [
        "49 56 41 34 56 108 13 165",
        "49 57 38 52 53 82 60 165",
        "48 60 36 52 53 85 66 180",
    ];
    let lit = lit.into_iter().chain([NONE]);
    let looks: Vec<_> = lit.chain([BALL; 3]).map(|seen| (seen, None)).collect();
    assert_eq!(learn(&looks), Ok(learnt([106, 255], [6, 194], [0, 140])));
    // At the border of the view an object is not whole.
    let cut_off = "44 70 1 52 53 91 255 200";
    assert_eq!(learn(&[(cut_off, None); 6]), Err(VisionError::PartOfObject));
}

/// The outside of the middle of the view is counted where the object is not alone.
#[test]
fn a_colour_that_the_background_has_is_refused() {
    const MERGED: &str = "44 70 1 1 88 143 255 90";
    // Of the 5,390 pixels of the four parts, all of the second one is a wall.
    let wall = [NONE, "83 70 78 1 88 143 197 255", NONE, NONE, BALL];
    let thousandths = (197 * 8 * 1_000_u32).div_ceil(12_584 - 66 * 109) as u16;
    let refused = VisionError::CommonColour(BackgroundShare { thousandths });
    assert_eq!(learn(&[(MERGED, Some(wall))]), Err(refused));
    // A few pixels are told, and looked for all the same; bounds that more of the background has are none.
    let speck = [NONE, NONE, "40 9 40 9 41 10 0 255", NONE, BALL];
    let learnt = learn(&[
        (MERGED, Some(speck)),
        (MERGED, Some(speck)),
        (MERGED, Some(wall)),
    ]);
    assert_eq!(learnt.map(|learnt| learnt.background.thousandths), Ok(1));
    let in_parts = [
        NONE,
        NONE,
        "40 9 40 9 41 10 0 255",
        NONE,
        "49 57 38 52 53 82 60 100",
    ];
    let learnt = learn(&[(MERGED, Some(in_parts)); 6]);
    assert_eq!(learnt, Err(VisionError::PartOfObject));
}

#[test]
fn nothing_goes_before_starting_up() {
    let (mut sight, line) = sight(Script::new(), 88);
    let colour = Subject::Colour(ORANGE);
    assert_eq!(wait(sight.begin(colour)), Err(VisionError::NotStarted));
    assert_eq!(wait(sight.learn_colour()), Err(VisionError::NotStarted));
    assert_eq!(wait(sight.learn_background()), Err(VisionError::NotStarted));
    line.assert_finished();
}

#[test]
fn an_inverted_colour_is_not_sent() {
    let (mut sight, line) = sight(started(), 88);
    wait(sight.start_up()).unwrap();
    let inverted = ColourWindow {
        green: [90, 80],
        ..ORANGE
    };
    let begun = wait(sight.begin(Subject::Colour(inverted)));
    assert_eq!(begun, Err(VisionError::Colour));
    line.assert_finished();
}

/// Silence is told apart from noise, and the same object works again when the camera is back.
#[test]
fn a_dead_line_is_survived() {
    let (mut sight, line) = sight(started(), 88);
    wait(sight.start_up()).unwrap();
    wait(async {
        line.unplug();
        let begun = sight.begin(Subject::Colour(ORANGE)).await;
        assert_eq!(begun, Err(VisionError::Silent));
        line.fail_next_read();
        let error = sight.begin(Subject::Colour(ORANGE)).await.unwrap_err();
        assert!(matches!(error, VisionError::Line(_)), "{error}");
    });
}

/// A camera that lost its power streams where poll mode was set. The driver sets all again, but
/// gain and white balance have changed, so it is started up.
#[test]
fn a_restart_within_a_look_is_survived() {
    const SEEN: &str = "ACK\rT 44 70 40 60 48 77 20 201\r:";
    let look_for = |script: Script| {
        (0..5).fold(script.on("ST 170 240 60 140 16 80\r", "ACK\r:"), |s, _| {
            s.on("TC\r", SEEN)
        })
    };
    let restored = [
        "CR 18 40 19 32\r",
        "HD 1\r",
        "NF 0\r",
        "PM 1\r",
        "ST 170 240 60 140 16 80\r",
    ];
    let script = started()
        .on("ST 170 240 60 140 16 80\r", "ACK\r:")
        .on("TC\r", SEEN)
        // Power fails here.
        .on("TC\r", format!("AC{BANNER}"));
    let script = restored
        .iter()
        .fold(script, |script, command| script.on(command, "ACK\r:"))
        .on("TC\r", SEEN)
        // Told of the restart, but that was not read.
        .on("\r", "ACK\r:")
        .on("\r", "ACK\r:")
        .on("GV\r", format!("ACK\r{BANNER}"));
    let script = look_for(set_up(script, &["NF 0\r", "HD 1\r", "PM 1\r"]));
    let (mut sight, line) = sight(script, 88);
    wait(sight.start_up()).unwrap();
    let camera = Lens::pin_hole(88, 45.0).camera().unwrap();
    // The direction of the middle between its edges.
    let expected = camera.bearing(43.0);
    let mut judge = Judge::new(camera, Patience::default(), Shape::Any);
    let seen = wait(look(&mut sight, Subject::Colour(ORANGE), &mut judge));
    assert_eq!(seen, Err(VisionError::Restarted));
    wait(sight.start_up()).unwrap();
    let seen = wait(look(&mut sight, Subject::Colour(ORANGE), &mut judge));
    assert!(
        matches!(seen, Ok(Look::Steady(seen)) if (seen.bearing - expected).abs() < 1e-4),
        "{seen:?}, sent {:?}",
        line.transcript()
    );
    line.assert_finished();
}

/// Power fails between two looks; the banner waits until it is read. The driver sets the modes again by
/// itself, but the background and the adaptation are lost all the same.
#[test]
fn a_restart_between_two_looks_is_told_whoever_notices_it() {
    type Act = fn(&mut Sight) -> Result<(), VisionError>;
    const RESTORED: [(&str, &str); 4] = [
        ("CR 18 40 19 32\r", "ACK\r:"),
        ("HD 1\r", "ACK\r:"),
        ("NF 0\r", "ACK\r:"),
        ("PM 1\r", "ACK\r:"),
    ];
    const ST: (&str, &str) = ("ST 170 240 60 140 16 80\r", "ACK\r:");
    const LF: (&str, &str) = ("LF\r", "ACK\r:");
    const TW: (&str, &str) = (
        "TW\r",
        "ACK\rS 200 100 46 3 3 3\rT 44 70 40 60 48 80 20 201\r:",
    );
    const GT: (&str, &str) = ("GT\r", "ACK\r170 230 70 130 16 76\r:");
    const LEARNT: (&str, &str) = ("ST 170 230 70 130 16 76\r", "ACK\r:");
    const FD: (&str, &str) = ("FD 12\r", "ACK\rT 6 8 5 7 6 9 6 255\r:");
    let begin: Act = |sight| wait(sight.begin(Subject::Colour(ORANGE)));
    let background: Act = |sight| wait(sight.learn_background());
    let learn: Act = |sight| wait(sight.learn_colour()).map(|_| ());
    let motion: Act = |sight| {
        wait(async {
            sight.begin(MOTION).await?;
            sight.next().await.map(|_| ())
        })
    };
    // The command during which the banner is read, and the commands that are sent again.
    for (act, during, again) in [
        (begin, ST, &[ST][..]),
        (background, LF, &[LF]),
        (learn, TW, &[TW, GT, LEARNT]),
        (motion, FD, &[]),
    ] {
        let exchanges = [LF, during].into_iter().chain(RESTORED);
        let exchanges = exchanges.chain(again.iter().copied());
        let script = exchanges.fold(started(), |script, (sent, reply)| script.on(sent, reply));
        let (mut sight, line) = sight(script, 88);
        wait(sight.start_up()).unwrap();
        wait(sight.learn_background()).unwrap();
        line.inject(BANNER);
        assert_eq!(act(&mut sight), Err(VisionError::Restarted), "{during:?}");
        assert_eq!(act(&mut sight), Err(VisionError::NotStarted), "{during:?}");
        line.assert_finished();
    }
}

/// The same while it is being set up, after it has adapted.
#[test]
fn a_restart_while_setting_up_is_told() {
    let script = Script::idle().on("GV\r", format!("ACK\r{BANNER}"));
    let script = set_up(script, &[])
        .on("NF 0\r", format!("AC{BANNER}"))
        .on("CR 18 40 19 32\r", "ACK\r:")
        .on("NF 0\r", "ACK\r:")
        .on("HD 1\r", "ACK\r:")
        .on("PM 1\r", "ACK\r:");
    let (mut sight, _line) = sight(script, 88);
    assert_eq!(wait(sight.start_up()), Err(VisionError::Restarted));
    let begun = wait(sight.begin(Subject::Colour(ORANGE)));
    assert_eq!(begun, Err(VisionError::NotStarted));
}
