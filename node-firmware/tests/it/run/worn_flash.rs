//! Flash that is worn out or has rotted: nodes work from RAM and say so.

use std::{
    collections::HashSet,
    task::{Context, Waker},
};

use embassy_futures::block_on;
use node_firmware::{
    config::RoleConfig,
    console::ToPc,
    message::{Memory, Sight},
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use zigbee_link::{security::BLOCK, store::Store, wire::Eui64};

use crate::run::{
    bench::{Bench, Board, END, LINK, SECOND, Site},
    support::{flash::Fault, site::target_config},
};

const FAULTS: [Fault; 3] = [Fault::Fails, Fault::Lost, Fault::Sticks];

/// Another one at each start.
fn random(round: u64, start: u64) -> u64 {
    ChaCha8Rng::seed_from_u64(100 * round + start).random()
}

/// Returns true if the PC was told that the node of this number, or the coordinator, works from RAM.
fn is_told(site: &Site, id: Option<u16>) -> bool {
    let told = site.pc.told();
    let address = told.iter().rev().find_map(|line| match line {
        ToPc::Member { address, hello } if Some(hello.id) == id => Some(*address),
        _ => None,
    });
    let address = address.unwrap_or(0);
    told.iter().any(|line| {
        matches!(line, ToPc::Health { address: of, health }
            if *of == address && health.memory == Memory::Ram)
    })
}

/// At every start, and in the middle of its work. It goes on with its work.
#[test]
fn a_camera_with_a_worn_flash_works_and_says_so() {
    for (round, fault) in (1..).zip(FAULTS) {
        for range in [0..END, LINK..END] {
            let mut site = Site::new();
            site.camera.sees(Some(40));
            site.bench.run_for(50 * SECOND);
            assert!(!is_told(&site, Some(101)));
            // Writes of the role are tried in the middle of its work, writes of the link at a start: it would
            // restart.
            site.camera.faults.set(fault, 1.0, range.clone(), round);
            if range.start == 0 {
                site.camera.power(&mut site.bench, random(round, 0));
            }
            for start in 1..=3 {
                site.bench.run_for(40 * SECOND);
                site.target.step(1.0, 0.0);
                site.bench.run_for(40 * SECOND);
                let what = format!("{fault:?} in {range:?}, start {start}");
                let looks = site.camera.looks();
                assert!(looks.contains(&Sight::InView), "{what}: {looks:?}");
                assert_eq!(
                    site.camera.liveness.borrow().memory(),
                    Memory::Ram,
                    "{what}"
                );
                assert!(is_told(&site, Some(101)), "{what}");
                site.camera.sent.0.borrow_mut().clear();
                site.camera.power(&mut site.bench, random(round, start));
            }
        }
    }
}

/// It forms another network at each start, and the members of the last one come.
#[test]
fn a_coordinator_with_a_worn_flash_works_and_says_so() {
    for (round, fault) in (1..).zip(FAULTS) {
        let mut site = Site::new();
        site.bench.run_for(50 * SECOND);
        site.coordinator.faults.set(fault, 1.0, 0..END, round);
        for start in 1..=2 {
            site.pc.forget();
            site.coordinator
                .power(&mut site.bench, random(round, start));
            site.bench.run_for(300 * SECOND);
            assert_eq!(site.coordinator.liveness.borrow().memory(), Memory::Ram);
            assert!(is_told(&site, None), "{fault:?}: {:?}", site.pc.told());
            assert!(site.coordinator.lamps().joined);
        }
    }
}

/// Operations fail or are lost, bits flip anywhere under the log, at starts and in between, as they come.
/// No extended address, key and frame counter occur together twice, and no node stops for good.
#[test]
fn no_nonce_twice_whatever_the_flash_does() {
    const CASES: usize = 10_000;
    let mut rng = ChaCha8Rng::seed_from_u64(0xf1a5);
    let mut bench = Bench::new();
    let mut board = Board::new(&mut bench, RoleConfig::Target(target_config(0)));
    let whole = board.flash.copy();
    let mut nonces = HashSet::new();
    let mut counts = [0_usize; 3];
    for case in 0..CASES {
        match rng.random_range(0..8) {
            // A new board, for one that has rotted is never well again.
            0 => board.flash = whole.copy(),
            1..4 => {
                for _ in 0..rng.random_range(1..4) {
                    let at = rng.random_range(0..LINK as usize);
                    board.flash.bytes_mut()[at] ^= 1 << rng.random_range(0..8);
                }
            }
            4 => board.faults.clear(),
            _ => {
                let fault = FAULTS[rng.random_range(0..FAULTS.len())];
                let share = if rng.random() { 1.0 } else { 0.2 };
                // The role's part alone would change nothing here.
                board.faults.set(fault, share, 0..LINK, case as u64);
            }
        }
        let seed: u64 = rng.random();
        let started = {
            let mut node = board.firmware(&bench, seed);
            node.as_mut().poll(&mut Context::from_waker(Waker::noop()))
        };
        if started.is_ready() {
            // Before it sent anything, and it is started again.
            counts[0] += 1;
            continue;
        }
        if board.liveness.borrow().memory() == Memory::Ram {
            counts[1] += 1;
        }
        let mut store = Store::new(board.flash.copy(), 0..LINK).unwrap();
        let saved = block_on(store.load()).ok();
        let drawn = Eui64::of_node(board.config.id, !seed);
        let in_flash = saved.filter(|_| board.liveness.borrow().memory() == Memory::Flash);
        let (own, limit) = match in_flash {
            Some(saved) => {
                counts[2] += 1;
                (saved.extended.unwrap(), saved.counter_limit)
            }
            None => (drawn, BLOCK),
        };
        assert!(limit >= BLOCK);
        for counter in [limit - BLOCK, limit - 1] {
            assert!(
                nonces.insert((own, counter)),
                "{own:?} {counter} twice, case {case}"
            );
        }
    }
    println!("{counts:?}: started again, in RAM, in flash");
    assert!(
        counts[1] > CASES / 20 && counts[2] > CASES / 10,
        "{counts:?}"
    );
}
