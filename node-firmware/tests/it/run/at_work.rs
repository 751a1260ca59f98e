//! Nodes that join, look, obey and restart.

use node_firmware::{
    config::{RoleConfig, SiteKey, Subjects},
    console::{FromPc, KeyChangeReport, ToPc},
    message::{CameraCommand, Duty, Sight, TrackedBlob},
};

use crate::run::{
    bench::{SECOND, Site},
    support::site::camera_config,
};

#[test]
fn they_join_and_look() {
    let mut site = Site::new();
    site.camera.sees(Some(40));
    site.bench.run_for(40 * SECOND);
    assert!(site.coordinator.lamps().joined);
    assert!(site.camera.lamps().joined);
    assert!(site.target.lamps().joined);
    let members = site
        .pc
        .told()
        .into_iter()
        .filter_map(|message| match message {
            ToPc::Member { hello, .. } => Some(hello.id),
            _ => None,
        });
    let mut members: Vec<u16> = members.collect();
    members.sort_unstable();
    members.dedup();
    assert_eq!(members, [101, 102]);

    // It stood since it was switched on.
    assert_eq!(site.camera.looks().last(), Some(&Sight::InView));
    assert!(site.target.lamps().may_walk);
    assert!(site.target.lamps().target_seen);
    assert!(site.camera.lamps().target_seen);

    // It goes where the camera does not see it.
    site.camera.sees(None);
    site.target.step(1.0, 0.5);
    site.bench.run_for(SECOND);
    assert!(!site.target.lamps().may_walk);
    site.bench.run_for(20 * SECOND);
    assert_eq!(site.camera.looks().last(), Some(&Sight::NotInView));
    assert!(site.target.lamps().may_walk);
    let heard = site.camera.heard();
    assert!(heard.contains(&"ST 170 240 60 140 16 80".to_owned()));
}

/// A network that sleeps while it is quiet: with its CMUcam2 the node's own UART is off, and bytes find it on again.
#[test]
fn a_line_rests_while_its_camera_sleeps() {
    let mut site = Site::new();
    for config in site.configs() {
        config.sleeps = true;
    }
    site.restart(4);
    site.camera.sees(Some(40));
    site.bench.run_for(40 * SECOND);
    assert!(!site.camera.rests.get());
    assert_eq!(site.camera.looks().last(), Some(&Sight::InView));
    // Two minutes after it was last woken.
    site.bench.run_for(160 * SECOND);
    assert!(site.camera.rests.get());
    assert_eq!(site.camera.heard().last().unwrap(), "SD");
    site.camera.forget_heard();
    site.bench.run_for(60 * SECOND);
    assert!(site.camera.rests.get());
    assert_eq!(site.camera.heard(), [""; 0]);
    // A question wakes it. It starts anew, and obeys then.
    site.pc.wish(FromPc::Sightings(site.camera_address()));
    site.bench.run_for(20 * SECOND);
    assert!(!site.camera.rests.get());
    assert!(site.camera.heard().contains(&"RS".to_owned()));
    assert!(site.command(CameraCommand::Track { colour: 0 }, 5 * SECOND));
}

#[test]
fn the_pc_commands_a_camera() {
    let mut site = Site::new();
    site.camera.sees(Some(40));
    site.bench.run_for(40 * SECOND);
    let address = site.camera_address();
    let command = CameraCommand::Track { colour: 0 };
    assert!(site.command(command, 5 * SECOND));
    let blob = TrackedBlob {
        middle: [40, 70],
        edges: [34, 57, 46, 82],
        pixels: 34,
        confidence: 200,
    };
    let told = site.pc.told();
    let tracked = told.iter().filter_map(|told| match told {
        ToPc::Tracked {
            address: of,
            tracked,
        } if *of == address => Some(tracked),
        _ => None,
    });
    let tracked: Vec<_> = tracked.collect();
    // Five times a second.
    assert!((20..=26).contains(&tracked.len()), "{}", tracked.len());
    for tracked in tracked {
        assert_eq!(tracked.blob, blob);
        // Column 40 of 88 is a little to the left of the middle.
        assert!(
            tracked
                .seen
                .is_some_and(|seen| seen.bearing > 0.0 && seen.bearing < 0.1)
        );
    }

    // A colour that would leave a gap is not learnt.
    let command = CameraCommand::LearnColour { colour: 3 };
    assert!(!site.command(command, 20 * SECOND));
    let before = site.pc.told().len();
    site.bench.run_for(20 * SECOND);
    assert_eq!(site.pc.told().len(), before, "no more packets");
}

