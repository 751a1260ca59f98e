//! A node whose radio is a real `ot-rcp` at the other end of a line, with a camera emulator or a PC.

use std::{
    cell::Cell,
    f32::consts::FRAC_PI_4,
    future::{Future, pending},
    time::Duration,
};

use calib_core::dead_reckoning::{Place, PlaceParts, Systematic};
use cmucam2_emulator::Note;
use embassy_futures::select::{Either4, select4};
use embedded_storage_async::nor_flash::NorFlash;
use nalgebra::{Rotation2, Vector2};
use node_firmware::{
    config::{CameraConfig, Config, CoordinatorConfig, LensSigma, RoleConfig, SiteKey, Subjects},
    console::ToPc,
    message::{
        CameraState, Confirmation, CoordinateFrame, Duty, Hello, MemberKind, Message, PoseParts,
        Reference, References, Seen, Sight, StopBearing, Stopped,
    },
    vision::{ColourWindow, Lens},
};
use zigbee_link::{
    link::Delivery,
    network::{self, NetworkStatus},
    radio::{Channel, Radio},
    runner::{self, Clock, Happened, Shared},
    security::Protection,
    store::{Membership, Store},
    wire::ShortAddress,
};

use super::{
    node::{Camera, Console, Line, Machine, Panel},
    peer::{Air, Process, StdClock, poll_for},
    support::{
        aether::{eui, key_bytes},
        node::{provisioned, settings},
    },
};

/// Link of another node on this computer.
type Link<'a> = Shared<&'a StdClock, 4, 4, 1>;

/// Limit of a test. A camera's start takes some six seconds; it adapts to the light for five of them.
const LIMIT: Duration = Duration::from_secs(60);

/// Values that `settings` and `provisioned` have too.
fn config(number: u8, role: RoleConfig) -> Config {
    let mut config = Config::new(number.into(), SiteKey::new(1, key_bytes(1)), role);
    config.channels = 1 << Channel::FIRST.number();
    config.protection = Protection::EncMic32;
    config
}

/// Sends a message that must arrive.
async fn deliver(link: &Link<'_>, to: ShortAddress, message: &Message) {
    let delivery = link.send(to, message).await;
    assert!(
        !matches!(delivery, Ok(Delivery::NoAnswer) | Err(_)),
        "{delivery:?}"
    );
}

/// Runs a story with the node, another one, and a device on the node's line; the story must end, and nothing
/// else.
async fn tell<T, R: Radio, F: NorFlash>(
    story: impl Future<Output = T>,
    node: impl Future<Output = String>,
    (link, radio, store): (&Link<'_>, &mut R, &mut Store<F>),
    device: impl Future<Output = ()>,
) -> T {
    match select4(story, node, runner::run(link, radio, store), device).await {
        Either4::First(result) => result,
        Either4::Second(why) => panic!("the node stopped: {why}"),
        Either4::Third(why) => panic!("the other node stopped: {why:?}"),
        Either4::Fourth(()) => panic!("the line was closed"),
    }
}

/// The node forms a network and opens it at the press of a button. A node on this computer joins and
/// presents itself; the PC on the node's line is told. A second start goes on from flash: the other node
/// comes back without a press of a button. The node's co-processor restarts in the middle of both.
#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn a_coordinator_forms_a_network() {
    let air = Air::new();
    let role = RoleConfig::Coordinator(CoordinatorConfig::default());
    let mut machine = Machine::new(&config(0, role));
    let first = coordinate(&air, &mut machine, Start::First);
    let second = coordinate(&air, &mut machine, Start::Again);
    assert_eq!(first, second);
}

#[derive(Clone, Copy, PartialEq)]
enum Start {
    First,
    Again,
}

