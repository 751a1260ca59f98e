//! A coordinator is provisioned anew while the other nodes go on: they find themselves in another
//! network, in which addresses are those of others.

use crate::support;

use node_firmware::{facts::Fact, message::Message, role::camera};
use support::{
    bus::PERFECT,
    net::{Net, SECOND, from_to, refining, same, with_references},
    site::camera_config,
};

/// Addresses in the new network: the cameras, the target.
const ADDRESSES: ([u16; 5], u16) = ([2, 10, 1, 5, 4], 3);

const NEW_PAN: u16 = 0x4321;

/// The coordinator begins anew. All nodes lose the network, and join the next one.
fn provision_coordinator(net: &mut Net) {
    net.coordinator.erase();
    net.coordinator.restart(net.now);
    for camera in &mut net.cameras {
        camera.detach(net.now);
    }
    net.target.detach(net.now);
    net.run_for(10 * SECOND);
    let (cameras, target) = ADDRESSES;
    net.coordinator.join(net.now, NEW_PAN, 0);
    for (camera, address) in net.cameras.iter_mut().zip(cameras) {
        camera.join(net.now, NEW_PAN, address);
    }
    net.target.join(net.now, NEW_PAN, target);
    net.run_for(10 * SECOND);
}

fn restart_all(net: &mut Net) {
    for camera in &mut net.cameras {
        camera.restart(net.now);
        camera.event(net.now, camera::CameraEvent::Ready);
    }
    net.target.restart(net.now);
    net.coordinator.restart(net.now);
    net.run_for(5 * SECOND);
}

/// The references were elected, and have not solved yet.
#[test]
fn references_of_a_former_network_are_none() {
    let config = |n: usize| {
        let mut camera = camera_config(None);
        camera.may_be_elected = n < 2;
        camera
    };
    for (seed, is_restarted) in [(1, false), (2, true), (3, false), (4, true)] {
        let mut net = Net::new(PERFECT, seed, config);
        net.walk_to(2);
        let elected = |camera: &support::bus::Station<camera::CameraRole>| {
            let mut facts = camera.facts.iter();
            facts.any(|fact| matches!(fact, Fact::References(Some(_))))
        };
        assert!(net.cameras[..2].iter().all(elected));
        provision_coordinator(&mut net);
        if is_restarted {
            restart_all(&mut net);
        }
        net.wait();
        net.walk_to(10);
        assert!(net.are_all_done(), "{:?}", net.reports());
        if net.reports()[0].duty == Some(node_firmware::message::Duty::First) {
            net.check_poses(from_to(0, 1), 5.0);
        } else {
            net.check_poses(from_to(1, 0), 5.0);
        }
    }
}

/// A camera that is done keeps its pose, for it stands where it stood. Others begin anew: the targets of
/// their sightings are not known.
#[test]
fn poses_outlive_a_network_and_sightings_do_not() {
    let mut net = Net::new(PERFECT, 5, |n| {
        if n == 4 {
            refining(n)
        } else {
            with_references(n)
        }
    });
    net.walk_to(6);
    let before = net.reports();
    assert!(before[..4].iter().all(|report| report.done));
    assert!(!before[4].done && before[4].sightings > 0);
    provision_coordinator(&mut net);
    let after = net.reports();
    assert_eq!(after[..4], before[..4]);
    assert_eq!(
        net.cameras[4].recalled_sightings(),
        usize::from(after[4].sightings)
    );
    assert!(after[4].sightings <= 1, "{:?}", after[4]);
    let (cameras, _) = ADDRESSES;
    for _ in 0..2 {
        net.walk();
        let mut known: Vec<_> = net
            .target
            .role
            .cameras()
            .map(|camera| camera.address)
            .collect();
        known.sort_unstable();
        let mut addresses = cameras;
        addresses.sort_unstable();
        assert_eq!(known, addresses);
        for (address, report) in cameras.into_iter().zip(net.reports()) {
            let mut table = net.target.role.cameras();
            let entry = table.find(|camera| camera.address == address).unwrap();
            assert!(entry.report.is_none_or(|known| known.id == report.id));
        }
        restart_all(&mut net);
    }
    net.walk_to(20);
    net.check_poses(same, 5.0);
    assert!(net.target.role.position().1);
    net.check_target(0.3);
}

/// A camera that triggers where others know their poses would begin a second frame.
#[test]
fn nobody_is_elected_where_poses_are_known() {
    let config = |n: usize| {
        let mut camera = camera_config(None);
        camera.may_be_elected = true;
        camera.stops = if n < 2 { 3 } else { 12 };
        camera
    };
    let mut net = Net::new(PERFECT, 6, config);
    for camera in &mut net.cameras[2..] {
        camera.is_off = true;
    }
    net.walk_to(4);
    assert!(net.reports()[..2].iter().all(|report| report.done));
    let duty = net.reports()[0].duty;
    provision_coordinator(&mut net);
    for camera in &mut net.cameras[2..] {
        camera.is_off = false;
    }
    for event in [support::target::BROKEN, support::target::WORKS] {
        net.target.event(net.now, event);
    }
    net.run_for(SECOND);
    net.walk_to(18);
    let appointed = |fact: &Fact| matches!(fact, Fact::References(Some(_)));
    assert!(!net.coordinator.facts.iter().any(appointed));
    assert!(net.are_all_done(), "{:?}", net.reports());
    if duty == Some(node_firmware::message::Duty::First) {
        net.check_poses(from_to(0, 1), 5.0);
    } else {
        net.check_poses(from_to(1, 0), 5.0);
    }
}

