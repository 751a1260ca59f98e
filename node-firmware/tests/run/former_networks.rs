//! Nodes whose network is no more, and starts in which the power or the flash fails.

use std::task::{Context, Poll, Waker};

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::NorFlash as _;
use node_firmware::{
    config::{RoleConfig, SiteKey},
    facts::{Fact, FactStore},
    limits::MEMBERS,
    message::References,
};
use zigbee_link::{
    store::{Member, Record, Saved, Store},
    wire::{Eui64, ShortAddress},
};

use crate::{
    bench::{Bench, Board, END, LINK, SECOND, Site},
    support::{flash::Flash, site::target_config},
};

/// What the link's half of a flash says.
pub(super) fn link(flash: &Flash) -> (Saved, Vec<Member>) {
    block_on(async {
        let mut store = Store::new(flash.copy(), 0..LINK).unwrap();
        let saved = store.load().await.unwrap();
        let mut members = Vec::new();
        for place in 0..MEMBERS as u8 {
            members.extend(store.member(place).await.unwrap());
        }
        (saved, members)
    })
}

/// What a role remembers.
fn facts(board: &Board) -> Vec<Fact> {
    let flash = board.flash.copy();
    let mut facts = Vec::new();
    block_on(async {
        let memory = FactStore::open(flash, LINK..END, board.config.owner()).await;
        let recalled = memory.unwrap().recall(|fact| facts.push(*fact)).await;
        recalled.unwrap();
    });
    facts
}

/// All that a node does before it waits for the first time.
fn start(board: &Board, bench: &Bench) -> Poll<String> {
    let mut node = board.firmware(bench, 77);
    node.as_mut().poll(&mut Context::from_waker(Waker::noop()))
}

/// A fact that is about addresses.
fn references() -> Fact {
    Fact::References(Some(References {
        first: 2,
        second: 1,
        positions: None,
    }))
}

fn remember(board: &Board) {
    let flash = board.flash.clone();
    block_on(async {
        let memory = FactStore::open(flash, LINK..END, board.config.owner()).await;
        memory.unwrap().save(&references()).await.unwrap();
    });
}

/// A site at work for a while, and switched off.
fn site() -> Site {
    let mut site = Site::new();
    site.camera.sees(Some(40));
    site.bench.run_for(100 * SECOND);
    site.switch_off();
    remember(&site.coordinator);
    remember(&site.camera);
    site
}

fn erase_link(flash: &Flash) {
    block_on(flash.clone().erase(0, LINK)).unwrap();
}

/// A network is void with a page that is taken, with a link range that was erased, with another
/// address of the coordinator. Addresses are given anew then, and what a role remembered of them
/// would be of others.
#[test]
fn facts_go_with_the_network() {
    let site = site();
    let limit = link(&site.coordinator.flash).0.counter_limit;
    assert_eq!(facts(&site.coordinator), [references()]);
    for (what, is_void) in [
        ("nothing", false),
        ("counter too low", false),
        ("counter", true),
        ("erased", true),
        ("address", true),
    ] {
        let mut site = self::site();
        let board = &mut site.coordinator;
        match what {
            "counter too low" => board.config.first_counter = limit,
            "counter" => board.config.first_counter = limit + 1,
            "erased" => erase_link(&board.flash),
            "address" => board.config.extended = Some([2, 0, 0, 0, 0, 0, 0, 9]),
            _ => {}
        }
        assert!(start(board, &site.bench).is_pending());
        assert_eq!(facts(board).contains(&references()), !is_void, "{what}");
        assert_eq!(link(&board.flash).1.is_empty(), is_void, "{what}");
        assert_eq!(link(&board.flash).0.network.is_none(), is_void, "{what}");
    }
    // And a camera's.
    let mut site = site;
    for is_void in [false, true] {
        let limit = link(&site.camera.flash).0.counter_limit;
        site.camera.config.first_counter = limit + u32::from(is_void);
        assert!(start(&site.camera, &site.bench).is_pending());
        assert_eq!(facts(&site.camera).contains(&references()), !is_void);
    }
}

