//! Nodes whose network is no more, and starts in which the power or the flash fails.

use std::{
    collections::HashSet,
    task::{Context, Poll, Waker},
};

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::NorFlash as _;
use node_firmware::{
    config::{RoleConfig, SiteKey},
    facts::{Fact, FactStore},
    limits::MEMBERS,
    message::{Memory, References},
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use zigbee_link::{
    security::BLOCK,
    store::{Member, Record, Saved, Store},
};

use crate::run::{
    bench::{Bench, Board, END, LINK, SECOND, Site},
    support::{flash::Flash, site::target_config},
};

/// Contents of the link's half of a flash.
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

/// Facts that a role remembers.
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

pub(super) fn erase_link(flash: &Flash) {
    block_on(flash.clone().erase(0, LINK)).unwrap();
}

/// A network is void with a page of another key, with a link range that was erased, with another number of
/// the node. Addresses are given anew then, and the facts that a role remembered of them would be of others.
#[test]
fn facts_go_with_the_network() {
    let site = site();
    assert_eq!(facts(&site.coordinator), [references()]);
    for (what, is_void) in [
        ("nothing", false),
        ("key", true),
        ("erased", true),
        ("number", true),
    ] {
        let mut site = self::site();
        let board = &mut site.coordinator;
        match what {
            "key" => board.config.site_key = SiteKey::new(2, *b"fedcba9876543210"),
            "erased" => erase_link(&board.flash),
            "number" => board.config.id = 9,
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
        if is_void {
            site.camera.config.site_key = SiteKey::new(2, *b"fedcba9876543210");
        }
        assert!(start(&site.camera, &site.bench).is_pending());
        assert_eq!(facts(&site.camera).contains(&references()), !is_void);
    }
}

/// A coordinator's members do not outlive their network: not when its address changes, not when its
/// board is another node in between, and not when firmware that left them there was.
#[test]
fn members_of_a_former_network_stay_out() {
    for what in ["number", "role", "left there"] {
        let mut site = site();
        assert_eq!(link(&site.coordinator.flash).1.len(), 2);
        let board = &mut site.coordinator;
        match &mut board.config.role {
            RoleConfig::Coordinator(own) => own.join_window_s = 0,
            _ => unreachable!(),
        }
        match what {
            "number" => board.config.id = 9,
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
            let own = saved.extended;
            assert_eq!(saved.network.map(|network| network.coordinator), own);
            assert_eq!(members, [], "{what}");
            // No node may join by now.
            assert_eq!(site.hellos().len(), 0, "{what}");
            assert!(!site.camera.lamps().joined, "{what}");
        }
    }
}

/// Any read of the flash at the start fails once: the node does not go on with less than it knew.
#[test]
fn a_read_that_fails_once_at_the_start_costs_nothing() {
    let mut site = site();
    let board = &mut site.coordinator;
    let before = board.flash.copy();
    let mut reads = 0;
    loop {
        reads += 1;
        board.flash = before.copy();
        board.flash.fail_read(reads);
        assert!(start(board, &site.bench).is_pending());
        assert_eq!(board.liveness.borrow().memory(), Memory::Flash);
        let is_over = board.flash.wear().reads - before.wear().reads < reads.into();
        board.flash.fail_read(u32::MAX);
        let [(former, former_members), (saved, members)] = [&before, &board.flash].map(link);
        assert_eq!(
            (saved.network, saved.extended),
            (former.network, former.extended)
        );
        assert_eq!(members, former_members);
        assert_eq!(saved.counter_limit, former.counter_limit + BLOCK);
        if is_over {
            break;
        }
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
    for (flash, key, lowest) in [(&fresh, old, 0), (&before, new, used)] {
        board.config.site_key = key;
        let mut cuts = 0;
        loop {
            cuts += 1;
            board.flash = flash.copy();
            board.flash.power(Some(cuts));
            let started = start(board, &site.bench);
            // Where this is taken for a flash that fails, the node works from RAM until the power is gone.
            let is_cut = !board.flash.has_power();
            board.flash.power(None);
            drop(started);
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

/// Events of a node, in any order: pages with keys old and new, other numbers, erasures, power cuts in the
/// middle of a start or of a write, and starts after which it sends. No extended address, key and frame
/// counter occur together twice.
#[test]
fn no_nonce_twice_whatever_is_provisioned() {
    const CUTS: u32 = 10_000;
    let mut rng = ChaCha8Rng::seed_from_u64(0x5eed);
    let keys = [
        SiteKey::new(1, *b"0123456789abcdef"),
        SiteKey::new(2, *b"fedcba9876543210"),
        SiteKey::new(1, *b"fedcba9876543210"),
    ];
    let mut bench = Bench::new();
    let mut board = Board::new(&mut bench, RoleConfig::Target(target_config(0)));
    let mut nonces = HashSet::new();
    let (mut cuts, mut addresses) = (0, HashSet::new());
    while cuts < CUTS {
        match rng.random_range(0..16) {
            0 => block_on(board.flash.clone().erase(0, LINK)).unwrap(),
            1 => block_on(board.flash.clone().erase(0, END)).unwrap(),
            2..5 => board.config.site_key = keys[rng.random_range(0..keys.len())],
            5 => board.config.id = rng.random_range(1..3),
            6 => {
                board.config.role = match board.config.role {
                    RoleConfig::Target(_) => RoleConfig::Coordinator(Default::default()),
                    _ => RoleConfig::Target(target_config(0)),
                }
            }
            _ => {}
        }
        let is_cut = rng.random_bool(0.7);
        let after = rng.random_range(1..60);
        board.flash.power(is_cut.then_some(after));
        let started = {
            let mut node = board.firmware(&bench, rng.random());
            node.as_mut().poll(&mut Context::from_waker(Waker::noop()))
        };
        if !board.flash.has_power() {
            cuts += 1;
            board.flash.power(None);
            continue;
        }
        assert!(started.is_pending(), "{started:?}");
        board.flash.power(None);
        // It may have sent under any counter from the limit it began with to the one it has now.
        let (saved, _) = link(&board.flash);
        let own = saved.extended.unwrap();
        addresses.insert(own);
        let limit = saved.counter_limit;
        assert!(limit >= BLOCK);
        for counter in [limit - BLOCK, limit - 1] {
            let nonce = (own, saved.active_key.check_value(), counter);
            assert!(nonces.insert(nonce), "{nonce:?} twice");
        }
    }
    assert!(addresses.len() > 100, "{}", addresses.len());
}
