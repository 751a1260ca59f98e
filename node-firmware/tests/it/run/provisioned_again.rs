//! Nodes that get another page, and their knowledge then.

use node_firmware::{
    config::{CoordinatorConfig, RoleConfig, SiteKey},
    console::FromPc,
    message::{CameraCommand, MemberKind, Sight},
};

use crate::run::{
    bench::{SECOND, Site},
    former_networks::{erase_link, link},
    support::site::target_config,
};

/// Pages with another key are taken, however low their frame counter: a network that had the key
/// before, and left it, included. That no nonce occurs twice is for the radios to check.
#[test]
fn another_key_is_taken() {
    let mut site = Site::new();
    site.camera.sees(Some(40));
    site.bench.run_for(100 * SECOND);
    let old = SiteKey::new(1, *b"0123456789abcdef");
    let new = SiteKey::new(2, *b"fedcba9876543210");
    for (round, keys) in [[new, new, old], [new, new, new], [old, old, old]]
        .into_iter()
        .enumerate()
    {
        for (config, key) in site.configs().into_iter().zip(keys) {
            config.site_key = key;
        }
        site.restart(20 + 10 * round as u64);
        site.bench.run_for(50 * SECOND);
        let expected: &[u16] = if round == 0 { &[101] } else { &[101, 102] };
        assert!(
            site.hellos().keys().eq(expected),
            "round {round}: {:?}",
            site.hellos()
        );
        // Memberships under the other key are void: the network is a new one.
        site.restart(25 + 10 * round as u64);
        site.bench.run_for(50 * SECOND);
        assert!(
            site.hellos().keys().eq(expected),
            "round {round}: {:?}",
            site.hellos()
        );
    }
}

/// With the same key, a node goes on as it was; erased or under another number, it is another node.
#[test]
fn an_address_is_kept_until_the_node_is_erased() {
    let mut site = Site::new();
    site.bench.run_for(100 * SECOND);
    let (before, _) = link(&site.camera.flash);
    assert!(before.network.is_some());
    site.camera.power(&mut site.bench, 30);
    site.bench.run_for(SECOND / 100);
    let (after, _) = link(&site.camera.flash);
    assert_eq!(after.network, before.network);
    assert_eq!(after.extended, before.extended);
    site.camera.config.id = 7;
    site.camera.power(&mut site.bench, 31);
    site.bench.run_for(SECOND / 100);
    let (other, _) = link(&site.camera.flash);
    assert_eq!(other.network, None);
    assert_eq!(other.extended.unwrap().number(), 7);
    assert!(other.counter_limit >= after.counter_limit);
    site.camera.switch_off(&mut site.bench);
    erase_link(&site.camera.flash);
    site.camera.power(&mut site.bench, 32);
    site.bench.run_for(SECOND / 100);
    let (erased, _) = link(&site.camera.flash);
    assert_eq!(erased.extended.unwrap().number(), 7);
    assert_ne!(erased.extended, other.extended);
}

/// A member that was erased is back within seconds, with the address it had. The join window is long
/// over.
#[test]
fn an_erased_member_is_back_at_once() {
    let mut site = Site::new();
    site.bench.run_for(100 * SECOND);
    let short = |site: &Site| {
        link(&site.camera.flash)
            .0
            .network
            .map(|network| network.short)
    };
    let before = short(&site);
    assert!(before.is_some());
    for seed in 40..44 {
        site.camera.switch_off(&mut site.bench);
        erase_link(&site.camera.flash);
        site.camera.power(&mut site.bench, seed);
        site.bench.run_for(5 * SECOND);
        assert_eq!(short(&site), before);
        assert_eq!(link(&site.coordinator.flash).1.len(), 2);
    }
}

/// The board of the coordinator becomes the target, and that of the target the camera's, and so on, under one
/// key. No board takes its former role for its present one.
#[test]
fn boards_change_their_roles() {
    let mut site = Site::new();
    site.camera.sees(Some(40));
    site.bench.run_for(100 * SECOND);
    let mut coordinator = CoordinatorConfig::default();
    coordinator.join_window_s = 600;
    // Coordinator and target.
    site.coordinator.config.role = RoleConfig::Target(target_config(0));
    site.target.config.role = RoleConfig::Coordinator(coordinator.clone());
    site.restart(40);
    site.bench.run_for(600 * SECOND);
    for lamps in [
        &site.coordinator.lamps,
        &site.camera.lamps,
        &site.target.lamps,
    ] {
        assert!(lamps.0.get().joined);
    }
    assert_eq!(site.camera.looks().last(), Some(&Sight::InView));
    assert!(site.coordinator.lamps().may_walk);
    // And back.
    site.coordinator.config.role = RoleConfig::Coordinator(coordinator);
    site.target.config.role = RoleConfig::Target(target_config(0));
    site.restart(50);
    site.bench.run_for(600 * SECOND);
    assert_eq!(site.hellos().get(&102), Some(&MemberKind::Target));
    assert!(matches!(
        site.hellos().get(&101),
        Some(MemberKind::Camera { .. })
    ));
    assert!(site.target.lamps().may_walk);
}

/// A camera's colour is learnt, and its power fails.
#[test]
fn a_learnt_colour_survives_a_restart() {
    let mut site = Site::new();
    site.camera.sees(Some(40));
    site.bench.run_for(40 * SECOND);
    let command = CameraCommand::LearnColour { colour: 0 };
    assert!(site.command(command, 30 * SECOND));
    // Under another number it is another member, which has to join.
    site.pc.wish(FromPc::JoinWindow(600));
    // The memory is that of a camera of this number only.
    for (id, window) in [
        (101, "ST 130 190 90 150 40 100"),
        (7, "ST 170 240 60 140 16 80"),
        (101, "ST 170 240 60 140 16 80"),
    ] {
        site.camera.config.id = id;
        site.camera.power(&mut site.bench, 60);
        site.camera.forget_heard();
        site.bench.run_for(30 * SECOND);
        site.target.step(1.0, 0.5);
        site.bench.run_for(30 * SECOND);
        let heard = site.camera.heard();
        let mut windows = heard
            .iter()
            .filter(|line| line.starts_with("ST"))
            .peekable();
        assert!(windows.peek().is_some(), "{heard:?}");
        assert!(windows.all(|line| line == window), "{id}: {heard:?}");
    }
}