/// Runs until a node on this computer has joined and presented itself.
fn coordinate(air: &Air, machine: &mut Machine, start: Start) -> Membership {
    let clock = StdClock::new();
    let [(mut co_processor, own_radio), (_process, mut radio)] = [1, 2].map(|node| air.node(node));
    let [uart, device] = Line::new();
    let mut console = Console::new(device);
    let panel = Panel::default();
    let node = machine.run(uart, own_radio, panel.clone());

    let mut store = provisioned();
    let saved = poll_for(LIMIT, store.load()).unwrap().unwrap();
    let device = network::Node::device(clock.now(), settings(1), &saved);
    let link = Link::new(device, &clock);

    let story = async {
        panel.until(|lamps| lamps.joined).await;
        if start == Start::First {
            panel.press_join_window();
        }
        let membership = loop {
            if let Happened::<Message>::Status(NetworkStatus::Joined(membership)) =
                link.happened(NetworkStatus::Out).await
            {
                break membership;
            }
            clock
                .sleep_until(clock.now() + Duration::from_millis(20))
                .await;
        };
        restart(&mut co_processor);
        let hello = Hello {
            id: 1234,
            kind: MemberKind::Target,
        };
        let message = Message::Hello(hello);
        deliver(&link, ShortAddress::COORDINATOR, &message).await;
        let is_told = |told: &ToPc| {
            *told
                == ToPc::Member {
                    address: membership.short.0,
                    hello,
                }
        };
        console.until(is_told).await;
        membership
    };
    let other = (&link, &mut radio, &mut store);
    let told = tell(story, node, other, pending());
    let membership = poll_for(LIMIT, told).expect("it takes too long");
    // The node draws the rest of its address.
    assert_eq!(membership.coordinator.number(), 0);
    assert_ne!(membership.short, ShortAddress::COORDINATOR);
    membership
}

/// As a watchdog restarts a co-processor.
fn restart(co_processor: &mut Process) {
    co_processor.kill();
    co_processor.restart();
}

/// The node joins, brings up its camera, looks three times at a ball whose place it is told, and
/// reports its pose: at the origin, looking along the x axis.
#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn a_camera_finds_its_pose() {
    // Columns, and distances of the ball.
    let stops = [(15.0, 5.0), (43.5, 2.5), (70.0, 4.0)];
    let pose = calibrate(camera_config(), &stops, None);
    check_pose(&pose);
}

/// The same of the first of two reference cameras, and of a ball whose place is not known, but only how
/// it went on from its first stop. This computer plays the second camera, which is on the x axis and looks
/// at the space in front of the first one.
#[test]
#[ignore = "needs an ot-rcp: cargo xtask peers"]
fn a_reference_camera_finds_its_pose() {
    let mut config = camera_config();
    config.reference = Some(Reference {
        duty: Duty::First,
        position: None,
    });
    config.baseline = Some(BASELINE);
    config.frame_heading_deg = Some(0.0);
    let stops = [
        (15.0, 5.0),
        (43.5, 2.5),
        (70.0, 4.0),
        (30.0, 3.0),
        (60.0, 5.5),
    ];
    let pose = calibrate(config, &stops, Some(FRAC_PI_4));
    println!("{pose:?}");
    // It is the origin; only its heading is found.
    let sigma = pose.covariance[5].sqrt();
    let off = pose.heading - FRAC_PI_4;
    assert_eq!(pose.position, [0.0; 2]);
    assert!(off.abs() < 4.0 * sigma && sigma < 0.05, "{pose:?}");
}

/// Distance from the first reference camera to the second.
const BASELINE: f32 = 5.0;
/// Sigma of the second camera's bearings, radians.
const BEARING_SIGMA: f32 = 0.003;

fn camera_config() -> CameraConfig {
    let orange = ColourWindow {
        red: [170, 240],
        green: [60, 140],
        blue: [16, 80],
    };
    let subjects = Subjects::Colours([orange].into_iter().collect());
    let mut camera = CameraConfig::new(Lens::pin_hole(88, 45.0), subjects);
    camera.lens_sigma = LensSigma::EXACT;
    camera
}