/// A coordinator's members do not outlive their network: not when its address changes, not when its
/// board is another node in between, and not when firmware that left them there was.
#[test]
fn members_of_a_former_network_stay_out() {
    for what in ["address", "role", "left there"] {
        let mut site = site();
        assert_eq!(link(&site.coordinator.flash).1.len(), 2);
        let board = &mut site.coordinator;
        match &mut board.config.role {
            RoleConfig::Coordinator(own) => own.join_window_s = 0,
            _ => unreachable!(),
        }
        match what {
            "address" => board.config.extended = Some([2, 0, 0, 0, 0, 0, 0, 9]),
            "role" => {
                let role = RoleConfig::Target(target_config(0));
                let coordinator = core::mem::replace(&mut board.config.role, role);
                assert!(start(board, &site.bench).is_pending());
                board.config.role = coordinator;
            }
            _ => block_on(async {
                let mut store = Store::new(board.flash.clone(), 0..LINK).unwrap();
                store.load().await.unwrap();
                store.save(Record::Network(None)).await.unwrap();
            }),
        }
        // The new network comes, is written down, and is recalled.
        for seed in [30, 40] {
            site.restart(seed);
            site.bench.run_for(200 * SECOND);
            let (saved, members) = link(&site.coordinator.flash);
            let own = site.coordinator.config.extended.map(Eui64);
            assert_eq!(saved.network.map(|network| network.coordinator), own);
            assert_eq!(members, [], "{what}");
            // Nobody may join by now.
            assert_eq!(site.hellos().len(), 0, "{what}");
            assert!(!site.camera.lamps.0.get().joined, "{what}");
        }
    }
}

/// Any read of the flash at the start fails: the node does not go on with less than it knew.
#[test]
fn a_flash_that_fails_at_the_start_stops_the_node() {
    let mut site = site();
    let board = &mut site.coordinator;
    let before = board.flash.copy();
    let mut reads = 0;
    loop {
        reads += 1;
        board.flash = before.copy();
        board.flash.fail_read(reads);
        let started = start(board, &site.bench);
        if board.flash.wear().reads - before.wear().reads < reads.into() {
            assert!(started.is_pending());
            break;
        }
        let failure = Poll::Ready("the flash failed".to_owned());
        assert_eq!(started, failure, "read {reads}");
    }
    assert!(reads > 300, "{reads} are too few to be all");
}

/// The power fails at each moment of a start with a page that is taken. Then the node starts with
/// it, and neither recalls facts of the former network nor falls below a counter it used.
#[test]
fn power_cuts_at_the_start_are_survived() {
    let mut site = site();
    let used = link(&site.coordinator.flash).0.counter_limit;
    let board = &mut site.coordinator;
    let before = board.flash.copy();
    let fresh = before.copy();
    block_on(fresh.clone().erase(0, END)).unwrap();
    let (old, new) = (board.config.site_key, SiteKey::new(2, *b"fedcba9876543210"));
    for (flash, key, counter, lowest) in [
        (&fresh, old, 1, 1),
        (&before, old, used + 1, used + 1),
        (&before, new, 1, used),
    ] {
        board.config.site_key = key;
        board.config.first_counter = counter;
        let mut cuts = 0;
        loop {
            cuts += 1;
            board.flash = flash.copy();
            board.flash.power(Some(cuts));
            let started = start(board, &site.bench);
            let is_cut = !board.flash.has_power();
            board.flash.power(None);
            if is_cut {
                assert!(started.is_ready());
            }
            assert!(start(board, &site.bench).is_pending(), "cut at {cuts}");
            let (saved, members) = link(&board.flash);
            assert_eq!(Some(saved.active_key), key.key(), "cut at {cuts}");
            assert!(saved.counter_limit >= lowest, "cut at {cuts}");
            assert_eq!((saved.network, members), (None, vec![]));
            assert_eq!(facts(board), [], "cut at {cuts}");
            if !is_cut {
                break;
            }
        }
        assert!(cuts > 60, "{cuts} changes are too few to be all");
    }
}

/// With the same key and a frame counter just above the former limit, every frame is above it.
#[test]
fn the_counter_goes_on_above_the_former_limit() {
    let mut site = site();
    let limit = link(&site.camera.flash).0.counter_limit;
    let before = site.bench.counters(&site.camera);
    assert!(before.iter().all(|&(_, counter)| counter < limit));
    site.camera.config.first_counter = limit + 1;
    // The coordinator's window is open again.
    site.restart(30);
    site.bench.run_for(50 * SECOND);
    let used = site.bench.counters(&site.camera);
    let mut counters: Vec<_> = used.difference(&before).map(|used| used.1).collect();
    counters.sort_unstable();
    assert!(counters.len() > 10);
    assert_eq!(counters[0], limit + 1);
    assert!(link(&site.camera.flash).0.counter_limit > limit + 1);
    let camera = link(&site.camera.flash).0.network.unwrap().short;
    assert_ne!(camera, ShortAddress::UNASSIGNED);
}