/// A person sends a camera away, and shuts out every node that is not a member: the others go on under
/// another key.
#[test]
fn the_pc_sends_a_member_away_and_changes_the_key() {
    let mut site = Site::new();
    site.camera.sees(Some(40));
    site.bench.run_for(400 * SECOND);
    let camera = site.camera_address();
    site.pc.forget();
    for success in [true, false] {
        site.pc.wish(FromPc::Remove(camera));
        site.bench.run_for(20 * SECOND);
        let address = camera;
        let removed = ToPc::Removed { address, success };
        assert_eq!(site.pc.told(), [removed]);
        site.pc.forget();
    }
    assert!(!site.camera.lamps().joined);
    site.pc.wish(FromPc::Refresh);
    site.bench.run_for(SECOND);
    let is_camera = |told: &ToPc| matches!(told, ToPc::Member { address, .. } | ToPc::Report { address, .. } if *address == camera);
    assert!(!site.pc.told().iter().any(is_camera));
    assert!(site.pc.told().contains(&ToPc::KeyChange(None)));

    let key = SiteKey::new(2, core::array::from_fn(|i| 0x30 ^ i as u8));
    site.pc.wish(FromPc::ChangeKey(key));
    site.bench.run_for(10 * SECOND);
    let change = |done| {
        ToPc::KeyChange(Some(KeyChangeReport {
            index: 2,
            check: key.key().unwrap().check_value(),
            done,
            unreached: 0,
        }))
    };
    assert!(site.pc.told().contains(&change(false)));
    site.pc.wish(FromPc::Refresh);
    site.bench.run_for(SECOND);
    assert!(site.pc.told().contains(&change(true)));
    assert!(site.target.lamps().joined);
    // The camera, with the former key, is not let in any more; the target is after a restart.
    site.pc.wish(FromPc::JoinWindow(600));
    site.target.lamps.0.take();
    site.target.power(&mut site.bench, 13);
    site.bench.run_for(200 * SECOND);
    assert!(site.target.lamps().joined);
    assert!(!site.camera.lamps().joined);
    // No other network has its identifier; it can take another one, and its members follow.
    site.pc.forget();
    site.pc.wish(FromPc::Refresh);
    site.bench.run_for(SECOND);
    let told = site.pc.told();
    assert!(!told.iter().any(|told| matches!(told, ToPc::Pan { .. })));
    let pan = |told: &ToPc| match told {
        ToPc::Network(Some(network)) => Some(network.pan),
        _ => None,
    };
    let before = told.iter().find_map(pan);
    site.pc.forget();
    site.pc.wish(FromPc::ChangePan);
    site.bench.run_for(10 * SECOND);
    let told = site.pc.told();
    let (conflict_s, changes) = (None, true);
    assert!(told.contains(&ToPc::Pan {
        conflict_s,
        changes
    }));
    let after = told.iter().find_map(pan);
    assert!(after.is_some() && after != before, "{before:?} {after:?}");
    assert!(site.target.lamps().joined);
    // An impossible key is refused.
    site.pc.forget();
    let bad = SiteKey::new(0, [7; 16]);
    site.pc.wish(FromPc::ChangeKey(bad));
    site.bench.run_for(SECOND);
    assert!(site.pc.told().contains(&ToPc::KeyChange(None)));
}

/// Both the coordinator and its line send more than the other takes at a time.
#[test]
fn a_pc_that_writes_much_does_not_stop_the_coordinator() {
    let mut site = Site::new();
    site.bench.run_for(30 * SECOND);
    for _ in 0..100 {
        site.pc.wish(FromPc::Refresh);
    }
    site.bench.run_for(10 * SECOND);
    site.pc.forget();
    site.pc.wish(FromPc::Refresh);
    site.bench.run_for(SECOND);
    let told = site.pc.told();
    assert!(matches!(told.first(), Some(ToPc::Network(Some(_)))));
    let members = told
        .iter()
        .filter(|told| matches!(told, ToPc::Member { .. }));
    assert_eq!(members.count(), 2);
}