/// Shows a ball to a camera, in these columns and at these distances, until it has a pose. The camera is told
/// the places of the ball. If it is the first reference, its heading is given here, and it is told how the
/// ball has walked and what the second reference saw.
fn calibrate(config: CameraConfig, stops: &[(f64, f32)], reference: Option<f32>) -> PoseParts {
    let eye = config.lens.camera().unwrap();
    let turn = Rotation2::new(reference.unwrap_or(0.0));
    let place = |(column, range): (f64, f32)| {
        let ray = eye.ray(column as f32);
        turn * Vector2::new(ray.forward, ray.left).normalize() * range
    };
    let begun = stops[0];

    let air = Air::new();
    let baud = config.baud;
    let mut machine = Machine::new(&self::config(1, RoleConfig::Camera(config)));
    let clock = StdClock::new();
    let [(_co_processor, own_radio), (_process, mut radio)] = [1, 2].map(|node| air.node(node));
    let [uart, device] = Line::new();
    let mut camera = Camera::new(device, baud);
    let panel = Panel::default();
    let node = machine.run(uart, own_radio, panel.clone());

    let mut store = provisioned();
    let saved = poll_for(LIMIT, store.load()).unwrap().unwrap();
    let mut coordinator = network::Node::coordinator(settings(0), &saved, [None]);
    coordinator.allow(eui(1).number()).unwrap();
    let link = Link::new(coordinator, &clock);

    let ball = Cell::new(0.0);
    let story = async {
        let member = loop {
            if let (from, Message::Hello(_)) = link.recv().await {
                break from;
            }
        };
        if reference.is_some() {
            let references = References {
                first: member.0,
                second: ShortAddress::COORDINATOR.0,
                positions: None,
            };
            deliver(&link, member, &Message::References(references)).await;
        }
        let mut pose = None;
        for (stop, &seen) in (0..).zip(stops) {
            ball.set(seen.0);
            let place_there = place(seen);
            let stopped = Message::Stopped(match reference {
                None => stopped(stop, CoordinateFrame::Site, place_there),
                Some(_) => stopped(stop, CoordinateFrame::Own, place_there - place(begun)),
            });
            // A frame that shows the ball where it was before.
            clock
                .sleep_until(clock.now() + Duration::from_millis(200))
                .await;
            deliver(&link, member, &stopped).await;
            loop {
                match link.recv().await.1 {
                    Message::Look(look) if look.sight == Sight::NotReady => {
                        clock
                            .sleep_until(clock.now() + Duration::from_millis(200))
                            .await;
                        deliver(&link, member, &stopped).await;
                    }
                    Message::Look(look) if look.stop == stop => {
                        assert_eq!(look.sight, Sight::InView, "stop {stop}");
                        let seen_by = [member.0].into_iter().collect();
                        let confirmation = Confirmation { stop, seen_by };
                        deliver(&link, member, &Message::Confirmed(confirmation)).await;
                        break;
                    }
                    Message::Report(report) => pose = report.pose().copied(),
                    _ => {}
                }
            }
            if reference.is_some() {
                deliver(
                    &link,
                    member,
                    &Message::Bearing(second_saw(stop, place_there)),
                )
                .await;
            }
        }
        while pose.is_none() {
            if let Message::Report(report) = link.recv().await.1 {
                if let CameraState::Refused(refusal) = report.state {
                    panic!("{refusal}");
                }
                pose = report.pose().copied();
            }
        }
        // A reference is weak until a target has estimated it.
        if reference.is_none() {
            panel.until(|lamps| lamps.calibrated).await;
        }
        pose
    };
    let other = (&link, &mut radio, &mut store);
    let told = tell(story, node, other, camera.run(&ball));
    let pose = poll_for(LIMIT, told).expect("it takes too long");

    let commands = camera.notes.iter().filter_map(|note| match note {
        Note::Command(command) => Some(command.to_string().into_bytes()),
        _ => None,
    });
    let commands: Vec<_> = commands.collect();
    assert!(commands.iter().any(|line| line == b"RS"), "{commands:x?}");
    let refused = |note: &Note| matches!(note, Note::Refused { .. });
    assert!(!camera.notes.iter().any(refused), "{:?}", camera.notes);
    pose.expect("it was reported")
}

/// The origin and heading zero are within four of its own standard deviations, which are small.
fn check_pose(pose: &PoseParts) {
    println!("{pose:?}");
    let [xx, _, yy, _, _, hh] = pose.covariance;
    let [x, y] = pose.position;
    for (value, variance, most) in [(x, xx, 0.1), (y, yy, 0.1), (pose.heading, hh, 0.02)] {
        let sigma = variance.sqrt();
        assert!(value.abs() < 4.0 * sigma && sigma < most, "{pose:?}");
    }
}

/// A target that knows its place in this frame exactly.
fn stopped(stop: u16, frame: CoordinateFrame, position: Vector2<f32>) -> Stopped {
    let place = Place::new(PlaceParts {
        fix: 1,
        position: position.into(),
        fix_covariance: [0.0; 3],
        step_covariance: [0.0; 3],
        walked: Vector2::zeros(),
        systematic: Systematic {
            heading_sigma: 0.0,
            scale_sigma: 0.0,
        },
        standing_sigma: 0.0,
    });
    Stopped {
        stop,
        colour: 0,
        frame,
        place: place.unwrap(),
    }
}

/// Bearing of a ball at this place from the second reference camera.
fn second_saw(stop: u16, place: Vector2<f32>) -> StopBearing {
    let turn_back = Rotation2::new(-3.0 * FRAC_PI_4);
    let seen = turn_back * (place - Vector2::new(BASELINE, 0.0));
    StopBearing {
        target: ShortAddress::COORDINATOR.0,
        stop,
        seen: Seen::direction(seen.y.atan2(seen.x), BEARING_SIGMA),
        pose: None,
    }
}
