//! The kit's buttons: pins that are connected to ground when pressed.

use cmucam2_emulator::{Extent, Object, Place, Shape};
use node_firmware::config::RoleConfig;
use nrf52840_emulator::Input;

use super::{faults::Site, *};

const JOIN_WINDOW: u32 = 11;
const LEARN_COLOUR: u32 = 12;

/// Number of times that a bouncing contact closes before it stays closed; and the time between them.
const BOUNCES: usize = 3;
const BOUNCE: u64 = MS;

/// From now on for so long.
fn press(site: &mut Site, number: usize, pin: u32, lasts: u64) {
    let mut at = site.network.reached();
    let bounces = [(1 << pin, BOUNCE), (0, BOUNCE)].repeat(BOUNCES);
    for (low, time) in bounces.into_iter().chain([(1 << pin, lasts), (0, 0)]) {
        site.network.input(number, Input::Pulls(at, 0, low));
        at += time;
    }
}

/// A coordinator that no device may join unasked, and a camera.
fn closed() -> Site {
    let coordinator = || {
        let lab = lab();
        let mut config = lab.configs.coordinator.settings().clone();
        let RoleConfig::Coordinator(role) = &mut config.role else {
            panic!("{config:?}");
        };
        role.join_window_s = 0;
        role.allow.clear();
        node(&config.check().unwrap())
    };
    Site::new(vec![Box::new(coordinator), Box::new(|| lab().camera(0))])
}

fn members(site: &Site) -> usize {
    let is_member = |(_, told): &&(u64, ToPc)| matches!(told, ToPc::Member { .. });
    site.told.iter().filter(is_member).count()
}

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_button_lets_nodes_join() {
    let mut site = closed();
    site.run(15 * S);
    // Shorter than contacts bounce.
    press(&mut site, 0, JOIN_WINDOW, 5 * MS);
    site.run(30 * S);
    // The other button is nothing to a coordinator.
    press(&mut site, 0, LEARN_COLOUR, 200 * MS);
    site.run(45 * S);
    assert_eq!(members(&site), 0);
    press(&mut site, 0, JOIN_WINDOW, 200 * MS);
    site.run(75 * S);
    assert!(members(&site) > 0);
    for number in 0..2 {
        in_order(&site.switch_off(number));
    }
}

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_button_has_a_camera_learn_a_colour() {
    let learnt = |pin| {
        let lab = lab();
        let camera = || {
            let lab = self::lab();
            let mut scene = Scene::default();
            // It fills half of the view: of less, the camera would take the mean of object and background.
            scene.objects.push(Object {
                colour: [230, 40, 30],
                shape: Shape::Disc,
                place: Place::At(Extent::centred(0.5, 0.5, 0.5, 0.5)),
            });
            Node {
                peer: Some(Box::new(lab.eye_before(0, scene))),
                ..lab.camera(0)
            }
        };
        let coordinator = || self::lab().coordinator();
        let mut site = Site::new(vec![Box::new(coordinator), Box::new(camera)]);
        site.run(20 * S);
        press(&mut site, 1, pin, 200 * MS);
        site.run(60 * S);
        let outcome = site.switch_off(1);
        in_order(&outcome);
        let facts = facts(&outcome, lab.configs.cameras[0].settings().owner());
        facts.iter().any(|fact| matches!(fact, Fact::Colours(_)))
    };
    assert!(!learnt(JOIN_WINDOW));
    assert!(learnt(LEARN_COLOUR));
}