/// Its role goes on meanwhile: a member that comes back hears of the others.
#[test]
fn a_pc_that_takes_nothing_does_not_stop_the_coordinator() {
    let mut site = Site::new();
    site.camera.sees(Some(40));
    site.bench.run_for(40 * SECOND);
    site.coordinator.is_stalled.set(true);
    for _ in 0..20 {
        site.pc.wish(FromPc::Refresh);
    }
    site.bench.run_for(2 * SECOND);
    site.target.lamps.0.take();
    site.target.power(&mut site.bench, 13);
    site.bench.run_for(100 * SECOND);
    assert!(site.target.lamps().target_seen);
    site.coordinator.is_stalled.set(false);
    site.bench.run_for(40 * SECOND);
    site.pc.forget();
    site.pc.wish(FromPc::Refresh);
    site.bench.run_for(10 * SECOND);
    let told = site.pc.told();
    assert!(
        told.iter()
            .any(|told| matches!(told, ToPc::Network(Some(_))))
    );
}

/// Each loses its power once; the join window is closed by then.
#[test]
fn they_come_back_after_a_restart() {
    let mut site = Site::new();
    site.camera.sees(Some(40));
    site.bench.run_for(100 * SECOND);
    for number in 0..3 {
        site.camera.lamps.0.take();
        site.target.lamps.0.take();
        match number {
            0 => site.coordinator.power(&mut site.bench, 11),
            1 => site.camera.power(&mut site.bench, 12),
            _ => site.target.power(&mut site.bench, 13),
        }
        site.bench.run_for(30 * SECOND);
    }
    site.camera.sent.0.borrow_mut().clear();
    site.camera.sees(Some(41));
    site.target.step(1.0, 0.5);
    site.bench.run_for(30 * SECOND);
    assert_eq!(site.camera.looks().last(), Some(&Sight::InView));
    assert!(site.target.lamps().may_walk);
}

/// The target is the part of the view that differs from the background. A camera that lost its background,
/// with the target in its view, does not take a new one by itself.
#[test]
fn a_background_is_not_learnt_with_the_target_in_view() {
    let mut site = Site::new();
    let mut camera = camera_config(Some(Duty::First));
    camera.subjects = Subjects::Motion { threshold: 10 };
    site.camera.config.role = RoleConfig::Camera(camera);
    site.restart(20);
    let mut column = 8;
    let mut stop = |site: &mut Site| {
        // Elsewhere in view each time.
        column = 17 - column;
        site.camera.sees(Some(column));
        site.target.step(1.0, 0.5);
        site.bench.run_for(30 * SECOND);
        site.camera.looks().last().copied()
    };
    let backgrounds = |site: &Site| {
        let heard = site.camera.heard();
        heard.iter().filter(|line| line.starts_with("LF")).count()
    };
    site.camera.sees(Some(8));
    site.bench.run_for(40 * SECOND);
    assert_eq!(stop(&mut site), Some(Sight::InView));
    let learnt = backgrounds(&site);
    site.camera.line.unplug(false);
    assert_eq!(stop(&mut site), Some(Sight::Failed));
    site.camera.line.plug();
    for _ in 0..3 {
        assert_eq!(stop(&mut site), Some(Sight::Failed));
        assert_eq!(backgrounds(&site), learnt);
    }
    // A user who sees that the target is elsewhere wants it.
    assert!(site.command(CameraCommand::LearnBackground, 5 * SECOND));
    assert_eq!(stop(&mut site), Some(Sight::InView));
    assert_eq!(backgrounds(&site), learnt + 1);
}

/// Its gain and white balance are those of the light at its start. A carrier who goes on walking is
/// enough to make it see again.
#[test]
fn a_camera_adapts_to_another_daylight() {
    let mut site = Site::new();
    site.camera.sees(Some(40));
    site.bench.run_for(40 * SECOND);
    assert_eq!(site.camera.looks().last(), Some(&Sight::InView));
    site.camera.dazzle();
    site.camera.forget_heard();
    let stop = |site: &mut Site| {
        site.target.step(1.0, 0.5);
        site.bench.run_for(30 * SECOND);
        assert!(site.target.lamps().may_walk);
        site.camera.looks().last().copied()
    };
    let stops = (0..20).position(|_| stop(&mut site) == Some(Sight::InView));
    assert!(stops.is_some(), "{:?}", site.camera.looks());
    let heard = site.camera.heard();
    assert_eq!(heard.iter().filter(|line| *line == "RS").count(), 1);
    assert_eq!(stop(&mut site), Some(Sight::InView));
}