/// The coordinator changes the identifier of its network; or a node was out of reach for a while.
/// That is the same network.
#[test]
fn the_same_network_is_known_again() {
    let mut net = Net::new(PERFECT, 5, refining);
    net.walk_to(6);
    net.run_for(10 * SECOND);
    let before = net.reports();
    for (pan, is_away) in [(NEW_PAN, false), (NEW_PAN, true), (NEW_PAN + 1, false)] {
        let (now, facts) = (net.now, net.cameras[4].facts.len());
        for camera in &mut net.cameras {
            if is_away {
                camera.detach(now);
            }
            let address = camera.address.0;
            camera.join(now, pan, address);
        }
        net.run_for(SECOND);
        assert_eq!(net.reports(), before);
        // The identifier is all that is new.
        assert!(net.cameras[4].facts.len() <= facts + 1);
    }
    for camera in &mut net.cameras {
        camera.restart(net.now);
    }
    net.run_for(SECOND);
    assert_eq!(net.reports(), before);
    assert!(net.cameras[4].recalled_sightings() > 1);
}

/// The power fails while the former network is forgotten. Then it is forgotten after the restart.
#[test]
fn a_cut_while_a_network_is_forgotten_leaves_nothing() {
    let config = |n: usize| {
        let mut camera = with_references(n);
        camera.stops = 12;
        camera
    };
    let of_network = |facts: &[Fact]| {
        let of = |fact: &&Fact| {
            matches!(
                fact,
                Fact::References(Some(_))
                    | Fact::Sighting(_, Some(_))
                    | Fact::ReferenceStop(_, Some(_))
                    | Fact::Posed(Some(_))
                    | Fact::Camera(_, Some(_))
            )
        };
        facts.iter().filter(of).count()
    };
    for cut in 1.. {
        // One with stops of a reference, one with sightings, and the target.
        let mut net = Net::new(PERFECT, 5, config);
        net.walk_to(2);
        let unsolved = net.cameras.remove(0);
        let mut net = Net::new(PERFECT, 5, config);
        net.walk_to(6);
        let sighted = net.cameras.remove(4);
        let now = net.now;
        let mut is_whole = true;
        for (mut camera, address) in [(unsolved, 2), (sighted, 4)] {
            assert!(of_network(&camera.recalled()) > 2);
            camera.is_off = true;
            camera.detach(now);
            camera.facts_left = Some(cut);
            camera.join(now, NEW_PAN, address);
            support::bus::AnyStation::act(&mut camera, now, &mut net.air);
            is_whole &= camera.facts_left != Some(0);
            camera.facts_left = None;
            camera.restart(now);
            support::bus::AnyStation::act(&mut camera, now, &mut net.air);
            assert_eq!(of_network(&camera.recalled()), 0, "cut at {cut}");
            assert_eq!(camera.role.report().sightings, 0);
        }
        let target = &mut net.target;
        assert_eq!(of_network(&target.recalled()), 5);
        target.is_off = true;
        target.detach(now);
        target.facts_left = Some(cut);
        target.join(now, NEW_PAN, 3);
        support::bus::AnyStation::act(target, now, &mut net.air);
        is_whole &= target.facts_left != Some(0);
        assert!(target.role.position().1, "it stands where it stood");
        target.facts_left = None;
        target.restart(now);
        support::bus::AnyStation::act(target, now, &mut net.air);
        assert_eq!(of_network(&target.recalled()), 0, "cut at {cut}");
        assert_eq!(target.role.cameras().count(), 0);
        if is_whole {
            assert!(cut > 5, "{cut}");
            break;
        }
    }
}

/// The first reference had solved, and no other node heard of it. Messages that waited in the former network
/// are not sent to others in the next; and its pose alone would be of no use there.
#[test]
fn nothing_is_sent_to_former_addresses() {
    let mut net = Net::new(PERFECT, 7, with_references);
    net.walk_to(2);
    net.step_until_confirmed(0);
    net.cameras[0].is_mute = true;
    while net.poses()[0].is_none() {
        net.run_for(1_000);
    }
    net.cameras[0].is_mute = false;
    let before = net.air.sent.len();
    provision_coordinator(&mut net);
    let told = |message: &Message| matches!(message, Message::Located(_) | Message::Posed(_));
    let sent = &net.air.sent[before..];
    assert!(!sent.iter().any(|sent| told(&sent.message)));
    net.walk_to(12);
    assert!(net.are_all_done(), "{:?}", net.reports());
    net.check_poses(same, 5.0);
}
